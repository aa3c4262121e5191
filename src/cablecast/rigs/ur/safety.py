"""Reading the controller's state: whether the arm may move, and what a person has to do if not."""

import numpy as np

from cablecast.arm.robot import RobotConfig
from cablecast.errors import RigError
from cablecast.rigs.ur.link import Report, UrLink

ROBOT_RUNNING = 7
NORMAL_BIT, REDUCED_BIT = 0, 1
_STOP_WORDS = {
    2: "protective stop",
    3: "recovery mode",
    4: "safeguard stop",
    5: "emergency stop of the system",
    6: "emergency stop of the robot",
    7: "emergency stop",
    8: "safety violation",
    9: "fault",
    10: "stop for safety",
}
_ADVICE = {
    2: "look what the arm touched or which limit it met, make the way free, and enable the robot "
    "on the pendant",
    3: "move the arm back within its limits by hand, as the pendant says",
    4: "step out of the guarded space and reset the safeguard",
    5: "find out why, release the button, and start the robot on the pendant",
    6: "find out why, release the button, and start the robot on the pendant",
    7: "find out why, release the button, and start the robot on the pendant",
}
RESUME = "cablecast never clears a stop; the same command resumes with this trial"
PAYLOAD_TOLERANCE = 0.05
"""Largest difference between the payload of the lab file and that on the controller [kg]."""
CENTER_TOLERANCE = 0.02
"""Largest distance between the centre of the payload in the lab file and on the controller [m]."""
SPEED_TOLERANCE = 1e-3


def stop_text(bits: int) -> str | None:
    """Return what stopped the arm for safety, and what to do; None where nothing did.

    Args:
        bits: Safety status bits of RTDE.
    """
    for bit in (7, 6, 5, 2, 3, 4, 8, 9, 10):
        if bits >> bit & 1:
            advice = _ADVICE.get(bit, "read the pendant's log and clear the cause")
            return f"{_STOP_WORDS[bit]}: {advice}. {RESUME}"
    if not bits >> NORMAL_BIT & 1:
        return f"the safety system is not in its normal mode: read the pendant's log. {RESUME}"
    return None


def check_ready(link: UrLink, robot: RobotConfig) -> Report:
    """Refuse to move unless the controller is ready for it, and return its newest report.

    Args:
        link: Connection to the controller.
        robot: Payload that must be set.

    Raises:
        RigError: It is not; says what a person has to do.
    """
    report = link.wait_for_report()
    if text := stop_text(report.safety_bits):
        raise RigError(text)
    if report.robot_mode != ROBOT_RUNNING:
        raise RigError(
            f"the robot is in mode {report.robot_mode}, not running: power it on and release its "
            "brakes on the pendant"
        )
    if link.ask("polyscopeVersion").strip()[:1] >= "5" and link.ask("isInRemoteControl") != "True":
        raise RigError("the robot is in local control: switch the pendant to remote control")
    if abs(report.speed_scaling - 1.0) > SPEED_TOLERANCE:
        raise RigError(
            f"the speed slider of the pendant is at {100 * report.speed_scaling:.0f} %: set it to "
            "100 %, or casts land elsewhere"
        )
    if abs(report.payload - robot.payload_mass) > PAYLOAD_TOLERANCE:
        raise RigError(
            f"the payload on the controller is {report.payload:.2f} kg, that of the lab file "
            f"{robot.payload_mass:.2f} kg: weigh gripper and cable, and set both alike"
        )
    center = report.payload_cog
    if center is not None and np.linalg.norm(center - robot.payload_cog) > CENTER_TOLERANCE:
        raise RigError(
            f"the payload's centre on the controller is at {center.round(3).tolist()} m, that of "
            f"the lab file at {list(robot.payload_cog)} m: measure it, and set both alike"
        )
    return report
