"""AimSession: targets, casts at them, and what follows from each landing, step by step."""

import abc
import copy
import dataclasses
import enum
import functools
import itertools
import math
import os
import warnings
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.aiming.config import AimConfig
from cablecast.aiming.predictor import Beliefs, LandingPredictor
from cablecast.aiming.propose import NEAR, propose
from cablecast.camera.settings import CameraSight
from cablecast.cast import HIT_CHANCE_MIN, Cast, EndpointTrack, Proposal
from cablecast.data.dataset import Dataset
from cablecast.data.store import CastStore
from cablecast.errors import InputError, RigError
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.rigs.checked import CheckedRig, TrialFailedError, attempt_trial
from cablecast.runs.progress import Progress, ProgressCallback, show
from cablecast.setup import Setup
from cablecast.task import Goal, MissLaw, Task
from cablecast.tuning.tracks import MeasuredTracks

LOCAL_COUNT = 8
"""Casts near a target that the simulators take a step towards at most: a step takes the longer, the
more there are."""

GROWTH = 3
"""Times as many casts as the simulator was fitted to, from which on a new fit is due."""

EARLY_GROWTH = 2
"""Times as many, if first tries land farther off than was stated."""

EARLY_INNOVATION, EARLY_TRIES = 2.0, 3
"""Mean normalised squared innovation (1 is expected) of so many first tries or more from which on
they land farther off than was stated. With the 5-cast fits of the virtual rig, three first tries
exceed it in 28 to 66 % of draws where a fit is poor (regions of 90 % that hold less than 75 %), and
in 1 to 11 % elsewhere."""

FIRST_COUNT = 5
"""Casts from which on the first fit is due, where a session started without one."""

ENOUGH = 40
"""Casts from which on no fit is due: more barely change the parameters."""

_INNOVATION_MAX = 4.0
# From the third cast at a goal on, one with a smaller chance to hit than this must be expected
# nearer than this share of the nearest landing's distance.
_UNLIKELY, _NEARER = 0.1, 0.75

STUCK_COUNT = 3
"""Casts in a row that come no nearer to a goal, after which no other is made at it."""

# Two misses by more than this [cable lengths], the second at least this share of the first, and in
# one direction, by the least cosine of the angle between them, were not changed by a correction.
_FAR, _NO_LESS, _ONE_WAY = 0.1, 0.75, 0.9

# Growth of the number of casts after which the scales of the process are fitted anew.
_SCALE_GROWTH = 1.3


