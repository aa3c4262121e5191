import dataclasses
import time

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
# Speed of the fastest joint below which the arm rests [rad/s].
REST_SPEED = 0.01
# Longest time for which anything is waited for, on a busy computer [s].
PATIENCE = 120.0


def wait_until(is_so):
    """Wait until something is so."""
    deadline = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def make_fault(process, name):
    """Let a fault come, and wait until it is there."""
    process.admin.fault(name)
    wait_until(lambda: not process.admin.state()["faults"])


def is_idle(process):
    """Return whether the arm rests, and no program runs."""
    state = process.admin.state()
    return state["at_rest"] and not state["program"]


def time_to_rest(process, event):
    """Return how long after its newest event the arm still moved [s], by the twin's clock."""
    begin = [e["time"] for e in process.admin.events() if e["what"] == event][-1]
    wait_until(lambda: process.admin.state()["time"] > begin + 1.0)
    truth = process.admin.truth(begin, begin + 1.0)
    moving = [
        t for t, s in zip(truth["times"], truth["joint_speed"], strict=True) if s > REST_SPEED
    ]
    return moving[-1] - begin if moving else 0.0


@pytest.fixture(scope="session")
def twin_setup() -> Setup:
    """Read the lab file of the twin that comes with cablecast, without its camera."""
    return dataclasses.replace(load_setup(TWIN_FILE), camera=None)


@pytest.fixture(scope="session")
def home(twin_setup) -> np.ndarray:
    """Return the joint angles at the start of its casts."""
    return twin_setup.arm.inverse(np.asarray(reset_pose(twin_setup.workspace), dtype=float))
