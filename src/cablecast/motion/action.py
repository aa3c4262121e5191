"""Batches of actions of the sweep, the casting motion of the paper; their ranges and grids.

An action is (theta1, theta2, r2, psi, pace). The gripper sweeps from straight ahead to theta1 and
back to theta2 while its radius changes from r0 to r2. psi is the final heading of the cable at the
gripper (paper, section V-B, equations 2 and 3). The paper makes every motion as fast as v_max and
the jerk of the set-up allow, a pace of 1; at another pace the same path takes 1 / pace as long.
Batches are arrays of shape [action, 5]; [action, 4] means the paper's pace.

Models predict casts to the right; casts to the left are their mirror images. `side` is +1 for the
right and -1 for the left.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import ActionError, InputError

ACTION_NAMES = ("theta1", "theta2", "r2", "psi", "pace")
ACTION_SIZE = len(ACTION_NAMES)

THETA_MIN = np.radians(0.5)
"""Smallest sweep [rad]; below it the reversal at theta1 is meaningless."""
THETA_MAX = np.radians(120.0)
"""Largest sweep [rad]; beyond it the gripper would be behind the robot."""
R2_BOUNDS = (0.05, 5.0)
"""Bounds of the radius about the polar origin [m]; the feasibility check tests the arm's reach."""
PSI_MAX = np.pi
"""Largest final heading of the cable [rad]."""
PACE_BOUNDS = (0.05, 3.0)
"""Bounds of the pace [-]; slower motions would take too long."""


def action_numbers(values: ArrayLike) -> NDArray[np.float64]:
    """Return values of actions as an array of any shape; raises ActionError for others."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise ActionError(f"{str(values)[:60]} holds a value that is not a number") from None


def action_rows(actions: ArrayLike) -> NDArray[np.float64]:
    """Return a batch of actions as an array, shape [action, 5].

    Args:
        actions: theta1, theta2 [rad], r2 [m], psi [rad], pace [-], shape [action, 5]; or without
            the pace, which is 1 then, shape [action, 4].

    Raises:
        ActionError: The array has another shape, or holds something else.
    """
    actions = action_numbers(actions)
    if actions.ndim != 2 or actions.shape[1] not in (ACTION_SIZE - 1, ACTION_SIZE):
        raise ActionError(f"actions have shape {actions.shape}: it must be [action, 4 or 5]")
    if actions.shape[1] == ACTION_SIZE:
        return actions
    return np.column_stack([actions, np.ones(len(actions))])


def check_action_values(actions: ArrayLike) -> NDArray[np.float64]:
    """Check a batch of actions and return it as `action_rows` does.

    Raises:
        ActionError: There is no action, a value is not finite or out of bounds, both arcs end on
            the same side, or psi stops short of theta2.
    """
    actions = action_rows(actions)
    if len(actions) == 0:
        raise ActionError("there are 0 actions: there must be at least 1")
    theta1, theta2, r2, psi, pace = actions.T

    def refuse(bad, describe):
        if np.any(bad):
            row = int(np.argmax(bad))
            where = "" if len(actions) == 1 else f"action {row}: "
            raise ActionError(where + describe(row))

    for column, name in enumerate(ACTION_NAMES):
        values = actions[:, column]
        refuse(
            ~np.isfinite(values),
            lambda i, n=name, v=values: f"{n} = {v[i]} must be a finite number",
        )
    low, high = np.degrees([THETA_MIN, THETA_MAX])
    for name, theta in (("theta1", theta1), ("theta2", theta2)):
        refuse(
            (np.abs(theta) < THETA_MIN) | (np.abs(theta) > THETA_MAX),
            lambda i, n=name, v=theta: (
                f"|{n}| = {np.degrees(abs(v[i])):.4g} deg is outside [{low:g}, {high:g}] deg"
            ),
        )
    refuse(
        theta1 * theta2 >= 0,
        lambda i: (
            f"theta1 = {np.degrees(theta1[i]):.4g} deg and theta2 = "
            f"{np.degrees(theta2[i]):.4g} deg must have opposite signs"
        ),
    )
    refuse(
        (r2 < R2_BOUNDS[0]) | (r2 > R2_BOUNDS[1]),
        lambda i: f"r2 = {r2[i]:.4g} m is outside [{R2_BOUNDS[0]:g}, {R2_BOUNDS[1]:g}] m",
    )
    # In a grid, theta2 plus the wrist turn may fall an ulp short of theta2.
    side = np.sign(theta2)
    refuse(
        (side * psi < np.abs(theta2) - 1e-9) | (np.abs(psi) > PSI_MAX + 1e-9),
        lambda i: (
            f"psi = {np.degrees(psi[i]):.4g} deg must lie between theta2 = "
            f"{np.degrees(theta2[i]):.4g} deg and {np.degrees(side[i] * PSI_MAX):.4g} deg"
        ),
    )
    refuse(
        (pace < PACE_BOUNDS[0]) | (pace > PACE_BOUNDS[1]),
        lambda i: f"pace = {pace[i]:.4g} is outside [{PACE_BOUNDS[0]:g}, {PACE_BOUNDS[1]:g}]",
    )
    return actions


_MIRRORED = np.array([True, True, False, True, False])


def mirror_actions(actions: ArrayLike, side: ArrayLike = -1.0) -> NDArray[np.float64]:
    """Mirror actions, shape [..., 5], about the workspace axis where `side`, shape [...], is -1."""
    actions, side = np.asarray(actions, dtype=float), np.asarray(side, dtype=float)[..., None]
    return actions * np.where(_MIRRORED[: actions.shape[-1]], side, 1.0)


def mirror_to_right(
    actions: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return actions mirrored to theta2 > 0, shape [action, 5], and their sides, shape [action].

    `mirror_actions(*mirror_to_right(actions))` gives back the actions.
    """
    side = np.where(actions[:, 1] < 0, -1.0, 1.0)
    return mirror_actions(actions, side), side


