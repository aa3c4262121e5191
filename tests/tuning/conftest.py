import dataclasses

import numpy as np
import pytest

from cablecast.data.record import collect_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.action import ActionRanges
from cablecast.rigs.engine import RigEngine
from cablecast.setup import Setup
from cablecast.tuning.tracks import MeasuredTracks

SETUP = Setup()
SEGMENT_COUNT, DT = 10, 2e-3
TRIAL_COUNT = 10


def coarse_engine() -> EngineWarp:
    """Coarse, to be quick: tracks are compared with those of the same engine."""
    return EngineWarp(segment_count=SEGMENT_COUNT, dt=DT)


@pytest.fixture
def engine() -> EngineWarp:
    return coarse_engine()


@pytest.fixture(scope="session")
def cable():
    return SETUP.cable


@pytest.fixture(scope="session")
def truth(cable):
    """Return the true parameters of the cable of the recorded trials."""
    return dataclasses.replace(
        cable.params, bend_stiffness=1e-3, lateral_friction=0.5, worksurface_friction=0.5
    )


@pytest.fixture(scope="session")
def dataset(truth, tmp_path_factory):
    """Trials on a rig that is the engine itself with the true parameters."""
    return collect_dataset(
        tmp_path_factory.mktemp("recorded") / "tune-data",
        RigEngine(coarse_engine(), SETUP, truth),
        SETUP,
        purpose="tune",
        count=TRIAL_COUNT,
        ranges=ActionRanges(),
    )


@pytest.fixture(scope="session")
def tracks(dataset) -> MeasuredTracks:
    return MeasuredTracks.from_dataset(dataset)


@pytest.fixture(scope="session")
def good(tracks) -> MeasuredTracks:
    """Return the tracks that stayed on the table."""
    return tracks[np.flatnonzero(tracks.status == "ok")]


@pytest.fixture(scope="session")
def few(good) -> MeasuredTracks:
    """Return three of these."""
    return good[np.arange(3)]