class StopReason(enum.Enum):
    """Why a proposed cast is not worth making."""

    STUCK = enum.auto()
    """The last casts at the goal came no nearer."""
    UNLIKELY = enum.auto()
    """It is unlikely to hit, and expected to come little nearer than others."""
    IN_VAIN = enum.auto()
    """It is unlikely to hit, and corrections did not change where casts miss."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Stop:
    """A proposed cast that is not worth making.

    Attributes:
        proposal: The cast.
        reason: Why it is not.
        nearest: Outcome nearest to the goal so far, shape [k].
        is_simulated: Whether that one was simulated, since none of the casts had an outcome.
    """

    proposal: Proposal
    reason: StopReason
    nearest: NDArray[np.float64]
    is_simulated: bool


class RefitReason(enum.Enum):
    """Why the simulator should be fitted anew."""

    FIRST_FIT = enum.auto()
    """It is fitted to no cast of the session yet."""
    MORE_CASTS = enum.auto()
    """There are `GROWTH` times as many casts."""
    FAR_OFF = enum.auto()
    """First tries land farther off than was stated."""


@dataclasses.dataclass(frozen=True)
class RefitDue:
    """A new fit that is due.

    Attributes:
        reason: Why it is.
        cast_count: Active casts of the session.
        fitted_count: Number of them that the simulator is fitted to.
        size: Misses of first tries over the stated ones [-]; 0 for the other reasons.
    """

    reason: RefitReason
    cast_count: int
    fitted_count: int
    size: float = 0.0


Refitting = Callable[[CastStore, ProgressCallback], Beliefs]
"""Fits the simulator to all casts of a session that were not discarded, and simulates with it."""

LANDINGS_FILE = "landings.npz"
"""Simulated landings of the casts of a session, in its folder."""


class CastSession(abc.ABC):
    """Casts at goals of one task on one cable, kept one by one.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        task: Task of its goals.
        config: Settings.
        store: All casts, with discarded ones.
        sight: Limits of the sight of the rig's camera; None while they are unknown.
    """

    setup: Setup
    task: Task
    config: AimConfig
    store: CastStore
    sight: CameraSight | None

    @abc.abstractmethod
    def propose(self, target_xy: Goal) -> Proposal:
        """Propose the next cast at a goal, and say what to expect of it."""

    @abc.abstractmethod
    def observe(self, proposal: Proposal, track: EndpointTrack) -> Cast:
        """Take in a proposed cast that was made, and what the rig saw of it."""

    @abc.abstractmethod
    def _condition(self) -> None:
        """Know what the casts tell that were not discarded, and nothing else."""

    def stop(self, proposal: Proposal) -> Stop | None:
        """Return why a proposed cast is not worth making; None if it is."""
        return None

    @property
    def refit_due(self) -> RefitDue | None:
        """Why the simulator should be fitted to all casts now; None if it need not be."""
        return None

    def refit(self, progress: ProgressCallback = show) -> None:
        """Fit the simulator to all casts, and plan with it from now on; see `refit_due`."""
        raise InputError("this session fits by itself where it is worth it")

    def miss_laws(self) -> dict[str, MissLaw]:
        """Return the laws of outcomes about the expected ones, by the family of the motions.

        Motions of one family say nothing of how well those of another are predicted.
        """
        squares: dict[str, list[float]] = {}
        for _, cast in self.active_casts():
            if cast.proposal is not None and np.isfinite(cast.square):
                square = cast.proposal.expected.law.scale * cast.square
                squares.setdefault(cast.proposal.action.family, []).append(square)
        size = len(self.task.coordinates)
        return {family: MissLaw.after(own, size) for family, own in squares.items()}

    def goals(
        self, target_xy: ArrayLike | None = None, **forms: ArrayLike | None
    ) -> tuple[Goal, ...]:
        """Return checked goals with the tolerance of the session; see `values` of the task."""
        return self.task.goals(self.setup, target_xy, within_pct=self.config.within_pct, **forms)

    @property
    def casts(self) -> tuple[Cast, ...]:
        """All casts in the order in which they were made, with discarded ones."""
        return tuple(self.store.casts)

    @property
    def undone(self) -> frozenset[int]:
        """Numbers of the casts that were discarded."""
        return self.store.undone

    def casts_at(self, value: ArrayLike) -> list[Cast]:
        """Return the casts at one goal by its value, shape [k], without discarded ones."""
        goal = np.asarray(value, dtype=float)
        return [cast for _, cast in self.active_casts() if cast.is_at(goal)]

    def active_casts(self) -> list[tuple[int, Cast]]:
        """Return the casts that were not discarded, with their numbers."""
        return [row for row in enumerate(self.store.casts) if row[0] not in self.undone]

    def undo(self, number: int | None = None) -> Cast:
        """Discard a cast, the last aimed one by default: it is kept, and counts for nothing.

        Raises:
            InputError: There is no such cast, or it was discarded before.
        """
        if number is None:
            aimed = [row for row, cast in self.active_casts() if cast.proposal is not None]
            number = aimed[-1] if aimed else -1
        if number not in range(len(self.store)) or number in self.undone:
            raise InputError("there is no such cast to discard")
        self.store.undo(number)
        self._condition()
        return self.store.casts[number]

    def is_done(self, value: ArrayLike) -> bool:
        """Return whether a goal of some value, shape [k], was hit, or all its tries are used."""
        casts = self.casts_at(value)
        return len(casts) >= self.config.tries or any(cast.hit for cast in casts)

    def cast(self, rig: CheckedRig, proposal: Proposal) -> Cast:
        """Make a proposed cast on a rig with the set-up of the session, and take it in.

        Raises:
            RigError: The cast failed too often.
            InputError: The proposal is not the next cast of the session.
        """
        self._check_next(proposal)
        return self.observe(proposal, self.play(rig, proposal.trajectory, proposal.number))

    def play(self, rig: CheckedRig, motion: Trajectory, number: int) -> EndpointTrack:
        """Reset a rig and play one motion; a cast that fails is repeated.

        A rig that draws by chance draws from the number of the cast.

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
        try:
            self.look(rig)
        except RigError as error:
            # A cast that was made is not lost because the camera fails afterwards.
            warnings.warn(
                f"the camera does not say what it sees after cast {number}, and the next cast "
                f"relies on its sight before: {error}",
                stacklevel=2,
            )
        return track

    def look(self, rig: CheckedRig) -> None:
        """Ask a rig what its camera cannot see, and aim past it; `play` does so after each cast."""
        if rig.sight is not None:
            self.sight = rig.sight()

    def _check_next(self, proposal: Proposal) -> None:
        if not isinstance(proposal, Proposal):
            raise InputError(
                f"a proposal is what propose(target) returns, not a {type(proposal).__name__}"
            )
        if proposal.number != len(self.store):
            raise InputError(
                f"the proposal is cast {proposal.number} of the session, whose next cast is "
                f"{len(self.store)}: propose again, since other casts were made meanwhile"
            )


