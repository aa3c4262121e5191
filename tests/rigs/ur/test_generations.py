"""The three generations of controllers, each with what only it can do or fail to do."""

import dataclasses
import itertools
import socket
import struct
import threading
import time

import numpy as np
import pytest
from tests.rigs.ur.conftest import make_fault, wait_until

from cablecast.errors import InputError, RigError
from cablecast.rigs.ur.agent import reported
from cablecast.rigs.ur.link import UrLink, check_ready
from cablecast.rigs.ur.rtde import RtdeClient
from cablecast.rigs.ur.twin.controller import GENERATIONS
from cablecast.rigs.ur.twin.laboratory import FAULTS, TwinConfig, faults_of

# Noise of an encoder is 0.05 mrad.
ENCODER_ERROR = 5e-4
ARMS = {"cb3": "ur5", "e-series": "ur5e", "polyscope-x": "ur5e"}


@pytest.fixture(scope="module", params=list(GENERATIONS))
def twin(request, make_twin):
    name = request.param
    process, setup = make_twin(
        model=ARMS[name], generation=name, has_cable=False, rate=20.0, patience=0.0
    )
    yield name, process, setup
    process.close()


@pytest.fixture
def link(twin):
    _, process, setup = twin
    link = UrLink(setup.robot)
    yield link
    link.close()
    process.admin.clear()


def test_each_generation_is_told_by_its_version_and_asked_only_what_it_can_answer(twin, link):
    name, process, setup = twin
    assert link.version == GENERATIONS[name].version[:3]
    assert link.has_dashboard == (name != "polyscope-x")
    report = check_ready(link)
    assert report.payload == setup.robot.payload_mass
    if name != "polyscope-x":
        return
    for fault in ("dashboard_slow", "dashboard_off"):
        with pytest.raises(InputError, match=f"polyscope-x has no {fault}"):
            process.admin.fault(fault)


def test_a_slow_dashboard_delays_and_one_that_is_silent_is_named(twin, link, monkeypatch):
    name, process, _ = twin
    if name == "polyscope-x":
        pytest.skip("it has no dashboard")
    assert link.ask("running") == "Program running: false"
    make_fault(process, "dashboard_slow")
    monkeypatch.setattr("cablecast.rigs.ur.link._ANSWER_TIME_MAX", 0.1)
    with pytest.raises(RigError, match=r"did not answer 'running' within 0\.1 s") as error:
        link.ask("running")
    assert "\n" not in str(error.value)
    monkeypatch.setattr("cablecast.rigs.ur.link._ANSWER_TIME_MAX", 60.0)
    assert link.ask("safetymode") == "Safetymode: NORMAL"
    make_fault(process, "dashboard_off")
    with pytest.raises(RigError, match="no dashboard server answers"):
        link.ask("running")


def test_local_control_is_refused_where_it_can_be_asked_for(twin, link):
    name, process, _ = twin
    if "local_control" not in faults_of(name):
        assert name == "cb3"
        return
    make_fault(process, "local_control")
    if name == "e-series":
        with pytest.raises(RigError, match="switch the pendant to remote control"):
            check_ready(link)
    link.send_program("def cablecast_none():\n  stopj(2)\nend\n")
    wait_until(lambda: process.admin.events()[-1].get("reason") == "in local control")
    assert process.admin.events()[-1]["what"] == "program refused"


def test_a_program_that_hangs_is_ended_with_and_without_a_dashboard(twin, link):
    process = twin[1]
    q = link.wait_for_report().target_q.round(6).tolist()
    hold = f"servoj({q}, t=0.1, lookahead_time=0.1, gain=300)"
    link.send_program(f"def hang():\n  local n = 0\n  while n < 1:\n    {hold}\n  end\nend\n")
    # Reports of before may still be under way.
    wait_until(lambda: link.wait_for_report().is_playing)
    assert process.admin.state()["program"] == "hang"
    with pytest.raises(RigError, match="another program runs on the controller"):
        check_ready(link)
    link.stop_program()
    wait_until(lambda: not process.admin.state()["program"])


