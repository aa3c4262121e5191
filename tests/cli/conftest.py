import dataclasses
import pathlib
import shutil
import sys
import types

import pytest
from tools.small_results import prepare

from cablecast.cli import main
from cablecast.workspace import load_targets

# A rig that writes down that it was connected, cast with and closed.
RIG_MODULE = """
import pathlib
import time

import numpy as np

from cablecast.rigs.base import RigLifecycle
from cablecast.cast import EndpointTrack, TrialStatus

FOLDER = pathlib.Path(__file__).parent


def note(event):
    with (FOLDER / "events.txt").open("a") as file:
        print(event, file=file)


class NotingRig(RigLifecycle):
    def __init__(self):
        super().__init__()
        note("connected")
        self.description = {"rig": "[/] [bold]weiß"}

    def execute(self, trajectory):
        self._use_reset()
        note("cast")
        if (FOLDER / "slow").exists():
            time.sleep(30.0)
        times = np.array([0.0, trajectory.duration + 1.0])
        endpoint_xy = np.array([[0.0, 1.2], [0.3, 0.9]])
        return EndpointTrack(times=times, endpoint_xy=endpoint_xy, status=TrialStatus.OK)

    def close(self):
        if not self._closed:
            note("closed")
        super().close()


def make(setup, seed):
    return NotingRig()
"""
SMALL_VERBS = ("collect", "repeat", "tune", "select", "simulate", "train", "evaluate")


@dataclasses.dataclass(frozen=True)
class NotedLab:
    """A working folder with a rig that notes what is done with it.

    Attributes:
        path: Folder.
        rig: Options of the command line that choose the rig.
    """

    path: pathlib.Path
    rig: tuple[str, ...] = ("--rig", "noting_rig_of_a_lab:make")

    @property
    def events(self) -> list[str]:
        """What was done with the rig so far, in order."""
        file = self.path / "events.txt"
        return file.read_text().split() if file.exists() else []


@pytest.fixture(scope="session")
def dataset_folder(tmp_path_factory) -> pathlib.Path:
    """Make a small dataset as a user makes it, with a coarse cable to be quick."""
    folder = tmp_path_factory.mktemp("simulated") / "dataset"
    arguments = ["--count", "300", "--segment-count", "10", "--dt", "0.002", "--out", str(folder)]
    assert main(["simulate", *arguments]) == 0
    return folder


@pytest.fixture(scope="session")
def model_folder(dataset_folder) -> pathlib.Path:
    """Train a model on it, enough to plan but not to plan well."""
    folder = dataset_folder.parent / "model"
    arguments = ["--epochs", "5", "--candidate-count", "500", "--out", str(folder)]
    assert main(["train", "--dataset", str(dataset_folder), *arguments]) == 0
    return folder


@pytest.fixture
def in_new_folder(tmp_path, monkeypatch) -> pathlib.Path:
    """Run the test where no results lie."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="session")
def casts_folder(dataset_folder) -> pathlib.Path:
    """Make some casts to tune with in the simulator."""
    folder = dataset_folder.parent / "tune-data"
    assert main(["collect", "--rig", "engine", "--count", "6", "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def lab(in_new_folder):
    """Return a working folder with a noting rig, a file, and a folder of somebody else."""
    (in_new_folder / "noting_rig_of_a_lab.py").write_text(RIG_MODULE)
    (in_new_folder / "file").write_text("precious")
    (in_new_folder / "foreign").mkdir()
    (in_new_folder / "foreign" / "thesis.tex").write_text("years of work")
    yield NotedLab(in_new_folder)
    sys.modules.pop("noting_rig_of_a_lab", None)


def skip_check(patch):
    """Let `collect` not simulate first what casts reach, which has tests of its own."""
    found = types.SimpleNamespace(summary="not looked at", reaches_anything=True)
    patch.setattr("cablecast.pipeline.collect.check", lambda *_, **__: found)


@pytest.fixture(scope="session")
def keep_small(leave_figures_blank):
    """Return a function that cuts targets, checks and drawing while a patch lasts."""
    targets = load_targets()[::4]

    def apply(patch):
        skip_check(patch)
        leave_figures_blank(patch)
        patch.setattr("cablecast.pipeline.evaluate.load_targets", lambda: targets)

    return apply


@pytest.fixture(scope="session")
def results(tmp_path_factory, keep_small) -> pathlib.Path:
    """Make small finished results of most verbs; tests must not change them."""
    pytest.importorskip("shapely")
    folder = tmp_path_factory.mktemp("results")
    with pytest.MonkeyPatch.context() as patch:
        keep_small(patch)
        prepare(folder, SMALL_VERBS)
    return folder


@pytest.fixture
def in_copy(results, tmp_path, monkeypatch, keep_small) -> pathlib.Path:
    """Run the test in a copy of the small results, with the rig that made some of them."""
    keep_small(monkeypatch)
    copy = tmp_path / "copy"
    shutil.copytree(results, copy)
    monkeypatch.chdir(copy)
    return copy
