import threading

import pytest

from cablecast.datasets.reader import read_dataset
from cablecast.errors import InputError
from cablecast.view.worker import Worker
from cablecast.view.works import long_work


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
