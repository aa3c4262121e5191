"""Films of a hand that swings a cable lead to its numbers, and to models of other simulators."""

import csv
import json

import pytest

pytest.importorskip("cv2")

from tools.film import TURN
from tools.film import main as make_films

from cablecast.cli import main
from cablecast.data.dataset import read_dataset
from cablecast.exports.facts import CableModel
from cablecast.pipeline.export import export_cable
from cablecast.pipeline.tune import tune
from cablecast.setup import Setup
from cablecast.tuning.fit import FitConfig

# Two films at 30 frames/s determine the friction within some 20 %, and stiffness over mass within
# some 15 %: so wide are the stated intervals. At 20 frames/s a hand's turns are cut.
FRICTION_SHARE, STIFFNESS_FACTOR = 0.1, 1.2
# A tag of 3 cm is some 20 px wide: its direction is known to a tenth of a pixel or two [rad].
TURN_TOLERANCE = 0.02
FIT = FitConfig(
    start_count=3,
    rough_iterations=6,
    kept_start_count=1,
    coarse_iterations=1,
    fine_iterations=1,
    materials=(),
    ensemble_iterations=0,
)


def rows(file):
    return list(csv.DictReader(file.open()))


def refused(arguments, capsys):
    assert main(["track", *map(str, arguments)]) == 2
    return capsys.readouterr().err.splitlines()[-1]


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    """Two films with markers."""
    folder = tmp_path_factory.mktemp("films")
    make_films(["hand", str(folder), "--count", "2", "--rate", "30"])
    return folder


def track(folder, out, *grip):
    """Track the films of a folder, and return the table of their casts."""
    videos = [str(file) for file in sorted(folder.glob("*.mp4"))]
    words = [*videos, "--tags", str(folder / "tags.yaml"), *grip, "--out", str(out)]
    assert main(["track", *words]) == 0
    return out / "casts.csv"


def test_a_tag_on_the_hand_tells_how_it_turns(tmp_path):
    make_films(["hand", str(tmp_path), "--count", "1", "--rate", "30", "--tag", "7"])
    table = track(tmp_path, tmp_path / "track", "--grip-tag", "7")
    turns = [abs(float(row["grip_yaw_rad"])) for row in rows(table) if row["grip_yaw_rad"]]
    assert max(turns) == pytest.approx(TURN, abs=TURN_TOLERANCE)


@pytest.mark.slow
def test_films_of_a_hand_become_the_numbers_of_the_cable(films, tmp_path):
    table = track(films, tmp_path / "track", "--grip-hue", "242")
    assert {row["cast"] for row in rows(table)} == {"000000", "000001"}
    assert main(["import", str(table), "--out", str(tmp_path / "casts")]) == 0
    tuned = tune(read_dataset(tmp_path / "casts"), config=FIT)
    truth = json.loads((films / "truth.json").read_text())
    friction = truth["lateral_friction"] * truth["worksurface_friction"]
    assert float(tuned.params.friction) == pytest.approx(friction, rel=FRICTION_SHARE)
    ratio = float(tuned.params.bend_stiffness / tuned.params.mass)
    assert 1 / STIFFNESS_FACTOR < ratio * truth["mass"] / truth["bend_stiffness"] < STIFFNESS_FACTOR
    low, high = CableModel(cable=tuned.setup.cable, posterior=tuned.posterior).intervals()[
        "friction"
    ]
    assert low < friction < high < Setup().cable.params.friction
    assert all(file.is_file() for file in export_cable(tuned, tmp_path / "models"))


def test_a_hand_that_cannot_be_told_from_the_free_end_is_refused(films, capsys, tmp_path):
    video, tags = films / "000000.mp4", films / "tags.yaml"
    known = [video, "--tags", tags, "--out", tmp_path / "out"]
    assert "30 deg apart" in refused([*known, "--grip-hue", 152], capsys)
    assert "grip_hue or grip_tag" in refused([*known, "--grip-hue", 242, "--grip-tag", 7], capsys)
    assert "2 videos are called 000000" in refused([video, video], capsys)
    assert "VIDEO" in refused([], capsys)
