"""The library of simulated resets: what is stored, and how it is made and drawn from."""

import dataclasses

import numpy as np
import pytest

from cablecast.cable import CABLE_NAMES, load_cable
from cablecast.errors import DatasetError, InputError, RigError
from cablecast.motion.action import MotionConfig
from cablecast.rigs.virtual import reset_library
from cablecast.rigs.virtual.reset_library import (
    ResetLibrary,
    cast_and_reset,
    find_library,
    hidden_digest,
    joined,
    library_path,
    sample_reset,
    simulate_resets,
)
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
    library = find_library(load_cable(name))
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
        library = find_library(load_cable(name))
        assert library is not None
        report = library.report()
        assert report["before_scatter_pct"] > 50.0
        assert 0.0 < report["aside_scatter_pct"] < 0.1 * report["before_scatter_pct"]


def test_a_draw_depends_on_the_generator_alone_and_keeps_lengths():
    cable = load_cable("cable_1")
    arc = np.concatenate([[0.0], np.linspace(0.006, cable.length, 31), [cable.length + 0.05]])
    first, second = (sample_reset(cable, arc, np.random.default_rng(5)) for _ in range(2))
    assert first is not None
    np.testing.assert_array_equal(first, second)
    drawn = [sample_reset(cable, arc, np.random.default_rng(seed)) for seed in range(20)]
    assert len({shape[-1, 0] for shape in drawn if shape is not None}) > 5
    steps = np.linalg.norm(np.diff(first, axis=0), axis=1)
    np.testing.assert_allclose(steps, np.diff(arc), rtol=STRETCH, atol=STRETCH_GRIP)
    assert first[-1, 2] == pytest.approx(first[-2, 2]), "an attachment goes on level"


def test_another_laboratory_and_a_cable_of_ones_own_have_no_library():
    cable = load_cable("cable_1")
    rng = np.random.default_rng(0)
    assert sample_reset(cable, [0.0, 0.1], rng, lab_seed=1) is None
    assert sample_reset(dataclasses.replace(cable, name="mine"), [0.0, 0.1], rng) is None
    assert sample_reset(dataclasses.replace(cable, length=0.7), [0.0, 0.1], rng) is None


def test_tuned_parameters_do_not_change_what_the_reset_leaves():
    cable = load_cable("cable_1")
    tuned = dataclasses.replace(cable, params=dataclasses.replace(cable.params, mass=0.06))
    assert find_library(tuned) is find_library(cable)


def test_a_library_is_read_as_it_was_written(tmp_path):
    library = find_library(load_cable("cable_3"))
    assert library is not None
    library.save(tmp_path / "a.npz")
    again = ResetLibrary.load(tmp_path / "a.npz")
    np.testing.assert_allclose(again.positions, library.positions, atol=1e-6)
    assert (again.cable, again.info) == (library.cable, library.info)
    assert len(joined(library, again)) == 2 * len(library)
    (tmp_path / "a.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:1000])
    with pytest.raises(DatasetError, match="no reset library"):
        ResetLibrary.load(tmp_path / "a.npz")


def test_each_reset_follows_another_cast():
    trajectories, begins = cast_and_reset(load_cable("cable_2"), WORKSPACE, 3, seed=4)
    starts = [t.grip_path.evaluate([b])[0, 0] for t, b in zip(trajectories, begins, strict=True)]
    assert np.ptp(np.array(starts)[:, 0]) > 0.1
    for trajectory in trajectories:
        assert trajectory.joint_path is not None
        np.testing.assert_allclose(
            trajectory.grip_path.evaluate(trajectory.grip_path.duration[:, None])[0, 0, :2],
            [0.0, WORKSPACE.reset_y],
            atol=1e-9,
        )


def test_a_simulated_reset_ends_as_those_of_the_library():
    pytest.importorskip("mujoco")
    cable = load_cable("cable_3")
    stored = find_library(cable)
    assert stored is not None
    made = simulate_resets(cable, WORKSPACE, 2, seed=123, motion=MotionConfig())
    scatter = stored.endpoints.std(axis=0)
    # Four standard deviations, and a centimetre for a library of few states.
    off = np.abs(made.endpoints - stored.endpoints.mean(axis=0))
    assert np.all(off < 4 * scatter + 0.01)
    assert np.all(made.before_xy[:, 1] < 1.6)


def test_the_command_goes_on_where_it_was_interrupted(tmp_path, monkeypatch):
    calls = []

    def quick(cable, workspace, count, seed, config, motion):
        calls.append(seed)
        shapes = np.random.default_rng(seed).normal(size=(count, 4, 3))
        return ResetLibrary(
            cable=cable.name,
            arc_lengths=np.linspace(0.0, cable.length, 4),
            positions=shapes,
            before_xy=shapes[:, 0, :2],
            info={},
        )

    monkeypatch.setattr(reset_library, "simulate_resets", quick)
    command = {"cable": "cable_1", "seed": 2}
    reset_library.MakeLibrary(count=16, out=tmp_path / "whole.npz", **command).run()
    reset_library.MakeLibrary(count=8, out=tmp_path / "parts.npz", **command).run()
    reset_library.MakeLibrary(count=16, out=tmp_path / "parts.npz", **command).run()
    assert calls == [20_000, 20_008, 20_000, 20_008]
    whole, parts = (ResetLibrary.load(tmp_path / f"{n}.npz") for n in ("whole", "parts"))
    np.testing.assert_array_equal(whole.positions, parts.positions)


def test_a_library_of_another_true_cable_is_replaced_not_continued(tmp_path, monkeypatch):
    def quick(cable, workspace, count, seed, config, motion):
        shapes = np.random.default_rng(seed).normal(size=(count, 4, 3))
        arc = np.linspace(0.0, cable.length, 4)
        return ResetLibrary(
            cable=cable.name, arc_lengths=arc, positions=shapes, before_xy=shapes[:, 0, :2], info={}
        )

    monkeypatch.setattr(reset_library, "simulate_resets", quick)
    out = tmp_path / "library.npz"
    reset_library.MakeLibrary(cable="cable_1", count=16, out=out).run()
    assert hidden_digest(load_cable("cable_1"), 0) != hidden_digest(load_cable("cable_1"), 1)
    monkeypatch.setattr(reset_library, "hidden_digest", lambda cable, lab_seed: "another")
    reset_library.MakeLibrary(cable="cable_1", count=8, out=out).run()
    assert len(ResetLibrary.load(out)) == 8


def test_making_a_library_does_not_depend_on_the_one_before_it(monkeypatch):
    from cablecast.rigs.virtual.rig import RigVirtual

    cable, found = load_cable("cable_1"), []

    def stop(self, trajectories, progress=None):
        found.append(find_library(cable))
        raise RigError("far enough")

    monkeypatch.setattr(RigVirtual, "execute_many", stop)
    assert find_library(cable) is not None
    with pytest.raises(RigError, match="far enough"):
        simulate_resets(cable, WORKSPACE, 1, seed=0)
    assert found == [None]
    assert find_library(cable) is not None


def test_no_resets_are_refused():
    with pytest.raises(InputError, match="count = 0"):
        simulate_resets(load_cable("cable_1"), WORKSPACE, 0, seed=0)
