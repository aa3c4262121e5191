"""The program that ur-rtde uploads, as the twin carries it out: commands arrive in registers.

The text of ur-rtde's program is not interpreted. The twin knows it by its name and does what its
commands ask for, as far as a rig uses them: move, stream set points, stop, and watch for silence.
The numbers of commands and registers were read from the program that ur-rtde 1.6.5 sends.
"""

from typing import Any

import numpy as np

from cablecast.twin.urscript import Run

READY, DONE = 1, 2
_MOVEJ, _SERVOJ, _SERVO_STOP, _STOPL, _STOPJ = 1, 11, 16, 7, 8
_WITHIN_LIMITS_POSE, _WITHIN_LIMITS_JOINTS, _WATCHDOG, _END = 36, 37, 35, 255
_SERVO_BRAKE = 10.0


def is_ur_rtde_program(text: str) -> bool:
    """Return whether a program is the one that ur-rtde uploads."""
    return "def rtde_control():" in text


class UrRtdeProgram:
    """Carries out the commands of ur-rtde.

    Args:
        controller: The `Controller` that it runs on.
    """

    def __init__(self, controller: Any):
        self.controller = controller
        self._executed = False
        self._servo: tuple[Any, ...] | None = None
        self._watchdog = 0.0
        self._silence = 0.0

    def run(self) -> Run:
        """Run until the stop command, and yield what takes time."""
        c = self.controller
        c.int_registers[0] = READY
        c.inputs["input_int_register_0"] = 0
        while True:
            command = int(c.inputs["input_int_register_0"])
            if self._is_silent():
                c.log("watchdog", silence=self._silence)
                yield "stopj", (_SERVO_BRAKE,), {}
                return
            if command == _END:
                yield "stopj", (_SERVO_BRAKE,), {}
                return
            if command == _SERVOJ:
                q = [self._double(i) for i in range(6)]
                self._servo = (q, self._double(8), self._double(9), self._double(10))
                c.int_registers[0] = READY
            elif command == 0:
                self._executed = False
                c.int_registers[0] = READY
            elif not self._executed:
                yield from self._carry_out(command)
                self._executed = True
                c.int_registers[0] = DONE
            if self._servo is None:
                yield "sync", (), {}
            else:
                q, t, lookahead, gain = self._servo
                yield (
                    "servoj",
                    (q,),
                    {"t": max(t, c.dt), "lookahead_time": lookahead, "gain": gain},
                )

    def _carry_out(self, command: int) -> Run:
        c = self.controller
        if command == _MOVEJ:
            q = [self._double(i) for i in range(6)]
            yield "movej", (q,), {"v": self._double(6), "a": self._double(7)}
        elif command == _SERVO_STOP:
            self._servo = None
            yield "stopj", (_SERVO_BRAKE,), {}
        elif command in (_STOPL, _STOPJ):
            self._servo = None
            yield "stopj", (max(self._double(0), 0.5),), {}
        elif command == _WATCHDOG:
            self._watchdog = self._double(0)
        elif command in (_WITHIN_LIMITS_POSE, _WITHIN_LIMITS_JOINTS):
            q = np.array([self._double(i) for i in range(6)])
            c.limits.forget()
            c.int_registers[1] = int(c.limits.violation(q) is None)
            c.limits.forget()
        else:
            c.log("command not known to the twin", command=command)

    def _is_silent(self) -> bool:
        """Return whether the client has written nothing for longer than its watchdog allows."""
        c = self.controller
        self._silence = c.time - float(c.inputs.get("written at", c.time))
        return self._watchdog > 0.0 and self._silence > 1.0 / self._watchdog

    def _double(self, index: int) -> float:
        return float(self.controller.inputs[f"input_double_register_{index}"])
