"""What uneven friction leaves of a miss after one correction.

The strange rig is cast at random actions without scatter, once as it is and once with one
friction everywhere. The landings of both give the shift by the uneven friction; central differences
about the action give the Jacobian of the landing. A correction by the Jacobian J of the even world
moves the landing in the uneven one, whose Jacobian is J', so that the share |I - J' J^+| of a miss
in the worst direction is left: what a method with no other error would leave.
"""

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from benchmarks.places import DIFFERENCES
from benchmarks.result import Table
from benchmarks.strange_rig import Scatter, StrangeRig
from cablecast.cast import TrialStatus
from cablecast.errors import JointLimitError
from cablecast.motion.action import ACTION_SIZE, ActionRanges
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import feasible_ranges, feasible_uniform
from cablecast.motion.trajectory import plan_trajectory
from cablecast.setup import Setup

STEP = 0.02
"""Half the way of a central difference, as a share of the range of each number of an action."""
STILL = Scatter(angle=0.0, bow=0.0, friction=0.0)
UNEVEN = ("strange", "patchy")
"""Rigs that are compared with the one of even friction."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class UnevenArgs:
    """Effect of uneven friction on landings and corrections.

    Attributes:
        cable: Name of a preset.
        labs: Seeds of the laboratories.
        count: Actions in each laboratory whose casts come to rest on the table.
    """

    cable: str = "cable_1"
    labs: tuple[int, ...] = (0, 1, 2)
    count: int = 24


def landing(rig: StrangeRig, action: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return where a cast comes to rest [m], shape [2]; None unless it is made and seen there."""
    try:
        motion = plan_trajectory(Action.from_array(action), rig.setup)
    except JointLimitError:
        return None
    # The camera errs alike in every cast, which differences don't see.
    rig.seek(0)
    rig.reset()
    track = rig.execute(motion)
    return track.endpoint_xy[-1] if track.status is TrialStatus.OK else None


def linear(rig: StrangeRig, actions: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the landing of an action, then its change with each number, shape [1 + number, 2].

    Args:
        rig: Rig without scatter.
        actions: An action, then those a step up and those a step down in each of its numbers,
            shape [1 + 2 number, number].
    """
    found = []
    for action in actions:
        xy = landing(rig, action)
        if xy is None:
            return None
        found.append(xy)
    middle, up, down = np.split(np.array(found), (1, 1 + len(found) // 2))
    return np.concatenate([middle, (up - down) / 2])


def stencils(setup: Setup, count: int, seed: int) -> NDArray[np.float64]:
    """Return feasible actions with their steps up and down, shape [action, 1 + 2 number, number].

    psi moves with theta2, so that theta2 can take a step where the wrist does not turn.
    """
    ranges = feasible_ranges(setup)
    bounds = np.array([ranges.theta1, ranges.theta2, ranges.r2, ranges.wrist])
    inner = bounds + STEP * np.diff(bounds) * [1.0, -1.0]
    theta1, theta2, r2, wrist = ((float(low), float(high)) for low, high in inner)
    within = ActionRanges(theta1=theta1, theta2=theta2, r2=r2, wrist=wrist)
    actions = feasible_uniform(count, setup, within, seed=seed)
    steps = STEP * np.diff(bounds) * np.eye(len(bounds), ACTION_SIZE)
    steps[1, 3] = steps[1, 1]
    around = np.concatenate([np.zeros((1, ACTION_SIZE)), steps, -steps])
    return actions[:, None] + around


def after_correction(
    believed: NDArray[np.float64], true: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the relative error of a Jacobian, and the share of a miss that a step by it leaves.

    Args:
        believed: Jacobian that the correction inverts, shape [2, number].
        true: Jacobian of the rig, shape [2, number].
    """
    change = np.linalg.norm(true - believed) / np.linalg.norm(believed)
    left = np.linalg.norm(np.eye(2) - true @ np.linalg.pinv(believed), 2)
    return float(change), float(left)


def compare(args: UnevenArgs) -> dict[str, NDArray[np.float64]]:
    """Return shift [%], change of the Jacobian [-] and share left [-] by rig, [action, 3].

    The actions are those that come to rest on the table on all rigs.
    """
    setup = Setup(cable=args.cable)
    rows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in UNEVEN}
    for number, lab in enumerate(args.labs, 1):
        rigs = [
            StrangeRig(setup, lab_seed=lab, scatter=STILL, **DIFFERENCES[name])
            for name in ("even", *UNEVEN)
        ]
        for actions in stencils(setup, 10 * args.count, lab):
            casts = [cast for rig in rigs if (cast := linear(rig, actions)) is not None]
            if len(casts) < len(rigs):
                continue
            smooth, *others = casts
            for name, rough in zip(UNEVEN, others, strict=True):
                shift = 100.0 * float(np.linalg.norm(rough[0] - smooth[0])) / setup.cable.length
                rows[name].append((shift, *after_correction(smooth[1:].T, rough[1:].T)))
            if len(rows[UNEVEN[0]]) == number * args.count:
                break
    return {name: np.array(of) for name, of in rows.items()}


def uneven(args: UnevenArgs) -> Iterator[Table]:
    """Yield medians and quartiles on both rigs."""
    table = Table(
        f"Uneven friction and one friction, {args.cable}: medians (quartiles)",
        ("rig", "actions", "shift of the landing [%]", "change of the Jacobian", "miss left"),
        [],
    )
    for name, found in compare(args).items():
        q1, median, q3 = np.quantile(found, (0.25, 0.5, 0.75), axis=0)
        cells = (f"{m:.2f} ({a:.2f} to {b:.2f})" for m, a, b in zip(median, q1, q3, strict=True))
        table.rows.append((name, len(found), *cells))
    yield table
