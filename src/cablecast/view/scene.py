"""What is seen in the browser, drawn with viser: table or plane, marks, arms and cables that move.

A browser that draws in software decides how: few meshes whose vertices move instead of lines whose
number changes, words as small pictures, no shadows, no surroundings.
"""

import abc
import contextlib
import io
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cablecast.camera.settings import CameraSight
from cablecast.cast import Cast, Proposal
from cablecast.conventions import Ellipse
from cablecast.errors import InputError
from cablecast.pipeline.places import require
from cablecast.report.style import multiples
from cablecast.report.tries import REGION_SHARE
from cablecast.setup import Setup
from cablecast.view.arm_meshes import ArmMeshes
from cablecast.view.look import ShownCast
from cablecast.view.shapes import (
    ARM,
    BLUE,
    FLOOR,
    GREEN,
    GREY,
    INK,
    JOINT,
    PURPLE,
    SKY,
    TABLE,
    TABLE_LINE,
    TABLE_SIDE,
    VERMILLION,
    WHITE,
    Array,
    Color,
    MapPicture,
    Rods,
    Surface,
    circle,
    drawn_rods,
    grid_lines,
    hatched_circle,
    level,
    polyline,
    reach_arc,
    ribbon,
    swing_extent,
    table_lines,
    target_marks,
    text_image,
    thinned,
    tube,
)

if TYPE_CHECKING:
    import viser

LIFT = 0.002
"""Height of lines above the table, so that they are not hidden in it [m]."""

FIGURE_COLORS: dict[str, Color] = {
    "measured": BLUE,
    "plan": PURPLE,
    "believed": VERMILLION,
    "tuned": GREEN,
    "sliders": PURPLE,
    "MuJoCo": (230, 159, 0),
}
"""Colours of the figures of a stage."""

_PLAN_OPACITY = 0.5
_REST_OPACITY = 0.35
_HIT_OPACITY = 0.6  # Of the disc of a target that was hit.
_TEXT_HEIGHT = 0.07  # Of the text at a landing [m].
_TEXT_AWAY = 0.1  # Distance of that text from the landing [m].
_TEXT_ROOM = np.array([0.22, 0.08])  # Nearer to the last text, an earlier number is left out [m].
_TEXT_LIFT = 0.03  # Height of that text, above any cable on the table [m].
_BALL_RADIUS = 0.016  # Of the attachment at the free end [m].
_THICKNESS = 0.04  # Of the table's top [m].
_POST = 0.09  # Radius of the post that an arm of strikes stands on [m].
_PANE_OPACITY = 0.12  # Of the plane of a swing.
# Corner of the floor, or of the unseen ground that answers to clicks [m].
_FAR = np.array([20.0, 20.0])
_AXIS = 0.28  # Length of the base frame's axes, which end beyond the arm's foot [m].
# An image of viser lies in its own x-y plane with y down, so it is turned about x.
_FLAT = (0.0, 1.0, 0.0, 0.0)
_SHADOWLESS: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}


def start_server(host: str, port: int) -> "viser.ViserServer":
    """Start a server of the page at an address, on a port or the next free one.

    Raises:
        MissingExtraError: viser or trimesh is not installed.
        InputError: The address cannot be listened on.
    """
    require("the page", "viser", "trimesh")
    import viser

    try:
        # It always prints a table of addresses; the command prints ours.
        with contextlib.redirect_stdout(io.StringIO()):
            return viser.ViserServer(host=host, port=port, label="cablecast", verbose=False)
    except OSError as error:
        raise InputError(f"host {host!r}, port {port} cannot be listened on: {error}") from None


def stop_server(server: "viser.ViserServer") -> None:
    """Stop a server without output."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def update(handle: Any, **values: Any) -> None:
    """Set the properties that have changed: every assignment is sent to every tab."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


