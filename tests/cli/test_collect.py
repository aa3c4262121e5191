import json
import shutil
import signal
import subprocess
import sys
import time

import pytest
from tests.cli.conftest import skip_check

from cablecast.cli import main
from cablecast.data.dataset import read_dataset
from cablecast.pipeline.repeat import read_actions
from cablecast.report.maps import repeatability_map

# A rig whose trials take a while and which writes down each that it makes.
SLOW_RIG = """
import pathlib
import time

import numpy as np

from cablecast.errors import RigError
from cablecast.rigs.base import RigLifecycle
from cablecast.cast import EndpointTrack, TrialStatus

FOLDER = pathlib.Path(__file__).parent


class SlowRig(RigLifecycle):
    def __init__(self, seed):
        super().__init__()
        self.description = {"rig": "slow", "seed": seed}
        self.seed = seed
        self.index = 0

    def seek(self, index, purpose=""):
        self.index = index

    def execute(self, trajectory):
        self._use_reset()
        time.sleep(0.03)
        if (FOLDER / "broken").exists():
            raise RigError("the cable fell out of the gripper")
        random = np.random.default_rng([self.seed, self.index])
        landed = [0.3, 0.9] + random.normal(scale=0.01, size=2)
        with (FOLDER / "made.txt").open("a") as file:
            print(self.index, file=file)
        self.index += 1
        return EndpointTrack(
            times=np.array([0.0, trajectory.duration + 1.0]),
            endpoint_xy=np.stack([[0.0, 1.2], landed]),
            status=TrialStatus.OK,
        )


def make(setup, seed):
    return SlowRig(seed)
"""
RIG = ["--rig", "slow_rig_of_a_lab:make"]