@pytest.mark.parametrize("version", [(7, 1, 0, 0), (4, 9, 9, 9)])
def test_a_controller_of_an_unknown_version_is_refused_in_one_line(
    twin_address, twin_setup, version, monkeypatch
):
    server = socket.create_server((twin_address(), 0))
    address, port = server.getsockname()
    monkeypatch.setattr("cablecast.rigs.ur.link.RTDE_PORT", port)

    def answer():
        connection, _ = server.accept()
        with connection:
            assert connection.recv(3) == b"\x00\x03v"
            connection.sendall(struct.pack(">HB4I", 19, ord("v"), *version))

    thread = threading.Thread(target=answer)
    thread.start()
    config = dataclasses.replace(twin_setup.robot, address=address)
    number = ".".join(map(str, version[:3]))
    with pytest.raises(RigError, match=f"runs version {number}, and cablecast knows 3") as error:
        UrLink(config)
    thread.join()
    server.close()
    assert "\n" not in str(error.value)


def test_a_program_reaches_a_controller_that_speaks_first(link, monkeypatch):
    server = socket.create_server((link.robot.address, 0))
    monkeypatch.setattr("cablecast.rigs.ur.link.PROGRAM_PORT", server.getsockname()[1])
    text, got = "# a program\n" * 2000, []

    def serve():
        connection, _ = server.accept()
        with connection:
            connection.settimeout(10.0)
            connection.sendall(bytes(107))
            time.sleep(0.05)
            connection.sendall(bytes(1000))
            time.sleep(0.05)
            while len(b"".join(got)) < len(text):
                got.append(connection.recv(1 << 16))

    thread = threading.Thread(target=serve)
    thread.start()
    link.send_program(text)
    thread.join()
    server.close()
    assert b"".join(got).decode() == text


def test_only_a_controller_that_is_too_old_is_not_asked_for_its_payload():
    for version in [(3, 10, 9), (5, 4, 3)]:
        assert "payload" not in reported(version)
    for version in [(3, 11, 0), (5, 5, 1), *(g.version[:3] for g in GENERATIONS.values())]:
        assert reported(version)[-2:] == ["payload", "payload_cog"]


def test_a_report_that_the_controller_does_not_know_is_named(twin):
    address = twin[2].robot.address
    with pytest.raises(RigError, match="does not report mood, weather"):
        RtdeClient(address, 40, lambda version: ["timestamp", "mood", "weather"])


def test_no_report_is_lost_while_its_reader_is_busy(twin):
    name, process, setup = twin
    client = RtdeClient(setup.robot.address, 40, lambda version: ["timestamp", "actual_q"])
    begin = process.admin.state()["time"]
    wait_until(lambda: process.admin.state()["time"] > begin + 1.0)
    reports = list(itertools.islice(client.reports(), 100))
    steps = np.diff([report["timestamp"] for report in reports])
    np.testing.assert_allclose(steps, GENERATIONS[name].dt, atol=1e-9)


def test_a_client_of_other_people_reads_the_same_of_the_twin(twin):
    rtde_receive = pytest.importorskip("rtde_receive")
    name, process, setup = twin
    names = [*reported(GENERATIONS[name].version[:3]), "output_int_register_36"]
    interface = rtde_receive.RTDEReceiveInterface(
        setup.robot.address, variables=names, use_upper_range_registers=True
    )
    try:
        np.testing.assert_allclose(
            interface.getActualQ(), process.admin.state()["q"], atol=ENCODER_ERROR
        )
        assert interface.getPayload() == setup.robot.payload_mass
        assert interface.getRobotMode() == 7
    finally:
        interface.disconnect()


def test_an_arm_gets_no_controller_of_another_series():
    assert TwinConfig().generation_of("ur5") == "cb3"
    assert TwinConfig().generation_of("ur3e") == "e-series"
    assert TwinConfig(generation="polyscope-x").generation_of("ur5e") == "polyscope-x"
    with pytest.raises(InputError, match="no ur5 with a controller of generation polyscope-x"):
        TwinConfig(generation="polyscope-x").generation_of("ur5")
    with pytest.raises(InputError, match="unknown generation 'cb2'"):
        TwinConfig(generation="cb2")
    for model in ("ur5e", "ur20"):
        assert TwinConfig().generation_of(model) == "e-series"
    assert set(FAULTS) - set(faults_of("cb3")) == {"local_control"}
