"""Tables and figures of README and docs, written from the results.

A page says where a result stands:

    <!-- results: NAME -->               every table of the result, with its title
    <!-- results: NAME, WORDS -->        the table whose title starts with these words
    <!-- results: NAME, =VIEW -->        what a function of `VIEWS` makes of it
    <!-- results: all -->                a list of all results
    <!-- end of results -->

What stands between the marks is written by `make results`, and a test compares it. The first table
of a result on a page ends with the origin of the data, and says if the code has changed since.
"""

import datetime
import hashlib
import importlib
import io
import os
import pathlib
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.common import REACHED_BY
from benchmarks.result import FOLDER, ROOT, Result, Table, quoted, show
from cablecast.cable import load_cable
from cablecast.engines.warp_.engine import DEFAULT_DT, DEFAULT_SEGMENT_COUNT
from cablecast.files import read_json, read_text, write_bytes, write_json, write_text
from cablecast.pipeline.check import OUTLOOK_FILE
from cablecast.runs.progress import duration_text

PAGES = ("README.md", *sorted(str(p.relative_to(ROOT)) for p in (ROOT / "docs").glob("*.md")))
START = re.compile(r"^<!-- results: ([\w-]+)(?:, (=?)([^>]+?))? -->\n", re.MULTILINE)
END = "<!-- end of results -->"


def effects(result: Result) -> str:
    """Return the table of the laboratory's effects, with their sizes and sources."""
    from benchmarks.effects import SIZES
    from cablecast.rigs.virtual._hidden import EFFECTS

    shifts = {row["effect"]: row for row in result.table("Shift").records()}

    def cell(name: str) -> str:
        if (row := shifts.get(name)) is None:
            return "-"
        return f"{row['median']:.1f} ({row['q1']:.1f} to {row['q3']:.1f})"

    columns = ("effect", "size", "source", "landings shift [%]: median (quartiles)")
    rows = [(name, *SIZES[name], cell(name)) for name in EFFECTS]
    return Table("", columns, [*rows, ("all of them", "", "", cell("all"))]).markdown()


def tries(result: Result) -> str:
    """Return a row for each try: median, quartiles, casts lost, and how often regions held."""
    records = result.table("Miss of each try").records()
    keys = varied(records, ("rig", "cable", "casts", "method"))
    hits = all("hit" in row for row in records)
    heads = ("try", "median", "quartiles", "lost", *["hit so far"] * hits)
    columns = (*keys, *heads, "inside 50 %", "inside 90 %")
    rows = [
        (
            *(str(row[key]) for key in keys),
            str(row["try"]),
            interval(row),
            "" if row["q1"] is None else f"{row['q1']:.1f} to {row['q3']:.1f}",
            "" if row["lost"] is None else f"{row['lost']:.1f} %",
            *([f"{row['hit']:.0f} %"] if hits else []),
            *("" if row[key] is None else f"{row[key]:.0f} %" for key in ("in 50 %", "in 90 %")),
        )
        for row in records
    ]
    return Table("", columns, rows).markdown()


def centimetres(result: Result) -> str:
    """Return the misses of first tries and of those after one and three corrections [cm]."""
    heads = {"first try": 1, "after one correction": 2, "after three": 4}
    rows = []
    for name, words in CABLES.items():
        cable = load_cable(name)
        found = {r["try"]: r for r in result.tables[0].records() if r["cable"] == name}
        cells = [
            interval({key: cable.length * found[n][key] for key in ("median", "low", "high")}, "cm")
            for n in heads.values()
        ]
        hits = ", ".join(f"{found[n]['hit']:.0f}" for n in heads.values())
        rows.append((f"{name}: {words}, {100 * cable.length:.0f} cm", *cells, f"{hits} %"))
    return Table("", ("cable", *heads, "hit within 1, 2, 4 tries"), rows).markdown()


def distances(result: Result) -> str:
    """Return misses, floors and motions by the distance of the targets."""
    columns = ("cable", "r [m]", "targets", "first try", "last try", "hit", "floor", "ratio")
    rows = []
    for row in result.table("By distance").records():
        calm, ratio = row["floor"], row["last try"] / row["floor"] if row["floor"] else None
        rows.append(
            (
                *(str(row[name]) for name in ("cable", "r [m]", "targets")),
                *(f"{row[name]:.1f}" for name in ("first try", "last try")),
                f"{row['hit']:.0f} %",
                "" if calm is None else f"{calm:.1f}",
                "" if ratio is None else f"{ratio:.1f}",
                f"{row['polar']:.0f} %",
                "" if row["pace"] is None else f"{row['pace']:.2f}",
                f"{row['seconds']:.0f} s",
            )
        )
    return Table("", (*columns, "polar", "pace", "a cast takes"), rows).markdown()


