"""Words of the page, in Markdown: the state of the table, a plan, the tries, the map."""

import math
from collections.abc import Mapping

import numpy as np

from cablecast.cast import Cast, Proposal
from cablecast.conventions import xy_to_polar
from cablecast.report.tables import markdown_table
from cablecast.report.words import hit_text, motion_text, place_text
from cablecast.runs.progress import duration_text
from cablecast.view.desk import Desk, Phase, Preview
from cablecast.view.look import ShownCast
from cablecast.view.scene import EXPECTED_SHARE, FIGURE_COLORS
from cablecast.view.shapes import GREEN, INK, MAP_COLORS, MAP_FULL_SHARE, VERMILLION
from cablecast.view.worker import WorkState

_ROWS = 5  # Tries at any target in the table; the others can be chosen from the list below it.
_WORTH_SAYING = 0.1  # Chance of a cast without a landing that is worth a line.

# The first three are the steps of `prepare_aim`.
_TOUR = (
    "**Cast a few times.** The rig casts, and it is seen where the cable goes.",
    "**Fit.** The simulated cable is changed until it moves as yours did.",
    "**Simulate.** It casts in every way that the arm can move.",
    "**Point.** Choose a target with a click: a ghost shows the planned cast.",
    "**Cast.** Watch the cable, and read how far it missed. Then correct, and cast again.",
)
_PREPARED_COUNT = 3


def tour_text(desk: Desk, state: WorkState) -> str:
    """Return the steps up to the first cast with the present one marked; nothing after that."""
    if desk.tries:
        return ""
    if desk.session is None:
        now = min(max(state.step, 1), _PREPARED_COUNT) if state.name else 0
    else:
        now = _PREPARED_COUNT + (1 if desk.preview is None else 2)
    lines = []
    for number, what in enumerate(_TOUR, start=1):
        mark = "✓" if number < now else "▶" if number == now else "○"
        lines.append(f"{mark} {what}")
    return "\n\n".join(lines)


def status_text(desk: Desk, state: WorkState) -> str:
    """Return the state of the table, and what to do next."""
    if state.name:
        return work_text(state)
    phase, last, news = desk.phase, desk.last, state.message or desk.message
    head, length = phase.value, desk.setup.cable.length
    if phase is Phase.PLANNED and desk.stop:
        head = "This cast is unlikely to hit. Choose another target."
    if phase in (Phase.LANDED, Phase.DONE) and last is not None and math.isfinite(last.miss_pct):
        verdict = "Hit" if last.hit else "Landed"
        head = f"{verdict}: {_length_text(last.miss_pct, length)} from the target. {head}"
    if desk.stop and not state.message:
        news = f"another cast is not worth it: {desk.stop}" if phase is Phase.DONE else desk.stop
    return f"**{head}**" + (f"\n\n{news[:1].upper()}{news[1:]}" if news else "")


def _length_text(pct: float, length: float) -> str:
    """Return a share of the cable's length [%] in centimetres, too."""
    return f"{pct * length:.1f} cm ({pct:.1f} %)"


def work_text(state: WorkState) -> str:
    """Return the work under way, how far it is, and how long it still takes."""
    text = f"**{state.name[:1].upper()}{state.name[1:]} is under way.**"
    if state.progress is not None:
        progress = state.progress
        text += f"\n\n{progress.task}"
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
    r, theta = xy_to_polar(proposal.goal.value)
    half, most = (100 * proposal.expected.miss_within(proposal.goal, p) for p in (0.5, 0.9))
    shares, names = 100.0 * preview.limit_shares, desk.setup.arm.joint_names
    fastest, hardest = (int(np.argmax(row)) for row in shares)
    rows = [
        ("target", f"{r:.3f} m, {math.degrees(theta):z.1f}°, try {proposal.try_number}"),
        ("chance of a hit", hit_text(proposal, tries)),
        ("most likely", f"{_length_text(half, length)} off"),
        ("nine of ten", f"within {_length_text(most, length)}"),
        ("duration", motion_text(proposal)),
        ("joint speed", f"{shares[0, fastest]:.0f} % of its limit ({names[fastest]})"),
        ("joint accel.", f"{shares[1, hardest]:.0f} % of its limit ({names[hardest]})"),
        ("table's edge", f"{100 * preview.margin:.0f} cm away"),
    ]
    if proposal.expected.failure > _WORTH_SAYING:
        rows.append(
            ("may fail", f"{100 * proposal.expected.failure:.0f} % hidden or off the table")
        )
    return markdown_table(("plan", ""), rows)


