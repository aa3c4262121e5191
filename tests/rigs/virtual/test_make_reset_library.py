"""The tool that simulates resets and stores where they leave the cable."""

import numpy as np
import pytest
from tools import make_reset_library
from tools.make_reset_library import cast_and_reset, joined, make_library, simulate_resets

from cablecast.errors import InputError
from cablecast.rigs.virtual.trials import ResetLibrary, find_library
from cablecast.setup import Setup

SETUP = Setup(cable="cable_2")


def drawn_resets(setup, count, seed, config):
    """Return a stand-in for the simulation: shapes drawn from the seed."""
    shapes = np.random.default_rng(seed).normal(size=(count, 4, 3))
    return ResetLibrary(
        cable=setup.cable.name,
        arc_lengths=np.linspace(0.0, setup.cable.length, 4),
        positions=shapes,
        before_xy=shapes[:, 0, :2],
        info={},
    )


def test_each_reset_follows_another_cast():
    trajectories, begins = cast_and_reset(SETUP, 3, seed=4)
    starts = [t.grip_path.evaluate([b])[0, 0] for t, b in zip(trajectories, begins, strict=True)]
    assert np.ptp(np.array(starts)[:, 0]) > 0.1
    for trajectory in trajectories:
        assert trajectory.joint_path is not None
        np.testing.assert_allclose(
            trajectory.grip_path.evaluate(trajectory.grip_path.duration[:, None])[0, 0, :2],
            [0.0, SETUP.workspace.reset_y],
            atol=1e-9,
        )


@pytest.mark.slow
def test_a_simulated_reset_ends_as_those_of_the_library():
    pytest.importorskip("mujoco")
    from cablecast.rigs.virtual import VirtualConfig

    setup = Setup(cable="cable_3")
    stored = find_library(setup)
    assert stored is not None
    made = simulate_resets(setup, 1, 123, VirtualConfig(version=4, segment_count=16))
    scatter = stored.endpoints.std(axis=0)
    # Four standard deviations, and a centimetre for a library of few states.
    off = np.abs(made.endpoints - stored.endpoints.mean(axis=0))
    assert np.all(off < 4 * scatter + 0.01)
    assert np.all(made.before_xy[:, 1] < 1.6)


def test_the_command_goes_on_where_it_was_interrupted(tmp_path, monkeypatch):
    calls = []

    def quick(setup, count, seed, config):
        calls.append(seed)
        return drawn_resets(setup, count, seed, config)

    monkeypatch.setattr(make_reset_library, "simulate_resets", quick)
    make_library("cable_1", 16, 2, tmp_path / "whole.npz")
    make_library("cable_1", 8, 2, tmp_path / "parts.npz")
    make_library("cable_1", 16, 2, tmp_path / "parts.npz")
    assert calls == [20_000, 20_008, 20_000, 20_008]
    whole, parts = (ResetLibrary.load(tmp_path / f"{n}.npz") for n in ("whole", "parts"))
    np.testing.assert_array_equal(whole.positions, parts.positions)


def test_a_library_of_another_true_cable_is_replaced_not_continued(tmp_path, monkeypatch):
    monkeypatch.setattr(make_reset_library, "simulate_resets", drawn_resets)
    out = tmp_path / "library.npz"
    make_library("cable_1", 16, 0, out)
    monkeypatch.setattr(make_reset_library, "hidden_digest", lambda cable, lab_seed: "another")
    make_library("cable_1", 8, 0, out)
    assert len(ResetLibrary.load(out)) == 8


def test_making_a_library_does_not_depend_on_the_one_before_it(monkeypatch):
    settings = []

    class StopError(Exception):
        pass

    def stop(setup, seed, config):
        settings.append(config.stored_resets)
        raise StopError

    monkeypatch.setattr(make_reset_library, "RigVirtual", stop)
    with pytest.raises(StopError):
        simulate_resets(SETUP, 1, seed=0)
    assert settings == [False]


def test_two_libraries_become_one_in_order():
    first, second = (drawn_resets(SETUP, 3, seed, None) for seed in (0, 1))
    both = joined(first, second)
    np.testing.assert_array_equal(both.positions[3:], second.positions)
    np.testing.assert_array_equal(both.before_xy[:3], first.before_xy)


def test_no_resets_are_refused():
    with pytest.raises(InputError, match="count = 0"):
        simulate_resets(SETUP, 0, seed=0)


def test_the_report_is_printed_of_what_is_stored(capsys):
    make_reset_library.main(["--cable", "cable_1", "--report"])
    printed = capsys.readouterr().out
    assert "reset_cable_1.npz" in printed
    assert "aside_scatter_pct" in printed
