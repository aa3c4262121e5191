"""Put the tables and figures of a reproduction into the pages that quote it.

    python tools/quote_reproduction.py runs/reproduce            # print the tables
    python tools/quote_reproduction.py runs/reproduce --write    # put all into README.md and docs/

The headline of the README, the time that each stage took in docs/reproduce.md, and figures of
docs/gallery.md, scaled to a page and to few colours. All numbers come from the folder; the
sentences around them stand here.
"""

import argparse
import collections
import dataclasses
import pathlib
import re

from PIL import Image

from cablecast.evaluation.published import BEST_METHOD, METHOD_NAMES, published_row
from cablecast.files import read_json, read_text, write_text
from cablecast.pipeline.reproduce import QUICK
from cablecast.report.reproduction import Reproduction
from cablecast.report.tables import five_cells, published_cells
from cablecast.runs.folder import plain_settings
from cablecast.runs.progress import duration_text

ROOT = pathlib.Path(__file__).parents[1]
FIGURES = {
    "coverage.png": "select/coverage.png",
    "tracks.png": "tune/tracks.png",
    "repeatability.png": "repeat/repeatability.png",
    "landings.png": "evaluate-fine-tuning/landings.png",
}
"""Figures of the first cable, by their names in docs/images."""
WIDTH, COLORS = 1100, 96
"""Width of a figure [pixel], and its number of colours."""


def headline(folder: pathlib.Path) -> str:
    """Return the table with all that a reader must know about it."""
    config = read_json(folder / "config.json")
    settings = config["settings"]
    budget = settings["budget"]
    results = Reproduction(folder=folder, cables=tuple(budget["cables"]))
    first = results.cables[0]
    is_quick = budget == plain_settings(dataclasses.asdict(QUICK))
    command = "cablecast reproduce" + " --quick" * is_quick
    seconds = read_json(folder / "metrics.json")["seconds"]
    lines = [
        "Distance from target to landing over the 32 targets, in % of cable length:",
        "",
        "| casts | median | 1st quartile | 3rd quartile | min | max |",
        "|---|---|---|---|---|---|",
    ]
    rig = "virtual rig" if settings["rig"] == "virtual" else f"rig {settings['rig']}"
    for cable, metrics in results.best_evaluations().items():
        cells = " | ".join(f"**{cell}**" for cell in five_cells(metrics["errors_pct"]))
        lines.append(f"| **{cable}**, {METHOD_NAMES[BEST_METHOD]}, {rig} | {cells} |")
        lines += _published(cable) if cable != first else []
        if cable == first:
            lines += _other_methods(results, first, rig)
    lines += [
        "",
        f"Of {budget['repeats']} cast{'s' * (budget['repeats'] != 1)} at each target. "
        + _landed(results)
        + f" `{command}` makes these tables, the figures of the paper in its own drawing, and one "
        f"report of them all; it took {duration_text(sum(seconds.values()))} on "
        f"{config['cpu_count']} processor cores.",
    ]
    return "\n".join(lines)


def _other_methods(results: Reproduction, cable: str, rig: str) -> list[str]:
    """Return the rows of the other methods on the first cable, each followed by the paper's."""
    lines = []
    for method, metrics in reversed(results.evaluations(cable).items()):
        if method != BEST_METHOD:
            cells = " | ".join(five_cells(metrics["errors_pct"]))
            lines.append(f"| {cable}, {METHOD_NAMES[method]}, {rig} | {cells} |")
        lines += _published(cable, method)
    return lines


def _published(cable: str, method: str = BEST_METHOD) -> list[str]:
    row = published_row(cable, method)
    if row is None:
        return []
    cells = " | ".join(published_cells(row))
    return [f"| paper: {row.cable}, {row.method}, real UR5 | {cells} |"]


def _landed(results: Reproduction) -> str:
    """Return the number of casts of the best method that the errors leave out, in words."""
    phrases = []
    for cable, metrics in results.best_evaluations().items():
        lost = metrics["trial_count"] - metrics["status_counts"].get("ok", 0)
        phrases.append(f"{lost} of {metrics['trial_count']} with {cable}")
    return "Casts without a landing are left out, as in the paper: " + ", ".join(phrases) + "."


def times(folder: pathlib.Path) -> str:
    """Return the time of each kind of stage, summed over the cables."""
    config = read_json(folder / "config.json")
    seconds = read_json(folder / "metrics.json")["seconds"]
    kinds: dict[str, list[float]] = collections.defaultdict(list)
    for title, taken in seconds.items():
        kinds[title.partition(": ")[2] or title].append(taken)
    total = sum(seconds.values())
    lines = [
        f"On {config['cpu_count']} processor cores, rig `{config['settings']['rig']}`:",
        "",
        "| stage | runs | time | share |",
        "|---|---|---|---|",
    ]
    for kind, taken in sorted(kinds.items(), key=lambda item: -sum(item[1])):
        share = 100 * sum(taken) / total
        lines.append(f"| {kind} | {len(taken)} | {duration_text(sum(taken))} | {share:.0f} % |")
    lines.append(f"| all | {len(seconds)} | {duration_text(total)} | 100 % |")
    return "\n".join(lines)


def insert(page: pathlib.Path, name: str, text: str, folder: pathlib.Path) -> None:
    """Replace what stands between the marks of a name in a page."""
    begin, end = f"<!-- {name}: begin", f"<!-- {name}: end -->"
    origin = f"Written by `python tools/quote_reproduction.py {folder} --write`."
    text = f"{begin}. {origin} -->\n\n{text}\n\n{end}"
    pattern = re.escape(begin) + ".*?" + re.escape(end)
    content, count = re.subn(pattern, lambda _: text, read_text(page), flags=re.DOTALL)
    if count != 1:
        raise SystemExit(f"{page} has {count} places between {begin} and {end}, not one")
    write_text(page, content)
    print(f"{page}: {name} of {folder}")


def write_figures(folder: pathlib.Path) -> None:
    """Write the figures of the first cable into docs/images."""
    cable = read_json(folder / "config.json")["settings"]["budget"]["cables"][0]
    for name, source in FIGURES.items():
        with Image.open(folder / cable / source) as picture:
            height = round(picture.height * WIDTH / picture.width)
            scaled = picture.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
        path = ROOT / "docs" / "images" / name
        scaled.quantize(COLORS).save(path, optimize=True)
        print(f"{path}: {path.stat().st_size / 1024:.0f} KiB")


def main() -> None:
    """Print the tables, or put tables and figures into the pages."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=pathlib.Path, help="folder of `cablecast reproduce`")
    parser.add_argument("--write", action="store_true", help="put all into the pages")
    arguments = parser.parse_args()
    for name, page, table in (
        ("headline", ROOT / "README.md", headline),
        ("times", ROOT / "docs/reproduce.md", times),
    ):
        if arguments.write:
            insert(page, name, table(arguments.folder), arguments.folder)
        else:
            print(table(arguments.folder), end="\n\n")
    if arguments.write:
        write_figures(arguments.folder)


if __name__ == "__main__":
    main()
