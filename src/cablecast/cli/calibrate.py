"""`cablecast calibrate`: where the robot stands at the table, and the lens of the camera."""

import contextlib
import dataclasses
import math
import pathlib
import shlex
import sys
import typing
from typing import TYPE_CHECKING, Annotated

import tyro

from cablecast.cli.options import argument, picked
from cablecast.errors import InputError

if TYPE_CHECKING:
    from cablecast.camera.tags import Point

What = typing.Literal["table", "lens"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Calibrate:
    """Find where the robot stands at the table (table), or the lens of the camera (lens).

    For `table`, touch the centres of at least six tags with the tip of the tool, and give the
    points that the controller shows in its base frame, as a file or one by one. The fit names tags
    that lie elsewhere, and writes the base's height and yaw, the table's near edge and the tags'
    places into the lab file. For `lens`, show the board to the camera, or give pictures of it. The
    older pattern of ChArUco boards is read too. Either takes seconds of computing, and a person
    some minutes. docs/camera.md explains both.
    """

    what: Annotated[tyro.conf.Positional[What], argument("table|lens")]
    """Thing to calibrate."""
    setup: Annotated[pathlib.Path, argument("FILE")]
    """Lab file with the section `camera`, which is changed."""
    touched: Annotated[pathlib.Path | None, argument("FILE", "typed one by one")] = None
    """CSV of the touched points, for table: tag, x_m, y_m, z_m in the controller's base frame."""
    pictures: Annotated[pathlib.Path | None, argument("DIR", "taken from the camera")] = None
    """Folder of pictures of the board, for lens."""
    count: Annotated[int, argument("N")] = 15
    """Pictures to take from the camera, for lens."""
    squares: Annotated[tuple[int, int], argument("ACROSS DOWN")] = (11, 8)
    """Number of squares of the board, for lens."""
    square: Annotated[float, argument("M")] = 0.06
    """Side of a square of the board, for lens [m]."""
    tag: Annotated[float, argument("M")] = 0.045
    """Side of a tag on the board, for lens [m]."""
    family: Annotated[str, argument("NAME")] = "4X4_100"
    """Family of the tags on the board, for lens, such as 5X5_100."""
    write: Annotated[bool, argument("", "it is changed")] = True
    """Leave the lab file as it is. Otherwise it gets the result."""

    def run(self) -> None:
        """Calibrate, write and print."""
        if self.what == "table":
            self._table()
        else:
            self._lens()
        print(f"written   {self.setup}" if self.write else "not written")

    def _table(self) -> None:
        from cablecast.camera.tags import read_touches
        from cablecast.pipeline.camera import AXIS_OFFSET_MAX, calibrate_table
        from cablecast.setup import load_setup
        from cablecast.vision.trials import require_camera, tags_of

        setup = load_setup(self.setup)
        require_camera(setup)
        if self.touched is not None:
            touched = read_touches(self.touched)
        else:
            print(
                "Touch the centre of each tag with the tip of the tool, and type what the pendant\n"
                "shows in the frame Base: x y z in mm. An empty line leaves a tag out."
            )
            touched = _ask_for_touches(
                [tag.id for tag in tags_of(setup).tags],
                self.setup.with_name(f"{self.setup.stem}-touched.csv"),
            )
        fit = calibrate_table(self.setup, touched, write=self.write)
        for tag_id, residual in sorted(fit.residuals.items()):
            note = "  lies elsewhere, and was left out" if tag_id in fit.outliers else ""
            print(f"tag {tag_id:3d}   {1e3 * residual:6.2f} mm{note}")
        print(f"misfit    {1e3 * fit.rms:.2f} mm (rms of the others)")
        print(f"base      {fit.base_height:.4f} m above the table, yaw {fit.base_yaw_deg:.2f} deg")
        x, y = fit.axis_xy
        print(f"axis      x = {x:.4f} m, y = {y:.4f} m in the frame of the tags, now the origin")
        drop = 1e3 * setup.workspace.r_max * math.radians(fit.tilt_deg)
        print(f"tilt      {fit.tilt_deg:.2f} deg, {drop:.1f} mm at r_max")
        if drop > 3.0:
            print("change: shim the base or the table until the tilt is below 3 mm at r_max")
        if abs(x) > AXIS_OFFSET_MAX:
            print(
                f"change: the tags' middle line lies {1e3 * abs(x):.0f} mm off the robot's "
                "axis; where the table does too, its edges are off by that"
            )

    def _lens(self) -> None:
        from cablecast.cli.progress import console_progress
        from cablecast.pipeline.camera import calibrate_lens_of
        from cablecast.vision.calibration import Board

        across, down = self.squares
        size = picked(self, "square", "tag", "family")
        board = Board(column_count=across, row_count=down, **size)
        with console_progress() as progress:
            options = picked(self, "pictures", "count", "write")
            fit = calibrate_lens_of(self.setup, board=board, progress=progress, **options)
        pattern = "older pattern, of OpenCV before 4.6" if fit.board.legacy else "newer pattern"
        print(f"board     {pattern}, in {fit.picture_count} pictures")
        print(f"misfit    {fit.rms_px:.2f} px")
        focal = fit.lens.focal
        print(f"lens      focal length {focal[0]:.1f} x {focal[1]:.1f} px +- {fit.focal_sd:.1f}")
        u, v = fit.lens.centre
        print(f"centre    {u:.1f}, {v:.1f} px +- {fit.centre_sd:.1f}")
        print(
            f"table     +- {fit.edge_sd:.1f} px at the picture's edge, "
            f"{1e3 * fit.edge_sd / fit.lens.width:.1f} mm for each metre that it shows across"
        )


def _ask_for_touches(tag_ids: list[int], file: pathlib.Path) -> "dict[int, Point]":
    """Ask for the touched points of tags [m], and keep them in a file, under another name so far.

    Those of a run that was stopped are taken with an empty line.
    """
    from cablecast.camera.tags import read_touches
    from cablecast.files import write_csv

    part = file.with_name(f"{file.stem}-part{file.suffix}")
    before = read_touches(part) if part.is_file() else {}
    touched = {tag_id: before[tag_id] for tag_id in tag_ids if tag_id in before}
    if touched:
        print(
            f"{part} keeps what was typed before a stop: an empty line takes the point in brackets"
        )
    try:
        for tag_id in tag_ids:
            point = _ask_for_touch(tag_id, touched.get(tag_id))
            if point is not None:
                touched[tag_id] = point
                rows = [(i, *own) for i, own in touched.items()]
                write_csv(part, ("tag", "x_m", "y_m", "z_m"), rows)
    except BaseException:
        if touched:
            print(
                f"\nThe points so far are kept in {part}: the same command goes on; to begin anew, "
                "delete it"
            )
        raise
    if touched:
        part.replace(file)
        print(f"The points are kept: --touched {shlex.quote(str(file))} gives them again")
    return touched


def _ask_for_touch(tag_id: int, before: "Point | None") -> "Point | None":
    """Ask the person at the terminal for a touched point [m], until it is one, or that before."""
    shown = "" if before is None else f" ({' '.join(f'{1e3 * value:.2f}' for value in before)})"
    while True:
        print(f"tag {tag_id}, x y z [mm]{shown}: ", end="", flush=True)
        line = sys.stdin.readline()
        if not line:
            raise InputError("nobody types touched points: give them as --touched FILE")
        words = line.replace(",", " ").split()
        if not words:
            return before
        with contextlib.suppress(ValueError):
            x, y, z = (float(word) / 1e3 for word in words)
            if all(math.isfinite(value) for value in (x, y, z)):
                return x, y, z
        print("three numbers, please: x y z in mm")
