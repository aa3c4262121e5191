"""aim: from a cable never seen to casts that hit their targets."""

import dataclasses
import math
import os
import pathlib
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.data.dataset import Dataset
from cablecast.data.store import CastStore
from cablecast.errors import InputError, check_count
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.motion.feasibility import ACTION_COUNT_MAX
from cablecast.pipeline.aim_casts import AimProposal, AimTrial
from cablecast.pipeline.aim_fits import FITS_FOLDER, SESSION_FOLDER, newest_fit
from cablecast.pipeline.aim_learning import CANDIDATE_COUNT, AimLearning, Learned
from cablecast.pipeline.aim_session import TRIES, WITHIN_PCT, AimSession
from cablecast.pipeline.collect import collect
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.tuning.tuned import Tuned

CALIBRATION_COUNT = 5
"""Casts that the simulator is fitted to before the first aimed one."""
SIMULATED_COUNT = 16_000
"""Simulated casts that the model learns from."""
EPOCHS = 60

CALIBRATION_FOLDER = "calibration"

ProposalCallback = Callable[[AimProposal], None]
TrialCallback = Callable[[AimProposal, AimTrial], None]
RefitCallback = Callable[[AimSession, str], None]


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
    fit_all: bool = False,
    calibration_count: int = CALIBRATION_COUNT,
    count: int = SIMULATED_COUNT,
    epochs: int = EPOCHS,
    candidate_count: int = CANDIDATE_COUNT,
    within_pct: float = WITHIN_PCT,
    tries: int = TRIES,
    seed: int = 0,
    device: str = "cpu",
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = ignore,
) -> AimSession:
    """Make a few casts, fit the simulator to them, learn from it, and open a session.

    Args:
        rig: Rig that `make_rig` returned; gives the set-up.
        casts: Casts on the rig that were made before; some are made where None.
        tuned: Result of `tune`, in place of a fit to the casts; without casts none are made then.
        fit_all: True to fit the simulator anew now to all casts that the session in `out` has, and
            to learn anew from it. Later calls for the same folder go on with the newest such fit.
        calibration_count: Casts to make where none were given. With 0 the session aims at once
            with what is believed of the cable, and the simulator is fitted to its first casts.
        count: Simulated casts that the model learns from.
        epochs: Largest number of passes over them.
        candidate_count: Motions to choose from.
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
    place = None if out is None else pathlib.Path(out)
    learning = AimLearning(
        setup=rig.setup,
        count=count,
        epochs=epochs,
        candidate_count=candidate_count,
        seed=seed,
        device=device,
        folder=place,
    )
    learned = _later(learning, fit_all, progress)
    if learned is not None:
        casts = None
    else:
        if casts is None and tuned is None:
            casts = _calibrated(learning, rig, calibration_count, progress)
        learned = learning.learned(casts, tuned, progress)
    session = AimSession(
        learned.policy,
        casts=casts,
        tuned=learned.tuned,
        fitted_count=learned.fitted_count,
        out=None if place is None else place / SESSION_FOLDER,
        within_pct=within_pct,
        tries=tries,
        learning=learning,
    )
    session.look(rig)
    return session


def _calibrated(
    learning: AimLearning, rig: CheckedRig, count: int, progress: ProgressCallback
) -> Dataset | None:
    """Return casts to fit the simulator to; None where none are asked for. See `prepare_aim`."""
    from cablecast.engines.warp_.rollout import compile_ahead
    from cablecast.engines.warp_.world import Features

    check_count("calibration_count", count, 0, ACTION_COUNT_MAX)
    if count == 1:
        raise InputError("calibration_count is 1: a fit takes at least 2 casts; 0 begins without")
    if not count:
        return None
    progress(Progress(task=f"1/4 {count} casts to fit the simulator to"))
    # For the fit, whose materials a kernel of their own plays.
    compile_ahead(Features(remembers=True, surface=True))
    out = None if learning.folder is None else learning.folder / CALIBRATION_FOLDER
    return collect(
        rig, count=count, sampling="spread", seed=learning.seed, out=out, progress=progress
    )


def _later(learning: AimLearning, fit_all: bool, progress: ProgressCallback) -> Learned | None:
    """Return what a fit to all casts of a session taught; None for the one to its first casts.

    Args:
        learning: Settings, with the folder of the session.
        fit_all: True for a fit to all casts that the session has by now, False for the newest one
            that is finished.
        progress: Told how far each step is.

    Raises:
        InputError: There are no casts yet to fit the simulator to, or fewer than the fit had.
    """
    folder = learning.folder
    newest = 0 if folder is None else newest_fit(folder)
    if not (fit_all or newest):
        return None
    if folder is None or not (folder / SESSION_FOLDER).exists():
        raise InputError("fitting to all casts needs the folder of a session that has some")
    store = CastStore(learning.setup, folder / SESSION_FOLDER)
    if newest > len(store):
        raise InputError(
            f"{folder / FITS_FOLDER} has a fit to {newest} casts, but the session has {len(store)}"
        )
    if not fit_all:
        return learning.kept(newest, progress)
    if not len(store):
        raise InputError("fitting to all casts needs the folder of a session that has some")
    return learning.learned_anew(store.dataset(), len(store), progress)


def aim(
    session: AimSession | ForwardSearchPolicy,
    rig: CheckedRig,
    target_xy: ArrayLike | None = None,
    *,
    r: ArrayLike | None = None,
    theta_deg: ArrayLike | None = None,
    refit: bool = True,
    on_proposal: ProposalCallback | None = None,
    on_trial: TrialCallback | None = None,
    on_refit: RefitCallback | None = None,
    progress: ProgressCallback = ignore,
) -> AimResult:
    """Cast at targets one after another, each until it is hit or all tries are used.

    A target that the session has cast at before goes on where it stopped. Before a new target the
    simulator is fitted anew to all casts where `AimSession.refit_reason` says that it is worth it.

    Args:
        session: Session that `prepare_aim` returned, or a policy of simulated casts alone.
        rig: Rig that `make_rig` returned, with the set-up of the session.
        target_xy: Targets [m], shape [2] or [target, 2]; or else r and theta_deg.
        r: Distances from the robot's base [m], a number or shape [target].
        theta_deg: Angles from straight ahead, positive to the robot's right [deg], a number or
            shape [target].
        refit: False to keep the model that the session has.
        on_proposal: Called with every cast before it is made.
        on_trial: Called with every cast after it was made.
        on_refit: Called with the session and the reason of a new fit that is due, in place of
            `session.refit(progress)`.
        progress: Told how many targets are done, and how far a new fit is.

    Returns:
        The casts at every target.

    Raises:
        TargetError: A target is not finite, out of reach, or off the table.
        RigError: A cast failed too often. Earlier casts are kept.
    """
    session = session if isinstance(session, AimSession) else AimSession(session)
    targets = session.setup.workspace.check_targets(
        target_xy, r=r, theta_deg=theta_deg, cable_length=session.setup.cable.length
    )
    for done, target in enumerate(targets):
        # Never between the tries at a target: a correction relies on the model of the last try.
        reason = "" if not refit or session.trials_at(target) else session.refit_reason
        if reason and on_refit is not None:
            on_refit(session, reason)
        elif reason:
            progress(Progress(task="A new fit to all casts", note=reason))
            session.refit(progress)
        while not session.is_done(target):
            proposal = session.propose(target)
            if on_proposal is not None:
                on_proposal(proposal)
            trial = session.cast(rig, proposal)
            if on_trial is not None:
                on_trial(proposal, trial)
        progress(Progress(task="Aiming", done=done + 1, total=len(targets), unit="targets"))
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
