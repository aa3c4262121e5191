"""`cablecast camera`: check the camera of a lab file, and compare its clock with the robot's."""

import dataclasses
import pathlib
import typing
from typing import TYPE_CHECKING, Annotated

import tyro

from cablecast.cli.options import EXIT_FALLS_SHORT, argument
from cablecast.cli.tables import make_table, print_table
from cablecast.errors import InputError

if TYPE_CHECKING:
    from cablecast.setup import Setup
    from cablecast.vision.check import CameraReport

Task = typing.Literal["check", "sync"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class CameraVerb:
    """Check the camera of a lab file (check), or compare its clock with the robot's (sync).

    The task `check` says on one page what was asked of the camera and what it does: frame rate,
    lost frames, exposure, blur at the speed of the cable's end, tags seen, misfit of the
    calibration, and what to change. The exit status is 3 if there is anything to change. `sync`
    finds the offset of the two clocks, says how sure it is, and writes it into the lab file: the
    robot of the lab file is reset and makes one cast at the speed of the lab file; or give a film
    of a swing and the robot's log of it. Either takes seconds to a minute. docs/camera.md explains
    both.
    """

    task: Annotated[tyro.conf.Positional[Task], argument("check|sync")]
    """Task: check or sync."""
    setup: Annotated[pathlib.Path, argument("FILE")]
    """Lab file with the section `camera`."""
    seconds: Annotated[float, argument("S")] = 3.0
    """Time to look at the camera, for check [s]."""
    tip_speed: Annotated[float, argument("M/S")] = 5.0
    """Speed of the cable's end for which the blur is stated, for check [m/s]."""
    picture: Annotated[pathlib.Path | None, argument("FILE", "not kept")] = None
    """Keep the last picture, with the tags and the table's edges drawn into it, for check."""
    pick: bool = False
    """Learn hue and size of the marker that lies at the end of the cable, and write them into the
    lab file, for check."""
    at: Annotated[tuple[float, float] | None, argument("X Y", "where a reset lays the end")] = None
    """Place near the marker, for --pick [m]."""
    film: Annotated[pathlib.Path | None, argument("FILE", "the robot makes a cast")] = None
    """Film of the swinging arm, for sync."""
    log: Annotated[pathlib.Path | None, argument("FILE", "the robot makes a cast")] = None
    """CSV of what the robot reported of that swing: time_s [s] and q1 to q6 [rad], for sync."""
    begin: Annotated[float, argument("S")] = 0.0
    """Time of the camera's clock at the first frame of the film, for sync [s]."""
    write: Annotated[bool, argument("", "it is changed")] = True
    """Leave the lab file as it is. Otherwise it gets the offset, or the marker of --pick."""

    def run(self) -> int:
        """Check or sync, and print what was found; return the exit status."""
        return self._check() if self.task == "check" else self._sync()

    def _check(self) -> int:
        from cablecast.pipeline.camera import check_camera
        from cablecast.setup import load_setup

        setup = load_setup(self.setup)
        report = check_camera(setup, seconds=self.seconds, tip_speed=self.tip_speed)
        advice = report.advice()
        _print_report(report, advice)
        if self.pick:
            self._pick(report, setup)
        if self.picture is not None:
            from cablecast.files import write_bytes
            from cablecast.vision.check import draw_report
            from cablecast.vision.plane import SeenPlane

            write_bytes(self.picture, draw_report(report, SeenPlane.of(setup)))
            print(f"picture   {self.picture}")
        return EXIT_FALLS_SHORT if advice else 0

    def _pick(self, report: "CameraReport", setup: "Setup") -> None:
        from cablecast.setup import update_lab_file
        from cablecast.vision.plane import SeenPlane
        from cablecast.vision.tracker import pick_marker

        if report.calibration is None:
            raise InputError(f"no marker without the table: {report.calibration_error}")
        plane = SeenPlane.of(setup)
        at, z = self.at or plane.start, plane.height
        found = pick_marker(report.image, report.calibration.view, plane.area, at, z)
        if found is None:
            raise InputError(
                f"no marker is seen near x, y = {at[0]:.2f}, {at[1]:.2f} m: wrap vivid tape of "
                "another colour than the cable around its end, or say where it lies (--at)"
            )
        size = [round(found.length, 3), round(found.width, 3)]
        values = {"marker": size, "marker_hue": round(found.hue, 1)}
        print(f"marker    hue {found.hue:.0f} deg, {1e3 * size[0]:.0f} x {1e3 * size[1]:.0f} mm")
        if self.write:
            update_lab_file(self.setup, {"camera": values})
            print(f"written   {self.setup}")

    def _sync(self) -> int:
        from cablecast.pipeline.camera import sync_camera, sync_film
        from cablecast.setup import load_setup, update_lab_file

        setup = load_setup(self.setup)
        if self.film is not None and self.log is not None:
            found = sync_film(setup, self.film, self.log)
            offset = found.offset - self.begin
        elif self.film is not None or self.log is not None or setup.robot is None:
            raise InputError(
                "sync needs a film of the swinging arm (--film) and its log (--log), or a robot in "
                "the lab file that makes one cast"
            )
        else:
            found = sync_camera(setup)
            offset = found.offset
        print(
            f"offset     {offset:.5f} s: the robot's clock when the camera's shows zero\n"
            f"uncertain  {1e3 * found.sd:.2f} ms (standard deviation)\n"
            f"explained  {100 * found.explained:.1f} % of what moved in {found.frame_count} frames"
        )
        if self.write:
            values = {"clock_offset": round(offset, 6), "clock_offset_sd": round(found.sd, 6)}
            update_lab_file(self.setup, {"camera": values})
            print(f"written    {self.setup}")
        return 0


def _print_report(report: "CameraReport", advice: list[str]) -> None:
    """Print the page of a check."""
    asked, facts = report.settings, report.facts
    table = make_table(f"Camera {asked.source}")
    for heading in ("", "asked", "is"):
        table.add_column(heading)
    exposure = "unknown" if facts.exposure is None else f"{1e3 * facts.exposure:.2f} ms"
    lost = f"{report.missed_count} by the camera, {report.dropped_count} by this computer"
    flicker = "none"
    if report.flicker is not None:
        flicker = f"{100 * report.flicker.amplitude:.0f} % at {report.flicker.rate:g} Hz"
    bright, sd = report.brightness, asked.clock_offset_sd
    rows = [
        ("size", f"{asked.width} x {asked.height} px", f"{facts.width} x {facts.height} px"),
        ("format", asked.fourcc, f"{facts.fourcc or 'unknown'} ({facts.backend})"),
        ("frames/s", f"{asked.rate:g}", f"{report.rate:.2f}"),
        ("frames/s by arrival", "", f"{report.arrival_rate:.2f}"),
        ("lost frames", "0", f"{lost}, of {report.frame_count}"),
        ("exposure", f"{1e3 * asked.exposure:.2f} ms", exposure),
        ("automatic exposure", "off", _switch(facts.auto_exposure)),
        ("automatic white balance", "off", _switch(facts.auto_balance)),
        ("autofocus", "off", _switch(facts.autofocus)),
        ("repeated frames", "0", str(report.repeated_count)),
        ("flicker", "below 5 %", flicker),
        ("brightness", "", f"{bright.mean:.0f} of 255, {100 * bright.clipped:.1f} % saturated"),
        (
            "blur",
            f"below {1e3 * asked.marker[0]:.0f} mm",
            f"{1e3 * report.blur:.1f} mm at {report.tip_speed:g} m/s",
        ),
        ("tags", str(report.tag_count), str(len(report.tags_seen))),
    ]
    if (calibration := report.calibration) is not None:
        if calibration.turned:
            rows.append(
                ("orientation of the tags", "", "turned by 180 deg against OpenCV's pictures")
            )
        rms = f"{1e3 * calibration.rms:.1f} mm, {calibration.rms_px:.2f} px"
        rows.append(("misfit of the tags", "below 3 mm", rms))
        rows.append(("scale", "", f"{report.px_per_m / 1e3:.2f} px/mm"))
    offset = "not measured" if sd is None else f"{asked.clock_offset:.4f} s, +- {1e3 * sd:.1f} ms"
    for row in (*rows, ("clock offset", "measured", offset)):
        table.add_row(*row)
    print_table(table, *(f"change: {line}" for line in advice))
    if not advice:
        print("nothing to change")


def _switch(state: bool | None) -> str:
    return {None: "unknown", True: "on", False: "off"}[state]
