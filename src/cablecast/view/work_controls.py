"""Controls of long work: start it, see how far it is, stop it, go on."""

import pathlib
from typing import Any

from cablecast.view.figure import set_changed
from cablecast.view.host import Host
from cablecast.view.status import status_text
from cablecast.view.works import WORKS, long_work


class WorkControls:
    """Kind and amount of some work, its progress, and a stop.

    Args:
        host: Page that the controls act on.
        home: Folder of the cable's results, e.g. runs/cable_1.
    """

    def __init__(self, host: Host, home: pathlib.Path):
        self._host, self._home = host, home
        gui: Any = host.server.gui
        gui.add_markdown(
            f"The steps of the pipeline, in `{home}`. What was stopped goes on when it is started "
            "again, here or by its verb on the command line."
        )
        self._kind = gui.add_dropdown("Work", tuple(WORKS))
        self._kind.on_update(lambda _: self._suggest())
        self._amount = gui.add_number("casts", WORKS["collect"].amount, min=1, step=1)
        self._says = gui.add_markdown("")
        self._start = gui.add_button("Start, or go on", color="blue", icon="player-play-filled")
        self._start.on_click(lambda _: host.guard(self._begin))
        self._stop = gui.add_button("Stop the work", color="red", icon="hand-stop")
        self._stop.on_click(lambda _: host.stop())
        self._bar = gui.add_progress_bar(0.0)
        self._status = gui.add_markdown("")
        self._suggest()

    def refresh(self) -> None:
        """Show the state of the worker."""
        state = self._host.worker.state
        busy = bool(state.name)
        set_changed(self._start, "disabled", busy)
        set_changed(self._stop, "visible", busy)
        set_changed(self._bar, "visible", busy)
        text = status_text(self._host.desk, state) if busy else state.message
        set_changed(self._status, "content", text)
        progress = state.progress
        if progress is not None and progress.total:
            set_changed(self._bar, "value", round(100.0 * progress.done / progress.total, 1))

    def _suggest(self) -> None:
        known = WORKS[str(self._kind.value)]
        self._amount.visible = bool(known.unit)
        self._amount.label = known.unit or "amount"
        self._amount.value = known.amount
        self._says.content = f"`{self._kind.value}`: {known.says}, into `{known.folder}`."

    def _begin(self) -> None:
        kind, host = str(self._kind.value), self._host
        work = long_work(kind, host.desk.rig, self._home, int(self._amount.value))
        host.worker.submit(kind, work)
