"""Words of the page, in Markdown: the state of the table, a plan, the tries, the map."""

import math

import numpy as np

from cablecast.cast import Cast
from cablecast.conventions import xy_to_polar
from cablecast.runs.progress import duration_text
from cablecast.view.desk import Desk, Phase, Preview
from cablecast.view.scene import EXPECTED_SHARE
from cablecast.view.shapes import MAP_COLORS, MAP_FULL_SHARE, Color
from cablecast.view.worker import WorkState

_ROWS = 5  # Tries in the table; the others can be chosen from the list below it.
_WORTH_SAYING = 0.1  # Chance of a cast without a landing that is worth a line.

# The first four are the steps of `prepare_aim`.
_TOUR = (
    "**Cast a few times.** The rig casts, and it is seen where the cable goes.",
    "**Fit.** The simulated cable is changed until it moves as yours did.",
    "**Simulate.** It casts in every way that the arm can move.",
    "**Train.** A model predicts where those casts land.",
    "**Point.** Choose a target with a click: a ghost shows the planned cast.",
    "**Cast.** Watch the cable, and read how far it missed. Then correct, and cast again.",
)
_PREPARED_COUNT = 4


def tour_text(desk: Desk, state: WorkState) -> str:
    """Return the steps up to the first cast with the present one marked; nothing after that."""
    if desk.tries:
        return ""
    if desk.session is None:
        now = max(state.step, 1) if state.name else 0
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
    news = state.message or desk.message
    last = desk.last
    head = desk.phase.value
    if desk.phase is Phase.LANDED and last is not None and math.isfinite(last.miss_pct):
        verdict = "Hit" if last.hit else "Landed"
        centimetres = last.miss_pct * desk.setup.cable.length
        head = f"{verdict}: {centimetres:.1f} cm ({last.miss_pct:.1f} %) from the target. {head}"
    return f"**{head}**" + (f"\n\n{news[:1].upper()}{news[1:]}" if news else "")


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
    """Return what to expect of a plan, as a table."""
    proposal, length = preview.proposal, desk.setup.cable.length
    r, theta = xy_to_polar(proposal.target_xy)
    offset = float(np.linalg.norm(proposal.expected_xy - proposal.target_xy))
    major, minor = 100.0 / length * proposal.ellipse(EXPECTED_SHARE).semi_axes
    shares, names = 100.0 * preview.limit_shares, desk.setup.arm.joint_names
    fastest, hardest = (int(np.argmax(row)) for row in shares)
    rows = [
        ("target", f"{r:.3f} m, {math.degrees(theta):.1f}°, try {proposal.try_number}"),
        ("expected", f"{100 * offset:.1f} cm ({100 * offset / length:.1f} %) beside it"),
        (f"{100 * EXPECTED_SHARE:.0f} % land", f"within {major:.0f} by {minor:.0f} %"),
        ("duration", f"{proposal.trajectory.duration:.2f} s"),
        ("joint speed", f"{shares[0, fastest]:.0f} % of its limit ({names[fastest]})"),
        ("joint accel.", f"{shares[1, hardest]:.0f} % of its limit ({names[hardest]})"),
        ("table's edge", f"{100 * preview.margin:.0f} cm away"),
    ]
    if proposal.failure > _WORTH_SAYING:
        rows.append(("may fail", f"{100 * proposal.failure:.0f} % hidden or off the table"))
    lines = ["| plan | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)]
    if not proposal.inside_coverage:
        lines.append("\nNo simulated cast lands here: this is the nearest.")
    return "\n".join(lines)


def tries_text(desk: Desk) -> str:
    """Return the last tries as a table."""
    lines = ["| try | target | miss |", "|---|---|---|"]
    for one in desk.tries[-_ROWS:]:
        miss = one.status.code.replace("_", " ")
        if math.isfinite(one.miss_pct):
            miss = f"{one.miss_pct * desk.setup.cable.length:.1f} cm, {one.miss_pct:.1f} %"
        if desk.is_undone(one):
            miss = f"~~{miss}~~"
        if one.hit:
            miss = f"**{miss}**"
        lines.append(f"| {one.try_number} | {_target_text(one)} | {miss} |")
    return "\n".join(lines)


def try_name(one: Cast) -> str:
    """Return the name of a try in a list."""
    return f"{one.number}: {_target_text(one)}, try {one.try_number}"


def _target_text(one: Cast) -> str:
    r, theta = xy_to_polar(one.target_xy)
    return f"{r:.2f} m, {math.degrees(theta):.0f}°"


def legend_text() -> str:
    """Return what the colours of the map of expected misses mean."""
    shares = 100.0 * MAP_FULL_SHARE * np.linspace(0.0, 1.0, len(MAP_COLORS))
    scale = ", ".join(
        f"{swatch(tuple(color))} {share:.3g}"
        for color, share in zip(MAP_COLORS.astype(int), shares, strict=True)
    )
    return (
        "Expected miss of a first cast, with what an action that is off by 1° and 1 cm adds, in % "
        f"of the cable's length: {scale} and more"
    )


def swatch(color: Color) -> str:
    """Return a small square in a colour."""
    red, green, blue = color
    return f'<span style="color: rgb({red},{green},{blue})">■</span>'
