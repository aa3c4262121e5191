"""The benchmark of motion capture, with a cable that the engine itself has swung."""

import numpy as np
import pytest
from benchmarks.mocap import BEND, DAMPING, Args, Player, Sequences, fit, main

from cablecast.errors import InputError

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


def test_a_folder_without_sequences_is_refused(tmp_path):
    with pytest.raises(InputError, match="holds no file"):
        list(main(Args(data=tmp_path)))