class AimSession(CastSession):
    """Aims at targets one after another, and corrects by every cast.

    ```
    proposal = session.propose(r=1.10, theta_deg=16.7)
    cast = session.cast(rig, proposal)
    ```

    A robot that is driven by something else plays `proposal.trajectory` and hands what it saw to
    `session.observe(proposal, track)`. Each cast is kept before the call returns. A session that is
    opened again in the same folder knows all of its casts.

    Args:
        model: Model to plan with, and the fit behind it; a policy of simulated casts alone stands
            for one of which nothing else is known.
        casts: Casts on the rig that were made before.
        out: Folder that keeps the casts; none if None.
        config: Settings; `tries`, `within_pct`, `force` and `refit` are used here and by `aim`.
        refitting: Makes a new model from all casts; `prepare_aim` gives it.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        task: Task of its goals: that of the model.
        store: All casts, with discarded ones.
        predictor: Beliefs of the model, conditioned on the casts.
        sight: Limits of the sight of the rig's camera; None while they are unknown.
        drifted: Whether the last cast showed that the cable, its grip or the camera has changed.

    Raises:
        InputError: The policy has learned from real casts, or the folder holds something else.
    """

    def __init__(
        self,
        model: Beliefs | ForwardSearchPolicy,
        *,
        casts: Dataset | None = None,
        out: str | os.PathLike[str] | CastStore | None = None,
        config: AimConfig | None = None,
        refitting: Refitting | None = None,
    ):
        if isinstance(model, ForwardSearchPolicy):
            model = Beliefs(policy=model)
        self.config = config or AimConfig()
        self.setup: Setup = model.policy.setup
        self.task: Task = model.policy.model.task
        is_open = isinstance(out, CastStore)
        self.store = out if is_open else CastStore(self.setup, out, self.task)
        if casts is not None:
            self.store.add_dataset(casts)
        if self.store.task.name != self.task.name:
            raise InputError(f"the casts are of {self.store.task.name}, the model {self.task.name}")
        self.store.set_tolerance(self.config.within_pct)
        self.sight: CameraSight | None = None
        self.drifted = False
        self._refitting = refitting
        self.use(model)

    def use(self, model: Beliefs) -> None:
        """Plan with another model from now on, conditioned on all casts."""
        self.model = model
        if model.ensemble is not None and self.store.folder is not None:
            model.ensemble.recall_landings(self.store.folder / LANDINGS_FILE, self.task)
        self._condition()

    def _condition(self) -> None:
        """Condition the beliefs on all casts, in the order and the groups in which they were made.

        So a session that is opened again goes on as if it had never been closed.
        """
        self.predictor = LandingPredictor.of(
            self.model, polar=self.config.polar and not self.config.fast
        )
        self.drifted = False
        self._scaled_count = 0
        self._local: tuple[tuple, LandingPredictor] | None = None
        for is_aimed, group in itertools.groupby(
            enumerate(self.store.casts), lambda row: row[1].proposal is not None
        ):
            # Casts for something else came together, aimed ones one by one.
            rows = list(group)
            for part in [[row] for row in rows] if is_aimed else [rows]:
                kept = [row for row in part if row[0] not in self.store.undone]
                self._add(kept, part[-1][0] + 1, always=not is_aimed)

    def _add(self, casts: Sequence[tuple[int, Cast]], count: int, *, always: bool = False) -> None:
        """Condition on casts that were made together, with which the session has `count`.

        The scales of the process are fitted anew where there are enough new ones, or `always`.
        """
        # The scales change slowly: fitting them at each cast would be wasted.
        fit_scales = always or count >= _SCALE_GROWTH * self._scaled_count
        self.predictor = self.predictor.with_casts(
            [cast for _, cast in casts],
            fitted=[self.model.has_fitted(*row) for row in casts],
            fit_scales=fit_scales,
        )
        if fit_scales:
            self._scaled_count = count
        if self.model.ensemble is not None and self.store.folder is not None:
            self.model.ensemble.keep_landings(self.store.folder / LANDINGS_FILE, self.task)

    @property
    def fitted_count(self) -> int:
        """Number of casts that the simulator was fitted to, without those discarded since."""
        return sum(self.model.has_fitted(*row) for row in self._active_sweeps())

    def add_casts(self, casts: Dataset) -> int:
        """Take in casts that were made for something else, and return how many are new.

        Raises:
            InputError: The casts were simulated, or made with another set-up.
        """
        before = len(self.store)
        self.store.add_dataset(casts)
        new = list(enumerate(self.store.casts))[before:]
        if new:
            self._add(new, len(self.store), always=True)
        return len(new)

    def fork(self) -> "AimSession":
        """Return a session of the same casts that goes on by itself and keeps nothing on disk."""
        other = copy.copy(self)
        other.store = self.store.in_memory()
        return other

    def _active_sweeps(self) -> list[tuple[int, Cast]]:
        """Return the sweeps that were not discarded: simulators are fitted to these."""
        return [(number, self.store.casts[number]) for number in self.store.sweeps]

    def stop(self, proposal: Proposal) -> Stop | None:
        """Return why a proposed cast is not worth making; None if it is.

        It is not if the last three casts at the goal came no nearer than those before; if two have
        been made there, and this one is unlikely to hit and expected to come little nearer than
        the nearest of them, the scatter of equal casts included; if it is unlikely to hit and the
        last two missed far in one direction; or if none has landed and this one is expected far
        off. `AimConfig.force` makes it all the same.
        """
        goal, length = proposal.goal, self.setup.cable.length

        def miss(outcome: NDArray[np.float64]) -> float:
            return float(goal.miss(outcome))

        casts = self.casts_at(goal.value)
        misses = [miss(cast.outcome) if cast.landed else math.inf for cast in casts]
        landed = [cast.outcome for cast in casts if cast.landed]
        near = min(landed or [self.model.policy.nearest_landing(goal.value)], key=miss)
        expected = proposal.expected_miss
        before = min(misses[:-STUCK_COUNT], default=math.inf)
        stuck = len(misses) >= STUCK_COUNT and min(misses[-STUCK_COUNT:]) >= before
        if landed:
            scatter = math.sqrt(len(goal.value)) * proposal.expected.scatter / length
            no_nearer = math.hypot(expected, scatter) >= _NEARER * miss(near)
            unlikely = len(casts) >= 2 and proposal.hit_chance < _UNLIKELY and no_nearer
        else:
            far = expected > max(goal.within_pct / 100.0, NEAR)
            unlikely = proposal.hit_chance < HIT_CHANCE_MIN and far
        in_vain = proposal.hit_chance < _UNLIKELY and self._misses_one_way(goal, landed)
        if self.config.force or not (stuck or unlikely or in_vain):
            return None
        found = (stuck, StopReason.STUCK), (in_vain, StopReason.IN_VAIN)
        return Stop(
            proposal=proposal,
            reason=next((reason for holds, reason in found if holds), StopReason.UNLIKELY),
            nearest=near,
            is_simulated=not landed,
        )

    @staticmethod
    def _misses_one_way(goal: Goal, landed: Sequence[NDArray[np.float64]]) -> bool:
        """Return whether the last two of some outcomes, shape [k], missed far in one direction."""
        if len(landed) < 2:
            return False
        first, last = ((one - goal.value) / goal.task.scale(goal.setup) for one in landed[-2:])
        sizes = np.linalg.norm([first, last], axis=1)
        far = sizes.min() > _FAR and sizes[1] >= _NO_LESS * sizes[0]
        return bool(far and first @ last >= _ONE_WAY * sizes.prod())

    def propose(
        self,
        target_xy: ArrayLike | Goal | None = None,
        *,
        r: float | None = None,
        theta_deg: float | None = None,
    ) -> Proposal:
        """Propose the next cast at a target, and say what to expect of it.

        Args:
            target_xy: Target [m], shape [2], or a checked goal; or else r and theta_deg.
            r: Distance from the robot's base [m].
            theta_deg: Angle from straight ahead, positive to the robot's right [deg].

        Raises:
            TargetError: The target is not finite, out of reach, or off the table.
        """
        if isinstance(target_xy, Goal):
            goal = target_xy
        else:
            goals = self.goals(target_xy, r=r, theta_deg=theta_deg)
            if len(goals) != 1:
                raise InputError(f"a proposal has one target, not {len(goals)}")
            goal = goals[0]
        return propose(
            self.predictor_at(goal.value),
            goal,
            number=len(self.store),
            try_number=len(self.casts_at(goal.value)) + 1,
            laws=self.miss_laws(),
            sight=self.sight,
        )

    def predictor_at(self, target_xy: NDArray[np.float64]) -> LandingPredictor:
        """Return the predictor for one goal by its value, shape [k].

        Its simulators have taken a step towards the casts near the target that they were not fitted
        to. The last one is kept.
        """
        active = [row for row in self._active_sweeps() if not self.model.has_fitted(*row)]
        rows = casts_near(active, Goal(task=self.task, setup=self.setup, value=target_xy))
        if not rows:
            return self.predictor
        key = (self.predictor, tuple(rows), tuple(target_xy))
        if self._local is None or self._local[0] != key:
            tracks = MeasuredTracks.of_casts([self.store.casts[row] for row in rows], self.setup)
            self._local = key, self.predictor.near(target_xy, tracks)
        return self._local[1]

    def pilot(self, rig: CheckedRig, progress: ProgressCallback = show) -> None:
        """Make some polar casts at no goal, from which the others learn: all err alike.

        Where its swing leaves the cable in a heap, one with a slower swing follows. None is made
        after another polar cast, or where the settings make none.

        Raises:
            RigError: A cast failed too often.
        """
        while (polar := self.predictor.polar) is not None and (action := polar.pilot) is not None:
            progress(Progress(task="A polar cast, from which the others learn"))
            number, motion = len(self.store), plan_trajectory(action, self.setup)
            self.store.add(Cast.of_motion(motion, self.play(rig, motion, number), "pilot"))
            self._condition()

    def observe(self, proposal: Proposal, track: EndpointTrack) -> Cast:
        """Take in a proposed cast that was made, and what the rig saw of it.

        Raises:
            InputError: The proposal is not the next cast of the session.
        """
        self._check_next(proposal)
        cast = Cast.of_motion(proposal.trajectory, track, "aim", proposal)
        self.store.add(cast)
        drift_count = len(self.predictor.experience.drifts)
        try:
            self._add([(proposal.number, cast)], len(self.store))
        except BaseException:
            # It was stopped with the cast stored, and nothing learned from it yet.
            self._condition()
            raise
        self.drifted = len(self.predictor.experience.drifts) > drift_count
        return cast

    @property
    def refit_due(self) -> RefitDue | None:
        """Why the simulator should be fitted to all casts now; None if it need not be."""
        if self._refitting is None:
            return None
        active = self._active_sweeps()
        return refit_due(
            [cast for _, cast in active],
            [self.model.has_fitted(*row) for row in active],
            needs_first_fit=self.model.fitted_to is None,
        )

    def fit(self, progress: ProgressCallback = show) -> Beliefs:
        """Return the model of a fit to all casts that were not discarded, for `use`.

        Takes as long as the first fit; the session stays as it is. A fit that was stopped goes on
        where it was when this is called again before the next cast.

        Raises:
            InputError: The session was not prepared by `prepare_aim`, or has too few casts.
        """
        if self._refitting is None:
            raise InputError("only a session that prepare_aim returned can be fitted anew")
        return self._refitting(self.store, progress)

    def refit(self, progress: ProgressCallback = show) -> None:
        """Fit the simulator to all casts, and plan with it from now on; see `fit`."""
        self.use(self.fit(progress))


