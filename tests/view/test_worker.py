import contextlib
import threading
import time

import pytest

from cablecast.errors import InputError, RigError
from cablecast.runs.progress import Progress
from cablecast.view.worker import Worker


def run_with(worker, scenario):
    """Run the worker here, in the main thread, while a scenario acts from another."""
    errors = []

    def leave(report):
        raise SystemExit

    def act():
        try:
            scenario()
        except BaseException as error:
            errors.append(error)
        finally:
            worker._queue.put(leave)

    thread = threading.Thread(target=act)
    thread.start()
    with contextlib.suppress(SystemExit):
        worker.run()
    thread.join()
    if errors:
        raise errors[0]


def test_work_is_done_in_the_thread_of_the_worker_and_reports(wait_until):
    seen = []
    worker = Worker()

    def work(report):
        report(Progress(task="sweeping", done=1, total=2))
        report(Progress(task="sweeping", done=2, total=2))
        seen.append((threading.current_thread(), worker.state))

    def scenario():
        worker.submit("sweeping", work)
        wait_until(lambda: not worker.state.busy)

    run_with(worker, scenario)
    thread, state = seen[0]
    assert thread is threading.main_thread()
    assert state.name == "sweeping"
    assert state.progress.done == 2
    assert state.seconds_left == pytest.approx(0.0)
    assert worker.state.message == ""


def test_a_second_work_is_refused_while_one_is_under_way(wait_until):
    worker, gate = Worker(), threading.Event()

    def scenario():
        worker.submit("a cast", lambda report: gate.wait(5.0))
        with pytest.raises(InputError, match="busy: a cast is under way"):
            worker.submit("another cast", lambda report: None)
        gate.set()
        wait_until(lambda: not worker.state.busy)
        worker.submit("another cast", lambda report: None)

    run_with(worker, scenario)


def test_a_stop_interrupts_the_work_and_more_of_them_leave_its_cleanup_alone(wait_until):
    worker, events, stopped = Worker(), [], threading.Event()

    def work(report):
        try:
            events.append("begun")
            time.sleep(30.0)
        finally:
            report(Progress(task="stopping the arm"))
            assert stopped.wait(30.0)
            events.append("arm stopped")

    def scenario():
        worker.submit("a cast", work)
        wait_until(lambda: events)
        worker.stop()
        wait_until(lambda: worker.state.progress)
        for _ in range(3):
            worker.stop()
        stopped.set()
        wait_until(lambda: not worker.state.busy)
        assert worker.state.message == "stopped: a cast"
        worker.submit("another cast", lambda report: events.append("cast"))
        wait_until(lambda: not worker.state.busy)

    run_with(worker, scenario)
    assert events == ["begun", "arm stopped", "cast"]


def test_a_stop_of_work_that_fails_meanwhile_is_not_taken_for_the_next_interrupt(wait_until):
    worker, events = Worker(), []

    def fails(report):
        try:
            events.append("begun")
            time.sleep(30.0)
        finally:
            raise RigError("the arm is off")

    def interrupted(report):
        raise KeyboardInterrupt

    def scenario():
        worker.submit("a cast", fails)
        wait_until(lambda: events)
        worker.stop()
        wait_until(lambda: worker.state.message == "the arm is off")
        worker.submit("another cast", interrupted)

    with pytest.raises(KeyboardInterrupt):
        run_with(worker, scenario)


def test_a_stop_without_work_does_nothing():
    worker = Worker()
    run_with(worker, worker.stop)
    assert worker.state.message == ""


@pytest.mark.parametrize(
    ("error", "words"),
    [(RigError("the arm is off"), "the arm is off"), (KeyError("q7"), "KeyError: 'q7'")],
)
def test_work_that_fails_leaves_a_sentence_and_a_worker_that_goes_on(error, words, wait_until):
    worker, done = Worker(), []

    def fail(report):
        raise error

    def scenario():
        worker.submit("a cast", fail)
        wait_until(lambda: not worker.state.busy)
        assert worker.state.message == words
        worker.submit("another", lambda report: done.append(1))
        wait_until(lambda: done)

    run_with(worker, scenario)


def test_somebody_at_the_keyboard_ends_the_program():
    worker = Worker()

    def interrupted(report):
        raise KeyboardInterrupt

    worker.submit("a cast", interrupted)
    with pytest.raises(KeyboardInterrupt):
        worker.run()


def test_work_that_is_stopped_before_it_starts_never_starts(wait_until):
    worker, done = Worker(), []
    finish = worker._finish

    def late(message):
        # Somebody starts work and stops it, before the worker looks for any.
        worker._finish = finish
        finish(message)
        worker.submit("a cast", lambda report: done.append("a cast"))
        worker.stop()

    worker._finish = late

    def scenario():
        worker.submit("a fit", lambda report: None)
        wait_until(lambda: worker.state.message == "stopped")
        worker.submit("another fit", lambda report: done.append("another fit"))
        wait_until(lambda: done)

    run_with(worker, scenario)
    assert done == ["another fit"]
