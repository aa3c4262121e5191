"""Whether the jaws still hold the cable after a cast, by what the camera sees ahead of them.

Before the cast the cable lies straight ahead of the jaws, which shows how it differs from what is
beside it. After the cast it leaves the jaws in the direction in which they hold it, and bends no
sharper than it can: it crosses each of some arcs about them. Where the arm hides these, the jaws
are turned until it does not: a cable that they hold turns with them.
"""

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm
from cablecast.arm.shape import arm_shape, sight_clearance
from cablecast.camera.lens import CameraView
from cablecast.conventions import Array
from cablecast.errors import CablecastError
from cablecast.vision.tags import load_cv2

Image = NDArray[np.uint8]

_RADII = np.arange(0.04, 0.091, 0.005)
"""Radii of the arcs about the grip [m]."""
_ANGLES = np.radians(np.arange(-90.0, 91.0, 2.0))
"""Directions of the places on an arc, from that in which the jaws hold the cable [rad]."""
_BEND = 0.06
"""Smallest radius to which a cable bends at the jaws [m]."""
_AHEAD = np.radians(4.0)
"""Directions in which a cable that lies straight is seen [rad]."""
_FREE, _FREE_MIN = 0.01, 0.9
"""Distance of a line of sight from the arm's surface from which on a place is in sight [m], and
least share of the places which the cable may cross that must be."""
_TURN = np.radians(15.0)
"""Step by which the jaws are turned towards the camera [rad]."""
_THIN = 0.035
"""Width of what is too wide to be a cable, such as the hand and its shadow [m]."""
_LIKE, _CONTRAST_MIN = 0.4, 12.0
"""Share of the cable's own contrast from which on a place shows it, and contrast, of 255, below
which the cable does not differ from the table."""
_CROSSED_MIN = 0.3
"""Least share of the arcs that a held cable crosses."""


def turned_into_sight(q: Array, arm: Arm, view: CameraView) -> Array | None:
    """Return the joints that turn the jaws in their place until what is ahead of them is in sight.

    None where no turn does.

    Args:
        q: Joints of the standing arm [rad], shape [joint].
        arm: Arm, its mounting and its gripper.
        view: Calibrated camera.
    """
    pose = arm.standing_pose(q)
    x, y, _ = np.asarray(view.position) - pose[:3]
    whole = float(np.arctan2(x, y) - pose[3])
    for turn in np.linspace(0.0, whole, max(int(np.ceil(abs(whole) / _TURN)), 1) + 1):
        try:
            turned = arm.inverse(pose + [0.0, 0.0, 0.0, turn, 0.0]) if turn else q
        except CablecastError:
            continue
        if _is_clear(_arcs(turned, arm, view)[1]):
            return turned
    return None


def _is_clear(free: NDArray[np.bool_]) -> bool:
    """Return whether the places that the cable may cross are in sight."""
    reach = np.arcsin(np.minimum(_RADII / (2.0 * _BEND), 1.0))
    return bool(free[np.abs(_ANGLES) <= reach[:, None]].mean() >= _FREE_MIN)


def is_held(images: tuple[Image, Image], q: Array, arm: Arm, view: CameraView) -> bool | None:
    """Return whether the jaws still hold the cable; None where the camera cannot tell.

    Args:
        images: Pictures before and after a cast, BGR, shape [v, u, 3].
        q: Joints of the standing arm at these times [rad], shape [2, joint].
        arm: Arm, its mounting and its gripper.
        view: Calibrated camera.
    """
    (start, _), (end, free) = (_arcs(at, arm, view) for at in q)
    cable = _thin(images[0], start, view)[:, np.abs(_ANGLES) < _AHEAD].mean(axis=(0, 1))
    contrast = float(np.linalg.norm(cable))
    if contrast < _CONTRAST_MIN or not _is_clear(free):
        return None
    # What lay there before the cast is not the cable, but for the cable itself.
    x, y, _, yaw, _ = arm.grip_pose(q[0])
    aside = (end[..., :2] - [x, y]) @ [np.cos(yaw), -np.sin(yaw)]
    before = np.where(np.abs(aside)[..., None] < _THIN, 0.0, _thin(images[0], end, view))
    new = _thin(images[1], end, view) - before
    like = np.where(free, new @ cable / contrast**2, 0.0).max(axis=1)
    return bool((like > _LIKE).mean() > _CROSSED_MIN)


def _arcs(q: Array, arm: Arm, view: CameraView) -> tuple[Array, NDArray[np.bool_]]:
    """Return the places of the arcs [m], shape [arc, place, 3], and which of them are in sight."""
    x, y, height, yaw, _ = arm.grip_pose(q)
    angles = yaw + _ANGLES
    ahead = np.stack([np.sin(angles), np.cos(angles), 0.0 * angles], axis=-1)
    # From the jaws the cable comes down to the table.
    places = np.array([x, y, height / 2]) + _RADII[:, None, None] * ahead
    flat = places.reshape(-1, 3)
    shape = arm_shape(np.repeat(q[None], len(flat), axis=0), arm)
    free = sight_clearance(flat, view.position, shape).reshape(places.shape[:2]) > _FREE
    u, v = np.moveaxis(view.to_image(places), -1, 0)
    return places, free & (u > 0) & (v > 0) & (u < view.lens.width - 1) & (v < view.lens.height - 1)


def _thin(image: Image, places: Array, view: CameraView) -> Array:
    """Return the colours of what is thin at some places, shape [arc, place, 3]; 0 out of sight."""
    cv2, pixels = load_cv2(), view.to_image(places)
    wide = round(_THIN * view.pixels_per_metre(places[0, 0, :2])) // 2 * 2 + 1
    low = np.maximum(np.floor(pixels.min(axis=(0, 1))).astype(int) - wide, 0)
    high = np.ceil(pixels.max(axis=(0, 1))).astype(int) + wide
    piece = np.ascontiguousarray(image[low[1] : high[1], low[0] : high[0]])
    if not piece.size:
        return np.zeros((*places.shape[:2], 3))
    thin = cv2.blur(piece.astype(np.float32) - cv2.medianBlur(piece, wide), (2, 2))
    u, v = np.moveaxis((pixels - low).astype(np.float32), -1, 0)
    return cv2.remap(thin, u, v, cv2.INTER_LINEAR).astype(float)
