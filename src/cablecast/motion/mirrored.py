"""Mirroring: models know casts to the right; those to the left are their mirror images."""

import numpy as np
from numpy.typing import NDArray

from cablecast.conventions import mirror_xy
from cablecast.motion.action import mirror_actions


def rightward(actions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return actions as a model knows them, with theta2 > 0, and the hands they are played with.

    Args:
        actions: Actions on either side, shape [action, 4].

    Returns:
        Actions, shape [action, 4], and +1, or -1 for those that were mirrored, shape [action].
    """
    hands = np.where(actions[:, 1] < 0, -1.0, 1.0)
    return played(actions, hands), hands


def side_hands(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return +1 for points on the right half of the table, and -1 for others, shape [point]."""
    return np.where(xy[:, 0] < 0, -1.0, 1.0)


def played(actions: NDArray[np.float64], hands: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return actions to the right as they are played with given hands, shape [action, 4]."""
    return np.where(hands[:, None] < 0, mirror_actions(actions), actions)


def to_right(xy: NDArray[np.float64], hands: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return one point or one for each action as the model sees it, or back, [action, 2]."""
    return np.where(hands[:, None] < 0, mirror_xy(xy), xy)
