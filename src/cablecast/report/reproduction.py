"""The report of a reproduction: one HTML page with every experiment next to the published one."""

import base64
import dataclasses
import itertools
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cablecast.data.dataset import StoredSettings
from cablecast.errors import InputError
from cablecast.evaluation.evaluate import (
    DRAW_COUNT,
    ErrorSummary,
    share_of_smaller_median,
)
from cablecast.evaluation.published import (
    BEST_METHOD,
    METHOD_NAMES,
    published_row,
    published_rows,
)
from cablecast.files import read_csv
from cablecast.report.curves import error_boxes
from cablecast.report.maps import coverage_figure, ellipse_map
from cablecast.report.page import SettingsLists, render_template, run_settings
from cablecast.report.style import svg_uri
from cablecast.report.tables import (
    Table,
    cable_table,
    coverage_table,
    flatten_settings,
    measured_table,
    method_table,
    pct,
    split_table,
    time_table,
    tuning_table,
)
from cablecast.runs.folder import Parts
from cablecast.setup import Setup

_SETUP_STAGES = (*(f"evaluate-{method}" for method in METHOD_NAMES), "select", "repeat", "tune")
"""Stages whose settings hold the set-up; those that decide the figures come first."""

_TRIAL_NUMBERS = ("target", "target_x_m", "target_y_m", "landed_x_m", "landed_y_m", "error_pct")


class PagePicture(NamedTuple):
    """A picture inside the page, as a data URI, and the sentence below it."""

    uri: str
    caption: str


class Part(NamedTuple):
    """A section of the page: its heading, and text, tables and figures in this order."""

    title: str
    paragraphs: Sequence[str] = ()
    tables: Sequence[Table] = ()
    figures: Sequence[PagePicture] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class Reproduction:
    """Run folders of a reproduction: one folder per cable, and in it one per stage.

    Every method is tried on the first cable.
    """

    folder: pathlib.Path
    cables: tuple[str, ...]

    def metrics(self, cable: str, stage: str) -> dict[str, Any] | None:
        """Return metrics.json of a stage; None where the stage has not been run."""
        return Parts(self.folder / cable / stage).get("metrics")

    def setup(self, cable: str) -> Setup:
        """Return the set-up that a cable was cast with, as its stages recorded it."""
        for folder in (self.folder / cable / stage for stage in _SETUP_STAGES):
            if (config := Parts(folder).get("config")) is not None:
                return StoredSettings(config, str(folder)).setup
        raise InputError(f"{self.folder} holds no finished stage of {cable} that tells its set-up")

    def evaluations(self, cable: str) -> dict[str, dict[str, Any]]:
        """Return metrics.json of the evaluation of every method that was tried on a cable."""
        found = {method: self.metrics(cable, f"evaluate-{method}") for method in METHOD_NAMES}
        return {method: metrics for method, metrics in found.items() if metrics is not None}

    def by_cable(self, stage: str) -> dict[str, dict[str, Any]]:
        """Return metrics.json of a stage of every cable that it was run for."""
        found = {cable: self.metrics(cable, stage) for cable in self.cables}
        return {cable: metrics for cable, metrics in found.items() if metrics is not None}

    def trials(self, cable: str, method: str) -> dict[str, NDArray[np.float64]]:
        """Return columns of numbers of trials.csv of an evaluation; an empty cell is NaN."""
        file = self.folder / cable / f"evaluate-{method}" / "trials.csv"
        rows = read_csv(file, _TRIAL_NUMBERS)
        return {
            name: np.array([float(row[name] or "nan") for row in rows]) for name in _TRIAL_NUMBERS
        }

    def errors_by_target(self, cable: str, method: str) -> NDArray[np.float64]:
        """Return errors [% of cable length], NaN without a landing, shape [target, cast]."""
        trials = self.trials(cable, method)
        targets = np.unique(trials["target"])
        return np.stack([trials["error_pct"][trials["target"] == target] for target in targets])

    def picture(self, cable: str, stage: str, name: str, caption: str) -> tuple[PagePicture, ...]:
        """Return a PNG file that a stage left behind as a figure; nothing where it did not."""
        file = self.folder / cable / stage / name
        if not file.is_file():
            return ()
        uri = "data:image/png;base64," + base64.b64encode(file.read_bytes()).decode()
        return (PagePicture(uri=uri, caption=caption),)


