"""The program that carries one motion to the controller, set point by set point.

It runs on the controller's clock. Each cycle it looks whether this computer is still there, and
whether it asks to stop; if so, it brakes and ends. What it does and how far it is stands in
registers that RTDE reports.
"""

import enum

from cablecast.arm.robot import RobotConfig
from cablecast.rigs.ur.path import SetPoints

BEAT_REGISTER = 18
"""Input: a number that this computer changes as long as all is well."""
STOP_REGISTER = 19
"""Input: number of the program that shall stop."""
PHASE_REGISTER = 20
"""Input: what the rig is doing, for a person who looks, and for the twin."""
STATE_REGISTER = 12
"""Output: one of `ProgramState`."""
TICK_REGISTER = 13
"""Output: number of the set point that is being approached, from 1; 0 before the motion."""
NUMBER_REGISTER = 14
"""Output: number of the program, so that one is not taken for another."""

STOP_DECELERATION = 15.0
"""Deceleration of all joints when the program stops early [rad/s²]."""
HOLD_TIME = 0.3
"""Time for which the arm holds its place before a motion [s]."""


class ProgramState(enum.IntEnum):
    """States of a program."""

    NONE = 0
    HOLDING = 1
    MOVING = 2
    DONE = 3
    STOPPED = 4
    SILENCE = 5


def motion_program(name: str, points: SetPoints, robot: RobotConfig, number: int) -> str:
    """Return the program of one motion, in URScript.

    Args:
        name: Name of the program.
        points: Set points; the arm stands at the first.
        robot: Settings of servoj, and the longest silence.
        number: Number of the program.
    """
    silence = max(2, round(robot.watchdog / points.dt))
    rows = points.q
    lines = [
        f"def {name}():",
        f"  global beat = read_input_integer_register({BEAT_REGISTER})",
        "  global silence = 0",
        "  global going = True",
        f"  write_output_integer_register({TICK_REGISTER}, 0)",
        f"  write_output_integer_register({STATE_REGISTER}, {ProgramState.HOLDING:d})",
        f"  write_output_integer_register({NUMBER_REGISTER}, {number})",
        "  def watch():",
        f"    local now = read_input_integer_register({BEAT_REGISTER})",
        "    if now == beat:",
        "      silence = silence + 1",
        "    else:",
        "      silence = 0",
        "      beat = now",
        "    end",
        f"    if read_input_integer_register({STOP_REGISTER}) == {number}:",
        "      going = False",
        f"      write_output_integer_register({STATE_REGISTER}, {ProgramState.STOPPED:d})",
        f"    elif silence > {silence}:",
        "      going = False",
        f"      write_output_integer_register({STATE_REGISTER}, {ProgramState.SILENCE:d})",
        "    end",
        "  end",
        "  def go(tick, q):",
        "    if going:",
        "      watch()",
        "      if going:",
        f"        write_output_integer_register({TICK_REGISTER}, tick)",
        f"        servoj(q, t={points.dt:g}, lookahead_time={robot.lookahead:g}, "
        f"gain={robot.gain:g})",
        "      else:",
        f"        stopj({STOP_DECELERATION:g})",
        "      end",
        "    end",
        "  end",
        "  local held = 0",
        f"  while held < {round(HOLD_TIME / points.dt)}:",
        f"    go(0, {_row(rows[0])})",
        "    held = held + 1",
        "  end",
        "  if going:",
        f"    write_output_integer_register({STATE_REGISTER}, {ProgramState.MOVING:d})",
        "  end",
        *(f"  go({tick}, {_row(row)})" for tick, row in enumerate(rows[1:], 1)),
        "  if going:",
        f"    stopj({STOP_DECELERATION:g})",
        f"    write_output_integer_register({STATE_REGISTER}, {ProgramState.DONE:d})",
        "  end",
        "end",
    ]
    return "\n".join(lines) + "\n"


def _row(q) -> str:
    # A microradian moves the grip by less than a micrometre.
    return "[" + ",".join(f"{angle:.6f}" for angle in q) + "]"
