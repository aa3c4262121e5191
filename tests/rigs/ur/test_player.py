"""Motions on a twin through its sockets: carried out, watched, and always stopped."""

import dataclasses
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest
from tests.rigs.ur.conftest import REST_SPEED, make_fault, time_to_rest, wait_until

from cablecast.errors import RigError, StoppedError
from cablecast.motion.polar import reset_pose
from cablecast.rigs.driver import CastAbortedError, RigPhase
from cablecast.rigs.path import straight_move
from cablecast.rigs.ur.link import UrLink, check_ready
from cablecast.rigs.ur.player import ProgramPlayer
from cablecast.rigs.ur.program import motion_program
from cablecast.setup import save_setup

# The arm must rest this soon after whatever stops it, by the twin's clock [s].
REST_TIME_MAX = 0.5
# Encoder noise is 0.05 mrad; the servo has settled to less than that.
ANGLE_TOLERANCE = 5e-4
# The clock does not wait here, where silence is tried; a busy computer gets the longest watchdog.
PATIENT = {"watchdog": 1.0, "silence_max": 3.0}
# Longest time from the end of the watchdog's patience to rest [s].
BRAKING_TIME_MAX = 0.2
# Where the network is lost, it may wait for as long as lets the arm rest in time [s].
WATCHDOG = 0.3


@pytest.fixture(scope="module")
def twin(make_twin):
    """Run a CB3 arm without a cable."""
    return make_twin(PATIENT, has_cable=False, patience=0.0)


@pytest.fixture
def link(twin):
    process, setup = twin
    process.admin.clear()
    link = UrLink(setup.robot)
    yield link
    link.close()
    process.admin.clear()


@pytest.fixture
def player(link):
    return ProgramPlayer(link)


def way(link, setup, turn=0.3, speed=0.6):
    """Return a turn of the base away from home, or back to it."""
    home = setup.arm.inverse(np.asarray(reset_pose(setup.workspace), dtype=float))
    time.sleep(0.2)
    q = np.mean([r.q for r in list(link.reports)[-10:]], axis=0)
    away = abs(q[0] - home[0]) > turn / 2
    return straight_move(q, home if away else home + [turn, 0, 0, 0, 0, 0], speed)


def test_a_motion_ends_where_it_should_and_every_report_of_it_is_kept(link, player, twin):
    points = way(link, twin[1])
    record = player.play("cablecast_test", points)
    moved = [r for r in record.reports if record.start_time <= r.time]
    np.testing.assert_allclose(moved[-1].q, points.q[-1], atol=ANGLE_TOLERANCE)
    assert {r.speed_scaling for r in moved} == {1.0}
    assert {r.safety_bits for r in moved} == {1}
    # The path is followed as it was meant, a servo's lag behind.
    times = np.array([r.time for r in moved]) - record.start_time
    meant = points.evaluate(times - 0.03)[:, 0]
    assert np.abs(meant - [r.q[0] for r in moved]).max() < 0.02
    assert not link.latest().is_playing


@pytest.mark.parametrize(
    ("fault", "error", "words"),
    [
        ("protective_stop", RigError, "protective stop: look what the arm touched"),
        ("emergency_stop", RigError, "emergency stop: find out why"),
        ("speed_slider", CastAbortedError, "the speed fell to 50 %"),
        ("program_stopped", StoppedError, "somebody stopped or paused the program"),
        ("controller_dies", RigError, "has been silent|broke"),
        ("network_lost", RigError, "has been silent"),
    ],
)
def test_a_fault_in_the_motion_stops_the_arm_and_says_what_to_do(
    link, player, twin, fault, error, words
):
    process, setup = twin
    points = way(link, setup, turn=0.6)
    if fault == "network_lost":
        link.robot = dataclasses.replace(link.robot, watchdog=WATCHDOG)
        player = ProgramPlayer(link)
    link.set_phase(RigPhase.CAST)
    process.admin.fault(fault, "cast", 0.5)
    with pytest.raises(error, match=words):
        player.play("cablecast_test", points)
    assert time_to_rest(process, "fault") < REST_TIME_MAX
    commands = {e["command"] for e in process.admin.events() if e["what"] == "dashboard"}
    assert "unlock protective stop" not in commands
    process.admin.clear()
    link.close()
    # A person has cleared it: the next motion goes.
    again = UrLink(setup.robot)
    try:
        check_ready(again)
        ProgramPlayer(again).play("cablecast_test", way(again, setup))
    finally:
        again.close()


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("speed_slider", "slider of the pendant is at 50 %: set it to 100 %"),
        ("wrong_payload", "payload on the controller is 0.00 kg, that of the lab file 0.95 kg"),
    ],
)
def test_nothing_moves_where_the_controller_is_not_ready(link, twin, fault, words):
    make_fault(twin[0], fault)
    for _ in range(3):
        link.wait_for_report()
    with pytest.raises(RigError, match=words):
        check_ready(link)