class MeshesDrawing:
    """Meshes of an arm in the browser."""

    def __init__(self, server: "viser.ViserServer", name: str, meshes: ArmMeshes):
        self._meshes = meshes
        self._handles = [
            server.scene.add_mesh_simple(
                f"{name}/{piece}",
                mesh.vertices,
                mesh.faces,
                color=mesh.color,
                flat_shading=True,
                **_SHADOWLESS,
            )
            for piece, mesh in meshes.pieces.items()
        ]

    def move(self, q: Array) -> None:
        """Draw the arm at joint angles [rad], shape [joint]."""
        for handle, quat, position in zip(self._handles, *self._meshes.poses(q), strict=True):
            handle.wxyz, handle.position = quat, position

    def show(self, visible: bool, opacity: float | None) -> None:
        """Show it with an opacity, None for a solid one, or hide it."""
        for handle in self._handles:
            update(handle, visible=visible, opacity=opacity)


class RodsDrawing:
    """Rounded rods in the browser, as one instanced mesh of cylinders and one of balls."""

    def __init__(
        self,
        server: "viser.ViserServer",
        name: str,
        rods_at: Callable[[Array], Rods],
        q: Array,
        color: Color,
        *,
        housing_color: Color | None = None,
        opacity: float | None = None,
    ):
        import trimesh

        self._rods_at, rods = rods_at, rods_at(q)
        # What shines through need not be round, and costs a browser that draws in software more.
        sides = 24 if opacity is None else 12
        cylinder = trimesh.creation.cylinder(radius=1.0, height=1.0, sections=sides)
        ball = trimesh.creation.uv_sphere(radius=1.0, count=[sides // 2, sides])
        centers, radii = rods.joints

        def add(part: str, mesh: Any, quats: Array, places: Array, scales: Array, paint: Any):
            return server.scene.add_batched_meshes_simple(
                f"{name}/{part}",
                mesh.vertices,
                mesh.faces,
                quats,
                places,
                batched_scales=scales,
                batched_colors=paint,
                opacity=opacity,
                lod="off",
                cast_shadow=opacity is None,
                receive_shadow=False,
            )

        upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(radii), 1))
        sizes = np.repeat(radii[:, None], 3, axis=1)
        paints = np.array([_linear(color), _linear(housing_color or color)], dtype=np.uint8)
        own = paints[rods.housings.astype(int)]
        self._rods = add("rods", cylinder, rods.quats_wxyz, rods.centers, rods.scales, own)
        self._balls = add("balls", ball, upright, centers, sizes, _linear(color))

    def move(self, q: Array) -> None:
        """Draw the rods at joint angles [rad], shape [joint]."""
        rods = self._rods_at(q)
        self._rods.batched_wxyzs = rods.quats_wxyz.astype(np.float32)
        self._rods.batched_positions = rods.centers.astype(np.float32)
        self._rods.batched_scales = rods.scales.astype(np.float32)
        self._balls.batched_positions = rods.joints[0].astype(np.float32)

    def show(self, visible: bool, opacity: float | None) -> None:
        """Show them with an opacity, None for solid ones, or hide them."""
        update(self._rods, visible=visible, opacity=opacity)
        update(self._balls, visible=visible, opacity=opacity)


def _linear(color: Color) -> Color:
    """Return a colour as instanced meshes want it: viser takes theirs as linear light."""
    red, green, blue = (round(255 * (value / 255) ** 2.2) for value in color)
    return red, green, blue


