import pathlib

import pytest

from cablecast.cli import main


@pytest.fixture(scope="session")
def dataset_folder(tmp_path_factory) -> pathlib.Path:
    """A small dataset, made as a user makes it, with a coarse cable to be quick."""
    folder = tmp_path_factory.mktemp("simulated") / "dataset"
    arguments = ["--count", "300", "--segment-count", "10", "--dt", "0.002", "--out", str(folder)]
    assert main(["simulate", *arguments]) == 0
    return folder


@pytest.fixture(scope="session")
def model_folder(dataset_folder) -> pathlib.Path:
    """A model trained on it, enough to plan but not to plan well."""
    folder = dataset_folder.parent / "model"
    arguments = ["--epochs", "5", "--candidate-count", "500", "--out", str(folder)]
    assert main(["train", "--dataset", str(dataset_folder), *arguments]) == 0
    return folder


@pytest.fixture
def in_new_folder(tmp_path, monkeypatch) -> pathlib.Path:
    """Runs the test where no results lie."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
