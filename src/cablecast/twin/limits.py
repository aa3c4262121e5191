"""Limits that the twin's controller checks on its own, whatever the program says.

They stand for the safety system of a real controller. Nothing here is shared with the checks that a
rig makes before it sends a program: both must agree for an arm to move.
"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.limits import JOINT_NAMES
from cablecast.setup import Setup

# The maker's data sheets: all joints turn by 360 deg either way. A controller tolerates a little
# more before it stops.
_POSITION_MAX = np.radians(363.0)
_SPEEDS_MAX_DEG = {
    "ur3": (180.0, 180.0, 180.0, 360.0, 360.0, 360.0),
    "ur5": (180.0, 180.0, 180.0, 180.0, 180.0, 180.0),
    "ur10": (120.0, 120.0, 180.0, 180.0, 180.0, 180.0),
}
"""Largest speed of each joint by the size of the arm, of both series [deg/s]."""
_SPEED_TOLERANCE_DEG = 11.0
# A jump of a set point that no motor could follow stops a real arm as well.
_ACCELERATION_MAX = 45.0
_WINDOW = 0.032
"""Time over which rates are measured [s]: servoj smooths its set points over as much, so that one
which comes a cycle late is no jump."""
_TABLE_MARGIN = 0.0


@dataclasses.dataclass
class TwinLimits:
    """Limits of set points, checked one after another.

    Args:
        setup: Arm, table and box; the box of its robot section is the controller's safety planes.
        dt: Control cycle [s].
    """

    setup: Setup
    dt: float

    def __post_init__(self):
        self._window = round(_WINDOW / self.dt)
        size = self.setup.arm.model.removesuffix("e")
        self._speed_max = np.radians(np.array(_SPEEDS_MAX_DEG[size]) + _SPEED_TOLERANCE_DEG)
        self._past: list[NDArray[np.float64]] = []

    def forget(self) -> None:
        """Begin anew: the next set point follows none."""
        self._past = []

    def violation(self, q: NDArray[np.float64]) -> str | None:
        """Return what is wrong with the next set point, or None.

        Args:
            q: Set point one cycle after the one before [rad], shape [6].
        """
        if q.shape != (6,) or not np.all(np.isfinite(q)):
            return "a set point is not six finite angles"
        joint = int(np.argmax(np.abs(q)))
        if abs(q[joint]) > _POSITION_MAX:
            return f"{JOINT_NAMES[joint]} at {q[joint]:.3f} rad is beyond its limit of position"
        count = self._window
        self._past = [*self._past, q.copy()][-2 * count - 1 :]
        if len(self._past) > count:
            rate = (q - self._past[-1 - count]) / (count * self.dt)
            joint = int(np.argmax(np.abs(rate) / self._speed_max))
            if abs(rate[joint]) > self._speed_max[joint]:
                return f"{JOINT_NAMES[joint]} at {rate[joint]:.2f} rad/s is beyond its speed"
        if len(self._past) > 2 * count:
            before = (self._past[-1 - count] - self._past[0]) / (count * self.dt)
            change = (rate - before) / (count * self.dt)
            joint = int(np.argmax(np.abs(change)))
            if abs(change[joint]) > _ACCELERATION_MAX:
                return (
                    f"{JOINT_NAMES[joint]} at {change[joint]:.0f} rad/s2 is beyond its acceleration"
                )
        return self._outside(q)

    def _outside(self, q: NDArray[np.float64]) -> str | None:
        arm = self.setup.arm
        grip, flange = arm.grip_pose(q)[:3], arm.forward(q)[:3, 3]
        for name, place in (("the grip", grip), ("the flange", flange)):
            if place[2] < _TABLE_MARGIN:
                return f"{name} would be {-place[2]:.3f} m below the table"
            robot = self.setup.robot
            if robot is None:
                continue
            low, high = np.asarray(robot.box_low), np.asarray(robot.box_high)
            # A thousandth of a metre of tolerance, as safety planes have.
            if np.any(place < low - 1e-3) or np.any(place > high + 1e-3):
                return f"{name} at {place.round(3).tolist()} m would be outside the safety planes"
        return None