class Figure:
    """Arm and cable of one cast, moving; a ghost with an opacity, a solid figure without.

    The name is that in the tree of the scene, the colour that of the cable. Without meshes the arm
    is drawn as rods.

    Attributes:
        with_arm: True where the arm is drawn, too.
    """

    def __init__(
        self,
        server: "viser.ViserServer",
        name: str,
        setup: Setup,
        color: Color,
        *,
        opacity: float | None = None,
        with_arm: bool = True,
        meshes: ArmMeshes | None = None,
    ):
        self._server, self._name, self._setup = server, name, setup
        self._color, self._opacity, self.with_arm = color, opacity, with_arm
        self._arm_opacity = None if opacity is None else 0.5 * opacity
        self._normal = Surface.of(setup).axes[:, 2]
        self._meshes = meshes
        # Of the arm, once its joints are known.
        self._drawings: list[RodsDrawing | MeshesDrawing] = []
        self._cable: Any = None
        self._visible = True
        self._trail = server.scene.add_mesh_simple(
            f"{name}/trail",
            *ribbon(np.zeros((1, 3)), self._normal),
            color=color,
            side="double",
            visible=False,
            **_SHADOWLESS,
        )
        self._tip = server.scene.add_icosphere(
            f"{name}/tip",
            _BALL_RADIUS,
            color,
            subdivisions=2,
            opacity=opacity,
            cast_shadow=opacity is None,
        )

    def show(self, cast: ShownCast, time: float) -> None:
        """Draw a cast at a time [s]; nothing while the figure is hidden."""
        if not self._visible:
            return
        q, nodes = cast.joints_at(time), cast.nodes_at(time)
        if q is not None and self.with_arm:
            self._draw_arm(q)
        # An arm at rest fades: it may stand between the eye and the landing.
        if self._opacity is None and self._setup.strike is None:
            self._arm_opacity = _REST_OPACITY if time >= cast.duration else None
        self._show_arm(self.with_arm)
        if nodes is not None:
            self._draw_cable(nodes)
        if self._cable is not None:
            update(self._cable, visible=nodes is not None)
        tip = cast.tip_at(time)
        update(self._tip, visible=bool(np.all(np.isfinite(tip))))
        if self._tip.visible:
            self._tip.position = tip
        trail = thinned(cast.trail(time), len(cast.times))
        update(self._trail, visible=len(trail) > 1)
        if len(trail) > 1:
            trail = level(trail, 2 * LIFT)[:, :3]
            self._trail.vertices = ribbon(trail, self._normal)[0].astype(np.float32)

    def _show_arm(self, visible: bool) -> None:
        for drawing in self._drawings:
            drawing.show(visible, self._arm_opacity)

    def _draw_arm(self, q: Array) -> None:
        if not self._drawings:
            server, meshes, is_solid = self._server, self._meshes, self._opacity is None
            rods = RodsDrawing(
                server,
                f"{self._name}/arm",
                lambda q: drawn_rods(q, self._setup, tool_alone=meshes is not None),
                q,
                ARM if is_solid else self._color,
                housing_color=JOINT if is_solid else None,
                opacity=self._arm_opacity,
            )
            self._drawings.append(rods)
            if meshes is not None:
                self._drawings.append(MeshesDrawing(server, f"{self._name}/meshes", meshes))
        for drawing in self._drawings:
            drawing.move(q)

    def _draw_cable(self, nodes: Array) -> None:
        vertices, faces = tube(nodes, self._setup.cable.radius)
        if self._cable is not None and len(self._cable.vertices) == len(vertices):
            self._cable.vertices = vertices
            return
        self._cable = self._server.scene.add_mesh_simple(
            f"{self._name}/cable",
            vertices,
            faces,
            color=self._color,
            opacity=self._opacity,
            side="double",
            **_SHADOWLESS,
        )

    @property
    def visible(self) -> bool:
        """True while the figure is drawn."""
        return self._visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        if visible == self._visible:
            return
        self._visible = visible
        self._show_arm(visible and self.with_arm)
        for handle in (self._tip, self._trail, self._cable):
            if handle is not None:
                handle.visible = visible


