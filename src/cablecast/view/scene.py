"""The scene in the browser: table, arm, cable, ghost, target, landings; drawn with viser."""

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cablecast.setup import Setup
from cablecast.view.shapes import (
    Rods,
    arm_rods,
    circle,
    level,
    polyline,
    reach_arc,
    table_lines,
    tube,
)
from cablecast.view.shown import ShownCast
from cablecast.view.tries import Try

if TYPE_CHECKING:
    import viser

Color = tuple[int, int, int]

# The palette of Okabe and Ito, as in report/style.py, which stays distinct under colour blindness.
BLUE: Color = (0, 114, 178)
VERMILLION: Color = (213, 94, 0)
GREEN: Color = (0, 158, 115)
PURPLE: Color = (204, 121, 167)
INK: Color = (31, 41, 51)

_THICKNESS = 0.04  # Of the table's top [m].
_LIFT = 0.002  # Of lines above the table, so that they are not hidden in it [m].
_BALL_RADIUS = 0.016  # Of the attachment at the free end [m].


@dataclasses.dataclass(frozen=True, kw_only=True)
class Paint:
    """Colours of a scene, light or dark."""

    table: Color
    side: Color
    line: Color
    text: Color
    arm: Color
    joint: Color


LIGHT = Paint(
    table=(226, 214, 194),
    side=(176, 158, 132),
    line=(196, 182, 160),
    text=INK,
    arm=(196, 203, 212),
    joint=(94, 119, 145),
)
DARK = Paint(
    table=(88, 80, 70),
    side=(58, 52, 45),
    line=(112, 103, 91),
    text=(230, 234, 240),
    arm=(150, 160, 172),
    joint=(70, 96, 124),
)


def linear(color: Color) -> Color:
    """Return a colour as instanced meshes want it: viser takes theirs as linear light."""
    red, green, blue = (round(255 * (value / 255) ** 2.2) for value in color)
    return red, green, blue


class RodsDrawing:
    """Rounded rods in the browser, as one instanced mesh of cylinders and one of balls."""

    def __init__(
        self,
        server: "viser.ViserServer",
        name: str,
        rods: Rods,
        color: Color,
        *,
        joint_color: Color | None = None,
        opacity: float | None = None,
    ):
        import trimesh

        cylinder = trimesh.creation.cylinder(radius=1.0, height=1.0, sections=14)
        ball = trimesh.creation.uv_sphere(radius=1.0, count=[10, 14])
        centers, radii = rods.joints
        common: dict[str, Any] = {"opacity": opacity, "lod": "off", "receive_shadow": False}
        if opacity is not None:
            common["cast_shadow"] = False
        add = server.scene.add_batched_meshes_simple
        self._rods = add(
            f"{name}/rods",
            np.asarray(cylinder.vertices, dtype=np.float32),
            np.asarray(cylinder.faces, dtype=np.uint32),
            rods.quats_wxyz,
            rods.centers,
            batched_scales=rods.scales,
            batched_colors=linear(color),
            **common,
        )
        self._balls = add(
            f"{name}/balls",
            np.asarray(ball.vertices, dtype=np.float32),
            np.asarray(ball.faces, dtype=np.uint32),
            np.tile([1.0, 0.0, 0.0, 0.0], (len(radii), 1)),
            centers,
            batched_scales=np.repeat(radii[:, None], 3, axis=1),
            batched_colors=linear(joint_color or color),
            **common,
        )

    def move(self, rods: Rods) -> None:
        """Move as many rods of the same radii."""
        self._rods.batched_wxyzs = rods.quats_wxyz.astype(np.float32)
        self._rods.batched_positions = rods.centers.astype(np.float32)
        self._rods.batched_scales = rods.scales.astype(np.float32)
        self._balls.batched_positions = rods.joints[0].astype(np.float32)

    def recolor(self, color: Color, joint_color: Color | None = None) -> None:
        """Paint the rods and the balls."""
        self._rods.batched_colors = np.array(linear(color), dtype=np.uint8)
        self._balls.batched_colors = np.array(linear(joint_color or color), dtype=np.uint8)

    @property
    def visible(self) -> bool:
        """Whether it is drawn."""
        return bool(self._rods.visible)

    @visible.setter
    def visible(self, visible: bool) -> None:
        if visible != self._rods.visible:
            self._rods.visible = self._balls.visible = visible

    def remove(self) -> None:
        """Take it out of the scene."""
        self._rods.remove()
        self._balls.remove()


