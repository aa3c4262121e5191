"""`cablecast export`: write a dataset in the layout of LeRobot."""

import dataclasses
import pathlib
from typing import Annotated

import tyro

from cablecast.cli.options import argument


@dataclasses.dataclass(frozen=True, kw_only=True)
class Export:
    """Write casts of a rig as a LeRobot data set (version 3), one episode per cast.

    A frame holds the joints, the commanded joints of the next frame, and the cable's end. The
    folder is written whole or not at all. Takes seconds, longer with films.
    """

    dataset: Annotated[tyro.conf.Positional[pathlib.Path], argument("DATASET")]
    """Folder of casts that `cablecast collect` or `cablecast import` made."""
    fps: int = 10
    """Frames per second; tracks have 10 samples a second."""
    films: Annotated[pathlib.Path | None, argument("DIR", "none")] = None
    """Folder with a film of each cast, 000000.mp4 and so on, which starts with the motion."""
    out: Annotated[pathlib.Path | None, argument("DIR", "DATASET-lerobot")] = None
    """New folder of the data set."""

    def run(self) -> None:
        """Export, and print where it lies."""
        from cablecast.cli.progress import console_progress
        from cablecast.data.dataset import read_dataset
        from cablecast.pipeline.export import export_dataset

        casts = read_dataset(self.dataset)
        # `.` and `..` name a folder without saying its name.
        named = self.dataset if self.dataset.name not in ("", "..") else self.dataset.resolve()
        out = self.out or named.with_name(f"{named.name}-lerobot")
        with console_progress() as progress:
            export_dataset(casts, out, fps=self.fps, films=self.films, progress=progress)
        print(f"{len(casts)} casts of {casts.cable.name} are in {out}")
