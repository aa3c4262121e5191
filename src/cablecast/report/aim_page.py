"""The report of aiming: one HTML file that says first which targets were hit."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.aiming.session import AimSession, Stop
from cablecast.cast import Cast, TrialStatus
from cablecast.evaluation.evaluate import Evaluation, trial_rows
from cablecast.report.page import (
    error_table,
    paper_figures,
    player_data,
    render_template,
    rig_names,
    run_settings,
    shared_figures,
)
from cablecast.report.style import svg_uri
from cablecast.report.tables import Row, Table, flatten_settings, pct
from cablecast.report.tries import (
    PANELS_MAX,
    joint_curves,
    target_panels,
    tracking_error,
    tries_map,
)
from cablecast.report.words import chance_text, miss_text, place_text, stop_text, verdict_text
from cablecast.setup import Setup

Beyond = tuple[NDArray[np.float64], str]
"""Target that is out of reach [m], shape [2], and why in words."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tried:
    """Outcome of one call of `aim`.

    Attributes:
        session: Session that the casts belong to.
        every: Every try at every target.
        stops: Why no further cast was made at each target; None if it was hit, or if all tries were
            used.
        beyond: Further targets, which are out of reach.
    """

    session: AimSession
    every: Evaluation
    stops: Sequence[Stop | None]
    beyond: Sequence[Beyond] = ()

    @property
    def tries(self) -> list[list[Cast]]:
        """Casts at each target, in order."""
        tries: list[list[Cast]] = [[] for _ in self.every.target_xy]
        for index, cast in zip(self.every.target_index.tolist(), self.every.casts, strict=True):
            tries[index].append(cast)
        return tries

    @property
    def last(self) -> Evaluation:
        """The last try at each target that was cast at."""
        index = self.every.target_index
        return self.every.rows(np.flatnonzero(np.append(index[1:] != index[:-1], len(index) > 0)))

    def map(self) -> Any:
        """Return the map of the tries, a figure."""
        return tries_map(
            self.every,
            within_pct=self.session.config.within_pct,
            beyond_xy=[xy for xy, _ in self.beyond],
        )


def aim_page(tried: Tried, config: Mapping[str, Any]) -> str:
    """Return the whole page, figures inside; it refers to no other file and no other host.

    Args:
        tried: Targets and tries.
        config: Contents of config.json.
    """
    session, every, tries = tried.session, tried.every, tried.tries
    setup, within_pct = session.setup, session.config.within_pct
    info = session.model.policy.model.info
    kind, rig_name = rig_names(every, config)
    published = paper_figures(every)
    misses_pct = [casts[0].miss_pct for casts in tries if casts]
    figures = {"tries": svg_uri(tried.map())}
    if len(tries) <= PANELS_MAX:
        figures["panels"] = svg_uri(target_panels(every, within_pct))
    if joints := joint_curves(every.casts, setup):
        figures["joints"] = svg_uri(joints)
    figures |= shared_figures(every, info)
    return render_template(
        "aim.html",
        cable=setup.cable,
        rig_name=rig_name,
        rig_kind=kind,
        verdict=verdict_text(tries, len(tried.beyond)),
        hit_count=sum(any(cast.hit for cast in casts) for casts in tries),
        first_count=sum(casts[0].hit for casts in tries if casts),
        asked=len(tries) + len(tried.beyond),
        within_pct=within_pct,
        cast_count=len(every.casts),
        known_count=len(session.active_casts()) - len(every.casts),
        lost=[(s, n) for s, n in every.status_counts.items() if n and s is not TrialStatus.OK],
        ok_count=every.status_counts[TrialStatus.OK],
        first_miss_pct=np.median(np.nan_to_num(misses_pct, nan=np.inf)) if misses_pct else np.nan,
        targets=_target_rows(tried),
        arm=_arm_table(every.casts, setup),
        errors=error_table(tried.last, rig_name, published) if published else None,
        model=info.get("metrics", {}),
        fitted_count=session.fitted_count,
        figures=figures,
        player=player_data(every),
        trials=trial_rows(every),
        settings=[
            ("Aiming", flatten_settings(config["settings"])),
            ("Rig", flatten_settings(every.rig)),
            *run_settings(config),
        ],
        pct=pct,
    )


def _target_rows(tried: Tried) -> list[tuple[str, str, str]]:
    """Return each target, its outcome, and the miss of each try."""
    rows = []
    for xy, casts, stop in zip(tried.every.target_xy, tried.tries, tried.stops, strict=True):
        # A number and its unit stay on one line.
        misses = ", ".join(_try_text(cast).replace(" ", "\u00a0") for cast in casts)
        rows.append((place_text(xy), _outcome_text(casts, stop), misses))
    return rows + [(place_text(xy), f"out of reach: {why}", "") for xy, why in tried.beyond]


def _try_text(cast: Cast) -> str:
    """Return how far a try missed, and the chance of a hit that was stated before it."""
    if cast.proposal is None:
        return miss_text(cast)
    return f"{miss_text(cast)} ({chance_text(cast.proposal.hit_chance)})"


def _outcome_text(casts: Sequence[Cast], stop: Stop | None) -> str:
    """Return the outcome at a target in words."""
    hits = [cast.try_number for cast in casts if cast.hit]
    if hits:
        return f"hit at try {hits[0]}"
    if stop is None:
        return f"missed by all {len(casts)} tries" if len(casts) > 1 else "missed by its only try"
    left = f"left after {len(casts)} tries" if len(casts) > 1 else "left after one try"
    return f"{left if casts else 'not cast at'}: {stop_text(stop)}"


def _arm_table(casts: Sequence[Cast], setup: Setup) -> Table:
    """Return a row for each cast: demands on the joints, and how they followed."""
    names, limits = setup.arm.joint_names, setup.arm.limits
    rows = []
    for cast in casts:
        path = cast.joint_path
        if path is None:
            continue
        room = np.array(limits.position) - np.abs(path.q - np.array(limits.middle)).max(axis=0)
        speed = path.peak_speed / np.array(limits.velocity)
        steps = np.diff(path.times)[:, None]
        jerked = np.abs(np.diff(path.qd, axis=0) / steps).max(axis=0)
        hardest = jerked / np.array(limits.acceleration)
        error = np.degrees(np.abs(tracking_error(cast)[1]))
        cells = [
            f"{place_text(cast.target_xy)}, try {cast.try_number}",
            f"{cast.duration:.2f} s",
            f"{np.degrees(room.min()):.0f}° ({names[int(room.argmin())]})",
            f"{100 * speed.max():.0f} % ({names[int(speed.argmax())]})",
            f"{100 * hardest.max():.0f} % ({names[int(hardest.argmax())]})",
            f"{error.max():.1f}° ({names[int(error.max(axis=0).argmax())]})" if error.size else "–",
        ]
        rows.append(Row(tuple(cells)))
    heads = ("cast", "duration", "nearest to a limit of angle")
    heads += ("largest speed", "largest acceleration", "largest tracking error")
    return Table(title="", heads=heads, rows=tuple(rows))