def order_of_methods(results: Reproduction) -> list[str]:
    """Return sentences on our order of methods by their medians, and where the paper's differs."""
    cable = results.cables[0]
    paper = {row.method: row.median_pct for row in published_rows(cable)}
    medians = {
        method: metrics["errors_pct"]["median_pct"]
        for method, metrics in results.evaluations(cable).items()
        if metrics["errors_pct"]["median_pct"] is not None and METHOD_NAMES[method] in paper
    }
    if len(medians) < 2:
        return []
    ours = sorted(medians, key=lambda method: medians[method])
    listed = ", ".join(f"{METHOD_NAMES[method]} ({medians[method]:.1f} %)" for method in ours)
    sentences = [f"By their medians, from best to worst: {listed}."]
    for better, worse in itertools.combinations(ours, 2):
        theirs = [paper[METHOD_NAMES[method]] for method in (better, worse)]
        # The paper prints whole percents; two methods with the same one have no order there.
        if theirs[0] > theirs[1]:
            errors = [results.errors_by_target(cable, method) for method in (better, worse)]
            share = 100.0 * share_of_smaller_median(*errors)
            sentences.append(
                f"Unlike in the paper ({theirs[0]:.0f} and {theirs[1]:.0f} %), "
                f"{METHOD_NAMES[better]} is better than {METHOD_NAMES[worse]}. With the targets "
                f"drawn anew {DRAW_COUNT:,} times, it has the smaller median in {share:.0f} %; "
                "half would be chance."
            )
    return sentences if len(sentences) > 1 else [*sentences, "This is the paper's order."]


def tuning_part(results: Reproduction) -> Part | None:
    """Report section V-D: the simulator's distance from the rig before and after tuning."""
    tunings = results.by_cable("tune")
    if not tunings:
        return None
    lead = results.cables[0]
    for cable, metrics in results.by_cable("tune-more").items():
        tunings[f"{cable}, with {metrics['training_count']} casts"] = metrics
    return Part(
        title="Tuning the simulator (table I)",
        paragraphs=[
            "Differential Evolution looked for the ten parameters with which simulated endpoints "
            "stay nearest to measured ones, on some casts of the rig; the distances are those "
            "of other casts, which it never saw. Default parameters are those that were believed "
            "of the cable before anything was measured; the paper's are PyBullet's. The paper "
            "does not state how many simulations its search took. With 80 casts in place of 60 its "
            "distance on the way was 2 to 12 % larger.",
        ],
        tables=[tuning_table(tunings)],
        figures=results.picture(
            lead, "tune", "tracks.png", f"Measured and simulated tracks of {lead}, validation casts"
        ),
    )


def selection_part(results: Reproduction) -> Part | None:
    """Report section V-E: coverage and repeatability, and what was chosen."""
    selection = results.metrics(results.cables[0], "select")
    if selection is None:
        return None
    setup = results.setup(results.cables[0])
    figure = coverage_figure(selection, setup.workspace, setup.cable.length)
    ratio = selection["coverage"][0]["hull_ratio"]
    return Part(
        title="Choosing r0, v_max and psi (figures 6 and 7)",
        paragraphs=[
            *selection["choice"]["reasons"],
            "The paper chose r0 = 0.6 m and v_max = 1.5 m/s with psi.",
        ],
        tables=[coverage_table(selection)],
        figures=[
            PagePicture(
                uri=svg_uri(figure),
                caption="Where the casts of each combination come to rest: concave hulls of "
                f"ratio {ratio:g} within the half disc of radius "
                f"{selection['half_disc_radius_m']:.2f} m. "
                "Grey: what polar casting reaches. After figure 6 of the paper.",
            ),
            *results.picture(
                results.cables[0],
                "repeat",
                "repeatability.png",
                "Repeated landings with 95 % ellipses. After figure 7 of the paper.",
            ),
        ],
    )


def model_part(results: Reproduction) -> Part | None:
    """Report section V-F: training and fine-tuning of the model."""
    figures: list[PagePicture] = []
    sentences = []
    stage = f"model-{BEST_METHOD}"
    for cable, metrics in results.by_cable(stage).items():
        caption = f"Training of the model of {cable} on simulated casts, then on real ones."
        figures += results.picture(cable, stage, "learning_curve.png", caption)
        sentences.append(
            f"{cable}: on simulated casts that it had not seen the median error is "
            f"{metrics['held_out_median_pct']:.1f} % of the cable's length; on casts of the rig "
            f"{metrics['real_before_median_pct']:.1f} % before fine-tuning, and "
            f"{metrics['real_median_pct']:.1f} % after, each cast predicted by a model that was "
            "fine-tuned on the others."
        )
    if not sentences:
        return None
    return Part(
        title="Training the model of landings",
        paragraphs=[
            "A network is first trained on casts that were simulated with the tuned parameters, "
            "and then fine-tuned on casts of the rig.",
            *sentences,
        ],
        figures=figures,
    )


def method_part(results: Reproduction) -> Part | None:
    """Report section VI: every method on the first cable."""
    cable = results.cables[0]
    evaluations = results.evaluations(cable)
    if not evaluations:
        return None
    ours = [
        ("ours: " * (m != "ours") + METHOD_NAMES[m], ErrorSummary.from_dict(v["errors_pct"]))
        for m, v in evaluations.items()
    ]
    published = published_rows("cable_1")
    return Part(
        title="Every method on one cable (table II)",
        paragraphs=[
            "Distances from target to landing in % of cable length. As in the paper, casts that "
            "left the table or were hidden are left out of the first table; the second counts each "
            "as a miss.",
            *order_of_methods(results),
        ],
        tables=[
            method_table(evaluations, "errors_pct", f"Errors on {cable}"),
            method_table(
                evaluations,
                "errors_misses_counted_pct",
                f"Errors on {cable}, casts without a landing counted as misses",
                published=False,
            ),
            measured_table(evaluations, cable),
        ],
        figures=[
            PagePicture(
                uri=svg_uri(error_boxes(ours, published)),
                caption="The same errors as boxes, above those of the paper.",
            )
        ],
    )


