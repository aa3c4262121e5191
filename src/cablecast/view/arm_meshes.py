"""The arm as its maker drew it: the meshes of an MJCF or URDF file, placed by the arm's joints."""

import dataclasses
import os
import pathlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm
from cablecast.arm.ur import ArmUR
from cablecast.conventions import stream
from cablecast.errors import InputError, MissingExtraError
from cablecast.view.shapes import Array, Color

JOINT_NAMES = (
    "shoulder_pan_joint",
    "shoulder_lift_joint",
    "elbow_joint",
    "wrist_1_joint",
    "wrist_2_joint",
    "wrist_3_joint",
)
"""Joints of a UR, as the maker's own robot description names them; a prefix may precede."""

MISFIT_MAX = 0.005
"""Largest distance of a wrist of the file from that of the set-up's arm [m]."""

_FACE_COUNT_MAX = 400_000
_POSE_COUNT = 24  # Poses at which the two arms are compared.


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """Vertices [m], shape [vertex, 3], and triangles of a mesh, in the frame of its body."""

    vertices: Array
    faces: NDArray[np.integer]
    color: Color


class ArmMeshes:
    """Meshes of an MJCF or URDF file and where they are at given joint angles.

    The file is compiled by MuJoCo, which reads meshes of the formats STL, OBJ and MSH. The last two
    joints of the set-up's arm must be where those of the file are.

    Attributes:
        pieces: Meshes by name: that of the body, and a number.

    Raises:
        InputError: The file cannot be read, has no such joints or no mesh, or is another arm.
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(self, path: str | os.PathLike[str], arm: Arm):
        path = pathlib.Path(path)
        self._mujoco, self._model = _compile(path)
        self._data = self._mujoco.MjData(self._model)
        names = JOINT_NAMES if isinstance(arm, ArmUR) else arm.joint_names
        self._joints = [_joint(self._mujoco, self._model, name, path) for name in names]
        self.pieces: dict[str, Piece] = {}
        self._bodies: list[int] = []
        self._read_pieces(path)
        # From the world of the file to the base frame of the set-up.
        self._turn, self._shift = np.eye(3), np.zeros(3)
        self._align(path, arm)

    def poses(self, q: Array) -> tuple[Array, Array]:
        """Return the pose of each piece at joint angles [rad], shape [joint].

        Rotations are quaternions w, x, y, z, shape [piece, 4], positions [m], shape [piece, 3].
        """
        from scipy.spatial.transform import Rotation

        self._set_joints(q)
        turns = self._turn @ self._data.xmat[self._bodies].reshape(-1, 3, 3)
        quats = Rotation.from_matrix(turns).as_quat(scalar_first=True)
        return quats, self._data.xpos[self._bodies] @ self._turn.T + self._shift

    def _set_joints(self, q: Array) -> None:
        self._data.qpos[self._model.jnt_qposadr[self._joints]] = q
        self._mujoco.mj_kinematics(self._model, self._data)

    def _read_pieces(self, path: pathlib.Path) -> None:
        """Read the bodies that have meshes, and their meshes."""
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
        self._bodies = model.geom_bodyid[geoms].tolist()
        for geom, body in zip(geoms.tolist(), self._bodies, strict=True):
            self.pieces[f"{model.body(body).name or body}_{geom}"] = _piece(model, geom)

    def _align(self, path: pathlib.Path, arm: Arm) -> None:
        """Find how the file stands to the base frame, and refuse the file of another arm."""
        from scipy.spatial.transform import Rotation

        rng = stream(0, "poses of an arm")
        q = rng.uniform(-2.0, 2.0, (_POSE_COUNT, arm.joint_count))
        frames = arm.frames(q)
        ours = np.stack([T[..., :3, 3] for T in frames[-3:-1]], axis=1).reshape(-1, 3)
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
        for mesh in spec.meshes:
            mesh.file = _found_mesh(mesh.file, path.resolve().parent)
        # A URDF has meshes to show and others to collide with.
        spec.compiler.discardvisual = False
        return mujoco, spec.compile()
    except (ValueError, OSError) as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from error


def _found_mesh(file: str, folder: pathlib.Path) -> str:
    """Return the path of a mesh that a URDF gives as package://NAME/PATH; others as they are."""
    name = file.partition("package:")[2].lstrip("/")
    if not name:
        return file
    # The package may be the folder of the file, or a folder above it.
    within = name.partition("/")[2]
    places = [folder / name, *(above / within for above in (folder, *folder.parents))]
    return str(next((place for place in places if place.is_file()), file))


def _joint(mujoco: Any, model: Any, name: str, path: pathlib.Path) -> int:
    """Return the number of the joint with this name, or with this name after a prefix."""
    names = [model.joint(index).name for index in range(model.njnt)]
    found = [index for index, own in enumerate(names) if own == name]
    found = found or [index for index, own in enumerate(names) if own.endswith(name)]
    if len(found) != 1 or model.jnt_type[found[0]] != mujoco.mjtJoint.mjJNT_HINGE:
        raise InputError(f"{path} has {len(found)} joints named {name!r}, not 1; it has {names}")
    return found[0]


def _piece(model: Any, geom: int) -> Piece:
    """Return a mesh in the frame of its body."""
    from scipy.spatial.transform import Rotation

    mesh, material = model.mesh(model.geom_dataid[geom]), model.geom_matid[geom]
    vertices = model.mesh_vert[mesh.vertadr[0] :][: mesh.vertnum[0]]
    turn = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    red, green, blue = np.round(255 * rgba[:3]).astype(int).tolist()
    return Piece(
        vertices=turn.apply(vertices) + model.geom_pos[geom],
        faces=model.mesh_face[mesh.faceadr[0] :][: mesh.facenum[0]],
        color=(red, green, blue),
    )
