"""Arms from description files: URDF or MJCF, read by MuJoCo, and MuJoCo Menagerie."""

import dataclasses
import itertools
import os
import pathlib
import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.base import Arm, JointLimits
from cablecast.arm.serial import ArmSerial
from cablecast.arm.ur import ArmUR
from cablecast.conventions import stream
from cablecast.errors import (
    InputError,
    MissingExtraError,
    UnknownNameError,
    check_keys,
    check_number,
)
from cablecast.files import SIZE_MAX, read_bytes

ACCELERATION = 20.0
"""Largest acceleration of a joint where neither the file nor its torques tell less [rad/s²]."""
ACCELERATION_MIN = 1.0
"""Least acceleration of a joint that is taken from its torque [rad/s²]."""
TORQUE_SHARE = 0.6
"""Share of a joint's torque that is left for gravity and acceleration [-]."""
LINK_RADIUS = 0.06
"""Radius of a link without geometry in the file [m]."""

_CABLE_AXES = {"-y": 0.0, "x": 90.0, "y": 180.0, "-x": -90.0}
"""Turn of the flange about its z that brings -y to the axis along which the cable leaves [deg]."""

_SOURCES = ("file", "menagerie")
_FILE_KEYS = {"tip", "base_joint", "cable_axis", "link_radius", "limits", "posture"}
_MOUNT_KEYS = {"base_height", "base_yaw_deg", "gripper_length", "grip_offset", "measured"}
_TENSOR = ("xx", "xy", "xz", "yy", "yz", "zz")
_UPRIGHT = 1e-3  # Largest sine of the base axis' tilt.
_RANGE_FREE = 2 * np.pi  # Largest angle of a joint without limits [rad].
_POSE_COUNT = 256  # Random postures over which inertia and gravity are looked at.


def arm_from_dict(values: Any, folder: str | os.PathLike[str] | None = None) -> Arm:
    """Make an arm from the values of a lab file or of `Arm.to_dict`.

    Args:
        values: Keys of an `ArmUR`; or `file` or `menagerie` with those of a description; or those
            of an `ArmSerial`.
        folder: Folder to which `file` is relative.

    Raises:
        InputError: A key is unknown, a value out of bounds, or the description is of no use.
        UnknownNameError: There is no such model, file, joint or frame.
        MissingExtraError: MuJoCo is needed and not installed.
    """
    if isinstance(values, Mapping) and "names" in values:
        return ArmSerial.from_dict(values)
    if not isinstance(values, Mapping) or not any(key in values for key in _SOURCES):
        return ArmUR.from_dict(values)
    known = {*_SOURCES, *_FILE_KEYS, *_MOUNT_KEYS}
    values = check_keys(values, known, "a described arm", required={"tip"})
    if all(key in values for key in _SOURCES):
        raise InputError("arm has both file and menagerie: give one of them")
    mount = {key: values.pop(key) for key in _MOUNT_KEYS & set(values)}
    if "menagerie" in values:
        name = str(values.pop("menagerie"))
        return _arm(name, name, _menagerie(name), {}, True, mount, **values)
    path = pathlib.Path(folder or ".") / str(values.pop("file"))
    return _arm(path.stem, str(path), *_read(path), mount, **values)


def _library() -> Any:
    try:
        import mujoco
    except ImportError:
        raise MissingExtraError("mujoco", "mujoco", "an arm from a description file") from None
    return mujoco


def _menagerie(name: str) -> Any:
    """Return the MuJoCo specification of a robot of MuJoCo Menagerie, which may be downloaded."""
    _library()
    try:
        import mujoco_menagerie  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise InputError(
            f"arm menagerie = {name[:40]!r} needs the package mujoco-menagerie: pip install "
            "mujoco-menagerie"
        ) from None
    if name not in mujoco_menagerie.names():
        raise UnknownNameError(f"MuJoCo Menagerie has no robot {name[:40]!r}")
    try:
        robot = mujoco_menagerie.get(name)
        return robot.spec(robot.default_model)
    except Exception as error:
        line = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(
            f"MuJoCo Menagerie, which is downloaded at first use, does not give {name}: {line}. "
            "Without the internet, give `file:` with the arm's URDF or MJCF"
        ) from None


class _Stated(NamedTuple):
    """What a URDF says of a joint: type, range [rad] (None without one) and speed [rad/s]."""

    kind: str
    range: tuple[float, float] | None
    speed: float | None
    bounds: str = ""


