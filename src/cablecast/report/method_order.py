"""The order of methods by their errors, beside the paper's, with a measure of chance."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.evaluation.published import published_rows
from cablecast.report.reproduction import METHOD_NAMES, Reproduction

DRAW_COUNT = 2000
"""Number of times that the targets are drawn anew to tell the order of two methods from chance."""


def order_of_methods(results: Reproduction) -> list[str]:
    """Tell where our order of methods differs from the paper's, each case with its measure."""
    cable = results.cables[0]
    evaluations = results.evaluations(cable)
    paper = {row.method: row.median_pct for row in published_rows(cable)}
    medians = {
        method: metrics["errors_pct"]["median_pct"]
        for method, metrics in evaluations.items()
        if metrics["errors_pct"]["median_pct"] is not None and METHOD_NAMES[method] in paper
    }
    if len(medians) < 2:
        return []
    ours = sorted(medians, key=lambda method: medians[method])
    theirs = sorted(medians, key=lambda method: paper[METHOD_NAMES[method]])
    listed = ", ".join(f"{METHOD_NAMES[method]} ({medians[method]:.1f} %)" for method in ours)
    sentences = [f"By their medians, from best to worst: {listed}."]
    turned = {
        better: [
            worse
            for worse in ours[place + 1 :]
            if theirs.index(better) > theirs.index(worse)
            # The paper prints whole percents; two methods with the same one have no order there.
            and paper[METHOD_NAMES[better]] != paper[METHOD_NAMES[worse]]
        ]
        for place, better in enumerate(ours)
    }
    turned = {better: worse for better, worse in turned.items() if worse}
    if not turned:
        return [*sentences, "This is the paper's order."]
    return sentences + [
        f"Unlike in the paper, {_with_median(results, better, paper)} is better than "
        + " and than ".join(_with_median(results, method, paper) for method in worse)
        + f". {_why(results, better, worse)}"
        for better, worse in turned.items()
    ]


def _with_median(results: Reproduction, method: str, paper: Mapping[str, float]) -> str:
    name = METHOD_NAMES[method]
    ours = results.evaluations(results.cables[0])[method]["errors_pct"]["median_pct"]
    return f"{name} ({ours:.1f} %, there {paper[name]:.0f} %)"


def _why(results: Reproduction, better: str, worse: Sequence[str]) -> str:
    """Return the measurements of some methods that tell where their difference comes from."""
    cable = results.cables[0]
    evaluations = results.evaluations(cable)
    told = []
    for method in (better, *worse):
        metrics = evaluations[method]
        parts = [f"{metrics['targets_inside_coverage']} targets in its coverage"]
        prediction = metrics["prediction_errors_pct"]["median_pct"]
        if prediction is not None:
            parts.append(f"casts {prediction:.1f} % from where it expects them")
        told.append(f"{METHOD_NAMES[method]} has " + ", ".join(parts))
    errors = _errors_by_target(results, cable, better)
    shares = " and ".join(
        f"{100 * share_of_draws(errors, _errors_by_target(results, cable, method)):.0f} % against "
        f"{METHOD_NAMES[method]}"
        for method in worse
    )
    return (
        "Measured: " + "; ".join(told) + f". With the targets drawn anew {DRAW_COUNT:,} times, "
        f"{METHOD_NAMES[better]} has the smaller median in {shares}; half would be chance."
    )


def _errors_by_target(results: Reproduction, cable: str, method: str) -> NDArray[np.float64]:
    """Return errors [% of cable length], NaN without a landing, shape [target, cast]."""
    trials = results.trials(cable, method)
    targets = np.unique(trials["target"])
    return np.stack([trials["error_pct"][trials["target"] == target] for target in targets])


def share_of_draws(better: NDArray[np.float64], worse: NDArray[np.float64]) -> float:
    """Return how often one method has the smaller median error when the targets are drawn anew.

    Casts at one target err alike, so whole targets are drawn, with replacement.

    Args:
        better: Errors of one method, NaN without a landing, shape [target, cast].
        worse: Errors of another method at the same targets, same shape.

    Returns:
        Share of `DRAW_COUNT` draws; a draw without a landing counts for neither.
    """
    draws = np.random.default_rng(0).integers(len(better), size=(DRAW_COUNT, len(better)))
    medians = [
        np.nanmedian(errors[draws].reshape(DRAW_COUNT, -1), axis=1) for errors in (better, worse)
    ]
    return float(np.mean(medians[0] < medians[1]))