def cable_part(results: Reproduction) -> Part | None:
    """Report section VI: the best method on every cable."""
    evaluations = results.by_cable(f"evaluate-{BEST_METHOD}")
    if not evaluations:
        return None
    figures = []
    for cable, metrics in evaluations.items():
        trials, workspace = results.trials(cable, BEST_METHOD), results.setup(cable).workspace
        figure = ellipse_map(trials, workspace, metrics["cable_length_m"])
        figures.append(
            PagePicture(
                uri=svg_uri(figure),
                caption=f"{cable}: targets (numbers), landings (dots), 95 % ellipses of equal "
                "casts as the paper draws them, where there are enough, and dashed lines from each "
                "target to the mean of its landings. A triangle marks a target with a cast that "
                "did not land. After figure 8 of the paper.",
            )
        )
    return Part(
        title="The best method on every cable (table III)",
        tables=[
            cable_table(evaluations, "errors_pct", f"Errors of the {METHOD_NAMES[BEST_METHOD]}"),
            cable_table(
                evaluations,
                "errors_misses_counted_pct",
                "The same, casts without a landing counted as misses",
                published=False,
            ),
            cable_table(
                results.by_cable("evaluate-ours"),
                "errors_pct",
                "Ours: the same models, casts searched for and refined",
                published=False,
            ),
        ],
        figures=figures,
    )


def split_part(results: Reproduction) -> Part | None:
    """Split the errors of every method on every cable into causes."""
    evaluations = {
        f"{METHOD_NAMES[method]}, {cable}": metrics
        for cable in results.cables
        for method, metrics in results.evaluations(cable).items()
    }
    if (table := split_table(evaluations)) is None:
        return None
    return Part(
        title="Where the errors come from",
        paragraphs=[
            "Each planned cast was also made in the tuned simulator. That splits the way from a "
            "target to a landing into steps with one cause each: what the plan leaves, the "
            "difference between the model and the simulator that it was trained on (fine-tuning "
            "makes them differ on purpose), the difference between the simulator and the rig, and "
            "the scatter of equal casts.",
        ],
        tables=[table],
    )


def reproduction_page(
    results: Reproduction, config: Mapping[str, Any], times: Sequence[tuple[str, float]]
) -> tuple[str, list[Table]]:
    """Return the whole page, figures inside, and its tables in their order.

    It refers to no other file and no other host. Stages have titles and times [s].
    """
    budget, rig = config["settings"]["budget"], config["settings"]["rig"]
    makers = (tuning_part, selection_part, model_part, method_part, cable_part, split_part)
    parts = [part for maker in makers if (part := maker(results)) is not None]
    took = time_table(times)
    evaluations = [m for cable in results.cables for m in results.evaluations(cable).values()]
    page = render_template(
        "reproduction.html",
        rig_phrase=_RIG_PHRASES.get(rig, f"on the rig {rig}"),
        target_count=max((metrics["target_count"] for metrics in evaluations), default=0),
        cables=results.cables,
        budget=budget,
        cards=_cards(results),
        rig=rig,
        parts=parts,
        times=took,
        settings=_settings(results, config),
    )
    return page, [*(table for part in parts for table in part.tables), took]


_RIG_PHRASES = {"virtual": "on a virtual rig", "engine": "in a simulator"}


def _cards(results: Reproduction) -> list[dict[str, str]]:
    """Return the figures that a reader should see first."""
    cards = []
    for cable, metrics in results.by_cable(f"evaluate-{BEST_METHOD}").items():
        paper = published_row(cable)
        beside = f"; the paper's robot: {paper.median_pct:.0f} %" if paper else ""
        cards.append(
            {
                "value": pct(metrics["errors_pct"]["median_pct"]),
                "text": f"median error with {cable}, in % of its length{beside}",
            }
        )
    return cards


def _settings(results: Reproduction, config: Mapping[str, Any]) -> SettingsLists:
    """Return titles and lines of the settings at the end of the page."""
    found = [("The whole", flatten_settings(config["settings"]))]
    for cable, metrics in results.by_cable("tune").items():
        found.append((f"Tuned parameters of {cable}", flatten_settings(metrics["params"])))
    evaluation = results.metrics(results.cables[0], f"evaluate-{BEST_METHOD}")
    if evaluation is not None:
        found.append(("Rig", flatten_settings(evaluation["rig"])))
    return [*found, *run_settings(config)]