def _read(path: pathlib.Path) -> tuple[Any, dict[str, _Stated], bool]:
    """Return the MuJoCo specification of a file, the joints of a URDF, and whether it has dynamics.

    A URDF is given to MuJoCo without materials and ranges, which MuJoCo reads as another does not.
    """
    mujoco = _library()
    try:
        # The XML says its encoding.
        root = ElementTree.fromstring(read_bytes(path, SIZE_MAX))
    except FileNotFoundError:
        raise UnknownNameError(f"there is no arm description {path}") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise InputError(f"{path} is not XML: {error}") from None
    if root.tag not in ("robot", "mujoco"):
        raise InputError(f"{path} is neither URDF nor MJCF: it begins with <{root.tag[:40]}>")
    if any("xacro" in element.tag for element in root.iter()):
        raise InputError(f"{path} is a xacro file: make a URDF of it with the program xacro")
    joints, has_dynamics = {}, True
    for joint in root.findall("joint") if root.tag == "robot" else ():
        if (name := joint.get("name", "")) in joints:
            raise InputError(f"{path} names two joints {name[:40]!r}: give each a name of its own")
        joints[name] = _stated(path, name, joint)
    try:
        if root.tag == "mujoco":
            spec = mujoco.MjSpec.from_file(str(path))
        else:
            for parent in list(root.iter()):
                for material in parent.findall("material"):
                    parent.remove(material)
            has_dynamics = _has_dynamics(root)
            for link in root.findall("link") if not has_dynamics else ():
                # What only dynamics needs is no reason to refuse the chain.
                for inertial in link.findall("inertial"):
                    link.remove(inertial)
            spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
            spec.modelfiledir = str(path.parent)
    except (ValueError, OSError) as error:
        raise InputError(f"{path}: {' '.join(str(error).split())}") from None
    # ROS names meshes by package; look for them next to the file.
    for mesh in spec.meshes:
        parts = pathlib.PurePosixPath(mesh.file).parts
        for start in range(len(parts)):
            if (found := path.parent / pathlib.Path(*parts[start:])).is_file():
                mesh.file = str(found.resolve())
                break
    return spec, joints, has_dynamics


def _has_dynamics(urdf: ElementTree.Element) -> bool:
    """Return whether each link that a joint moves states its inertia, unless it is a bare frame."""
    moved = {child.get("link") for joint in urdf.findall("joint") for child in joint.iter("child")}
    stated = []
    for link in urdf.findall("link"):
        inertial = link.find("inertial")
        least = None if inertial is None else _least_inertia(inertial)
        if least is not None and (least < 0.0 or not np.isfinite(least)):
            return False
        if link.get("name") in moved and not least and any(link.iter("geometry")):
            return False
        stated.append(bool(least))
    return any(stated)


def _least_inertia(inertial: ElementTree.Element) -> float:
    """Return the least of a link's mass [kg] and principal inertias [kg m²]; NaN if one is none."""
    try:
        tags = {element.tag: element for element in inertial}
        mass, tensor = float(tags["mass"].get("value", "0")), tags["inertia"]
        xx, xy, xz, yy, yz, zz = (float(tensor.get(f"i{k}", "0")) for k in _TENSOR)
        inertia = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    except (KeyError, ValueError, np.linalg.LinAlgError):
        return float("nan")
    return float(min(mass, *inertia))


def _stated(path: pathlib.Path, name: str, joint: ElementTree.Element) -> _Stated:
    """Return what a URDF states of a joint, and take the range from it."""
    values: dict[str, float] = {}
    limit = joint.find("limit")
    for key in ("lower", "upper", "velocity", "effort"):
        text = None if limit is None else limit.get(key)
        if limit is None or text is None:
            continue
        try:
            values[key] = float(text)
        except ValueError:
            raise InputError(
                f"{path}: {key} of joint {name[:40]!r} = {text[:40]!r} is not a number"
            ) from None
        if key != "velocity" and not (key == "effort" and 0.0 < values[key] < np.inf):
            del limit.attrib[key]
    kind = "mimic" if joint.find("mimic") is not None else joint.get("type", "")
    low, high = values.get("lower", 0.0), values.get("upper", 0.0)
    if kind == "continuous" or (low, high) == (-np.inf, np.inf):
        low, high = -_RANGE_FREE, _RANGE_FREE
    speed = values.get("velocity", 0.0)
    return _Stated(
        kind,
        (low, high) if -np.inf < low < high < np.inf else None,
        speed if 0.0 < speed < np.inf else None,
        ", ".join(f"{key} = {values[key]:g}" for key in ("lower", "upper") if key in values),
    )


