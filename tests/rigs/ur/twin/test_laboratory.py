import contextlib
import struct
import time
from types import SimpleNamespace

import pytest

from cablecast.rigs.arm import REPORT_GAP_MAX
from cablecast.rigs.driver import RigPhase
from cablecast.rigs.path import straight_move
from cablecast.rigs.ur.program import motion_program
from cablecast.rigs.ur.rtde import BEAT, PHASE
from cablecast.rigs.ur.twin import laboratory as laboratory_module
from cablecast.rigs.ur.twin.laboratory import Fault, TwinConfig, TwinLaboratory
from cablecast.rigs.ur.twin.servers import DATA_PACKAGE, SETUP_INPUTS, SETUP_OUTPUTS, frame

INPUT = b"input_int_register_24"


@pytest.fixture
def make_laboratory(twin_setup, twin_address):
    """Return a function that makes a laboratory without a cable, closed after the test."""
    with contextlib.ExitStack() as stack:

        def make(**settings):
            config = TwinConfig(address=twin_address(), has_cable=False, **settings)
            laboratory = TwinLaboratory(twin_setup, config)
            stack.callback(laboratory.close)
            return laboratory

        yield make


def rtde_client(laboratory):
    """Return a client of RTDE that reads nothing of what it is sent."""
    client = SimpleNamespace(kind="rtde", state={}, send=lambda data: None, open=True)
    laboratory.rtde.accept(client)
    return client


@pytest.mark.parametrize("patience", [0.0, 60.0])
def test_the_clock_waits_for_a_client_that_is_busy_and_that_of_a_real_controller_does_not(
    make_laboratory, twin_setup, patience
):
    laboratory = make_laboratory(rate=10.0, patience=patience)
    controller = laboratory.controller
    points = straight_move(controller.arm.q, controller.arm.q + [0.3, 0, 0, 0, 0, 0], 1.0)
    controller.inputs.update({f"input_int_register_{controller.robot.input_register + BEAT}": 1})
    controller.inputs["written at"] = begin = controller.time
    controller.load(motion_program("silent", points, twin_setup.robot, 1))
    deadline = time.monotonic() + (0.3 if patience else 60.0)
    laboratory.run(lambda: time.monotonic() < deadline and controller.time < begin + 1.0)
    if patience:
        # It was never silent for so long by the controller's clock that the arm had to stop.
        assert controller.is_running_program
        assert controller.time - begin <= twin_setup.robot.watchdog / 2 + 2 * controller.dt
    else:
        assert not controller.is_running_program
        assert controller.at_rest


def test_a_twin_that_was_held_up_does_not_make_up_for_it_in_a_rush(make_laboratory, monkeypatch):
    laboratory = make_laboratory(rate=3.0)
    now, ticks = [0.0], []

    def poll(timeout, *_):
        now[0] += max(timeout, 0.0)

    def tick():
        # One tick takes as long as five minutes of the world.
        now[0] += 300.0 * (len(ticks) == 10)
        ticks.append(now[0])

    monkeypatch.setattr(laboratory_module, "time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(laboratory.servers, "poll", poll)
    monkeypatch.setattr(laboratory.servers, "of", lambda kind: [kind])
    monkeypatch.setattr(laboratory, "tick", tick)
    laboratory.run(lambda: len(ticks) < 100)
    # What comes at once is less of the controller's time than a cast may lack of its reports.
    rush = ticks.count(ticks[10]) * laboratory.controller.dt
    assert 0.0 < rush < REPORT_GAP_MAX


def test_a_fault_comes_in_a_phase_that_begins_and_ends_between_two_ticks(
    make_laboratory, twin_setup
):
    laboratory = make_laboratory()
    controller, server, client = laboratory.controller, laboratory.rtde, rtde_client(laboratory)
    name = f"input_int_register_{twin_setup.robot.input_register + PHASE}".encode()
    server.receive(client, frame(SETUP_INPUTS, name), [client])
    recipe = next(iter(client.state["inputs"]))
    # Both arrive as one piece.
    written = b"".join(
        frame(DATA_PACKAGE, struct.pack(">Bi", recipe, phase))
        for phase in (RigPhase.READOUT, RigPhase.IDLE)
    )
    laboratory.faults.append(Fault("speed_slider", "readout"))
    laboratory.tick()
    assert controller.speed_slider == 1.0
    server.receive(client, written, [client])
    laboratory.tick()
    assert controller.speed_slider == 0.5
    assert not laboratory.faults


@pytest.mark.parametrize(
    "data",
    [
        b"\x00\x00\x00",
        frame(SETUP_INPUTS, b"\xff"),
        frame(SETUP_OUTPUTS, b"\x00"),
        frame(DATA_PACKAGE, b"\x07"),
        frame(SETUP_INPUTS, INPUT) + frame(DATA_PACKAGE, b"\x01\x00"),
    ],
    ids=["no header", "no names", "no rate", "unknown recipe", "short"],
)
def test_a_client_that_sends_nonsense_is_dropped_and_the_twin_goes_on(make_laboratory, data):
    laboratory = make_laboratory()
    client = rtde_client(laboratory)
    laboratory.rtde.receive(client, data, [client])
    assert not client.open
    assert laboratory.controller.events[-1]["what"] == "RTDE client sent nonsense"
    laboratory.tick()
