"""Path of one motion: its fit, its checks, and the program that carries it to the controller.

A program holds a path as cubic pieces in joint space, a line each, and evaluates them at the
controller's own rate. Each cycle it looks whether this computer is still there, and whether it asks
to stop; if so, it brakes and ends. What it does and how far it is stands in registers that RTDE
reports.

Sources: Universal Robots, "The URScript Programming Language"; controllers neither run nor refuse
programs of some 1,000 to 2,500 motions (GitHub: visose/Robots #55, ros-industrial/universal_robot
#411), so that a program here is short, whatever its motion.
"""

import dataclasses
import enum
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.robot import RobotConfig
from cablecast.arm.shape import find_collision
from cablecast.arm.ur import JOINT_NAMES
from cablecast.errors import InputError, JointLimitError
from cablecast.motion.trajectory import JointPath
from cablecast.rigs.ur.rtde import BEAT, NUMBER, STATE, STOP, TICK
from cablecast.setup import Setup

Array = NDArray[np.float64]

PROGRAM_SIZE_MAX = 20_000
"""Longest program [byte]."""
TICK_DT = 0.001
"""Unit of the time that a program reports [s]."""
FIT_TOLERANCE = 8e-5
"""Largest distance of a piece from the set points [rad]: with what lies between them, 1e-4."""
_KNOT_DT = 0.008
"""Pieces last whole multiples of it [s]: whole cycles of every controller."""
_CHECK_DT = 0.002
_DECIMALS_Q, _DECIMALS_QD = 6, 5
"""A microradian moves the grip by less than a micrometre."""
_LIMIT_TOLERANCE = 1.001
_ACCELERATION_MARGIN = 1.25
"""Pieces overshoot the true peak of an acceleration at its corners."""


@dataclasses.dataclass(frozen=True)
class JointCurve:
    """Path of the joints as cubic pieces between knots, from rest to rest.

    Angles and rates are those of the program, rounded as they are sent: what is checked is what the
    controller evaluates.

    Attributes:
        times: Times of the knots, the first 0 [s], shape [knot].
        q: Joint angles at the knots [rad], shape [knot, 6].
        qd: Joint rates at the knots, zero at both ends [rad/s], shape [knot, 6].
    """

    times: Array
    q: Array
    qd: Array

    def __post_init__(self):
        shape = (len(self.times), 6)
        spans = np.diff(self.times) / _KNOT_DT
        if len(spans) < 1 or self.q.shape != shape or self.qd.shape != shape:
            raise InputError(
                f"a curve has shapes times {self.times.shape}, q {self.q.shape}, qd "
                f"{self.qd.shape}, not [knot], [knot, 6], [knot, 6]"
            )
        if not (np.isfinite(self.q).all() and np.isfinite(self.qd).all()):
            raise InputError("the path of a motion must be finite")
        if np.any(spans < 0.5) or np.any(abs(spans - spans.round()) > 1e-6):
            raise InputError(f"pieces of a motion must last whole multiples of {_KNOT_DT:g} s")
        if np.any(self.qd[[0, -1]] != 0.0):
            raise InputError("a motion must start and end at rest")
        object.__setattr__(self, "q", self.q.round(_DECIMALS_Q))
        object.__setattr__(self, "qd", self.qd.round(_DECIMALS_QD))

    @classmethod
    def fit(cls, path: JointPath) -> "JointCurve":
        """Fit a curve to set points at even times, with as few pieces as `FIT_TOLERANCE` allows.

        Raises:
            InputError: The set points are at times that no controller has.
        """
        dt = float(path.times[1] - path.times[0]) if len(path.times) > 1 else 0.0
        stride = round(_KNOT_DT / dt) if dt > 0.0 else 0
        if abs(stride * dt - _KNOT_DT) > 1e-9 or stride < 1:
            raise InputError(
                f"control_dt = {dt:g} s of a robot must divide {_KNOT_DT:g} s, as 0.002 s does"
            )
        if not np.allclose(np.diff(path.times), dt, rtol=0.0, atol=1e-9):
            raise InputError("the set points of a robot must come at even times")
        # Held at its end until the next knot.
        pad = ((0, -(len(path.q) - 1) % stride), (0, 0))
        q, qd = np.pad(path.q, pad, "edge"), np.pad(path.qd, pad)
        qd[[0, -1]] = 0.0
        whole = cls(np.arange(0, len(q), stride, dtype=np.float64) * dt, q[::stride], qd[::stride])
        knots, last = [0], len(whole.times) - 1
        while knots[-1] < last:
            end = knots[-1] + 1
            while end < last:
                piece = [knots[-1], end + 1]
                meant = q[piece[0] * stride : piece[1] * stride + 1]
                times = whole.times[piece[0]] + np.arange(len(meant)) * dt
                if np.abs(whole._spline(piece)(times) - meant).max() > FIT_TOLERANCE:
                    break
                end += 1
            knots.append(end)
        return cls(whole.times[knots], whole.q[knots], whole.qd[knots])

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return float(self.times[-1])

    def evaluate(self, times: ArrayLike) -> Array:
        """Return joint angles [rad], shape [time, 6], held before the start and after the end."""
        return self._spline(slice(None))(np.clip(times, 0.0, self.duration))

    def slowed(self, factor: int) -> "JointCurve":
        """Return the same way in a whole multiple of its time."""
        return JointCurve(self.times * factor, self.q, self.qd / factor)

    def _spline(self, knots: slice | list[int]) -> Callable[[Array], Array]:
        """Return the pieces between some of the knots, as a function of time."""
        from scipy.interpolate import CubicHermiteSpline

        return CubicHermiteSpline(self.times[knots], self.q[knots], self.qd[knots])


