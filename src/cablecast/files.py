"""Files: bounded readers of text, YAML, CSV and JSON, and writes that are whole or not at all.

A file that cannot be read (missing, no permission, a failing disk) is told apart from a file with
wrong content: only the second is damaged. At the end stand the cores and libraries of the machine.
"""

import codecs
import csv
import functools
import glob
import hashlib
import importlib.metadata
import io
import json
import math
import os
import pathlib
import platform
import re
import shutil
import stat
import tempfile
from collections.abc import Iterable, Sequence
from typing import Any

import yaml

from cablecast.errors import DamagedFileError, InputError, UnreadableFileError

SIZE_MAX = 2**20
"""Largest size of a file written by a person [byte]."""

JSON_SIZE_MAX = 2**28
"""Largest size of a JSON file of a run [byte]."""

CHECKSUM_KEY = "sha256"


def read_bytes(path: str | pathlib.Path, size_max: int = JSON_SIZE_MAX) -> bytes:
    """Return the content of a file of at most some size [byte].

    Raises:
        FileNotFoundError: There is no such file.
        UnreadableFileError: The system refuses to read it.
        InputError: The file is too large.
    """
    path = pathlib.Path(path)
    try:
        with path.open("rb") as file:
            content = file.read(size_max + 1)
    except (FileNotFoundError, NotADirectoryError):
        raise FileNotFoundError(f"there is no file {path}") from None
    except OSError as error:
        raise UnreadableFileError(f"{path} cannot be read: {error.strerror or error}") from None
    if len(content) > size_max:
        raise InputError(f"{path} has more than {size_max} bytes")
    return content


def read_text(path: str | pathlib.Path, size_max: int = SIZE_MAX) -> str:
    """Return the text of a file, in UTF-8, or in UTF-16 with a byte-order mark; see `read_bytes`.

    Raises:
        InputError: The file is too large, or neither.
    """
    content = read_bytes(path, size_max)
    try:
        is_wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        text = content.decode("utf-16" if is_wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path} is not text in UTF-8 (byte {error.start}): save it in UTF-8"
        ) from None
    if "\0" in text:
        # UTF-16 without a mark, or no text at all.
        raise InputError(f"{path} is not text in UTF-8 (byte 0 in it): save it in UTF-8")
    return text


_LEADING_ZERO = re.compile(r"[-+]?0[0-9_]+")


