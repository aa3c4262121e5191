"""The robot of a lab, whose box holds the reach of a UR5 in front of it."""

from cablecast.rigs.ur.config import RobotUR

ROBOT = RobotUR(
    address="127.0.0.1",
    payload_mass=0.95,
    payload_cog=(0.0, 0.0, 0.06),
    box_low=(-0.97, 0.05, 0.0),
    box_high=(0.97, 0.97, 1.1),
)
