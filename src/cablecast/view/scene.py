"""The arm as its maker drew it: the meshes of an MJCF or URDF file, placed by the arm's joints.

Figures in the browser: arm and cable of one cast, drawn with viser.

Table, scale, target and landings in the browser.
"""

import contextlib
import dataclasses
import io
import os
import pathlib
from typing import TYPE_CHECKING, Any

import numpy as np

from cablecast.errors import InputError, MissingExtraError
from cablecast.view.look import ShownCast
from cablecast.view.shapes import LIGHT

if TYPE_CHECKING:
    import viser

from typing import TYPE_CHECKING

from numpy.typing import NDArray

from cablecast.arm.ur import ArmUR
from cablecast.camera.settings import CameraSight
from cablecast.pipeline.aim import ellipse_points
from cablecast.pipeline.aim_session import AimProposal, AimTrial
from cablecast.setup import Setup
from cablecast.view.shapes import (
    GREEN,
    VERMILLION,
    Color,
    Paint,
    Rods,
    add_text,
    arm_rods,
    circle,
    gripper_rods,
    hatched_circle,
    level,
    polyline,
    reach_arc,
    ribbon,
    table_lines,
    thinned,
    tube,
)

if TYPE_CHECKING:
    import viser

Array = NDArray[np.float64]

JOINT_NAMES = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
"""Joints of the file, as the maker's own robot description names them; a prefix may precede."""

MISFIT_MAX = 0.005
"""Largest distance of a wrist of the file from that of the set-up's arm [m]."""

_FACE_COUNT_MAX = 400_000
_POSE_COUNT = 24  # Poses at which the two arms are compared.
_WRISTS = (4, 5)  # DH frames whose origins are the places of the last two joints.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Piece:
    """One body of the arm.

    Attributes:
        name: Name of the body in the file.
        vertices: Vertices in the frame of the body [m], shape [vertex, 3].
        faces: Vertex numbers, shape [face, 3].
        colors: Red, green, blue and opacity of each face, shape [face, 4].
    """

    name: str
    vertices: Array
    faces: NDArray[np.int32]
    colors: NDArray[np.uint8]


