"""Things that move before the virtual camera: cable, attachment, marker, arm and its shadow."""

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.shape import ArmShape, arm_shape, sight_clearance
from cablecast.arm.ur import ArmUR
from cablecast.cable import Attachment, Cable
from cablecast.camera.lens import CameraView
from cablecast.errors import InputError
from cablecast.motion.trajectory import JointPath, joints_at
from cablecast.rigs.virtual.camera_config import CameraConfig
from cablecast.vision.tags import load_cv2
from cablecast.vision.tracker import MarkerConfig

Image = NDArray[np.uint8]

LAMP = (-0.7, 0.9, 2.8)
"""Place of the lamp that throws the arm's shadow [m]."""
_SHADOW = 0.32
"""Share of the light that the arm keeps from what lies in its shadow."""
_PENUMBRA = 0.02
"""Half the width of the shadow's soft edge [m]."""
_SUBFRAME_MOVE = 1.5
"""Way of a moving thing between two drawings of it [px]."""
_SUBFRAME_MAX = 24
_SHIFT = 4
"""Fractional bits of coordinates for drawing."""
_BELOW_Z = -0.004
"""Height below which parts of the cable hang beside the table [m]."""

_MARKER_BGR = (62, 178, 58)
_MARKER_LIGHT_BGR = (78, 196, 72)
_CABLE_BGR = {"cable_1": (58, 84, 176), "cable_2": (52, 46, 44), "cable_3": (140, 132, 128)}
_OTHER_CABLE_BGR = (120, 70, 40)
_METAL_BGR = (96, 94, 92)
_ROD_BGR = (
    (70, 68, 66),
    (150, 148, 146),
    (176, 172, 168),
    (182, 180, 178),
    (170, 128, 96),
    (182, 180, 178),
    (174, 170, 166),
    (168, 126, 94),
    (160, 158, 156),
    (52, 50, 50),
    (34, 34, 36),
)
_COS, _SIN = (f(2 * np.pi * np.arange(20) / 20) for f in (np.cos, np.sin))


