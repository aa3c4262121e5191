"""The learning side cannot read what is true in the laboratory."""

import ast
import dataclasses
import pathlib

import numpy as np
import pytest

import cablecast
from cablecast.cable import CABLE_NAMES, load_cable
from cablecast.rigs.virtual import RigVirtual
from cablecast.rigs.virtual._hidden import effect_strengths, hidden_cable

SOURCE = pathlib.Path(cablecast.__file__).parent
SHARED = ("mass", "bend_stiffness", "twist_stiffness", "friction", "endpoint_mass")


def imported_names(text):
    """Every module that a file imports, and every name that it takes from one."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_only_the_laboratory_reads_hidden_parameters_and_others_know_what_it_makes_public():
    room, rigs = SOURCE / "rigs" / "virtual", SOURCE / "rigs"
    public = {f"cablecast.rigs.virtual.{n}" for n in ("RigVirtual", "TrialNoise", "VirtualConfig")}
    readers = 0
    for path in SOURCE.rglob("*.py"):
        text = path.read_text()
        if "rigs.virtual" not in text:
            continue
        names = [n for n in imported_names(text) if n.startswith("cablecast.rigs.virtual")]
        if any("_hidden" in name for name in names):
            readers += 1
            assert path.is_relative_to(room), path
        # The twin, among the rigs, is the laboratory behind a network: it lets out the protocols.
        if not path.is_relative_to(rigs):
            assert "hidden_cable" not in text, path
            assert set(names) <= public, path
    assert readers


def test_the_description_tells_no_hidden_value(cable, setup):
    pytest.importorskip("mujoco")
    description = RigVirtual(setup).description

    def numbers(value):
        if isinstance(value, dict):
            for item in value.values():
                yield from numbers(item)
        elif isinstance(value, float):
            yield value

    truth = hidden_cable(cable, 0, effect_strengths(0))
    assert not {getattr(truth, name) for name in SHARED} & set(numbers(description))


@pytest.mark.parametrize("name", CABLE_NAMES)
def test_the_truth_differs_from_the_belief_by_a_believable_amount(name):
    cable = load_cable(name)
    truth = hidden_cable(cable, 0, effect_strengths(0))
    for parameter in SHARED:
        ratio = getattr(truth, parameter) / getattr(cable.params, parameter)
        # Strands that stick make a cable stiffer than a look-up says.
        assert 0.5 < ratio < 3.6, parameter
        assert abs(ratio - 1) > 0.02, parameter


def test_another_laboratory_has_another_copy_of_the_same_cable(cable):
    values = [
        dataclasses.astuple(hidden_cable(cable, seed, effect_strengths(seed)))[:3]
        for seed in (0, 1, 2)
    ]
    assert len(set(values)) == 3
    np.testing.assert_allclose(values[1], values[0], rtol=0.2)


def test_a_users_cable_has_a_truth_of_its_own_about_its_parameters(cable):
    own = dataclasses.replace(cable, name="garden_hose", length=0.8)
    truth = hidden_cable(own, 0, effect_strengths(0))
    assert truth == hidden_cable(own, 0, effect_strengths(0))
    assert truth != hidden_cable(own, 1, effect_strengths(1))
    for parameter in SHARED:
        believed = getattr(own.params, parameter)
        assert getattr(truth, parameter) != believed
        assert 0.2 < getattr(truth, parameter) / believed < 5.0


def test_tuning_the_belief_of_a_preset_does_not_change_its_truth(cable):
    tuned = cable.with_params(mass=0.2)
    assert hidden_cable(tuned, 0, effect_strengths(0)) == hidden_cable(
        cable, 0, effect_strengths(0)
    )
