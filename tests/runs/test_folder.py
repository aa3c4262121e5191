import os
import subprocess
import sys

import pytest

import cablecast
from cablecast.errors import InputError, UnreadableFileError
from cablecast.files import library_versions
from cablecast.runs.folder import (
    RunFolder,
    fingerprint,
    hold_folder,
    plain_settings,
    settings_differences,
    source_commit,
)
from cablecast.runs.places import cable_folder, rig_folder

SETTINGS = {"seed": 0, "training": {"epochs": 5}, "grid": (1, 2)}


def begun(path, settings=SETTINGS, metrics=None):
    run = RunFolder.open(path, "train", settings)
    with run.locked():
        if metrics is not None:
            run.finish(metrics)
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


def test_a_done_run_gives_its_metrics_back_and_refuses_other_settings_by_name(tmp_path):
    begun(tmp_path, metrics={"error": 1.5})
    assert RunFolder.open(tmp_path, "train", SETTINGS).metrics == {"error": 1.5}
    with pytest.raises(InputError, match=r"training\.epochs is 5 there and 6 here"):
        RunFolder.open(tmp_path, "train", SETTINGS | {"training": {"epochs": 6}})
    with pytest.raises(InputError, match="command is 'train' there and 'evaluate' here"):
        RunFolder.open(tmp_path, "evaluate", SETTINGS)


def test_a_run_stopped_before_its_first_result_does_not_bind_the_next(tmp_path):
    begun(tmp_path)
    changed = begun(tmp_path, SETTINGS | {"seed": 1})
    assert RunFolder.read(tmp_path) == changed
    assert changed.config["settings"]["seed"] == 1


@pytest.mark.parametrize(
    "content", ["", "{", "[]", "7", "[" * 10**5, '{"command": "train"}', "\xff"]
)
def test_a_damaged_config_is_refused(tmp_path, content):
    (tmp_path / "config.json").write_text(content, encoding="latin-1")
    with pytest.raises(InputError, match=r"config\.json is") as caught:
        RunFolder.open(tmp_path, "train", SETTINGS)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", ["[1]", "7", "{}", '{"error": 1.0}', "{" * 10**5, "\xff"])
def test_damaged_metrics_are_refused_and_say_how_to_go_on(tmp_path, content):
    begun(tmp_path, metrics={"error": 1.5})
    (tmp_path / "metrics.json").write_text(content, encoding="latin-1")
    with pytest.raises(InputError, match=r"metrics\.json is"):
        _ = RunFolder.open(tmp_path, "train", SETTINGS).metrics


def test_metrics_that_cannot_be_read_are_not_called_damaged(tmp_path):
    begun(tmp_path)
    (tmp_path / "metrics.json").mkdir()
    with pytest.raises(UnreadableFileError, match="cannot be read"):
        _ = RunFolder.open(tmp_path, "train", SETTINGS).metrics


def test_another_process_is_kept_out_of_a_folder_while_a_run_is_in_it(tmp_path):
    script = (
        "import sys, pathlib; from cablecast.runs.folder import hold_folder\n"
        "from cablecast.errors import InputError\n"
        "try:\n"
        "    with hold_folder(pathlib.Path(sys.argv[1]), InputError): print('held')\n"
        "except InputError as error: print(error)\n"
    )

    def other_process():
        command = [sys.executable, "-c", script, str(tmp_path)]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    with RunFolder.open(tmp_path, "train", SETTINGS).locked():
        assert other_process() == f"another process is writing to {tmp_path}"
    assert other_process() == "held"


def test_an_export_that_was_killed_does_not_stop_runs_around_it(tmp_path, dead_process):
    left = tmp_path / "run" / ".casts-lerobot.12-x.tmp"
    left.mkdir(parents=True)
    (tmp_path / "run" / f".metrics.json.{dead_process}-x.tmp").write_text("{")
    with hold_folder(tmp_path / "run", InputError):
        assert [file.name for file in (tmp_path / "run").iterdir()] == [left.name]


def test_what_another_process_writes_and_hidden_files_of_a_person_stay(tmp_path):
    alive = tmp_path / f".metrics.json.{os.getppid()}-x.tmp"
    for file in (alive, tmp_path / ".mine.tmp"):
        file.write_text("{")
    with hold_folder(tmp_path, InputError):
        assert {file.name for file in tmp_path.iterdir()} == {alive.name, ".mine.tmp"}


def test_a_run_of_other_settings_that_began_meanwhile_is_not_overwritten(tmp_path):
    late = RunFolder.open(tmp_path, "train", SETTINGS | {"seed": 1})
    first = begun(tmp_path, metrics={"error": 1.0})
    with pytest.raises(InputError, match="seed is"), late.locked():
        pass
    assert RunFolder.read(tmp_path) == first
    # Unless a run is told to replace it, however damaged it is.
    (tmp_path / "config.json").write_text("{")
    with late.locked(replaces=True):
        assert RunFolder.read(tmp_path) == late


def test_a_folder_of_someone_else_is_left_alone(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a/thesis.tex").write_text("dear")
    with pytest.raises(InputError, match=r"holds a/thesis.tex but no run"):
        RunFolder.open(tmp_path, "train", SETTINGS)


def test_a_part_is_made_once_and_checked_when_it_is_read(tmp_path):
    parts = RunFolder.open(tmp_path, "select", SETTINGS).parts("coverage")
    made = []

    def make():
        made.append(1)
        return {"share": 0.5}

    assert parts.get_or_make("a", make) == parts.get_or_make("a", make) == {"share": 0.5}
    assert len(made) == 1
    text = parts.file("a").read_text()
    parts.file("a").write_text(text.replace("0.5", "0.9"))
    with pytest.raises(InputError, match=r"a\.json is damaged.*Delete it"):
        parts.get("a")


def test_a_part_of_another_run_is_not_taken_for_one_of_this(tmp_path):
    ours, theirs = (
        RunFolder.open(tmp_path / str(seed), "select", SETTINGS | {"seed": seed}).parts("coverage")
        for seed in (1, 2)
    )
    theirs.put("a", {"share": 0.9})
    ours.folder.mkdir(parents=True)
    theirs.file("a").rename(ours.file("a"))
    with pytest.raises(InputError, match=r"a\.json belongs to a run of other settings.*Delete it"):
        ours.get("a")


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
    assert rig_folder("evaluate", "my.lab:make") == "evaluate-my.lab-make"


def test_differences_name_nested_settings_and_absent_ones_and_many_are_counted():
    phrases = settings_differences({"a": {"b": 1}, "old": 2}, {"a": {"b": 3}, "new": 4})
    assert phrases == [
        "a.b is 1 there and 3 here",
        "old is 2 there and '(absent)' here",
        "new is '(absent)' there and 4 here",
    ]
    there, here = ({str(key): {"x": value} for key in range(9)} for value in (1, 2))
    phrases = settings_differences(there, here)
    assert phrases[5:] == ["5.x is 1 there and 2 here", "and 3 others"]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), object(), {1, 2}])
def test_settings_are_as_json_stores_them_and_what_it_cannot_hold_is_refused(value):
    assert plain_settings({"grid": (1, 2), "a": {"b": None}}) == {"grid": [1, 2], "a": {"b": None}}
    with pytest.raises(InputError, match="plain, finite values"):
        plain_settings({"value": value})


def test_a_fingerprint_changes_with_the_values_and_with_the_bytes():
    names = {fingerprint({"a": 1}), fingerprint({"a": 2}), fingerprint({"a": 1}, b"x")}
    assert len(names) == 3
    assert fingerprint({"a": 1, "b": 2}) == fingerprint({"b": 2, "a": 1})