class TargetScene(abc.ABC):
    """What targets lie on, with its scale, and target, expectation, tries and map on it.

    All of that is drawn in the coordinates of the surface: two on it, and the height above it.

    Attributes:
        surface: The surface.
        text_scale: Size of words over that on the table [-].
    """

    text_scale: ClassVar[float] = 1.0

    def __init__(self, server: "viser.ViserServer", setup: Setup):
        self._server, self._setup = server, setup
        self.surface = Surface.of(setup)
        self._blind: tuple[tuple[float, float, float], ...] = ()
        scene = server.scene
        scene.configure_environment_map(hdri=None)
        scene.configure_default_lights(enabled=False, cast_shadow=False)
        scene.world_axes.visible = False
        scene.add_light_hemisphere(
            "/light/sky", sky_color=(255, 255, 255), ground_color=(150, 145, 140), intensity=1.9
        )
        scene.add_light_directional(
            "/light/lamp", color=(255, 250, 240), intensity=1.6, position=(-1.0, -1.5, 3.0)
        )
        for name in ("/room", "/marks"):
            turn, place = self.surface.quat_wxyz, self.surface.origin
            scene.add_frame(name, show_axes=False, wxyz=turn, position=place)
        scene.add_frame("/base", axes_length=_AXIS, axes_radius=0.006, position=(0.0, 0.0, 0.004))
        self._draw()

    @staticmethod
    def of(server: "viser.ViserServer", setup: Setup) -> "TargetScene":
        """Return the scene of the task of a laboratory."""
        return (TableScene if setup.strike is None else PlaneScene)(server, setup)

    @abc.abstractmethod
    def _draw(self) -> None:
        """Draw what does not move, over what was there."""

    @abc.abstractmethod
    def on_click(self, action: Callable[["viser.SceneNodePointerEvent[Any]"], None]) -> None:
        """Call a function for each click or tap into the picture, or on the plane of a swing."""

    def _sheet(self, name: str, low: Any, high: Any, color: Color, **options: Any) -> Any:
        """Add a rectangle between two corners [m]."""
        corners = np.array([[*low], [high[0], low[1]], [*high], [low[0], high[1]]])
        faces = np.array([[0, 1, 2], [0, 2, 3]])
        return self._server.scene.add_mesh_simple(
            name, level(corners, 0.0), faces, color=color, side="double", **_SHADOWLESS, **options
        )

    def _scale(
        self, low: Any, high: Any, x_edge: float, y_edge: float, plate: Color | None = None
    ) -> None:
        """Write the distances along both sides of a rectangle, at its edges [m]."""
        for axis, (start, end) in enumerate(zip(low, high, strict=True)):
            for at in multiples(0.5, start, end):
                name = f"{'xy'[axis]}/{at:zg}".replace("-", "m").replace(".", "_")
                place = (at, x_edge, LIFT) if axis == 0 else (y_edge, at, LIFT)
                self._text(f"/room/scale/{name}", f"{at:zg} m", place, plate=plate)

    def set_sight(self, sight: CameraSight | None) -> None:
        """Mark the places on the table that the camera is blind at, where they are known."""
        blind = () if sight is None else sight.blind
        if blind == self._blind:
            return
        self._blind = blind
        self._server.scene.remove_by_name("/room/blind")
        for number, (x, y, radius) in enumerate(blind):
            name = f"/room/blind/{number}"
            hatch = hatched_circle((x, y), radius, LIFT)
            self._lines(f"{name}/hatch", hatch, JOINT, 1.0)
            # On the near side, where it hides no target in the place.
            below = (x, y - radius - _TEXT_HEIGHT / 2, LIFT)
            self._text(f"{name}/label", "hidden from the camera", below, height=_TEXT_HEIGHT)

    def clear(self) -> None:
        """Take the marks of target, expectation and landings away."""
        for name in ("target", "expected", "tries"):
            self._server.scene.remove_by_name(f"/marks/{name}")

    def target(self, value: Array, within: float = 0.0, *, is_hit: bool = False) -> None:
        """Draw the target [m], shape [k], as a cross, with a ring of its tolerance [m] if known.

        One that was hit is green, and filled.
        """
        xy = self.surface.flat(value)
        self._server.scene.remove_by_name("/marks/target")
        color = GREEN if is_hit else VERMILLION
        self._lines("/marks/target/rings", target_marks(xy, 2 * LIFT, within), color, 3.0)
        if is_hit:
            self._server.scene.add_cylinder(
                "/marks/target/disc",
                within,
                LIFT,
                color=color,
                opacity=_HIT_OPACITY,
                position=(*xy, LIFT),
                cast_shadow=False,
            )

    def expectation(self, proposal: Proposal) -> None:
        """Draw the expected landing, and the ellipse that nine of ten landings lie in."""
        expected, axes = proposal.expected, self.surface.axes[: proposal.expected.dimension, :2]
        # The shadow of a region in the air is the ellipse of the same square.
        square = expected.law.square(REGION_SHARE, expected.dimension)
        mean = self.surface.flat(expected.mean)
        ellipse = Ellipse.of_covariance(mean, axes.T @ expected.spread @ axes, square)
        lines = [circle(mean, 0.012, 2 * LIFT), polyline(level(ellipse.outline(), 2 * LIFT))]
        self._lines("/marks/expected", np.concatenate(lines), PURPLE, 2.5)

    def landings(self, trials: list[Cast]) -> None:
        """Draw the outcomes of tries at one target, numbered, each with a line to the target."""
        self._server.scene.remove_by_name("/marks/tries")
        places = [(one, self.surface.flat(one.outcome)) for one in trials]
        # Where the text of each lies: on its far side, where it hides no target.
        beside = [self._beside(one, xy) for one, xy in places]
        for (one, xy), label in zip(places, beside, strict=True):
            if not np.all(np.isfinite(xy)):
                continue
            name, is_last = f"/marks/tries/{one.number}", one is trials[-1]
            color = GREEN if one.hit else INK if is_last else GREY
            self._server.scene.add_icosphere(
                f"{name}/ball", 0.014, color, position=(*xy, 0.012), cast_shadow=False
            )
            ends = level(np.stack([self.surface.flat(one.target_xy), xy]), 3 * LIFT)
            self._lines(f"{name}/miss", ends[None], color, 2.5 if is_last else 1.0)
            text = f"{one.try_number}"
            if is_last:
                cable_length = self._setup.cable.length
                hit = "hit, " if one.hit else ""
                text += f":  {hit}{one.miss_pct * cable_length:.1f} cm, {one.miss_pct:.1f} %"
            apart = np.abs(label - beside[-1])
            # The last one may have no outcome.
            if is_last or not np.all(apart <= self.text_scale * _TEXT_ROOM):
                ink, plate = (WHITE, GREEN) if one.hit else (color, WHITE)
                self._text(f"{name}/label", text, (*label, _TEXT_LIFT), ink, _TEXT_HEIGHT, plate)

    def _beside(self, one: Cast, xy: Array) -> Array:
        is_beyond = xy[1] >= self.surface.flat(one.target_xy)[1]
        away = self.text_scale * _TEXT_AWAY
        return xy + [0.0, away if is_beyond else -away]

    def show_map(self, picture: MapPicture | None) -> None:
        """Lay a map on the surface, below the lines; take it away if None."""
        if picture is None:
            self._server.scene.remove_by_name("/marks/map")
            return
        (x, y), (width, depth) = (picture.low + picture.high) / 2, picture.high - picture.low
        self._server.scene.add_image(
            "/marks/map",
            picture.image,
            width,
            depth,
            format="png",
            wxyz=_FLAT,
            position=(x, y, LIFT / 2),
            **_SHADOWLESS,
        )

    def _lines(self, name: str, segments: Array, color: Color, thickness: float) -> None:
        self._server.scene.add_line_segments(
            name, segments, color, thickness=thickness, thickness_units="screen"
        )

    def _text(
        self,
        name: str,
        text: str,
        position: tuple[float, float, float],
        color: Color = INK,
        height: float = 0.08,
        plate: Color | None = None,
    ) -> None:
        """Lay a line of text on the surface, to be read from the robot's side."""
        image, height = text_image(text, color, plate), self.text_scale * height
        self._server.scene.add_image(
            name,
            image,
            height * image.shape[1] / image.shape[0],
            height,
            format="png",
            wxyz=_FLAT,
            position=position,
            **_SHADOWLESS,
        )


