"""The tools of a release know every extra and every licence."""

import importlib.metadata

from tools.check_release import TRIALS, UNKNOWN, dependencies, extras, licence


def test_every_extra_is_tried_alone():
    assert set(TRIALS) == {"", *extras()}


def test_the_licence_of_every_dependency_is_stated():
    rows = dependencies(("all",))
    assert {"numpy", "torch", "mujoco", "warp-lang"} <= set(rows)
    # Installed by the extra of an extra, or by a dependency.
    assert {"safetensors", "markupsafe"} <= set(rows)
    unknown = [name for name, row in rows.items() if row is not None and licence(row) == UNKNOWN]
    assert unknown == []


def test_a_distribution_states_its_licence_in_one_of_three_ways():
    stated = {
        "License-Expression: MIT": "MIT",
        "Classifier: License :: OSI Approved :: BSD License": "BSD License",
        "License: Apache 2\n\n        and its text": "Apache 2",
        "Keywords: none": UNKNOWN,
    }
    for line, expected in stated.items():
        assert licence(_Distribution(f"Name: x\nVersion: 1\n{line}\n")) == expected


class _Distribution(importlib.metadata.Distribution):
    def __init__(self, text):
        self.text = text

    def read_text(self, filename):
        return self.text if filename == "METADATA" else None

    def locate_file(self, path):
        raise NotImplementedError
