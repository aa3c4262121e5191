"""Swings by a real arm: what is checked before one, and where the cable can be in it."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from cablecast.conventions import Array
from cablecast.errors import InputError, JointLimitError
from cablecast.motion.joint_move import JointMoves
from cablecast.rigs.path import JointCurve, check_path
from cablecast.setup import Setup

STRETCH = 1.05
"""Length of a pulled cable over that of the lab file, knot and tape included [-]."""
_CHECK_DT = 0.008


def envelope(setup: Setup, q: Array) -> tuple[Array, Array]:
    """Return the corners of a box that the cable cannot leave [m], shape [3] each.

    It can be anywhere within its length, attachment included, of where its root is. Joint angles
    [rad] have the shape [step, joint].
    """
    moves, cable = JointMoves.of(setup), setup.cable
    root = moves.stick.root(moves.arm.frames(q)[-1])
    reach = STRETCH * (cable.length + cable.attachment_length)
    return root.min(axis=0) - reach, root.max(axis=0) + reach


def move_envelope(setup: Setup, unit: ArrayLike) -> tuple[Array, Array]:
    """Return `envelope` of some moves by their unit coordinates, shape [move, parameter]."""
    moves, unit = JointMoves.of(setup), np.atleast_2d(np.asarray(unit, dtype=float))
    times = np.arange(0.0, float(moves.duration(unit).max()) + _CHECK_DT, _CHECK_DT)
    q, _ = moves.angles(unit, times)
    return envelope(setup, q.reshape(-1, moves.arm.joint_count))


def check_swing(curve: JointCurve, setup: Setup, what: str) -> None:
    """Refuse a motion with a stick that leaves limits or box, or in which the cable could.

    Beside what `check_path` refuses, the box that the cable cannot leave must lie within the box
    that the lab file says to be clear.

    Args:
        curve: The path as it is sent.
        setup: Set-up with robot and strike sections.
        what: Name of the motion in the error.

    Raises:
        JointLimitError: A limit, a box or a distance is violated; names the value and the bound.
        InputError: The lab file does not say which box is clear.
    """
    strike = setup.strike
    if strike is None or strike.clear_low is None or strike.clear_high is None:
        raise InputError(
            "a real arm swings a cable only in a box that a person has seen to be clear of people "
            "and things: set clear_low and clear_high in the strike section"
        )
    armed = dataclasses.replace(setup, arm=JointMoves.of(setup).arm_with_stick)
    check_path(curve, armed, what, strike.floor)
    q = curve.evaluate(np.arange(0.0, curve.duration + _CHECK_DT, _CHECK_DT))
    low, high = envelope(setup, q)
    clear_low, clear_high = np.array(strike.clear_low), np.array(strike.clear_high)
    beyond = np.maximum(clear_low - low, high - clear_high)
    if beyond.max() > 0.0:
        axis = int(np.argmax(beyond))
        below = clear_low[axis] - low[axis] >= high[axis] - clear_high[axis]
        value, bound = (low, clear_low) if below else (high, clear_high)
        raise JointLimitError(
            f"{what}: the cable could come to {'xyz'[axis]} = {value[axis]:.2f} m, outside the "
            f"clear box, which ends at {bound[axis]:.2f} m"
        )
