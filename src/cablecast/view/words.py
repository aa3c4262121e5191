"""Words of the page, in Markdown: the state of the session, a plan, the tries."""

import html
import math
from collections.abc import Mapping

import numpy as np

from cablecast.cast import Cast, Proposal
from cablecast.report.tables import markdown_table
from cablecast.report.tries import REGION_SHARE
from cablecast.report.words import hit_text, motion_text
from cablecast.runs.progress import duration_text
from cablecast.task import closest
from cablecast.view.desk import Desk, Phase
from cablecast.view.look import ShownCast
from cablecast.view.scene import FIGURE_COLORS
from cablecast.view.shapes import GREEN, INK, VERMILLION, Array
from cablecast.view.tasks import Preview
from cablecast.view.worker import WorkState

_ROWS = 5  # Tries at any target in the table; the others can be chosen from the list below it.
_WORTH_SAYING = 0.1  # Chance of a cast without a landing that is worth a line.


def tour_text(desk: Desk, state: WorkState) -> str:
    """Return the steps up to the first cast with the present one marked; nothing after that."""
    if desk.tries:
        return ""
    steps, lines = desk.task.steps, []
    if desk.session is None:
        now = min(max(state.step, 1), len(steps) - 2) if state.busy else 0
    else:
        now = len(steps) - (desk.preview is None)
    for number, what in enumerate(steps, start=1):
        mark = "✓" if number < now else "▶" if number == now else "○"
        lines.append(f"{mark} {what}")
    return "\n\n".join(lines)


def status_text(desk: Desk, state: WorkState) -> str:
    """Return the state of the session, and what to do next."""
    if state.busy:
        return work_text(state)
    phase, last, news = desk.phase, desk.last, state.message or desk.message
    head, length = desk.task.heads.get(phase.name, phase.value), desk.setup.cable.length
    if phase is Phase.PLANNED and desk.stop:
        head = "This cast is unlikely to hit. Choose another target."
    if phase in (Phase.LANDED, Phase.DONE) and last is not None and math.isfinite(last.miss_pct):
        verdict = "Hit" if last.hit else desk.task.inside.capitalize()
        head = f"{verdict}: {_length_text(last.miss_pct, length)} from the target. {head}"
    if desk.stop and not state.message:
        news = f"another cast is not worth it: {desk.stop}" if phase is Phase.DONE else desk.stop
    return f"**{head}**" + (f"\n\n{literal(news[:1].upper() + news[1:])}" if news else "")


def literal(text: str) -> str:
    """Return a text in which a browser finds no HTML: Markdown would let it run."""
    return html.escape(text, quote=False)


def _length_text(pct: float, length: float) -> str:
    """Return a share of the cable's length [%] in centimetres, too."""
    return f"{pct * length:.1f} cm ({pct:.1f} %)"


def work_text(state: WorkState) -> str:
    """Return the work under way, how far it is, and how long it still takes."""
    text = f"**{state.name[:1].upper()}{state.name[1:]} is under way.**"
    if state.progress is not None:
        progress = state.progress
        text += f"\n\n{literal(progress.task)}"
        if progress.total:
            text += f": {progress.done} of {progress.total} {progress.unit}"
        if state.seconds_left is not None:
            text += f", about {duration_text(state.seconds_left)} left"
    return text


def plan_text(preview: Preview, desk: Desk) -> str:
    """Return what to expect of a plan, as a table; once it is cast, what was expected."""
    proposal, length = preview.proposal, desk.setup.cable.length
    if desk.phase in (Phase.LANDED, Phase.DONE):
        return _landing_text(proposal, desk)
    tries = 1 if desk.session is None else desk.session.config.tries
    task = desk.task
    half, most = (100 * proposal.expected.miss_within(proposal.goal, p) for p in (0.5, 0.9))
    shares, names = 100.0 * preview.limit_shares, desk.setup.arm.joint_names
    fastest, hardest = (int(np.argmax(row)) for row in shares)
    fails: list[tuple[str, str]] = []
    if proposal.expected.failure > _WORTH_SAYING:
        fails = [("may fail", f"{100 * proposal.expected.failure:.0f} % {task.lost}")]
    rows = [
        ("target", f"{task.exact_place(proposal.goal.value)}, try {proposal.try_number}"),
        ("chance of a hit", hit_text(proposal, tries)),
        ("most likely", f"{_length_text(half, length)} off"),
        ("nine of ten", f"within {_length_text(most, length)}"),
        *fails,
        ("duration", motion_text(proposal)),
        ("joint speed", f"{shares[0, fastest]:.0f} % of its limit ({literal(names[fastest])})"),
        ("joint accel.", f"{shares[1, hardest]:.0f} % of its limit ({literal(names[hardest])})"),
    ]
    if math.isfinite(preview.margin):
        rows.append(("table's edge", f"{100 * preview.margin:.0f} cm from the free end's way"))
    return markdown_table(("plan", ""), rows)


