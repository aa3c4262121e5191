"""Pictures of `benchmarks casts`: misses against tries, or against the number of real casts."""

import itertools
import pathlib

import numpy as np
from numpy.typing import NDArray

from benchmarks.places import Found
from cablecast.evaluation.evaluate import median_interval
from cablecast.files import write_bytes
from cablecast.report import style

COLORS = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE, style.SKY)


def draw(found: Found, path: pathlib.Path) -> None:
    """Draw misses against tries; against the number of real casts where there are several numbers.

    Args:
        found: Results by rig, cable, number of casts and method.
        path: PNG file to write.
    """
    names = list(dict.fromkeys((name, cable) for name, cable, _, _ in found))
    by_count = len({count for _, _, count, _ in found}) > 1
    with style.styled():
        width = max(4.0, 0.33 * style.PAGE_WIDTH * len(names))
        figure = style.new_figure(width + 1.4 * by_count, 2.9)
        axes = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
        for axis, (name, cable) in zip(axes, names, strict=True):
            here = {
                key[2:]: np.array([row["miss_pct"] for row in rows])
                for key, rows in found.items()
                if key[:2] == (name, cable)
            }
            (_over_counts if by_count else _over_tries)(axis, here)
            targets = len(next(iter(here.values())))
            axis.set(title=f"{cable}, {name} rig: {targets} targets")
            axis.grid(axis="y", color=style.FAINT)
        axes[0].set(ylabel="miss [% of cable length]")
        if by_count:
            figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center")
        else:
            axes[0].legend()
        write_bytes(path, style.png_bytes(figure))


def _over_tries(axis, here: dict[tuple[int, str], NDArray[np.float64]]) -> None:
    """Draw medians with their intervals, and a band from quartile to quartile, for each line."""
    for ((count, method), misses), color in zip(
        here.items(), itertools.cycle(COLORS), strict=False
    ):
        tries = np.arange(1, misses.shape[1] + 1)
        q1, q3 = np.quantile(misses, (0.25, 0.75), axis=0)
        axis.fill_between(tries, q1, q3, color=color, alpha=0.15, linewidth=0)
        _medians(axis, tries, misses.T, color, f"{method}, {count} casts before")
        axis.set(xlabel="try", xticks=tries, ylim=(0, None))


def _over_counts(axis, here: dict[tuple[int, str], NDArray[np.float64]]) -> None:
    """Draw medians with their intervals: the first try of every method, and later ones dashed."""
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    counts = sorted({count for count, _ in here})
    methods = dict.fromkeys(method for _, method in here)
    for method, color in zip(methods, itertools.cycle(COLORS), strict=False):
        known = [count for count in counts if (count, method) in here]
        tries = min(here[count, method].shape[1] for count in known)
        for number in range(tries):
            label = method if tries == 1 else f"{method}, try {number + 1}"
            misses = [here[count, method][:, number] for count in known]
            places = [counts.index(count) for count in known]
            _medians(axis, places, misses, color, label, "-" if number == 0 else "--")
    axis.set(xlabel="real casts before the first target", yscale="log")
    axis.set_xticks(range(len(counts)), [str(count) for count in counts])
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.minorticks_off()


def _medians(axis, places, misses, color, label: str, linestyle: str = "-") -> None:
    """Draw the medians of some misses, with the intervals that hold 90 % of bootstrap draws."""
    middle, low, high = np.array([median_interval(values) for values in misses]).T
    axis.errorbar(
        places,
        middle,
        (middle - low, high - middle),
        marker="o",
        markersize=4,
        capsize=2,
        color=color,
        linestyle=linestyle,
        label=label,
    )