class _Loader(yaml.SafeLoader):
    """Loader of plain YAML: no aliases, no repeated keys, and 5e-2 is a number."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("aliases (*name) are not allowed")
        return super().compose_node(parent, index)

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        if _LEADING_ZERO.fullmatch(str(node.value)):
            raise yaml.MarkedYAMLError(
                problem=f"{str(node.value)[:40]} has a leading zero, which YAML reads as octal: "
                "write the number without it, or a name in quotes",
                problem_mark=node.start_mark,
            )
        return super().construct_yaml_int(node)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise yaml.YAMLError(f"a key in line {key.start_mark.line + 1} is no name")
            if key.value in seen:
                raise yaml.YAMLError(
                    f"the key {str(key.value)[:40]!r} appears twice, again in line "
                    f"{key.start_mark.line + 1}"
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)
# YAML 1.1 reads 5e-2 and 1.e5 as text, but every person means the number.
_Loader.yaml_implicit_resolvers = {
    first: [(tag, regexp) for tag, regexp in resolvers if tag != "tag:yaml.org,2002:float"]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(
        r"""^[-+]?(?:(?:[0-9][0-9_]*)?\.[0-9_]+(?:[eE][-+]?[0-9]+)?
        |[0-9][0-9_]*\.?(?:[eE][-+]?[0-9]+)
        |[0-9][0-9_]*\.
        |\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$""",
        re.VERBOSE,
    ),
    list("-+0123456789."),
)
# 08 is no octal number, and would be text.
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", _LEADING_ZERO, list("-+0"))


def read_yaml(path: str | pathlib.Path) -> dict[str, Any]:
    """Return the mapping that a YAML file of at most `SIZE_MAX` bytes holds; see `parse_yaml`."""
    return parse_yaml(read_text(path), str(path))


def parse_yaml(text: str, name: str) -> dict[str, Any]:
    """Return the mapping that a text in YAML holds; the error names it.

    Raises:
        InputError: It is not YAML, holds aliases or repeated keys, or is no mapping.
    """
    try:
        values = yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError, TypeError) as error:
        reason = " ".join(str(error).split())[:200]
        if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
            line = error.problem_mark.line
            has_tab = any("\t" in row for row in text.splitlines()[line : line + 1])
            what = "it has a tab, indent with spaces" if has_tab else error.problem
            reason = f"line {line + 1}: {what}"
        raise InputError(f"{name} is not plain YAML: {reason}") from None
    if not isinstance(values, dict):
        raise InputError(f"{name} must hold a mapping of names to values")
    return values


def read_csv(
    path: str | pathlib.Path, columns: tuple[str, ...], size_max: int = 16 * SIZE_MAX
) -> list[dict[str, str]]:
    """Return the rows of a CSV file of at most some size [byte].

    The header must hold some columns; see `cells_of` for what separates them. Empty cells beyond
    the last column are ignored.

    Raises:
        InputError: There is no such file, it is too large, or a column or a cell is missing or too
            many.
    """
    try:
        header, *lines = cells_of(read_text(path, size_max)) or [[]]
    except FileNotFoundError as error:
        raise InputError(str(error)) from None
    except csv.Error as error:
        raise InputError(f"{path} is no CSV file: {error}") from None
    if missing := [name for name in columns if name not in header]:
        raise InputError(f"{path} lacks the columns {', '.join(missing)}")
    if doubled := [name for name in header if name and header.count(name) > 1]:
        raise InputError(f"{path} has two columns {doubled[0][:40]}: rename one of them")
    needed = max(header.index(name) for name in columns) if columns else 0
    rows = []
    for number, cells in enumerate(lines, start=2):
        if not cells:
            continue
        if len(cells) <= needed:
            raise InputError(f"line {number} of {path} has too few cells")
        if any(cell.strip() for cell in cells[len(header) :]):
            raise InputError(
                f"line {number} of {path} has too many cells; if it has decimal commas, "
                "separate its cells by ; or tabs"
            )
        rows.append(dict(zip(header, cells + [""] * (len(header) - len(cells)), strict=False)))
    return rows


_COMMA_NUMBER = re.compile(r"\s*[-+]?\d*,\d+(?:[eE][-+]?\d+)?\s*")


def cells_of(text: str) -> list[list[str]]:
    """Return the cells of a table whose header shows whether `,`, `;` or tabs separate them.

    Beside the latter two, a comma in a number is that of its decimals.
    """
    lines = text.splitlines()
    head = next((line for line in lines if any(mark in line for mark in ",;\t")), "")
    separator = max(",;\t", key=head.count)
    rows = list(csv.reader(lines, delimiter=separator))
    if separator == ",":
        return rows
    return [[c.replace(",", ".") if _COMMA_NUMBER.fullmatch(c) else c for c in row] for row in rows]


def read_numbers(
    path: str | pathlib.Path, columns: tuple[str, ...], least: int, optional: tuple[str, ...] = ()
) -> list[list[float]]:
    """Return the rows of a CSV file, at least so many, of finite numbers in some columns.

    Optional columns follow if the file has them.

    Raises:
        InputError: There is no such file, or something is missing or no number.
    """
    values, rows = [], read_csv(path, columns)
    columns += tuple(name for name in optional if any(name in row for row in rows))
    for number, row in enumerate(rows, start=1):
        values.append([])
        for name in columns:
            cell = row.get(name) or ""
            try:
                values[-1].append(float(cell))
            except ValueError:
                values[-1].append(math.nan)
            if not math.isfinite(values[-1][-1]):
                raise InputError(
                    f"{path}: {name} = {cell[:40]!r} in row {number} is no finite number"
                )
    if len(values) < least:
        raise InputError(
            f"{path} must hold at least {least} rows of finite numbers, not {len(values)}"
        )
    return values


def write_csv(path: pathlib.Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a table whole; see `write_bytes`."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    write_text(path, text.getvalue())


def read_json(path: str | pathlib.Path) -> dict[str, Any]:
    """Return the mapping that a JSON file holds.

    Raises:
        FileNotFoundError: There is no such file.
        UnreadableFileError: The system refuses to read it.
        DamagedFileError: It is not JSON, or no mapping.
    """
    try:
        values = json.loads(read_text(path, JSON_SIZE_MAX))
    except (ValueError, RecursionError) as error:
        reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
        raise DamagedFileError(f"{path} is damaged: {' '.join(reason.split())[:200]}") from None
    if not isinstance(values, dict):
        raise DamagedFileError(f"{path} is damaged: it must hold a mapping of names to values")
    return values


_TEMPORARY = re.compile(r"\..+\.(\d+)-.*\.tmp")


def temporary_prefix(path: pathlib.Path) -> str:
    """Return the prefix of a file's temporary names, which holds the number of the process."""
    return f".{path.name}.{os.getpid()}-"


def remove_leftovers(path: pathlib.Path) -> None:
    """Remove what processes that were killed left of a file or folder, under temporary names."""
    for left in path.parent.glob(f".{glob.escape(path.name)}.*-*.tmp"):
        if not is_leftover(left):
            continue
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)