@dataclasses.dataclass(frozen=True, kw_only=True)
class FilmedTrial:
    """Motion of cable and arm before the camera.

    Attributes:
        cable: Gives thickness and attachment.
        times: Times at which the cable's shape is known, close enough together for a smooth curve
            between them [s], shape [time].
        nodes: Cable from grip to endpoint, base frame [m], shape [time, node, 3].
        joint_path: Joints as they really moved; None for a table without an arm.
        arm: Arm whose joints these are.
    """

    cable: Cable
    times: NDArray[np.float64]
    nodes: NDArray[np.float64]
    joint_path: JointPath | None
    arm: ArmUR = dataclasses.field(default_factory=ArmUR)

    def __post_init__(self):
        if self.nodes.shape[0] != len(self.times) or self.nodes.shape[2:] != (3,):
            raise InputError(
                f"nodes have shape {self.nodes.shape}: {len(self.times)} times ask for "
                "[time, node, 3]"
            )
        if len(self.times) > 2 and float(np.max(np.diff(self.times))) > 0.025:
            raise InputError(
                f"cable shapes every {float(np.max(np.diff(self.times))):.3f} s are too far apart "
                "to film: at most 0.025 s"
            )

    def shape_at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the cable at some times, held before the first and after the last.

        Args:
            times: Times [s], shape [time].

        Returns:
            Nodes [m], shape [time, node, 3].
        """
        if len(self.times) == 1:
            return np.repeat(self.nodes, len(times), axis=0)
        clipped = np.clip(times, self.times[0], self.times[-1])
        # Four neighbours tell a cubic through the two in the middle; a spline over the whole trial
        # would be solved anew for every frame.
        last = len(self.times) - 1
        right = np.clip(np.searchsorted(self.times, clipped, side="right"), 1, last)
        index = np.clip(np.arange(-2, 2) + right[:, None], 0, last)
        t = self.times[index]
        p = self.nodes[index]
        h = t[:, 2] - t[:, 1]
        s = ((clipped - t[:, 1]) / h)[:, None, None]
        before = np.maximum(t[:, 2] - t[:, 0], 1e-12)[:, None, None]
        after = np.maximum(t[:, 3] - t[:, 1], 1e-12)[:, None, None]
        m1 = (p[:, 2] - p[:, 0]) / before * h[:, None, None]
        m2 = (p[:, 3] - p[:, 1]) / after * h[:, None, None]
        return (
            (1 + 2 * s) * (1 - s) ** 2 * p[:, 1]
            + s * (1 - s) ** 2 * m1
            + s * s * (3 - 2 * s) * p[:, 2]
            + s * s * (s - 1) * m2
        )


class Drawing:
    """Everything that moves in one frame, projected for each instant of its exposure.

    Args:
        config: Settings of the camera.
        view: True camera.
        shade: Share of the light that reaches each pixel [-], shape [v, u].
        trial: Motion of cable and arm.
        marker: Size of the marker.
        time: Middle of the exposure [s].
    """

    def __init__(
        self,
        config: CameraConfig,
        view: CameraView,
        shade: NDArray[np.float32],
        trial: FilmedTrial,
        marker: MarkerConfig,
        time: float,
    ):
        exposure = config.exposure
        ends = np.array([time - exposure / 2, time, time + exposure / 2])
        shapes = trial.shape_at(ends)
        moved = np.linalg.norm(np.diff(view.to_image(shapes), axis=0), axis=-1).sum(axis=0)
        count = int(np.clip(np.ceil(np.max(moved) / _SUBFRAME_MOVE), 1, _SUBFRAME_MAX))
        self.times = time + exposure * ((np.arange(count) + 0.5) / count - 0.5)
        shapes = _spline_matrix(shapes.shape[1]) @ trial.shape_at(self.times)
        self.z = shapes[..., 2]
        self.cable = view.to_image(shapes)
        middle = self.cable[count // 2, -1]
        scale = config.focal / (view.position[2] - self.z[count // 2, -1])
        self.cable_px = max(trial.cable.diameter * scale, 1.0)
        tip = shapes[:, -1]
        along = tip - shapes[:, -3]
        along /= np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
        self.marker = view.to_image(_capsule_outline(tip, along, marker))
        self.hook = view.to_image(_attachment_outline(trial.cable, tip, along, marker))
        self.rods: list[NDArray[np.float64]] = []
        self.shadow: list[NDArray[np.float64]] = []
        light = self._light_at(shade, middle)
        if trial.joint_path is not None:
            shape = arm_shape(joints_at(trial.joint_path, self.times), trial.arm)
            self.order = np.argsort(shape.ends[0, :, :, 2].mean(axis=-1))
            self.rods = _rod_outlines(shape, view)
            self.shadow = [view.to_image(rod) for rod in _shadow_outlines(shape, count // 2)]
            clearance = sight_clearance(tip[count // 2][None], LAMP, _instant(shape, count // 2))
            covered = float(np.clip(0.5 - clearance[0] / (2 * _PENUMBRA), 0.0, 1.0))
            light *= 1.0 - _SHADOW * covered
        self.light = light
        self.cable_bgr = _CABLE_BGR.get(trial.cable.name, _OTHER_CABLE_BGR)
        self.magnet = trial.cable.attachment is Attachment.MAGNET

    @staticmethod
    def _light_at(shade: NDArray[np.float32], pixel: NDArray[np.float64]) -> float:
        """Return the share of the light that reaches a pixel [-]."""
        if not np.all(np.isfinite(pixel)):
            return 1.0
        u = int(np.clip(round(float(pixel[0])), 0, shade.shape[1] - 1))
        v = int(np.clip(round(float(pixel[1])), 0, shade.shape[0] - 1))
        return float(shade[v, u])

    def paint(self, canvas: Image, corner: tuple[int, int], on_table: NDArray[np.bool_]) -> None:
        """Draw into a piece of the background.

        Args:
            canvas: Piece of the background, changed in place, shape [v, u, 3].
            corner: Left and top of the piece [px].
            on_table: Whether each of its pixels shows the table's surface, shape [v, u].
        """
        cv2 = load_cv2()
        height, width = canvas.shape[:2]
        if self.shadow:
            mask = np.zeros((height, width), np.uint8)
            for outline in self.shadow:
                _fill(mask, outline, corner, 255)
            if mask.any():
                mask = cv2.blur(mask, (15, 15), borderType=cv2.BORDER_REPLICATE)
                dimmed = 1.0 - _SHADOW * mask.astype(np.float32) / 255
                canvas[:] = (canvas * dimmed[..., None]).astype(np.uint8)
        everything = [self.cable.reshape(-1, 2), self.marker.reshape(-1, 2)]
        everything += [self.hook.reshape(-1, 2)] + [rod.reshape(-1, 2) for rod in self.rods]
        points = np.concatenate(everything)
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            return
        margin = 4 + int(np.ceil(self.cable_px))
        low = np.floor(points.min(axis=0)).astype(int) - margin - corner
        high = np.ceil(points.max(axis=0)).astype(int) + margin + 1 - corner
        left, top = np.maximum(low, 0)
        right, bottom = min(int(high[0]), width), min(int(high[1]), height)
        if left >= right or top >= bottom:
            return
        region = canvas[top:bottom, left:right]
        table = on_table[top:bottom, left:right]
        place = (corner[0] + int(left), corner[1] + int(top))
        if len(self.times) == 1:
            region[:] = self._instant(region.copy(), place, table, 0)
            return
        total = np.zeros(region.shape, np.float32)
        for index in range(len(self.times)):
            cv2.accumulate(self._instant(region.copy(), place, table, index), total)
        region[:] = np.round(total / len(self.times)).astype(np.uint8)

    def _instant(
        self, image: Image, corner: tuple[int, int], on_table: NDArray[np.bool_], index: int
    ) -> Image:
        """Draw one instant of the exposure into a piece."""
        z = self.z[index]
        below = z < _BELOW_Z
        if below.any():
            hidden = image.copy()
            self._draw_cable(hidden, corner, index, slice(None))
            if below[-1]:
                self._draw_end(hidden, corner, index)
            image[~on_table] = hidden[~on_table]
            first = int(np.argmax(below))
            self._draw_cable(image, corner, index, slice(0, max(first, 1)))
            if not below[-1]:
                last = len(z) - int(np.argmax(below[::-1]))
                self._draw_cable(image, corner, index, slice(last, None))
                self._draw_end(image, corner, index)
        else:
            self._draw_cable(image, corner, index, slice(None))
            self._draw_end(image, corner, index)
        if self.rods:
            for rod in self.order:
                outline, ridge, gloss = self.rods[rod][index]
                colour = np.array(_ROD_BGR[rod], dtype=float)
                _fill(image, outline, corner, (0.62 * colour).tolist())
                _fill(image, ridge, corner, (0.9 * colour).tolist())
                _fill(image, gloss, corner, np.minimum(1.14 * colour, 255).tolist())
        return image

    def _draw_cable(self, image: Image, corner: tuple[int, int], index: int, part: slice) -> None:
        """Draw a part of the cable."""
        cv2 = load_cv2()
        path = self.cable[index, part]
        if len(path) < 2 or not np.isfinite(path).all():
            return
        line = [_fixed(path, corner)]
        colour = np.array(self.cable_bgr) * self.light
        thickness = max(round(self.cable_px), 1)
        cv2.polylines(image, line, False, (0.75 * colour).tolist(), thickness, cv2.LINE_AA, _SHIFT)
        if thickness >= 4:
            inner = max(thickness // 2, 1)
            light = np.minimum(1.15 * colour, 255).tolist()
            cv2.polylines(image, line, False, light, inner, cv2.LINE_AA, _SHIFT)

    def _draw_end(self, image: Image, corner: tuple[int, int], index: int) -> None:
        """Draw the attachment and the marker."""
        cv2 = load_cv2()
        hook = self.hook[index]
        if len(hook) and np.isfinite(hook).all():
            colour = (np.array(_METAL_BGR) * self.light).tolist()
            if self.magnet:
                _fill(image, hook, corner, colour)
            else:
                line = [_fixed(hook, corner)]
                cv2.polylines(image, line, False, colour, 3, cv2.LINE_AA, _SHIFT)
        outline = self.marker[index]
        _fill(image, outline, corner, (np.array(_MARKER_BGR) * self.light).tolist())
        inner = outline.mean(axis=0) + 0.5 * (outline - outline.mean(axis=0))
        _fill(image, inner, corner, (np.array(_MARKER_LIGHT_BGR) * self.light).tolist())


def _fixed(points: NDArray[np.float64], corner: tuple[int, int]) -> NDArray[np.int32]:
    """Return pixels as OpenCV takes them with fractional bits."""
    return np.round((points - corner) * (1 << _SHIFT)).astype(np.int32)


def _fill(image: Image, outline: NDArray[np.float64], corner: tuple[int, int], colour) -> None:
    """Fill the convex hull of some points."""
    if not np.isfinite(outline).all():
        return
    cv2 = load_cv2()
    hull = cv2.convexHull(_fixed(outline, corner))
    cv2.fillConvexPoly(image, hull, colour, cv2.LINE_AA, _SHIFT)


def _instant(shape: ArmShape, index: int) -> ArmShape:
    """Return the arm at one instant."""
    return ArmShape(ends=shape.ends[index : index + 1], radii=shape.radii)


def _capsule_outline(
    tip: NDArray[np.float64], along: NDArray[np.float64], marker: MarkerConfig
) -> NDArray[np.float64]:
    """Return the outline of the marker about the endpoint [m], shape [time, point, 3]."""
    radius = marker.width / 2
    half = max(marker.length / 2 - radius, 0.0)
    across = _level_across(along)
    forward = np.stack([across[:, 1], -across[:, 0], np.zeros(len(along))], axis=-1)
    circle = radius * (_COS[:, None] * forward[:, None] + _SIN[:, None] * across[:, None])
    ends = [(tip + sign * half * along)[:, None] + circle for sign in (-1.0, 1.0)]
    return np.concatenate(ends, axis=1)


def _attachment_outline(
    cable: Cable, tip: NDArray[np.float64], along: NDArray[np.float64], marker: MarkerConfig
) -> NDArray[np.float64]:
    """Return the line of the hook or the outline of the magnet [m], shape [time, point, 3]."""
    length = cable.attachment_length
    if cable.attachment is Attachment.NONE or length <= 0:
        return np.empty((len(tip), 0, 3))
    across = _level_across(along)
    if cable.attachment is Attachment.MAGNET:
        centre = tip + (marker.length / 2 + length / 2) * along
        forward = np.stack([across[:, 1], -across[:, 0], np.zeros(len(along))], axis=-1)
        circle = _COS[:, None] * forward[:, None] + _SIN[:, None] * across[:, None]
        return centre[:, None] + 0.011 * circle
    bend = 0.22 * length
    angle = np.linspace(-np.pi / 2, 0.75 * np.pi, 12)
    stem = length - bend
    local_along = np.concatenate([[0.0, stem], stem + bend * np.cos(angle)])
    local_across = np.concatenate([[0.0, -bend], bend * np.sin(angle)])
    return (
        tip[:, None]
        + local_along[:, None] * along[:, None]
        + local_across[:, None] * across[:, None]
    )


def _level_across(along: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return level unit vectors to the left of some directions."""
    across = np.stack([-along[:, 1], along[:, 0], np.zeros(len(along))], axis=-1)
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    return np.where(length > 1e-6, across / np.maximum(length, 1e-9), [1.0, 0.0, 0.0])


