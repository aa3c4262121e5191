"""Set points of one motion: their checks, and the program that carries them to the controller.

The program runs on the controller's clock. Each cycle it looks whether this computer is still
there, and whether it asks to stop; if so, it brakes and ends. What it does and how far it is stands
in registers that RTDE reports.
"""

import dataclasses
import enum

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.robot import RobotConfig
from cablecast.arm.shape import find_collision
from cablecast.arm.ur import JOINT_NAMES
from cablecast.errors import InputError, JointLimitError
from cablecast.rigs.ur.agent import (
    BEAT_REGISTER,
    NUMBER_REGISTER,
    STATE_REGISTER,
    STOP_REGISTER,
    TICK_REGISTER,
)
from cablecast.setup import Setup

Array = NDArray[np.float64]

CONTROL_DTS = (0.002, 0.004, 0.008)
"""Times between set points that the programs use [s]: whole cycles of both controllers."""
_LIMIT_TOLERANCE = 1.001
_ACCELERATION_MARGIN = 1.25
"""Second differences of set points overshoot the true peak of an acceleration at its corners."""


@dataclasses.dataclass(frozen=True)
class SetPoints:
    """Set points at even times, from rest to rest.

    Attributes:
        q: Joint angles [rad], shape [tick, 6].
        dt: Time between two of them [s].
    """

    q: Array
    dt: float

    def __post_init__(self):
        if self.q.ndim != 2 or self.q.shape[1] != 6 or len(self.q) < 2:
            raise InputError(f"set points have shape {self.q.shape}, not [tick, 6]")
        if not np.all(np.isfinite(self.q)):
            raise InputError("set points must be finite")
        if not any(abs(self.dt - dt) < 1e-9 for dt in CONTROL_DTS):
            known = ", ".join(f"{dt:g}" for dt in CONTROL_DTS)
            raise InputError(f"control_dt = {self.dt:g} s of a robot must be one of {known} s")

    @property
    def duration(self) -> float:
        """Time from the first to the last [s]."""
        return (len(self.q) - 1) * self.dt

    def slowed(self, factor: float) -> "SetPoints":
        """Return the same way at a part of the speed.

        Args:
            factor: Share of the speed, above 0 and at most 1 [-].
        """
        from scipy.interpolate import CubicSpline

        times = np.arange(len(self.q)) * self.dt
        count = int(np.ceil(times[-1] / factor / self.dt)) + 1
        spline = CubicSpline(times, self.q, axis=0, bc_type="clamped")
        q = spline(np.minimum(np.arange(count) * self.dt * factor, times[-1]))
        return SetPoints(np.asarray(q), self.dt)


def joint_move(start: Array, end: Array, speed: float, dt: float) -> SetPoints:
    """Return a straight way in joint space, from rest to rest.

    Args:
        start: Joint angles at its start [rad], shape [6].
        end: Joint angles at its end [rad], shape [6].
        speed: Largest speed of a joint [rad/s].
        dt: Time between set points [s].
    """
    distance = float(np.abs(end - start).max())
    duration = max(1.875 * distance / speed, 4 * dt)
    count = int(np.ceil(duration / dt)) + 1
    u = np.linspace(0.0, 1.0, count)[:, None]
    return SetPoints(start + u**3 * (10 - 15 * u + 6 * u * u) * (end - start), dt)


def check_path(points: SetPoints, setup: Setup, what: str) -> None:
    """Refuse set points that leave limits or box, or come too close to anything.

    Args:
        points: Set points.
        setup: Arm with its limits, and the robot section with box, margins and obstacles.
        what: Name of the motion in the error.

    Raises:
        JointLimitError: A limit, the box or a distance is violated; names the value and the bound.
        InputError: The set-up has no robot.
    """
    robot, limits = setup.robot, setup.arm.limits
    if robot is None:
        raise InputError("the lab file has no robot section: --rig ur needs one")
    q, dt = points.q, points.dt
    position = np.array(limits.position) - robot.position_margin
    qd = np.diff(q, axis=0) / dt
    padded = np.concatenate([np.zeros((1, 6)), qd, np.zeros((1, 6))])
    qdd = np.diff(padded, axis=0) / dt
    for values, bound, name, unit in (
        (q, position, "at", "rad"),
        (qd, np.array(limits.velocity) * _LIMIT_TOLERANCE, "turning at", "rad/s"),
        (qdd, np.array(limits.acceleration) * _ACCELERATION_MARGIN, "speeding up at", "rad/s²"),
    ):
        over = np.abs(values) - bound
        if over.max() > 0.0:
            tick, joint = np.unravel_index(int(np.argmax(over)), over.shape)
            raise JointLimitError(
                f"{what}: {JOINT_NAMES[int(joint)]} {name} {values[tick, joint]:.3f} {unit} is "
                f"beyond {bound[joint]:.3f} {unit}"
            )
    low, high = np.array(robot.box_low), np.array(robot.box_high)
    for name, places in (
        ("grip", setup.arm.grip_pose(q)[:, :3]),
        ("flange", setup.arm.forward(q)[:, :3, 3]),
    ):
        outside = np.maximum(low - places, places - high).max(axis=1)
        if outside.max() > 0.0:
            tick = int(np.argmax(outside))
            raise JointLimitError(
                f"{what}: the {name} at {places[tick].round(3).tolist()} m is outside the box from "
                f"{low.tolist()} to {high.tolist()} m"
            )
    if found := find_collision(setup.arm, robot, q):
        raise JointLimitError(f"{what}: {found}")


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


def _row(q: Array) -> str:
    # A microradian moves the grip by less than a micrometre.
    return "[" + ",".join(f"{angle:.6f}" for angle in q) + "]"
