"""A checked rig refuses impossible answers, hangs no longer than it may, and fails in one line."""

import dataclasses
import signal
import sys
import threading
import time

import numpy as np
import pytest

from cablecast.camera.settings import CameraSight
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.errors import InputError, RigError, StoppedError, TargetError
from cablecast.rigs import checked as time_limit
from cablecast.rigs.checked import CheckedRig, attempt_trial, call_within

SHORT = 0.3
"""Time limit of a rig that hangs [s]: a busy machine may stop a test for a tenth of a second."""

needs_timers = pytest.mark.skipif(
    not hasattr(signal, "setitimer"), reason="this system has no interval timers"
)


def landing(x=0.4):
    times = 0.1 * np.arange(30)
    endpoint_xy = np.tile([x, 0.7], (30, 1))
    endpoint_xy[:3] = [0.0, 1.2]
    return EndpointTrack(times=times, endpoint_xy=endpoint_xy, status=TrialStatus.OK)


class OddRig:
    """Answers well, but for what it is told to do instead in one of its methods."""

    def __init__(self, **instead):
        self.description = {"rig": "odd"}
        self.calls = []
        self.instead = instead

    def _do(self, name, answer=None):
        self.calls.append(name)
        return self.instead[name]() if name in self.instead else answer

    def reset(self):
        self._do("reset")

    def execute(self, trajectory):
        return self._do("execute", landing())

    def close(self):
        self._do("close")


class ManyRig(OddRig):
    """The same with many trials at once."""

    def execute_many(self, trajectories, progress=None):
        if progress is not None:
            progress(len(trajectories))
        return self._do("execute_many", [landing(0.1 * i) for i in range(len(trajectories))])


def fail(error):
    """Return a function that raises an error."""

    def call():
        raise error

    return call


def run_trial(rig, trajectory):
    """One trial, and the end of the rig."""
    rig.reset()
    rig.execute(trajectory)
    rig.close()


def close_after(rig, error):
    """Close a rig on the way out of an error, as a `finally` clause does."""
    try:
        raise error
    finally:
        rig.close()


@pytest.fixture
def make(setup):
    return lambda rig, **options: CheckedRig(rig, setup, **options)


FAILURES = {
    "a value error": (ValueError("no\ncamera"), "failed: ValueError: no camera"),
    "an error without words": (ZeroDivisionError(), "failed: ZeroDivisionError"),
    "leaving the process": (SystemExit("done"), "failed: SystemExit: done"),
    "no memory": (MemoryError(), "failed: MemoryError"),
    "an endless text": (RuntimeError("x" * 10_000), "failed: RuntimeError: xxx"),
}


@pytest.mark.parametrize("method", ["reset", "execute", "close"])
@pytest.mark.parametrize("name", FAILURES)
def test_whatever_a_rig_raises_comes_out_as_one_short_line(name, method, make, small_cast):
    error, words = FAILURES[name]
    rig = make(OddRig(**{method: fail(error)}))
    with pytest.raises(RigError) as caught:
        run_trial(rig, small_cast)
    assert f"the rig's {method} {words}" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400
    assert caught.value.__cause__ is error


def test_errors_of_cablecast_and_the_user_s_interrupt_pass_as_they_are(make, small_cast):
    for error in (TargetError("too far"), KeyboardInterrupt()):
        rig = make(OddRig(execute=fail(error)))
        rig.reset()
        with pytest.raises(type(error)) as caught:
            rig.execute(small_cast)
        assert caught.value is error


def test_an_impossible_answer_is_refused(make, small_cast):
    rig = make(OddRig(execute=lambda: landing(400.0)))
    rig.reset()
    with pytest.raises(RigError, match="looks like millimetres"):
        rig.execute(small_cast)


def test_many_answers_are_checked_one_by_one_and_counted(make, small_cast):
    rig = make(ManyRig())
    told = []
    tracks = rig.execute_many([small_cast] * 3, told.append)
    assert told == [3]
    assert [track.final_xy[0] for track in tracks] == pytest.approx([0.0, 0.1, 0.2])
    with pytest.raises(RigError, match="returned 1 tracks for 2 motions"):
        make(ManyRig(execute_many=lambda: [landing()])).execute_many([small_cast] * 2)
    with pytest.raises(RigError, match="millimetres"):
        make(ManyRig(execute_many=lambda: [landing(), landing(400.0)])).execute_many(
            [small_cast] * 2
        )


