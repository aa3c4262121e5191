"""Takes of motion-capture systems, as they export them, become casts in our frame."""

import numpy as np
import pytest

from cablecast.cast import TrialStatus
from cablecast.cli import main
from cablecast.data.dataset import read_dataset
from cablecast.data.mocap import MocapFrame, MocapNames, Take
from cablecast.data.store import CastStore
from cablecast.errors import DatasetError, InputError
from cablecast.motion.casting import Action
from cablecast.motion.trajectory import plan_trajectory
from cablecast.pipeline.import_casts import import_casts
from cablecast.setup import Setup
from cablecast.tuning.tracks import MeasuredTracks

SETUP = Setup()
# Exports have a micrometre, and a path fitted to 120 Hz follows it to a fraction of a millimetre.
PLACE, FIT = 1e-5, 5e-4
# The system's frame: y up, its origin on the floor beside the table.
TURN = np.array([[0.8, 0.0, 0.6], [-0.6, 0.0, 0.8], [0.0, -1.0, 0.0]])
ORIGIN = np.array([0.4, -0.9, -0.7])
WAIT = 1.0


def theirs(points):
    """Points of our frame as the system measures them [m]."""
    return (np.asarray(points) - ORIGIN) @ TURN


def cast():
    """Return times, and the places of end, grip and a point ahead of it, at 120 Hz after a wait."""
    path = plan_trajectory(Action(-0.4, 0.4, 0.6, 0.8), SETUP).grip_path
    times = np.arange(0.0, 4.5, 1 / 120)
    x, y, z, yaw, _ = path.evaluate(np.clip(times - WAIT, 0.0, None))[0].T
    ahead = np.stack([np.sin(yaw), np.cos(yaw), 0 * yaw], axis=-1)
    grip = np.stack([x, y, z + 0.06], axis=-1)
    end = np.stack([x, y, 0 * z], axis=-1) + 0.5 * ahead
    return times, {"end": end, "grip": grip, "ahead": grip + 0.05 * ahead}


def write_points(path, scale=1.0):
    ours = np.array([[-1.0, 0.2, 0.0], [1.1, 0.3, 0.0], [0.9, 1.3, 0.0], [-0.8, 1.2, 0.1]])
    rows = np.hstack([ours, scale * theirs(ours)])
    lines = [",".join(f"{value:.6f}" for value in row) for row in rows]
    path.write_text("x_m,y_m,z_m,mocap_x_m,mocap_y_m,mocap_z_m\n" + "\n".join(lines) + "\n")
    return path


def cells(point, scale):
    return ["" if np.isnan(value) else f"{scale * value:.6f}" for value in point]


