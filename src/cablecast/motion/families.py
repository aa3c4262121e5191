"""Families of motions that a cast may be planned from, by the name that files know them by."""

from collections.abc import Mapping

import numpy as np

from cablecast.motion.casting import Action
from cablecast.motion.joint_move import JointMove
from cablecast.motion.polar import PolarCast
from cablecast.motion.trajectory import Motion

MOTIONS: tuple[type[Motion], ...] = (Action, PolarCast, JointMove)
"""All families; another one is a class in a file of its own, and a name here."""


def motion_of(columns: Mapping[str, float]) -> Motion | None:
    """Return the motion whose parameters are known of one cast; None where those of none are.

    Args:
        columns: Parameters of all families by name; NaN, or absent, where unknown.
    """
    for kind in MOTIONS:
        values = np.array([columns.get(name, np.nan) for name in kind.parameters], dtype=float)
        if np.all(np.isfinite(values)):
            return kind.from_array(values)
    return None