def _arm(
    name: str,
    where: str,
    spec: Any,
    stated: dict[str, _Stated],
    has_dynamics: bool,
    mount: dict[str, Any],
    *,
    tip: str,
    base_joint: str | None = None,
    cable_axis: str = "-y",
    link_radius: float = LINK_RADIUS,
    limits: Mapping[str, Any] | None = None,
    posture: Any = None,
) -> ArmSerial:
    """Return a described arm, mounted and with its gripper.

    Args:
        name: Name of the arm.
        where: File or robot, for errors.
        spec: MuJoCo specification.
        stated: What a URDF says of each joint.
        has_dynamics: Whether the inertia of the links is known.
        mount: Mounting and gripper.
        tip: Body or site that is the flange; its z points out of it.
        base_joint: Joint that turns the arm about the vertical; the first if None.
        cable_axis: Axis of the tip along which the cable leaves.
        link_radius: Radius of links without geometry [m].
        limits: Limits that replace those of the file.
        posture: Posture near which the arm works [rad].
    """
    link_radius = check_number("arm link_radius", link_radius, 0.005, 0.5, "m")
    if not isinstance(cable_axis, str) or cable_axis not in _CABLE_AXES:
        raise InputError(
            f"arm cable_axis = {str(cable_axis)[:20]!r}: one of {', '.join(_CABLE_AXES)}"
        )
    given = check_keys(
        limits or {}, {f.name for f in dataclasses.fields(JointLimits)}, "arm limits"
    )
    mujoco = _library()
    model = _compiled(spec, where)
    data = mujoco.MjData(model)
    end, body = _find_tip(model, data, str(tip), where)
    joints = _find_joints(model, body, base_joint, where)
    names = tuple(model.joint(joint).name for joint in joints)
    data.qpos[model.jnt_qposadr[joints]] = 0.0
    mujoco.mj_kinematics(model, data)
    frames = [_frame(model, data, joint) for joint in joints]
    _check_upright(model, data, joints[0], frames[0], where)
    flange = np.eye(4)
    flange[:3, :3] = end.xmat.reshape(3, 3)
    flange[:3, 3] = end.xpos
    c, s = (f(np.radians(_CABLE_AXES[cable_axis])) for f in (np.cos, np.sin))
    flange[:3, :2] = flange[:3, :2] @ [[c, -s], [s, c]]
    frames.append(flange)
    axis = np.array([*frames[0][:2, 3], 0.0])
    for frame in frames:
        frame[:3, 3] -= axis
    if posture is not None:
        if not isinstance(posture, list | tuple) or len(posture) != len(names):
            raise InputError(f"arm posture must be {len(names)} angles")
        posture = tuple(check_number("arm posture", q, -20.0, 20.0, "rad") for q in posture)
    steps: list[Any] = [np.linalg.solve(a, b) for a, b in itertools.pairwise(frames)]
    capsules = [
        _capsule(_link_points(model, data, joint) - axis, step, frame, link_radius)
        for joint, step, frame in zip(joints, steps, frames[1:], strict=True)
    ]
    return ArmSerial(
        model=name,
        names=names,
        offsets=tuple(_offset(T) for T in (frames[0], *steps)),
        capsules=tuple(capsules),
        posture=posture,
        limits=_limits(model, data, joints, stated, has_dynamics, given, where),
        **mount,
    )


def _compiled(spec: Any, where: str) -> Any:
    compiler = spec.compiler
    # Keep the frames of links that are fixed to others, and forgive what only dynamics needs.
    compiler.fusestatic, compiler.balanceinertia = False, True
    compiler.boundmass, compiler.boundinertia = 1e-6, 1e-9
    try:
        return spec.compile()
    except ValueError:
        # Without the meshes that lie elsewhere, the chain and the other shapes are still known.
        folder = pathlib.Path(spec.modelfiledir or ".")
        places = (folder / spec.meshdir, folder)
        missing = [
            mesh
            for mesh in spec.meshes
            if not any((place / mesh.file).is_file() for place in places)
        ]
        names = {mesh.name for mesh in missing}
        for row in [*(geom for geom in spec.geoms if geom.meshname in names), *missing]:
            spec.delete(row)
    try:
        return spec.compile()
    except ValueError:
        for rows in (spec.geoms, spec.meshes, spec.textures, spec.materials):
            for row in list(rows):
                spec.delete(row)
    try:
        return spec.compile()
    except ValueError as error:
        raise InputError(f"{where}: {' '.join(str(error).split())}") from None


