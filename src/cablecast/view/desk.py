"""Desk: what a person does at the table, without a page: point, look at the plan, cast, correct.

The casts are those of a session of `aim`. Every value that comes from a page is checked here.
Methods may be called from any thread; a cast locks the desk, so that two people never cast at once.
"""

import copy
import dataclasses
import enum
import threading

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.aiming.session import AimSession
from cablecast.cast import Cast, Proposal
from cablecast.conventions import stream
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.motion.action import mirror_to_right
from cablecast.motion.casting import Action
from cablecast.motion.limits import check_grip_paths
from cablecast.motion.trajectory import Trajectory
from cablecast.report.words import change_text, stop_text
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import Setup
from cablecast.view.look import ShownCast

SEGMENT_COUNT, STEP = 30, 1e-3
"""Resolution of previews: a cast in a fraction of the time, with a landing some per cent of the
cable's length from that of the full resolution."""

_EDGE = 0.1  # Least distance of a suggested target from the table's edges [m].
_CHOICE = 8  # Landings of which the one farthest from all targets is suggested.


class Phase(enum.Enum):
    """State of the table; the value says what to do next."""

    NO_MODEL = "Get ready first: the rig makes some casts, and the simulator learns from them."
    READY = "Click on the table to choose a target."
    PLANNED = "Look at the plan, then cast."
    CASTING = "The arm moves: keep clear."
    LANDED = "Correct and cast again, or choose another target."
    DONE = "Choose another target."


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Preview:
    """A planned cast and what to expect of it.

    Attributes:
        proposal: Planned cast, with its ellipse.
        cast: Simulated cast.
        limit_shares: Largest share of each joint's speed and acceleration limits [-], [2, joint].
        margin: Predicted distance of the free end from the table's edges [m]; negative off it.
    """

    proposal: Proposal
    cast: ShownCast
    limit_shares: NDArray[np.float64]
    margin: float


