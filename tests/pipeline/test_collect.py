"""Choice of the actions of a collection."""

import numpy as np
import pytest

import cablecast as cc
from cablecast.errors import InputError
from cablecast.rigs.engine import RigEngine
from cablecast.tuning.spread import spread_actions

SETUP = cc.Setup()


@pytest.fixture(scope="module")
def rig():
    with cc.make_rig(RigEngine(cc.EngineWarp(10, 2e-3), SETUP), SETUP) as opened:
        yield opened


@pytest.mark.usefixtures("coarse_engine", "few_casts")
def test_spread_casts_are_those_of_the_believed_cable_and_a_stopped_collection_goes_on(
    rig, tmp_path
):
    reports, options = [], {"count": 3, "sampling": "spread", "seed": 2, "out": tmp_path / "casts"}
    casts = cc.collect(rig, **options, progress=reports.append)
    # What the casts are to be spread over is said before they are made.
    assert any("casts of cable_1 reach" in report.note for report in reports)
    expected = spread_actions(SETUP, 3, cc.EngineWarp(), seed=2)
    np.testing.assert_array_equal(casts.actions, expected)
    again = cc.collect(rig, **options)
    np.testing.assert_array_equal(again.actions, expected)


def test_an_unknown_choice_is_refused_with_the_known_ones(rig):
    with pytest.raises(InputError, match="'random' must be uniform, grid or spread"):
        cc.collect(rig, count=3, sampling="random")
