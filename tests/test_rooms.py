"""The rooms of the library: imports point to earlier rooms, without circles.

The order of the rooms stands in pyproject.toml, under [tool.cablecast].
"""

import ast
import pathlib
import tomllib
from collections.abc import Iterator
from typing import NamedTuple

import pytest

ROOT = pathlib.Path(__file__).parents[1]
PACKAGE = "cablecast"
# The public face imports from every room, and `python -m cablecast` starts the last one.
EXEMPT = {PACKAGE, f"{PACKAGE}.__main__"}
# All that a room may take from the public face: anything else would hide where it comes from.
FACE_NAMES = {"__version__"}
ROOMS: list[str] = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["cablecast"][
    "rooms"
]


class Import(NamedTuple):
    """One import of something that belongs to the package."""

    line: int
    module: str
    """Module that is imported, or that a name is imported from."""
    name: str | None = None
    """Name that is imported, None for a module."""


class Module(NamedTuple):
    """One source file of the package."""

    name: str
    path: pathlib.Path

    @property
    def source(self) -> str:
        return self.path.read_text()

    @property
    def imports(self) -> list[Import]:
        package = self.name if self.path.stem == "__init__" else self.name.rpartition(".")[0]
        return list(find_imports(self.source, package, set(MODULES)))


def read_modules(source: pathlib.Path) -> dict[str, Module]:
    modules = {}
    for path in sorted((source / PACKAGE).rglob("*.py")):
        parts = path.relative_to(source).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        modules[name] = Module(name, path)
    return modules


def find_imports(source: str, package: str, modules: set[str]) -> Iterator[Import]:
    """Find the imports from the package at any depth: top level, TYPE_CHECKING, functions.

    Args:
        source: Text of a module.
        package: Package that relative imports start from.
        modules: Names of all modules, which tell `from a import module` from `from a import name`.
    """
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if _is_ours(alias.name):
                    yield Import(node.lineno, alias.name)
                if alias.name == PACKAGE:
                    yield from _uses_of_face(tree, alias.asname or PACKAGE, modules)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                stem = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*stem, *filter(None, [base])])
            if not _is_ours(base):
                continue
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                if inner in modules:
                    yield Import(node.lineno, inner)
                else:
                    yield Import(node.lineno, base, alias.name)


def _is_ours(name: str) -> bool:
    return name.partition(".")[0] == PACKAGE


def _uses_of_face(tree: ast.AST, bound: str, modules: set[str]) -> Iterator[Import]:
    """Find `cablecast.name` after `import cablecast`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            inner = f"{PACKAGE}.{node.attr}"
            if node.value.id == bound and inner not in modules:
                yield Import(node.lineno, PACKAGE, node.attr)


def room_of(module: str) -> str:
    return module.split(".")[1]


def find_circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Find the strongly connected components of two modules or more."""
    reached: dict[str, set[str]] = {}
    for start in edges:
        seen: set[str] = set()
        ahead = list(edges[start])
        while ahead:
            module = ahead.pop()
            if module not in seen:
                seen.add(module)
                ahead += edges.get(module, set())
        reached[start] = seen
    circles = {
        frozenset(other for other in reached[module] if module in reached.get(other, set()))
        for module in edges
        if module in reached[module]
    }
    return sorted(sorted(circle) for circle in circles)


MODULES = read_modules(ROOT / "src")
INNER = {name: module for name, module in MODULES.items() if name not in EXEMPT}
PRESENT = sorted({room_of(name) for name in INNER})


def test_every_room_has_its_place_in_the_order():
    unknown = [room for room in PRESENT if room not in ROOMS]
    missing = [room for room in ROOMS if room not in PRESENT]
    assert not unknown, (
        f"not in `rooms` of pyproject.toml, which says what may import what: {', '.join(unknown)}"
    )
    assert not missing, f"in `rooms` of pyproject.toml, but not in src: {', '.join(missing)}"
    assert len(set(ROOMS)) == len(ROOMS), "a room stands twice in `rooms` of pyproject.toml"


def test_the_order_in_contributing_is_that_of_the_project_file():
    text = " ".join((ROOT / "CONTRIBUTING.md").read_text().split())
    assert ", ".join(ROOMS) + "." in text


@pytest.mark.parametrize("room", PRESENT)
def test_a_room_imports_only_from_earlier_rooms(room):
    assert room in ROOMS, f"{room} is not in `rooms` of pyproject.toml"
    wrong = []
    for module in INNER.values():
        if room_of(module.name) != room:
            continue
        for found in module.imports:
            if found.module in EXEMPT:
                if found.name and found.name not in FACE_NAMES:
                    wrong.append(
                        f"{module.name}:{found.line} takes {found.name} from the public face: "
                        "import it from its own module"
                    )
                continue
            other = room_of(found.module)
            if other not in ROOMS:
                wrong.append(
                    f"{module.name}:{found.line} imports {found.module}: {other} is not in `rooms` "
                    "of pyproject.toml"
                )
            elif ROOMS.index(other) > ROOMS.index(room):
                wrong.append(
                    f"{module.name}:{found.line} imports {found.module}: {other} comes after {room}"
                )
    assert not wrong, "\n" + "\n".join(wrong)


@pytest.mark.parametrize("room", PRESENT)
def test_a_room_has_no_circle_of_imports(room):
    inside = {name: module for name, module in INNER.items() if room_of(name) == room}
    edges = {
        name: {found.module for found in module.imports if found.module in inside} - {name}
        for name, module in inside.items()
    }
    circles = [" <-> ".join(circle) for circle in find_circles(edges)]
    assert not circles, "\n" + "\n".join(circles)


def test_an_import_is_seen_wherever_it_stands():
    source = """
from typing import TYPE_CHECKING
import cablecast, numpy
from cablecast import __version__, files
if TYPE_CHECKING:
    from cablecast.cable import Cable
def load():
    import cablecast.report.page as page
    from . import base
    from ..cast import Track
    return cablecast.Setup
"""
    modules = {"cablecast", "cablecast.files", "cablecast.engines.base", "cablecast.cast"}
    found = {(i.module, i.name) for i in find_imports(source, "cablecast.engines", modules)}
    assert found == {
        ("cablecast", None),
        ("cablecast", "Setup"),
        ("cablecast", "__version__"),
        ("cablecast.files", None),
        ("cablecast.cable", "Cable"),
        ("cablecast.report.page", None),
        ("cablecast.engines.base", None),
        ("cablecast.cast", "Track"),
    }


def test_circles_are_found_whole_and_told_apart():
    edges = {"a": {"b"}, "b": {"c", "d"}, "c": {"a"}, "d": {"e"}, "e": {"d"}, "f": {"a"}}
    assert find_circles(edges) == [["a", "b", "c"], ["d", "e"]]