def joint_move(start: Array, end: Array, speed: float) -> JointCurve:
    """Return a straight way in joint space, from rest to rest.

    Args:
        start: Joint angles at its start [rad], shape [6].
        end: Joint angles at its end [rad], shape [6].
        speed: Largest speed of a joint [rad/s].
    """
    distance = float(np.abs(end - start).max())
    duration = max(1.875 * distance / speed, 4 * _KNOT_DT)
    count = int(np.ceil(duration / _KNOT_DT))
    u = np.linspace(0.0, 1.0, count + 1)[:, None]
    times = np.arange(count + 1, dtype=np.float64) * _KNOT_DT
    q = start + u**3 * (10 - 15 * u + 6 * u * u) * (end - start)
    qd = 30 * u**2 * (1 - u) ** 2 * (end - start) / times[-1]
    return JointCurve.fit(JointPath(times=times, q=q, qd=qd))


def check_path(curve: JointCurve, setup: Setup, what: str) -> None:
    """Refuse a path that leaves limits or box, or comes too close to anything.

    Args:
        curve: The path as it is sent.
        setup: Arm with its limits, and the robot section with box, margins and obstacles.
        what: Name of the motion in the error.

    Raises:
        JointLimitError: A limit, the box or a distance is violated; names the value and the bound.
        InputError: The set-up has no robot.
    """
    robot, limits = setup.robot, setup.arm.limits
    if robot is None:
        raise InputError("the lab file has no robot section: --rig ur needs one")
    q = curve.evaluate(np.arange(round(curve.duration / _CHECK_DT) + 1) * _CHECK_DT)
    position, middle = np.array(limits.position) - robot.position_margin, np.array(limits.middle)
    qd = np.diff(q, axis=0) / _CHECK_DT
    qdd = np.diff(qd, axis=0, prepend=0.0, append=0.0) / _CHECK_DT
    for values, bound, name, unit in (
        (q - middle, position, "off the middle of its range by" if middle.any() else "at", "rad"),
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


def hold_time(robot: RobotConfig) -> float:
    """Return the time for which the arm holds its place before a motion [s]."""
    return max(HOLD_TIME, robot.watchdog + _HOLD_MARGIN)


def motion_program(name: str, curve: JointCurve, robot: RobotConfig, number: int) -> str:
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
        f"  go({span:.1f}, {_row(q, _DECIMALS_Q)}, {_row(qd, _DECIMALS_QD)})"
        for span, q, qd in zip(spans, curve.q[1:], curve.qd[1:], strict=True)
    ]
    text = _PROGRAM.format(
        name=name,
        start=_row(curve.q[0], _DECIMALS_Q),
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


def _row(values: Array, decimals: int) -> str:
    return "[" + ",".join(f"{value:.{decimals}f}" for value in values) + "]"
