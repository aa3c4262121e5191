"""Nothing moves on a controller that is not ready, and a motion that goes wrong is stopped."""

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest
from tests.robot import ROBOT

from cablecast.errors import RigError, StoppedError
from cablecast.rigs.driver import CastAbortedError
from cablecast.rigs.path import JointCurve
from cablecast.rigs.ur.link import Report, check_arm, check_ready
from cablecast.rigs.ur.player import ProgramPlayer
from cablecast.rigs.ur.program import ProgramState, motion_program
from cablecast.rigs.ur.rtde import NUMBER

DT = 0.008
TICK_COUNT = 60
FAULT_TICK = 30
CURVE = JointCurve(np.array([0.0, TICK_COUNT * DT]), np.zeros((2, 6)), np.zeros((2, 6)))


def report(time=0.0, **changes):
    values = {
        "time": time,
        "host_time": time,
        "q": np.zeros(6),
        "qd": np.zeros(6),
        "target_q": np.zeros(6),
        "speed_scaling": 1.0,
        "safety_bits": 1,
        "robot_mode": 7,
        "is_playing": True,
        "payload": 0.95,
        "payload_cog": np.array([0.0, 0.0, 0.06]),
        "state": ProgramState.MOVING,
        "tick": 0,
        "number": 0,
    }
    return Report(**(values | changes))


def ready(version=(3, 15, 8), remote="true", **changes):
    answers = {"is in remote control": remote} if (5, 6) <= version < (10,) else {}
    changes = {"is_playing": False} | changes
    link = SimpleNamespace(
        robot=ROBOT,
        wait_for_report=lambda: report(**changes),
        ask=answers.__getitem__,
        version=version,
    )
    return check_ready(link)


def test_a_controller_that_is_ready_is_taken():
    ready()
    ready(version=(5, 12, 6))
    # Neither a CB3 nor an early e-Series can be asked for remote control, nor PolyScope X.
    ready(version=(5, 4, 0))
    ready(version=(10, 7, 0))
    ready(payload_cog=None)


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ({"safety_bits": 1 << 2 | 1 << 10}, "protective stop: look what the arm touched"),
        ({"safety_bits": 1 << 4 | 1 << 10}, "safeguard stop: step out of the guarded space"),
        ({"safety_bits": 1 << 6 | 1 << 7 | 1 << 10}, "emergency stop: find out why"),
        ({"safety_bits": 1 << 9}, "fault: read the pendant's log"),
        ({"safety_bits": 1 << 1}, r"reduced mode \(bit 1\): leave the reduced space"),
        ({"safety_bits": 0}, "not in its normal mode"),
        ({"robot_mode": 3}, "in mode 3, not running"),
        ({"is_playing": True}, "another program runs on the controller"),
        ({"version": (5, 12, 6), "remote": "false"}, "in local control"),
        ({"speed_scaling": 0.5}, "at 50 %: set it to 100 %"),
        ({"speed_scaling": 0.9985}, r"at 99\.[89]\d* %: set it to 100 %"),
        ({"payload": 0.89}, "payload on the controller is 0.89 kg"),
        ({"payload_cog": np.array([0.0, 0.03, 0.06])}, r"payload's centre on the controller"),
    ],
)
def test_nothing_moves_on_a_controller_that_is_not_ready(state, words):
    with pytest.raises(RigError, match=words):
        ready(**state)


class ScriptedLink:
    """Reports a motion tick by tick, with a fault from one of them on, and notes commands."""

    robot, is_alive = ROBOT, True

    def __init__(self, fault, is_paused=False):
        self.fault, self.is_paused = fault, is_paused
        self.number = 0
        self.reports = [report(is_playing=False, state=ProgramState.NONE)]
        self.commands = []

    def send_program(self, text):
        self.number = int(
            re.search(rf"register\({ROBOT.output_register + NUMBER}, (\d+)\)", text)[1]
        )

    def latest(self):
        if self.number:
            tick = min(len(self.reports), TICK_COUNT)
            state = ProgramState.DONE if tick == TICK_COUNT else ProgramState.MOVING
            changes = {"tick": 8 * tick, "state": state, "number": self.number}
            if tick >= FAULT_TICK:
                changes |= self.fault(tick)
            self.reports.append(report(len(self.reports) * DT, **changes))
        return self.reports[-1]

    def since(self, when):
        return [report for report in self.reports if report.time > when]

    def keep_alive(self):
        pass

    def rest(self):
        self.commands.append("rest")

    def ask_to_stop(self, number):
        self.commands.append(("stop", number))
        state = self.reports[-1].state if self.is_paused else ProgramState.STOPPED
        self.reports.append(report(1e3, is_playing=False, state=state))

    def stop_program(self):
        self.commands.append("stop program")


