import dataclasses
import json

import pytest

from cablecast.errors import InputError
from cablecast.files import seal
from cablecast.runs.progress import FolderStage, StageLog, remaining_time, run_stages


@pytest.fixture
def make_stages(tmp_path):
    """Stages that note that they ran; one of them may fail."""
    ran = []

    def make(names, failing=()):
        def work(name):
            ran.append(name)
            if name in failing:
                raise RuntimeError(name)
            (tmp_path / name).mkdir()
            (tmp_path / name / "metrics.json").write_text("{}")

        return [
            FolderStage(
                name=name,
                title=f"stage {name}",
                folder=tmp_path / name,
                expected=60.0,
                work=lambda name=name: work(name),
            )
            for name in names
        ]

    return make, ran


def test_stages_run_in_order_and_each_only_once(make_stages, tmp_path):
    make, ran = make_stages
    reports = []
    run_stages(make("abc"), tmp_path, reports.append)
    assert ran == ["a", "b", "c"]
    log = run_stages(make("abc"), tmp_path, reports.append)
    assert ran == ["a", "b", "c"]
    assert set(log.seconds) == {"a", "b", "c"}
    assert reports[0].task == reports[3].task == "[1/3] stage a"
    assert reports[0].note.startswith("the whole: about")
    assert reports[3].note.startswith("done in")


def test_a_stage_is_run_again_after_one_that_was_made_again(make_stages, tmp_path):
    make, ran = make_stages
    run_stages(make("a"), tmp_path)
    stages = make("abc")
    run_stages(stages, tmp_path)
    (stages[1].folder / "metrics.json").unlink()
    stages[1].folder.rmdir()
    checked = [
        dataclasses.replace(stage, work=lambda name=stage.name: ran.append(f"check {name}"))
        for stage in (stages[0], stages[2])
    ]
    run_stages([checked[0], stages[1], checked[1]], tmp_path)
    # What "c" read may have changed, what "a" read has not.
    assert ran == ["a", "b", "c", "b", "check c"]


def test_a_stage_that_failed_is_taken_up_and_keeps_the_time_that_was_spent(make_stages, tmp_path):
    make, ran = make_stages
    with pytest.raises(RuntimeError):
        run_stages(make("abc", failing="b"), tmp_path)
    stored = json.loads((tmp_path / "stages.json").read_text())
    assert set(stored) == {"a", "b", "sha256"}
    stored = seal({"a": stored["a"], "b": 100.0})
    (tmp_path / "stages.json").write_text(json.dumps(stored))
    log = run_stages(make("abc"), tmp_path)
    assert ran == ["a", "b", "b", "c"]
    assert log.seconds["b"] >= 100.0


def test_the_expected_end_follows_the_pace_of_the_machine(make_stages, tmp_path):
    make, _ = make_stages
    stages, log = make("abcd"), StageLog(tmp_path)
    assert remaining_time(stages, log) == pytest.approx(4 * 60.0)
    for name in "ab":
        stages["ab".index(name)].work()
        log.seconds[name] = 300.0
    # Two stages of an expected minute took ten: with one minute of doubt the pace is 11 to 3.
    assert remaining_time(stages, log) == pytest.approx(2 * 60.0 * 11 / 3)


@pytest.mark.parametrize("content", ["{", "[]", "7", '{"a": 10.0}', '{"a": "x"}', "[" * 10**5])
def test_a_damaged_file_of_times_is_named(tmp_path, content):
    (tmp_path / "stages.json").write_text(content)
    with pytest.raises(
        InputError, match=r"stages\.json is damaged.*Delete it; only times are lost"
    ):
        StageLog(tmp_path)
