"""Figures in the browser: arm and cable of one cast, drawn with viser."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cablecast.setup import Setup
from cablecast.view.arm_meshes import ArmMeshes, MeshesDrawing
from cablecast.view.palette import LIGHT, Color, Paint
from cablecast.view.shapes import Rods, arm_rods, gripper_rods, ribbon, thinned, tube
from cablecast.view.shown import ShownCast

if TYPE_CHECKING:
    import viser

LIFT = 0.002
"""Height of lines above the table, so that they are not hidden in it [m]."""

_BALL_RADIUS = 0.016  # Of the attachment at the free end [m].


def set_changed(handle: Any, name: str, value: Any) -> None:
    """Set a property that has changed: every assignment is sent to every tab."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)


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

        # What shines through need not be round, and costs a browser that draws in software more.
        sides = 24 if opacity is None else 12
        cylinder = trimesh.creation.cylinder(radius=1.0, height=1.0, sections=sides)
        ball = trimesh.creation.uv_sphere(radius=1.0, count=[sides // 2, sides])
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
        """True while it is drawn."""
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
        with_arm: True for a figure with the arm.
        paint: Colours.
        meshes: Meshes of the arm; drawn as rods where None.
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
        meshes: ArmMeshes | None = None,
    ):
        self._server, self._name, self._setup = server, name, setup
        self._color, self._opacity, self._with_arm = color, opacity, with_arm
        self._paint, self._meshes = paint, meshes
        self._arm: RodsDrawing | None = None
        self._real_arm: MeshesDrawing | None = None
        self._cable: Any = None
        self._node_count = 0
        self._visible = True
        # One mesh whose vertices move: a browser that draws in software spends two thirds of its
        # time on lines whose number changes.
        vertices, faces = ribbon(np.zeros((1, 2)), 2 * LIFT)
        self._trail = server.scene.add_mesh_simple(
            f"{name}/trail",
            vertices.astype(np.float32),
            faces,
            color=color,
            side="double",
            visible=False,
            cast_shadow=False,
            receive_shadow=False,
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
            self._draw_arm(q)
        if nodes is not None:
            self._draw_cable(nodes)
        tip = nodes[-1] if nodes is not None else np.append(cast.endpoint_at(time), 0.01)
        set_changed(self._tip, "visible", bool(np.all(np.isfinite(tip))))
        if self._tip.visible:
            self._tip.position = tip
        trail = thinned(cast.trail(time), len(cast.times))
        set_changed(self._trail, "visible", len(trail) > 1)
        if len(trail) > 1:
            self._trail.vertices = ribbon(trail, 2 * LIFT)[0].astype(np.float32)

    def _draw_arm(self, q: NDArray[np.float64]) -> None:
        if self._meshes is not None:
            if self._real_arm is None:
                self._real_arm = MeshesDrawing(self._server, f"{self._name}/meshes", self._meshes)
            self._real_arm.move(q)
        arm = self._setup.arm
        rods = arm_rods(q, arm) if self._meshes is None else gripper_rods(q, arm)
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

    def recolor(self, color: Color) -> None:
        """Draw the cable, its end and its trail in another colour."""
        self._color = color
        self._tip.color = color
        self._trail.color = color
        if self._cable is not None:
            self._cable.color = color

    def repaint(self, paint: Paint) -> None:
        """Take the arm's colours from a light or dark scene."""
        self._paint = paint
        if self._arm is not None and self._opacity is None:
            self._arm.recolor(paint.arm, paint.joint)

    @property
    def _parts(self) -> list[Any]:
        parts = (self._arm, self._real_arm, self._cable, self._tip, self._trail)
        return [part for part in parts if part is not None]

    @property
    def visible(self) -> bool:
        """True while the figure is drawn."""
        return self._visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        if visible == self._visible:
            return
        self._visible = visible
        for part in self._parts:
            part.visible = visible

    def remove(self) -> None:
        """Take the figure out of the scene."""
        for part in self._parts:
            part.remove()
