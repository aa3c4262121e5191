"""What is drawn, as colours and arrays, without a browser: arm, cable, lines, map, words."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.base import Arm
from cablecast.arm.shape import GRIPPER_ROD_COUNT, STANDING, arm_shape
from cablecast.conventions import Array
from cablecast.learning.policy import Policy
from cablecast.motion.joint_move import JointMoves, SwingPlane, swing_shape
from cablecast.report.style import multiples
from cablecast.rigs.swings import move_envelope
from cablecast.setup import Setup
from cablecast.workspace import Workspace

Color = tuple[int, int, int]

# The palette of Okabe and Ito, as in report/style.py, which stays distinct under colour blindness.
BLUE: Color = (0, 114, 178)
VERMILLION: Color = (213, 94, 0)
GREEN: Color = (0, 158, 115)
PURPLE: Color = (204, 121, 167)
SKY: Color = (86, 180, 233)
INK: Color = (31, 41, 51)
GREY: Color = (123, 135, 148)
SLATE: Color = (71, 85, 105)
WHITE: Color = (255, 255, 255)
TABLE: Color = (226, 214, 194)
TABLE_SIDE: Color = (176, 158, 132)
TABLE_LINE: Color = (196, 182, 160)
FLOOR: Color = (214, 219, 224)
ARM: Color = (212, 217, 223)
JOINT: Color = (94, 119, 145)

CABLE_RADIUS_MIN = 0.006
"""Smallest radius at which a cable is drawn [m]: a thinner one vanishes on a screen."""

TRAIL_COUNT = 160
"""Number of points of the trail of a free end."""

TRAIL_WIDTH = 0.008
"""Width at which the trail is drawn [m]."""

MAP_FULL_SHARE = 0.25
"""Expected miss at the end of the map's colours [share of cable length]."""

# Colours of shares 0, 1/2 and 1 of that. Blue to orange stays distinct under colour blindness.
MAP_COLORS = np.array([[0, 114, 178], [240, 228, 66], [213, 94, 0]], dtype=float)

_GRID_STEP = 0.25  # Distance of the lines across the table or the plane of a swing [m].
_MAP_STEP = 0.04  # Distance of the targets of the map [m].
_HATCH_STEP = 0.03  # Distance of the lines across a place that the camera is blind at [m].
_TUBE_SIDES = 6
_RING_RADIUS, _CROSS = 0.03, 0.05  # Ring of a target without a tolerance, half of a cross [m].
_HOUSING_LENGTH = 2.6  # Links shorter than this are housings of joints [radii].
_HOUSING_OUT = 0.75  # Length by which a housing stands out at either end [radii].
_TUBE_SHARE = 0.8  # Radius of a long link over that of its ends [-].
_FOV, _ELEVATION = np.radians(44.0), np.radians(74.0)  # Steep: the arm hides little of the table.
_ELEVATION_NARROW = np.radians(86.0)
# A plane of swings is seen from its side, turned and from above by so much that the floor is seen.
_ASIDE, _ABOVE, _ROOM = np.radians(14.0), np.radians(7.0), 1.12
_EXTENT_MOVES = 64  # Moves that tell how far a cable can come.
_SCALE_ROOM = np.array([0.04, 0.14])  # Room at the table's sides, and for the scale before it [m].
_MAP_DETAIL = 4  # Pixels of the map's picture for each of its targets, along both sides.
_MAP_OPACITY = 190.0  # Of 255: lines and words below the map shine through a little.
_PASSED_OPACITY = 50  # Of 255: arm and cable are seen behind it.
_PLATE = 190  # Of 255: what lies below words shines through a little.
_PIXELS = 48  # Height of words, enough for a window that shows one table.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rods:
    """Rods, rounded but for those that are housings of joints.

    Attributes:
        ends: Both ends of each rod's axis [m], shape [rod, 2, 3].
        radii: Radius [m], shape [rod].
        housings: Which rods are the housing of a joint, shape [rod].
    """

    ends: Array
    radii: Array
    housings: NDArray[np.bool_]

    @property
    def scales(self) -> Array:
        """Scales of a unit cylinder along z, shape [rod, 3]."""
        length = np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1)
        return np.stack([self.radii, self.radii, np.maximum(length, 1e-4)], axis=1)

    @property
    def centers(self) -> Array:
        """Centres of the rods [m], shape [rod, 3]."""
        return self.ends.mean(axis=1)

    @property
    def quats_wxyz(self) -> Array:
        """Rotations of a cylinder along z onto the rods, shape [rod, 4]."""
        along = self.ends[:, 1] - self.ends[:, 0]
        length = np.linalg.norm(along, axis=1, keepdims=True)
        up = np.array([0.0, 0.0, 1.0])
        u = np.where(length > 1e-9, along / np.maximum(length, 1e-9), up)
        # The half-way rotation from z to u: (1 + z.u, z x u), which fails for u = -z only.
        w = 1.0 + u[:, 2]
        quats = np.stack([w, -u[:, 1], u[:, 0], np.zeros(len(u))], axis=1)
        quats[w < 1e-9] = [0.0, 1.0, 0.0, 0.0]
        return quats / np.linalg.norm(quats, axis=1, keepdims=True)

    @property
    def joints(self) -> tuple[Array, Array]:
        """Balls that round the rods off: centres [m] and radii [m], shapes [ball, 3], [ball]."""
        round_ = ~self.housings
        return self.ends[round_].reshape(-1, 3), np.repeat(self.radii[round_], 2)