class ArmMeshes:
    """Meshes of an arm and where they are at given joint angles.

    The file is compiled by MuJoCo, which reads meshes of the formats STL, OBJ and MSH.

    Args:
        path: MJCF or URDF file with the six joints of a UR arm.
        arm: Arm of the set-up. Its wrists must be where those of the file are.

    Raises:
        InputError: The file cannot be read, has no such joints or no mesh, or is another arm.
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(self, path: str | os.PathLike[str], arm: ArmUR):
        path = pathlib.Path(path)
        self._mujoco, self._model = _compile(path)
        self._data = self._mujoco.MjData(self._model)
        self._joints = [_joint(self._mujoco, self._model, name, path) for name in JOINT_NAMES]
        self._bodies, self.pieces = self._read_pieces(path)
        # From the world of the file to the base frame of the set-up.
        self._turn, self._shift = np.eye(3), np.zeros(3)
        self._align(path, arm)

    def poses(self, q: Array) -> tuple[Array, Array]:
        """Return where the pieces are.

        Args:
            q: Joint angles [rad], shape [6].

        Returns:
            Rotations as quaternions w, x, y, z, shape [piece, 4], and positions [m], shape
            [piece, 3].
        """
        from scipy.spatial.transform import Rotation

        self._set_joints(q)
        turns = self._turn @ self._data.xmat[self._bodies].reshape(-1, 3, 3)
        quats = Rotation.from_matrix(turns).as_quat(scalar_first=True)
        return quats, self._data.xpos[self._bodies] @ self._turn.T + self._shift

    def _set_joints(self, q: Array) -> None:
        self._data.qpos[self._model.jnt_qposadr[self._joints]] = q
        self._mujoco.mj_kinematics(self._model, self._data)

    def _read_pieces(self, path: pathlib.Path) -> tuple[list[int], list[Piece]]:
        """Return the bodies that have meshes, and their meshes."""
        model, is_mesh = self._model, self._mujoco.mjtGeom.mjGEOM_MESH
        geoms = np.flatnonzero(model.geom_type == is_mesh)
        # Where some meshes only show and others only collide, those that show are drawn.
        shows = geoms[(model.geom_contype[geoms] == 0) & (model.geom_conaffinity[geoms] == 0)]
        geoms = shows if len(shows) else geoms
        if not len(geoms):
            raise InputError(f"{path} has no meshes")
        count = int(np.sum(model.mesh_facenum[model.geom_dataid[geoms]]))
        if count > _FACE_COUNT_MAX:
            raise InputError(f"{path} has {count} faces: at most {_FACE_COUNT_MAX} are drawn")
        bodies = sorted({int(model.geom_bodyid[geom]) for geom in geoms})
        return bodies, [
            _piece(self._mujoco, model, body, geoms[model.geom_bodyid[geoms] == body])
            for body in bodies
        ]

    def _align(self, path: pathlib.Path, arm: ArmUR) -> None:
        """Find how the file stands to the base frame, and refuse the file of another arm."""
        from scipy.spatial.transform import Rotation

        rng = np.random.default_rng(0)
        q = rng.uniform(-2.0, 2.0, (_POSE_COUNT, len(JOINT_NAMES)))
        frames = arm.frames(q)
        ours = np.stack([frames[wrist][..., :3, 3] for wrist in _WRISTS], axis=1).reshape(-1, 3)
        theirs = []
        for pose in q:
            self._set_joints(pose)
            theirs.extend(self._data.xanchor[self._joints[-2:]])
        theirs = np.array(theirs)
        middle, their_middle = ours.mean(axis=0), theirs.mean(axis=0)
        turn: Any = Rotation.align_vectors(ours - middle, theirs - their_middle)[0]
        self._turn = turn.as_matrix()
        self._shift = middle - self._turn @ their_middle
        misfit = np.linalg.norm(theirs @ self._turn.T + self._shift - ours, axis=1).max()
        if misfit > MISFIT_MAX:
            raise InputError(
                f"{path} is no {arm.model}: its wrists are up to {1000 * misfit:.0f} mm from those "
                f"of the set-up's arm; at most {1000 * MISFIT_MAX:.0f} mm are allowed"
            )


class MeshesDrawing:
    """Meshes of an arm in the browser."""

    def __init__(self, server: "viser.ViserServer", name: str, meshes: ArmMeshes):
        import trimesh
        from trimesh.visual import ColorVisuals

        self._meshes = meshes
        self._handles: list[Any] = []
        for piece in meshes.pieces:
            mesh = trimesh.Trimesh(piece.vertices, piece.faces, process=False)
            mesh.visual = ColorVisuals(mesh, face_colors=piece.colors)
            self._handles.append(
                server.scene.add_mesh_trimesh(
                    f"{name}/{piece.name}", mesh, cast_shadow=False, receive_shadow=False
                )
            )

    def move(self, q: Array) -> None:
        """Draw the arm at joint angles [rad], shape [6]."""
        for handle, quat, position in zip(self._handles, *self._meshes.poses(q), strict=True):
            handle.wxyz, handle.position = quat, position

    @property
    def visible(self) -> bool:
        """True while it is drawn."""
        return bool(self._handles[0].visible)

    @visible.setter
    def visible(self, visible: bool) -> None:
        if visible != self.visible:
            for handle in self._handles:
                handle.visible = visible

    def remove(self) -> None:
        """Take it out of the scene."""
        for handle in self._handles:
            handle.remove()


def _compile(path: pathlib.Path) -> tuple[Any, Any]:
    """Return MuJoCo and the compiled model of a file."""
    try:
        import mujoco as library
    except ImportError:
        raise MissingExtraError("mujoco", "view", "an arm drawn with meshes") from None
    mujoco: Any = library
    if not path.is_file():
        raise InputError(f"{path} is not a file")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        # A URDF has meshes to show beside those to collide with.
        spec.compiler.discardvisual = False
        return mujoco, spec.compile()
    except (ValueError, OSError) as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from error


def _joint(mujoco: Any, model: Any, name: str, path: pathlib.Path) -> int:
    """Return the number of the joint with this name, or with this name after a prefix."""
    names = [model.joint(index).name for index in range(model.njnt)]
    found = [index for index, own in enumerate(names) if own.endswith(name)]
    if len(found) != 1 or model.jnt_type[found[0]] != mujoco.mjtJoint.mjJNT_HINGE:
        raise InputError(f"{path} has {len(found)} joints named {name!r}, not 1; it has {names}")
    return found[0]


def _piece(mujoco: Any, model: Any, body: int, geoms: NDArray[np.int64]) -> Piece:
    """Return the meshes of a body as one, in the body's frame."""
    vertices, faces, colors, count = [], [], [], 0
    for geom in geoms:
        mesh = model.mesh(model.geom_dataid[geom])
        first, number = mesh.vertadr[0], mesh.vertnum[0]
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        own = model.mesh_vert[first : first + number] @ turn.reshape(3, 3).T + model.geom_pos[geom]
        first_face, face_number = mesh.faceadr[0], mesh.facenum[0]
        vertices.append(own)
        faces.append(model.mesh_face[first_face : first_face + face_number] + count)
        material = model.geom_matid[geom]
        rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        colors.append(np.tile(np.round(255 * rgba).astype(np.uint8), (face_number, 1)))
        count += number
    return Piece(
        name=model.body(body).name or f"body_{body}",
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces),
        colors=np.concatenate(colors),
    )


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