def outlooks(result: Result) -> str:
    """Return hits within some tries by what reaches the target, next to what was stated."""
    rows = [
        (
            *(str(row[name]) for name in ("reached by", "targets", "tries")),
            f"{row['hit']:.0f} % ({row['low']:.0f} to {row['high']:.0f})",
            f"{row['stated']:.0f} %",
            "" if row["floor"] is None else f"{row['floor']:.1f}",
        )
        for row in result.table("Hits within").records()
    ]
    columns = ("reached by", "targets", "tries", "hit", "stated before", "floor")
    return Table("", columns, rows).markdown()


def convergence(result: Result) -> str:
    """Return median and p90 of each cable, by segments and step in double precision."""
    return resolutions(result.tables[0])


def steps(result: Result) -> str:
    """Return the same for the error of the step alone."""
    return resolutions(result.tables[1])


def resolutions(table: Table) -> str:
    """Return a row for each resolution in double precision, the default in bold."""
    records = [row for row in table.records() if row["precision"] == "double"]
    keys, rows = ("segments", "step [ms]"), []
    names, lines = pivot(records, keys, "cable", median_and_p90)
    for segments, step, *cells in lines:
        row = (segments, show(float(step)), *cells)
        is_default = (int(segments), row[1]) == (DEFAULT_SEGMENT_COUNT, show(1e3 * DEFAULT_DT))
        rows.append(tuple(f"**{cell}**" for cell in row) if is_default else row)
    columns = (*keys, *(f"{name}: median / p90 [%]" for name in names))
    return Table("", columns, rows).markdown()


def median_and_p90(row: dict[str, Any]) -> str:
    """Return the median and the 90th percentile of an error."""
    return f"{row['median [%]']:.2f} / {row['p90 [%]']:.1f}"


def marked(result: Result) -> str:
    """Return the worlds that are marked at each step, by the number of segments."""
    rows: dict[Any, list[dict[str, Any]]] = {}
    for row in result.tables[0].records():
        rows.setdefault(row["segments"], []).append(row)
    steps = " / ".join(show(row["step [ms]"]) for row in next(iter(rows.values())))
    columns = ("segments", "worlds", f"marked at {steps} ms", "grown and not marked", "most growth")
    lines = []
    for segments, of in rows.items():
        marks = " / ".join(str(row["marked"]) for row in of)
        grown = sum(row["grown and not marked"] for row in of)
        growth = max(row["most growth"] for row in of)
        lines.append((segments, sum(row["worlds"] for row in of), marks, grown, f"{growth:.2f}"))
    return Table("", columns, lines).markdown()


CABLES = {
    "cable_1": "11 mm rope with a hook",
    "cable_2": "2 mm rope with a hook",
    "cable_3": "7 mm iron wire with a magnet",
}


def pivot(
    records: Sequence[dict[str, Any]],
    keys: Sequence[str],
    across: str,
    cell: Callable[[dict[str, Any]], str],
) -> tuple[list[Any], list[tuple]]:
    """Return the values of a column, and rows by some others with a cell for each of the values."""
    cells = {(tuple(r[k] for k in keys), r[across]): cell(r) for r in records}
    lines, heads = (list(dict.fromkeys(part)) for part in zip(*cells, strict=True))
    rows = [(*map(str, line), *(cells.get((line, head), "") for head in heads)) for line in lines]
    return heads, rows


def varied(records: Sequence[dict[str, Any]], names: Sequence[str]) -> list[str]:
    """Return those columns in which rows differ."""
    return [name for name in names if len({row[name] for row in records}) > 1]


def interval(row: dict[str, Any], unit: str = "") -> str:
    """Return a median with the interval of its bootstrap draws, where it is known."""
    text = f"{row['median']:.1f}{f' {unit}' if unit else ''}"
    return text if row["low"] is None else f"{text} ({row['low']:.1f} to {row['high']:.1f})"


def closed_forms(result: Result) -> str:
    """Return every case of the validation, with its theory and plot."""
    from benchmarks.validation import THEMES
    from benchmarks.validation.case import page

    return page(THEMES, {table.title: table for table in result.tables})


