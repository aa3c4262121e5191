import dataclasses

import numpy as np
import pytest
from tests.rigs.conftest import TWIN_FILE

from cablecast.motion.polar import reset_pose
from cablecast.setup import Setup, load_setup

# From docs/lab.md, with a box about the arm's reach.
UR10E = {
    "arm": {"base_height": 0.126},
    "workspace": {"r_max": 1.2, "reset_y": 0.76},
    "motion": {"r0": 0.76, "control_dt": 0.002},
    "robot": {"box_low": [-1.25, 0.05, 0.0], "box_high": [1.25, 1.25, 1.5]},
}


@pytest.fixture(scope="session")
def twin_setup() -> Setup:
    """Read the lab file of the twin that comes with cablecast, without its camera."""
    return dataclasses.replace(load_setup(TWIN_FILE), camera=None)


@pytest.fixture(scope="session")
def home(twin_setup) -> np.ndarray:
    """Return the joint angles at the start of its casts."""
    return twin_setup.arm.inverse(np.asarray(reset_pose(twin_setup.workspace), dtype=float))
