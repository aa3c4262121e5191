"""Exports: a dataset in the layout of LeRobot, a cable as models of other simulators."""

import dataclasses
import itertools
import math
import os
import pathlib
import shutil
import tempfile
from collections.abc import Iterator

import numpy as np

from cablecast.data.dataset import Dataset
from cablecast.data.lerobot import VIDEO_FILE, Episode, Video, episodes_of, write_tables
from cablecast.errors import DatasetError, InputError, check_count
from cablecast.exports import mujoco_, pybullet_, rods
from cablecast.exports.facts import CableModel
from cablecast.files import remove_leftovers, temporary_prefix, write_text
from cablecast.runs.places import file_name
from cablecast.runs.progress import Progress, ProgressCallback, show
from cablecast.tuning.tuned import Tuned
from cablecast.vision.tags import load_cv2
from cablecast.vision.video import Image, read_video, write_video

FPS_MAX = 1000
FILM_NAME = "{number:06d}.mp4"
"""Name of the film of a cast."""


def export_dataset(
    dataset: Dataset,
    out: str | os.PathLike[str],
    *,
    fps: int = 10,
    films: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = show,
) -> pathlib.Path:
    """Write casts of a rig as a data set of LeRobot.

    The folder must be new or empty, is written whole or not at all, and is returned. Films, a
    folder with 000000.mp4 and so on, start with the motion of their cast.

    Raises:
        InputError: A number out of bounds, a missing film, or a folder that is not empty.
        DatasetError: The casts were simulated, or have no tracks or joints.
        MissingExtraError: There are films, and OpenCV is not installed.
    """
    check_count("fps", fps, high=FPS_MAX)
    if dataset.kind == "sim":
        raise DatasetError("simulated casts have no tracks of joints: export casts of a rig")
    out = pathlib.Path(out)
    if out.is_file() or (out.is_dir() and any(out.iterdir())):
        raise InputError(f"{out} is not empty: --out needs a new folder")
    if films is not None:
        load_cv2()
    episodes = episodes_of(dataset, fps, with_films=films is not None)
    out.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers(out)
    part = pathlib.Path(
        tempfile.mkdtemp(prefix=temporary_prefix(out), suffix=".tmp", dir=out.parent)
    )
    try:
        video = None
        if films is not None:
            video = _join_films(pathlib.Path(films), part / VIDEO_FILE, episodes, fps, progress)
        write_tables(part, dataset, episodes, fps, video)
        # A temporary folder is its owner's alone; results are for sharing.
        umask = os.umask(0)
        os.umask(umask)
        part.chmod(0o777 & ~umask)
        if out.is_dir():
            out.rmdir()
        part.rename(out)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise
    return out


SEGMENT_COUNT = 20
"""Segments of an exported chain: MuJoCo's time grows with the square of their number."""
BULLET_SEGMENT_COUNT = 18
"""Segments for PyBullet, as in the paper: its springs are explicit, and take longer segments."""


def export_cable(
    tuned: Tuned, out: str | os.PathLike[str], *, segment_count: int | None = None
) -> list[pathlib.Path]:
    """Write a cable as models of MuJoCo, PyBullet, Newton and PyElastica, and return the files.

    Args:
        tuned: The fitted cable, with its uncertainty.
        out: Folder of the files, which are replaced where they exist.
        segment_count: Segments of the models; by default 20, for PyBullet 18.

    Raises:
        InputError: The number of segments is out of bounds, or the cable's parameters are given
            per world.
    """
    if segment_count is not None:
        check_count("segment_count", segment_count, 2, 100)
    if tuned.params.world_count is not None:
        raise InputError("a cable to export has one set of parameters, not one per world")
    out, cable = pathlib.Path(out), tuned.setup.cable.with_params(tuned.params)
    # It is the name of the models, too.
    cable = dataclasses.replace(cable, name=file_name(cable.name))
    model, bullet = (
        CableModel(cable=cable, posterior=tuned.posterior, segment_count=segment_count or count)
        for count in (SEGMENT_COUNT, BULLET_SEGMENT_COUNT)
    )
    texts = {
        f"{cable.name}_chain.xml": mujoco_.chain_xml(model),
        f"{cable.name}_flex.xml": mujoco_.flex_xml(model),
        f"{cable.name}.urdf": pybullet_.urdf(bullet),
        f"{cable.name}_pybullet.py": pybullet_.springs(bullet),
        f"{cable.name}_newton.py": rods.newton(model),
        f"{cable.name}_elastica.py": rods.elastica(model),
    }
    for name, text in texts.items():
        write_text(out / name, text)
    return [out / name for name in texts]


def _join_films(
    films: pathlib.Path,
    file: pathlib.Path,
    episodes: list[Episode],
    fps: int,
    progress: ProgressCallback,
) -> Video:
    """Write one film of all episodes, with one frame per frame of the data."""
    total = len(episodes)
    sizes: list[tuple[int, int]] = []
    colors = np.zeros((total, 3, 256), dtype=np.int64)

    def frames() -> Iterator[Image]:
        for done, episode in enumerate(episodes):
            progress(Progress(task="Joining films", done=done, total=total, unit="casts"))
            path = films / FILM_NAME.format(number=done)
            for frame in _film_frames(path, len(episode["index"]), fps):
                sizes[:] = sizes or [frame.shape[:2]]
                (height, width), here = sizes[0], frame.shape[:2]
                if here != (height, width):
                    raise InputError(
                        f"{path} has {here[1]} x {here[0]} px, others {width} x {height}: films of "
                        "one camera have one size"
                    )
                # OpenCV's order is blue, green, red.
                for channel in range(3):
                    values = frame[..., 2 - channel].ravel()
                    colors[done, channel] += np.bincount(values, minlength=256)
                yield frame

    write_video(file, frames(), fps)
    progress(Progress(task="Joining films", done=total, total=total, unit="casts"))
    return Video(size=sizes[0], colors=colors)


def _film_frames(path: pathlib.Path, count: int, fps: int) -> Iterator[Image]:
    """Yield the frames of a film nearest to times 1/fps apart; the last one goes on to the end."""
    _, source = read_video(path)
    done, end = 0, (math.inf, np.empty(0, dtype=np.uint8))
    for (time, frame), (after, _) in itertools.pairwise(itertools.chain(source, [end])):
        while done < count and done / fps < (time + after) / 2:
            yield frame
            done += 1
        if done == count:
            return
