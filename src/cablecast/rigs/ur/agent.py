"""Process of its own that talks to the controller through ur-rtde; `UrLink` starts and commands it.

ur-rtde ends its whole process when a connection breaks at the wrong moment, keeps Python's lock
while it connects, and prints to standard output. Here none of that reaches the one who drives the
arm. The heart beats here, too: it stops as soon as the owner is gone, or says nothing.

Commands come in and answers go out as JSON, one a line.
"""

import contextlib
import json
import os
import sys
import threading
import time
from typing import Any, TextIO

OWNER_TIME_MAX = 0.5
"""Longest time for which the heart beats without a word from the owner [s]."""
_POLL = 0.0005
_CONNECT_TIME_MAX_MS = 3000


class Agent:
    """Connections of ur-rtde to one controller.

    Args:
        out: Stream of answers.
        settings: Address, dashboard port, registers, and the period of the heartbeat.
    """

    def __init__(self, out: TextIO, settings: dict[str, Any]):
        import dashboard_client
        import rtde_io
        import rtde_receive

        self._out = out
        self._settings = settings
        self._lock = threading.Lock()
        self._write_lock = threading.Lock()
        self._alive_until = 0.0
        self._beat = 0
        self._beat_at = 0.0
        address = settings["address"]
        self._dashboard: Any = dashboard_client.DashboardClient(address, settings["dashboard_port"])
        self._dashboard.connect(_CONNECT_TIME_MAX_MS)
        self._receive: Any = rtde_receive.RTDEReceiveInterface(address)
        self._io: Any = rtde_io.RTDEIOInterface(address)
        self._control: Any = None
        for target in (self._record, self._pulse):
            threading.Thread(target=target, daemon=True).start()

    def say(self, values: dict[str, Any]) -> None:
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
            with self._write_lock:
                written = self._io.setInputIntRegister(command["register"], command["value"])
            if not written:
                self.say({"error": f"register {command['register']} was not written"})
        elif do == "ask":
            try:
                self.say({"answer": str(getattr(self._dashboard, command["question"])())})
            except Exception as error:
                self.say({"answer": None, "error": " ".join(str(error).split())[:200]})
        elif do == "stream":
            threading.Thread(target=self._stream, args=(command,), daemon=True).start()

    def _pulse(self) -> None:
        """Change the beat's register as long as the owner wants."""
        while True:
            time.sleep(self._settings["beat_period"])
            self._pulse_once()

    def _pulse_once(self) -> None:
        """Beat, unless the owner is silent or the last beat was just now."""
        now, period = time.monotonic(), self._settings["beat_period"]
        if now > self._alive_until or now - self._beat_at < period / 2:
            return
        self._beat_at = now
        self._beat = (self._beat + 1) % 1_000_000
        with contextlib.suppress(Exception), self._write_lock:
            self._io.setInputIntRegister(self._settings["beat_register"], self._beat)

    def _record(self) -> None:
        """Send every report that is read whole."""
        r, settings = self._receive, self._settings
        state, tick, number = (settings[f"{name}_register"] for name in ("state", "tick", "number"))
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
                    r.getPayload(),
                    self._payload_cog(),
                    r.getOutputIntRegister(state),
                    r.getOutputIntRegister(tick),
                    r.getOutputIntRegister(number),
                ]
                # A report that changed while it was read is read again.
                if r.getTimestamp() == now:
                    before = now
                    self.say({"report": report})
                    # On a busy computer this thread may be the only one that runs in time.
                    self._pulse_once()
            except (BrokenPipeError, ValueError):
                os._exit(0)
            except Exception:
                # A connection that breaks: the silence will be noticed.
                time.sleep(0.01)

    def _payload_cog(self) -> list[float] | None:
        """Return the centre of the payload; None where the controller does not report it."""
        try:
            return self._receive.getPayloadCog()
        except RuntimeError:
            return None

    def _stream(self, command: dict[str, Any]) -> None:
        """Send set points one by one, each a cycle after the one before."""
        import rtde_control

        try:
            if self._control is None:
                self._control = rtde_control.RTDEControlInterface(self._settings["address"])
            control, dt = self._control, command["dt"]
            control.setWatchdog(1.0 / command["watchdog"])
            self.say({"stream": "begins"})
            for tick, q in enumerate(command["q"]):
                if time.monotonic() > self._alive_until:
                    self.say({"stream": "silence", "tick": tick})
                    break
                begin = control.initPeriod()
                control.servoJ(q, 0.0, 0.0, dt, command["lookahead"], command["gain"])
                control.waitPeriod(begin)
            else:
                self.say({"stream": "done"})
            control.servoStop(command["deceleration"])
            control.stopScript()
            control.disconnect()
            self._control = None
        except Exception as error:
            self._control = None
            self.say({"stream": "failed", "error": " ".join(str(error).split())[:200]})


def main() -> None:
    """Connect, say so, and obey until the owner is gone."""
    # What libraries print must not get between the answers.
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    try:
        agent = Agent(out, json.loads(sys.stdin.readline()))
    except ModuleNotFoundError as error:
        out.write(json.dumps({"missing": str(error.name)}) + "\n")
        out.flush()
        return
    except Exception as error:
        out.write(json.dumps({"failed": " ".join(str(error).split())[:200]}) + "\n")
        out.flush()
        os._exit(1)
    agent.say({"connected": True})
    with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
        for line in sys.stdin:
            agent.obey(json.loads(line))
    # ur-rtde's own end may hang or abort, and nothing is left to do.
    os._exit(0)


if __name__ == "__main__":
    main()
