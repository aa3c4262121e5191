"""Process of its own that talks to the controller through ur-rtde; `UrLink` starts and commands it.

ur-rtde ends its whole process when a connection breaks at the wrong moment, keeps Python's lock
while it connects, and prints to standard output. Here none of that reaches the process that drives
the arm. The heartbeat comes from here, too: it stops as soon as the owner is gone, or silent.

Commands come in and answers go out as JSON, one a line.
"""

import contextlib
import json
import os
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any, TextIO

from cablecast.errors import RigError
from cablecast.rigs.ur.rtde import BEAT, NUMBER, STATE, TICK, RegisterWriter

DASHBOARD_PORT, PROGRAM_PORT = 29999, 30002
"""Ports of every UR controller; programs go to the secondary client interface."""

OWNER_TIME_MAX = 0.5
"""Longest time for which the heart beats without a word from the owner [s]."""
_POLL = 0.0005


class Agent:
    """Connections of ur-rtde to one controller.

    Args:
        out: Stream of answers.
        address: Name or address of the controller.
        beat_period: Time between two heartbeats [s].
        input_register: First of the registers that are written.
        output_register: First of the registers that programs write.
    """

    def __init__(
        self,
        out: TextIO,
        address: str,
        beat_period: float,
        input_register: int,
        output_register: int,
    ):
        self._out = out
        self._beat_period = beat_period
        self._lock = threading.Lock()
        self._write_lock = threading.Lock()
        self._alive_until = 0.0
        self._beat = 0
        self._beat_at = 0.0
        self._output_registers = [output_register + index for index in (STATE, TICK, NUMBER)]
        self._receive, self._has_payload = receive(address, self._output_registers)
        self._inputs = RegisterWriter(address, input_register)
        for target in (self._record, self._pulse):
            threading.Thread(target=target, daemon=True).start()

    def say(self, **values: Any) -> None:
        """Send one answer."""
        with self._lock:
            self._out.write(json.dumps(values) + "\n")
            self._out.flush()

    def obey(self, command: dict[str, Any]) -> None:
        """Carry out one command."""
        do = command["do"]
        if do == "alive":
            self._alive_until = time.monotonic() + OWNER_TIME_MAX
        elif do == "rest":
            self._alive_until = 0.0
        elif do == "write":
            # One that is not written is a connection that broke: the owner notices the silence.
            with contextlib.suppress(OSError), self._write_lock:
                self._inputs.write(command["register"], command["value"])

    def _pulse(self) -> None:
        """Change the beat's register as long as the owner wants."""
        while True:
            time.sleep(self._beat_period)
            self._pulse_once()

    def _pulse_once(self) -> None:
        """Beat, unless the owner is silent or the last beat was just now."""
        now = time.monotonic()
        if now > self._alive_until or now - self._beat_at < self._beat_period / 2:
            return
        self._beat_at = now
        self._beat = (self._beat + 1) % 1_000_000
        with contextlib.suppress(OSError), self._write_lock:
            self._inputs.write(BEAT, self._beat)

    def _record(self) -> None:
        """Send every report that is read whole, in the order of the attributes of `Report`."""
        r = self._receive
        before = -1.0
        while True:
            try:
                now = r.getTimestamp()
                if now == before:
                    time.sleep(_POLL)
                    continue
                report = [
                    now,
                    time.monotonic(),
                    r.getActualQ(),
                    r.getActualQd(),
                    r.getTargetQ(),
                    r.getSpeedScaling() * r.getTargetSpeedFraction(),
                    r.getSafetyStatusBits(),
                    r.getRobotMode(),
                    r.getRuntimeState() == 2,
                    r.getPayload() if self._has_payload else None,
                    r.getPayloadCog() if self._has_payload else None,
                    *(r.getOutputIntRegister(index) for index in self._output_registers),
                ]
                # A report that changed while it was read is read again.
                if r.getTimestamp() == now:
                    before = now
                    self.say(report=report)
                    # On a busy computer this thread may be the only one that runs in time.
                    self._pulse_once()
            except (BrokenPipeError, ValueError):
                os._exit(0)
            except Exception:
                # A connection that breaks: the owner notices the silence.
                time.sleep(0.01)


def receive(address: str, registers: Sequence[int]) -> tuple[Any, bool]:
    """Return a connection that reports what `Report` needs, and whether it reports the payload.

    By itself ur-rtde asks for ten times as much, and of PolyScope X it does not ask the payload.
    CB3 reports it since 3.11, an e-Series since 5.5.
    """
    import rtde_receive

    names = [
        "timestamp",
        "actual_q",
        "actual_qd",
        "target_q",
        "speed_scaling",
        "target_speed_fraction",
        "safety_status_bits",
        "robot_mode",
        "runtime_state",
        *(f"output_int_register_{index}" for index in registers),
    ]
    upper = min(registers) >= 24
    try:
        more = [*names, "payload", "payload_cog"]
        connection = rtde_receive.RTDEReceiveInterface(
            address, variables=more, use_upper_range_registers=upper
        )
        return connection, True
    except RuntimeError as error:
        if "payload" not in str(error):
            raise
    connection = rtde_receive.RTDEReceiveInterface(
        address, variables=names, use_upper_range_registers=upper
    )
    return connection, False


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300]


def main() -> None:
    """Connect, say so, and obey until the owner is gone."""
    # What libraries print must not get between the answers.
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    try:
        agent = Agent(out, **json.loads(sys.stdin.readline()))
    except ModuleNotFoundError as error:
        out.write(json.dumps({"missing": str(error.name)}) + "\n")
        out.flush()
        return
    except Exception as error:
        kind = "refused" if isinstance(error, RigError) else "failed"
        out.write(json.dumps({kind: _one_line(error)}) + "\n")
        out.flush()
        os._exit(1)
    agent.say(connected=True)
    with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
        for line in sys.stdin:
            agent.obey(json.loads(line))
    # ur-rtde's own end may hang or abort, and nothing is left to do.
    os._exit(0)


if __name__ == "__main__":
    main()