def is_leftover(path: pathlib.Path) -> bool:
    """Return whether a file or folder has a temporary name of a process that is gone."""
    named = _TEMPORARY.fullmatch(path.name)
    return named is not None and not _is_alive(int(named[1]))


def _is_alive(process: int) -> bool:
    if os.name == "nt":
        # There, signal 0 is no question.
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        # It belongs to another user.
        return True
    return True


def write_bytes(path: pathlib.Path, content: bytes) -> None:
    """Write a file under a temporary name, flush it to the disk, and rename it.

    Its folder is created.
    """
    temporary = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(
            prefix=temporary_prefix(path), suffix=".tmp", dir=path.parent
        )
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes files that only their owner may read; results are for sharing, unless a
        # person has closed the file.
        umask = os.umask(0)
        os.umask(umask)
        mode = stat.S_IMODE(path.stat().st_mode) if path.exists() else 0o666 & ~umask
        os.chmod(temporary, mode)
        os.replace(temporary, path)
    except BaseException as error:
        if temporary:
            pathlib.Path(temporary).unlink(missing_ok=True)
        # A person knows the file, not its temporary name; writing itself names none at all.
        if isinstance(error, OSError) and error.errno is not None:
            error.filename, error.filename2 = str(path), None
        raise


def write_text(path: pathlib.Path, text: str) -> None:
    """Write text in UTF-8; see `write_bytes`."""
    write_bytes(path, text.encode())


def write_json(path: pathlib.Path, values: Any) -> None:
    """Write plain values as indented JSON, which has no NaN; see `write_bytes`."""
    text = json.dumps(values, indent=2, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")


def seal(values: dict[str, Any]) -> dict[str, Any]:
    """Return plain values with their checksum added."""
    plain = json.loads(json.dumps(values, allow_nan=False))
    return {**plain, CHECKSUM_KEY: _checksum(plain)}


def read_sealed(path: str | pathlib.Path) -> dict[str, Any]:
    """Return the values of a sealed JSON file; see `seal`.

    Raises:
        FileNotFoundError: There is no such file.
        UnreadableFileError: The system refuses to read it.
        DamagedFileError: It is not JSON or no mapping, or its checksum does not match.
    """
    values = read_json(path)
    stored = values.pop(CHECKSUM_KEY, None)
    try:
        checksum = _checksum(values)
    except RecursionError:
        raise DamagedFileError(f"{path} is damaged: nested too deeply") from None
    if stored != checksum:
        raise DamagedFileError(f"{path} is damaged: its content does not match its checksum")
    return values


def _checksum(values: dict[str, Any]) -> str:
    text = json.dumps(values, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]


DISTRIBUTIONS = (
    "cablecast",
    "numpy",
    "scipy",
    "warp-lang",
    "mujoco",
    "ruckig",
    "torch",
    "pyarrow",
    "matplotlib",
)
"""Distributions whose versions affect the results."""


def core_count() -> int:
    """Return the number of processor cores that this process may use, at least 1."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@functools.cache
def processor_name() -> str:
    """Return the name of the processor as Linux states it; empty elsewhere."""
    try:
        lines = pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    return next((line.partition(":")[2].strip() for line in lines if "model name" in line), "")


@functools.cache
def library_versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries that affect the results.

    The libraries are not imported; what the process has imported no longer changes.
    """
    versions = {"python": platform.python_version(), "platform": platform.platform()}
    for name in DISTRIBUTIONS:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions
