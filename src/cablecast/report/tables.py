"""Tables of results, each made once: as HTML in a report, as Markdown for a README, as text.

Errors are in % of cable length. Rows of the paper stand below ours.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from cablecast.evaluation.coverage import PUBLISHED_CANDIDATES
from cablecast.evaluation.published import (
    METHOD_NAMES,
    PublishedRow,
    published_row,
    published_rows,
    published_tuning,
)
from cablecast.runs.folder import flat_settings

Metrics = Mapping[str, Any]
"""Contents of the metrics.json of one stage."""

FIVE_NUMBERS = (
    "median_pct",
    "first_quartile_pct",
    "third_quartile_pct",
    "min_pct",
    "max_pct",
)
FIVE_HEADS = ("median", "1st quartile", "3rd quartile", "min", "max")


def pct(value: float | None, digits: int = 1) -> str:
    """Return a percentage, a dash for a missing value (None, NaN), "miss" for an infinite one.

    >>> pct(12.345), pct(None), pct(math.inf)
    ('12.3', '–', 'miss')
    """
    if value is None or math.isnan(value):
        return "–"
    return "miss" if math.isinf(value) else f"{value:.{digits}f}"


def share_pct(value: float | None) -> str:
    """Return a part of a whole as a percentage with its sign, a dash for a missing value.

    >>> share_pct(0.129), share_pct(None)
    ('12.9 %', '–')
    """
    return pct(value) if value is None or math.isnan(value) else f"{pct(100 * value)} %"


def five_cells(summary: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the five numbers of a summary of errors, as `ErrorSummary.to_dict` returns it.

    JSON has no infinity: where there are errors but a number is missing, it is a miss.
    """
    missing = math.inf if summary["count"] else math.nan
    values = (summary[name] for name in FIVE_NUMBERS)
    return tuple(pct(missing if value is None else value) for value in values)


def published_cells(row: PublishedRow) -> tuple[str, ...]:
    """Return the five numbers of a row of the paper, which prints whole percents."""
    return tuple(f"{getattr(row, name):.0f}" for name in FIVE_NUMBERS)


def flatten_settings(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return nested settings as lines of a table: dotted names and readable values.

    >>> flatten_settings({"arm": {"model": "ur5"}, "seed": 0})
    [('arm.model', 'ur5'), ('seed', '0')]
    """
    lines = []
    for name, value in flat_settings(values):
        is_list = isinstance(value, Sequence) and not isinstance(value, str)
        lines.append((name, ", ".join(map(_plain, value)) if is_list else _plain(value)))
    return lines


def _plain(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in GitHub's Markdown, which a bar in a text would break."""
    lines = [heads, [":--"] * len(heads), *rows]
    cells = ([text.replace("|", "&#124;") for text in line] for line in lines)
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)


