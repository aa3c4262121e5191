"""Controls of the page: the tabs beside the scene. They hold no state of their own."""

import math
from typing import Any

import numpy as np

from cablecast.arm.limits import JOINT_NAMES
from cablecast.conventions import xy_to_polar
from cablecast.pipeline.aim_session import AimTrial
from cablecast.runs.progress import duration_text
from cablecast.view.desk import Desk, Phase, Preview
from cablecast.view.host import Host
from cablecast.view.scene import EXPECTED_SHARE
from cablecast.view.worker import WorkState

_ROWS = 8
"""Number of tries in the table; the others can be chosen from the list below it."""

_WORTH_SAYING = 0.1
"""Chance of a cast without a landing that is worth a line."""


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
        with gui.add_folder("View", expand_by_default=False):
            self._time = gui.add_slider("time [s]", 0.0, 5.0, 0.02, 0.0)
            self._time.on_update(self._seek)
            self._play = gui.add_button("Play or pause", color="gray", icon="player-play")
            self._play.on_click(lambda _: page.player.toggle())
            speed = gui.add_dropdown("speed", ("1", "1/2", "1/4", "1/10"), initial_value="1")
            speed.on_update(lambda _: self._set_speed(str(speed.value)))
            coverage = gui.add_checkbox("Where it can land", False)
            coverage.on_update(lambda _: page.guard(lambda: page.show_map(coverage.value)))
            dark = gui.add_checkbox("Dark", False)
            dark.on_update(lambda _: page.set_dark(dark.value))
        self._shown_time = -1.0

    def refresh(self) -> None:
        """Show the state of desk and worker."""
        desk, state = self._page.desk, self._page.worker.state
        phase, busy = desk.phase, bool(state.name)
        _set(self._status, "content", status_text(desk, state))
        _set(self._make, "visible", phase is Phase.NO_MODEL)
        _set(self._make, "disabled", busy)
        _set(self._cast, "visible", phase in (Phase.READY, Phase.PLANNED, Phase.CASTING))
        _set(self._cast, "disabled", busy or desk.preview is None)
        _set(self._correct, "visible", phase is Phase.LANDED)
        _set(self._correct, "disabled", busy)
        _set(self._stop, "visible", busy)
        _set(self._bar, "visible", busy)
        progress = state.progress
        if progress is not None and progress.total:
            _set(self._bar, "value", round(100.0 * progress.done / progress.total, 1))
        elif busy:
            _set(self._bar, "value", 100.0)
        _set(self._plan, "content", "" if desk.preview is None else plan_text(desk.preview, desk))
        _set(self._tries_folder, "visible", bool(desk.tries))
        _set(self._table, "content", tries_text(desk))
        names = tuple(_try_name(one) for one in desk.tries) or ("-",)
        if tuple(self._number.options) != names:
            self._number.options = names
            self._number.value = names[-1]
        _set(self._undo, "disabled", busy or desk.last is None)

    def show_time(self, time: float, duration: float) -> None:
        """Move the time slider, at most five times a second."""
        if abs(time - self._shown_time) < 0.2 and 0.0 < time < duration:
            return
        self._shown_time = time
        if duration > 0 and abs(self._time.max - duration) > 1e-6:
            self._time.max = round(duration, 2)
        _set(self._time, "value", round(min(time, duration), 2))

    def _seek(self, event: Any) -> None:
        # Setting the value from here comes without a client.
        if event.client is not None:
            self._page.player.seek(float(self._time.value))

    def _set_speed(self, text: str) -> None:
        over = text.partition("/")[2]
        self._page.player.speed = 1.0 / float(over) if over else 1.0

    def _replay_chosen(self) -> None:
        for one in self._page.desk.tries:
            if _try_name(one) == self._number.value:
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


def plan_text(preview: Preview, desk: Desk) -> str:
    """Return what to expect of a plan, as a table in Markdown."""
    proposal = preview.proposal
    length = proposal.cable_length
    r, theta = xy_to_polar(proposal.target_xy)
    offset = float(np.linalg.norm(proposal.expected_xy - proposal.target_xy))
    major, minor, _ = (100.0 / length * value for value in proposal.ellipse(EXPECTED_SHARE))
    shares = 100.0 * preview.limit_shares
    fastest, hardest = (int(np.argmax(row)) for row in shares)
    rows = [
        ("target", f"{r:.3f} m, {math.degrees(theta):.1f}°, try {proposal.try_number}"),
        ("expected", f"{100 * offset / length:.1f} % of the cable's length beside it"),
        (f"{100 * EXPECTED_SHARE:.0f} % land", f"within {major:.0f} by {minor:.0f} %"),
        ("duration", f"{proposal.trajectory.duration:.2f} s"),
        ("joint speed", f"{shares[0, fastest]:.0f} % of its limit ({JOINT_NAMES[fastest]})"),
        ("acceleration", f"{shares[1, hardest]:.0f} % of its limit ({JOINT_NAMES[hardest]})"),
        ("table's edge", f"{100 * preview.margin:.0f} cm away"),
    ]
    if proposal.failure > _WORTH_SAYING:
        rows.append(("may fail", f"{100 * proposal.failure:.0f} % hidden or off the table"))
    lines = ["| plan | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)]
    if not proposal.inside_coverage:
        lines.append("\nNo simulated cast lands here: this is the nearest.")
    return "\n".join(lines)


def tries_text(desk: Desk) -> str:
    """Return the last tries as a table in Markdown."""
    lines = ["| try | target | miss |", "|---|---|---|"]
    for one in desk.tries[-_ROWS:]:
        r, theta = xy_to_polar(one.target_xy)
        miss = one.status.code.replace("_", " ")
        if math.isfinite(one.miss_pct):
            miss = f"{one.miss_pct * desk.setup.cable.length:.1f} cm, {one.miss_pct:.1f} %"
        if desk.is_undone(one):
            miss = f"~~{miss}~~"
        lines.append(
            f"| {one.try_number} | {r:.2f} m, {math.degrees(theta):.0f}° | "
            f"{'**' + miss + '**' if one.hit else miss} |"
        )
    return "\n".join(lines)


def status_text(desk: Desk, state: WorkState) -> str:
    """Return the state of the table, and what to do next."""
    if state.name:
        text = f"**{state.name[:1].upper()}{state.name[1:]} is under way.**"
        if state.progress is not None:
            progress = state.progress
            text += f"\n\n{progress.task}"
            if progress.total:
                text += f": {progress.done} of {progress.total} {progress.unit}"
            if state.seconds_left is not None:
                text += f", about {duration_text(state.seconds_left)} left"
        return text
    news = state.message or desk.message
    last = desk.last
    head = desk.phase.value
    if desk.phase is Phase.LANDED and last is not None and math.isfinite(last.miss_pct):
        verdict = "Hit" if last.hit else "Landed"
        centimetres = last.miss_pct * desk.setup.cable.length
        head = f"{verdict}: {centimetres:.1f} cm ({last.miss_pct:.1f} %) from the target. {head}"
    return f"**{head}**" + (f"\n\n{news[:1].upper()}{news[1:]}" if news else "")


def _try_name(one: AimTrial) -> str:
    r, theta = xy_to_polar(one.target_xy)
    return f"{one.number}: {r:.2f} m, {math.degrees(theta):.0f}°, try {one.try_number}"


def _set(handle: Any, name: str, value: Any) -> None:
    """Set a property that has changed: every assignment is sent to every tab."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)