LIGHTS = {
    "even": "even light",
    "flicker": "flicker of +-10 to 50 % at 100 and 120 Hz, at 30, 60 and 120 frames/s",
    "bands": "bands of a rolling shutter, +-50 %, the same rates",
    "cast": "cast of +-30 % in one channel",
    "balance": "white balance that drifts by +-30 % in 0.5 s, in one channel",
    "brightness": "0.4 to 1.8 times as bright",
    "green of hue": "green tape of hue 90 to 160 degrees, looked for as 122",
    "far hue": "tape of hue 90 to 300 degrees, every 30",
    "near hue": "tape of hue 330 to 60 degrees, every 30",
    "tenth": "a tenth of the frames lost",
}
"""Words for each kind of light."""


def lights(result: Result) -> str:
    """Return the worst of each kind of light."""
    kinds: dict[str, list[dict[str, Any]]] = {kind: [] for kind in LIGHTS}
    for row in result.tables[0].records():
        name = row["light"]
        if name.startswith("hue"):
            name = f"{'far' if 90 <= int(name.split()[1]) <= 300 else 'near'} {name}"
        kinds[next(kind for kind in LIGHTS if name.startswith(kind))].append(row)
    columns = (
        "light",
        "lights",
        "found in the worst [%]",
        "rms in the worst [mm]",
        "of even light",
    )
    rows = []
    for kind, of in kinds.items():
        rms, ratio = (f"{max(row[key] for row in of):.2f}" for key in ("rms [mm]", "of even light"))
        rows.append((LIGHTS[kind], len(of), f"{min(r['found [%]'] for r in of):.1f}", rms, ratio))
    return Table("", columns, rows).markdown()


CELL = re.compile(r"(.*?)(?:; at rest after ([\d.]+) s)?; (\W*(?:not )?resumed\W*)")
"""A cell of the table of faults: what the command said, when the arm stood, and the end."""
NUMBER = re.compile(r"\d+\.\d+")


def reactions(result: Result) -> str:
    """Return what comes of each fault on all controllers: the usual first, others with phases."""
    cells: dict[str, list[tuple[str, str, tuple[str, ...]]]] = {}
    phases = result.tables[0].columns[1:]
    for table in result.tables:
        for fault, *row in table.rows:
            for phase, cell in zip(phases, row, strict=True):
                if parts := CELL.fullmatch(cell):
                    cells.setdefault(fault, []).append((table.title, phase, parts.groups()))
    rows = []
    for fault, of in cells.items():
        controllers = list(dict.fromkeys(title for title, _, _ in of))
        # Numbers differ from cell to cell: the words count, and the numbers' range is shown.
        kinds: dict[str, list[tuple[str, str, str]]] = {}
        for title, phase, (words, *_) in of:
            kinds.setdefault(NUMBER.sub("%s", words), []).append((title, phase, words))
        said = []
        for words, places in sorted(kinds.items(), key=lambda item: -len(item[1])):
            numbers = zip(*(NUMBER.findall(text) for _, _, text in places), strict=True)
            where = [
                phase + f" on {' and '.join(on)}" * (on != controllers)
                for phase in phases
                if (on := [title for title, at, _ in places if at == phase])
            ]
            for of_place in numbers:
                words = words.replace("%s", span(of_place), 1)
            said.append(words + f" ({', '.join(where)})" * bool(said))
        only = f" ({', '.join(controllers)})" * (len(controllers) < len(result.tables))
        rest = max((float(rest) for *_, (_, rest, _) in of if rest), default=None)
        done = sum(end == "resumed" for *_, (_, _, end) in of)
        rows.append((fault + only, "; ".join(said), rest, f"{done} of {len(of)}"))
    columns = ("fault", "what the command says", "arm at rest within [s]", "resumed")
    return Table("", columns, rows).markdown()


def span(numbers: Sequence[str]) -> str:
    """Return the least and the largest of some numbers."""
    return " to ".join(dict.fromkeys((min(numbers, key=float), max(numbers, key=float))))


def runs() -> str:
    """Return a row for each result that pages quote: its command, age and pages."""
    rows = []
    texts = {page: read_text(ROOT / page) for page in PAGES}
    for path in sorted(FOLDER.glob("*.json")):
        result = quoted(path.stem)
        shown = [page for page, text in texts.items() if path.stem in quoted_names(text)]
        links = ", ".join(
            f"[{pathlib.Path(page).name}]({os.path.relpath(page, 'docs')})" for page in shown
        )
        took = "" if result.seconds is None else duration_text(result.seconds)
        commit = (result.commit or "")[:8]
        changed = ", ".join(result.changed())
        rows.append((f"`{result.command}`", result.date, commit, took, changed, links, result.note))
    columns = ("command", "date", "commit", "time", "code changed since", "pages", "note")
    return Table("", columns, rows).markdown()


