"""Controls of the page: the tabs beside the scene. They hold no state of their own."""

from typing import Any

from cablecast.view.desk import Phase
from cablecast.view.figure import set_changed
from cablecast.view.host import Host
from cablecast.view.status import (
    plan_text,
    status_text,
    tour_text,
    tries_text,
    try_name,
)


class CastControls:
    """Target, plan, cast, correct, undo, and the tries so far.

    Args:
        page: Page that the controls act on.
    """

    def __init__(self, page: Host):
        self._page = page
        gui: Any = page.server.gui
        self._status = gui.add_markdown("")
        self._make = gui.add_button("Get ready", color="blue", icon="wand")
        self._make.on_click(lambda _: page.prepare())
        self._cast = gui.add_button("Cast", color="blue", icon="player-play-filled")
        self._cast.on_click(lambda _: self._ask() if page.rig_is_real else page.cast())
        self._correct = gui.add_button("Correct and cast again", color="blue", icon="target-arrow")
        self._correct.on_click(lambda _: self._ask(True) if page.rig_is_real else page.correct())
        self._stop = gui.add_button("Stop", color="red", icon="hand-stop")
        self._stop.on_click(lambda _: page.stop())
        self._bar = gui.add_progress_bar(0.0, animated=True)
        self._plan = gui.add_markdown("")
        self._tour = gui.add_markdown("", visible=False)
        with gui.add_folder("Target", expand_by_default=False):
            reach = page.desk.setup.workspace.reach(page.desk.setup.cable.length)
            self._r = gui.add_number("r [m]", 1.1, min=0.0, max=round(reach, 3), step=0.01)
            self._theta = gui.add_number("theta [deg]", 0.0, min=-90.0, max=90.0, step=0.5)
            gui.add_button("Plan", color="gray").on_click(
                lambda _: page.aim_polar(self._r.value, self._theta.value)
            )
        self._tries_folder = gui.add_folder("Tries")
        with self._tries_folder:
            self._table = gui.add_markdown("")
            self._number = gui.add_dropdown("Try", ("-",))
            self._replay = gui.add_button("Replay", color="gray", icon="repeat")
            self._replay.on_click(lambda _: self._replay_chosen())
            self._undo = gui.add_button("Undo the last try", color="gray", icon="arrow-back-up")
            self._undo.on_click(lambda _: page.undo())
            self._due = gui.add_markdown("", visible=False)
            self._refit = gui.add_button("Fit to all casts", color="gray", icon="refresh")
            self._refit.on_click(lambda _: page.refit())

    def refresh(self) -> None:
        """Show the state of desk and worker."""
        desk, state = self._page.desk, self._page.worker.state
        phase, busy = desk.phase, bool(state.name)
        set_changed(self._status, "content", status_text(desk, state))
        set_changed(self._make, "visible", phase is Phase.NO_MODEL)
        set_changed(self._make, "disabled", busy)
        set_changed(self._cast, "visible", phase in (Phase.READY, Phase.PLANNED, Phase.CASTING))
        set_changed(self._cast, "disabled", busy or desk.preview is None)
        set_changed(self._correct, "visible", phase is Phase.LANDED)
        set_changed(self._correct, "disabled", busy)
        set_changed(self._stop, "visible", busy)
        set_changed(self._bar, "visible", busy)
        progress = state.progress
        if progress is not None and progress.total:
            set_changed(self._bar, "value", round(100.0 * progress.done / progress.total, 1))
        elif busy:
            set_changed(self._bar, "value", 100.0)
        set_changed(
            self._plan, "content", "" if desk.preview is None else plan_text(desk.preview, desk)
        )
        tour = tour_text(desk, state)
        set_changed(self._tour, "visible", bool(tour))
        set_changed(self._tour, "content", tour)
        set_changed(self._tries_folder, "visible", bool(desk.tries))
        set_changed(self._table, "content", tries_text(desk))
        names = tuple(try_name(one) for one in desk.tries) or ("-",)
        if tuple(self._number.options) != names:
            self._number.options = names
            self._number.value = names[-1]
        set_changed(self._undo, "disabled", busy or desk.last is None)
        due = desk.refit_reason
        set_changed(self._due, "visible", bool(due))
        set_changed(self._due, "content", f"A new fit is worth it: {due}.")
        set_changed(self._refit, "color", "blue" if due else "gray")
        set_changed(self._refit, "disabled", busy)

    def _replay_chosen(self) -> None:
        for one in self._page.desk.tries:
            if try_name(one) == self._number.value:
                self._page.guard(lambda number=one.number: self._page.replay(number))

    def _ask(self, corrected: bool = False) -> None:
        """Ask before a real arm moves."""
        gui: Any = self._page.server.gui
        with gui.add_modal("The arm will move") as modal:
            gui.add_markdown("Is everybody out of its reach, and the emergency stop at hand?")
            yes = gui.add_button("Yes, cast", color="red")
            no = gui.add_button("No")

        def answer(go: bool) -> None:
            modal.close()
            if go:
                (self._page.correct if corrected else self._page.cast)()

        yes.on_click(lambda _: answer(True))
        no.on_click(lambda _: answer(False))