EXPECTED_SHARE = 0.9
"""Share of the landings that the ellipse of a plan holds."""

_EARLIER = (123, 135, 148)  # Colour of the landings before the last.
_TEXT_HEIGHT = 0.07  # Of the text at a landing [m].
_TEXT_AWAY = 0.1  # Distance of that text from the landing [m].
_TEXT_ROOM = np.array([0.22, 0.08])  # Nearer to the last text, an earlier number is left out [m].
_TEXT_LIFT = 0.03  # Height of that text, above any cable on the table [m].
_THICKNESS = 0.04  # Of the table's top [m].
_AXIS = 0.28  # Length of the base frame's axes, which end beyond the arm's foot [m].


class Room:
    """Table, scale and base frame, which do not move.

    Args:
        server: Server of the page.
        setup: Set-up with table and cable.
        paint: Colours.
    """

    def __init__(self, server: "viser.ViserServer", setup: Setup, paint: Paint = LIGHT):
        self._server, self._setup = server, setup
        self.paint = paint
        self._blind: tuple[tuple[float, float, float], ...] = ()
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
            table_lines(self._setup, 0.25, LIFT / 2).astype(np.float32),
            paint.line,
            thickness=1.0,
            thickness_units="screen",
        )
        scene.add_line_segments(
            "/room/reach",
            reach_arc(self._setup, LIFT).astype(np.float32),
            paint.reach,
            thickness=2.0,
            thickness_units="screen",
        )
        edge = table.y_min - 0.07
        for x in np.arange(np.ceil(2 * -table.half_width) / 2, table.half_width + 1e-6, 0.5):
            self._label(f"x/{x:g}".replace("-", "m").replace(".", "_"), f"{x:g} m", (x, edge, 0.0))
        for y in np.arange(0.5 * max(1, np.ceil(2 * table.y_min)), table.y_max + 1e-6, 0.5):
            place = (-table.half_width - 0.13, float(y), 0.0)
            self._label(f"y/{y:g}".replace(".", "_"), f"{y:g} m", place)
        scene.add_frame(
            "/room/base", axes_length=_AXIS, axes_radius=0.006, position=(0.0, 0.0, 0.004)
        )
        self._label("axis_x", "x", (_AXIS + 0.05, 0.03, LIFT))
        self._label("axis_y", "y", (0.03, _AXIS + 0.03, LIFT))
        self._draw_blind()

    def set_sight(self, sight: CameraSight | None) -> None:
        """Mark the places on the table that the camera is blind at, where they are known."""
        blind = () if sight is None else sight.blind
        if blind != self._blind:
            self._blind = blind
            self._draw_blind()

    def _draw_blind(self) -> None:
        """Hatch the blind places, over what was there."""
        self._server.scene.remove_by_name("/room/blind")
        for number, (x, y, radius) in enumerate(self._blind):
            name = f"/room/blind/{number}"
            self._server.scene.add_line_segments(
                f"{name}/hatch",
                hatched_circle((x, y), radius, LIFT).astype(np.float32),
                self.paint.reach,
                thickness=1.0,
                thickness_units="screen",
            )
            # On the near side, where it hides no target in the place.
            below = (x, y - radius - _TEXT_HEIGHT / 2, LIFT)
            color = self.paint.text
            add_text(self._server, f"{name}/label", "not seen", below, color, _TEXT_HEIGHT)

    def _label(self, name: str, text: str, position: tuple[float, float, float]) -> None:
        add_text(self._server, f"/room/scale/{name}", text, position, self.paint.text)


