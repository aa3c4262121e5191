"""aim: from a cable never seen to casts that hit their targets."""

import dataclasses
import math
import os
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.checks import check_count, check_seed
from cablecast.datasets.reader import Dataset
from cablecast.models.many_cables import ManyCablesModel
from cablecast.motion.feasibility import ACTION_COUNT_MAX
from cablecast.pipeline import many_cables
from cablecast.pipeline.aim_casts import AimProposal, AimTrial
from cablecast.pipeline.aim_fits import SESSION_FOLDER, later_fit
from cablecast.pipeline.aim_session import TRIES, WITHIN_PCT, AimSession
from cablecast.pipeline.collect import collect
from cablecast.pipeline.places import folder_or_temporary, require
from cablecast.pipeline.simulate import simulate
from cablecast.pipeline.train import train
from cablecast.pipeline.tune import tune
from cablecast.pipeline.tuned import Tuned
from cablecast.policies.base import check_targets
from cablecast.policies.forward_search import CANDIDATE_COUNT, ForwardSearchPolicy
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.places import DATASET_FOLDER, MODEL_FOLDER, TUNE_FOLDER
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import Setup

CALIBRATION_COUNT = 5
"""Casts that the simulator is fitted to before the first aimed one."""
SIMULATED_COUNT = 16_000
"""Simulated casts that the model learns from."""
EPOCHS = 60

CALIBRATION_FOLDER = "calibration"

ProposalCallback = Callable[[AimProposal], None]
TrialCallback = Callable[[AimProposal, AimTrial], None]


@dataclasses.dataclass(frozen=True, kw_only=True)
class AimResult:
    """Casts at some targets.

    Attributes:
        session: Session, which further targets can be aimed at in.
        target_xy: Targets [m], shape [target, 2].
        trials: Casts at each target, in order.
    """

    session: AimSession
    target_xy: NDArray[np.float64]
    trials: tuple[tuple[AimTrial, ...], ...]

    @property
    def hit(self) -> NDArray[np.bool_]:
        """True for each target that was hit, shape [target]."""
        return np.array([any(trial.hit for trial in trials) for trials in self.trials])

    def misses_pct(self, try_number: int) -> NDArray[np.float64]:
        """Return the miss of one try at each target [% of cable length], shape [target].

        A target that was hit before keeps the miss of that cast. A cast without a landing is NaN.

        Args:
            try_number: Number of the try, from 1.
        """
        return np.array(
            [
                trials[min(try_number, len(trials)) - 1].miss_pct if trials else math.nan
                for trials in self.trials
            ]
        )


def prepare_aim(
    rig: CheckedRig,
    *,
    casts: Dataset | None = None,
    tuned: Tuned | None = None,
    model: ManyCablesModel | None = None,
    refine: int = 0,
    fit_all: bool = False,
    calibration_count: int = CALIBRATION_COUNT,
    count: int = SIMULATED_COUNT,
    epochs: int = EPOCHS,
    candidate_count: int | None = None,
    within_pct: float = WITHIN_PCT,
    tries: int = TRIES,
    seed: int = 0,
    device: str = "cpu",
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | None = None,
) -> AimSession:
    """Make a few casts, fit the simulator to them, learn from it, and open a session.

    Args:
        rig: Rig that `make_rig` returned; gives the set-up.
        casts: Casts on the rig that were made before; some are made where None.
        tuned: Result of `tune`, in place of a fit to the casts; without casts none are made then.
        model: Model of many cables, in place of one that is trained for this cable in minutes.
        refine: Simulated casts that the model of many cables learns from first.
        fit_all: True to fit the simulator anew to all casts that the session in `out` has, and to
            learn anew from it. Later calls for the same folder go on with the newest such fit.
        calibration_count: Casts to make where none were given.
        count: Simulated casts that the model learns from.
        epochs: Largest number of passes over them.
        candidate_count: Motions to choose from; 50,000, or 20,000 with `model`, where None.
        within_pct: Distance from a target at which a cast has hit [% of cable length].
        tries: Casts at one target at most.
        seed: Seed of everything that is drawn by chance.
        device: "cpu" or "cuda".
        out: Folder that keeps everything and lets stopped work go on; none where None.
        progress: Told how far each step is.

    Returns:
        A session that has learned from the casts.

    Raises:
        InputError: A value is out of bounds, or the folder holds something else.
        RigError: A cast failed too often.
        MissingExtraError: A library that a later step needs is missing.
    """
    require("aiming", "torch", "safetensors")
    if model is not None:
        model.check_setup(rig.setup)
    _check_counts(calibration_count, count, candidate_count)
    shared: dict[str, Any] = {"seed": check_seed(seed), "progress": progress}
    with folder_or_temporary(out) as folder:
        later = later_fit(folder, rig.setup, fit_all)
        place = folder if later is None else later.folder
        kept = None if out is None else place
        if later is not None:
            casts, tuned = None, _fitted(later.casts, kept, device, progress, holds_out=False)
        if tuned is None:
            if casts is None:
                casts = _calibrated(rig, calibration_count, folder, shared)
            tuned = _fitted(casts, kept, device, progress)
        usual = CANDIDATE_COUNT if model is None else many_cables.CANDIDATE_COUNT
        search = {"candidate_count": candidate_count or usual, **shared}
        search["out"] = None if kept is None else kept / MODEL_FOLDER
        if model is None:
            policy = _trained_policy(rig.setup, tuned, place, count, epochs, device, search)
        else:
            known = Tuned.of(tuned, rig.setup)
            policy = many_cables.policy_for_cable(model, known, rig.setup, refine=refine, **search)
        return AimSession(
            policy,
            casts=casts,
            tuned=tuned,
            fitted_count=None if later is None else later.count,
            out=None if out is None else folder / SESSION_FOLDER,
            within_pct=within_pct,
            tries=tries,
        )