def write_motive(path, times, points, version="1.23"):
    """Write a take as Motive does: rigid bodies with rotation and error, markers, gaps empty."""
    place = [("Position", axis) for axis in "XYZ"]
    body = [*(("Rotation", axis) for axis in "XYZW"), *place, ("Mean Marker Error", "")]
    columns = []
    for name in points:
        if name == "grip":
            columns += [("Rigid Body", name, "A1", *cell) for cell in body]
            cells_of_marker = [*place, ("Marker Quality", "")]
            columns += [("Rigid Body Marker", f"{name}:Marker1", "A1", *c) for c in cells_of_marker]
        else:
            columns += [("Marker", f"Cable:{name}", "A1", *cell) for cell in place]
    kinds, names, ids, parts, axes = zip(*columns, strict=True)
    heads = [["Type", *kinds], ["Name", *names], ["ID", *ids], ["", *parts]]
    if version == "1.25":
        heads.insert(3, ["Parent", *[""] * len(kinds)])
    lines = [
        f"Format Version,{version},Take Name,one,Capture Frame Rate,120.000000,Rotation Type,"
        "Quaternion,Length Units,Millimeters,Coordinate Space,Global",
        "",
        *("," + ",".join(head) for head in heads),
        ",".join(["Frame", "Time (Seconds)", *axes]),
    ]
    for i, time in enumerate(times):
        row = [str(i), f"{time:.6f}"]
        for name, places in points.items():
            xyz = cells(theirs(places[i]), 1e3)
            row += ["0", "0", "0", "1", *xyz, "0.1", *xyz, "1"] if name == "grip" else xyz
        lines.append(",".join(row))
    path.write_text("\ufeff" + "\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_vicon(path, times, points, separator=","):
    """Write a take as Nexus does: a section of devices before that of the trajectories."""
    lines = ["Devices", "1000", separator.join(["", "", "Force"]), "Frame,Sub Frame,Fx"]
    lines += [",,N", "1,0,0.5", ""]
    lines = [line.replace(",", separator) for line in lines]
    # A section of bodies may be exported without any.
    empty = ["Segments", "120", ",,body,,", "Frame,Sub Frame,TX,TY,TZ", ",,mm,mm,mm", ""]
    lines += [line.replace(",", separator) for line in empty]
    lines += ["Trajectories", "120"]
    lines.append(separator.join(["", "", *(f"Cable:{n}{2 * separator}" for n in points)]))
    lines.append(separator.join(["Frame", "Sub Frame", *["X", "Y", "Z"] * len(points)]))
    lines.append(separator.join(["", "", *["mm"] * (3 * len(points))]))
    for i in range(len(times)):
        row = [str(i + 101), "0"]
        for places in points.values():
            row += cells(theirs(places[i]), 1e3)
        lines.append(separator.join(row))
    path.write_text("\n".join([*lines, "", ""]))
    return path


WRITERS = {
    "Motive 1.23": write_motive,
    "Motive 1.25": lambda *args: write_motive(*args, version="1.25"),
    "Vicon CSV": write_vicon,
    "Vicon ASCII": lambda *args: write_vicon(*args, separator="\t"),
}


@pytest.mark.parametrize("system", WRITERS)
def test_a_take_is_read_in_our_frame_with_its_gaps(system, tmp_path):
    times, points = cast()
    points["end"][200:230] = np.nan
    file = WRITERS[system](tmp_path / "take.csv", times, points)
    take = Take.load(file, MocapFrame.load(write_points(tmp_path / "points.csv")))
    assert take.times == pytest.approx(times, abs=1e-6)
    for name, places in points.items():
        assert take.point(name) == pytest.approx(places, abs=PLACE, nan_ok=True)


def test_takes_become_casts_that_tuning_reads(tmp_path):
    times, points = cast()
    takes = tmp_path / "takes"
    takes.mkdir()
    write_motive(takes / "take 1.csv", times, points)
    write_vicon(takes / "take 2.TXT", times, points, separator="\t")
    names = MocapNames(
        frame=write_points(tmp_path / "points.csv"), end="end", grip=("grip", "ahead")
    )
    casts = import_casts(takes, SETUP, mocap=names)
    assert len(casts) == 2
    assert casts.track(1).status is TrialStatus.OK
    # The motion starts a moment after the first sample; the wait before it is left out.
    tracks, path = (
        MeasuredTracks.from_dataset(casts),
        plan_trajectory(Action(-0.4, 0.4, 0.6, 0.8), SETUP).grip_path,
    )
    ticks = np.arange(0.2, 2.0, 0.02)
    found = tracks.grip_path.evaluate(ticks)[0]
    shifts = np.arange(-0.2, 0.2, 1e-3)
    misses = [np.abs(found[:, :4] - path.evaluate(ticks + s)[0][:, :4]).max() for s in shifts]
    assert min(misses) < 5 * FIT
    # A session keeps the tracked grip: no action says how these casts moved.
    CastStore(SETUP, tmp_path / "session").add_dataset(casts)
    stored = MeasuredTracks.from_dataset(CastStore(SETUP, tmp_path / "session").dataset())
    np.testing.assert_array_equal(
        stored.grip_path.evaluate(ticks), tracks.grip_path.evaluate(ticks)
    )


def test_takes_that_have_changed_are_not_taken_for_those_that_were_imported(tmp_path):
    times, points = cast()
    takes = tmp_path / "takes"
    takes.mkdir()
    write_vicon(takes / "take.TXT", times, points)
    names = MocapNames(frame=write_points(tmp_path / "points.csv"), end="end", grip=("grip",))
    import_casts(takes, SETUP, mocap=names, out=tmp_path / "out")
    write_vicon(takes / "take.TXT", times, {**points, "end": points["end"] + [0.01, 0.0, 0.0]})
    with pytest.raises(DatasetError, match=r"rig\.sha256 is"):
        import_casts(takes, SETUP, mocap=names, out=tmp_path / "out")


def test_the_command_imports_a_take(tmp_path, capsys):
    times, points = cast()
    take = write_motive(tmp_path / "take.csv", times, points)
    frame = write_points(tmp_path / "points.csv")
    out = ["--out", str(tmp_path / "out")]
    words = ["import", str(take), "--points", str(frame), "--grip", "grip", "ahead", *out]
    assert main(words) == 0
    assert "1 cast of cable_1 is in" in capsys.readouterr().out
    assert len(read_dataset(tmp_path / "out")) == 1


def test_sections_without_rows_are_passed_over_and_hold_no_positions(tmp_path):
    take = write_vicon(tmp_path / "take.csv", *cast())
    frame = MocapFrame.load(write_points(tmp_path / "points.csv"))
    whole = take.read_text()
    section = "Segments\n120\n,,body,,\nFrame,Sub Frame,TX,TY,TZ\n,,mm,mm,mm"
    for ending in ("", "\n\n"):
        take.write_text(whole + section + ending)
        assert list(Take.load(take, frame).points) == ["Cable:end", "Cable:grip", "Cable:ahead"]
        take.write_text(section + ending)
        with pytest.raises(InputError, match="holds no positions"):
            Take.load(take, frame)
    take.write_text("x" * 200_000)
    with pytest.raises(InputError, match="is no CSV file"):
        Take.load(take, frame)


def test_what_is_no_take_or_no_frame_is_refused_with_what_is_wrong(tmp_path):
    times, points = cast()
    frame = MocapFrame.load(write_points(tmp_path / "points.csv"))
    take = write_vicon(tmp_path / "take.csv", times, points)
    with pytest.raises(InputError, match="no point 'tip', of Cable:end, Cable:grip, Cable:ahead"):
        Take.load(take, frame).point("tip")
    with pytest.raises(InputError, match="no take of Motive"):
        Take.load(tmp_path / "points.csv", frame)
    with pytest.raises(InputError, match=r"no file .*none\.csv"):
        Take.load(tmp_path / "none.csv", frame)
    text = take.read_text()
    take.write_text(text.replace("mm", "inch"))
    with pytest.raises(InputError, match="length unit 'inch'"):
        Take.load(take, frame)
    take.write_text(text.replace("\n150,0,", "\n150,0,far"))
    with pytest.raises(InputError, match=r"line \d+ of .* is not a number"):
        Take.load(take, frame)
    with pytest.raises(InputError, match=r"point \d of .* misses the rigid fit by .* mm"):
        MocapFrame.load(write_points(tmp_path / "points.csv", scale=1e3))
    rows = (tmp_path / "points.csv").read_text().splitlines()
    (tmp_path / "points.csv").write_text("\n".join(rows[:3]) + "\n")
    with pytest.raises(InputError, match="at least 3 rows of finite"):
        MocapFrame.load(tmp_path / "points.csv")
    line = "\n".join(f"{x},0,0,{x},0,0" for x in range(4))
    (tmp_path / "points.csv").write_text(f"{rows[0]}\n{line}\n")
    with pytest.raises(InputError, match="lie in a line"):
        MocapFrame.load(tmp_path / "points.csv")
    still = {name: np.repeat(places[:1], len(times), axis=0) for name, places in points.items()}
    names = MocapNames(frame=write_points(tmp_path / "points.csv"), end="end", grip=("grip",))
    with pytest.raises(InputError, match="'grip' does not move"):
        import_casts(write_vicon(tmp_path / "take.csv", times, still), SETUP, mocap=names)


def test_a_motive_export_says_its_unit_wherever_it_stands_and_each_name_once(tmp_path):
    times, points = cast()
    frame = MocapFrame.load(write_points(tmp_path / "points.csv"))
    take = write_motive(tmp_path / "take.csv", times, points)
    text = take.read_text(encoding="utf-8-sig")
    expected = Take.load(take, frame).point("end")
    others = {
        "notes with a comma": text.replace("Take Name,one", "Take Notes,slow, then fast").encode(),
        "UTF-16": text.encode("utf-16"),
        "semicolons": text.replace(",", ";").replace(".", ",").encode(),
        "tabs": text.replace(",", "\t").encode(),
    }
    for name, content in others.items():
        take.write_bytes(content)
        found = Take.load(take, frame).point("end")
        np.testing.assert_array_equal(found, expected, err_msg=name)
    take.write_text(text.replace("Length Units,Millimeters,", ""))
    with pytest.raises(InputError, match="does not say its Length Units"):
        Take.load(take, frame)
    take.write_text(text.replace("Cable:ahead", "Cable:end"))
    with pytest.raises(InputError, match="has two points 'Cable:end'"):
        Take.load(take, frame)
    write_vicon(take, times, points)
    take.write_text(take.read_text().replace("Cable:ahead", "Cable:end"))
    with pytest.raises(InputError, match="has two points 'Cable:end'"):
        Take.load(take, frame)