@dataclasses.dataclass(frozen=True, kw_only=True)
class ActionRanges:
    """Ranges of actions that end to the right of the workspace axis.

    The paper does not publish its ranges. The defaults follow its sibling task (arXiv 2111.04814:
    theta1 1 to 80 deg, theta2 20 to 80 deg, r2 0.21 to 0.77 m), extended to small theta2 to cover
    the workspace axis. What an arm can do at a table is `feasible_ranges`.

    Attributes:
        theta1: End of the first arc [rad].
        theta2: End of the second arc [rad].
        r2: Final radius about the polar origin [m].
        wrist: Wrist turn psi - theta2 [rad]; (0, 0) gives the action set A1.
        pace: Speed over that of the paper's motion [-]; (1, 1) gives the paper's.
    """

    theta1: tuple[float, float] = (-float(np.radians(80)), -float(np.radians(5)))
    theta2: tuple[float, float] = (float(np.radians(5)), float(np.radians(80)))
    r2: tuple[float, float] = (0.35, 0.80)
    wrist: tuple[float, float] = (0.0, float(np.radians(90)))
    pace: tuple[float, float] = (1.0, 1.0)

    def __post_init__(self):
        for name, low, high in (
            ("theta1", -THETA_MAX, -THETA_MIN),
            ("theta2", THETA_MIN, THETA_MAX),
            ("r2", *R2_BOUNDS),
            ("wrist", 0.0, PSI_MAX),
            ("pace", *PACE_BOUNDS),
        ):
            values = getattr(self, name)
            if len(values) != 2 or not low <= values[0] <= values[1] <= high:
                raise ActionError(
                    f"range of {name} = {tuple(values)} must ascend within [{low:.4g}, {high:.4g}]"
                )
        if self.theta2[1] + self.wrist[1] > PSI_MAX:
            raise ActionError(
                f"theta2 + wrist reaches {self.theta2[1] + self.wrist[1]:.4g} rad: psi must be at "
                f"most {PSI_MAX:.4g} rad"
            )

    def to_array(self) -> NDArray[np.float64]:
        """Return the ends of theta1, theta2, r2, the wrist turn and the pace, shape [5, 2]."""
        return np.array([self.theta1, self.theta2, self.r2, self.wrist, self.pace])

    def __str__(self) -> str:
        low, high = np.degrees([self.theta1, self.theta2, self.wrist]).T
        slow = "" if self.pace == (1.0, 1.0) else ", a pace from {:.2g} to {:.2g}"
        return (
            f"theta1 from {low[0]:.0f} to {high[0]:.0f} deg, theta2 from {low[1]:.0f} to "
            f"{high[1]:.0f} deg, r2 from {self.r2[0]:.2f} to {self.r2[1]:.2f} m"
            f"{slow.format(*self.pace)} and a wrist turn from {low[2]:.0f} to {high[2]:.0f} deg"
        )


def grid_actions(ranges: ActionRanges, counts: Sequence[int]) -> NDArray[np.float64]:
    """Return a full grid of actions with theta1 < 0 < theta2 <= psi.

    Args:
        ranges: Ranges of the grid, both ends included.
        counts: Number of values of theta1, theta2, r2, the wrist turn and the pace. Three counts
            mean psi = theta2 (A1), as in the paper's 15 x 15 x 15; without the fifth the pace is
            1. A count of one takes the middle of its range.

    Returns:
        Actions, shape [action, 5]; theta1 varies slowest, the pace fastest.
    """
    counts = tuple(int(count) for count in counts)
    if len(counts) not in (3, 4, 5) or min(counts) < 1:
        raise InputError(f"grid counts {counts} must be three, four or five positive numbers")
    bounds = ranges.to_array()
    if len(counts) == 3:
        bounds[3] = 0.0
    if len(counts) < ACTION_SIZE:
        bounds[4] = 1.0
    axes = [
        np.linspace(low, high, count) if count > 1 else np.array([(low + high) / 2])
        for (low, high), count in zip(bounds, (*counts, 1, 1)[:ACTION_SIZE], strict=True)
    ]
    grid = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    return with_psi(grid)


def with_psi(actions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return actions whose psi was given as the turn of the wrist, psi - theta2."""
    found = actions.copy()
    found[:, 3] += found[:, 1]
    return found