def _find_tip(model: Any, data: Any, tip: str, where: str) -> tuple[Any, int]:
    """Return the frame of the tip, and the body that it belongs to."""
    for kind in ("body", "site"):
        try:
            found = getattr(model, kind)(tip)
        except KeyError:
            continue
        body = found.id if kind == "body" else int(model.site_bodyid[found.id])
        return getattr(data, kind)(tip), body
    names = [model.body(i).name for i in range(1, model.nbody)]
    names += [model.site(i).name for i in range(model.nsite)]
    raise UnknownNameError(
        f"{where} has no frame {tip[:40]!r} for the tip; it has {', '.join(names)[:300]}"
    )


def _find_joints(model: Any, body: int, base_joint: str | None, where: str) -> list[int]:
    joints: list[int] = []
    while body:
        first = int(model.body_jntadr[body])
        joints[:0] = range(first, first + int(model.body_jntnum[body]))
        body = int(model.body_parentid[body])
    names = [model.joint(joint).name for joint in joints]
    if base_joint is not None and base_joint not in names:
        raise UnknownNameError(
            f"no joint {str(base_joint)[:40]!r} moves the tip of {where}; these do: "
            f"{', '.join(names)[:300]}"
        )
    if base_joint is not None:
        joints = joints[names.index(base_joint) :]
    if not joints:
        raise InputError(f"no joint of {where} moves the tip")
    kinds = _library().mjtJoint
    words = {
        kinds.mjJNT_SLIDE: "slides",
        kinds.mjJNT_BALL: "is a ball",
        kinds.mjJNT_FREE: "is free",
    }
    for joint in joints:
        if (word := words.get(kinds(model.jnt_type[joint]))) is not None:
            raise InputError(
                f"joint {model.joint(joint).name!r} of {where} {word}: from the base "
                "joint to the tip only hinges are supported"
            )
    return joints


def _frame(model: Any, data: Any, joint: int) -> NDArray[np.float64]:
    """Return the pose of a joint that turns about z, in the world of the file."""
    axis = data.xaxis[joint]
    body = data.xmat[model.jnt_bodyid[joint]].reshape(3, 3)
    across = body[:, int(np.argmin(np.abs(axis @ body)))]
    across = across - (across @ axis) * axis
    frame = np.eye(4)
    frame[:3, 0] = across / np.linalg.norm(across)
    frame[:3, 1] = np.cross(axis, frame[:3, 0])
    frame[:3, 2], frame[:3, 3] = axis, data.xanchor[joint]
    return frame


def _check_upright(
    model: Any, data: Any, joint: int, base: NDArray[np.float64], where: str
) -> None:
    tilt = float(np.hypot(*base[:2, 2]))
    if tilt > _UPRIGHT:
        angle = np.degrees(np.arctan2(tilt, abs(base[2, 2])))
        raise InputError(
            f"the base axis, joint {model.joint(joint).name!r} of {where}, is tilted by "
            f"{angle:.1f} deg: only arms that stand upright are supported"
        )
    body = int(model.jnt_bodyid[joint])
    body = int(model.body_parentid[body]) or body
    if data.xmat[body].reshape(3, 3)[2, 2] < 0.0:
        raise InputError(
            f"the base of {where} hangs, its z axis points down: only arms that stand "
            "upright are supported"
        )


def _limits(
    model: Any,
    data: Any,
    joints: list[int],
    stated: dict[str, _Stated],
    has_dynamics: bool,
    given: dict[str, Any],
    where: str,
) -> JointLimits:
    names = [model.joint(joint).name for joint in joints]
    # MJCF states limits to MuJoCo, which has no speeds.
    rows = [
        stated.get(name) or _of_mujoco(model, at) for name, at in zip(names, joints, strict=True)
    ]
    known: dict[str, Any] = {}
    for name, row in zip(names, rows, strict=True):
        if row.kind == "mimic":
            raise InputError(
                f"joint {name!r} of {where} moves with another one (mimic): from the base "
                "joint to the tip each must move by itself"
            )
        if "position" not in given and row.range is None:
            raise InputError(
                f"{where} states no range of joint {name!r}"
                f"{f', its limit has {row.bounds}' if row.bounds else ''}: give position for "
                "all joints under limits in the lab file [rad]"
            )
        if "velocity" not in given and row.speed is None:
            raise InputError(
                f"{where} states no speed of joint {name!r}: give velocity for all "
                "joints under limits in the lab file [rad/s]"
            )
    low, high = np.array([row.range or (-_RANGE_FREE, _RANGE_FREE) for row in rows]).T
    if "position" not in given:
        known["position"] = tuple(((high - low) / 2).tolist())
        known["middle"] = tuple(((high + low) / 2).tolist())
    if "velocity" not in given:
        known["velocity"] = tuple(row.speed for row in rows)
    if "acceleration" not in given:
        found = np.full(len(joints), ACCELERATION)
        if has_dynamics:
            found = _accelerations(model, data, joints, low, high)
        known["acceleration"] = tuple(found.tolist())
        weak = [name for name, a in zip(names, found, strict=True) if a <= ACCELERATION_MIN]
        why = "" if has_dynamics else "does not state the inertia of each link well"
        if weak:
            why = f"leaves joint {', '.join(weak)} no torque beyond gravity for more"
        if why:
            warnings.warn(
                f"{where} {why}: accelerations of {min(found):g} to {max(found):g} rad/s² are "
                "assumed. Give acceleration under limits in the lab file",
                stacklevel=2,
            )
    return JointLimits.from_dict(given, len(joints), known)


