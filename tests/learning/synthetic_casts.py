"""Casts whose landings follow a formula, and small models."""

import itertools

import numpy as np

from cablecast.data.dataset import Dataset
from cablecast.learning.gaussian_process import GaussianProcessModel
from cablecast.learning.landing import FEATURE_COUNT
from cablecast.learning.network import ForwardModel
from cablecast.motion.action import action_rows, with_psi
from cablecast.setup import Setup

SETUP = Setup()
CABLE = SETUP.cable


def random_actions(count, seed):
    """Actions from the whole range of the right half of the table, shape [count, 5]."""
    low, high = np.radians([-80, 5, 0, 0]), np.radians([-5, 80, 0, 90])
    low[2], high[2] = 0.35, 0.8
    actions = np.random.default_rng(seed).uniform(low, high, (count, 4))
    return action_rows(with_psi(actions))


def smooth_map(actions):
    """Return where a stick at the end of the arm lands; it lags more in wider swings of theta1."""
    theta1, theta2, r2, psi, _ = actions.T
    heading = psi + 0.3 * np.sin(2 * theta1) * r2
    x = r2 * np.sin(theta2) + CABLE.length * np.sin(heading)
    y = r2 * np.cos(theta2) + CABLE.length * np.cos(heading)
    return np.stack([x, y], axis=-1)


def dataset_of(actions, landing, kind="sim", fingerprint="f00d"):
    """Return a dataset of casts that reached no farther than where they landed."""
    reach = np.maximum(landing, [0.0, 1.22])
    extent = np.stack([0 * reach[:, 0], reach[:, 0], landing[:, 1], reach[:, 1]], axis=-1)
    return Dataset(
        actions=actions,
        rest_xy=landing,
        status=np.where(SETUP.workspace.on_table(landing), "ok", "off_table"),
        duration=np.ones(len(actions)),
        extent=extent,
        info={"kind": kind, "fingerprint": fingerprint, "settings": SETUP.to_settings()},
    )


def smooth_dataset(count=2000, seed=0):
    actions = random_actions(count, seed)
    return dataset_of(actions, smooth_map(actions))


def network(widths, seed=0, info=None):
    """Return a forward model with random weights, normalised for `random_actions`."""
    generator = np.random.default_rng(seed)
    weights = tuple(
        (
            generator.normal(scale=1 / np.sqrt(a), size=(a, b)).astype(np.float32),
            generator.normal(scale=0.1, size=b).astype(np.float32),
        )
        for a, b in itertools.pairwise(widths)
    )
    return ForwardModel(
        weights=weights,
        feature_mean=np.array([-0.74, 0.74, 0.575, 0.79, 0.0]),
        feature_scale=np.array([0.38, 0.38, 0.13, 0.45, 1.0]),
        endpoint_mean=np.array([0.6, 0.7]),
        endpoint_scale=0.3,
        info=info or {},
    )


def plain_model(*layers, setup=SETUP, **changes):
    """Return a model of these matrices and offsets that normalises nothing.

    Every cast keeps 1 m within the table, unless `changes` of the other fields say otherwise.
    """
    values = {
        "weights": tuple(
            (np.array(matrix, dtype=np.float32), np.array(offset, dtype=np.float32))
            for matrix, offset in layers
        ),
        "feature_mean": np.zeros(FEATURE_COUNT),
        "feature_scale": np.ones(FEATURE_COUNT),
        "endpoint_mean": np.zeros(2),
        "endpoint_scale": 1.0,
        "margin_features": np.zeros((1, FEATURE_COUNT), dtype=np.float32),
        "margins": np.ones(1, dtype=np.float32),
        "info": {"dataset": {"settings": setup.to_settings(), "fingerprint": "f00d"}},
    }
    return ForwardModel(**values | changes)


def linear_model(slope=0.05, **changes):
    """Return a model that lands at (0.9 theta2 - 0.2, 0.6 + r2 + slope * wrist)."""
    matrix = [[0.0, 0.0], [0.9, 0.0], [0.0, 1.0], [0.0, slope], [0.0, 0.0]]
    return plain_model((matrix, [-0.2, 0.6]), **changes)


def process_of(model):
    """Return a Gaussian process with the normalisation and the description of a network."""
    shared = vars(model).copy()
    del shared["weights"]
    return GaussianProcessModel(
        **shared,
        inputs=np.ones((3, FEATURE_COUNT), dtype=np.float32),
        length_scales=np.ones(FEATURE_COUNT),
        coefficients=np.ones((3, 2)),
    )
