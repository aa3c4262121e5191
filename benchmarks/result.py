"""Results as data: what a command measured, when, on what, and of which version of the code.

A result is a small JSON file. Those that pages quote lie in `benchmarks/results`. Each has a
fingerprint of every part of cablecast that decides its numbers: it is out of date once the code of
such a part differs. Comments and docstrings do not count, nor what only carries numbers from one
part to the next: set-ups, datasets, folders.
"""

import ast
import dataclasses
import functools
import hashlib
import io
import pathlib
import subprocess
import tarfile
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from cablecast.files import read_json, write_json
from cablecast.runs.folder import plain_settings, run_facts

ROOT = pathlib.Path(__file__).parents[1]
FOLDER = ROOT / "benchmarks" / "results"
"""Results that pages quote."""
OTHER = ROOT / "runs" / "benchmarks"
"""Results that no page quotes."""

ENGINE = ("cable", "engines/base", "engines/dynamics", "engines/warp_")
PHYSICS = (*ENGINE, "motion/casting", "motion/grip_path")
"""Rooms, or packages and modules in them, that decide how a simulated cable moves."""
LABORATORY = (*ENGINE, "motion", "arm", "rigs/virtual")
PAPER = (*LABORATORY, "tuning", "learning", "evaluation")
"""What `cablecast reproduce` depends on: it does not aim."""
LEARNING = (*LABORATORY, "tuning", "learning", "aiming")
AIR = (
    *ENGINE,
    "engines/contact",
    "engines/swing",
    "motion/joint_move",
    "tuning/tips",
    "aiming/strike",
)
"""Strikes in the air."""
STRIKES = (
    *AIR,
    "arm",
    "motion",
    "rigs/virtual",
    "tuning/servo",
    "aiming/strike_session",
    "pipeline/strike",
)
"""Strikes on the strike laboratory."""
WHIP = ("cable", "task", "tuning/tips")
"""Strikes with a whip, which MuJoCo plays."""
ROBOT = ("rigs/arm", "rigs/driver", "rigs/path", "rigs/ur")
SIGHT = ("camera", "vision", "rigs/virtual")

DIGITS = 6
"""Significant digits of a number in a file."""


@dataclasses.dataclass
class Table:
    """A table that prints as Markdown."""

    title: str
    columns: tuple[str, ...]
    rows: list[tuple]

    def __str__(self) -> str:
        cells = self.cells()
        widths = [max(len(row[i]) for row in cells) for i in range(len(self.columns))]
        lines = [" | ".join(v.ljust(w) for v, w in zip(r, widths, strict=True)) for r in cells]
        rule = "-|-".join("-" * width for width in widths)
        return "\n".join([f"\n{self.title}\n", lines[0], rule, *lines[1:]])

    def cells(self) -> list[tuple[str, ...]]:
        """Return the columns' names and the rows as they are printed."""
        return [self.columns, *[tuple(show(value) for value in row) for row in self.rows]]

    def markdown(self) -> str:
        """Return the table without its title, for a page."""
        head, *rows = ("| " + " | ".join(row) + " |" for row in self.cells())
        return "\n".join([head, "|" + "---|" * len(self.columns), *rows])

    def records(self) -> list[dict[str, Any]]:
        """Return each row as a mapping from the names of the columns."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]


def show(value: Any) -> str:
    """Return a cell of a table."""
    if value is None:
        return ""
    if not isinstance(value, float):
        return str(value)
    # Not -0.
    text = f"{value + 0.0:.3g}"
    return f"{float(text):,.0f}" if 1e3 <= abs(float(text)) < 1e9 else text


@dataclasses.dataclass(frozen=True, kw_only=True)
class Result:
    """What a command measured.

    Attributes:
        name: Name of the file.
        command: Command that measures it anew.
        settings: Settings of the command.
        commit: Commit of the source tree, with "+changes" if it differed; None if unknown.
        date: Date of the start.
        processor: Name of the processor; empty if unknown.
        cores: Number of processor cores.
        load: Mean number of busy processes in the minute before the start; None if unknown.
        seconds: Duration [s]; None if unknown.
        code: Fingerprint of each part of cablecast that it depends on.
        tables: What was measured.
        note: What a reader must know about its origin.
    """

    name: str
    command: str
    settings: dict[str, Any]
    commit: str | None
    date: str
    processor: str
    cores: int | None
    load: float | None
    seconds: float | None
    code: dict[str, str]
    tables: tuple[Table, ...]
    note: str = ""

    def changed(self, root: pathlib.Path = ROOT) -> list[str]:
        """Return the parts of cablecast whose code has changed since."""
        return [part for part, stored in self.code.items() if stored != fingerprint(part, root)]

    def table(self, title: str) -> Table:
        """Return the table whose title starts with some words."""
        return next(table for table in self.tables if table.title.startswith(title))

    def write(self, folder: pathlib.Path = FOLDER) -> pathlib.Path:
        """Write the file and return its path."""
        path = folder / f"{self.name}.json"
        write_json(path, plain(dataclasses.asdict(self)))
        return path

    @classmethod
    def read(cls, path: pathlib.Path) -> "Result":
        """Return the result that a file holds."""
        values = read_json(path)
        tables = tuple(
            Table(table["title"], tuple(table["columns"]), [tuple(row) for row in table["rows"]])
            for table in values.pop("tables")
        )
        return cls(**values, tables=tables)


def plain(value: Any) -> Any:
    """Return a value as JSON takes it: numbers rounded, NaN as null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (np.bool_, np.integer)):
        return value.item()
    if isinstance(value, (float, np.floating)):
        return float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None
    return str(value) if isinstance(value, pathlib.PurePath) else value


