"""The benchmark of motion capture, with a cable that the engine itself has swung."""

import dataclasses

import numpy as np
import pytest
from benchmarks.mocap import BEND, DAMPING, SETS, Args, Player, Sequences, fit, main

from cablecast.errors import DamagedFileError, InputError

RATE, FRAMES = 100.0, 40
TRUE = {"bend_stiffness": 1e-3, "twist_stiffness": 1e-3, "linear_damping": 0.1}


def hanging(frames):
    """Return markers of a cable whose held ends sway: those in between are yet to be found."""
    times = np.arange(frames) / RATE
    sway = 0.05 * np.sin(6.0 * times)[:, None]
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 12)
    arc = np.stack([0.27 * np.sin(angle), 0 * angle, -0.27 * np.cos(angle)], axis=-1)
    markers = np.repeat(arc[None], frames, axis=0)
    markers[:, :, 1] += sway
    return markers


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with sequences that the engine played with known numbers."""
    folder = tmp_path_factory.mktemp("mocap")
    markers = hanging(FRAMES)
    path = folder / "rope_train.npz"
    for _ in range(2):
        np.savez(path, positions=markers[None], rate_hz=RATE)
        player = Player(Sequences(path), Args(data=folder, segment_count=20))
        played = player.play({**TRUE, "damping_time": 0.05})[0]
        # The second time, the cable begins as it was, and is played again from there.
        markers[:, 2:-2] = played
    np.savez(path, positions=markers[None], rate_hz=RATE)
    return folder


def test_numbers_that_made_the_sequences_leave_a_small_error(folder):
    player = Player(Sequences(folder / "rope_train.npz"), Args(data=folder, segment_count=20))
    right = player.error_cm({**TRUE, "damping_time": 0.05})
    wrong = player.error_cm({**TRUE, "damping_time": 0.5})
    assert right[1] < 0.5 * wrong[1]
    assert right[0] == pytest.approx(right[1] * 8 / 12)


def test_the_fit_finds_a_better_damping(folder):
    player = Player(Sequences(folder / "rope_train.npz"), Args(data=folder, segment_count=20))
    unknowns = (BEND, DAMPING)
    found = fit(player, unknowns, 3)
    start = {u.name: u.start for u in unknowns}
    assert player.error_cm(found)[1] < 0.7 * player.error_cm(start)[1]
    assert abs(found["damping_time"] - 0.05) < abs(DAMPING.start - 0.05)


def test_more_numbers_never_follow_the_sequences_less(folder, monkeypatch):
    """A loss with two valleys: from its own start a fit of two numbers ends in the side one."""
    player = Player(Sequences(folder / "rope_train.npz"), Args(data=folder, segment_count=20))

    def errors(values):
        b = np.log(values["bend_stiffness"] / BEND.start)
        d = np.log(values["damping_time"] / DAMPING.start) if "damping_time" in values else 0.0
        near = 0.2 + 0.5 * b**2 if abs(b) < 0.5 else 0.1 * (b - 2.0)
        return np.array([near, 0.1 * d, 0.0]).reshape(1, 1, 1, 3)

    monkeypatch.setattr(player, "errors", errors)
    few = {"bend_stiffness": BEND.start * np.exp(1.5)}
    alone, after = fit(player, (BEND, DAMPING), 8), fit(player, (BEND, DAMPING), 8, few)
    assert np.abs(errors(alone)).max() > 0.1
    assert np.abs(errors(after)).max() < 0.01
    assert np.abs(errors(fit(player, (BEND, DAMPING), 8, starts=4))).max() < 0.01


def test_what_was_fitted_is_not_fitted_again(folder, tmp_path, monkeypatch):
    (folder / "rope_eval.npz").write_bytes((folder / "rope_train.npz").read_bytes())
    args = Args(data=folder, segment_count=20, iterations=1, starts=1, out=tmp_path)
    seen = []

    def stopped(_, unknowns, *rest):
        seen.append(rest[1])
        if len(seen) == 2:
            raise KeyboardInterrupt
        return {**TRUE, "damping_time": 0.05 * len(seen)}

    monkeypatch.setattr("benchmarks.mocap.fit", stopped)
    with pytest.raises(KeyboardInterrupt):
        list(main(args))
    (table,) = main(args)
    assert len(table.rows) == len(SETS) == len(seen) - 1
    # Each fit starts from what the one before found.
    assert seen[0] is None
    assert seen[1] == seen[2] == {**TRUE, "damping_time": 0.05}
    assert table.rows[0][2] == table.rows[0][4]
    with pytest.raises(DamagedFileError, match="other settings"):
        list(main(dataclasses.replace(args, starts=2)))


def test_a_folder_without_sequences_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds no file"):
        list(main(Args(data=tmp_path, out=tmp_path)))