def arm_rods(q: ArrayLike, arm: Arm) -> Rods:
    """Return arm and gripper at joint angles [rad], shape [joint].

    Short links are the housings of the joints, and stand out at both ends; long ones are slimmer.
    """
    shape = arm_shape(np.asarray(q, dtype=float)[None], arm)
    ends, radii = shape.ends[0].copy(), shape.radii.copy()
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    housings = length < _HOUSING_LENGTH * radii
    housings[-GRIPPER_ROD_COUNT:] = False
    # What stands on the table does not reach into it.
    out = (housings & (np.arange(len(radii)) >= STANDING))[:, None] * _HOUSING_OUT
    out = out * (radii / np.maximum(length, 1e-9))[:, None] * along
    ends += np.stack([-out, out], axis=1)
    slim = ~housings
    slim[-GRIPPER_ROD_COUNT:] = False
    radii[slim] *= _TUBE_SHARE
    return Rods(ends=ends, radii=radii, housings=housings)


def drawn_rods(q: ArrayLike, setup: Setup, *, tool_alone: bool = False) -> Rods:
    """Return the arm with its gripper, or with the stick of a strike, at joint angles [rad].

    The angles have the shape [joint]. The gripper or the stick is alone where meshes show the arm.
    """
    rods, tool_count = arm_rods(q, setup.arm), GRIPPER_ROD_COUNT
    ends, radii, housings = rods.ends, rods.radii, rods.housings
    if setup.strike is not None:
        stick = JointMoves.of(setup).stick
        held = swing_shape(np.asarray(q, dtype=float), setup.arm, stick).ends[-1:]
        ends = np.concatenate([ends[:-GRIPPER_ROD_COUNT], held])
        radii = np.append(radii[:-GRIPPER_ROD_COUNT], stick.radius)
        housings, tool_count = np.append(housings[:-GRIPPER_ROD_COUNT], False), 1
    chosen = slice(-tool_count if tool_alone else 0, None)
    return Rods(ends=ends[chosen], radii=radii[chosen], housings=housings[chosen])


