"""Motions of a grip from rest to rest."""

import numpy as np

from cablecast.motion.grip_path import GripPath


def smooth(share):
    """Return a path from 0 to 1 with the share of its time, at rest at both ends."""
    share = np.clip(share, 0.0, 1.0)
    return share**3 * (10.0 - 15.0 * share + 6.0 * share**2)


def sweep(angle: float, duration: float = 0.5) -> GripPath:
    """Return a sideways swing of the grip about the robot's axis, just above the table."""
    times = np.linspace(0.0, duration, 30)
    theta = angle * smooth(times / duration)
    poses = np.zeros((30, 5))
    poses[:, 0] = 0.6 * np.sin(theta)
    poses[:, 1] = 0.6 * np.cos(theta)
    poses[:, 2] = 0.02
    poses[:, 3] = theta
    return GripPath.fit(times, poses)
