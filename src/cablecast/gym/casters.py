"""Casters: a batch of actions on the engine, or one after the other on a rig."""

import dataclasses
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import CableParams
from cablecast.datasets.simulate import simulate_actions
from cablecast.dynamics import Dynamics
from cablecast.engines.base import Engine
from cablecast.errors import ActionError, InputError
from cablecast.motion.action import Action, check_action_values
from cablecast.motion.feasibility import check_actions
from cablecast.motion.trajectory import plan_trajectory
from cablecast.rigs.base import run_trials
from cablecast.rigs.checked import CheckedRig
from cablecast.setup import Setup
from cablecast.track import TrialStatus

INFEASIBLE = "infeasible"
"""Status of an action that is no casting motion, or that the arm cannot make."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Landings:
    """Ends of a batch of casts.

    Attributes:
        xy: Resting points [m], shape [cast, 2]; NaN where there is none.
        status: Codes of the trial statuses, or `INFEASIBLE`, shape [cast].
    """

    xy: NDArray[np.float64]
    status: NDArray[np.str_]


class Caster(Protocol):
    """Executor of the casts of an environment."""

    def cast(self, actions: NDArray[np.float64], params: CableParams) -> Landings:
        """Make a batch of casts, each from the reset state.

        Args:
            actions: (theta1, theta2, r2, psi), shape [cast, 4].
            params: Parameters of the cables, one value per cast.
        """
        ...

    def close(self) -> None:
        """Let go of the rig."""
        ...


class EngineCaster:
    """Casts a batch as one rollout of an engine.

    Args:
        engine: Simulator.
        setup: Cable, workspace, arm and motion settings.
        dynamics: Material of the cable and servo of the arm; its parameters are those of each cast.
    """

    def __init__(self, engine: Engine, setup: Setup, dynamics: Dynamics | None = None):
        self.engine, self.setup = engine, setup
        self.dynamics = Dynamics.of(dynamics, setup)

    def cast(self, actions: NDArray[np.float64], params: CableParams) -> Landings:
        """Simulate a batch of casts; see `Caster.cast`."""
        feasible = feasible_mask(actions, self.setup)
        xy = np.full((len(actions), 2), np.nan)
        status = np.full(len(actions), INFEASIBLE, dtype="<U16")
        if np.any(feasible):
            dynamics = self.dynamics.with_params(params.rows(feasible))
            columns = simulate_actions(actions[feasible], dynamics, self.setup, self.engine)
            xy[feasible] = np.stack([columns["endpoint_x"], columns["endpoint_y"]], axis=-1)
            status[feasible] = columns["status"]
        return Landings(xy=xy, status=status)

    def close(self) -> None:
        """Do nothing: an engine holds nothing."""


class RigCaster:
    """Casts on a rig, with the one cable that it holds.

    Args:
        rig: Rig that `make_rig` returned.
    """

    def __init__(self, rig: CheckedRig):
        self.rig, self.setup = rig, rig.setup

    def cast(self, actions: NDArray[np.float64], params: CableParams) -> Landings:
        """Make casts one after the other, or at once where the rig can; see `Caster.cast`."""
        del params
        feasible = feasible_mask(actions, self.setup)
        xy = np.full((len(actions), 2), np.nan)
        status = np.full(len(actions), INFEASIBLE, dtype="<U16")
        motions = [
            plan_trajectory(Action.from_array(action), self.setup) for action in actions[feasible]
        ]
        tracks = run_trials(self.rig, motions) if motions else []
        for row, track in zip(np.flatnonzero(feasible), tracks, strict=True):
            status[row] = track.status.code
            if track.status is TrialStatus.OK:
                xy[row] = track.final_xy
        return Landings(xy=xy, status=status)

    def close(self) -> None:
        """Close the rig."""
        self.rig.close()


def feasible_mask(actions: NDArray[np.float64], setup: Setup) -> NDArray[np.bool_]:
    """Return which actions are casting motions that the arm can make, shape [action].

    Args:
        actions: (theta1, theta2, r2, psi), of any finite values, shape [action, 4].
        setup: Cable, workspace, arm and motion settings.

    Raises:
        InputError: An action is not finite: a learner has diverged.
    """
    if np.any(bad := ~np.all(np.isfinite(actions), axis=1)):
        row = int(np.argmax(bad))
        raise InputError(f"action {row} = {actions[row].tolist()} is not finite")
    mask = np.array([_is_cast(action) for action in actions])
    if np.any(mask):
        mask[mask] = check_actions(actions[mask], setup, both_sides=False).mask
    return mask


def _is_cast(action: NDArray[np.float64]) -> bool:
    try:
        check_action_values(action[None])
    except ActionError:
        return False
    return True
