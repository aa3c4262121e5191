"""The library of simulated resets: what is stored, and how it is made and drawn from."""

import dataclasses

import numpy as np
import pytest
from tools.make_reset_library import hidden_digest, report

from cablecast.arm.ur import ArmUR
from cablecast.cable import CABLE_NAMES, load_cable
from cablecast.errors import DatasetError
from cablecast.rigs.virtual.trials import (
    ResetLibrary,
    find_library,
    library_path,
)
from cablecast.setup import Setup
from cablecast.workspace import Workspace

WORKSPACE = Workspace()
SIZE_MAX = 300_000
"""What all libraries may take in the package [bytes]."""
STRETCH = 2e-3
"""How far a resampled segment may be from its length [-]: the stored nodes are 2 cm apart."""
STRETCH_GRIP = 2e-4
"""The same next to the grip, where the cable bends within one such distance [m]."""


@pytest.mark.parametrize("name", CABLE_NAMES)
def test_every_preset_has_a_library_of_cables_that_lie_straight_ahead(name):
    library = find_library(Setup(cable=name))
    assert library is not None
    assert len(library) >= 32
    length = load_cable(name).length
    ahead = library.endpoints[:, 1] > 0.97 * length
    ahead &= np.abs(np.degrees(np.arctan2(*library.endpoints.T))) < 10
    # A reset may fail, rarely; a trial never begins from it.
    assert ahead.mean() >= 0.95
    assert np.all(ahead[library.accepted()])
    assert len(library.accepted()) >= 12
    # Nobody lies below the table, and the grip is the origin.
    heights = library.positions[library.accepted(), :, 2] + WORKSPACE.grip_height
    assert np.min(heights) > load_cable(name).radius - 1.5e-3
    np.testing.assert_allclose(library.positions[:, 0], 0.0, atol=1e-6)


def test_all_libraries_together_are_small():
    assert sum(library_path(name).stat().st_size for name in CABLE_NAMES) < SIZE_MAX


def test_resets_scatter_far_less_than_the_casts_before_them():
    for name in CABLE_NAMES:
        library = find_library(Setup(cable=name))
        assert library is not None
        values = report(library)
        assert values["before_scatter_pct"] > 50.0
        assert 0.0 < values["aside_scatter_pct"] < 0.1 * values["before_scatter_pct"]


def test_a_state_at_other_nodes_keeps_its_lengths():
    setup = Setup()
    library, length = find_library(setup), setup.cable.length
    assert library is not None
    arc = np.concatenate([[0.0], np.linspace(0.006, length, 31)])
    shapes = [library.resample(index, arc) for index in range(20)]
    assert len({shape[-1, 0] for shape in shapes}) > 5
    steps = np.linalg.norm(np.diff(shapes[0], axis=0), axis=1)
    np.testing.assert_allclose(steps, np.diff(arc), rtol=STRETCH, atol=STRETCH_GRIP)


def test_another_laboratory_and_a_cable_of_ones_own_have_no_library():
    cable = load_cable("cable_1")
    assert find_library(Setup(cable=cable), lab_seed=1) is None
    assert find_library(Setup(cable=dataclasses.replace(cable, name="mine"))) is None
    assert find_library(Setup(cable=dataclasses.replace(cable, length=0.7))) is None


def test_tuned_parameters_and_another_arm_do_not_change_what_the_reset_leaves():
    cable = load_cable("cable_1")
    tuned = cable.with_params(mass=0.06)
    library = find_library(Setup(cable=cable))
    assert library is not None
    for setup in (
        Setup(cable=tuned),
        Setup(arm=ArmUR(model="ur5e", base_yaw_deg=90.0)),
        Setup().with_motion(v_max=1.2),
        # A table that is wider only, and one that reaches behind the robot.
        Setup(workspace=Workspace(table_width=3.5)),
        Setup(workspace=Workspace(table_near_y=-0.5, table_depth=2.0)),
    ):
        assert find_library(setup) is library


@pytest.mark.parametrize(
    "changes",
    [{"grip_height": 0.05}, {"reset_y": 0.65}, {"table_depth": 1.4}],
    ids=["grip higher", "reset farther", "table shorter"],
)
def test_a_setup_whose_reset_moves_otherwise_has_no_library(changes):
    assert find_library(Setup(workspace=Workspace(**changes))) is None


def test_a_library_is_read_as_it_was_written(tmp_path):
    library = find_library(Setup(cable="cable_3"))
    assert library is not None
    library.save(tmp_path / "a.npz")
    again = ResetLibrary.load(tmp_path / "a.npz")
    np.testing.assert_allclose(again.positions, library.positions, atol=1e-6)
    assert (again.cable, again.info) == (library.cable, library.info)
    np.testing.assert_allclose(again.before_xy, library.before_xy, atol=1e-6)
    (tmp_path / "a.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:1000])
    with pytest.raises(DatasetError, match="no reset library"):
        ResetLibrary.load(tmp_path / "a.npz")


def test_the_digest_tells_laboratories_apart_without_telling_their_values():
    cable = load_cable("cable_1")
    assert hidden_digest(cable, 0) == hidden_digest(cable, 0)
    assert hidden_digest(cable, 0) != hidden_digest(cable, 1)
