"""`cablecast export`: a dataset in the layout of LeRobot, a cable for other simulators."""

import dataclasses
import pathlib
from typing import Annotated

import tyro

from cablecast.cli.options import CableName, LabFile, argument, casts_text, load_lab
from cablecast.errors import DatasetError
from cablecast.runs.places import CALIBRATION_FOLDER, TUNE_FOLDER, cable_folder, check_not_aim


@dataclasses.dataclass(frozen=True, kw_only=True)
class Export:
    """Write casts as a LeRobot data set (version 3), or a cable for other simulators.

    Of casts, each is an episode. A frame holds the joints, the commanded joints of the next frame,
    and the cable's end. The folder is written whole or not at all. Takes seconds, longer with
    films. `cablecast export cable` writes a fitted cable, with its uncertainty, as models of
    MuJoCo (a chain of capsules, and a 1-D flex), PyBullet (URDF and a script), Newton and
    PyElastica (scripts). Units, laws, and what a model leaves out stand in the files.
    """

    dataset: Annotated[tyro.conf.Positional[str], argument("DATASET|cable")]
    """Folder of casts that `cablecast collect` or `cablecast import` made; or the word cable (a
    folder of that name is ./cable)."""
    setup: LabFile = None
    cable: CableName = None
    params: Annotated[pathlib.Path | None, argument("FILE", "runs/CABLE/tune")] = None
    """Parameters that `cablecast tune` found (params.json, or its folder), for cable."""
    segment_count: Annotated[int | None, argument("INT", "20, for PyBullet 18")] = None
    """Segments of the models, for cable."""
    fps: int = 10
    """Frames per second; tracks have 10 samples a second."""
    films: Annotated[pathlib.Path | None, argument("DIR", "none")] = None
    """Folder with a film of each cast, 000000.mp4 and so on, which starts with the motion."""
    out: Annotated[
        pathlib.Path | None, argument("DIR", "DATASET-lerobot, or runs/CABLE/models")
    ] = None
    """New folder of the data set, or folder of the models."""

    def run(self) -> None:
        """Export, and print where it lies."""
        # A path would drop the ./ of a folder that has the name of the word.
        if self.dataset == "cable":
            self._export_cable()
        else:
            self._export_casts(pathlib.Path(self.dataset))

    def _export_cable(self) -> None:
        from cablecast.pipeline.export import export_cable
        from cablecast.tuning.tuned import load_tuned

        setup = load_lab(self.setup, self.cable)
        folder = cable_folder(setup.cable.name)
        tuned = load_tuned(self.params or folder / TUNE_FOLDER, setup)
        out = self.out or folder / "models"
        for path in export_cable(tuned, out, segment_count=self.segment_count):
            print(path)

    def _export_casts(self, dataset: pathlib.Path) -> None:
        from cablecast.cli.progress import console_progress
        from cablecast.data.dataset import read_dataset
        from cablecast.pipeline.export import export_dataset

        check_not_aim(dataset, CALIBRATION_FOLDER, "its data set", DatasetError)
        casts = read_dataset(dataset)
        # `.` and `..` name a folder without saying its name.
        named = dataset if dataset.name not in ("", "..") else dataset.resolve()
        out = self.out or named.with_name(f"{named.name}-lerobot")
        with console_progress() as progress:
            export_dataset(casts, out, fps=self.fps, films=self.films, progress=progress)
        print(f"{casts_text(len(casts), casts.cable.name)} in {out}")
