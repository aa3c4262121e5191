"""The rope-whipping world of Iterative Residual Policy, rebuilt in MuJoCo from its published facts.

Chi, Burchfiel, Cousineau, Feng and Song, "Iterative Residual Policy for Goal-Conditioned Dynamic
Manipulation of Deformable Objects" (RSS 2022, arXiv 2203.00663), and the settings of their
repository. A UR5 swings a stick with a rope at its end in a vertical plane: elbow and first wrist
joint move, from a start in which the rope hangs. The tip's path ends at the first contact.

What could not be had: the meshes of the arm (here it is made of the library's capsules), and which
ropes and goals were drawn (here by a seed).
"""

import dataclasses
import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.arm.shape import arm_shape
from cablecast.arm.ur import ArmUR
from cablecast.conventions import Array

START_DEG = (0.0, -70.0, 150.0, -170.0, -90.0, 0.0)
"""Joints at the start [deg]."""
MOVING = (2, 3)
"""Joints that move: elbow and first wrist joint."""
SPEEDS = (1.0, 3.14)
"""Range of the speed of the joint that moves most [rad/s]."""
TURNS_DEG = ((-60.0, -180.0), (60.0, -120.0))
"""Range by which each of them moves [deg]."""
RAMP_TIME = 0.1
"""Duration of a ramp [s]: in the simulator the acceleration grows with the speed."""
DT, RECORD_STEPS, DURATION = 1e-3, 10, 4.0
"""Step [s], steps between two records, and duration of a swing [s]."""
KP, ARMATURE = 3000.0, 1000.0
"""Gain of the joints' controller [1/s²], whose damping is its root, and inertia of a rotor."""

FLANGE_BEYOND = 0.00935
"""Distance from the flange of the maker's drawings to the start of the stick [m]."""
STICK, ROOT_BEYOND = 0.48, 0.01
"""Length of the stick, and distance from its end to the rope's root [m]."""
RADIUS, BODY_COUNT = 0.01, 25
"""Radius of stick and rope [m], and number of capsules of a rope."""

LENGTHS = tuple(cm / 100 for cm in range(50, 161, 10))
"""Lengths of the grid of ropes [m]."""
DENSITIES = (13.0, 20.2, 28.9, 39.2, 51.0, 64.4, 79.4, 96.0, 114.0, 134.0, 155.0, 178.0)
"""Linear densities of the grid of ropes [g/m]."""

PIXELS, HALF_WIDTH = 256, 3.0
"""Pixels of the plane of the swing in each direction, and half its width [m]."""
PIXELS_PER_M = PIXELS / (2.0 * HALF_WIDTH)


@dataclasses.dataclass(frozen=True)
class Rope:
    """A rope of the grid.

    Attributes:
        length: Length [m].
        density: Linear density [kg/m].
    """

    length: float
    density: float


def draw_ropes(kind: str, count: int, seed: int) -> list[Rope]:
    """Return different ropes of the test set "interpolation" or "extrapolation"."""
    extra = {(i, j) for i in range(12) for j in range(12) if i < 2 or j > 9}
    inner = {(i, j) for i in range(12) for j in range(12) if i in (6, 7) or j in (4, 5)} - extra
    grid = sorted(inner if kind == "interpolation" else extra)
    rng = np.random.default_rng([seed, kind == "interpolation"])
    chosen = rng.choice(len(grid), count, replace=False)
    return [Rope(LENGTHS[grid[k][1]], DENSITIES[grid[k][0]] / 1e3) for k in chosen]


def joint_targets(action: Array) -> Array:
    """Return the set points of both joints [rad], shape [step, 2], of an action in [0, 1]³."""
    action = np.clip(action, 0.0, 1.0 - 1e-7)
    start = np.radians(START_DEG)[list(MOVING)]
    speed = SPEEDS[0] + action[0] * (SPEEDS[1] - SPEEDS[0])
    low, high = np.radians(TURNS_DEG).T
    turn = low + action[1:] * (high - low)
    rate = speed / np.abs(turn).max()
    duration = RAMP_TIME + 1.0 / rate
    t = np.linspace(0.0, duration, math.ceil(duration / DT))
    up = 0.5 / RAMP_TIME * np.clip(t, 0.0, RAMP_TIME) ** 2
    down = 0.5 / RAMP_TIME * np.clip(t - (duration - RAMP_TIME), 0.0, RAMP_TIME) ** 2
    phase = rate * (up + np.clip(t - RAMP_TIME, 0.0, None) - down)
    return start + phase[:, None] * turn