def test_a_rig_of_ones_own_must_be_reset_before_each_motion_and_not_used_when_closed(
    make, small_cast
):
    rig = make(OddRig())
    with pytest.raises(RigError, match="reset"):
        rig.execute(small_cast)
    rig.reset()
    rig.execute(small_cast)
    with pytest.raises(RigError, match="reset"):
        rig.execute(small_cast)
    rig.close()
    rig.close()
    assert rig.rig.calls == ["reset", "execute", "close"]
    with pytest.raises(RigError, match="closed"):
        rig.reset()


def test_a_failed_reset_is_no_reset(make, small_cast):
    rig = make(OddRig(reset=fail(ValueError("protective stop"))))
    with pytest.raises(RigError, match="protective stop"):
        rig.reset()
    with pytest.raises(RigError, match="must be reset"):
        rig.execute(small_cast)


def test_a_rig_that_shares_luck_between_purposes_is_refused(make):
    class OldSeek(OddRig):
        def seek(self, index):
            pass

    class Seek(OddRig):
        def seek(self, index, purpose=""):
            self.calls.append((index, purpose))

    with pytest.raises(RigError, match="seek must take an index and a purpose"):
        make(OldSeek())
    rig = make(Seek())
    rig.seek(4, "real")
    rig.seek(2)
    assert rig.rig.calls == [(4, "real"), (2, "")]
    for index, purpose, words in ((-1, "tune", "trial index = -1"), (0, "party", "'party'")):
        with pytest.raises(InputError, match=words):
            rig.seek(index, purpose)


def hang():
    """Wait as a rig does whose camera sends no more frames."""
    time.sleep(60.0)


@needs_timers
@pytest.mark.parametrize("method", ["reset", "execute", "close"])
def test_a_rig_that_hangs_is_interrupted(method, make, small_cast):
    rig = make(OddRig(**{method: hang}), time_limit=SHORT)
    with pytest.raises(RigError, match=rf"the rig's {method} took longer .* 0\.3 s"):
        run_trial(rig, small_cast)


@needs_timers
def test_an_interrupted_rig_may_first_stop_its_arm(make, small_cast):
    stopped = []

    def careful():
        try:
            hang()
        finally:
            time.sleep(SHORT / 3)
            stopped.append("arm")

    rig = make(OddRig(execute=careful), time_limit=SHORT)
    rig.reset()
    with pytest.raises(RigError, match="took longer"):
        rig.execute(small_cast)
    assert stopped == ["arm"]


@needs_timers
@pytest.mark.parametrize("stubbornness", ["except Exception", "except BaseException", "an answer"])
def test_a_rig_that_does_not_let_itself_be_interrupted_fails_all_the_same(
    stubbornness, make, small_cast, monkeypatch
):
    monkeypatch.setattr(time_limit, "_GRACE_MIN", SHORT)
    swallowed = []

    def stubborn():
        for _ in range(3):
            try:
                hang()
            except Exception:
                continue
            except BaseException as error:
                swallowed.append(error)
                if stubbornness == "except Exception":
                    raise
        return landing()

    rig = make(OddRig(execute=stubborn), time_limit=SHORT)
    rig.reset()
    with pytest.raises(RigError, match="took longer"):
        rig.execute(small_cast)
    assert len(swallowed) == (1 if stubbornness == "except Exception" else 3)


@needs_timers
def test_many_trials_have_the_time_of_many(make, small_cast):
    rig = make(ManyRig(), time_limit=0.2)
    rig.rig.instead["execute_many"] = lambda: (time.sleep(0.3), [landing()] * 20)[1]
    assert len(rig.execute_many([small_cast] * 20)) == 20
    with pytest.raises(RigError, match=r"limit of 0\.2 s"):
        rig.execute_many([small_cast])


@needs_timers
def test_a_rig_within_a_rig_leaves_the_outer_limit_in_force(make, small_cast):
    inner = make(OddRig(), time_limit=30.0)

    def outer():
        inner.reset()
        hang()

    rig = make(OddRig(execute=outer), time_limit=SHORT)
    rig.reset()
    with pytest.raises(
        RigError, match=r"execute took longer than its time limit of 0\.3 s; --time-limit"
    ):
        rig.execute(small_cast)
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0


def test_outside_the_main_thread_there_is_no_limit_and_no_error(make, small_cast):
    rig = make(OddRig(execute=lambda: (time.sleep(2 * SHORT), landing())[1]), time_limit=SHORT)
    ended = []

    def run():
        rig.reset()
        ended.append(rig.execute(small_cast).status)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert ended == [TrialStatus.OK]


