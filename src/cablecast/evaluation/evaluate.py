"""Evaluation of a policy on a rig: distances from the targets to the landings."""

import dataclasses
import pathlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.checks import check_count
from cablecast.datasets.record import TrialPlan, record_trials
from cablecast.datasets.trials import trial_track
from cablecast.evaluation.metrics import ErrorSummary, summarise_errors, target_error_pct
from cablecast.motion.action import Action
from cablecast.motion.trajectory import Trajectory
from cablecast.policies.base import Policy
from cablecast.rigs.attempts import ATTEMPT_COUNT
from cablecast.rigs.base import Rig
from cablecast.runs.progress import CountCallback
from cablecast.setup import Setup
from cablecast.track import EndpointTrack, TrialStatus


@dataclasses.dataclass(frozen=True, kw_only=True)
class TargetCast:
    """One cast at one target.

    Attributes:
        target_index: Index of the target, from 0.
        repeat: Index of the cast at this target, from 0.
        target_xy: Target of the endpoint [m], shape [2].
        action: Executed action; None for a motion without an action.
        predicted_xy: Predicted resting point of the endpoint [m], shape [2].
        track: Track measured by the rig.
        trajectory: Executed motion.
        inside_coverage: Whether the target lies inside the simulated coverage.
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
        """End of the trial."""
        return self.track.status

    @property
    def landed_xy(self) -> NDArray[np.float64]:
        """Point where the endpoint came to rest [m], NaN unless the status is OK, shape [2]."""
        return self.track.final_xy


@dataclasses.dataclass(frozen=True, kw_only=True)
class Evaluation:
    """All casts of one policy on one rig.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        rig: Description of the rig.
        target_xy: Targets [m], shape [target, 2].
        inside_coverage: Whether each target lies inside the simulated coverage, shape [target].
        trials: Casts, target by target.
        fingerprint: Fingerprint of the casts.
        metrics: Metrics of the evaluation, as stored in metrics.json.
    """

    setup: Setup
    rig: dict[str, Any]
    target_xy: NDArray[np.float64]
    inside_coverage: NDArray[np.bool_]
    trials: tuple[TargetCast, ...]
    fingerprint: str = ""
    metrics: dict[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def cable(self) -> Cable:
        """Cable that was cast."""
        return self.setup.cable

    @property
    def landed_xy(self) -> NDArray[np.float64]:
        """Resting point of each cast [m], NaN unless its status is OK, shape [trial, 2]."""
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
        """Number of casts by status."""
        statuses = [trial.status for trial in self.trials]
        return {status: statuses.count(status) for status in TrialStatus}

    @property
    def summary(self) -> ErrorSummary:
        """Error summary as in the paper's tables (section VI): casts not OK are left out."""
        return summarise_errors(self.errors_pct)

    @property
    def summary_misses_counted(self) -> ErrorSummary:
        """Error summary that counts every cast not OK as a miss of unknown, large size."""
        return summarise_errors(np.nan_to_num(self.errors_pct, nan=np.inf))

    @property
    def summary_inside_coverage(self) -> ErrorSummary:
        """Error summary of the casts whose target lies inside the simulated coverage."""
        inside = np.array([trial.inside_coverage for trial in self.trials])
        return summarise_errors(np.where(inside, self.errors_pct, np.nan))


def evaluate_policy(
    path: str | pathlib.Path,
    policy: Policy,
    rig: Rig,
    targets: ArrayLike,
    *,
    repeats: int = 1,
    attempts: int = ATTEMPT_COUNT,
    progress: CountCallback | None = None,
) -> Evaluation:
    """Cast at every target and collect the results.

    Casts are stored as they are made. An interrupted evaluation resumes; see `record_trials`. The
    rig is not closed.

    Args:
        path: Folder of the casts.
        policy: Policy that plans the motions.
        rig: Rig that executes the motions.
        targets: Targets of the endpoint [m], shape [target, 2].
        repeats: Number of casts at each target; five in the paper.
        attempts: Number of attempts at a cast before the evaluation stops.
        progress: Called with the numbers of finished and of all casts, at the start and after each.

    Raises:
        TargetError: A target is not finite, out of reach, or off the table.
        RigError: A cast failed too often.
        DatasetError: The folder holds other casts.
    """
    check_count("repeats", repeats, high=100_000)
    setup = policy.setup
    target_xy = np.atleast_2d(setup.workspace.check_target(targets, setup.cable.length))
    plan = policy.plan(target_xy)
    motions = plan.trajectories
    inside = np.asarray(plan.inside_coverage, dtype=bool)
    trials = TrialPlan(
        setup=setup,
        kind="evaluate",
        count=len(target_xy),
        motion=lambda number: motions[number],
        repeats=repeats,
        attempts=attempts,
        keep_nodes=True,
    )
    settings = {
        "targets": target_xy.tolist(),
        "policy": policy.info,
        "durations": [round(motion.duration, 9) for motion in motions],
    }
    dataset = record_trials(path, rig, trials, settings, progress)
    casts = tuple(
        TargetCast(
            target_index=row // repeats,
            repeat=row % repeats,
            target_xy=target_xy[row // repeats],
            action=motions[row // repeats].action,
            predicted_xy=np.asarray(plan.predicted_xy[row // repeats], dtype=float),
            track=trial_track(dataset, row),
            trajectory=motions[row // repeats],
            inside_coverage=bool(inside[row // repeats]),
        )
        for row in range(len(dataset))
    )
    return Evaluation(
        setup=setup,
        rig=dict(dataset.info["settings"]["rig"]),
        target_xy=target_xy,
        inside_coverage=inside,
        trials=casts,
        fingerprint=dataset.fingerprint,
    )
