import subprocess

import pytest

import cablecast
from cablecast.cli.options import cable_folder, evaluation_folder
from cablecast.cli.run_folder import RunFolder, library_versions, source_commit
from cablecast.errors import InputError

SETTINGS = {"seed": 0, "training": {"epochs": 5}, "grid": (1, 2)}


def begun(path, settings=SETTINGS):
    run = RunFolder.open(path, "train", settings)
    run.begin()
    return run


def test_a_run_is_taken_up_with_the_same_settings_and_the_facts_of_its_start(tmp_path):
    first = begun(tmp_path / "run")
    (tmp_path / "run" / "part.bin").write_bytes(b"half done")
    again = RunFolder.open(tmp_path / "run", "train", SETTINGS)
    assert again.metrics is None
    assert again.config["started"] == first.config["started"]


def test_looking_at_a_folder_writes_nothing(tmp_path):
    RunFolder.open(tmp_path / "run", "train", SETTINGS)
    assert list(tmp_path.iterdir()) == []


def test_other_settings_are_refused_by_name(tmp_path):
    begun(tmp_path).finish({"error": 1.0})
    with pytest.raises(InputError, match=r"training\.epochs is 5 there and 6 here"):
        RunFolder.open(tmp_path, "train", SETTINGS | {"training": {"epochs": 6}})
    with pytest.raises(InputError, match="command is 'train' there and 'evaluate' here"):
        RunFolder.open(tmp_path, "evaluate", SETTINGS)


def test_a_run_stopped_before_its_first_result_does_not_bind_the_next(tmp_path):
    begun(tmp_path)
    changed = begun(tmp_path, SETTINGS | {"seed": 1})
    assert RunFolder.read_config(tmp_path) == changed.config
    assert changed.config["settings"]["seed"] == 1


def test_a_done_run_gives_its_metrics_back(tmp_path):
    begun(tmp_path).finish({"error": 1.5})
    assert RunFolder.open(tmp_path, "train", SETTINGS).metrics == {"error": 1.5}


@pytest.mark.parametrize("content", ["", "{", "[]", '{"command": "train"}', "\xff"])
def test_a_damaged_config_is_refused(tmp_path, content):
    (tmp_path / "config.json").write_text(content, encoding="latin-1")
    with pytest.raises(InputError, match=r"config\.json is damaged"):
        RunFolder.open(tmp_path, "train", SETTINGS)


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file"):
        RunFolder.open(tmp_path / "file", "train", SETTINGS)


def test_versions_name_every_library_without_importing_it():
    versions = library_versions()
    assert versions["cablecast"] == cablecast.__version__
    assert all(versions.values())


def test_the_commit_is_that_of_the_source_tree_or_none():
    commit = source_commit()
    head = subprocess.run(["git", "rev-parse", "HEAD"], capture_output=True, text=True)
    if head.returncode == 0:
        assert commit is not None
        assert commit.startswith(head.stdout.strip()[:40])


def test_names_of_cables_and_rigs_make_harmless_folder_names():
    assert cable_folder("../../etc").parts == ("runs", "_.._etc")
    assert cable_folder("..").parts == ("runs", "cable")
    assert cable_folder("cable_1").parts == ("runs", "cable_1")
    assert evaluation_folder("my.lab:make") == "evaluate-my.lab-make"
