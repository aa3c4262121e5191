"""Desk: what a person does, without a page: point, look at the plan, cast, correct.

The casts are those of a session of `aim`. Every value that comes from a page is checked here.
Methods may be called from any thread; a cast locks the desk, so that two people never cast at once.
"""

import copy
import enum
import math
import threading

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.aiming.session import AimSession, CastSession
from cablecast.cast import Cast, Proposal
from cablecast.conventions import stream
from cablecast.engines.base import Engine
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.report.words import stop_text
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import Setup
from cablecast.view.tasks import PageTask, Preview

SEGMENT_COUNT, STEP = 30, 1e-3
"""Resolution of previews: a cast in a fraction of the time, with a landing some per cent of the
cable's length from that of the full resolution."""

_CHOICE = 8  # Targets of which the one farthest from all targets is suggested.


class Phase(enum.Enum):
    """State of the session; the value says what to do next."""

    NO_MODEL = "Get ready first: the rig makes some casts, and the simulator learns from them."
    READY = "Click on the table to choose a target."
    PLANNED = "Look at the plan, then cast."
    CASTING = "The arm moves: keep clear."
    LANDED = "Correct and cast again, or choose another target."
    DONE = "Choose another target."


class Desk:
    """State of a session and of its tries.

    The engine simulates the previews; `make_engine` makes it if None.

    Attributes:
        setup: Set-up of the rig.
        task: What its casts are for.
        session: Session that plans; None until one was prepared.
        preview: Plan for the current target; None before the first, and after one that was refused.
        stop: Why the next cast at the target is not worth making; empty where it is, or was hit.
        message: Latest news in one sentence; empty if there are none.
    """

    def __init__(self, rig: CheckedRig, engine: Engine | None = None):
        self.rig = rig
        self.engine = engine or EngineWarp(segment_count=SEGMENT_COUNT, dt=STEP)
        self.setup: Setup = rig.setup
        self.task: PageTask = PageTask.of(self.setup, self.engine)
        self.session: CastSession | None = None
        self.preview: Preview | None = None
        self.stop = ""
        self.message = ""
        self._lock = threading.RLock()
        self._casting = False
        # Of targets that are suggested.
        self._rng = stream(0, "suggested targets")

    @property
    def phase(self) -> Phase:
        """State of the session; without the lock, which a plan holds as long as it takes."""
        session, preview = self.session, self.preview
        if self._casting:
            return Phase.CASTING
        if session is None:
            return Phase.NO_MODEL
        if preview is None:
            return Phase.READY
        if preview.proposal.number >= len(session.casts):
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

    def set_session(self, session: CastSession) -> None:
        """Plan with a session from now on."""
        if session.setup.to_settings() != self.setup.to_settings():
            raise InputError("the model was made for another set-up than the rig's")
        with self._lock:
            self._refuse_casting()
            self.session, self.preview, self.stop = session, None, ""

    def open_session(self, session: CastSession, report: ProgressCallback = ignore) -> None:
        """Plan with a session from now on, once its first plan will be as quick as the others.

        Raises:
            InputError: It was made for another set-up, or a cast is under way.
        """
        report(Progress(task="A first plan"))
        self.task.rehearse(session)
        self.set_session(session)

    def refit(self, report: ProgressCallback = ignore) -> None:
        """Fit the simulator to all casts that were not undone, and plan with its model.

        Targets can be planned meanwhile, with the model of before.

        Raises:
            InputError: There is no session, it has too few casts, or fits by itself.
        """
        session = self._need_session()
        if not isinstance(session, AimSession):
            raise InputError("this session fits by itself where it is worth it")
        model = session.fit(report)
        report(Progress(task="All casts with the new model"))
        # A copy, so that one that is stopped half-way leaves the session as it was.
        renewed = copy.copy(session)
        with self._lock:
            renewed.use(model)
            self.set_session(renewed)
        self.task.rehearse(renewed)
        self.message = f"The simulator fits {renewed.fitted_count} casts now."

    def aim(self, target: ArrayLike) -> Preview:
        """Choose a target [m], and plan the next cast at it, corrected by earlier casts.

        It is x and y on the table, or distance ahead and height in the plane of a swing, shape [2];
        or a point in space, shape [3].

        Raises:
            TargetError: It is not finite, out of reach, or off the table.
            InputError: It is no row of numbers, there is no session, or a cast is under way.
        """
        with self._lock:
            self._refuse_casting()
            session = self._need_session()
            # A target that is refused leaves no plan for the one before.
            self.preview, self.stop = None, ""
            proposal = self.task.propose(session, target)
            self.preview = self.task.preview(session, proposal)
            self.stop = _stop_words(session, proposal)
            self.message = ""
            return self.preview

    def other_target(self) -> NDArray[np.float64]:
        """Return a target [m], shape [k], that simulated casts reach, far from those aimed at."""
        some = self.task.suggested(self._need_session(), self._rng, _CHOICE)
        aimed = [one.target_xy for one in self.tries]
        if (preview := self.preview) is not None:
            aimed.append(preview.proposal.goal.value)
        known = np.array(aimed).reshape(-1, 1, some.shape[1])
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
            # Other sessions stop no cast, and a plan takes long.
            if isinstance(session, AimSession):
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
                seen = math.isfinite(trial.miss_pct)
                self.message = self.task.news(session, trial) if seen else trial.status.value
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
            self.message = f"Try {last.try_number} is discarded: no plan uses it from now on."
            return last

    def _need_session(self) -> CastSession:
        if self.session is None:
            raise InputError("there is no model yet: make one first")
        return self.session

    def _refuse_casting(self) -> None:
        if self._casting:
            raise InputError("a cast is under way: wait until the cable rests")


def _stop_words(session: CastSession, proposal: Proposal) -> str:
    """Return why a proposed cast is not worth making; empty if it is."""
    stop = session.stop(proposal)
    return "" if stop is None else stop_text(stop)