class Desk:
    """State of the table and of the tries at it.

    The engine simulates the previews; `make_engine` makes it if None.

    Attributes:
        setup: Set-up of the rig.
        session: Session that plans; None until one was prepared.
        dynamics: Simulated cable: that of the model's training casts.
        preview: Plan for the current target; None before the first, and after one that was refused.
        stop: Why the next cast at the target is not worth making; empty where it is, or was hit.
        message: Latest news in one sentence; empty if there are none.
    """

    def __init__(self, rig: CheckedRig, engine: Engine | None = None):
        self.rig = rig
        self.engine = engine or EngineWarp(segment_count=SEGMENT_COUNT, dt=STEP)
        self.setup: Setup = rig.setup
        self.session: AimSession | None = None
        self.preview: Preview | None = None
        self.stop = ""
        self.message = ""
        self.dynamics = Dynamics.of(None, self.setup)
        self._lock = threading.RLock()
        self._casting = False
        # Of targets that are suggested.
        self._rng = stream(0, "suggested targets")

    @property
    def phase(self) -> Phase:
        """State of the table."""
        with self._lock:
            if self._casting:
                return Phase.CASTING
            if self.session is None:
                return Phase.NO_MODEL
            if self.preview is None:
                return Phase.READY
            if self.preview.proposal.number >= len(self.session.casts):
                return Phase.PLANNED
            return Phase.DONE if self.stop or self.is_hit else Phase.LANDED

    @property
    def tries(self) -> list[Cast]:
        """Casts at targets, in order, with those that were undone."""
        history = () if self.session is None else self.session.casts
        return [trial for trial in history if trial.try_number > 0]

    @property
    def last(self) -> Cast | None:
        """Latest try that was not undone."""
        return next((one for one in reversed(self.tries) if not self.is_undone(one)), None)

    @property
    def is_hit(self) -> bool:
        """Whether a try at the target of the plan hit it."""
        preview = self.preview
        return preview is not None and any(
            one.hit for one in self.tries_at(preview.proposal.goal.value)
        )

    def is_undone(self, trial: Cast) -> bool:
        """Return whether a try was discarded."""
        return self.session is not None and trial.number in self.session.undone

    def tries_at(self, target_xy: NDArray[np.float64]) -> list[Cast]:
        """Return the tries at a target [m] that were not undone, in order."""
        return [] if self.session is None else self.session.casts_at(target_xy)

    def set_session(self, session: AimSession) -> None:
        """Plan with a session from now on, and simulate with the cable of its model."""
        if session.setup.to_settings() != self.setup.to_settings():
            raise InputError("the model was made for another set-up than the rig's")
        settings = session.model.policy.model.settings
        with self._lock:
            self._refuse_casting()
            self.session, self.preview, self.stop = session, None, ""
            if settings.is_simulated:
                self.dynamics = settings.dynamics

    def open_session(self, session: AimSession, report: ProgressCallback = ignore) -> None:
        """Plan with a session from now on, once its first plan will be as quick as the others.

        Raises:
            InputError: It was made for another set-up, or a cast is under way.
        """
        report(Progress(task="A first plan"))
        self._rehearse(session)
        self.set_session(session)

    def refit(self, report: ProgressCallback = ignore) -> None:
        """Fit the simulator to all casts that were not undone, and plan with its model.

        Targets can be planned meanwhile, with the model of before.

        Raises:
            InputError: There is no session, or it has too few casts.
        """
        session = self._need_session()
        model = session.fit(report)
        report(Progress(task="All casts with the new model"))
        # A copy, so that one that is stopped half-way leaves the session as it was.
        renewed = copy.copy(session)
        with self._lock:
            renewed.use(model)
            self.set_session(renewed)
        self._rehearse(renewed)
        self.message = f"The simulator fits {renewed.fitted_count} casts now."

    def aim(self, target_xy: ArrayLike) -> Preview:
        """Choose a target [m], shape [2], and plan the next cast at it, corrected by earlier casts.

        Raises:
            TargetError: It is not finite, out of reach, or off the table.
            InputError: It is no pair of numbers, there is no session, or a cast is under way.
        """
        with self._lock:
            self._refuse_casting()
            session = self._need_session()
            # A target that is refused leaves no plan for the one before.
            self.preview, self.stop = None, ""
            proposal = session.propose(target_xy)
            self.preview = self._preview(session, proposal)
            self.stop = _stop_words(session, proposal)
            self.message = ""
            return self.preview

    def other_target(self) -> NDArray[np.float64]:
        """Return a target [m], shape [2], that simulated casts reach, far from those aimed at."""
        session, table = self._need_session(), self.setup.workspace
        xy = session.model.policy.predicted_xy
        xy = xy[table.edge_distance(xy) > _EDGE]
        xy = xy[np.linalg.norm(xy, axis=1) < table.reach(self.setup.cable.length)]
        if not len(xy):
            raise InputError(
                f"no simulated cast lands {_EDGE} m within the table's edges: click on the table"
            )
        some = self._rng.choice(xy, _CHOICE) * np.stack(
            [self._rng.choice([-1, 1], _CHOICE), np.ones(_CHOICE)], 1
        )
        aimed = [one.target_xy for one in self.tries]
        if (preview := self.preview) is not None:
            aimed.append(preview.proposal.goal.value)
        known = np.array(aimed).reshape(-1, 1, 2)
        return some[np.argmax(np.linalg.norm(some - known, axis=2).min(axis=0, initial=np.inf))]

    def look_ahead(self) -> None:
        """Find out whether another cast at the target of the last one is worth making."""
        with self._lock:
            session, last, preview = self._need_session(), self.last, self.preview
            if last is None or preview is None or not last.is_at(preview.proposal.goal.value):
                # Another target was chosen meanwhile.
                return
            self.stop = ""
            if self.is_hit:
                return
            self.stop = _stop_words(session, session.propose(last.target_xy))
            if not self.stop and session.is_done(last.target_xy):
                used = len(session.casts_at(last.target_xy))
                words = f"all {used} tries at this target are" if used > 1 else "its only try is"
                self.stop = f"{words} used"

    def correct(self) -> Preview:
        """Plan the next cast at the target of the last one."""
        with self._lock:
            self._refuse_casting()
            if (last := self.last) is None:
                raise InputError("there is nothing to correct yet: cast first")
            return self.aim(last.target_xy)

    def cast(self, planned: Preview | None) -> Cast:
        """Cast the plan that a person has seen, and see where the free end comes to rest.

        To be called in the thread that may use the rig.

        Raises:
            InputError: Nothing is planned, another plan than the one that was seen, or another cast
                is under way.
            RigError: The rig failed; the table can be used again.
        """
        with self._lock:
            self._refuse_casting()
            if planned is None:
                raise InputError("nothing is planned: choose a target first")
            if planned is not self.preview or self.phase is not Phase.PLANNED:
                raise InputError("the plan has changed meanwhile: look at it, then cast")
            session = self._need_session()
            self._casting = True
        try:
            trial = session.cast(self.rig, planned.proposal)
            with self._lock:
                self.message = change_text(trial, session) if trial.landed else trial.status.value
            return trial
        finally:
            with self._lock:
                self._casting = False

    def undo(self) -> Cast:
        """Discard the last try: it is kept, and no plan uses it from now on."""
        with self._lock:
            self._refuse_casting()
            if (last := self.last) is None:
                raise InputError("there is no try to undo")
            self._need_session().undo(last.number)
            self.preview, self.stop = None, ""
            self.message = f"Try {last.number} is discarded: no plan uses it from now on."
            return last

    def simulate(self, trajectory: Trajectory) -> ShownCast:
        """Return a motion as the simulator sees it."""
        return ShownCast.simulated(trajectory, self.setup, self.engine, self.dynamics)

    def _preview(self, session: AimSession, proposal: Proposal) -> Preview:
        table, action = self.setup.workspace, proposal.action.to_array()
        margin = float(table.edge_distance(proposal.expected.mean))
        if isinstance(proposal.action, Action):
            rightward, _ = mirror_to_right(action[None])
            margin = float(session.model.policy.model.predict_margin(rightward)[0])
        limits = check_grip_paths(proposal.trajectory.grip_path, self.setup)
        return Preview(
            proposal=proposal,
            cast=self.simulate(proposal.trajectory),
            limit_shares=np.asarray(limits.peaks[0, 1:] / limits.bounds[1:]),
            margin=margin,
        )

    def _rehearse(self, session: AimSession) -> None:
        """Plan for nobody: the first plan of a session takes several times as long as others."""
        landings = session.model.policy.predicted_xy
        away = np.linalg.norm(landings - np.median(landings, axis=0), axis=1)
        self._preview(session, session.propose(landings[np.argmin(away)]))

    def _need_session(self) -> AimSession:
        if self.session is None:
            raise InputError("there is no model yet: make one first")
        return self.session

    def _refuse_casting(self) -> None:
        if self._casting:
            raise InputError("a cast is under way: wait until the cable rests")


def _stop_words(session: AimSession, proposal: Proposal) -> str:
    """Return why a proposed cast is not worth making; empty if it is."""
    stop = session.stop(proposal)
    return "" if stop is None else stop_text(stop)
