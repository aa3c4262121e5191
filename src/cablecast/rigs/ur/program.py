"""The program that carries one motion to the controller.

A program holds a path as cubic pieces in joint space, a line each, and evaluates them at the
controller's own rate. Each cycle it looks whether this computer is still there, and whether it asks
to stop; if so, it brakes and ends. What it does and how far it is stands in registers that RTDE
reports.

Sources: Universal Robots, "The URScript Programming Language"; controllers neither run nor refuse
programs of some 1,000 to 2,500 motions (GitHub: visose/Robots #55, ros-industrial/universal_robot
#411), so that a program here is short, whatever its motion.
"""

import enum

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.rigs.path import DECIMALS_Q, DECIMALS_QD, JointCurve
from cablecast.rigs.ur.config import RobotUR
from cablecast.rigs.ur.rtde import BEAT, NUMBER, STATE, STOP, TICK

PROGRAM_SIZE_MAX = 20_000
"""Longest program [byte]."""
TICK_DT = 0.001
"""Unit of the time that a program reports [s]."""
_ELSEWHERE = 0.01
"""Angle of a joint from the start of a motion from which on its program does not move [rad]. A
program may arrive late, and an arm may be jogged meanwhile."""
STOP_DECELERATION = 15.0
"""Deceleration of all joints when the program stops early [rad/s²]."""
HOLD_TIME, _HOLD_MARGIN = 0.3, 0.1
"""Shortest time for which the arm holds its place before a motion, and by how much that is longer
than the watchdog's: an arm whose computer has died meanwhile does not begin to move [s]."""


class ProgramState(enum.IntEnum):
    """States of a program."""

    NONE = 0
    HOLDING = 1
    MOVING = 2
    DONE = 3
    STOPPED = 4
    SILENCE = 5
    ELSEWHERE = 6


UNDER_WAY = (ProgramState.HOLDING, ProgramState.MOVING)
"""States of a program that has not ended by itself."""

_PROGRAM = """\
def {name}():
  global step = get_steptime()
  global cycle = floor(1000 * step + 0.5)
  global beat = read_input_integer_register({beat})
  global silence = 0
  global tick = 0
  global q_0 = {start}
  global qd_0 = {rest}
  write_output_integer_register({tick}, 0)
  write_output_integer_register({state}, {states.HOLDING:d})
  write_output_integer_register({program}, {number})
  def brake(state):
    write_output_integer_register({state}, state)
    stopj({deceleration:g})
    halt
  end
  def servo(q):
    local now = read_input_integer_register({beat})
    silence = silence + cycle
    if now != beat:
      silence = 0
      beat = now
    end
    if read_input_integer_register({stop}) == {number}:
      brake({states.STOPPED:d})
    elif silence > {silence_max}:
      brake({states.SILENCE:d})
    end
    write_output_integer_register({tick}, tick)
    servoj(q, t=step, lookahead_time={robot.lookahead:g}, gain={robot.gain:g})
  end
  def go(span, q, qd):
    local at = 0.0
    while at < span - 0.5:
      at = at + cycle
      tick = tick + cycle
      local u = at / span
      local w = u * u * (3.0 - 2.0 * u)
      local c = u * (1.0 - u) * span / 1000.0
      local a = c * (1.0 - u)
      local b = c * u
      servo({angles})
    end
    q_0 = q
    qd_0 = qd
  end
  local here = get_actual_joint_positions()
  local joint = 0
  while joint < 6:
    local off = here[joint] - q_0[joint]
    if off > {tolerance:g} or off < -{tolerance:g}:
      brake({states.ELSEWHERE:d})
    end
    joint = joint + 1
  end
  local held = 0
  while held < {hold}:
    servo(q_0)
    held = held + cycle
  end
  write_output_integer_register({state}, {states.MOVING:d})
{pieces}
  stopj({deceleration:g})
  write_output_integer_register({state}, {states.DONE:d})
end
"""
_ANGLES = ", ".join(
    f"q_0[{j}] + w * (q[{j}] - q_0[{j}]) + a * qd_0[{j}] - b * qd[{j}]" for j in range(6)
)


def hold_time(robot: RobotUR) -> float:
    """Return the time for which the arm holds its place before a motion [s]."""
    return max(HOLD_TIME, robot.watchdog + _HOLD_MARGIN)


def motion_program(name: str, curve: JointCurve, robot: RobotUR, number: int) -> str:
    """Return the program of one motion, in URScript.

    Args:
        name: Name of the program.
        curve: Path; the arm stands at its start.
        robot: Registers, settings of servoj, and the longest silence.
        number: Number of the program.

    Raises:
        InputError: The path has so many pieces that a controller may not take its program.
    """
    spans = 1000 * np.diff(curve.times)
    pieces = [
        f"  go({span:.1f}, {_row(q, DECIMALS_Q)}, {_row(qd, DECIMALS_QD)})"
        for span, q, qd in zip(spans, curve.q[1:], curve.qd[1:], strict=True)
    ]
    text = _PROGRAM.format(
        name=name,
        start=_row(curve.q[0], DECIMALS_Q),
        rest=_row(curve.qd[0], 1),
        beat=robot.input_register + BEAT,
        stop=robot.input_register + STOP,
        state=robot.output_register + STATE,
        tick=robot.output_register + TICK,
        program=robot.output_register + NUMBER,
        number=number,
        deceleration=STOP_DECELERATION,
        silence_max=round(1000 * robot.watchdog),
        robot=robot,
        states=ProgramState,
        tolerance=_ELSEWHERE,
        angles=f"[{_ANGLES}]",
        hold=round(1000 * hold_time(robot)),
        pieces="\n".join(pieces),
    )
    if len(text) > PROGRAM_SIZE_MAX:
        raise InputError(
            f"the program of {name} has {len(text)} bytes, more than {PROGRAM_SIZE_MAX}: its path "
            f"of {curve.duration:.1f} s has {len(pieces)} pieces"
        )
    return text


def _row(values: NDArray[np.float64], decimals: int) -> str:
    return "[" + ",".join(f"{value:.{decimals}f}" for value in values) + "]"