class Row(NamedTuple):
    """One row of a table: its cells, the first being its name, and its kind, which is its style.

    The kind is "ours", "paper", "paper first" (below a line), or empty.
    """

    cells: tuple[str, ...]
    kind: str = ""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Table:
    """A table with a title, which is empty in a report that has its own, and a note below it."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[Row, ...]
    note: str = ""

    def to_markdown(self) -> str:
        """Return the table in Markdown, with its title and note."""
        rows = [
            [f"**{cell}**" if row.kind == "ours" and cell else cell for cell in row.cells]
            for row in self.rows
        ]
        lines = [f"**{self.title}**", "", markdown_table(self.heads, rows)]
        if self.note:
            lines += ["", self.note]
        return "\n".join(lines) + "\n"


def paper_rows(rows: Sequence[PublishedRow]) -> list[Row]:
    """Return rows of the paper as they stand below ours, without a count of casts."""
    return [
        Row(
            (f"paper, table {row.table}: {row.method}", "", *published_cells(row)),
            "paper" if number else "paper first",
        )
        for number, row in enumerate(rows)
    ]


def _error_row(name: str, metrics: Metrics, key: str, kind: str) -> Row:
    landed = metrics["status_counts"].get("ok", 0)
    count = f"{landed} of {metrics['trial_count']}"
    return Row((name, count, *five_cells(metrics[key])), kind)


def method_table(
    evaluations: Mapping[str, Metrics], key: str, title: str, *, published: bool = True
) -> Table:
    """Make table II from metrics by method: every method on cable 1, and the paper's rows below.

    `key` names the summary of errors, e.g. `errors_pct`. The paper counts no misses.
    """
    medians = {method: metrics[key]["median_pct"] for method, metrics in evaluations.items()}
    best = min(
        (method for method, median in medians.items() if median is not None),
        key=lambda method: medians[method],
        default=None,
    )
    rows = [
        _error_row(METHOD_NAMES[method], metrics, key, "ours" if method == best else "")
        for method, metrics in evaluations.items()
    ]
    if published:
        rows += paper_rows(published_rows("cable_1"))
    return Table(title=title, heads=("method", "landed", *FIVE_HEADS), rows=tuple(rows))


def cable_table(
    evaluations: Mapping[str, Metrics], key: str, title: str, *, published: bool = True
) -> Table:
    """Make table III from metrics by cable: the best method, each with the paper's row."""
    rows = []
    for cable, metrics in evaluations.items():
        rows.append(_error_row(cable, metrics, key, "ours"))
        if published and (row := published_row(cable)) is not None:
            rows.append(Row((f"paper: {cable}", "", *published_cells(row)), "paper"))
    return Table(title=title, heads=("cable", "landed", *FIVE_HEADS), rows=tuple(rows))


SPLIT_PARTS = {
    "repeatability": "equal casts land apart",
    "mismatch": "the simulator is not the rig",
    "model": "the model is not the simulator",
    "plan": "no cast is expected to land on the target",
}
"""Cause of each part of an error, in words; see `cablecast.evaluation.evaluate`."""


def measured_table(evaluations: Mapping[str, Metrics], cable: str) -> Table:
    """Make a table of what each method covers and how well it predicts, by method."""
    rows = [
        Row(
            (
                METHOD_NAMES[method],
                f"{metrics['targets_inside_coverage']} of {metrics['target_count']}",
                pct(metrics["errors_inside_coverage_pct"]["median_pct"]),
                pct(metrics["prediction_errors_pct"]["median_pct"]),
            )
        )
        for method, metrics in evaluations.items()
    ]
    return Table(
        title=f"Where the errors on {cable} start",
        heads=("method", "targets in its coverage", "median error there", "from the expected"),
        rows=tuple(rows),
        note="A target is in the coverage of a method that expects one of its casts to land there. "
        "From the expected: median distance between the expected and the actual landing of a "
        "cast, whatever the target. In % of cable length.",
    )


def split_table(evaluations: Mapping[str, Metrics]) -> Table | None:
    """Make a table of errors split into their causes, by name; None where none was split."""
    splits = {
        name: metrics["error_split"]
        for name, metrics in evaluations.items()
        if metrics.get("error_split")
    }
    if not splits:
        return None
    rows = []
    for name, split in splits.items():
        # A part that was not measured is not there.
        parts = [part for part in SPLIT_PARTS if split["parts"].get(part, {}).get("rms_pct")]
        rows.append(Row((name, "", pct(split["rms_pct"]), "100"), "ours"))
        for part in parts:
            values = split["parts"][part]
            cells = (pct(values["median_pct"]), pct(values["rms_pct"]), pct(values["share_pct"], 0))
            rows.append(Row((SPLIT_PARTS[part], *cells)))
        outside = split["outside_coverage"]
        count = f"{outside['cast_count']} of {split['cast_count']} casts"
        name = f"at targets outside the coverage: {count}"
        rows.append(Row((name, "", "", pct(outside["share_pct"], 0))))
    note = (
        "Median and root mean square of the length of each part, in % of cable length, over the "
        "casts that landed; and its share in the mean square of the whole error. The parts are "
        "vectors that add up to the whole: one that pulls others back has a negative share."
    )
    if any(split["repeats"] == 1 for split in splits.values()):
        note += (
            " With one cast at each target, the scatter of equal casts cannot be told from the "
            "simulator's deviation."
        )
    heads = ("", "median", "rms", "share [%]")
    return Table(title="Errors, split", heads=heads, rows=tuple(rows), note=note)


