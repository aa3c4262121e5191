"""A picture of one episode from above: table, robot, target, and where the casts landed."""

import numpy as np
from numpy.typing import NDArray

from cablecast.conventions import Array
from cablecast.workspace import Workspace

SCALE = 250.0
"""Pixels of a metre."""
MARGIN = 0.15
"""Width of what is shown around the table [m]."""
FLOOR, TABLE, ROBOT = (120, 120, 120), (235, 232, 225), (60, 60, 60)
TARGET, LANDING, EARLIER = (213, 94, 0), (0, 114, 178), (150, 190, 220)
RING, DOT = 0.05, 0.02
"""Radius of the target's ring, and of a landing [m]."""


def picture(workspace: Workspace, target_xy: Array, landings_xy: Array) -> NDArray[np.uint8]:
    """Return the picture, shape [row, column, 3]; the robot's right is on the right.

    Args:
        workspace: Table and reach.
        target_xy: Target [m], shape [2].
        landings_xy: Landings of the casts at it [m], the latest first, NaN where there is none,
            shape [cast, 2].
    """
    half, far = workspace.half_width, workspace.y_max
    columns = np.arange(-half - MARGIN, half + MARGIN, 1.0 / SCALE)
    # The robot is shown, too, where the table begins in front of it.
    rows = np.arange(far + MARGIN, min(workspace.y_min, 0.0) - MARGIN, -1.0 / SCALE)
    x, y = np.meshgrid(columns, rows)

    def distance(point: Array) -> Array:
        return np.hypot(x - point[0], y - point[1])

    image = np.empty((*x.shape, 3), dtype=np.uint8)
    image[...] = FLOOR
    image[(np.abs(x) <= half) & (y >= workspace.y_min) & (y <= far)] = TABLE
    image[distance(np.zeros(2)) <= RING] = ROBOT
    ring = np.abs(distance(target_xy) - RING) <= 0.3 * DOT
    image[ring | (distance(target_xy) <= 0.3 * DOT)] = TARGET
    for number, landing in reversed(list(enumerate(landings_xy))):
        image[distance(landing) <= DOT] = EARLIER if number else LANDING
    return image
