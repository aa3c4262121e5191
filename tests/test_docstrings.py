"""Openings of docstrings where ruff does not look: attributes, properties, classes, modules.

ruff checks the rest: the Google convention, and the imperative mood of functions.
"""

import ast
import pathlib
import re
from collections.abc import Iterator

import pytest

SOURCE = pathlib.Path(__file__).parents[1] / "src" / "cablecast"
ROOMS = sorted({path.relative_to(SOURCE).parts[0] for path in SOURCE.rglob("*.py")})
# A question word or a bare genitive makes the reader guess the noun.
BAD_OPENING = re.compile(r"(What|How|Where|Which|Whether|Of)\b")
BAD_ARGUMENT = re.compile(r"^ *\w+: (Of\b.*)$", re.MULTILINE)

_Documented = ast.Module | ast.ClassDef | ast.FunctionDef


def find_docstrings(source: str) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of each docstring, those below attributes included."""
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, _Documented):
            continue
        before: ast.stmt | None = None
        for index, statement in enumerate(node.body):
            below_attribute = isinstance(before, ast.Assign | ast.AnnAssign)
            if (
                (index == 0 or below_attribute)
                and isinstance(statement, ast.Expr)
                and isinstance(statement.value, ast.Constant)
                and isinstance(statement.value.value, str)
            ):
                yield statement.lineno, statement.value.value.strip()
            before = statement


def bad_openings(source: str) -> Iterator[tuple[int, str]]:
    for line, text in find_docstrings(source):
        if BAD_OPENING.match(text):
            yield line, text.splitlines()[0]
        for argument in BAD_ARGUMENT.findall(text):
            yield line, argument


@pytest.mark.parametrize("room", ROOMS)
def test_docstrings_and_arguments_open_with_a_verb_or_a_noun(room):
    paths = [SOURCE / room] if room.endswith(".py") else sorted((SOURCE / room).rglob("*.py"))
    found = [
        f"{path.relative_to(SOURCE)}:{line} {text}"
        for path in paths
        for line, text in bad_openings(path.read_text())
    ]
    assert not found, "\n" + "\n".join(found)


def test_every_kind_of_docstring_is_looked_at():
    source = '''"""What a module does."""
class Cable:
    """Which cable."""
    length: float
    """How long [m]."""
    @property
    def is_stiff(self):
        """Whether it is stiff.

        Args:
            seed: Of the choice.
        """
        return "How it goes on"
def load(path):
    """Of the folder."""
'''
    assert [line for line, _ in sorted(bad_openings(source))] == [1, 3, 5, 8, 8, 15]


def test_a_verb_or_a_noun_may_open_a_docstring():
    assert not list(bad_openings('"""Whatever, Offset, Returned: Offset: Office."""'))
