"""AimSession: targets, casts at them, and what each cast teaches, step by step."""

import contextlib
import copy
import dataclasses
import itertools
import os
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.aiming.choice import AimedCast, Aimer
from cablecast.camera.settings import CameraSight
from cablecast.cast import EndpointTrack
from cablecast.data.dataset import Dataset
from cablecast.data.record import trial_values
from cablecast.data.store import CastStore, StoredCast
from cablecast.errors import InputError, RigError, check_count, check_number
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.motion.action import Action
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.pipeline.aim_beliefs import make_beliefs
from cablecast.pipeline.aim_casts import SAME_TARGET, AimProposal, AimTrial, law_after, target_of
from cablecast.pipeline.aim_fits import refit_reason
from cablecast.pipeline.aim_learning import AimLearning, Learned
from cablecast.pipeline.aim_lessons import Lessons
from cablecast.pipeline.aim_words import BLIND_NOTE, DRIFT_NOTE, change_text, reason_text
from cablecast.rigs.checked import CheckedRig, TrialFailedError, attempt_trial
from cablecast.runs.progress import ProgressCallback, ignore
from cablecast.setup import Setup
from cablecast.tuning.tuned import Tuned

WITHIN_PCT = 3.0
"""Distance from the target at which a cast has hit [% of cable length]."""

TRIES = 6
"""Casts at one target at most."""

# Growth of the number of casts after which the scales of the process are fitted anew.
_REFIT_GROWTH = 1.3


