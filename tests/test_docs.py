"""What README and docs promise exists: links, pictures, verbs, options, modules, names."""

import ast
import contextlib
import dataclasses
import importlib
import importlib.util
import inspect
import pathlib
import re
import shlex
import typing

import numpy as np
import pytest
from benchmarks.__main__ import COMMANDS, parse
from tools.type_commands import (
    ELSEWHERE,
    MADE,
    blocks,
    commands_of,
    pages_with_commands,
    why_elsewhere,
)
from tools.type_commands import PAGES as TYPED

import cablecast
from cablecast.arm.base import JointLimits
from cablecast.arm.ur import ARM_MODELS
from cablecast.cli import main as run_command
from cablecast.cli.main import VERBS
from cablecast.errors import JointLimitError
from cablecast.motion.feasibility import check_actions, feasible_ranges
from cablecast.motion.polar import plan_reset, reset_pose

ROOT = pathlib.Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
HELP = {"--help", "--version"}


def by_name(page: pathlib.Path) -> str:
    return page.relative_to(ROOT).as_posix()


def commands(page: pathlib.Path) -> list[list[str]]:
    """Return the commands in the fenced blocks of a page, split as a shell splits them."""
    return [shlex.split(command.plain) for command in commands_of(by_name(page))]


def inline_commands(page: pathlib.Path) -> list[list[str]]:
    """Return what stands between backticks and looks like a command or an option."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    spans = (" ".join(span.split()) for span in re.findall(r"`([^`]+)`", text))
    return [
        span.split() for span in spans if re.match(r"(\S*/)?(cablecast|python|make) |--\w", span)
    ]


def options_of(verb: str) -> set[str]:
    fields = dataclasses.fields(VERBS[verb])
    switches = {f"--no-{field.name}" for field in fields if field.default is True}
    return {f"--{field.name.replace('_', '-')}" for field in fields} | switches | HELP


def options_in(words: list[str]) -> list[str]:
    return [word.partition("=")[0] for word in words if word.startswith("--")]


@pytest.fixture(scope="module")
def every_option() -> set[str]:
    """Options of any verb, and of the modules and scripts that the pages tell to run."""
    known = set().union(*map(options_of, VERBS))
    for page in PAGES:
        for words in [*commands(page), *inline_commands(page)]:
            source = ""
            if "-m" in words[:-1]:
                source = module_source(words)
            elif words[0].endswith("python") and words[1].endswith(".py"):
                source = (ROOT / words[1]).read_text()
            known |= set(re.findall(r'"(--[\w-]+)"', source))
    return known


def module_source(words: list[str]) -> str:
    """Source of the module that `python -m MODULE` runs."""
    name = words[words.index("-m") + 1]
    spec = importlib.util.find_spec(name)
    assert spec is not None, f"there is no module {name}"
    assert spec.origin
    return pathlib.Path(spec.origin).read_text()


@pytest.mark.parametrize("page", PAGES, ids=by_name)
def test_every_relative_link_and_picture_leads_to_a_file(page):
    text = re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for target in re.findall(r"\]\(([^)\s]+)\)|src=\"([^\"]+)\"", text):
        link, _, heading = "".join(target).partition("#")
        if re.match(r"\w+:", link):
            continue
        file = page.parent / link if link else page
        assert file.exists(), f"{by_name(page)} links to {link}"
        if heading:
            headings = re.findall(r"^#+ (.*)$", file.read_text(), re.MULTILINE)
            slugs = {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings}
            assert heading in slugs, f"{by_name(page)} links to #{heading}"


# What a user reads; tables that results fill are left out.
WORDS_MAX = 22_000
# About ten minutes of reading, with all tables.
PAGE_WORDS_MAX = 2_500
# A list of closed forms, which a program writes.
LONG_PAGES = {"docs/validation.md"}


def words(text: str) -> int:
    """Count what has a letter or a digit between spaces."""
    return len(re.findall(r"\S*\w\S*", text))


def test_all_pages_together_are_read_in_two_hours():
    results = re.compile(r"<!-- results: .*?<!-- end of results -->", re.DOTALL)
    counts = {by_name(page): words(results.sub("", page.read_text())) for page in PAGES}
    assert sum(counts.values()) <= WORDS_MAX, sorted(counts.items(), key=lambda item: -item[1])


@pytest.mark.parametrize("page", PAGES, ids=by_name)
def test_a_page_is_read_in_ten_minutes(page):
    assert by_name(page) in LONG_PAGES or words(page.read_text()) <= PAGE_WORDS_MAX


def test_every_page_is_listed():
    listed = (ROOT / "docs" / "README.md").read_text()
    for page in PAGES[1:]:
        assert page.name == "README.md" or f"({page.name})" in listed


def test_every_verb_is_listed():
    listed = (ROOT / "docs" / "README.md").read_text()
    assert {verb for verb in VERBS if f"`{verb}`" not in listed} == set()


@pytest.mark.parametrize("page", PAGES, ids=by_name)
def test_every_command_in_a_block_is_understood(page, monkeypatch):
    for verb in VERBS.values():
        monkeypatch.setattr(verb, "run", lambda self: None)
    for words in commands(page):
        if pathlib.Path(words[0]).name == "cablecast":
            assert run_command(words[1:]) == 0


def test_every_command_in_a_block_is_typed_or_named_with_what_runs_it():
    assert set(pages_with_commands()) == set(TYPED)
    lines = [command for page in TYPED for command in commands_of(page)]
    assert set(ELSEWHERE) <= {line.plain for line in lines}
    for page, start in MADE:
        assert any(one.page == page and one.plain.startswith(start) for one in lines), start
    for reason in filter(None, map(why_elsewhere, lines)):
        for name in re.findall(r"tests/\S+\.py", reason):
            assert (ROOT / name).is_file(), name


@pytest.mark.parametrize("page", PAGES, ids=by_name)
def test_every_verb_and_option_in_the_text_exists(page, every_option):
    for words in inline_commands(page):
        if words[1:3] == ["-m", "benchmarks"]:
            continue  # Parsed whole by the test of modules.
        known = every_option
        if pathlib.Path(words[0]).name == "cablecast":
            verb = next((word for word in words[1:] if not word.startswith("--")), None)
            assert verb is None or verb in VERBS, " ".join(words)
            known = options_of(verb) if verb else HELP
        assert set(options_in(words)) <= known, " ".join(words)


@pytest.mark.parametrize("page", PAGES, ids=by_name)
def test_every_module_and_target_that_is_run_exists(page):
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for words in [*commands(page), *inline_commands(page)]:
        if words[0] == "make":
            assert next(word for word in words[1:] if "=" not in word) in targets
        if words[0].endswith("python") and words[1].endswith(".py"):
            assert (ROOT / words[1]).is_file(), " ".join(words)
        if "-m" not in words[:-1] or words[words.index("-m") + 1] in ("pytest", "venv", "pip"):
            continue
        source = module_source(words)
        after = words[words.index("-m") + 2 :]
        if words[words.index("-m") + 1] == "benchmarks":
            assert not after or after[0] in (*COMMANDS, "all", "pages"), " ".join(words)
            if options_in(after) and after[0] in COMMANDS:
                parse(after[0], after[1:])
            continue
        for option in options_in(after):
            field = option[2:].replace("-", "_")
            assert f'"{option}"' in source or re.search(rf"^    {field}: ", source, re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=by_name)
def test_every_name_that_a_block_imports_exists(page):
    for language, content in blocks(page.read_text()):
        if language != "python":
            continue
        for node in ast.walk(ast.parse(content)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("cablecast"):
                module = importlib.import_module(node.module or "")
                for alias in node.names:
                    assert hasattr(module, alias.name), f"{node.module}.{alias.name}"


@pytest.mark.parametrize("page", PAGES, ids=by_name)
def test_every_public_name_and_keyword_that_a_block_uses_exists(page):
    """Only calls of `cc.NAME(...)` are looked at; what a block makes of the results is not."""
    for language, content in blocks(page.read_text()):
        if language != "python":
            continue
        for node in ast.walk(ast.parse(content)):
            if is_public(node):
                assert node.attr in cablecast.__all__, f"cablecast has no {node.attr}"
            if isinstance(node, ast.Call) and is_public(node.func):
                known = inspect.signature(getattr(cablecast, node.func.attr)).parameters
                used = {keyword.arg for keyword in node.keywords}
                assert used <= set(known), f"{node.func.attr} takes no {used - set(known)}"


def is_public(node: ast.AST) -> typing.TypeGuard[ast.Attribute]:
    """Whether a node is an attribute of `cc`, as the pages import cablecast."""
    return (
        isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id == "cc"
    )


def test_the_library_page_lists_every_public_name():
    page = (ROOT / "docs" / "library.md").read_text()
    section = page.split("## Every public name")[1].split("\n## ")[0]
    missing = {name for name in cablecast.__all__ if f"`{name}`" not in section}
    assert missing == {"__version__"}


@pytest.mark.parametrize("section", ["workspace", "arm", "motion"])
def test_the_lab_page_states_every_key_with_its_default(section):
    part = getattr(cablecast.Setup(), section)
    stated = keys_of_the_lab_page(section)
    for field in dataclasses.fields(part):
        value = getattr(part, field.name)
        if isinstance(value, (str, bool)):
            assert stated[field.name] == f"`{str(value).lower()}`"
        elif not isinstance(value, JointLimits):
            assert float(stated[field.name]) == value


@pytest.mark.parametrize(
    ("section", "kind"),
    [("cable", cablecast.Cable), ("cable", cablecast.CableParams), ("arm", JointLimits)],
)
def test_the_lab_page_states_every_key_of_a_nested_section(section, kind):
    assert {field.name for field in dataclasses.fields(kind)} <= set(keys_of_the_lab_page(section))


# Of the 20 s of a trial.
RESET_TIME_MAX = 19.0


def test_the_arms_of_the_lab_page_can_make_most_motions_with_the_settings_there():
    page = (ROOT / "docs" / "lab.md").read_text().split("## Other arms")[1]
    rows = re.findall(r"^\| `(ur\w+)` \|" + r" ([\d.]+) \|" * 6, page, re.MULTILINE)
    assert [row[0] for row in rows] == list(ARM_MODELS)
    for model, *numbers in rows:
        base_height, r_max, reset_y, r0, v_max, jerk = map(float, numbers)
        setup = cablecast.Setup(
            workspace=cablecast.Workspace(
                r_max=r_max, reset_y=reset_y, support_depth=min(reset_y, 0.466)
            ),
            arm=cablecast.ArmUR(model=model, base_height=base_height),
            motion=cablecast.MotionConfig(r0=r0, v_max=v_max, jerk=jerk),
        )
        # Where the first wrist joint is level with the shoulder.
        level = setup.workspace.grip_height + setup.arm.gripper_length
        level += setup.arm.lengths.d6 - setup.arm.lengths.d1
        assert base_height == pytest.approx(level, abs=5e-4)
        resets = contextlib.nullcontext()
        if model in ("ur3", "ur3e"):
            resets = pytest.raises(JointLimitError, match=r"even 1\.3 times as slow")
        with resets:
            assert plan_reset(reset_pose(setup.workspace), setup).duration < RESET_TIME_MAX, model
        ranges = feasible_ranges(setup)
        box = np.array([ranges.theta1, ranges.theta2, ranges.r2, ranges.wrist])
        drawn = np.random.default_rng(0).uniform(box[:, 0], box[:, 1], (500, 4))
        drawn[:, 3] += drawn[:, 1]
        assert check_actions(drawn, setup).mask.mean() > 0.9, model


def keys_of_the_lab_page(section: str) -> dict[str, str]:
    """Third cell of each row of the tables of a section, by the key in the first."""
    page = (ROOT / "docs" / "lab.md").read_text()
    text = re.split(r"^##", page.split(f"### `{section}`")[1], maxsplit=1, flags=re.MULTILINE)[0]
    rows = re.findall(r"^\| `(\w+)` \|[^|]*\| ([^|]*) \|", text, re.MULTILINE)
    return dict(rows)