class Figure:
    """Arm and cable of one cast, moving.

    Args:
        server: Server of the page.
        name: Name in the tree of the scene.
        setup: Set-up with arm and cable.
        color: Colour of the cable.
        opacity: Opacity of a ghost; None for a solid figure.
        with_arm: Whether the arm is drawn, too.
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
        paint: Paint = LIGHT,
    ):
        self._server, self._name, self._setup = server, name, setup
        self._color, self._opacity, self._with_arm = color, opacity, with_arm
        self._paint = paint
        self._arm: RodsDrawing | None = None
        self._cable: Any = None
        self._node_count = 0
        self._visible = True
        self._trail = server.scene.add_line_segments(
            f"{name}/trail", np.zeros((1, 2, 3)), color, thickness=2.0, thickness_units="screen"
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
        """Draw a cast at a time [s]."""
        if not self._visible:
            return
        q, nodes = cast.joints_at(time), cast.nodes_at(time)
        if q is not None and self._with_arm:
            rods = arm_rods(q, self._setup.arm)
            if self._arm is None:
                self._arm = RodsDrawing(
                    self._server,
                    f"{self._name}/arm",
                    rods,
                    self._paint.arm if self._opacity is None else self._color,
                    joint_color=self._paint.joint if self._opacity is None else None,
                    opacity=None if self._opacity is None else 0.5 * self._opacity,
                )
            self._arm.move(rods)
        if nodes is not None:
            self._draw_cable(nodes)
        tip = nodes[-1] if nodes is not None else np.append(cast.endpoint_at(time), 0.01)
        self._tip.visible = bool(np.all(np.isfinite(tip)))
        if self._tip.visible:
            self._tip.position = tip
        trail = cast.trail(time)[::2]
        self._trail.visible = len(trail) > 1
        if len(trail) > 1:
            self._trail.points = polyline(level(trail, 2 * _LIFT)).astype(np.float32)

    def _draw_cable(self, nodes: NDArray[np.float64]) -> None:
        vertices, faces = tube(nodes, self._setup.cable.radius)
        if self._cable is not None and self._node_count == len(nodes):
            self._cable.vertices = vertices.astype(np.float32)
            return
        self._node_count = len(nodes)
        self._cable = self._server.scene.add_mesh_simple(
            f"{self._name}/cable",
            vertices.astype(np.float32),
            faces,
            color=self._color,
            opacity=self._opacity,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def repaint(self, paint: Paint) -> None:
        """Take the arm's colours from a light or dark scene."""
        self._paint = paint
        if self._arm is not None and self._opacity is None:
            self._arm.recolor(paint.arm, paint.joint)

    @property
    def visible(self) -> bool:
        """Whether the figure is drawn."""
        return self._visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        if visible == self._visible:
            return
        self._visible = visible
        for part in (self._arm, self._cable, self._tip, self._trail):
            if part is not None:
                part.visible = visible

    def remove(self) -> None:
        """Take the figure out of the scene."""
        for part in (self._arm, self._cable, self._tip, self._trail):
            if part is not None:
                part.remove()