class Marks:
    """Target, expectation and landings on the table.

    Args:
        server: Server of the page.
        setup: Set-up with the cable.
    """

    def __init__(self, server: "viser.ViserServer", setup: Setup):
        self._server, self._setup = server, setup
        self._paint = LIGHT
        self._tries: list[AimTrial] = []

    def repaint(self, paint: Paint) -> None:
        """Take the colours of a light or dark scene."""
        self._paint = paint
        self.landings(self._tries)

    def clear(self) -> None:
        """Take all marks away."""
        self._tries = []
        for name in ("target", "expected", "tries"):
            self._server.scene.remove_by_name(f"/marks/{name}")

    def target(self, xy: NDArray[np.float64]) -> None:
        """Draw the target as two rings and a cross."""
        x, y = float(xy[0]), float(xy[1])
        cross = np.array(
            [
                [[x - 0.06, y, 2 * LIFT], [x + 0.06, y, 2 * LIFT]],
                [[x, y - 0.06, 2 * LIFT], [x, y + 0.06, 2 * LIFT]],
            ]
        )
        lines = [circle(xy, 0.02, 2 * LIFT), circle(xy, 0.045, 2 * LIFT), cross]
        self._server.scene.add_line_segments(
            "/marks/target",
            np.concatenate(lines).astype(np.float32),
            VERMILLION,
            thickness=3.0,
            thickness_units="screen",
        )

    def expectation(self, proposal: AimProposal) -> None:
        """Draw the expected landing, and the ellipse that nine of ten landings lie in."""
        outline = ellipse_points(proposal, EXPECTED_SHARE)
        lines = [circle(proposal.expected_xy, 0.012, 2 * LIFT), polyline(level(outline, 2 * LIFT))]
        self._server.scene.add_line_segments(
            "/marks/expected",
            np.concatenate(lines).astype(np.float32),
            GREEN,
            thickness=2.5,
            thickness_units="screen",
        )

    def landings(self, trials: list[AimTrial]) -> None:
        """Draw the landings of tries at one target, numbered, each with a line to the target."""
        scene = self._server.scene
        scene.remove_by_name("/marks/tries")
        self._tries = trials
        length = self._setup.cable.length
        for one in trials:
            if not np.all(np.isfinite(one.final_xy)):
                continue
            name, is_last = f"/marks/tries/{one.number}", one is trials[-1]
            x, y = map(float, one.final_xy)
            color = self._paint.text if is_last else _EARLIER
            scene.add_icosphere(
                f"{name}/ball", 0.014, color, position=(x, y, 0.012), cast_shadow=False
            )
            ends = level(np.stack([one.target_xy, one.final_xy]), 3 * LIFT)
            scene.add_line_segments(
                f"{name}/miss",
                ends[None].astype(np.float32),
                color,
                thickness=2.5 if is_last else 1.0,
                thickness_units="screen",
            )
            text = f"{one.try_number}"
            if is_last:
                text += f":  {one.miss_pct * length:.1f} cm, {one.miss_pct:.1f} %"
            if is_last or np.any(np.abs(_text_xy(one) - _text_xy(trials[-1])) > _TEXT_ROOM):
                x, y = _text_xy(one)
                place = (float(x), float(y), _TEXT_LIFT)
                plate = self._paint.page
                add_text(self._server, f"{name}/label", text, place, color, _TEXT_HEIGHT, plate)


def _text_xy(one: AimTrial) -> NDArray[np.float64]:
    """Return where the text of a landing lies: on its far side, where it hides no target."""
    beside = _TEXT_AWAY if one.final_xy[1] >= one.target_xy[1] else -_TEXT_AWAY
    return one.final_xy + [0.0, beside]


def start_server(host: str, port: int) -> "viser.ViserServer":
    """Start a server of the page.

    Args:
        host: Address to listen on.
        port: Port to listen on; the next free one if it is taken.

    Raises:
        MissingExtraError: viser is not installed.
        InputError: The address cannot be listened on.
    """
    try:
        import viser
    except ImportError:
        raise MissingExtraError("viser", "view", "the page") from None
    try:
        # It prints a table of addresses whatever it is told; ours is printed by the command.
        with contextlib.redirect_stdout(io.StringIO()):
            return viser.ViserServer(host=host, port=port, label="cablecast", verbose=False)
    except OSError as error:
        raise InputError(f"host {host!r}, port {port} cannot be listened on: {error}") from None


def stop_server(server: "viser.ViserServer") -> None:
    """Stop a server, as quietly as it was started."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()
