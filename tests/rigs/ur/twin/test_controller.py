import dataclasses
import re

import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.rigs.path import JointCurve, straight_move
from cablecast.rigs.ur.program import ProgramState, motion_program
from cablecast.rigs.ur.rtde import BEAT, STATE, STOP, TICK, FrameReader, Recipe, frame
from cablecast.rigs.ur.twin.controller import Controller
from cablecast.rigs.ur.twin.servers import OUTPUTS, RtdeServer, dashboard_answer

# The servo of the hidden arm has settled to its encoder's noise by then [s].
SETTLE_TIME = 1.0
# The arm must rest this soon after anything that stops it [s].
REST_TIME_MAX = 0.5


@pytest.fixture(params=["cb3", "e-series"])
def controller(request, twin_setup, home):
    return Controller(twin_setup, home, request.param)


@pytest.fixture
def points(controller, home):
    """Turn the base by 0.3 rad at up to 1 rad/s."""
    return straight_move(home, home + [0.3, 0, 0, 0, 0, 0], 1.0)


def read(controller, register):
    """Return what a program wrote into a register."""
    return controller.int_registers[controller.robot.output_register + register]


def run(controller, duration, beat=True):
    for _ in range(round(duration / controller.dt)):
        if beat:
            controller.inputs[f"input_int_register_{controller.robot.input_register + BEAT}"] += 1
        controller.tick()


def time_to_rest(controller, beat=True):
    start = controller.time
    while not (controller.at_rest and np.all(controller.target_qd == 0.0)):
        run(controller, controller.dt, beat)
        assert controller.time < start + 5.0
    return controller.time - start


def test_a_motion_program_is_carried_out_to_its_end(controller, points, home, twin_setup):
    controller.load(motion_program("cast", points, twin_setup.robot, 7))
    run(controller, points.duration + SETTLE_TIME)
    assert read(controller, STATE) == ProgramState.DONE
    assert read(controller, TICK) == round(1000 * points.duration)
    assert not controller.is_running_program
    np.testing.assert_allclose(controller.arm.q, points.q[-1], atol=1e-3)


@pytest.mark.parametrize("event", ["protective_stop", "emergency_stop", "stop", "silence", "ask"])
def test_whatever_stops_the_arm_brings_it_to_rest_within_half_a_second(
    controller, points, twin_setup, event
):
    controller.load(motion_program("cast", points, twin_setup.robot, 7))
    # Into the middle of the motion.
    run(controller, 0.55)
    assert not controller.at_rest
    beat = True
    if event == "protective_stop":
        controller.protective_stop("test")
    elif event == "emergency_stop":
        controller.emergency_stop()
    elif event == "stop":
        assert dashboard_answer(controller, "stop") == "Stopped"
    elif event == "silence":
        beat = False
    else:
        controller.inputs[f"input_int_register_{controller.robot.input_register + STOP}"] = 7
    assert time_to_rest(controller, beat) < REST_TIME_MAX
    run(controller, 3 * controller.dt, beat)
    assert not controller.is_running_program
    states = {"silence": ProgramState.SILENCE, "ask": ProgramState.STOPPED}
    if event in states:
        assert read(controller, STATE) == states[event]


def test_a_stop_for_safety_lets_no_program_start_until_a_person_clears_it(
    controller, points, twin_setup
):
    controller.protective_stop("test")
    text = motion_program("cast", points, twin_setup.robot, 7)
    controller.load(text)
    assert not controller.is_running_program
    controller.clear()
    controller.load(text)
    assert controller.is_running_program


def test_at_half_speed_the_same_way_takes_twice_as_long(controller, points, twin_setup):
    controller.speed_slider = 0.5
    controller.load(motion_program("cast", points, twin_setup.robot, 7))
    run(controller, points.duration + 0.3)
    assert controller.is_running_program
    run(controller, points.duration + 0.3 + SETTLE_TIME)
    assert read(controller, STATE) == ProgramState.DONE


def jump(home):
    """Turn the base at once."""
    q = np.repeat(home[None], 100, axis=0)
    q[50:, 0] += 0.2
    return JointCurve(np.arange(100) * 0.008, q, np.zeros((100, 6)))


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (
            lambda home: straight_move(home, home + [0, 0.9, 0, 0, 0, 0], 1.0),
            "below the table|outside the safety planes",
        ),
        (
            lambda home: straight_move(home, home + [2.5, 0, 0, 0, 0, 0], 1.0),
            "outside the safety planes",
        ),
        (
            lambda home: straight_move(home, home + [0.8, 0, 0, 0, 0, 0], 4.5),
            "beyond its speed|beyond its acceleration",
        ),
        (jump, "beyond its speed|beyond its acceleration"),
    ],
    ids=["below", "outside", "fast", "jump"],
)
def test_the_controller_itself_stops_a_path_beyond_its_bounds(
    controller, home, twin_setup, motion, words
):
    points = motion(home)
    controller.load(motion_program("cast", points, twin_setup.robot, 7))
    run(controller, points.duration + SETTLE_TIME)
    stops = [event for event in controller.events if event["what"] == "protective stop"]
    assert len(stops) == 1
    assert re.search(words, stops[0]["why"])


def test_a_program_that_does_not_compile_is_refused_with_its_reason(controller):
    controller.load("def cast():\n  what is this\nend\n")
    assert not controller.is_running_program
    assert "is no statement" in controller.events[-1]["reason"]


def test_a_program_beyond_the_controllers_size_does_nothing(controller, points, twin_setup):
    text = motion_program("cast", points, twin_setup.robot, 7)
    controller.program_size_max = len(text) - 1
    controller.load(text)
    assert not controller.is_running_program
    assert controller.events[-1]["reason"] == f"{len(text)} bytes"
    controller.program_size_max = len(text)
    controller.load(text)
    assert controller.is_running_program


def test_the_dashboard_answers_as_the_makers_does(twin_setup, home):
    cb3, e_series = (Controller(twin_setup, home, name) for name in ("cb3", "e-series"))
    assert dashboard_answer(cb3, "robotmode") == "Robotmode: RUNNING"
    assert dashboard_answer(cb3, "PolyscopeVersion").startswith("URSoftware 3.15")
    assert dashboard_answer(e_series, "PolyscopeVersion").startswith("URSoftware 5.")
    assert dashboard_answer(cb3, "is in remote control").startswith("could not understand")
    assert dashboard_answer(e_series, "is in remote control") == "true"
    cb3.protective_stop("test")
    assert dashboard_answer(cb3, "safetymode") == "Safetymode: PROTECTIVE_STOP"
    cb3.emergency_stop()
    assert dashboard_answer(cb3, "robotmode") == "Robotmode: POWER_OFF"


def test_every_variable_that_rtde_names_can_be_packed_and_read_back(controller):
    state = RtdeServer(controller, 0, lambda: None).state()
    names = tuple(OUTPUTS)
    recipe = Recipe(1, names, tuple(OUTPUTS.values()))
    packed = recipe.pack(state)
    reader = FrameReader()
    # A frame may arrive in pieces.
    assert list(reader.feed(packed[:5])) == []
    ((kind, payload),) = reader.feed(packed[5:])
    assert kind == ord("U")
    read = recipe.unpack(payload[1:])
    assert read["timestamp"] == controller.time
    np.testing.assert_array_equal(read["target_q"], controller.target_q)
    assert frame(ord("S")) == b"\x00\x03S"


def test_a_controller_needs_a_robot_in_its_lab_file(twin_setup, home):
    with pytest.raises(InputError, match="robot section"):
        Controller(dataclasses.replace(twin_setup, robot=None), home)
