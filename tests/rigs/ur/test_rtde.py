"""Answers of a controller by RTDE."""

import socket
import threading

import pytest

from cablecast.rigs.ur import rtde

# Data packages in a row: more than one answer, and soon read.
PACKAGES = 200
# A controller that is not asked any longer [s].
TIMEOUT = 0.2


def test_a_controller_that_reports_but_never_confirms_its_start_is_told_from_a_dead_one():
    ours, theirs = socket.socketpair()
    done = threading.Event()

    def flow():
        while not done.wait(TIMEOUT / PACKAGES):
            theirs.sendall(rtde.frame(rtde.DATA_PACKAGE, b"\x01" + bytes(8)))

    thread = threading.Thread(target=flow)
    thread.start()
    ours.settimeout(TIMEOUT)
    try:
        with pytest.raises(OSError, match=r"sends other messages, but does not answer request 'S'"):
            rtde.ask(ours, rtde.FrameReader(), rtde.START)
    finally:
        done.set()
        thread.join()
    with pytest.raises(TimeoutError):
        rtde.ask(ours, rtde.FrameReader(), rtde.START)
    ours.close()
    theirs.close()