def _rod_outlines(shape: ArmShape, view: CameraView) -> list[NDArray[np.float64]]:
    """Return silhouette, ridge and gloss of every rod [px], each shape [time, 3, point, 2]."""
    towards = np.asarray(view.position) - shape.ends
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    # Any two axes across the line of sight span the disc that a ball's silhouette is.
    side = np.cross(towards, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    up = np.cross(side, towards)
    circle = _COS[:, None] * side[..., None, :] + _SIN[:, None] * up[..., None, :]
    # Lamp light falls on the upper left of each rod.
    gleam = np.array([-0.35, 0.12, 0.0])
    outlines = []
    for rod, radius in enumerate(shape.radii):
        centres = shape.ends[:, rod, :, None, :]
        layers = [
            centres + radius * circle[:, rod],
            centres + radius * (0.74 * circle[:, rod] + 0.25 * gleam),
            centres + radius * (0.34 * circle[:, rod] + gleam),
        ]
        points = np.stack([layer.reshape(len(centres), -1, 3) for layer in layers], axis=1)
        outlines.append(view.to_image(points))
    return outlines


def _shadow_outlines(shape: ArmShape, index: int) -> list[NDArray[np.float64]]:
    """Return the outline of each rod's shadow on the table [m], each shape [point, 3]."""
    lamp = np.asarray(LAMP)
    shadows = []
    for (start, end), radius in zip(shape.ends[index], shape.radii, strict=True):
        points = []
        for centre in (start, end):
            scale = lamp[2] / (lamp[2] - centre[2])
            place = lamp + scale * (centre - lamp)
            circle = np.stack([_COS, _SIN, np.zeros(len(_COS))], axis=-1)
            points.append(place + scale * radius * circle)
        shadows.append(np.concatenate(points))
    return shadows


@functools.lru_cache(maxsize=8)
def _spline_matrix(node_count: int) -> NDArray[np.float64]:
    """Return weights that put three points between neighbouring nodes of a smooth curve."""
    if node_count < 4:
        return np.eye(node_count)
    from scipy.interpolate import CubicSpline

    index = np.arange(node_count)
    fine = np.linspace(0, node_count - 1, 4 * (node_count - 1) + 1)
    return CubicSpline(index, np.eye(node_count))(fine)