def respond(q: Array, dt: float) -> Array:
    """Return the angles [rad] that follow set points every dt [s], both [..., tick, joint].

    The controller works every `DT`; set points between those given lie on straight lines.
    """
    from scipy.signal import lfilter

    parts = round(dt / DT)
    ticks = np.arange((q.shape[-2] - 1) * parts + 1) / parts
    before = np.minimum(ticks.astype(int), q.shape[-2] - 2)
    way = (ticks - before)[:, None]
    start = q[..., :1, :]
    fine = (1.0 - way) * q[..., before, :] + way * q[..., before + 1, :] - start
    asked = DT**2 * (KP * fine + math.sqrt(KP) * np.gradient(fine, DT, axis=-2))
    kept = 1.0 - DT * math.sqrt(KP)
    moved = lfilter([0.0, 1.0], [1.0, DT**2 * KP - 1.0 - kept, kept], asked, axis=-2)
    return start + np.asarray(moved)[..., ::parts, :]


@functools.cache
def arm() -> ArmUR:
    """Return the arm with its stick as a gripper."""
    return ArmUR(model="ur5", base_height=0.0, gripper_length=FLANGE_BEYOND + STICK)


def to_plane(points: Array) -> Array:
    """Return points of the base frame [m], [..., 3], in the plane of the swing: forward and up."""
    return points[..., 1:]


def _model(rope: Rope) -> Any:
    """Return the MuJoCo model of a rope on the arm."""
    import mujoco

    start = np.radians(START_DEG)
    frames = arm().frames(start)
    shape = arm_shape(start[None], arm())
    spacing = rope.length / (BODY_COUNT - 1)
    spec = mujoco.MjSpec()
    spec.option.timestep = DT
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.density, spec.option.viscosity = 1.2, 2e-5
    spec.compiler.degree = False

    def capsule(body: Any, place: Array, ends: Array, radius: float, group: int, mass: float):
        """Add a capsule, ends in the base frame; those of the arm meet no other of the arm."""
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=(ends - place).ravel(),
            size=[radius, 0.0, 0.0],
            mass=mass,
            contype=group,
            conaffinity=2 if group == 1 else 3,
        )

    # The capsules of the library in their order: foot, base, shoulder, upper arm, elbow, forearm
    # and three of the wrist; the stick stands for the gripper.
    parts = (range(1, 5), range(5, 6), range(6, 9))
    body, place = spec.worldbody, np.zeros(3)
    for number, rods in enumerate(parts):
        if number:
            frame = frames[MOVING[number - 1]]
            body = body.add_body(pos=frame[:3, 3] - place)
            place = frame[:3, 3]
            body.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=frame[:3, 2], armature=ARMATURE)
        for rod in rods:
            capsule(body, place, shape.ends[0, rod], shape.radii[rod], 1, 1e-3)
    out = frames[-1][:3, 2]
    foot = frames[-1][:3, 3] + FLANGE_BEYOND * out
    root = foot + (STICK + ROOT_BEYOND) * out
    stick = np.stack([foot, foot + (STICK - 0.5 * spacing) * out])
    capsule(body, place, stick, RADIUS, 2, 0.1)
    across = np.cross(out, [1.0, 0.0, 0.0])
    for number in range(BODY_COUNT):
        middle = root + number * spacing * out
        body = body.add_body(name=f"B{number}", pos=middle - place)
        place = middle
        for axis in ((1.0, 0.0, 0.0), across) if number else ():
            body.add_joint(
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=axis,
                pos=-0.5 * spacing * out,
                stiffness=rope.density * 0.01 / 0.015,
                damping=rope.density * 0.005 / 0.015,
            )
        ends = middle + np.outer([-0.5, 0.5], spacing * out)
        capsule(body, place, ends, RADIUS, 2, rope.density * rope.length / BODY_COUNT)
    return spec.compile()