# `collect`, without simulating first what casts reach: an interpreter would take seconds for it.
COLLECT = """
import pytest, sys
from tests.cli.conftest import skip_check
from cablecast.cli import main

skip_check(pytest.MonkeyPatch())
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture
def lab(in_new_folder, monkeypatch):
    skip_check(monkeypatch)
    (in_new_folder / "slow_rig_of_a_lab.py").write_text(SLOW_RIG)
    yield in_new_folder
    sys.modules.pop("slow_rig_of_a_lab", None)


def made(lab):
    """Return the indices of the trials that were carried out to their end."""
    return [int(line) for line in (lab / "made.txt").read_text().split()]


@pytest.mark.parametrize(
    ("purpose", "folder", "sampling"),
    [("tune", "tune-data", "uniform"), ("real", "real-data", "grid")],
)
def test_casts_for_each_purpose_lie_in_a_folder_of_their_own(
    purpose, folder, sampling, lab, capsys
):
    assert main(["collect", *RIG, "--purpose", purpose, "--count", "4", "--no-psi"]) == 0
    captured = capsys.readouterr()
    assert "4 ok" in captured.out
    assert "4 of 4 casts" in captured.err
    out = lab / "runs/cable_1" / folder
    dataset = read_dataset(out)
    assert dataset.info["kind"] == purpose
    assert dataset.info["settings"]["sampling"] == sampling
    # The wrist stays where it is asked to.
    assert dataset.actions[:, 3].tolist() == dataset.actions[:, 1].tolist()
    config = json.loads((out / "config.json").read_text())
    assert config["command"] == "collect"
    metrics = json.loads((out / "metrics.json").read_text())
    assert (metrics["cast_count"], metrics["status_counts"]) == (4, {"ok": 4})


def test_a_collection_of_casts_that_leave_the_table_says_what_stays_on_it(lab, capsys):
    module = (lab / "slow_rig_of_a_lab.py").read_text()
    (lab / "leaving_rig_of_a_lab.py").write_text(module.replace("Status.OK", "Status.OFF_TABLE"))
    arguments = ["collect", "--rig", "leaving_rig_of_a_lab:make", "--count", "2"]
    assert main(arguments) == 0
    assert "note: most casts left the table; --sampling spread" in capsys.readouterr().out


def test_a_collection_killed_again_and_again_makes_each_trial_once(lab):
    command = [sys.executable, "-c", COLLECT, "collect", *RIG, "--count", "16"]
    data = lab / "runs/cable_1/tune-data/data"
    for _ in range(2):
        before = len(list(data.rglob("file-*.parquet")))
        process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        while len(list(data.rglob("file-*.parquet"))) < before + 2 and process.poll() is None:
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert main(command[3:]) == 0
    dataset = read_dataset(data.parent)
    assert len(dataset) == 16
    # Only a trial whose row was not yet written when the process died may have been made twice.
    assert sorted(set(made(lab))) == list(range(16))
    assert len(made(lab)) <= 16 + 2
    (lab / "made.txt").unlink()
    assert main([*command[3:], "--out", "unbroken"]) == 0
    unbroken = read_dataset(lab / "unbroken")
    assert dataset.rest_xy.tolist() == unbroken.rest_xy.tolist()


def test_a_rig_that_fails_says_so_and_the_same_command_goes_on_but_no_other(lab, capsys):
    (lab / "broken").touch()
    assert main(["collect", *RIG, "--count", "3"]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("cablecast: trial 0 failed 3 times")
    assert "the cable fell out of the gripper" in line
    (lab / "broken").unlink()
    assert main(["collect", *RIG, "--count", "3"]) == 0
    capsys.readouterr()
    assert main(["collect", *RIG, "--count", "4"]) == 2
    assert "count is 3 there and 4 here" in capsys.readouterr().err
    assert made(lab) == [0, 1, 2]


def test_repeats_are_measured_drawn_and_compared_with_the_paper(lab, capsys):
    pytest.importorskip("matplotlib")
    arguments = ["repeat", *RIG, "--combinations", "1.2", "1.8-psi", "--action-count", "2"]
    assert main([*arguments, "--repeats", "4"]) == 0
    printed = capsys.readouterr().out
    assert "1.27" in printed
    assert "4.72" in printed
    out = lab / "runs/cable_1/repeat-slow_rig_of_a_lab-make"
    combinations = json.loads((out / "metrics.json").read_text())["combinations"]
    assert [values["label"] for values in combinations] == ["v_max 1.2", "v_max 1.8 with psi"]
    assert all(values["cast_count"] == 8 for values in combinations)
    # 10 mm along each axis are 2.3 % of 0.62 m; eight casts tell it to a half.
    assert combinations[0]["scatter_pct"] == pytest.approx(2.3, rel=0.6)
    assert (out / "repeatability.png").read_bytes().startswith(b"\x89PNG")
    assert len((out / "1.2/actions.csv").read_text().splitlines()) == 3
    # A run of the same settings makes no cast, one of further combinations only theirs.
    before = len(made(lab))
    assert main([*arguments, "--repeats", "4"]) == 0
    assert len(made(lab)) == before
    more = ["repeat", *RIG, "--combinations", "1.5", "--action-count", "2", "--repeats", "4"]
    assert main(more) == 0
    assert len(made(lab)) == before + 8
    capsys.readouterr()
    assert main([*arguments, "--repeats", "3"]) == 2
    assert "repeats is 4 there and 3 here" in capsys.readouterr().err


def test_combinations_that_are_added_later_stand_beside_the_earlier_ones(lab, capsys, monkeypatch):
    pytest.importorskip("matplotlib")
    drawn = []
    monkeypatch.setattr(
        "cablecast.pipeline.repeat.repeatability_map",
        lambda results, table: (
            drawn.append([r.label for r in results]) or repeatability_map(results, table)
        ),
    )
    shared = ["repeat", *RIG, "--action-count", "2", "--repeats", "2", "--out", "out"]

    def combinations_after(*names):
        assert main([*shared, "--combinations", *names]) == 0
        return json.loads((lab / "out/metrics.json").read_text())["combinations"]

    earlier = combinations_after("1.2", "1.8-psi")
    capsys.readouterr()
    added = combinations_after("1.5")
    assert [added[0], added[2]] == earlier
    assert "1.8 with psi" in capsys.readouterr().out
    labels = ["v_max 1.2", "v_max 1.5", "v_max 1.8 with psi"]
    assert [row["label"] for row in added] == labels
    assert drawn == [[labels[0], labels[2]], labels]
    # What is known is not drawn again; without its casts, a combination keeps its figures.
    assert combinations_after("1.5") == added
    assert len(drawn) == 2
    shutil.rmtree(lab / "out/1.2/casts")
    (lab / "out/repeatability.png").unlink()
    assert combinations_after("1.5") == added
    assert drawn[2] == labels[1:]


def test_actions_of_one_s_own_are_repeated(lab, capsys):
    pytest.importorskip("matplotlib")
    file = lab / "actions.csv"
    file.write_text("theta1_deg,theta2_deg,r2_m,psi_deg\n-40,30,0.6,50\n")
    assert main(["repeat", *RIG, "--actions", str(file), "--repeats", "3", "--out", "out"]) == 0
    assert made(lab) == [0, 1, 2]
    for text, words in (
        ("theta1_deg,theta2_deg\n-40,30\n", "lacks the columns r2_m, psi_deg"),
        ("theta1_deg,theta2_deg,r2_m,psi_deg\n", "must hold at least 1 rows"),
        ("theta1_deg,theta2_deg,r2_m,psi_deg\n40,30,0.6,50\n", "opposite signs"),
        ("theta1_deg,theta2_deg,r2_m,psi_deg,pace\n-40,30,0.6,50,4\n", "pace = 4 is outside"),
        ("theta1_deg,theta2_deg,r2_m,psi_deg,pace\n-40,30,0.6,50,\n", "is no finite number"),
    ):
        file.write_text(text)
        capsys.readouterr()
        assert main(["repeat", *RIG, "--actions", str(file), "--out", "other"]) == 2
        assert words in capsys.readouterr().err
    assert not (lab / "other").exists()
    file.write_text("theta1_deg,theta2_deg,r2_m,psi_deg,pace\n-40,30,0.6,50,0.5\n")
    assert main(["repeat", *RIG, "--actions", str(file), "--repeats", "2", "--out", "slow"]) == 0
    # The table of the actions can be repeated again.
    tables = [lab / folder / "1.5-psi/actions.csv" for folder in ("out", "slow")]
    assert [read_actions(table)[:, 4].tolist() for table in tables] == [[1.0], [0.5]]
