"""What the virtual camera sees: the scene that stands still, and what moves before it.

Floor, table, foam boards, tags and clutter are drawn once; cable, attachment, marker, the arm and
its shadow for each instant of an exposure.
"""

import colorsys
import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm
from cablecast.arm.shape import GRIPPER_ROD_COUNT, ArmShape, arm_shape, sight_clearance
from cablecast.arm.ur import ArmUR
from cablecast.cable import Attachment, Cable
from cablecast.camera.lens import CameraView
from cablecast.camera.settings import MARKER_HUE
from cablecast.camera.tags import Tag, TagLayout
from cablecast.conventions import Array
from cablecast.errors import InputError
from cablecast.motion.trajectory import JointPath, joints_at
from cablecast.rigs.virtual.config import CameraConfig, clutter_place
from cablecast.setup import Setup
from cablecast.vision.tags import load_cv2, tag_cells, tag_picture
from cablecast.vision.tracker import MarkerConfig
from cablecast.workspace import Workspace

Image = NDArray[np.uint8]
Points = Sequence[tuple[float, float]]

_TEXEL = 0.001
"""Size of a pixel of the table's texture [m]."""
_BOARD = (0.92, 0.61)
"""Size of a foam board along x and y [m]."""
_FOAM_BGR = (222, 228, 226)
_SEAM_BGR = (150, 156, 158)
_FLOOR_BGR = (92, 98, 108)
_EDGE_BGR = (60, 78, 104)
_PLATE_BGR = (128, 124, 120)
_FLOOR_Z = -0.75
_TAG_ERROR = 0.001
"""Standard deviation of the places where tags are stuck [m]."""
_FALLOFF = 0.25
"""Loss of light from the table's middle to its far corners [-]."""
_LAMP = (-0.7, 0.9, 2.8)
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
"""Height below which parts of the cable hang over the table's edge [m]."""

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
# The last two are the gripper's.
_LINK_SHADES = len(_ROD_BGR) - GRIPPER_ROD_COUNT
_COS, _SIN = (f(2 * np.pi * np.arange(20) / 20) for f in (np.cos, np.sin))
_MARKER = MarkerConfig()


