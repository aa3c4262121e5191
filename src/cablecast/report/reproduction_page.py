"""The report of a reproduction: one HTML page with every experiment beside the published one."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import cablecast
from cablecast.evaluation.published import PUBLISHED_ROWS, published_repeatability
from cablecast.report.reproduction import BEST_METHOD, Reproduction
from cablecast.report.reproduction_parts import all_parts
from cablecast.report.tables import BEST_METHOD_PUBLISHED, Row, Table, time_table
from cablecast.report.template import template_environment
from cablecast.report.text import flatten_settings, pct
from cablecast.tuning.published import published_tuning


def reproduction_page(
    results: Reproduction, config: Mapping[str, Any], times: Sequence[tuple[str, float]]
) -> tuple[str, list[Table]]:
    """Return the whole page, figures inside; it refers to no other file and no other host.

    Args:
        results: Run folders; they tell the set-up of each cable as well.
        config: The reproduction's config.json.
        times: Title and time [s] of each stage.

    Returns:
        Page, and its tables in their order.
    """
    environment = template_environment()
    budget, rig = config["settings"]["budget"], config["settings"]["rig"]
    parts = all_parts(results)
    difficulty, took = difficulty_table(results), time_table(times)
    page = environment.get_template("reproduction.html").render(
        version=cablecast.__version__,
        rig_phrase=_RIG_PHRASES.get(rig, f"on the rig {rig}"),
        target_count=target_count(results),
        repeats_phrase="once each" if budget["repeats"] == 1 else f"{budget['repeats']} times each",
        cables_phrase=_cables_phrase(results.cables),
        simulated_count=budget["casts"],
        cards=_cards(results),
        rig_paragraphs=_RIG_TEXTS.get(rig, _RIG_TEXTS[""]),
        parts=parts,
        tables={"difficulty": difficulty, "times": took},
        settings=_settings(results, config),
    )
    tables = [difficulty] if difficulty else []
    tables += [table for part in parts for table in part.tables]
    return page, [*tables, took]


_RIG_PHRASES = {"virtual": "on a virtual rig", "engine": "in a simulator"}

_RIG_TEXTS = {
    "virtual": [
        "No real robot moved. The casts were carried out on the virtual rig, a laboratory in "
        "software: another physics engine than the one that the method learns with, cables whose "
        "true parameters nothing outside the laboratory reads, an arm that lags behind its set "
        "points, a table whose friction differs from place to place, a reset that never ends in "
        "quite the same state, and a camera that errs.",
        "A laboratory that is too easy would flatter the method. The difficulty of this one was "
        "set by hand to what was published of the real one: the table below says how far each "
        "measure of it is from the paper's.",
    ],
    "engine": [
        "No real robot moved, and no laboratory stood in for it: the casts were carried out in the "
        "same kind of simulator that the method learns with. The errors below are those of "
        "learning and planning alone; they cannot be compared with the paper's.",
    ],
    "": ["The casts were carried out on the rig named above; the figures are what it reported."],
}


def _cables_phrase(cables: Sequence[str]) -> str:
    return f"the cable {cables[0]}" if len(cables) == 1 else f"{len(cables)} different cables"


def target_count(results: Reproduction) -> int:
    """Return the number of targets that were cast at."""
    evaluations = [m for cable in results.cables for m in results.evaluations(cable).values()]
    return max((metrics["target_count"] for metrics in evaluations), default=0)


def _cards(results: Reproduction) -> list[dict[str, str]]:
    """Return the figures that a reader should see first."""
    cards = []
    for cable, metrics in results.best_evaluations().items():
        paper = next(
            (r for r in PUBLISHED_ROWS if (r.cable, r.method) == (cable, BEST_METHOD_PUBLISHED)),
            None,
        )
        beside = f"; the paper's robot: {paper.median_pct:.0f} %" if paper else ""
        cards.append(
            {
                "value": pct(metrics["errors_pct"]["median_pct"]),
                "unit": "%",
                "text": f"median error with {cable}, in % of its length{beside}",
            }
        )
    return cards


def difficulty_table(results: Reproduction) -> Table | None:
    """Compare the rig's difficulty with the real one's: what was measured before any learning."""
    rows = []
    for cable, metrics in results.tunings().items():
        paper = published_tuning(cable)
        rows.append(
            Row(
                cells=(
                    f"{cable}: median distance at rest of an untuned simulator",
                    pct(metrics["validation"]["default"]["final_median_pct"]),
                    pct(paper.default_final_pct) if paper else "",
                )
            )
        )
    selection = results.metrics(results.cables[0], "select") or {"coverage": []}
    for result in selection["coverage"]:
        repeated = result["repeatability"]
        if repeated is None:
            continue
        name = f"v_max {result['v_max']:g} m/s" + " with psi" * result["with_psi"]
        paper = published_repeatability(result["v_max"], result["with_psi"])
        scatter = repeated["scatter_pct"]
        rows.append(
            Row(
                cells=(
                    f"{name}: scatter of equal casts",
                    pct(math.nan if scatter is None else scatter, 2),
                    pct(paper.scatter_pct, 2) if paper else "",
                )
            )
        )
        off_table = paper.off_table_share if paper else None
        rows.append(
            Row(
                cells=(
                    f"{name}: casts that left the table [%]",
                    pct(100 * repeated["off_table_share"]),
                    "" if off_table is None else pct(100 * off_table),
                )
            )
        )
    if not rows:
        return None
    return Table(
        title="How difficult the rig is",
        heads=("in % of cable length, unless stated otherwise", "here", "paper"),
        rows=tuple(rows),
    )


def _settings(
    results: Reproduction, config: Mapping[str, Any]
) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return titles and lines of the settings at the end of the page."""
    found = [("The whole", flatten_settings(config["settings"]))]
    for cable in results.cables:
        if (metrics := results.metrics(cable, "tune")) is not None:
            found.append((f"Tuned parameters of {cable}", flatten_settings(metrics["params"])))
    evaluation = results.metrics(results.cables[0], f"evaluate-{BEST_METHOD}")
    if evaluation is not None:
        found.append(("Rig", flatten_settings(evaluation["rig"])))
    found.append(("Versions", flatten_settings(config["versions"])))
    facts = {name: config[name] for name in ("commit", "started", "cpu_count") if name in config}
    return [*found, ("Run", flatten_settings(facts))]
