import threading

import numpy as np
import pytest

from cablecast.data.dataset import read_dataset
from cablecast.errors import InputError
from cablecast.runs.places import DATASET_FOLDER
from cablecast.view.worker import Worker, long_work

COUNT = 60


def test_a_collection_that_was_stopped_goes_on_where_it_was(own, rig, tmp_path):
    worker = Worker()

    def stop_at_the_third():
        if own.cast_count == 2:
            # The worker sleeps here, as a robot moves.
            worker.stop()
            threading.Event().wait(5.0)

    own.during = stop_at_the_third
    worker.submit("collect", long_work("collect", rig, tmp_path, 4))
    worker.notify = lambda: None if worker.busy else worker.end()
    worker.run()
    assert worker.state.message == "stopped: collect"
    assert own.cast_count == 2
    own.during = None
    again = Worker()
    again.notify = lambda: None if again.busy else again.end()
    again.submit("collect", long_work("collect", rig, tmp_path, 4))
    again.run()
    assert again.state.message == ""
    # Two of the four were kept.
    assert own.cast_count == 4
    assert len(read_dataset(tmp_path / "tune-data")) == 4


def done(worker, kind, work):
    """Let a worker do some work, and return its last message."""
    worker.submit(kind, work)
    worker.notify = lambda: None if worker.busy else worker.end()
    worker.run()
    return worker.state.message


def test_a_simulation_that_was_stopped_ends_as_if_it_had_not_been(rig, tmp_path):
    stopped, straight = tmp_path / "stopped", tmp_path / "straight"
    worker, work = Worker(), long_work("simulate", rig, stopped, COUNT)

    def stopping(report):
        def told(progress):
            report(progress)
            worker.stop()

        work(told)

    assert done(worker, "simulate", stopping) == "stopped: simulate"
    for home in (stopped, straight):
        assert done(Worker(), "simulate", long_work("simulate", rig, home, COUNT)) == ""
    made, whole = (read_dataset(home / DATASET_FOLDER) for home in (stopped, straight))
    assert len(made) == COUNT
    assert np.array_equal(made.endpoint_xy, whole.endpoint_xy, equal_nan=True)


@pytest.mark.parametrize(
    ("kind", "amount", "words"),
    [
        ("reproduce", 1, "unknown work"),
        ("collect", 0, "casts = 0 is outside"),
        ("simulate", 10**9, "is outside"),
    ],
)
def test_work_that_the_page_does_not_offer_is_refused(rig, tmp_path, kind, amount, words):
    with pytest.raises(InputError, match=words):
        long_work(kind, rig, tmp_path, amount)
