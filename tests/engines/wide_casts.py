"""Casts over the whole range that the motion room allows, also those that no arm can follow."""

import numpy as np

from cablecast.cable import load_cable
from cablecast.motion.casting import cast_grip_paths
from cablecast.setup import Setup

CABLE = load_cable("cable_1")


def casts(count, seed=0, v_max=1.5):
    rng = np.random.default_rng(seed)
    theta1 = -np.radians(rng.uniform(5, 80, count))
    theta2 = np.radians(rng.uniform(5, 80, count))
    r2 = rng.uniform(0.35, 0.8, count)
    psi = theta2 + np.radians(rng.uniform(0, 90, count))
    actions = np.stack([theta1, theta2, r2, psi], axis=1)
    return cast_grip_paths(actions, Setup().with_motion(v_max=v_max))


def distance_pct(a, b):
    """Distance of landings in % of cable length."""
    return 100 * np.linalg.norm(a[:, -1] - b[:, -1], axis=1) / CABLE.length