def _of_mujoco(model: Any, joint: int) -> _Stated:
    low, high = model.jnt_range[joint].tolist()
    if not model.jnt_limited[joint]:
        low, high = -_RANGE_FREE, _RANGE_FREE
    return _Stated("", (low, high) if low < high else None, None)


def _accelerations(
    model: Any,
    data: Any,
    joints: list[int],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return what the joints' torques give, where the file tells them, at most ACCELERATION."""
    mujoco = _library()
    dofs = model.jnt_dofadr[joints]
    torque = np.full(len(dofs), np.inf)
    for at, joint in enumerate(joints):
        if model.jnt_actfrclimited[joint]:
            torque[at] = model.jnt_actfrcrange[joint, 1]
        drives = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
        for actuator in np.flatnonzero(drives & (model.actuator_trnid[:, 0] == joint)):
            if model.actuator_forcelimited[actuator]:
                gear = abs(model.actuator_gear[actuator, 0])
                torque[at] = gear * model.actuator_forcerange[actuator, 1]
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    mass, rng = np.zeros((model.nv, model.nv)), stream(0, "poses of an arm")
    found = np.empty((_POSE_COUNT, len(dofs)))
    for pose in found:
        data.qpos[model.jnt_qposadr[joints]] = rng.uniform(low, high)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        pose[:] = (TORQUE_SHARE * torque - np.abs(data.qfrc_bias[dofs])) / np.diag(mass)[dofs]
    return np.quantile(np.clip(found, ACCELERATION_MIN, ACCELERATION), 0.1, axis=0)


def _capsule(
    points: NDArray[np.float64],
    step: NDArray[np.float64],
    frame: NDArray[np.float64],
    link_radius: float,
) -> tuple[float, ...]:
    """Return a capsule about a link, in the frame at its end: both ends, and two radii.

    It follows the points on the link's surface along their longest direction; without points it
    reaches from joint to joint. Nine points of ten lie within the first radius, all of them within
    the second.
    """
    if not len(points):
        start = (-step[:3, :3].T @ step[:3, 3]).tolist()
        return (*start, 0.0, 0.0, 0.0, link_radius, link_radius)
    points = (points - frame[:3, 3]) @ frame[:3, :3]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    way = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    along = (points - middle) @ way
    off = np.linalg.norm(points - middle - along[:, None] * way, axis=1)
    radius = float(np.quantile(off, 0.9))
    low, high = along.min() + radius, max(along.max() - radius, along.min() + radius)
    beyond = along - np.clip(along, low, high)
    farthest = float(np.hypot(off, beyond).max())
    ends = (*(middle + low * way).tolist(), *(middle + high * way).tolist())
    return (*ends, radius, max(radius, farthest))


def _link_points(model: Any, data: Any, joint: int) -> NDArray[np.float64]:
    """Return points on the surface of the link that a joint moves, in the world [m], [point, 3]."""
    owned = model.body_weldid[model.geom_bodyid] == model.jnt_bodyid[joint]
    found = [np.empty((0, 3))]
    for geom in np.flatnonzero(owned):
        if model.geom_type[geom] == _library().mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            points = model.mesh_vert[first : first + count]
        else:
            middle, half = np.split(model.geom_aabb[geom], 2)
            points = middle + np.concatenate([np.diag(half), -np.diag(half)])
        found.append(points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    return np.concatenate(found)


def _offset(T: NDArray[np.float64]) -> tuple[float, ...]:
    from scipy.spatial.transform import Rotation

    quat: Any = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
    return tuple(float(value) for value in (*T[:3, 3], *quat))