def _check_counts(calibration_count: int, count: int, candidate_count: int | None) -> None:
    check_count("calibration_count", calibration_count, 2, ACTION_COUNT_MAX)
    check_count("count", count, 50, ACTION_COUNT_MAX)
    if candidate_count is not None:
        check_count("candidate_count", candidate_count, 1, ACTION_COUNT_MAX)


def _calibrated(
    rig: CheckedRig, count: int, folder: pathlib.Path, shared: dict[str, Any]
) -> Dataset:
    """Return casts to fit the simulator to; see `prepare_aim`."""
    text = f"1/4 {count} casts to fit the simulator to"
    (shared["progress"] or ignore)(Progress(task=text))
    return collect(rig, count=count, out=folder / CALIBRATION_FOLDER, **shared)


def _fitted(
    casts: Dataset,
    folder: pathlib.Path | None,
    device: str,
    progress: ProgressCallback | None,
    *,
    holds_out: bool = True,
) -> Tuned:
    """Return the fit to some casts; see `prepare_aim`."""
    (progress or ignore)(Progress(task=f"2/4 fit to {len(casts)} casts"))
    path = None if folder is None else folder / TUNE_FOLDER
    held_out = None if holds_out else 0
    return tune(casts, validation_count=held_out, device=device, out=path, progress=progress)


def _trained_policy(
    setup: Setup,
    tuned: Tuned | None,
    folder: pathlib.Path,
    count: int,
    epochs: int,
    device: str,
    search: dict[str, Any],
) -> ForwardSearchPolicy:
    """Return a policy that has learned from simulated casts of this cable; see `prepare_aim`."""
    shared = {"seed": search["seed"], "progress": search["progress"], "device": device}
    report = search["progress"] or ignore
    report(Progress(task="3/4 simulate"))
    simulated = simulate(setup, tuned, count=count, out=folder / DATASET_FOLDER, **shared)
    report(Progress(task="4/4 train"))
    return train(simulated, epochs=epochs, device=device, **search)


def aim(
    session: AimSession | ForwardSearchPolicy,
    rig: CheckedRig,
    target_xy: ArrayLike | None = None,
    *,
    r: ArrayLike | None = None,
    theta_deg: ArrayLike | None = None,
    on_proposal: ProposalCallback | None = None,
    on_trial: TrialCallback | None = None,
    progress: ProgressCallback | None = None,
) -> AimResult:
    """Cast at targets one after another, each until it is hit or all tries are used.

    A target that the session has cast at before goes on where it stopped.

    Args:
        session: Session that `prepare_aim` returned, or a policy of simulated casts alone.
        rig: Rig that `make_rig` returned, with the set-up of the session.
        target_xy: Targets [m], shape [2] or [target, 2]; or else r and theta_deg.
        r: Distances from the robot's base [m], a number or shape [target].
        theta_deg: Angles from straight ahead, positive to the robot's right [deg], a number or
            shape [target].
        on_proposal: Called with every cast before it is made.
        on_trial: Called with every cast after it was made.
        progress: Told how many targets are done.

    Returns:
        The casts at every target.

    Raises:
        TargetError: A target is not finite, out of reach, or off the table.
        RigError: A cast failed too often. Earlier casts are kept.
    """
    session = session if isinstance(session, AimSession) else AimSession(session)
    targets = check_targets(session.setup, target_xy, r=r, theta_deg=theta_deg)
    report = progress or ignore
    for done, target in enumerate(targets):
        while not session.is_done(target):
            proposal = session.propose(target)
            if on_proposal is not None:
                on_proposal(proposal)
            trial = session.cast(rig, proposal)
            if on_trial is not None:
                on_trial(proposal, trial)
        report(Progress(task="Aiming", done=done + 1, total=len(targets), unit="targets"))
    return AimResult(
        session=session,
        target_xy=targets,
        trials=tuple(tuple(session.trials_at(target)) for target in targets),
    )


def ellipse_points(proposal: AimProposal, share: float, count: int = 72) -> NDArray[np.float64]:
    """Return the outline of a proposal's ellipse [m], shape [point, 2].

    Args:
        proposal: Planned cast.
        share: Probability that the landing lies inside [-].
        count: Number of points.
    """
    major, minor, angle = proposal.ellipse(share)
    turn = np.linspace(0.0, 2.0 * np.pi, count)
    local = np.stack([major * np.cos(turn), minor * np.sin(turn)], axis=-1)
    c, s = np.cos(angle), np.sin(angle)
    return proposal.expected_xy + local @ np.array([[c, s], [-s, c]])
