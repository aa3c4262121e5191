"""Seeded damage to every file of a run: a verb says what it said before, or refuses in one line."""

import random

import pytest
from tools.attack_inputs import damaged_bytes, damaged_json

from cablecast.cli import main

# Files that each verb reads, beside those of the verbs before it.
READS = {
    "collect": ["casts/meta/info.json", "casts/metrics.json", "casts/data/**/*"],
    "tune": ["casts/data/**/*", "tune/*.json", "tune/**/*.json"],
    "repeat": ["repeat/*.json", "repeat/**/info.json", "repeat/**/*.parquet"],
    "select": ["select/*.json", "repeat/*.json"],
    "train": ["dataset/meta/info.json", "dataset/data/**/*", "model/*.json", "model/policy.npz"],
    "plan": ["model/policy.npz", "model/model.safetensors"],
    "evaluate": ["evaluate/*.json", "evaluate/casts/**/*.parquet", "evaluate/casts/**/info.json"],
}
# Each asks a verb once, which takes a tenth of a second, or a second where 32 casts are planned.
DAMAGES = 12
DAMAGES_OF_EVALUATIONS = 5
# Files for people, which no verb reads.
UNREAD = ("README.md", "stats.json", "model.json")


def contents(folder):
    return {file: file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}


def ask(verb, capsys):
    """Return the exit status of a verb, its standard output, and its lines of errors."""
    capsys.readouterr()
    status = main(list(SMALL_VERBS[verb]))
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    lines = [line for line in captured.err.splitlines() if line.startswith("cablecast: ")]
    return status, captured.out, lines


@pytest.mark.parametrize("verb", READS)
def test_damage_is_refused_or_of_no_consequence(verb, in_copy, capsys):
    status, said, _ = ask(verb, capsys)
    assert status == 0
    before = contents(in_copy)
    files = [
        file
        for pattern in READS[verb]
        for file in sorted(in_copy.glob(pattern))
        if file.is_file() and file.name not in UNREAD
    ]
    rng = random.Random(f"damage of {verb}")
    refused = 0
    count = DAMAGES_OF_EVALUATIONS if verb == "evaluate" else DAMAGES
    for number in range(count):
        file = files[number % len(files)] if number < len(files) else rng.choice(files)
        damage = damaged_json if file.suffix == ".json" and number % 2 else damaged_bytes
        label, content = damage(before[file], rng)
        label = f"{file.name}: {label}"
        file.write_bytes(content)
        status, out, lines = ask(verb, capsys)
        after = contents(in_copy)
        if status == 0:
            assert out == said, label
            # Figures that can be computed again are written again, as they were.
            assert after[file] in (before[file], content), label
        else:
            assert (status, len(lines)) == (2, 1), label
            assert file.name in lines[0], label
            refused += 1
        changed = {name for name in before if after.get(name) != before[name]} - {file}
        assert not changed, label
        file.write_bytes(before[file])
    assert refused > count / 3


@pytest.mark.parametrize("verb", READS)
def test_a_file_that_the_system_refuses_is_not_called_damaged(verb, in_copy, capsys):
    for pattern in READS[verb]:
        found = (file for file in sorted(in_copy.glob(pattern)) if file.name not in UNREAD)
        file = next(file for file in found if file.is_file())
        aside = file.with_name("aside")
        file.rename(aside)
        # Whoever runs the tests may read everything, but nobody reads a folder as a file.
        file.mkdir()
        status, _, lines = ask(verb, capsys)
        file.rmdir()
        aside.rename(file)
        assert (status, len(lines)) == (2, 1), file
        assert file.name in lines[0]
        for word in ("damaged", "delete", "truncated", "restore"):
            assert word not in lines[0].lower(), lines[0]