def coverage_table(selection: Metrics) -> Table:
    """Make a table of the coverage of every combination, next to the paper's."""
    published = {(c.r0, c.v_max, c.with_psi): c for c in PUBLISHED_CANDIDATES}
    chosen = tuple(selection["choice"][name] for name in ("r0", "v_max", "with_psi"))
    rows = []
    for result in selection["coverage"]:
        key = (result["r0"], result["v_max"], result["with_psi"])
        paper = published.get(key)
        repeat = result.get("repeatability") or {}
        low, high = sorted(result["share_by_ratio"].values())
        same = result["same_angles"]["share"]
        same = None if same is None else 100 * same
        cells = (
            f"r0 = {key[0]:g} m, v_max = {key[1]:g} m/s" + ", psi" * key[2],
            str(result["feasible_count"]),
            pct(100 * result["share"]),
            f"{100 * low:.1f} to {100 * high:.1f}",
            f"{pct(same)} ({result['same_angles']['feasible_count']})",
            pct(100 * paper.coverage) if paper else "",
            pct(repeat.get("scatter_pct"), 2) if repeat else "",
            pct(repeat.get("distance_sd_pct"), 2) if repeat else "",
            pct(paper.scatter_pct, 2) if paper else "",
            pct(100 * repeat["off_table_share"]) if repeat else "",
            pct(100 * paper.off_table_share) if paper and paper.off_table_share else "",
        )
        rows.append(Row(cells, "ours" if key == chosen else ""))
    polar = selection["polar_casting"]["share"]
    rows.append(Row(("polar casting", "", pct(100 * polar), *[""] * 8)))
    ratio = selection["coverage"][0]["hull_ratio"]
    ratios = " and ".join(selection["coverage"][0]["share_by_ratio"])
    return Table(
        title="Coverage in % of the half disc, and repeatability in % of cable length",
        heads=(
            "",
            "casts",
            "coverage",
            f"with hull ratios {ratios}",
            "same angles at every r0 (casts)",
            "paper",
            "rms",
            "sd of distance",
            "paper",
            "off table",
            "paper",
        ),
        rows=tuple(rows),
        note=f"Coverage by concave hulls of ratio {ratio:g}; the paper does not state its own. "
        "Angles are those that the arm can make at each r0; the next to last of the columns of "
        "coverage has those of r0 = reset_y at every r0, of which the arm can follow few.",
    )


def tuning_table(tunings: Mapping[str, Metrics]) -> Table:
    """Make table I: the simulator's distance from the rig before and after tuning, by cable."""
    rows = []
    for cable, metrics in tunings.items():
        ours = [metrics["validation"][name] for name in ("default", "tuned")]
        distances = [pct(row[key]) for key in ("final_median_pct", "mean_pct") for row in ours]
        rows.append(Row((cable, *distances, f"{metrics['simulation_count']:,}"), "ours"))
        if (paper := published_tuning(cable)) is not None:
            final = (pct(paper.default_final_pct), pct(paper.tuned_final_pct))
            mean = (pct(paper.default_mean_pct), pct(paper.tuned_mean_pct))
            rows.append(Row((f"paper: {cable}", *final, *mean, "not stated"), "paper"))
    return Table(
        title="Distance between simulated and measured endpoints on validation casts",
        heads=(
            "",
            "at rest, default",
            "at rest, tuned",
            "on the way, default",
            "on the way, tuned",
            "simulations",
        ),
        rows=tuple(rows),
        note="At rest: median of the final distance. On the way: equation 4. In % of cable length.",
    )


def time_table(times: Sequence[tuple[str, float]]) -> Table:
    """Make a table of the time that each stage took, from their titles and times [s]."""
    rows = [Row((title, f"{seconds / 60:.1f}")) for title, seconds in times]
    total = sum(seconds for _, seconds in times)
    rows.append(Row(("all", f"{total / 60:.1f}"), "ours"))
    return Table(title="Time of each stage", heads=("stage", "min"), rows=tuple(rows))