def figures(result: Result) -> str:
    """Return what a reader must know of figures that were copied from a reproduction."""
    from benchmarks import reproduction

    paths = [ROOT / "docs" / "images" / name for name in reproduction.FIGURES]
    if all(signature(path) == f"reproduce {result.commit}" for path in paths):
        return "These figures are of the run below."
    return "**These figures are of an earlier run than the tables**, which are of the run below."


SMALL = 0.5
"""Size of a finding over the paper's below which the page says why."""


def carries(result: Result) -> str:
    """Return each finding that a run tells beside the paper's, what does not carry over first."""
    from benchmarks.reproduction import FINDINGS

    rows = []
    for finding, paper, *ours in result.table("Findings").rows:
        known = [value for value in ours if value is not None]
        if not known:
            continue
        held, middle = sum(value > 0.0 for value in known), float(np.median(known))
        interval = f"{middle:.1f}" + f" ({min(known):.1f} to {max(known):.1f})" * (len(known) > 1)
        size = np.sign(middle) if paper is None else middle / paper
        why = FINDINGS[finding][2] if size < SMALL and not result.settings["quick"] else ""
        words = "" if paper is None else f"{size:.2f}"
        of = f"{held} of {len(known)}"
        rows.append((size, finding, show(paper), interval, words, of, why))
    rows.sort(key=lambda row: row[0])
    columns = (
        "finding",
        "paper",
        "ours: median over the laboratories (least to most)",
        "ours over the paper's",
        "sign carries over in",
        "why not, as far as we know",
    )
    # The reasons are those of the whole run.
    end = None if any(row[-1] for row in rows) else -1
    return Table("", columns[:end], [row[1:end] for row in rows]).markdown()


def repeats(result: Result) -> str:
    """Return how equal casts repeat, beside the paper, for each speed at the paper's radius."""
    columns = (
        "motions",
        "SD: paper",
        "SD: ours",
        "RMS: ours",
        "off table: paper",
        "off table: ours",
    )
    rows = []
    for row in result.table("Coverage in %").rows:
        cells = [str(cell).strip("*") for cell in row]
        name, rms, sd, sd_paper, off, off_paper = (cells[0], *cells[6:11])
        if rms:
            rows.append((name, sd_paper, sd, rms, off_paper, off))
    return Table("", columns, rows).markdown()


SHOWN_TRIES = (0, 1, 2, 3, 7, 15)
"""Tries whose errors a page shows."""


def strikes(result: Result) -> str:
    """Return a row for each kind of rope and method: errors of some tries [cm].

    Published methods are shown beside all goals only.
    """
    records = [row for row in result.tables[0].records() if row["try"] in SHOWN_TRIES]
    if result.name != "irp":
        records = [row for row in records if row["distance"] is not None]

    def cell(row: dict[str, Any]) -> str:
        error = f"{row['mean']:.2f} ({row['low']:.2f} to {row['high']:.2f})"
        return error if row["distance"] is None else f"{error}; {row['distance']:.2f}"

    numbers, rows = pivot(records, ("kind", "method", "goals"), "try", cell)
    columns = ("ropes", "method", "goals", *(f"try {number}" for number in numbers))
    return Table("", columns, rows).markdown()


VIEWS: dict[str, Callable[[Result], str]] = {
    "effects": effects,
    "tries": tries,
    "centimetres": centimetres,
    "distances": distances,
    "outlooks": outlooks,
    "convergence": convergence,
    "steps": steps,
    "marked": marked,
    "closed forms": closed_forms,
    "lights": lights,
    "reactions": reactions,
    "figures": figures,
    "carries": carries,
    "repeats": repeats,
    "strikes": strikes,
}


FIGURES = {
    "docs/images/casts.png": ("five-casts", "benchmarks.casts"),
    "docs/images/irp.png": ("irp", "benchmarks.irp"),
}
"""Result of each figure, and the module whose `draw` draws its first table, by the path."""