def _landing_text(proposal: Proposal, desk: Desk) -> str:
    """Return how the last cast landed next to what was expected of it, as a table."""
    length = desk.setup.cable.length
    rows = [("target", place_text(proposal.goal.value))]
    last = desk.last
    if last is not None and last.landed:
        off = 100 * float(
            proposal.goal.task.miss(last.outcome, proposal.expected.mean, proposal.setup)
        )
        inside = proposal.expected.holds(last.outcome, EXPECTED_SHARE)
        often = "nine" if inside else "one"
        rows += [
            ("missed by", _length_text(last.miss_pct, length)),
            ("error of the forecast", _length_text(off, length)),
            ("purple ellipse", f"landed {'in' if inside else 'out'}side, as {often} of ten do"),
        ]
    return markdown_table((f"try {proposal.try_number}", ""), rows)


def tries_text(desk: Desk) -> str:
    """Return the last tries, and all at the target of the plan, as a table."""
    rows, preview = [], desk.preview
    here = None if preview is None else preview.proposal.goal.value
    for one in desk.tries:
        if one not in desk.tries[-_ROWS:] and (here is None or not one.is_at(here)):
            continue
        miss = one.status.code.replace("_", " ")
        if math.isfinite(one.miss_pct):
            miss = _length_text(one.miss_pct, desk.setup.cable.length)
        if desk.is_undone(one):
            miss = f"~~{miss}~~"
        if one.hit:
            miss = f'<span style="color: rgb{GREEN}">✓ **{miss}**</span>'
        rows.append((f"{one.try_number}", place_text(one.target_xy), miss))
    return markdown_table(("try", "target", "miss"), rows)


def try_name(one: Cast) -> str:
    """Return the name of a try in a list."""
    return f"{one.number}: {place_text(one.target_xy)}, try {one.try_number}"


def colors_text() -> str:
    """Return what the colours on the table mean, as HTML."""
    rows = (
        (FIGURE_COLORS["measured"], "the cable as it was seen"),
        (FIGURE_COLORS["plan"], "the plan, and where nine of ten land"),
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


def legend_text(length: float) -> str:
    """Return the scale of the map of expected misses, for a cable's length [m], as HTML."""
    colors = ", ".join(f"rgb({r:.0f}, {g:.0f}, {b:.0f})" for r, g, b in MAP_COLORS)
    ends = 100.0 * MAP_FULL_SHARE * length * np.linspace(0.0, 1.0, len(MAP_COLORS))
    ticks = "".join(f"<span>{end:.0f} cm</span>" for end in ends[:-1])
    return (
        '<div style="margin: 0 1em 0.8em; font-size: 0.85em">Expected miss of a first cast'
        f'<div style="height: 1em; background: linear-gradient(90deg, {colors})"></div>'
        '<div style="display: flex; justify-content: space-between">'
        f"{ticks}<span>{ends[-1]:.0f} cm and more</span></div></div>"
    )


def motions_text(casts: Mapping[str, ShownCast], length: float) -> str:
    """Return a table of the motions of a cast: which colour is which, and where each ends.

    How far it ends from the measured one is in % of the cable's length [m].
    """
    ends, rows = {kind: cast.endpoint_xy[-1] for kind, cast in casts.items()}, []
    for kind, end in ends.items():
        place = f"{end[0]:.2f}, {end[1]:.2f} m" if np.all(np.isfinite(end)) else "not seen"
        apart = 100 * float(np.linalg.norm(end - ends.get("measured", np.nan))) / length
        share = f"{apart:.1f} %" if kind != "measured" and math.isfinite(apart) else ""
        color = f'<span style="color: rgb{FIGURE_COLORS[kind]}">■</span>'
        rows.append((f"{color} {kind}", place, share))
    return markdown_table(("motion", "ends at", "from measured"), rows)
