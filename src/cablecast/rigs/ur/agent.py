"""Process of its own that talks to the controller by RTDE; `UrLink` starts and commands it.

It reads every report in time, however long the process that drives the arm thinks. The heartbeat
comes from here, too: it stops as soon as the owner is gone, or silent.

Commands come in and answers go out as JSON, one a line.
"""

import contextlib
import json
import os
import sys
import threading
import time
from typing import Any, TextIO

from cablecast.errors import RigError
from cablecast.rigs.ur.rtde import BEAT, CB3, NUMBER, STATE, TICK, RtdeClient, Version

DASHBOARD_PORT, PROGRAM_PORT = 29999, 30002
"""Ports of every UR controller; programs go to the secondary client interface."""

OWNER_TIME_MAX = 0.5
"""Longest time for which the heart beats without a word from the owner [s]."""
_PLAYING = 2
"""State of RTDE's runtime while a program runs."""


class Agent:
    """Connection to one controller.

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
        registers = [output_register + index for index in (STATE, TICK, NUMBER)]
        self._registers = [f"output_int_register_{index}" for index in registers]
        self._client = RtdeClient(
            address, input_register, lambda version: [*reported(version), *self._registers]
        )
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
                self._client.write(command["register"], command["value"])

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
            self._client.write(BEAT, self._beat)

    def _record(self) -> None:
        """Send every report, in the order of the attributes of `Report`."""
        for r in self._client.reports():
            report = [
                r["timestamp"],
                time.monotonic(),
                r["actual_q"],
                r["actual_qd"],
                r["target_q"],
                r["speed_scaling"] * r["target_speed_fraction"],
                r["safety_status_bits"],
                r["runtime_state"] == _PLAYING,
                r["robot_mode"],
                r.get("payload"),
                r.get("payload_cog"),
                *(r[name] for name in self._registers),
            ]
            try:
                self.say(report=report)
            except (BrokenPipeError, ValueError):
                os._exit(0)
            # On a busy computer this thread may be the only one that runs in time.
            self._pulse_once()


def reported(version: Version) -> list[str]:
    """Return the names of what a controller is asked to report, but for registers.

    CB3 reports the payload since 3.11, an e-Series since 5.5.1 (RTDE Guide).
    """
    names = ["timestamp", "actual_q", "actual_qd", "target_q", "speed_scaling"]
    names += ["target_speed_fraction", "safety_status_bits", "robot_mode", "runtime_state"]
    payload_since = (3, 11, 0) if version[0] == CB3 else (5, 5, 1)
    return names + ["payload", "payload_cog"] * (version >= payload_since)


def main() -> None:
    """Connect, say so, and obey until the owner is gone."""
    try:
        agent = Agent(sys.stdout, **json.loads(sys.stdin.readline()))
    except Exception as error:
        kind = "refused" if isinstance(error, RigError) else "failed"
        print(json.dumps({kind: " ".join(str(error).split())[:300]}), flush=True)
        return
    agent.say(connected=True)
    with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
        for line in sys.stdin:
            agent.obey(json.loads(line))
    # Nothing is left to do, and threads still write.
    os._exit(0)


if __name__ == "__main__":
    main()