def play(link):
    return ProgramPlayer(link).play("cast", CURVE)


def test_a_motion_that_is_as_it_should_be_is_kept_from_its_start():
    record = play(ScriptedLink(lambda tick: {}))
    assert record.start_time == pytest.approx(0.0)
    assert [r.tick for r in record.reports] == list(range(8, 8 * TICK_COUNT + 1, 8))


def interrupt(tick):
    raise KeyboardInterrupt


def test_a_program_that_a_person_paused_cannot_go_on():
    link = ScriptedLink(lambda tick: {"is_playing": False}, is_paused=True)
    with pytest.raises(StoppedError, match="paused"):
        play(link)
    assert link.commands[-1] == "stop program"


@pytest.mark.parametrize(
    ("version", "model", "fits"),
    [
        ((3, 15, 8), "ur5", True),
        ((5, 12, 6), "ur5e", True),
        ((5, 12, 6), "ur20", True),
        ((10, 7, 0), "ur5e", True),
        ((3, 15, 8), "ur5e", False),
        ((5, 12, 6), "ur5", False),
    ],
)
def test_an_arm_that_its_controller_cannot_move_is_refused(version, model, fits):
    if fits:
        check_arm(version, model)
        return
    with pytest.raises(RigError, match=f"describes a {model}, and the controller runs version"):
        check_arm(version, model)


@pytest.mark.parametrize(
    ("named", "model", "fits"),
    [
        ("UR5", "ur5e", True),
        ("UR5\n", "ur7e", True),
        ("UR10", "ur5e", False),
        ("UR20", "ur30", False),
        ("could not understand: get robot model", "ur5e", True),
        ("", "ur5e", True),
    ],
)
def test_an_arm_of_another_size_than_the_dashboard_names_is_refused(named, model, fits):
    if fits:
        check_arm((5, 12, 6), model, named)
        return
    with pytest.raises(RigError, match=f"describes a {model}, and the controller moves a UR"):
        check_arm((5, 12, 6), model, named)


@pytest.mark.parametrize(("watchdog", "hold"), [(0.04, 300), (0.2, 300), (1.0, 1100)])
def test_an_arm_whose_computer_died_before_the_motion_does_not_begin_it(watchdog, hold):
    robot = dataclasses.replace(ROBOT, watchdog=watchdog)
    program = motion_program("cast", CURVE, robot, 1)
    assert f"while held < {hold}:" in program
    assert hold > 1000 * watchdog


def stuck(tick):
    return {"tick": 8 * FAULT_TICK, "state": ProgramState.MOVING}


@pytest.mark.parametrize(
    ("fault", "error", "words"),
    [
        (lambda tick: {"q": np.full(6, 0.7)}, StoppedError, "a joint lags 0.70 rad behind"),
        (stuck, CastAbortedError, "behind the controller's clock"),
        (lambda tick: {"speed_scaling": 0.9}, CastAbortedError, "the speed fell to 90 %"),
        (
            lambda tick: {"is_playing": False},
            StoppedError,
            "somebody stopped or paused the program",
        ),
        (lambda tick: {"state": ProgramState.SILENCE}, CastAbortedError, "heard nothing of this"),
        (lambda tick: {"state": ProgramState.STOPPED}, CastAbortedError, "motion was stopped"),
        (lambda tick: {"safety_bits": 1 << 2}, RigError, "protective stop"),
        (interrupt, KeyboardInterrupt, None),
    ],
)
def test_a_motion_that_is_not_as_it_should_be_is_stopped(fault, error, words):
    link = ScriptedLink(fault)
    with pytest.raises(error, match=words):
        play(link)
    assert ("stop", link.number) in link.commands
    # The heart stops first: the program ends even if it does not hear of the stop.
    assert link.commands[0] == "rest"