def quoted(name: str) -> Result:
    """Return a result that pages quote."""
    return Result.read(FOLDER / f"{name}.json")


def measured(
    tables: Iterable[Table],
    *,
    name: str,
    command: str,
    settings: Mapping[str, Any],
    code: Sequence[str],
) -> tuple[Result, int]:
    """Run a benchmark: print its tables as they come, and return the result and its status.

    Args:
        tables: Generator of tables, which may return a status.
        name: Name of the result.
        command: Command that measures it.
        settings: Settings of the command.
        code: Parts of cablecast that the result depends on.
    """
    facts, start, found, status = run_facts(), time.perf_counter(), [], 0
    # As it is now, not as it may be edited to meanwhile.
    digests = {part: fingerprint(part) for part in code}
    source = iter(tables)
    while True:
        try:
            found.append(next(source))
        except StopIteration as stop:
            status = stop.value or 0
            break
        print(found[-1], flush=True)
    result = Result(
        name=name,
        command=command,
        settings=plain_settings(plain(settings)),
        commit=facts["commit"],
        date=facts["started"][:10],
        processor=facts["processor"],
        cores=facts["cpu_count"],
        load=facts["load"],
        seconds=round(time.perf_counter() - start, 1),
        code=digests,
        tables=tuple(found),
    )
    return result, status


@functools.cache
def fingerprint(part: str, root: pathlib.Path = ROOT) -> str:
    """Return a digest of the code of a room or of a package in it.

    Args:
        part: Path below src/cablecast, of a package or of a module without its suffix.
        root: Root of the repository.
    """
    base = root / "src" / "cablecast" / part
    files = sorted(base.rglob("*.py")) if base.is_dir() else [base.with_suffix(".py")]
    return _digest([file.read_text() for file in files if file.is_file()])


def code_key(code: Sequence[str]) -> str:
    """Return a name for the code of some parts: what other code made is not gone on with."""
    return hashlib.sha256("".join(fingerprint(part) for part in code).encode()).hexdigest()[:12]


def fingerprints_at(commit: str, code: Sequence[str]) -> dict[str, str]:
    """Return the digests of parts of cablecast as they were at a commit."""
    archive = subprocess.run(
        ["git", "archive", commit, "src/cablecast"], cwd=ROOT, capture_output=True, check=True
    ).stdout
    texts: dict[str, str] = {}
    with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
        for member in sorted(tar.getmembers(), key=lambda m: pathlib.PurePath(m.name)):
            file = tar.extractfile(member)
            if file is not None and member.name.endswith(".py"):
                name = member.name.removeprefix("src/cablecast/").removesuffix(".py")
                texts[name] = file.read().decode()
    return {
        part: _digest([text for name, text in texts.items() if f"{name}/".startswith(f"{part}/")])
        for part in code
    }


def _digest(sources: list[str]) -> str:
    shapes = repr([_shape(ast.parse(source)) for source in sources])
    return hashlib.sha256(shapes.encode()).hexdigest()[:12]


def _shape(node: Any) -> Any:
    """Return what a syntax tree says, without docstrings, alike in each version of Python."""
    if isinstance(node, list):
        return [_shape(item) for item in node if not _is_text(item)]
    if not isinstance(node, ast.AST):
        return node
    # Versions of Python differ in fields that are empty here.
    fields = ((name, getattr(node, name, None)) for name in node._fields)
    return type(node).__name__, [(n, _shape(v)) for n, v in fields if v is not None and v != []]


def _is_text(node: Any) -> bool:
    if not isinstance(node, ast.Expr) or not isinstance(node.value, ast.Constant):
        return False
    return isinstance(node.value.value, str)
