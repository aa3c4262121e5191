"""The examples in the docstrings run, and print what they say."""

import doctest
import importlib
import pathlib
import types

import pytest

from cablecast.errors import MissingExtraError

SOURCE = pathlib.Path(__file__).parents[1] / "src"
# Found as text, so that no module is imported before its own test, and none without an example.
MODULES = [
    ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__")
    for path in sorted(SOURCE.rglob("*.py"))
    if ">>> " in path.read_text()
]
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def run_examples(module) -> int:
    """Run the examples of a module and return how many there are."""
    count = 0
    for docstring in doctest.DocTestFinder(exclude_empty=True).find(module):
        try:
            doctest.DebugRunner(optionflags=FLAGS).run(docstring)
        except doctest.DocTestFailure as failure:
            pytest.fail(
                f"{failure.test.name}: {failure.example.source.strip()} printed {failure.got!r}, "
                f"not {failure.example.want!r}",
                pytrace=False,
            )
        except doctest.UnexpectedException as failure:
            error = failure.exc_info[1]
            if isinstance(error, MissingExtraError):
                pytest.skip(str(error))
            raise AssertionError(
                f"{failure.test.name}: {failure.example.source.strip()} raised {error!r}"
            ) from error
        count += len(docstring.examples)
    return count


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_print_what_they_say(name):
    assert run_examples(importlib.import_module(name)) > 0


def test_conventions_are_explained_by_examples():
    assert "cablecast.conventions" in MODULES


def test_an_example_that_prints_something_else_fails():
    module = types.ModuleType("wrong")
    module.__doc__ = ">>> 1 + 1\n3\n"
    with pytest.raises(pytest.fail.Exception, match=r"1 \+ 1 printed '2"):
        run_examples(module)


def test_an_example_without_its_extra_is_skipped():
    module = types.ModuleType("without")
    module.__doc__ = ">>> raise error\n"
    module.error = MissingExtraError("torch", "learn", "training")
    with pytest.raises(pytest.skip.Exception, match="training needs torch"):
        run_examples(module)