class TableScene(TargetScene):
    """The table."""

    def _draw(self) -> None:
        scene, table = self._server.scene, self._setup.workspace
        width, depth = 2 * table.half_width, table.y_max - table.y_min
        middle = (table.y_min + table.y_max) / 2
        for name, color, margin, thickness, z in (
            ("top", TABLE, 0.0, _THICKNESS, -_THICKNESS / 2),
            ("frame", TABLE_SIDE, 0.03, 0.03, -_THICKNESS - 0.004),
        ):
            scene.add_box(
                f"/room/{name}",
                color,
                (width + margin, depth + margin, thickness),
                position=(0.0, middle, z),
                cast_shadow=False,
            )
        self._lines("/room/lines", table_lines(self._setup, LIFT / 2), TABLE_LINE, 1.0)
        self._lines("/room/reach", reach_arc(self._setup, LIFT), JOINT, 2.0)
        # The base is at 0 m ahead.
        low = (-table.half_width, max(table.y_min, 0.1))
        high = (table.half_width, table.y_max)
        self._scale(low, high, table.y_min - 0.07, 0.14 - table.half_width)
        self._text("/room/scale/axis_x", "x", (_AXIS + 0.05, 0.03, LIFT))
        self._text("/room/scale/axis_y", "y", (0.03, _AXIS + 0.03, LIFT))

    def on_click(self, action: Callable[["viser.SceneNodePointerEvent[Any]"], None]) -> None:
        """Call a function for each click or tap into the picture."""
        below = (0.0, 0.0, -2 * _THICKNESS)
        ground = self._sheet("/room/ground", -_FAR, _FAR, FLOOR, position=below)
        ground.on_click(action)