class Room:
    """What does not move: table, floor, scale, base frame.

    Args:
        server: Server of the page.
        setup: Set-up with table and cable.
        paint: Colours.
    """

    def __init__(self, server: "viser.ViserServer", setup: Setup, paint: Paint = LIGHT):
        self._server, self._setup = server, setup
        self.paint = paint
        self._light()
        self.draw(paint)

    def _light(self) -> None:
        """Light the scene without a picture of surroundings and without shadows.

        Both, and a picture in the background, cost a browser that draws in software most of its
        frames (docs/view.md).
        """
        scene = self._server.scene
        scene.configure_environment_map(hdri=None)
        scene.configure_default_lights(enabled=False, cast_shadow=False)
        scene.world_axes.visible = False
        scene.add_light_hemisphere(
            "/light/sky", sky_color=(255, 255, 255), ground_color=(150, 145, 140), intensity=1.9
        )
        scene.add_light_directional(
            "/light/lamp", color=(255, 250, 240), intensity=1.6, position=(-1.0, -1.5, 3.0)
        )

    def draw(self, paint: Paint) -> None:
        """Draw everything in given colours, over what was there."""
        self.paint = paint
        scene, table = self._server.scene, self._setup.workspace
        width, depth = 2 * table.half_width, table.y_max - table.y_min
        middle = (table.y_min + table.y_max) / 2
        scene.add_box(
            "/room/top",
            paint.table,
            (width, depth, _THICKNESS),
            position=(0.0, middle, -_THICKNESS / 2),
            cast_shadow=False,
            receive_shadow=True,
        )
        scene.add_box(
            "/room/frame",
            paint.side,
            (width + 0.03, depth + 0.03, 0.03),
            position=(0.0, middle, -_THICKNESS - 0.004),
            cast_shadow=False,
            receive_shadow=False,
        )
        scene.add_line_segments(
            "/room/lines",
            table_lines(self._setup, 0.25, _LIFT / 2).astype(np.float32),
            paint.line,
            thickness=1.0,
            thickness_units="screen",
        )
        scene.add_line_segments(
            "/room/reach",
            reach_arc(self._setup, _LIFT).astype(np.float32),
            paint.joint,
            thickness=2.0,
            thickness_units="screen",
        )
        edge = table.y_min - 0.04
        for x in np.arange(np.ceil(2 * -table.half_width) / 2, table.half_width + 1e-6, 0.5):
            self._label(f"x/{x:g}".replace("-", "m").replace(".", "_"), f"{x:g} m", (x, edge, 0.0))
        for y in np.arange(0.5 * max(1, np.ceil(2 * table.y_min)), table.y_max + 1e-6, 0.5):
            place = (-table.half_width - 0.05, float(y), 0.0)
            self._label(f"y/{y:g}".replace(".", "_"), f"{y:g} m", place)
        scene.add_frame(
            "/room/base", axes_length=0.18, axes_radius=0.006, position=(0.0, 0.0, 0.004)
        )

    def _label(self, name: str, text: str, position: tuple[float, float, float]) -> None:
        self._server.scene.add_label(
            f"/room/scale/{name}",
            text,
            position=position,
            font_screen_scale=0.8,
            anchor="center-center",
        )


class Marks:
    """Target, expectation and landings on the table.

    Args:
        server: Server of the page.
        setup: Set-up with the cable.
    """

    def __init__(self, server: "viser.ViserServer", setup: Setup):
        self._server, self._setup = server, setup

    def target(self, xy: NDArray[np.float64]) -> None:
        """Draw the target as two rings and a cross."""
        x, y = float(xy[0]), float(xy[1])
        cross = np.array(
            [
                [[x - 0.06, y, 2 * _LIFT], [x + 0.06, y, 2 * _LIFT]],
                [[x, y - 0.06, 2 * _LIFT], [x, y + 0.06, 2 * _LIFT]],
            ]
        )
        lines = [circle(xy, 0.02, 2 * _LIFT), circle(xy, 0.045, 2 * _LIFT), cross]
        self._server.scene.add_line_segments(
            "/marks/target",
            np.concatenate(lines).astype(np.float32),
            VERMILLION,
            thickness=3.0,
            thickness_units="screen",
        )

    def expectation(self, xy: NDArray[np.float64], radius: float) -> None:
        """Draw the predicted landing, and the circle in which 95 % of the landings are expected.

        Args:
            xy: Predicted landing [m], shape [2].
            radius: Radius of the circle [m]; none is drawn where NaN.
        """
        lines = [circle(xy, 0.012, 2 * _LIFT)]
        if np.isfinite(radius):
            lines.append(circle(xy, radius, 2 * _LIFT, 73))
        self._server.scene.add_line_segments(
            "/marks/expected",
            np.concatenate(lines).astype(np.float32),
            PURPLE,
            thickness=2.5,
            thickness_units="screen",
        )

    def landings(self, tries: list[Try]) -> None:
        """Draw the landings of tries at one target, numbered, each with a line to the target."""
        scene = self._server.scene
        scene.remove_by_name("/marks/tries")
        length = self._setup.cable.length
        for one in tries:
            if not np.all(np.isfinite(one.landed_xy)):
                continue
            name, is_last = f"/marks/tries/{one.number}", one is tries[-1]
            place = np.append(one.landed_xy, 0.012)
            color = INK if is_last else (123, 135, 148)
            scene.add_icosphere(f"{name}/ball", 0.014, color, position=place, cast_shadow=False)
            ends = level(np.stack([one.target_xy, one.landed_xy]), 3 * _LIFT)
            scene.add_line_segments(
                f"{name}/miss",
                ends[None].astype(np.float32),
                color,
                thickness=2.5 if is_last else 1.0,
                thickness_units="screen",
            )
            text = f"{one.number}"
            if is_last:
                text += f":  {100 * one.miss:.1f} cm, {100 * one.miss / length:.1f} %"
            scene.add_label(
                f"{name}/label", text, position=place + [0.0, 0.0, 0.03], anchor="bottom-center"
            )
