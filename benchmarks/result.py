"""Results as data: what a command measured, when, on what, and of which version of the code.

A result is a small JSON file. Those that pages quote lie in `benchmarks/results`. Each has a
fingerprint of every part of cablecast that its benchmark can import (`depends`): it is out of date
once the code of such a part differs, or if it has no fingerprint of one. Comments and docstrings do
not count.
"""

import ast
import dataclasses
import functools
import hashlib
import io
import pathlib
import subprocess
import tarfile
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cablecast.files import read_json, write_json
from cablecast.runs.folder import plain_settings, run_facts

ROOT = pathlib.Path(__file__).parents[1]
FOLDER = ROOT / "benchmarks" / "results"
"""Results that pages quote."""
OTHER = ROOT / "runs" / "benchmarks"
"""Results that no page quotes."""

SHOWING = ("errors", "files", "runs", "report", "gym", "view", "cli")
"""Rooms that refuse, keep and show numbers, and change none."""
TOOLS = ("benchmarks.__main__", "benchmarks.pages", "benchmarks.result")
"""Modules of the benchmarks that measure nothing."""

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
        code: Fingerprint of each part of cablecast that it depends on, by `depends`.
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
        """Return the rooms of cablecast whose code has changed since, or is not known."""
        from benchmarks.__main__ import COMMANDS, module_of

        command = self.command.partition("python -m benchmarks ")[2].split(" ")[0]
        today = depends(module_of(command), root) if command in COMMANDS else ()
        unknown = [part for part in today if not _is_in(part, self.code)]
        other = [part for part, stored in self.code.items() if stored != fingerprint(part, root)]
        return sorted({part.split("/")[0] for part in (*other, *unknown)})

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
        code: Parts of cablecast that the result depends on, by `depends`.
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
    shapes = repr([_shape(ast.parse(file.read_text())) for file in files if file.is_file()])
    return hashlib.sha256(shapes.encode()).hexdigest()[:12]


def code_key(module: str) -> str:
    """Return a name for the code behind a benchmark: what other code made is not gone on with."""
    code = "".join(map(fingerprint, depends(module)))
    return hashlib.sha256(code.encode()).hexdigest()[:12]


@functools.cache
def depends(module: str, root: pathlib.Path = ROOT) -> tuple[str, ...]:
    """Return the parts of cablecast that the code of a benchmark can import.

    Imports inside functions count; those for types and rooms of `SHOWING` do not. A package with
    all its modules is one part.

    Args:
        module: Name of the benchmark's module, such as "benchmarks.casts".
        root: Root of the repository.
    """
    found, waiting = {module}, [module]
    while waiting:
        new = _imports(waiting.pop(), root) - found
        found |= new
        waiting += new
    package = root / "src" / "cablecast"
    files = {_file(name, root) for name in found if name.startswith("cablecast.")}
    parts = set()
    for file in files:
        folders = [folder for folder in reversed(file.parents) if package in folder.parents]
        whole = (folder for folder in folders if files.issuperset(folder.rglob("*.py")))
        parts.add(next(whole, file.with_suffix("")).relative_to(package).as_posix())
    return tuple(sorted(parts))


def _is_in(part: str, others: Iterable[str]) -> bool:
    """Return whether a part is one of some others, or lies in one."""
    return any(f"{part}/".startswith(f"{other}/") for other in others)


@functools.cache
def _imports(module: str, root: pathlib.Path) -> set[str]:
    """Return the modules of cablecast and of the benchmarks that a module can import by itself."""
    names: set[str] = set()
    for node in _nodes(ast.parse(_file(module, root).read_text())):
        match node:
            case ast.Import():
                names |= {alias.name for alias in node.names}
            case ast.ImportFrom(module=str(base)):
                names |= {f"{base}.{alias.name}" for alias in node.names}
            case ast.Attribute(value=ast.Name(id="cc" | "cablecast"), attr=name):
                names.add(f"cablecast.{name}")
            # An exported script has the text of a module.
            case ast.Call(func=ast.Name(id="script"), args=[ast.Constant(value=name), *_]):
                names.add(f"cablecast.exports.{name}")
    homes = _public(root)
    dotted = [homes.get(name, name).split(".") for name in names]
    modules = {".".join(parts[:end]) for parts in dotted for end in range(2, len(parts) + 1)}
    return {name for name in modules if _counts(name) and _file(name, root).is_file()}


def _counts(name: str) -> bool:
    package, room, *_ = name.split(".")
    return name not in TOOLS and (
        package == "benchmarks" or (package == "cablecast" and room not in SHOWING)
    )


@functools.cache
def _public(root: pathlib.Path) -> dict[str, str]:
    """Return the module of each public name of cablecast."""
    tree = ast.walk(ast.parse((root / "src" / "cablecast" / "__init__.py").read_text()))
    imports = [node for node in tree if isinstance(node, ast.ImportFrom)]
    return {f"cablecast.{alias.name}": str(node.module) for node in imports for alias in node.names}


def _file(module: str, root: pathlib.Path) -> pathlib.Path:
    """Return the file of a module, which need not exist."""
    parts = module.split(".")
    base = root.joinpath(*(["src"] if parts[0] == "cablecast" else []), *parts)
    return base / "__init__.py" if base.is_dir() else base.with_suffix(".py")


def _nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Find the nodes of a syntax tree that run: all but those under TYPE_CHECKING."""
    for child in ast.iter_child_nodes(node):
        if not (isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"):
            yield child
            yield from _nodes(child)


def fingerprints_at(commit: str, code: Sequence[str]) -> dict[str, str]:
    """Return the digests of parts of cablecast as they were at a commit."""
    archive = subprocess.run(
        ["git", "archive", commit, "src/cablecast"], cwd=ROOT, capture_output=True, check=True
    ).stdout
    with (
        tempfile.TemporaryDirectory() as folder,
        tarfile.open(fileobj=io.BytesIO(archive)) as tar,
    ):
        tar.extractall(folder, filter="data")
        return {part: fingerprint(part, pathlib.Path(folder)) for part in code}


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
