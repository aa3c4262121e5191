"""Carry out a policy's actions on a rig, and measure how far from its targets the cable landed."""

import dataclasses
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.errors import InputError, RigError
from cablecast.evaluation.kept_trials import KeptTrials
from cablecast.evaluation.metrics import ErrorSummary, summarise_errors, target_error_pct
from cablecast.motion.action import Action, MotionConfig
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.rigs.base import Rig, check_track, run_trials
from cablecast.track import EndpointTrack, TrialStatus
from cablecast.workspace import Workspace


class PlanLike(Protocol):
    """What a policy answers for some targets; `Plan` of the forward search is one.

    A plan of motions that no action describes also has `trajectories`, one per target; its actions
    are NaN then.
    """

    @property
    def actions(self) -> NDArray[np.float64]:
        """Columns theta1, theta2 [rad], r2 [m], psi [rad], shape [target, 4]."""
        ...

    @property
    def predicted_xy(self) -> NDArray[np.float64]:
        """Where the model says they land [m], shape [target, 2]."""
        ...

    @property
    def inside_coverage(self) -> NDArray[np.bool_]:
        """Whether simulated casts land at the target, shape [target]."""
        ...


class Policy(Protocol):
    """What is evaluated: anything that turns targets into actions."""

    def plan(self, target_xy: ArrayLike, /) -> PlanLike:
        """Actions for targets [m], shape [target, 2]."""
        ...


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """One cast at one target.

    Attributes:
        target_index: Which target, from 0.
        repeat: Which cast at this target, from 0.
        target_xy: Where the endpoint should come to rest [m], shape [2].
        action: What was done; None for a motion that is no action.
        predicted_xy: Where the model expected the endpoint [m], shape [2].
        track: What the rig saw.
        trajectory: The motion that was executed.
        inside_coverage: Whether the target lies where simulated casts landed.
    """

    target_index: int
    repeat: int
    target_xy: NDArray[np.float64]
    action: Action | None
    predicted_xy: NDArray[np.float64]
    track: EndpointTrack
    trajectory: Trajectory
    inside_coverage: bool

    @property
    def status(self) -> TrialStatus:
        """How the trial ended."""
        return self.track.status

    @property
    def landed_xy(self) -> NDArray[np.float64]:
        """Where the endpoint came to rest [m], NaN unless the status is OK, shape [2]."""
        return self.track.final_xy


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evaluation:
    """All trials of one policy on one rig.

    Attributes:
        cable: The cable that was cast.
        rig: What the rig says of itself.
        target_xy: The targets [m], shape [target, 2].
        inside_coverage: Which of them lie where simulated casts landed, shape [target].
        trials: The casts, target by target.
    """

    cable: Cable
    rig: dict
    target_xy: NDArray[np.float64]
    inside_coverage: NDArray[np.bool_]
    trials: tuple[Trial, ...]

    @property
    def landed_xy(self) -> NDArray[np.float64]:
        """Where each cast came to rest [m], NaN unless its status is OK, shape [trial, 2]."""
        return np.array([trial.landed_xy for trial in self.trials]).reshape(-1, 2)

    @property
    def errors_pct(self) -> NDArray[np.float64]:
        """Distance from target to landing [% of cable length], NaN unless OK, shape [trial]."""
        return target_error_pct(
            self.landed_xy, [trial.target_xy for trial in self.trials], self.cable.length
        )

    @property
    def planned_errors_pct(self) -> NDArray[np.float64]:
        """Distance from target to predicted endpoint [% of cable length], shape [trial]."""
        return target_error_pct(
            [trial.predicted_xy for trial in self.trials],
            [trial.target_xy for trial in self.trials],
            self.cable.length,
        )

    @property
    def prediction_errors_pct(self) -> NDArray[np.float64]:
        """Distance from predicted endpoint to landing [% of cable length], shape [trial]."""
        return target_error_pct(
            self.landed_xy, [trial.predicted_xy for trial in self.trials], self.cable.length
        )

    @property
    def status_counts(self) -> dict[TrialStatus, int]:
        """How many trials ended in each way."""
        statuses = [trial.status for trial in self.trials]
        return {status: statuses.count(status) for status in TrialStatus}

    @property
    def summary(self) -> ErrorSummary:
        """Errors as the paper's tables give them (section VI): those not OK are left out."""
        return summarise_errors(self.errors_pct)

    @property
    def summary_misses_counted(self) -> ErrorSummary:
        """Errors with every trial that is not OK counted as a miss of unknown, large size."""
        return summarise_errors(np.nan_to_num(self.errors_pct, nan=np.inf))

    @property
    def summary_inside_coverage(self) -> ErrorSummary:
        """Errors of the trials whose target lies inside the simulated coverage."""
        inside = np.array([trial.inside_coverage for trial in self.trials])
        return summarise_errors(np.where(inside, self.errors_pct, np.nan))


def evaluate_policy(
    policy: Policy,
    rig: Rig,
    targets: ArrayLike,
    cable: Cable,
    config: MotionConfig,
    workspace: Workspace,
    *,
    repeats: int = 1,
    kept: KeptTrials | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Evaluation:
    """Cast at every target and collect what happened.

    Each cast starts from a reset of its own; see `run_trials`. The rig is not closed.

    Args:
        policy: Chooses the actions.
        rig: Carries them out.
        targets: Where the endpoint should come to rest [m], shape [target, 2].
        cable: Gives the length that errors are measured in.
        config: Motion settings that the policy's actions are meant for.
        workspace: Table and reach.
        repeats: How many casts at each target; the paper makes five.
        kept: Where each cast is stored when it is done, and where those of an earlier run of the
            same evaluation are found; nowhere where None.
        progress: Called with the number of casts done and of all, at the start and as it grows.

    Raises:
        TargetError: A target that cannot be asked for.
        RigError: The rig failed.
    """
    if repeats < 1:
        raise InputError(f"repeats = {repeats}: it must be at least 1")
    target_xy = np.atleast_2d(workspace.check_target(targets, cable.length))
    plan = policy.plan(target_xy)
    inside = np.asarray(plan.inside_coverage, dtype=bool)
    trajectories = getattr(plan, "trajectories", None)
    if trajectories is None:
        actions = [Action.from_array(row) for row in plan.actions]
        trajectories = [plan_trajectory(action, config, workspace) for action in actions]

    order = [(target, repeat) for target in range(len(target_xy)) for repeat in range(repeats)]
    total = len(order)
    if progress:
        progress(0, total)
    run = run_trials if kept is None else kept.run
    tracks = run(
        rig,
        [trajectories[target] for target, _ in order],
        (lambda done: progress(done, total)) if progress else None,
    )
    if len(tracks) != total:
        raise RigError(f"the rig returned {len(tracks)} tracks for {total} motions")
    trials = tuple(
        Trial(
            target_index=target,
            repeat=repeat,
            target_xy=target_xy[target],
            action=trajectories[target].action,
            predicted_xy=np.asarray(plan.predicted_xy[target], dtype=float),
            track=check_track(track),
            trajectory=trajectories[target],
            inside_coverage=bool(inside[target]),
        )
        for (target, repeat), track in zip(order, tracks, strict=True)
    )
    return Evaluation(
        cable=cable,
        rig=dict(rig.description),
        target_xy=target_xy,
        inside_coverage=inside,
        trials=trials,
    )