def test_a_rig_may_have_all_the_time_there_is(make, small_cast):
    rig = make(OddRig(), time_limit=None)
    rig.reset()
    assert rig.execute(small_cast).status is TrialStatus.OK
    # That of very many motions is more than a timer takes.
    assert call_within(1e12, "it", lambda: 1) == 1
    with pytest.raises(InputError, match="time_limit = 0 s"):
        make(OddRig(), time_limit=0)


def test_an_error_in_closing_hides_none_that_came_before(make):
    with pytest.raises(KeyError) as caught, make(OddRig(close=fail(ValueError("stuck")))):
        raise KeyError("first")
    assert caught.value.__notes__ == [
        "closing the rig failed as well: the rig's close failed: ValueError: stuck"
    ]
    rig = make(OddRig(close=fail(SystemExit(1))))
    with pytest.raises(KeyError, match="first"):
        close_after(rig, KeyError("first"))
    with (
        pytest.raises(RigError, match="the rig's close failed"),
        make(OddRig(close=fail(ValueError("stuck")))),
    ):
        pass
    assert sys.exc_info() == (None, None, None)


def test_a_description_is_read_and_checked_once(make):
    class Described(OddRig):
        reads = 0

        @property
        def description(self):
            type(self).reads += 1
            return {"rig": "described", "reads": self.reads}

        @description.setter
        def description(self, value):
            pass

    rig = make(Described())
    assert rig.description == rig.description == {"rig": "described", "reads": 1}

    class Failing(Described):
        description = property(fail_to_describe, lambda self, value: None)

    with pytest.raises(RigError, match="the rig's description failed: OSError: no robot"):
        make(Failing())


def fail_to_describe(self):
    raise OSError("no robot")


def test_a_rig_has_a_picture_exactly_where_it_has_one(make):
    assert make(OddRig()).picture is None
    rig = OddRig()
    rig.picture = lambda: np.zeros((2, 3, 3), dtype=np.uint8)
    assert make(rig).picture().shape == (2, 3, 3)
    rig.picture = fail(OSError("unplugged"))
    with pytest.raises(RigError, match="picture failed: OSError: unplugged"):
        make(rig).picture()


def test_a_rig_has_a_sight_exactly_where_it_has_one(make):
    assert make(OddRig()).sight is None
    rig = OddRig()
    known = CameraSight(position=(0.0, 0.7, 2.0), blind=((0.5, 1.0, 0.1),))
    rig.sight = lambda: known
    assert make(rig).sight() is known
    rig.sight = lambda: None
    assert make(rig).sight() is None
    rig.sight = lambda: ((0.5, 1.0, 0.1),)
    with pytest.raises(RigError, match="sight is a tuple: it must be a CameraSight, or None"):
        make(rig).sight()


class UnluckyRig(OddRig):
    """Aborts every other draw."""

    def __init__(self):
        super().__init__()
        self.drawn = []

    def seek(self, index, purpose=""):
        self.drawn.append(index)

    def execute(self, trajectory):
        luck = np.random.default_rng(self.drawn[-1]).random()
        aborted = dataclasses.replace(landing(), status=TrialStatus.ABORTED)
        return aborted if luck < 0.5 else landing()


def test_a_trial_that_a_person_stopped_is_not_made_again(small_cast, setup):
    class StoppedRig(OddRig):
        resets = 0

        def reset(self):
            super().reset()
            self.resets += 1

        def execute(self, trajectory):
            raise StoppedError("somebody pressed stop")

    stopped = StoppedRig()
    with pytest.raises(RigError, match="failed because: somebody pressed stop"):
        attempt_trial(CheckedRig(stopped, setup), small_cast, index=0, purpose="tune")
    assert stopped.resets == 1


def test_a_trial_that_failed_by_chance_is_drawn_anew(small_cast, setup):
    unlucky = UnluckyRig()
    rig = CheckedRig(unlucky, setup)
    counts = [
        attempt_trial(rig, small_cast, index=index, purpose="tune", count=12)[1]
        for index in range(20)
    ]
    # With the luck of the first attempt again and again, each of these would fail for good.
    assert 5 <= np.count_nonzero(counts) <= 15
    assert len(set(unlucky.drawn)) == len(unlucky.drawn) == 20 + sum(counts)