def test_a_motion_from_elsewhere_is_refused(link, player, twin):
    points = way(link, twin[1])
    shifted = dataclasses.replace(points, q=points.q + 0.002)
    with pytest.raises(StoppedError, match="mrad from where the motion begins"):
        player.play("cablecast_test", shifted)


def test_registers_that_somebody_else_writes_are_named_with_what_to_change(link, twin):
    setup = twin[1]
    begin = time.monotonic()
    with pytest.raises(RigError, match=r"registers 24 to 26 .* set robot input_register") as caught:
        UrLink(setup.robot)
    assert "\n" not in str(caught.value)
    assert time.monotonic() - begin < 20.0
    beside = UrLink(dataclasses.replace(setup.robot, input_register=27))
    beside.close()


def test_a_program_that_the_controller_does_not_take_is_said_with_its_size(
    link, player, twin, monkeypatch
):
    monkeypatch.setattr("cablecast.rigs.ur.player._START_TIME_MAX", 0.5)
    monkeypatch.setattr(link, "send_program", lambda text: None)
    with pytest.raises(RigError, match=r"did not start a program of \d\.\d kB within 0\.5 s"):
        player.play("cablecast_test", way(link, twin[1]))


def test_an_arm_whose_driver_was_killed_comes_to_rest_by_itself(twin, tmp_path):
    process, setup = twin
    save_setup(setup, tmp_path / "twin.yaml")
    script = tmp_path / "drive.py"
    script.write_text(
        textwrap.dedent(
            """
            import os, sys, threading, time
            import numpy as np
            from cablecast.rigs.ur.link import UrLink
            from cablecast.rigs.path import straight_move
            from cablecast.rigs.ur.player import ProgramPlayer
            from cablecast.setup import load_setup

            setup = load_setup(sys.argv[1])
            link = UrLink(setup.robot)
            time.sleep(0.3)
            q = np.mean([r.q for r in list(link.reports)[-10:]], axis=0)
            side = -1.0 if q[0] > 0.0 else 1.0
            points = straight_move(q, q + [0.6 * side, 0, 0, 0, 0, 0], 0.15)

            def kill():
                while not any(r.tick > 1000 and r.state == 2 for r in list(link.reports)[-5:]):
                    time.sleep(0.01)
                os.kill(os.getpid(), 9)

            # A play that fails ends the process, with its error and not by the kill.
            threading.Thread(target=kill, daemon=True).start()
            ProgramPlayer(link).play("cablecast_test", points)
            """
        )
    )
    driver = subprocess.run(
        [sys.executable, str(script), str(tmp_path / "twin.yaml")], timeout=300, check=False
    )
    assert driver.returncode == -9
    begin = process.admin.state()["time"]
    wait_until(lambda: process.admin.state()["time"] > begin + 2.0)
    state = process.admin.state()
    assert state["at_rest"]
    assert state["program"] == ""
    # It was moving, and the controller ended it: it did not reach the end of its way.
    ends = [e for e in process.admin.events() if e["what"] == "program ends"]
    end, heard, watchdog = ends[-1]["time"], state["heard"], setup.robot.watchdog
    # The silence that the watchdog allows, and the braking.
    assert watchdog - 0.02 < end - heard < watchdog + BRAKING_TIME_MAX
    truth = process.admin.truth(heard, end + 0.3)
    times, speeds = np.array(truth["times"]), np.array(truth["joint_speed"])
    assert speeds[times < heard + watchdog - 0.05].min() > REST_SPEED
    assert speeds[times > end + 0.1].max() < REST_SPEED


def test_a_program_that_comes_late_does_not_move_an_arm_that_was_moved(link, player, twin):
    points = way(link, twin[1])
    elsewhere = dataclasses.replace(points, q=points.q + 0.1)
    number = 999
    link.keep_alive()
    begin = link.latest().time
    link.send_program(motion_program("cablecast_late", elsewhere, twin[1].robot, number))
    with pytest.raises(StoppedError, match="moved before its program began"):
        player._watch(begin, number, 10.0)
    player.stop(number)
    reports = link.since(begin)
    assert np.ptp([r.q for r in reports], axis=0).max() < ANGLE_TOLERANCE


def test_a_controller_that_is_not_there_is_named_before_anything_is_printed(twin, capfd):
    robot = dataclasses.replace(twin[1].robot, address="127.255.255.1")
    with pytest.raises(RigError, match=r"no RTDE server answers at 127.255.255.1:30004"):
        UrLink(robot)
    assert capfd.readouterr().out == ""