@dataclasses.dataclass(frozen=True)
class Swing:
    """What a swing was.

    Attributes:
        motion: Angles of both joints at the records [rad], shape [record, 2].
        path: Tip in the plane of the swing at the records until a contact [m], [record, 2].
        cut: Whether a contact ended it.
    """

    motion: Array
    path: Array
    cut: bool


class World:
    """The arm with one rope.

    Args:
        rope: Rope.
    """

    def __init__(self, rope: Rope):
        import mujoco

        self._mujoco = mujoco
        self.rope = rope
        self.model = _model(rope)
        self.data = mujoco.MjData(self.model)
        self._bodies = [self.model.body(f"B{number}").id for number in range(BODY_COUNT)]

    def swing(self, action: Array, impulse: float = 0.0) -> Swing:
        """Return the swing of an action in [0, 1]³, after an impulse at the tip [N·s]."""
        model, data, step = self.model, self.data, self._mujoco.mj_step
        self._mujoco.mj_resetData(model, data)
        targets = joint_targets(np.asarray(action, dtype=float))
        rates = np.gradient(targets, DT, axis=0)
        start, damping = targets[0], math.sqrt(KP)
        if impulse:
            self._push(impulse)
        tip = data.xipos[self._bodies[-1]]
        q, qd, bias, torque = data.qpos[:2], data.qvel[:2], data.qfrc_bias[:2], data.qfrc_applied
        motion, path, touched = [], [], False
        for number in range(round(DURATION / DT)):
            at = min(number, len(targets) - 1)
            torque[:2] = (
                ARMATURE * (KP * (targets[at] - start - q) + damping * (rates[at] - qd)) + bias
            )
            touched = touched or data.ncon > 0
            if number % RECORD_STEPS == 0:
                if touched:
                    break
                if number == 0:
                    self._mujoco.mj_forward(model, data)
                motion.append(start + q)
                path.append(to_plane(tip).copy())
            step(model, data)
        return Swing(motion=np.array(motion), path=np.array(path), cut=touched)

    def _push(self, impulse: float) -> None:
        """Step once with forces in the swing's direction that fall linearly towards the root."""
        model, data = self.model, self.data
        self._mujoco.mj_forward(model, data)
        for body, share in zip(self._bodies, np.linspace(0.0, 1.0, BODY_COUNT), strict=True):
            force = np.array([0.0, share * impulse / DT, 0.0])
            self._mujoco.mj_applyFT(
                model, data, force, np.zeros(3), data.xipos[body], body, data.qfrc_applied
            )
        self._mujoco.mj_step(model, data)
        data.qfrc_applied[:] = 0.0


def pixels_of(path: Array) -> Array:
    """Return the pixels that a path [m] covers as a polyline of one pixel, shape [pixel, 2]."""
    corners = np.clip((path + HALF_WIDTH) * PIXELS_PER_M, 0, PIXELS).astype(int)
    before, way = corners[:-1], np.diff(corners, axis=0)
    counts = np.abs(way).max(axis=1, initial=0)
    row = np.repeat(np.arange(len(way)), counts)
    step = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    along = (step / counts[row])[:, None]
    line = np.rint(before[row] + along * way[row]).astype(int)
    covered = np.concatenate([line, corners[-1:]])
    return covered[np.all(covered < PIXELS, axis=1)]


def pixel_error(path: Array, goal: Array) -> float:
    """Return the distance of a path [m] from a goal's pixel by the published metric [m]."""
    return float(np.linalg.norm(pixels_of(path) - goal, axis=1).min() / PIXELS_PER_M)


def middle_of(pixel: Array) -> Array:
    """Return the point in the middle of a pixel [m], shape [2]."""
    return (np.asarray(pixel) + 0.5) / PIXELS_PER_M - HALF_WIDTH


def draw_goals(rope: Rope, count: int, action_count: int, seed: int) -> NDArray[np.int_]:
    """Return pixels that some of a number of actions hit, drawn uniformly, shape [goal, 2]."""
    from scipy.stats import qmc

    world = World(rope)
    actions = qmc.Sobol(3, rng=np.random.default_rng(seed)).random(action_count)
    covered = np.concatenate([pixels_of(world.swing(action).path) for action in actions])
    found = np.unique(covered, axis=0)
    rng = np.random.default_rng([seed, round(1e3 * rope.length), round(1e6 * rope.density)])
    return found[rng.choice(len(found), count, replace=False)]