def draw_background(
    view: CameraView, config: CameraConfig, workspace: Workspace, layout: TagLayout, seed: int
) -> tuple[Image, NDArray[np.bool_], NDArray[np.float32]]:
    """Draw the empty scene under even light; the seed is that of tints, scuffs and clutter.

    Returns:
        The picture, BGR, shape [v, u, 3]; which pixels show the table's surface, shape [v, u]; and
        the share of the light that reaches each [-], same shape.
    """
    cv2 = load_cv2()
    rng = np.random.default_rng([seed, 17])
    texture, origin = _table_texture(workspace, layout, rng)
    v, u = np.ogrid[0.0 : config.height, 0.0 : config.width]
    # Undistorting two million pixels is slow; the maps are smooth, so a coarse grid will do.
    table_xy = _smooth_map(view, 0.0, config)
    floor_xy = _smooth_map(view, _FLOOR_Z, config)
    map_x = (table_xy[..., 0] - origin[0]) / _TEXEL
    map_y = (origin[1] - table_xy[..., 1]) / _TEXEL
    maps = (map_x.astype(np.float32), map_y.astype(np.float32))
    image = cv2.remap(texture, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    on_table = workspace.on_table(table_xy)
    image[~on_table] = _floor(floor_xy, ~on_table, rng)
    centre = np.array([config.width, config.height]) / 2
    radius = np.linalg.norm(centre)
    far2 = ((u - centre[0]) / radius) ** 2 + ((v - centre[1]) / radius) ** 2
    # A lamp above the left half of the table, and the lens's own vignetting.
    lamp = (u / config.width - 0.35) ** 2 + (v / config.height - 0.45) ** 2
    shade = (1.0 - _FALLOFF * (0.55 * far2 + 0.75 * lamp)).astype(np.float32)
    shaded = image * shade[..., None]
    return np.clip(shaded, 0, 255, out=shaded).astype(np.uint8), on_table, shade


def _smooth_map(view: CameraView, z: float, config: CameraConfig) -> Array:
    """Return the points of a level plane under every pixel [m], shape [v, u, 2]."""
    from scipy.interpolate import RectBivariateSpline

    us = np.linspace(-1.0, config.width, 61)
    vs = np.linspace(-1.0, config.height, 41)
    grid = view.to_table(np.stack(np.meshgrid(us, vs), axis=-1), z)
    u, v = np.arange(config.width), np.arange(config.height)
    return np.stack(
        [RectBivariateSpline(vs, us, grid[..., axis])(v, u) for axis in (0, 1)], axis=-1
    )


def _floor(xy: Array, seen: NDArray[np.bool_], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return the colours of the floor's tiles at the points xy [m] where it is seen, [pixel, 3]."""
    cv2 = load_cv2()
    place = xy[seen] / 0.5
    tile = np.floor(place).astype(int)
    checker = ((tile[:, 0] * 7 + tile[:, 1] * 13) % 5) * 2.5
    near = np.abs(place - np.round(place)) < 0.012
    grout = near[:, 0] | near[:, 1]
    stains = cv2.resize(
        rng.normal(0, 4, (9, 16)).astype(np.float32),
        (xy.shape[1], xy.shape[0]),
        interpolation=cv2.INTER_CUBIC,
    )[seen]
    image = np.array(_FLOOR_BGR) + (checker + stains - 22.0 * grout)[:, None]
    return np.clip(image, 0, 255).astype(np.uint8)


def _table_texture(
    workspace: Workspace, layout: TagLayout, rng: np.random.Generator
) -> tuple[Image, tuple[float, float]]:
    """Draw the table from straight above, and tell the place of its upper left pixel (x, y) [m]."""
    cv2 = load_cv2()
    columns = round(2 * workspace.half_width / _TEXEL)
    rows = round((workspace.y_max - workspace.y_min) / _TEXEL)
    origin = (-workspace.half_width + _TEXEL / 2, workspace.y_max - _TEXEL / 2)

    def px(x: float, y: float) -> tuple[int, int]:
        return round((x - origin[0]) / _TEXEL), round((origin[1] - y) / _TEXEL)

    texture = _foam(columns, rows, rng)
    cv2.rectangle(texture, (0, 0), (columns - 1, rows - 1), _EDGE_BGR, 9)
    # The robot's mounting plate, as far as it is on this table.
    cv2.rectangle(texture, px(-0.2, 0.2), px(0.2, -0.2), _PLATE_BGR, -1)
    _draw_clutter(texture, px, workspace, rng)
    for tag in layout.tags:
        # Nobody sticks a tag exactly where the plan has it.
        x, y = rng.normal([tag.x, tag.y], _TAG_ERROR)
        placed = dataclasses.replace(tag, x=float(x), y=float(y))
        _paste_tag(texture, origin, placed, layout.family)
    # As fine as a camera pixel sees it.
    return cv2.GaussianBlur(texture, (0, 0), 0.7), origin


def _foam(columns: int, rows: int, rng: np.random.Generator) -> Image:
    """Draw foam boards of slightly different age, laid from the far left corner on."""
    cv2 = load_cv2()
    texture = np.empty((rows, columns, 3), np.uint8)
    step_x, step_y = round(_BOARD[0] / _TEXEL), round(_BOARD[1] / _TEXEL)
    for top in range(0, rows, step_y):
        for left in range(0, columns, step_x):
            tint = np.array(_FOAM_BGR) + rng.normal(0, 3.0) + rng.normal(0, 1.2, 3)
            texture[top : top + step_y, left : left + step_x] = np.clip(tint, 0, 255)
    grain = rng.normal(0, 1.5, (rows // 4 + 1, columns // 4 + 1)).astype(np.float32)
    grain = cv2.resize(grain, (columns, rows), interpolation=cv2.INTER_CUBIC)
    grained = texture + grain[..., None]
    texture = np.clip(grained, 0, 255, out=grained).astype(np.uint8)
    for _ in range(40):
        start = rng.uniform([0, 0], [columns, rows])
        ends = [np.round(p).astype(int).tolist() for p in (start, start + rng.normal(0, 120, 2))]
        shade = (np.array(_FOAM_BGR) - rng.uniform(6, 22)).tolist()
        cv2.line(texture, *ends, shade, int(rng.integers(1, 4)), cv2.LINE_AA)
    for top in range(step_y, rows, step_y):
        cv2.line(texture, (0, top), (columns, top), _SEAM_BGR, 3, cv2.LINE_AA)
    for left in range(step_x, columns, step_x):
        cv2.line(texture, (left, 0), (left, rows), _SEAM_BGR, 3, cv2.LINE_AA)
    return texture


def _paste_tag(texture: Image, origin: tuple[float, float], tag: Tag, family: str) -> None:
    """Stick a printed tag on the table."""
    cv2 = load_cv2()
    cell = 12
    picture = tag_picture(tag.id, cell, family)
    # Within a white rim of one cell. A square's side lies half a pixel beside its pixels' centres.
    near, far = cell - 0.5, (tag_cells(family) + 1) * cell - 0.5
    source = np.array([[near, near], [far, near], [far, far], [near, far]])
    corners = tag.corners[:, :2]
    place = np.stack([corners[:, 0] - origin[0], origin[1] - corners[:, 1]], axis=1) / _TEXEL
    # The rim reaches at most a sixth of the square's side beyond it; more need not be warped.
    reach = 0.25 * tag.size / _TEXEL
    left, top = np.maximum(np.floor(place.min(axis=0) - reach), 0).astype(int)
    right, bottom = np.ceil(place.max(axis=0) + reach).astype(int)
    region = texture[top:bottom, left:right]
    if region.size == 0:
        return
    local = (place - [left, top]).astype(np.float32)
    H = cv2.getPerspectiveTransform(source.astype(np.float32), local)
    shape = (region.shape[1], region.shape[0])
    inside = cv2.warpPerspective(np.full_like(picture, 255), H, shape) > 127
    warped = cv2.warpPerspective(picture, H, shape, borderMode=cv2.BORDER_REPLICATE)
    # Ink is not black and paper not as white as the foam.
    ink = np.clip(warped.astype(np.float32) * 0.82 + 28.0, 0, 255).astype(np.uint8)
    region[inside] = ink[inside, None]


def _draw_clutter(
    texture: Image,
    px: Callable[[float, float], tuple[int, int]],
    workspace: Workspace,
    rng: np.random.Generator,
) -> None:
    """Draw a green cloth, a screwdriver with a green handle, a bottle cap, and a blue box."""
    cv2 = load_cv2()

    def polygon(points: Points, colour: tuple[int, int, int]) -> None:
        corners = np.array([px(x, y) for x, y in points], dtype=np.int32)
        cv2.fillPoly(texture, [corners], colour, cv2.LINE_AA)

    def turned(place: tuple[float, float], angle: float, points: Points) -> Points:
        (x, y), c, s = place, np.cos(angle), np.sin(angle)
        return [(x + c * a - s * b, y + s * a + c * b) for a, b in points]

    scatter = rng.uniform(-0.02, 0.02, 6)
    places = [
        clutter_place(x, y, workspace)
        for x, y in ((-1.08, 0.42), (-1.06, 0.44), (1.16, 0.45), (-0.95, 1.18), (1.05, 1.12))
    ]
    cloth_at, fold_at, driver_at, cap_at, box_at = places
    if not (cloth_at and fold_at and driver_at and cap_at and box_at):
        return
    # A folded cloth at the left edge.
    angle = 0.35 + scatter[0]
    cloth = [(-0.11, -0.08), (0.10, -0.09), (0.12, 0.07), (0.02, 0.10), (-0.12, 0.06)]
    polygon(turned(cloth_at, angle, cloth), (96, 148, 84))
    fold = [(-0.07, -0.02), (0.09, -0.07), (0.11, 0.05)]
    polygon(turned(fold_at, angle, fold), (82, 130, 72))
    for offset in (-0.05, 0.0, 0.05):
        ends = turned(cloth_at, angle, [(-0.1, offset), (0.1, offset * 0.6)])
        cv2.line(texture, px(*ends[0]), px(*ends[1]), (74, 122, 66), 2, cv2.LINE_AA)
    # A screwdriver at the right edge.
    angle = 1.1 + scatter[1]
    blade = [(0.05, -0.003), (0.17, -0.003), (0.17, 0.003), (0.05, 0.003)]
    polygon(turned(driver_at, angle, blade), (150, 148, 146))
    handle = [(-0.05, -0.010), (-0.03, -0.014), (0.05, -0.009), (0.05, 0.009), (-0.03, 0.014)]
    polygon(turned(driver_at, angle, [*handle, (-0.05, 0.010)]), (40, 168, 120))
    stripe = [(-0.03, -0.003), (0.04, -0.003), (0.04, 0.003), (-0.03, 0.003)]
    polygon(turned(driver_at, angle, stripe), (30, 30, 30))
    # A bottle cap as large as the marker, and a box of another colour.
    cap = px(cap_at[0], cap_at[1] + scatter[2])
    cv2.circle(texture, cap, 13, (70, 150, 40), -1, cv2.LINE_AA)
    cv2.circle(texture, cap, 9, (84, 166, 52), 1, cv2.LINE_AA)
    box = [(-0.05, -0.03), (0.05, -0.03), (0.05, 0.03), (-0.05, 0.03)]
    polygon(turned(box_at, 0.2 + scatter[3], box), (168, 96, 48))


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
    times: Array
    nodes: Array
    joint_path: JointPath | None
    arm: Arm = dataclasses.field(default_factory=ArmUR)

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

    @classmethod
    def of(cls, setup: Setup, times: Array, nodes: Array, joint_path: JointPath | None) -> Self:
        """Return a motion of the cable and the arm of a set-up."""
        return cls(
            cable=setup.cable, times=times, nodes=nodes, joint_path=joint_path, arm=setup.arm
        )

    def shape_at(self, times: Array) -> Array:
        """Return the cable at times [s], held before the first and after the last.

        Returns:
            Nodes [m], shape [time, node, 3].
        """
        if len(self.times) == 1:
            return np.repeat(self.nodes, len(times), axis=0)
        clipped = np.clip(times, self.times[0], self.times[-1])
        # Four neighbours give a cubic through the two in the middle; a spline over the whole trial
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

    The middle of the exposure is a time [s]; the shade is the share of the light that reaches each
    pixel [-], shape [v, u].
    """

    def __init__(
        self,
        config: CameraConfig,
        view: CameraView,
        shade: NDArray[np.float32],
        trial: FilmedTrial,
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
        self.marker = view.to_image(_capsule_outline(tip, along))
        self.hook = view.to_image(_attachment_outline(trial.cable, tip, along))
        self.rods: list[Array] = []
        self.shadow: list[Array] = []
        self.light = 1.0
        if np.all(np.isfinite(middle)):
            u, v = np.clip(np.round(middle).astype(int), 0, np.subtract(shade.shape[::-1], 1))
            self.light = float(shade[v, u])
        if trial.joint_path is not None:
            shape = arm_shape(joints_at(trial.joint_path, self.times), trial.arm)
            self.order = np.argsort(shape.ends[0, :, :, 2].mean(axis=-1))
            self.rods = _rod_outlines(shape, view)
            self.shadow = [view.to_image(rod) for rod in _shadow_outlines(shape, count // 2)]
            now = ArmShape(ends=shape.ends[count // 2][None], radii=shape.radii)
            clearance = sight_clearance(tip[count // 2][None], _LAMP, now)
            covered = float(np.clip(0.5 - clearance[0] / (2 * _PENUMBRA), 0.0, 1.0))
            self.light *= 1.0 - _SHADOW * covered
        self.cable_bgr = _CABLE_BGR.get(trial.cable.name, _OTHER_CABLE_BGR)
        self.marker_bgr = _turned(_MARKER_BGR, config.marker_hue - MARKER_HUE)
        self.marker_light_bgr = _turned(_MARKER_LIGHT_BGR, config.marker_hue - MARKER_HUE)
        self.magnet = trial.cable.attachment is Attachment.MAGNET

    def paint(self, canvas: Image, corner: tuple[int, int], on_table: NDArray[np.bool_]) -> None:
        """Draw into a piece of the background whose left and top are a corner [px].

        The pixels that show the table's surface are on_table, shape [v, u].
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
        things = (self.cable, self.marker, self.hook, *self.rods)
        points = np.concatenate([thing.reshape(-1, 2) for thing in things])
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
        total = np.zeros(region.shape, np.float32)
        for index in range(len(self.times)):
            cv2.accumulate(self._instant(region.copy(), place, table, index), total)
        region[:] = np.round(total / len(self.times)).astype(np.uint8)

    def _instant(
        self, image: Image, corner: tuple[int, int], on_table: NDArray[np.bool_], index: int
    ) -> Image:
        """Draw one instant of the exposure into a piece."""
        below = self.z[index] < _BELOW_Z
        seen = [slice(None)]
        if below.any():
            hidden = image.copy()
            self._draw_cable(hidden, corner, index, slice(None))
            if below[-1]:
                self._draw_end(hidden, corner, index)
            image[~on_table] = hidden[~on_table]
            last = len(below) - int(np.argmax(below[::-1]))
            seen = [slice(0, max(int(np.argmax(below)), 1)), slice(last, None)]
        for part in seen:
            self._draw_cable(image, corner, index, part)
        if not below[-1]:
            self._draw_end(image, corner, index)
        if self.rods:
            for rod in self.order:
                outline, ridge, gloss = self.rods[rod][index]
                links = len(self.rods) - GRIPPER_ROD_COUNT
                shade = min(rod, _LINK_SHADES - 1) if rod < links else rod - len(self.rods)
                colour = np.array(_ROD_BGR[shade], dtype=float)
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
        _fill(image, outline, corner, (np.array(self.marker_bgr) * self.light).tolist())
        inner = outline.mean(axis=0) + 0.5 * (outline - outline.mean(axis=0))
        _fill(image, inner, corner, (np.array(self.marker_light_bgr) * self.light).tolist())


@functools.cache
def _turned(bgr: tuple[int, int, int], angle_deg: float) -> tuple[float, ...]:
    """Return a colour whose hue is turned, as bright and as vivid."""
    hue, saturation, value = colorsys.rgb_to_hsv(*bgr[::-1])
    return colorsys.hsv_to_rgb((hue + angle_deg / 360) % 1.0, saturation, value)[::-1]


def _fixed(points: Array, corner: tuple[int, int]) -> NDArray[np.int32]:
    """Return pixels as OpenCV takes them with fractional bits."""
    return np.round((points - corner) * (1 << _SHIFT)).astype(np.int32)


def _fill(image: Image, outline: Array, corner: tuple[int, int], colour) -> None:
    """Fill the convex hull of some points."""
    if not np.isfinite(outline).all():
        return
    cv2 = load_cv2()
    hull = cv2.convexHull(_fixed(outline, corner))
    cv2.fillConvexPoly(image, hull, colour, cv2.LINE_AA, _SHIFT)


def _capsule_outline(tip: Array, along: Array) -> Array:
    """Return the outline of the marker about the endpoint [m], shape [time, point, 3]."""
    radius = _MARKER.width / 2
    half = max(_MARKER.length / 2 - radius, 0.0)
    circle = radius * _level_circle(_level_across(along))
    ends = [(tip + sign * half * along)[:, None] + circle for sign in (-1.0, 1.0)]
    return np.concatenate(ends, axis=1)


def _attachment_outline(cable: Cable, tip: Array, along: Array) -> Array:
    """Return the line of the hook or the outline of the magnet [m], shape [time, point, 3]."""
    length = cable.attachment_length
    if cable.attachment is Attachment.NONE or length <= 0:
        return np.empty((len(tip), 0, 3))
    across = _level_across(along)
    if cable.attachment is Attachment.MAGNET:
        centre = tip + (_MARKER.length / 2 + length / 2) * along
        return centre[:, None] + 0.011 * _level_circle(across)
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


def _level_across(along: Array) -> Array:
    """Return level unit vectors to the left of some directions."""
    across = np.stack([-along[:, 1], along[:, 0], np.zeros(len(along))], axis=-1)
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    return np.where(length > 1e-6, across / np.maximum(length, 1e-9), [1.0, 0.0, 0.0])


def _level_circle(across: Array) -> Array:
    """Return level unit circles about the origin, shape [time, point, 3]."""
    forward = np.stack([across[:, 1], -across[:, 0], np.zeros(len(across))], axis=-1)
    return _COS[:, None] * forward[:, None] + _SIN[:, None] * across[:, None]


def _rod_outlines(shape: ArmShape, view: CameraView) -> list[Array]:
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


def _shadow_outlines(shape: ArmShape, index: int) -> list[Array]:
    """Return the outline of each rod's shadow on the table [m], each shape [point, 3]."""
    lamp = np.asarray(_LAMP)
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
def _spline_matrix(node_count: int) -> Array:
    """Return weights that put three points between neighbouring nodes of a smooth curve."""
    if node_count < 4:
        return np.eye(node_count)
    from scipy.interpolate import CubicSpline

    index = np.arange(node_count)
    fine = np.linspace(0, node_count - 1, 4 * (node_count - 1) + 1)
    return CubicSpline(index, np.eye(node_count))(fine)