def _landing_text(proposal: Proposal, desk: Desk) -> str:
    """Return how the last cast ended next to what was expected of it, as a table."""
    length, task = desk.setup.cable.length, desk.task
    rows = [("target", task.place(proposal.goal.value))]
    last = desk.last
    if last is not None and math.isfinite(last.miss_pct):
        off = 100 * float(
            proposal.goal.task.miss(last.outcome, proposal.expected.mean, proposal.setup)
        )
        inside = proposal.expected.holds(last.outcome, REGION_SHARE)
        often = "nine" if inside else "one"
        rows += [
            ("missed by", _length_text(last.miss_pct, length)),
            ("error of the forecast", _length_text(off, length)),
            (
                "purple ellipse",
                f"{task.inside} {'in' if inside else 'out'}side, as {often} of ten do",
            ),
        ]
    return markdown_table((f"try {proposal.try_number}", ""), rows)


def tries_text(desk: Desk) -> str:
    """Return the last tries, and all at the target of the plan, as a table."""
    rows, preview = [], desk.preview
    here = None if preview is None else preview.proposal.goal.value
    for one in desk.tries:
        if one not in desk.tries[-_ROWS:] and (here is None or not one.is_at(here)):
            continue
        miss = one.status.words
        if math.isfinite(one.miss_pct):
            miss = _length_text(one.miss_pct, desk.setup.cable.length)
        if desk.is_undone(one):
            miss = f"~~{miss}~~"
        if one.hit:
            miss = f'<span style="color: rgb{GREEN}">✓ **{miss}**</span>'
        rows.append((f"{one.try_number}", desk.task.place(one.target_xy), miss))
    return markdown_table(("try", "target", "miss"), rows)


def try_name(one: Cast, desk: Desk) -> str:
    """Return the name of a try in a list."""
    return f"{one.number}: {desk.task.place(one.target_xy)}, try {one.try_number}"


def colors_text() -> str:
    """Return what the colours in the scene mean, as HTML."""
    rows = (
        (FIGURE_COLORS["measured"], "the cable as it was seen"),
        (FIGURE_COLORS["plan"], "the plan, and where nine of ten come"),
        (VERMILLION, "target, and its tolerance"),
        (GREEN, "hit"),
        (INK, "miss"),
    )
    items = "".join(
        f'<span style="white-space: nowrap"><span style="color: rgb{color}">■</span> {words}</span>'
        for color, words in rows
    )
    style = "display: flex; flex-wrap: wrap; gap: 0 1em; margin: 0 1em 0.5em; font-size: 0.8em"
    return f'<div style="{style}">{items}</div>'


def motions_text(casts: Mapping[str, ShownCast], length: float, target: Array) -> str:
    """Return a table of the motions of a cast: which colour is which, and where each ends.

    How far it ends from the measured one is in % of the cable's length [m]. For swings it is how
    near each comes to the target [m], shape [k].
    """
    ends, rows = {kind: cast.path[-1] for kind, cast in casts.items()}, []
    for kind, end in ends.items():
        color = f'<span style="color: rgb{FIGURE_COLORS[kind]}">■</span> {kind}'
        if len(end) == 3:
            miss = float(closest(casts[kind].path, target)[0])
            rows.append((color, f"{100 * miss:.1f} cm" if math.isfinite(miss) else "not seen"))
            continue
        place = f"{end[0]:.2f}, {end[1]:.2f} m" if np.all(np.isfinite(end)) else "not seen"
        apart = 100 * float(np.linalg.norm(end - ends.get("measured", np.nan))) / length
        share = f"{apart:.1f} %" if kind != "measured" and math.isfinite(apart) else ""
        rows.append((color, place, share))
    heads = ("motion", "ends at", "from measured") if len(target) == 2 else ("motion", "misses by")
    return markdown_table(heads, rows)