class PlaneScene(TargetScene):
    """The plane of a swing, above the floor, and the post that the arm stands on."""

    text_scale = 1.6

    def _draw(self) -> None:
        floor, (low, high) = self._setup.strike_section.floor, swing_extent(self._setup)
        self._sheet("/floor", -_FAR, _FAR, FLOOR, position=(0.0, 0.0, floor))
        if floor < 0.0:
            self._server.scene.add_cylinder(
                "/post",
                _POST,
                -floor,
                color=TABLE_SIDE,
                position=(0.0, 0.0, floor / 2),
                cast_shadow=False,
            )
        self._lines("/room/lines", grid_lines(low, high, 0.0), TABLE_LINE, 1.0)
        # Not where both would meet.
        self._scale(low + 0.3, high, low[1] + 0.07, low[0] + 0.14, plate=WHITE)
        self._pane = self._sheet("/room/pane", low, high, SKY, opacity=_PANE_OPACITY)

    def on_click(self, action: Callable[["viser.SceneNodePointerEvent[Any]"], None]) -> None:
        """Call a function for each click or tap on the plane."""
        self._pane.on_click(action)


class Player:
    """Plays casts side by side in a thread of its own, and hides figures that no longer play.

    Attributes:
        time: Time that is shown [s].
        speed: Shown seconds per second.
        rate: Pictures a second [1/s].
        pause: Time that the end of a cast is shown before the next round [s].
        on_frame: Called with the time [s] at every frame, e.g. to move a slider.
    """

    def __init__(self):
        self.time = 0.0
        self.speed = 1.0
        self.rate = 25.0
        self.pause = 0.8
        self.playing = False
        self.on_frame: Callable[[float], None] = lambda time: None
        self._acts: list[tuple[Any, ShownCast]] = []
        self._rounds = 1
        self._done: Callable[[], None] | None = None
        self._lock = threading.RLock()
        self._wake = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="player", daemon=True)
        self._thread.start()

    @property
    def duration(self) -> float:
        """Length of the longest cast [s]."""
        return max((cast.duration for _, cast in self._acts), default=0.0)

    def play(
        self,
        acts: Sequence[tuple[Any, ShownCast]],
        *,
        rounds: int = 1,
        done: Callable[[], None] | None = None,
    ) -> None:
        """Play casts in some rounds, instead of what is playing.

        `done` is called at the first end, in the player's thread; it must not wait.
        """
        with self._lock:
            self._set_acts(acts)
            self._rounds, self._done = rounds, done
            self.time, self.playing = 0.0, True
            self._draw()
        self._wake.set()

    def show(self, acts: Sequence[tuple[Any, ShownCast]], at: float) -> None:
        """Show casts at a time [s], at rest."""
        with self._lock:
            self._set_acts(acts)
            self.playing, self._done = False, None
            self.time = at
            self._draw()

    def seek(self, at: float) -> None:
        """Show another time [s], at rest; the end ends a playback."""
        with self._lock:
            self.playing, self.time = False, min(max(at, 0.0), self.duration)
            self._draw()
            done = self._done if self.time >= self.duration else None
            self._done = None if done else self._done
        if done is not None:
            done()

    def toggle(self) -> None:
        """Halt, or go on; at the end start again."""
        with self._lock:
            if not self.playing and self.time >= self.duration:
                self.time = 0.0
            self.playing = not self.playing and bool(self._acts)
        self._wake.set()

    def close(self) -> None:
        """End the thread."""
        self._ended = True
        self._wake.set()
        self._thread.join(timeout=2.0)

    def _set_acts(self, acts: Sequence[tuple[Any, ShownCast]]) -> None:
        playing = [figure for figure, _ in acts]
        for figure, _ in self._acts:
            figure.visible = figure in playing
        for figure in playing:
            figure.visible = True
        self._acts = list(acts)

    def _draw(self) -> None:
        for figure, cast in self._acts:
            figure.show(cast, self.time)
        self.on_frame(self.time)

    def _run(self) -> None:
        before = time.monotonic()
        while not self._ended:
            if not self.playing:
                self._wake.wait()
                self._wake.clear()
                before = time.monotonic()
                continue
            now = time.monotonic()
            with self._lock:
                if self.playing:
                    self._advance(now - before)
            before = now
            # What drawing took is part of the frame.
            time.sleep(max(0.002, 1.0 / self.rate - (time.monotonic() - now)))

    def _advance(self, seconds: float) -> None:
        end = self.duration
        # Between two rounds the time runs on through the pause.
        self.time += self.speed * seconds
        done = self._done if self.time >= end else None
        if self._rounds > 1 and self.time >= end + self.pause * self.speed:
            self.time, self._rounds = 0.0, self._rounds - 1
        elif self._rounds <= 1 and self.time >= end:
            self.time, self.playing = end, False
        self._draw()
        if done is not None:
            self._done = None
            done()