def origin(result: Result, root: pathlib.Path = ROOT) -> str:
    """Return the line below a result: its command, date, commit and machine, and what changed."""
    date = datetime.date.fromisoformat(result.date)
    parts = [f"`{result.command}`, {date.day} {date:%B %Y}"]
    if result.commit:
        commit, _, changes = result.commit.partition("+")
        parts.append(f"commit {commit[:8]}" + " with uncommitted changes" * bool(changes))
    if result.seconds is not None:
        took = duration_text(result.seconds)
        parts.append(f"{took} on {result.cores} cores" if result.cores else took)
    if result.processor:
        parts.append(result.processor)
    if result.load is not None and result.cores and result.load > 0.5 * result.cores:
        parts.append(f"on a busy machine (load {result.load:.1f})")
    lines = [", ".join(parts) + "."]
    if changed := result.changed(root):
        names = [*changed[:2], f"{len(changed) - 2} more rooms"] if len(changed) > 3 else changed
        words = " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
        lines.append(f"**The code of {words} has changed since.**")
    return f"<small>{' '.join(lines)}</small>"


def block(name: str, is_view: bool, what: str | None, *, told: bool = False) -> str:
    """Return what stands between the marks of a result; its origin unless it was told above."""
    if name == "all":
        return f"\n{runs()}\n\n"
    result = quoted(name)
    if what is None:
        body = "\n\n".join(f"{t.title}:\n\n{t.markdown()}" for t in result.tables)
    elif is_view:
        body = VIEWS[what](result)
    else:
        body = result.table(what).markdown()
    return f"\n{body}\n\n" + ("" if told else f"{origin(result)}\n\n")


def rendered(text: str) -> str:
    """Return a page with every result in it as it is now."""
    parts, place, told = [], 0, set()
    for mark in START.finditer(text):
        end = text.index(END, mark.end())
        name, is_view, what = mark.groups()
        parts += [text[place : mark.end()], block(name, bool(is_view), what, told=name in told)]
        place = end
        told.add(name)
    return "".join((*parts, text[place:]))


def quoted_names(text: str) -> set[str]:
    """Return the names of the results that a page quotes."""
    return {mark[1] for mark in START.finditer(text)} - {"all"}


def digest(name: str) -> str:
    """Return a digest of the tables of a result, which its figures carry."""
    tables = [(table.title, table.columns, table.rows) for table in quoted(name).tables]
    return hashlib.sha256(repr(tables).encode()).hexdigest()[:16]


def signed(picture: bytes, what: str) -> bytes:
    """Return a PNG file that says what it shows."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    info, buffer = PngInfo(), io.BytesIO()
    info.add_text("Result", what)
    Image.open(io.BytesIO(picture)).save(buffer, format="png", pnginfo=info, optimize=True)
    return buffer.getvalue()


def signature(path: pathlib.Path) -> str:
    """Return what a PNG file says that it shows; empty if nothing."""
    from PIL import Image

    with Image.open(path) as picture:
        return str(picture.info.get("Result", ""))


def outlook_values(promises: Result, five_casts: Result) -> dict[str, dict[str, Any]]:
    """Return the outlooks that `check` states, by what reaches a target.

    Hits are those of random laboratories, floors those of the three cables.
    """
    floors = {
        row["reached by"]: round(row["floor"] / 100.0, 4)
        for row in five_casts.table("Hits within").records()
    }
    found = {}
    for name, words in REACHED_BY.items():
        rows = promises.table("What check says").records()
        rows = [row for row in rows if row["reached by"] == words]
        found[name] = {
            "count": rows[0]["targets"],
            "hit": [round(row["hit [%]"] / 100.0, 3) for row in rows],
            "floor": floors.get(words, floors[REACHED_BY["calm"]]),
        }
    return found


def write_pages() -> int:
    """Write every page, figure and outlook that differs from its results."""
    values = outlook_values(quoted("promises"), quoted("five-casts"))
    if values != read_json(OUTLOOK_FILE):
        write_json(OUTLOOK_FILE, values)
        print(f"written: {OUTLOOK_FILE.relative_to(ROOT)}")
    for page in PAGES:
        text = read_text(ROOT / page)
        if (now := rendered(text)) != text:
            write_text(ROOT / page, now)
            print(f"written: {page}")
    for path, (name, module) in FIGURES.items():
        what = f"{name} {digest(name)}"
        if not (ROOT / path).is_file() or signature(ROOT / path) != what:
            picture = importlib.import_module(module).draw(quoted(name).tables[0].records())
            write_bytes(ROOT / path, signed(picture, what))
            print(f"written: {path}")
    kept = {path.stem for path in FOLDER.glob("*.json")}
    shown = set().union(*(quoted_names(read_text(ROOT / page)) for page in PAGES))
    for name in sorted(kept - shown):
        print(f"no page quotes {name}")
    return 0