class AimSession:
    """Aims at targets one after another, and learns from every cast.

    ```
    proposal = session.propose(r=1.10, theta_deg=16.7)
    trial = session.cast(rig, proposal)
    ```

    A robot that is driven by something else plays `proposal.trajectory` and hands what it saw to
    `session.observe(proposal, track)`. Each cast is kept before the call returns. A session that is
    opened again in the same folder knows all of its casts.

    Args:
        policy: Policy of simulated casts alone, as `train(simulated)` returns it.
        casts: Casts on the rig to begin with.
        tuned: Fit of the simulator to some of them; says how far off the first casts may be.
            Without it they are stated as for a simulator that follows some casts as usual; give
            `Tuned.believed(setup)` for one that was fitted to none.
        fitted_count: Casts of the session, from the first on, that the simulator was fitted to;
            those of the dataset that `tuned` came from where None.
        out: Folder that keeps the casts; none where None.
        within_pct: Distance from a target at which a cast has hit [% of cable length].
        tries: Casts at one target at most.
        learning: Settings that the model was learned with, for a new fit to all casts;
            `prepare_aim` gives them.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        store: All casts.
        aimer: What chooses the casts and learns from them.
        sight: Limits of the sight of the rig's camera; None while they are unknown.

    Raises:
        InputError: The policy has learned from real casts, a value is out of bounds, or the folder
            holds something else.
    """

    def __init__(
        self,
        policy: ForwardSearchPolicy,
        *,
        casts: Dataset | None = None,
        tuned: Tuned | None = None,
        fitted_count: int | None = None,
        out: str | os.PathLike[str] | None = None,
        within_pct: float = WITHIN_PCT,
        tries: int = TRIES,
        learning: AimLearning | None = None,
    ):
        learned = Learned(policy=policy, tuned=tuned, fitted_count=fitted_count)
        self.setup: Setup = policy.setup
        self.within_pct = check_number("within_pct", within_pct, 0.01, 100.0, "%")
        self.tries = check_count("tries", tries, 1, 1000)
        self.store = CastStore(self.setup, out)
        if casts is not None:
            self.store.add_dataset(casts)
        self._trials = [self._trial(number, cast) for number, cast in enumerate(self.store.casts)]
        self._learning, self._left_out = learning, frozenset[int]()
        self.sight: CameraSight | None = None
        self._lessons = Lessons(self.store)
        self.take_up(learned)

    def take_up(self, learned: Learned) -> None:
        """Plan with another model from now on, and learn anew from all casts with it.

        Args:
            learned: Model and fit, as `learn_anew` returns them.
        """
        policy, tuned = learned.policy, learned.tuned
        beliefs = make_beliefs(tuned)
        self._fit_count = learned.fitted_count
        self._tuned_to = "" if tuned is None else str(tuned.metrics.get("dataset_fingerprint", ""))
        self.aimer = Aimer(policy, beliefs.scales, beliefs.size, beliefs.ensemble)
        self.relearn(self._left_out)

    def refit(self, progress: ProgressCallback = ignore) -> None:
        """Fit the simulator to all casts, learn anew from it, and plan with it from now on.

        Takes as long as the first fit. A fit that was stopped goes on where it was when this is
        called again before the next cast.

        Args:
            progress: Told how far each step is.

        Raises:
            InputError: The session was not prepared by `prepare_aim`, or has too few casts.
        """
        self.take_up(self.learn_anew(progress))

    def learn_anew(self, progress: ProgressCallback = ignore) -> Learned:
        """Return what `take_up` asks for, from a fit to all casts; the session stays as it is.

        Args:
            progress: Told how far each step is.

        Raises:
            InputError: The session was not prepared by `prepare_aim`, or has too few casts.
        """
        if self._learning is None:
            raise InputError("only a session that prepare_aim returned can be fitted anew")
        every = CastStore(self.setup)
        every.casts = [c for row, c in enumerate(self.store.casts) if row not in self._left_out]
        return self._learning.learned_anew(every.dataset(), len(self.store), progress)

    @property
    def refit_reason(self) -> str:
        """Why the simulator should be fitted to all casts now; empty where it need not be."""
        waits, fitted = self._fit_count == 0, self.fitted_count
        return "" if self._learning is None else refit_reason(self._trials, fitted, waits=waits)

    def relearn(self, without: Collection[int] = ()) -> None:
        """Learn anew from all casts, in the order and the groups in which they were made.

        So a session that is opened again goes on as if it had never been closed.

        Args:
            without: Numbers of casts to leave out, such as those that went wrong; a new fit leaves
                them out, too.
        """
        self._left_out = frozenset(without)
        self.aimer = self.aimer.emptied()
        self._scaled_count = 0
        for is_aimed, group in itertools.groupby(
            enumerate(self.store.casts), lambda row: bool(np.isfinite(target_of(row[1])).all())
        ):
            # Casts for something else came together, aimed ones one by one.
            rows = list(group)
            for part in [[row] for row in rows] if is_aimed else [rows]:
                kept = [row for row in part if row[0] not in without]
                self._learn(kept, part[-1][0] + 1, always=not is_aimed)

    def _learn(
        self, casts: Sequence[tuple[int, StoredCast]], count: int, *, always: bool = False
    ) -> None:
        """Learn from casts, and fit the scales of the process where there are enough new ones.

        Args:
            casts: Casts that were made together, with their numbers.
            count: Number of casts of the session with them.
            always: True to fit the scales whatever the number of casts.
        """
        # The scales change slowly: fitting them at each cast would be wasted.
        refit = always or count >= _REFIT_GROWTH * self._scaled_count
        known = [
            AimedCast(
                action=cast.action,
                endpoint_xy=cast.endpoint_xy,
                fitted=self._was_fitted(number, cast),
                target_xy=target_of(cast),
            )
            for number, cast in casts
            if np.all(np.isfinite(cast.action))
        ]
        self.aimer.learn(known, refit=refit)
        if refit:
            self._scaled_count = count

    @property
    def fitted_count(self) -> int:
        """Number of casts of the session that the simulator was fitted to."""
        return sum(self._was_fitted(*row) for row in enumerate(self.store.casts))

    def _was_fitted(self, number: int, cast: StoredCast) -> bool:
        """Return whether the simulator was fitted to a cast."""
        if self._fit_count is not None:
            return number < self._fit_count
        return bool(self._tuned_to) and cast.origin.partition("/")[0] == self._tuned_to

    def add_casts(self, casts: Dataset) -> int:
        """Learn from casts of this cable that were made for something else.

        Args:
            casts: Casts on a rig, with the set-up of the session. Those that it knows are left out.

        Returns:
            The number of casts that are new.

        Raises:
            InputError: The casts were simulated, or made with another set-up.
        """
        known = len(self.store)
        self.store.add_dataset(casts)
        new = list(enumerate(self.store.casts))[known:]
        self._trials += [self._trial(number, cast) for number, cast in new]
        self._learn(new, len(self.store), always=True)
        return len(new)

    def fork(self) -> "AimSession":
        """Return a session that knows the same casts and keeps none of its own on the disk."""
        other = copy.copy(self)
        other.store = CastStore(self.setup)
        other.store.casts = list(self.store.casts)
        other.aimer, other._lessons = self.aimer.copy(), Lessons(other.store)
        other._trials = list(self._trials)
        if self._learning is not None:
            other._learning = dataclasses.replace(self._learning, folder=None)
        return other

    @property
    def history(self) -> tuple[AimTrial, ...]:
        """All casts, in the order in which they were made."""
        return tuple(self._trials)

    def trials_at(self, target_xy: ArrayLike) -> list[AimTrial]:
        """Return the casts at one target.

        Args:
            target_xy: Target [m], shape [2].
        """
        target = np.asarray(target_xy, dtype=float)
        return [t for t in self._trials if np.linalg.norm(t.target_xy - target) < SAME_TARGET]

    def is_done(self, target_xy: ArrayLike) -> bool:
        """Return whether a target [m], shape [2], was hit, or all tries at it are used."""
        trials = self.trials_at(target_xy)
        return len(trials) >= self.tries or any(trial.hit for trial in trials)

    def propose(
        self,
        target_xy: ArrayLike | None = None,
        *,
        r: float | None = None,
        theta_deg: float | None = None,
    ) -> AimProposal:
        """Plan the next cast at a target, and say what to expect of it.

        Args:
            target_xy: Target [m], shape [2]; or else r and theta_deg.
            r: Distance from the robot's base [m].
            theta_deg: Angle from straight ahead, positive to the robot's right [deg].

        Raises:
            TargetError: The target is not finite, out of reach, or off the table.
        """
        targets = self.setup.workspace.check_targets(
            target_xy, r=r, theta_deg=theta_deg, cable_length=self.setup.cable.length
        )
        if len(targets) != 1:
            raise InputError(f"a proposal has one target, not {len(targets)}")
        earlier = self.trials_at(targets[0])
        aimer = self._aimer_at(targets[0])
        choice = aimer.choose(targets[0], tried=bool(earlier), sight=self.sight)
        action = Action.from_array(choice.action)
        reason = reason_text(choice.action, earlier, len(self.store))
        if self.sight is not None and self.sight.is_blind_at(targets[0]):
            reason += BLIND_NOTE
        law = law_after(self._trials)
        return AimProposal(
            number=len(self._trials),
            try_number=len(earlier) + 1,
            target_xy=choice.target_xy,
            action=action,
            trajectory=plan_trajectory(action, self.setup),
            expected_xy=choice.expected_xy,
            covariance=law.scale * choice.covariance,
            law=law,
            scatter=choice.scatter,
            failure=choice.failure,
            inside_coverage=choice.inside_coverage,
            cable_length=self.setup.cable.length,
            reason=reason,
        )

    def _aimer_at(self, target_xy: NDArray[np.float64]) -> Aimer:
        """Return an aimer whose simulators learned from new casts near a target."""
        trials = [
            trial
            for trial, cast in zip(self._trials, self.store.casts, strict=True)
            if trial.number not in self._left_out and not self._was_fitted(trial.number, cast)
        ]
        return self._lessons.aimer_at(target_xy, self.aimer, trials)

    def cast(self, rig: CheckedRig, proposal: AimProposal) -> AimTrial:
        """Make a proposed cast on a rig, and learn from it.

        Args:
            rig: Rig that `make_rig` returned, with the set-up of the session.
            proposal: Cast that `propose` returned.

        Raises:
            RigError: The cast failed too often.
            InputError: The proposal is not the next cast of the session.
        """
        self._check_next(proposal)
        return self.observe(proposal, self.play(rig, proposal.trajectory, proposal.number))

    def play(self, rig: CheckedRig, motion: Trajectory, number: int) -> EndpointTrack:
        """Reset a rig and play one motion; a cast that fails is repeated.

        Args:
            rig: Rig that `make_rig` returned, with the set-up of the session.
            motion: Motion to play.
            number: Number of the cast, which a rig that draws by chance draws from.

        Raises:
            RigError: The cast failed too often.
        """
        # Robot and camera of a lab file are no part of what a session knows.
        if rig.setup.to_settings() != self.setup.to_settings():
            raise InputError("the rig has another set-up than the session")
        try:
            track, _ = attempt_trial(rig, motion, index=number, purpose="aim")
        except TrialFailedError as error:
            raise RigError(f"cast {number} {error}. Earlier casts are kept") from error
        # A cast that was made is not lost because the camera fails afterwards.
        with contextlib.suppress(RigError):
            self.look(rig)
        return track

    def look(self, rig: CheckedRig) -> None:
        """Ask a rig what its camera cannot see, and aim past it; `play` does so after each cast."""
        if hasattr(rig, "sight"):
            self.sight = rig.sight()

    def observe(self, proposal: AimProposal, track: EndpointTrack) -> AimTrial:
        """Learn from a proposed cast that was made.

        Args:
            proposal: Cast that `propose` returned.
            track: What the rig saw of it.

        Raises:
            InputError: The proposal is not the next cast of the session.
        """
        self._check_next(proposal)
        cast = StoredCast(
            purpose="aim",
            values=trial_values(proposal.trajectory, track)
            | {"nodes": None if track.nodes is None else track.nodes.ravel()},
            note=proposal.to_note(),
        )
        self.store.add(cast)
        drifts = len(self.aimer.experience.drifts)
        self._learn([(len(self._trials), cast)], len(self.store))
        self._trials.append(trial := self._trial(len(self._trials), cast))
        target = proposal.target_xy
        # Another lesson would be taken for the words alone where no cast at this target follows.
        aimer = self.aimer if self.is_done(target) else self._aimer_at(target)
        change = change_text(proposal, trial, aimer.predictor)
        if len(self.aimer.experience.drifts) > drifts:
            change += ". " + DRIFT_NOTE
        self._trials[-1] = trial = dataclasses.replace(trial, change=change)
        return trial

    def _check_next(self, proposal: AimProposal) -> None:
        if proposal.number != len(self._trials):
            raise InputError(
                f"the proposal is cast {proposal.number} of the session, whose next cast is "
                f"{len(self._trials)}: propose again, since it has learned meanwhile"
            )

    def _trial(self, number: int, cast: StoredCast) -> AimTrial:
        """Return a stored cast as a trial of the session."""
        length = self.setup.cable.length
        return AimTrial.of_cast(number, cast, cable_length=length, within_pct=self.within_pct)