def tube(nodes: Array, radius: float) -> tuple[Array, NDArray[np.integer]]:
    """Return a cable of some nodes and radius as one mesh [m], drawn at least visibly thick.

    Vertices have the shape [node * side, 3], faces [face, 3]. A browser moves the vertices of one
    mesh with far less work than a row of rods.
    """
    radius = max(radius, CABLE_RADIUS_MIN)
    along = np.gradient(nodes, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    # A cable on a table is nearly level; where it stands upright any side will do.
    side = np.cross(along, [0.0, 0.0, 1.0])
    width = np.linalg.norm(side, axis=1, keepdims=True)
    side = np.where(width > 1e-3, side / np.maximum(width, 1e-9), [1.0, 0.0, 0.0])
    up = np.cross(side, along)
    turn = np.linspace(0.0, 2 * np.pi, _TUBE_SIDES, endpoint=False)[None, :, None]
    ring = np.cos(turn) * side[:, None] + np.sin(turn) * up[:, None]
    vertices = (nodes[:, None] + radius * ring).reshape(-1, 3)
    node, corner = np.arange(len(nodes) - 1)[:, None], np.arange(_TUBE_SIDES)[None]
    here, there = node * _TUBE_SIDES + corner, (node + 1) * _TUBE_SIDES + corner
    after = (corner + 1) % _TUBE_SIDES
    here_next, there_next = node * _TUBE_SIDES + after, (node + 1) * _TUBE_SIDES + after
    corners = [here, there, here_next, here_next, there, there_next]
    return vertices, np.stack(corners, axis=-1).reshape(-1, 3)


def thinned(points: Array, whole_count: int) -> Array:
    """Return at most `TRAIL_COUNT` points of a path that grows, always with the last.

    A point that was left out stays out, so the number of points of the whole path is given.
    """
    step = max(1, -(-whole_count // (TRAIL_COUNT - 1)))
    return points if len(points) < 2 else np.concatenate([points[:-1:step], points[-1:]])


def ribbon(path: Array, normal: ArrayLike) -> tuple[Array, NDArray[np.integer]]:
    """Return a path of up to `TRAIL_COUNT` points [m], shape [point, 3], as a flat mesh [m].

    Its width lies across a normal. It always has the same number of vertices, shape
    [2 * TRAIL_COUNT, 3]; faces, shape [face, 3].
    """
    along = np.gradient(path, axis=0) if len(path) > 1 else np.zeros_like(path)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    side = TRAIL_WIDTH / 2 * np.cross(np.asarray(normal, dtype=float), along)
    # What is not yet there lies on the last point, without any area.
    more = TRAIL_COUNT - len(path)
    edges = [np.concatenate([e, np.repeat(path[-1:], more, 0)]) for e in (path + side, path - side)]
    vertices = np.stack(edges, axis=1).reshape(-1, 3)
    left = 2 * np.arange(TRAIL_COUNT - 1)[:, None]
    return vertices, np.concatenate([left + [0, 1, 2], left + [1, 3, 2]])


def level(xy: Array, height: float) -> Array:
    """Return points on the table [m], shape [..., 2], at a height [m], shape [..., 3]."""
    return np.concatenate([xy, np.full_like(xy[..., :1], height)], axis=-1)


def polyline(points: Array) -> Array:
    """Return the segments between successive points, shape [point - 1, 2, 3]."""
    return np.stack([points[:-1], points[1:]], axis=1)


def circle(center_xy: ArrayLike, radius: float, height: float) -> Array:
    """Return the segments of a level circle [m], shape [segment, 2, 3]."""
    turn = np.linspace(0.0, 2 * np.pi, 49)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return polyline(level(np.asarray(center_xy, dtype=float) + radius * ring, height))


def hatched_circle(center_xy: ArrayLike, radius: float, height: float) -> Array:
    """Return the segments of a level circle and of lines across it [m], shape [segment, 2, 3]."""
    center = np.asarray(center_xy, dtype=float)
    count = max(1, round(2 * radius / _HATCH_STEP) - 1)
    away = np.linspace(-radius, radius, count + 2)[1:-1]
    half = np.sqrt(radius**2 - away**2)
    # Turned by an eighth: the table has lines along both of its sides.
    across = np.array([1.0, 1.0]) / np.sqrt(2.0)
    along = np.array([1.0, -1.0]) / np.sqrt(2.0)
    middles = center + away[:, None] * across
    ends = np.stack([middles - half[:, None] * along, middles + half[:, None] * along], axis=1)
    return np.concatenate([circle(center, radius, height), level(ends, height)])


def target_marks(xy: Array, height: float, within: float = 0.0) -> Array:
    """Return a cross at a target and a ring of its tolerance [m], shape [segment, 2, 3].

    Without a tolerance the ring is as large as is seen well.
    """
    radius = within or _RING_RADIUS
    arm = max(1.5 * radius, _CROSS) * np.array([[[1.0, 0.0]], [[0.0, 1.0]]])
    cross = level(xy + arm * [[-1.0], [1.0]], height)
    return np.concatenate([circle(xy, radius, height), cross])


def table_lines(setup: Setup, height: float) -> Array:
    """Return the lines of a grid across the table [m], shape [line, 2, 3]."""
    table = setup.workspace
    return grid_lines((-table.half_width, table.y_min), (table.half_width, table.y_max), height)


def grid_lines(low: ArrayLike, high: ArrayLike, height: float) -> Array:
    """Return the level lines of a grid between two corners [m], shape [line, 2, 3]."""
    (x0, y0), (x1, y1) = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    lines = [[[x, y0, height], [x, y1, height]] for x in multiples(_GRID_STEP, x0, x1)]
    lines += [[[x0, y, height], [x1, y, height]] for y in multiples(_GRID_STEP, y0, y1)]
    return np.array(lines)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """Where targets lie: the top of the table, or the plane of a swing.

    Places on it are x and y, or the distance ahead and the height [m].

    Attributes:
        axes: Directions of both coordinates and the normal, as columns, shape [3, 3].
        origin: Place (0, 0) [m], shape [3].
    """

    axes: Array
    origin: Array

    @classmethod
    def of(cls, setup: Setup) -> "Surface":
        """Return the surface of the targets of a laboratory."""
        if setup.strike is None:
            return cls(axes=np.eye(3), origin=np.zeros(3))
        plane = SwingPlane.of(JointMoves.of(setup))
        axes = np.stack([plane.ahead, [0.0, 0.0, 1.0], plane.right], axis=1)
        return cls(axes=axes, origin=plane.aside * plane.right)

    @property
    def quat_wxyz(self) -> Array:
        """Rotation of the axes, shape [4]."""
        from scipy.spatial.transform import Rotation

        return Rotation.from_matrix(self.axes).as_quat(scalar_first=True)

    def flat(self, values: ArrayLike) -> Array:
        """Return the places of outcomes, shape [..., k], on the surface [m], shape [..., 2]."""
        values = np.asarray(values, dtype=float)
        at = values if values.shape[-1] == 2 else (values - self.origin) @ self.axes
        return at[..., :2]

    def points(self, places: ArrayLike) -> Array:
        """Return places on the surface [m], shape [..., 2], as points [m], shape [..., 3]."""
        return self.origin + np.asarray(places, dtype=float) @ self.axes[:, :2].T

    def pick(self, start: ArrayLike, direction: ArrayLike) -> Array | None:
        """Return the place that a ray meets [m], shape [2]; None if it meets none."""
        start = (np.asarray(start, dtype=float) - self.origin) @ self.axes
        along = np.asarray(direction, dtype=float) @ self.axes
        if start[2] * along[2] >= -1e-6 * abs(start[2]):
            return None
        return (start - along * start[2] / along[2])[:2]


def swing_extent(setup: Setup) -> tuple[Array, Array]:
    """Return the corners of the part of the plane that a swung cable can be in [m], [2] each."""
    from scipy.stats import qmc

    moves, floor = JointMoves.of(setup), setup.strike_section.floor
    box = move_envelope(setup, qmc.Sobol(moves.size, rng=0).random(_EXTENT_MOVES))
    corners = np.stack(np.meshgrid(*np.stack(box, axis=1)), axis=-1).reshape(-1, 3)
    places = SwingPlane.of(moves).coordinates(corners)[:, :2]
    return np.maximum(places.min(axis=0), [-np.inf, floor]), places.max(axis=0)


def reach_arc(setup: Setup, height: float) -> Array:
    """Return the edge of what can be reached at all, r_max + r_c, where it is on the table."""
    radius = setup.workspace.reach(setup.cable.length)
    turn = np.linspace(-np.pi / 2, np.pi / 2, 181)
    points = np.stack([radius * np.sin(turn), radius * np.cos(turn)], axis=1)
    segments = polyline(level(points, height))
    inside = setup.workspace.on_table(segments[:, :, :2]).all(axis=1)
    return segments[inside]


def viewpoint(
    setup: Setup, aspect: float = 16 / 9, *, panel: bool = False
) -> tuple[Array, Array, float]:
    """Return a place behind the robot from which the whole table is seen in an aspect [-].

    That is a position and the point looked at [m], shape [3], and the vertical field of view [rad].
    The panel of the page covers the lower part of a tall picture. The plane of a swing is seen from
    its side.
    """
    tall = panel and aspect <= 1.0
    # The band of the picture that the table or the plane fills.
    low, high = (0.24, 0.97) if tall else (-0.95, 0.95)
    if setup.strike is not None:
        return _viewpoint_aside(setup, aspect, low, high)
    table = setup.workspace
    x, near = np.array([table.half_width, table.y_min]) + _SCALE_ROOM * [1.0, -1.0]
    depth = table.y_max - near
    # On a phone the width is what is short: seen from above the table is taller.
    elevation = _ELEVATION_NARROW if tall else _ELEVATION
    tan, sin, cos = np.tan(_FOV / 2), np.sin(elevation), np.cos(elevation)
    # Distance along the view of the near edge: it fits the width, and both edges the band.
    first = max(
        x / (0.97 * tan * max(aspect, 0.2)),
        depth * (sin / tan - high * cos) / (high - low),
    )
    last = first + depth * cos
    # Both edges are as far from the middle of the band.
    y = (near / first + table.y_max / last - (low + high) * tan / sin) / (1 / first + 1 / last)
    look_at = np.array([0.0, y, 0.0])
    away = first - (near - y) * cos
    return look_at + away * np.array([0.0, -cos, sin]), look_at, float(_FOV)


def _viewpoint_aside(
    setup: Setup, aspect: float, bottom: float, top: float
) -> tuple[Array, Array, float]:
    """Return a place beside the plane of a swing from which all of it is seen; see `viewpoint`."""
    surface, (low, high) = Surface.of(setup), swing_extent(setup)
    tan = np.tan(_FOV / 2)
    width, height = high - low
    away = _ROOM * max(width / (2 * tan * max(aspect, 0.2)), height / ((top - bottom) * tan))
    middle = (low + high) / 2 - [0.0, (top + bottom) / 2 * tan * away]
    look_at = surface.points(middle)
    turned = [-np.sin(_ASIDE) * np.cos(_ABOVE), np.sin(_ABOVE), np.cos(_ASIDE) * np.cos(_ABOVE)]
    return look_at + away * surface.axes @ turned, look_at, float(_FOV)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class MapPicture:
    """A picture of the surface that targets lie on, between two corners [m], shape [2] each.

    Its shape is [row, column, 4], with the far or upper edge first.
    """

    image: NDArray[np.uint8]
    low: Array
    high: Array


def map_targets(table: Workspace) -> Array:
    """Return the targets of the map, all over the table [m], shape [row, column, 2]."""
    x = np.arange(-table.half_width + _MAP_STEP / 2, table.half_width, _MAP_STEP)
    y = np.arange(table.y_min + _MAP_STEP / 2, table.y_max, _MAP_STEP)
    return np.stack(np.meshgrid(x, y), axis=-1)


def miss_map(policy: Policy) -> Array:
    """Return how far casts of a policy are expected to miss `map_targets` [m], [row, column].

    That is the prediction's miss, and the shift for errors of the action of one degree and one
    centimetre; NaN out of reach.
    """
    xy = map_targets(policy.setup.workspace)
    miss = np.full(xy.shape[:2], np.nan)
    inside = np.linalg.norm(xy, axis=-1) <= policy.setup.workspace.reach(policy.setup.cable.length)
    plan = policy.plan(xy[inside])
    offset = np.linalg.norm(plan.predicted_xy - plan.target_xy, axis=1)
    miss[inside] = np.hypot(offset, np.nan_to_num(plan.sensitivity))
    return miss


def passed_map(tips: ArrayLike, setup: Setup) -> MapPicture:
    """Return where tips [m], shape [..., 3], pass in the plane of a swing, in blue."""
    low, high = swing_extent(setup)
    points = np.asarray(tips, dtype=float).reshape(-1, 3)
    places = Surface.of(setup).flat(points[np.isfinite(points[:, 0])])
    counts = np.ceil((high - low) / _MAP_STEP).astype(int)
    edges = [np.linspace(low[k], high[k], counts[k] + 1) for k in range(2)]
    passed = np.histogram2d(*places.T, bins=edges)[0].T > 0
    image = np.zeros((*passed.shape, 4), dtype=np.uint8)
    image[passed] = (*BLUE, _PASSED_OPACITY)
    return MapPicture(image=np.flipud(image), low=low, high=high)


def map_image(miss: Array, setup: Setup) -> NDArray[np.uint8]:
    """Return misses of `miss_map` [m] within reach as an image, far edge first.

    Its shape is [row, column, 4], with `_MAP_DETAIL` times as many rows and columns.
    """
    from scipy.ndimage import zoom

    known = np.isfinite(miss).astype(float)
    weight, sums = (
        np.asarray(zoom(values, _MAP_DETAIL, order=1, grid_mode=True, mode="nearest"))
        for values in (known, np.nan_to_num(miss))
    )
    table, length = setup.workspace, setup.cable.length
    share = sums / np.maximum(weight, 1e-9) / (MAP_FULL_SHARE * length)
    colors = np.stack([np.interp(share, (0.0, 0.5, 1.0), c) for c in MAP_COLORS.T], axis=-1)
    rows, columns = share.shape
    y = np.linspace(table.y_min, table.y_max, rows)[:, None, None]
    x = np.linspace(-table.half_width, table.half_width, columns)[None, :, None]
    seen = np.hypot(x, y) <= table.reach(length)
    image = np.concatenate([colors, _MAP_OPACITY * seen], axis=-1)
    return np.flipud(image).astype(np.uint8)


def text_image(text: str, color: Color, plate: Color | None = None) -> NDArray[np.uint8]:
    """Return a line of text, on a plate if it has a colour, RGBA, shape [v, u, 4]."""
    from PIL import Image, ImageDraw, ImageFont

    font = ImageFont.load_default(size=0.8 * _PIXELS)
    width = round(font.getlength(text)) + _PIXELS // 2
    behind = (*color, 0) if plate is None else (*plate, _PLATE)
    image = Image.new("RGBA", (width, _PIXELS), behind)
    ImageDraw.Draw(image).text((width / 2, _PIXELS / 2), text, (*color, 255), font, anchor="mm")
    return np.asarray(image)
