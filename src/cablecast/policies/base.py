"""Policy and Plan: interface from targets to motions."""

import dataclasses
import functools
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.conventions import polar_to_xy
from cablecast.errors import InputError, TargetError
from cablecast.motion.action import Action
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.setup import Setup


def _unknown() -> NDArray[np.float64]:
    return np.array(np.nan)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """One motion per target, with its predicted landing.

    Attributes:
        setup: Set-up that the motions are planned for.
        target_xy: Targets [m], shape [target, 2].
        actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [target, 4]; NaN for motions
            without an action.
        predicted_xy: Predicted landings [m], shape [target, 2].
        inside_coverage: Whether the target lies inside the policy's coverage, shape [target].
        spread: Predicted standard deviation of the landing about `predicted_xy`, along each axis
            [m], shape [target]; NaN if unknown.
        sensitivity: Shift of the predicted landing for action errors of 1 degree and 1 cm [m],
            shape [target]; NaN if unknown.
        motions: Planned motions, one per target. If None, `trajectories` plans them from the
            actions.
    """

    setup: Setup
    target_xy: NDArray[np.float64]
    actions: NDArray[np.float64] = dataclasses.field(default_factory=_unknown)
    predicted_xy: NDArray[np.float64]
    inside_coverage: NDArray[np.bool_]
    spread: NDArray[np.float64] = dataclasses.field(default_factory=_unknown)
    sensitivity: NDArray[np.float64] = dataclasses.field(default_factory=_unknown)
    motions: tuple[Trajectory, ...] | None = None

    def __post_init__(self):
        count = len(np.atleast_2d(self.target_xy))
        for name, shape, kind in (
            ("target_xy", (count, 2), float),
            ("actions", (count, 4), float),
            ("predicted_xy", (count, 2), float),
            ("inside_coverage", (count,), bool),
            ("spread", (count,), float),
            ("sensitivity", (count,), float),
        ):
            values = np.asarray(getattr(self, name), dtype=kind)
            # A single NaN stands for unknown everywhere.
            values = np.full(shape, values) if values.ndim == 0 else values
            if values.shape != shape:
                raise InputError(f"plan {name} has shape {values.shape}: it must be {shape}")
            object.__setattr__(self, name, values)
        if self.motions is None:
            if np.any(bad := ~np.all(np.isfinite(self.actions), axis=1)):
                row = int(np.argmax(bad))
                raise InputError(f"the plan has neither an action nor a motion for target {row}")
        elif len(self.motions) != count:
            raise InputError(f"the plan has {len(self.motions)} motions for {count} targets")

    def __len__(self) -> int:
        return len(self.target_xy)

    @functools.cached_property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """Motions with joint set points, one per target.

        Raises:
            JointLimitError: A motion violates limits of the arm.
        """
        if self.motions is not None:
            return tuple(self.motions)
        return tuple(
            plan_trajectory(Action.from_array(action), self.setup) for action in self.actions
        )


class Policy(Protocol):
    """Interface of policies, which turn targets into motions; implement it to evaluate your own."""

    @property
    def setup(self) -> Setup:
        """Set-up that the policy plans for."""
        ...

    @property
    def info(self) -> dict[str, Any]:
        """Description of the policy as plain values, for the settings of a run."""
        ...

    def plan(
        self,
        target_xy: ArrayLike | None = None,
        *,
        r: ArrayLike | None = None,
        theta_deg: ArrayLike | None = None,
    ) -> Plan:
        """Plan a motion for each target; see `check_targets` for the arguments."""
        ...


def check_targets(
    setup: Setup,
    target_xy: ArrayLike | None = None,
    *,
    r: ArrayLike | None = None,
    theta_deg: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Check the target arguments of `Policy.plan` and return the targets.

    Args:
        setup: Set-up with the table, the reach and the cable.
        target_xy: Targets [m], shape [2] or [target, 2]; alternative to r and theta_deg.
        r: Distances from the robot's base [m], a number or shape [target].
        theta_deg: Angles from straight ahead, positive to the robot's right [deg], a number or
            shape [target].

    Returns:
        Targets [m], shape [target, 2].

    Raises:
        InputError: Both forms are given, or neither, or values of the wrong kind or shape.
        TargetError: A target is not finite, has a negative radius, is out of reach, or off the
            table.
    """
    if (target_xy is None) == (r is None and theta_deg is None):
        raise InputError("a plan takes either target_xy or r and theta_deg")
    if target_xy is None:
        target_xy = _from_polar(r, theta_deg)
    targets = np.atleast_2d(_numbers("target_xy", target_xy))
    if targets.ndim != 2 or targets.shape[1] != 2:
        raise InputError(
            f"target_xy has shape {np.shape(target_xy)}: it must be [2] or [target, 2]"
        )
    return setup.workspace.check_target(targets, setup.cable.length)


def _from_polar(r: ArrayLike | None, theta_deg: ArrayLike | None) -> NDArray[np.float64]:
    """Return targets [m] from radii [m] and angles [deg], shape [target, 2]."""
    if r is None or theta_deg is None:
        raise InputError("a plan needs both r and theta_deg")
    radius, angle = _numbers("r", r), _numbers("theta_deg", theta_deg)
    try:
        radius, angle = np.broadcast_arrays(np.atleast_1d(radius), np.atleast_1d(angle))
    except ValueError:
        shapes = f"{radius.shape} and {angle.shape}"
        raise InputError(f"r and theta_deg have shapes {shapes}, which do not match") from None
    if radius.ndim != 1:
        raise InputError(f"r and theta_deg have shape {radius.shape}: it must be [target]")
    for one_r, one_theta in zip(radius, angle, strict=True):
        if not (np.isfinite(one_r) and np.isfinite(one_theta)):
            raise TargetError(
                f"target r = {one_r:g} m, theta = {one_theta:g} deg must be finite numbers"
            )
        if one_r < 0:
            raise TargetError(f"target r = {one_r:g} m must not be negative")
    return polar_to_xy(np.stack([radius, np.radians(angle)], axis=-1))


def _numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} = {str(values)[:80]!r} must be numbers") from None
