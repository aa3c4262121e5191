import numpy as np
import pytest

from cablecast.view.look import ShownCast
from cablecast.view.scene import Player


class Noting:
    """A figure that notes the times that it was shown."""

    def __init__(self):
        self.times = []

    def show(self, cast, at):
        self.times.append(at)


@pytest.fixture
def player():
    playing = Player()
    playing.pause = 0.0
    yield playing
    playing.close()


def cast(duration):
    times = np.linspace(0.0, duration, 3)
    return ShownCast(times=times, path=np.zeros((3, 2)))


def test_casts_play_side_by_side_to_the_end_of_the_longest(player, wait_until):
    first, second, done = Noting(), Noting(), []
    player.play([(first, cast(0.1)), (second, cast(0.2))], done=lambda: done.append(1))
    wait_until(lambda: not player.playing)
    assert first.times == second.times
    assert first.times[0] == 0.0
    assert first.times[-1] == pytest.approx(0.2)
    assert sorted(first.times) == first.times
    assert done == [1]


def test_rounds_are_played_from_the_beginning_and_the_first_end_alone_is_told(player, wait_until):
    figure, done = Noting(), []
    player.play([(figure, cast(0.1))], rounds=3, done=lambda: done.append(1))
    wait_until(lambda: not player.playing)
    assert np.count_nonzero(np.diff(figure.times) < 0) == 2
    assert done == [1]


def test_a_time_that_is_sought_is_shown_at_rest(player):
    figure = Noting()
    player.show([(figure, cast(1.0))], 0.0)
    player.seek(0.4)
    player.seek(7.0)
    assert figure.times[1:] == [0.4, 1.0]
    assert not player.playing


def test_a_toggle_halts_goes_on_and_begins_again(player):
    figure = Noting()
    player.toggle()
    assert not player.playing
    player.play([(figure, cast(5.0))])
    player.toggle()
    assert not player.playing
    player.seek(5.0)
    player.toggle()
    assert player.playing
    player.toggle()
    assert player.time < 5.0