def casts_near(casts: Sequence[tuple[int, Cast]], goal: Goal) -> list[int]:
    """Return the numbers of the casts that tell most of a goal, in ascending order.

    Those that were aimed at it come first, the latest before earlier ones, then those that landed
    nearest to it.
    """
    aimed, landed = [], []
    for number, cast in casts:
        if cast.is_at(goal.value):
            aimed.append(number)
        elif cast.landed:
            landed.append((float(goal.miss(cast.read(goal.task))), number))
    chosen = [*reversed(aimed), *(number for _, number in sorted(landed))]
    return sorted(chosen[:LOCAL_COUNT])


def refit_due(
    casts: Sequence[Cast],
    fitted: Sequence[bool],
    *,
    needs_first_fit: bool = False,
) -> RefitDue | None:
    """Return why the simulator should be fitted anew; None if it need not be.

    Args:
        casts: Active casts of a session, in the order in which they were made.
        fitted: Whether the simulator was fitted to each. One that was fitted to none of them needs
            no other fit.
        needs_first_fit: Whether the simulator is to be fitted to the first casts of the session.
    """
    count, fitted_count = len(casts), sum(fitted)
    due = functools.partial(RefitDue, cast_count=count, fitted_count=fitted_count)
    if needs_first_fit and count >= FIRST_COUNT:
        return due(RefitReason.FIRST_FIT)
    if not 0 < fitted_count < ENOUGH or count < EARLY_GROWTH * fitted_count:
        return None
    if count >= GROWTH * fitted_count:
        return due(RefitReason.MORE_CASTS)
    innovations = [
        cast.square / len(cast.target_xy)
        for cast, is_fitted in zip(casts, fitted, strict=True)
        if not is_fitted and cast.try_number == 1 and np.isfinite(cast.square)
    ]
    if len(innovations) < EARLY_TRIES:
        return None
    mean = float(np.mean(np.minimum(innovations, _INNOVATION_MAX)))
    if mean <= EARLY_INNOVATION:
        return None
    return due(RefitReason.FAR_OFF, size=float(np.sqrt(mean)))
