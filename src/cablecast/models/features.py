"""Features of actions, their normalisation, and the perturbations used for sensitivity."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import InputError

FEATURE_COUNT = 4

DEVIATION = np.array([np.radians(1.0), np.radians(1.0), 0.01, np.radians(1.0)])
"""Execution error assumed in (theta1, theta2, r2, psi): 1 degree and 1 cm."""

# A spread below this is rounding; dividing by it would blow the rounding up.
_SCALE_MIN = 1e-9
_ENDPOINT_SCALE_MIN = 1e-6


def action_features(actions: ArrayLike) -> NDArray[np.float64]:
    """Return the features of actions.

    psi is replaced by the turn of the wrist relative to the arm, psi - theta2. This turn swings the
    cable after the arm has stopped and, unlike psi, does not vary along with theta2.

    Args:
        actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].

    Returns:
        (theta1, theta2, r2, psi - theta2), shape [action, 4].

    Raises:
        InputError: The array has another shape.
    """
    features = np.array(actions, dtype=float)
    if features.ndim != 2 or features.shape[1] != FEATURE_COUNT:
        raise InputError(f"actions have shape {features.shape}: it must be [action, 4]")
    features[:, 3] -= features[:, 1]
    return features


def deviations(actions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the perturbations by which the sensitivity of an action is measured.

    There is one for each variable. In an action set without psi, psi always equals theta2, so a
    perturbation of theta2 includes psi and there is none of psi alone.

    Args:
        actions: All actions of the set, shape [action, 4].

    Returns:
        Changes of (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [change, 4].
    """
    changes = np.diag(DEVIATION)
    if np.allclose(actions[:, 3], actions[:, 1], rtol=0.0, atol=1e-9):
        changes[1] += changes[3]
        changes = changes[:3]
    return changes


def normalization(actions: NDArray[np.float64], endpoint_xy: NDArray[np.float64]) -> dict[str, Any]:
    """Return the means and scales of training rows, as arguments of a `LandingModel`.

    A feature that does not vary has the scale 1: psi - theta2 in an action set without psi.

    Args:
        actions: Training actions, shape [row, 4].
        endpoint_xy: Their endpoints [m], shape [row, 2].
    """
    features = action_features(actions)
    scale = features.std(axis=0)
    return {
        "feature_mean": features.mean(axis=0),
        "feature_scale": np.where(scale > _SCALE_MIN, scale, 1.0),
        "endpoint_mean": endpoint_xy.mean(axis=0),
        "endpoint_scale": max(float(endpoint_xy.std(axis=0).mean()), _ENDPOINT_SCALE_MIN),
    }