class Stage:
    """What targets lie on, and the figures of `FIGURE_COLORS`: those that play are seen."""

    def __init__(self, server: "viser.ViserServer", setup: Setup, meshes: ArmMeshes | None):
        self._server, self._setup, self._meshes = server, setup, meshes
        self.table = TargetScene.of(server, setup)
        self.player = Player()
        # Those that were shown so far.
        self.figures: dict[str, Figure] = {}

    def play(
        self,
        casts: Mapping[str, ShownCast],
        *,
        rounds: int = 1,
        done: Callable[[], None] | None = None,
    ) -> None:
        """Play casts by the names of their figures."""
        self.player.play(self._acts(casts), rounds=rounds, done=done)

    def show(self, casts: Mapping[str, ShownCast], at: float) -> None:
        """Show casts at a time [s], at rest."""
        self.player.show(self._acts(casts), at)

    def _acts(self, casts: Mapping[str, ShownCast]) -> list[tuple[Figure, ShownCast]]:
        acts = []
        for name, cast in casts.items():
            if name not in self.figures:
                self.figures[name] = Figure(
                    self._server,
                    f"/figures/{name}",
                    self._setup,
                    FIGURE_COLORS[name],
                    opacity=_PLAN_OPACITY if name == "plan" else None,
                    meshes=self._meshes if name == "measured" else None,
                )
            # Casts of one motion share the arm.
            self.figures[name].with_arm = name in ("measured", "plan") or not acts
            acts.append((self.figures[name], cast))
        return acts

    def hide(self, name: str) -> None:
        """Hide a figure until it plays again."""
        if name in self.figures:
            self.figures[name].visible = False
