"""Any serial arm that stands upright: kinematics of a chain of hinges, both ways.

While the gripper points down at one height, where the flange is takes two numbers: its distance
from the base axis, and the turn of the cable against the line to it. The base joint adds the
azimuth. So the inverse kinematics of a whole casting motion is a table over these two, solved once
and interpolated by a spline. Joint paths are thereby smooth functions of the grip, with exact
derivatives, and a look-up costs no iteration.

At each place of the table the posture is the one nearest to the arm's middle posture among those
that hold the grip: joints nearer to the middle of their range weigh more. For arms of more than six
joints, this settles the redundancy (A. Liegeois, 1977).
"""

import dataclasses
import functools
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.base import (
    Arm,
    Array,
    JointLimits,
    JointMotion,
    Links,
    directions,
    flange_motion,
    jacobian,
    polar_motion,
    rod_ends,
)
from cablecast.arm.shape import self_gaps
from cablecast.conventions import stream
from cablecast.errors import IKError, InputError, check_keys, check_name, check_number

JOINT_COUNT_MIN, JOINT_COUNT_MAX = 5, 12

# Nodes of the table over the radius and over the turn of the cable, and the range of that turn
# [rad]. The spline between them leaves the grip within 1e-6 m (tests/arm/test_serial.py).
_RADIUS_NODES, _TURN_NODES, _TURN_MAX = 97, 61, 3.4
# Random postures from which the search for a branch starts, and those that it follows.
_START_COUNT, _BRANCH_MAX = 256, 16
_ALMOST = 0.75
# Steps outwards and inwards in the search for the reach [m]; its ends are found to _REACH_GAP.
_STEP, _REACH_GAP = 0.01, 1e-4
# Smallest radius of the flange [m]: on the base axis the azimuth is not defined.
_RADIUS_MIN = 0.02
# Residual of a pose that counts as reached [m and rad], and largest change of a joint between two
# neighbouring poses that are the same branch [rad].
_SOLVED, _JUMP_MAX = 1e-7, 0.6
# Compliance of the pose in the solution: keeps it defined where a joint's effect vanishes.
_SOFT = 1e-10
# Poses of a batch whose height differs by more [m], or whose pitch [rad], are solved one by one, in
# so many steps from a level one; their rates are central differences over a step of time [s].
_LEVEL, _STEPS, _TIME_STEP = 1e-6, 16, 1e-3
# Share of the way from the edge of the level reach to its middle at which these steps begin.
_INWARDS = 0.3
# Poses per part of a batch: their coefficients stay in the processor's cache.
_PART = 4096


@dataclasses.dataclass(frozen=True, kw_only=True)
class ArmSerial(Arm):
    """A serial arm of hinges, described by its chain.

    `arm_from_dict` makes it from a URDF or MJCF file, and it keeps the numbers that it needs from
    there. The x axis of the file points along y of the base frame
    where base_yaw_deg is 0, and z = 0 of the file is `base_height` above the table.

    Attributes:
        names: Names of the joints from the base on.
        offsets: Pose of each joint in the frame of the one before, and of the flange in that of the
            last joint, at zero angles: x, y, z [m] and the quaternion w, x, y, z. A joint turns
            about its z.
        capsules: Both ends of the axis of each link in the frame of the next joint, or of the
            flange, and its radii, as drawn and to keep a distance from [m].
        posture: Posture near which the arm works [rad]: of several ways to hold the grip, the
            nearest is taken. None for the one that reaches farthest.
    """

    names: tuple[str, ...]
    offsets: tuple[tuple[float, ...], ...]
    capsules: tuple[tuple[float, ...], ...]
    posture: tuple[float, ...] | None = None

    def __post_init__(self):
        check_name(self.model, "arm")
        count = len(self.names)
        if not JOINT_COUNT_MIN <= count <= JOINT_COUNT_MAX:
            raise InputError(
                f"arm {self.model} has {count} joints from its base to the tip: "
                f"{JOINT_COUNT_MIN} to {JOINT_COUNT_MAX} are supported"
            )
        for what, rows, size in (
            ("offsets", self.offsets, count + 1),
            ("capsules", self.capsules, count),
            ("posture", self.posture or self.names, count),
        ):
            if len(rows) != size:
                raise InputError(f"arm {what} has {len(rows)} entries, not {size}")
        if any(len(row) != 7 for row in self.offsets):
            raise InputError("each of an arm's offsets has 7 numbers")
        if any(len(row) != 8 for row in self.capsules):
            raise InputError("each of an arm's capsules has 8 numbers")
        numbers = [*sum(self.offsets + self.capsules, ()), *(self.posture or ())]
        for value in numbers:
            check_number("arm offset, capsule or posture", value, -100.0, 100.0)
        super().__post_init__()

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints from the base on."""
        return self.names

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "ArmSerial":
        """Make an arm from the values of `to_dict`.

        Raises:
            InputError: A key is unknown or missing, or a value out of bounds.
        """
        fields = {field.name for field in dataclasses.fields(cls)}
        required = {"model", "names", "offsets", "capsules", "limits"}
        values = check_keys(values, fields, "arm", required=required)
        values["limits"] = JointLimits.from_dict(values["limits"], len(values["names"]))
        try:
            for key in ("names", "posture"):
                if values.get(key) is not None:
                    values[key] = tuple(values[key])
            for key in ("offsets", "capsules"):
                values[key] = tuple(tuple(row) for row in values[key])
        except TypeError:
            raise InputError(f"arm {key} must be a list, as an exported arm has it") from None
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for a config or YAML file."""
        values = super().to_dict()
        for key in ("names", "posture"):
            values[key] = None if values[key] is None else list(values[key])
        for key in ("offsets", "capsules"):
            values[key] = [list(row) for row in values[key]]
        return values

    @functools.cached_property
    def offsets_at_zero(self) -> tuple[Array, Array]:
        """Offsets of the description as matrices; see `Arm.offsets_at_zero`."""
        from scipy.spatial.transform import Rotation

        rows = np.array(self.offsets)
        T = np.tile(np.eye(4), (len(rows), 1, 1))
        T[:, :3, :3] = Rotation.from_quat(rows[:, 3:], scalar_first=True).as_matrix()
        T[:, :3, 3] = rows[:, :3]
        c, s = np.cos(self.base_yaw), np.sin(self.base_yaw)
        mount = np.eye(4)
        mount[:3, :3] = [[s, -c, 0.0], [c, s, 0.0], [0.0, 0.0, 1.0]]
        mount[2, 3] = self.base_height
        return mount @ T[0], T[1:]

    def links(self, frames: list[Array]) -> Links:
        """Return the links as capsules; see `Arm.links`."""
        shoulder = frames[0][..., :3, 3]
        foot = shoulder * [1.0, 1.0, 0.0]
        base = foot + [0.0, 0.0, self.base_height]
        rows = np.array(self.capsules)
        ends = [rod_ends([(foot, base), (base, shoulder)])]
        for T, row in zip(frames[1:], rows, strict=True):
            pair = row[:6].reshape(2, 3) @ np.swapaxes(T[..., :3, :3], -1, -2)
            ends.append((pair + T[..., None, :3, 3])[..., None, :, :])
        names = ("foot", "base", *(f"link {joint}" for joint in range(1, self.joint_count + 1)))
        drawn, safe = rows[[0, 0, *range(len(rows))], 6:].T
        return Links(names=names, ends=np.concatenate(ends, axis=-3), drawn=drawn, safe=safe)

    def inverse_motion(
        self, poses: ArrayLike, velocities: ArrayLike, accelerations: ArrayLike
    ) -> JointMotion:
        """Return joint angles along moving poses, with their rates and accelerations.

        Raises:
            IKError: The arm cannot hold the grip level at the lowest height of the poses.
        """
        p, v, a = (np.asarray(values, dtype=float) for values in (poses, velocities, accelerations))
        z = float(p[..., 2].min(initial=np.inf))
        if np.ptp(p[..., 2]) > _LEVEL or np.abs(p[..., 4]).max() > _LEVEL:
            return self._lifted(p, v, a, z)
        table = _tabulate(self, round(z + self.gripper_length, 9))
        with np.errstate(invalid="ignore", divide="ignore"):
            (rho, drho, ddrho), azimuth, _ = polar_motion(*flange_motion(self.grip_offset, p, v, a))
        turn = [p[..., 3] - azimuth[0], v[..., 3] - azimuth[1], a[..., 3] - azimuth[2]]
        q, qd, qdd = table.motion((rho, drho, ddrho), turn)
        for values, order in zip((q, qd, qdd), azimuth, strict=True):
            values[..., 0] -= table.sense * order
        low, high = (np.full_like(rho, bound) for bound in table.reach)
        return JointMotion(q=q, qd=qd, qdd=qdd, radius=rho, radius_min=low, radius_max=high)

    def _lifted(self, p: Array, v: Array, a: Array, z: float) -> JointMotion:
        """Return the joint motion of a gripper that rises and tilts.

        Each posture is continued from the level one below it, at the height z [m].
        """
        height = round(z + self.gripper_length, 9)
        table, solver = _tabulate(self, height), _Solver(self, height)
        t = np.reshape([0.0, -_TIME_STEP, _TIME_STEP], (3, *[1] * p.ndim))
        pose = (p + t * v + 0.5 * t * t * a).reshape(3, -1, 5)
        along, tool, *_ = directions(pose)
        x, y, up = np.moveaxis(
            pose[..., :3] - self.gripper_length * tool - self.grip_offset * along, -1, 0
        )
        rho, azimuth, pitch = np.hypot(x, y), np.arctan2(x, y), pose[..., 4]
        turn = pose[..., 3] - azimuth
        low, high = table.reach
        start = np.clip(rho[0], low, high)
        start = start + _INWARDS * (0.5 * (low + high) - start)
        still = np.zeros_like(start)
        q = table.motion((start, still, still), [turn[0], still, still])[0]
        for share in np.linspace(0.0, 1.0, _STEPS + 1)[1:]:
            place, level = (a + share * (b - a) for a, b in ((start, rho[0]), (height, up[0])))
            q = solver.solve(q, place, turn[0], height=level, pitch=share * pitch[0])
        before, after = (
            solver.solve(q, rho[i], turn[i], height=up[i], pitch=pitch[i]) for i in (1, 2)
        )
        for values, angle in zip((q, before, after), azimuth, strict=True):
            values[:, 0] -= table.sense * angle
        qd, qdd = 0.5 * (after - before) / _TIME_STEP, (after - 2.0 * q + before) / _TIME_STEP**2
        # The level reach as a sphere about the second joint; beyond it where the arm reaches less.
        centre = self.frames(np.zeros(self.joint_count))[1][2, 3]
        sphere = high**2 + (height - centre) ** 2 - (up[0] - centre) ** 2
        outer = np.sqrt(np.maximum(sphere, 0.0))
        outer = np.where(
            np.isnan(q[:, 0]) & (rho[0] > low), np.minimum(outer, 0.999 * rho[0]), outer
        )
        return JointMotion(
            **{
                name: values.reshape(p.shape[:-1] + values.shape[1:])
                for name, values in {
                    **{"q": q, "qd": qd, "qdd": qdd, "radius": rho[0]},
                    "radius_min": np.full_like(outer, low),
                    "radius_max": outer,
                }.items()
            }
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Table:
    """Postures over the distance of the flange from the base axis and the turn of the cable.

    The radius is low + (high - low) (1 - cos(pi s)) / 2: along the share s, joint angles stay
    smooth up to the ends of the reach, where along the radius they have infinite slope.

    Attributes:
        low: Smallest radius that the branch reaches [m].
        high: Largest radius [m].
        shares: Nodes of the share s, evenly spaced.
        turns: Nodes of the turn [rad], evenly spaced.
        sense: 1 where the base axis points up, -1 where it points down.
        coefficients: Bicubic polynomials, lowest powers first, of the cells' own shares of s and
            turn, shape [cell over s, cell over turn, power of s * power of turn, joint].
    """

    low: float
    high: float
    shares: Array
    turns: Array
    sense: float
    coefficients: Array

    @property
    def reach(self) -> tuple[float, float]:
        """Smallest and largest radius of the flange in the table [m]."""
        near, far = 0.5 * (1.0 - np.cos(np.pi * self.shares[[0, -1]])) * (self.high - self.low)
        return self.low + float(near), self.low + float(far)

    def motion(self, radius: tuple[Array, ...], turn: list[Array]) -> tuple[Array, Array, Array]:
        """Return angles, rates and accelerations; each argument with its two derivatives."""
        shape = radius[0].shape
        radius, turn = tuple(r.ravel() for r in radius), [t.ravel() for t in turn]
        joint_count = self.coefficients.shape[-1]
        # Joint by joint in memory, as `check_grip_paths` reads them.
        result = np.empty((3, joint_count, len(radius[0])))
        for start in range(0, len(radius[0]), _PART):
            part = slice(start, start + _PART)
            self._part([r[part] for r in radius], [t[part] for t in turn], result[:, :, part])
        q, qd, qdd = (np.moveaxis(rows.reshape(joint_count, *shape), 0, -1) for rows in result)
        return q, qd, qdd

    def _part(self, radius: list[Array], turn: list[Array], result: Array) -> None:
        rho, drho, ddrho = radius
        span = self.high - self.low
        with np.errstate(invalid="ignore"):
            cosine = np.clip(1.0 - 2.0 * (rho - self.low) / span, -1.0 + 1e-12, 1.0 - 1e-12)
            sine = np.sqrt(1.0 - cosine * cosine)
            slope = 2.0 / (np.pi * span * sine)
            s = np.arccos(cosine) / np.pi
            ds = slope * drho
            dds = slope * ddrho - (np.pi * cosine / sine) * ds * ds
            outside = ~((rho >= self.low) & (rho <= self.high))
            for value, nodes in ((s, self.shares), (turn[0], self.turns)):
                outside |= ~((value >= nodes[0]) & (value <= nodes[-1]))
        x, ix = _jet([s, ds, dds], self.shares)
        y, iy = _jet(turn, self.turns)
        basis = np.empty((len(rho), 3, 4, 4))
        basis[:, 0] = x[0][:, :, None] * y[0][:, None, :]
        basis[:, 1] = x[1][:, :, None] * y[0][:, None, :] + x[0][:, :, None] * y[1][:, None, :]
        basis[:, 2] = x[2][:, :, None] * y[0][:, None, :] + x[0][:, :, None] * y[2][:, None, :]
        basis[:, 2] += 2.0 * x[1][:, :, None] * y[1][:, None, :]
        values = basis.reshape(-1, 3, 16) @ self.coefficients[ix, iy]
        values[outside] = np.nan
        result[:] = values.transpose(1, 2, 0)


def _jet(value: list[Array], nodes: Array) -> tuple[list[Array], NDArray[np.intp]]:
    """Return the powers of a cell's share, each with two derivatives, and the cell."""
    step = nodes[1] - nodes[0]
    place = (value[0] - nodes[0]) / step
    cell = np.clip(np.nan_to_num(place, nan=0.0), 0, len(nodes) - 2).astype(np.intp)
    u, du, ddu = place - cell, value[1] / step, value[2] / step
    one, zero = np.ones_like(u), np.zeros_like(u)
    slope = np.stack([zero, one, 2.0 * u, 3.0 * u * u], axis=-1)
    bend = np.stack([zero, zero, 2.0 * one, 6.0 * u], axis=-1)
    powers = np.stack([one, u, u * u, u * u * u], axis=-1)
    return [powers, slope * du[:, None], bend * (du * du)[:, None] + slope * ddu[:, None]], cell


@functools.lru_cache(maxsize=8)
def _tabulate(arm: ArmSerial, height: float) -> _Table:
    """Return the table of an arm for one height of the flange above the table's surface [m]."""
    from scipy.interpolate import CubicSpline

    solver = _Solver(arm, height)
    radius, start = solver.find_branch()
    low, high = (solver.find_end(radius, start, way) for way in (-1.0, 1.0))
    shares = np.linspace(0.0, 1.0, _RADIUS_NODES)
    radii = low + (high - low) * 0.5 * (1.0 - np.cos(np.pi * shares))
    turns = np.linspace(-_TURN_MAX, _TURN_MAX, _TURN_NODES)
    row, column = int(np.argmin(np.abs(radii - radius))), _TURN_NODES // 2
    q = np.full((_RADIUS_NODES, _TURN_NODES, arm.joint_count), np.nan)
    q[row, column] = solver.solve(start[None], radii[row, None], np.zeros(1))
    # Straight ahead from the start to both ends of the reach, then all radii from turn to turn.
    for place, guess in _outwards(q[:, column], row):
        q[place, column] = solver.solve(guess[None], radii[place, None], np.zeros(1))
    for place, guess in _outwards(q.swapaxes(0, 1), column):
        q[:, place] = solver.solve(guess, radii, np.full(_RADIUS_NODES, turns[place]))
    known = np.all(np.isfinite(q), axis=-1) & ~_folds_into_itself(arm, q, (row, column))
    columns = _run(known[row], column)
    rows = _run(np.all(known[:, columns], axis=1), row)
    shares, turns, q = shares[rows], turns[columns], q[rows, columns]
    first = CubicSpline(shares, q, axis=0)
    second = CubicSpline(turns, first.c, axis=2)
    # second.c is [power of turn, cell over turn, power of s, cell over s, joint], highest first.
    c = np.transpose(second.c[::-1, :, ::-1], (3, 1, 2, 0, 4))
    c = c * (shares[1] - shares[0]) ** np.arange(4)[:, None, None]
    c = c * (turns[1] - turns[0]) ** np.arange(4)[:, None]
    return _Table(
        low=low,
        high=high,
        shares=shares,
        turns=turns,
        sense=solver.sense,
        coefficients=np.ascontiguousarray(c.reshape(*c.shape[:2], 16, arm.joint_count)),
    )


def _folds_into_itself(arm: ArmSerial, q: Array, start: tuple[int, int]) -> NDArray[np.bool_]:
    """Return at which postures, shape [..., joint], parts touch that do not at the start.

    Capsules of neighbours may overlap everywhere.
    """
    gaps = self_gaps(arm, np.nan_to_num(q).reshape(-1, arm.joint_count)).values()
    apart = [gap.reshape(q.shape[:-1]) for gap in gaps]
    return np.any([(gap < 0.0) & (gap[start] > 0.0) for gap in apart], axis=0)


def _outwards(q: Array, middle: int) -> Iterator[tuple[int, Array]]:
    """Yield the other rows from the middle to both ends, each with a guess from those before."""
    for way in (1, -1):
        for row in range(middle + way, len(q) if way > 0 else -1, way):
            last, before = q[row - way], q[row - 2 * way if row - way != middle else row - way]
            yield row, 2.0 * last - before


def _run(known: NDArray[np.bool_], middle: int) -> slice:
    """Return the run of true values about a place."""
    gaps = np.flatnonzero(~known)
    low = int(max(gaps[gaps < middle], default=-1)) + 1
    high = int(min(gaps[gaps > middle], default=len(known)))
    if high - low < 4 or not known[middle]:
        raise IKError("the arm holds its gripper straight down at too few places to plan motions")
    return slice(low, high)


class _Solver:
    """Postures that hold the flange at one height, straight ahead of the base.

    Args:
        arm: Arm.
        height: Height of the flange above the table's surface [m].
    """

    def __init__(self, arm: ArmSerial, height: float):
        self.arm, self.height = arm, height
        self.middle = np.array(arm.posture or arm.limits.middle)
        self.weights = np.array(arm.limits.position) ** -2.0
        # The base joint is all but free to face the grip, the last one to turn the cable.
        self.weights[[0, -1]] = 1e-9
        self.sense = float(np.sign(arm.frames(np.zeros(arm.joint_count))[0][2, 2]))
        self.reach = sum(float(np.linalg.norm(offset[:3])) for offset in arm.offsets)

    def solve(
        self,
        q: Array,
        radius: Array,
        turn: Array,
        *,
        height: Array | None = None,
        pitch: Array | float = 0.0,
        rough: int = 0,
    ) -> Array:
        """Return the postures nearest to the middle one, NaN where there are none.

        Newton's method on the conditions of the constrained minimum. The first `rough` steps leave
        out the curvature of the chain, so that they lead to a minimum from far away.

        Args:
            q: Guesses, shape [pose, joint].
            radius: Distance of the flange from the base axis [m], shape [pose].
            turn: Turn of the cable [rad], shape [pose].
            height: Height of the flange [m], shape [pose]; that of the solver if None.
            pitch: Pitch of the grip [rad], shape [pose].
            rough: Number of steps without curvature.
        """
        start, q, count = q, np.nan_to_num(q), self.arm.joint_count
        pose = np.zeros((len(q), 5))
        pose[:, 3], pose[:, 4] = turn, pitch
        along, tool, *_ = directions(pose)
        wanted = np.stack([np.cross(-along, tool), -along, tool], axis=-1)
        place = np.zeros((len(q), 3))
        place[:, 1], place[:, 2] = radius, self.height if height is None else height
        system = np.zeros((len(q), count + 6, count + 6))
        system[:, range(count, count + 6), range(count, count + 6)] = -_SOFT
        forces, step = np.zeros((len(q), 6)), np.zeros_like(q)
        for number in range(rough + 14):
            frames = self.arm.frames(q)
            T = frames[-1]
            turning = 0.5 * np.sum(np.cross(T[:, :3, :3], wanted, axis=1), axis=-1)
            error = np.concatenate([place - T[:, :3, 3], turning], axis=1)
            rates = jacobian(frames, T[:, :3, 3])
            system[:, :count, :count] = np.diag(self.weights)
            if number >= rough + 2:
                system[:, :count, :count] += _curvature(rates, forces)
            system[:, count:, :count] = rates
            system[:, :count, count:] = np.swapaxes(rates, 1, 2)
            pull = self.weights * (self.middle - q)
            right = np.concatenate([pull, error], axis=1)[..., None]
            found: Any = np.linalg.solve(system, right)[..., 0]
            step, forces = found[:, :count], found[:, count:]
            largest = np.max(np.abs(step), axis=1, keepdims=True)
            q = q + step * np.minimum(1.0, 0.4 / np.maximum(largest, 1e-12))
            if number >= rough + 3 and largest.max() < 1e-11:
                break
        good = (np.abs(error).max(axis=1) < _SOLVED) & (np.abs(step).max(axis=1) < 1e-5)
        if not rough:
            good &= np.abs(q - start).max(axis=1) < _JUMP_MAX
        return np.where(good[:, None], q, np.nan)

    def find_branch(self) -> tuple[float, Array]:
        """Return a radius and a posture there whose branch reaches far and is easy to hold.

        Raises:
            IKError: There is none.
        """
        limits, rng = self.arm.limits, stream(0, "poses of an arm")
        spread = np.minimum(limits.position, np.pi)
        q = limits.middle + spread * rng.uniform(-1.0, 1.0, (_START_COUNT, self.arm.joint_count))
        if self.arm.posture is not None:
            q = self.middle[None].copy()
        flange = self.arm.forward(q)[:, :3, 3]
        q[:, 0] += self.sense * np.arctan2(flange[:, 0], flange[:, 1])
        radius = np.clip(np.hypot(flange[:, 0], flange[:, 1]), 0.1, 0.9 * self.reach)
        q = self._settled(q, radius)
        kept = self.allows(q)
        if np.any(kept):
            middle = float(np.median(radius[kept]))
            q = self._settled(q[kept][:96], np.full(min(int(kept.sum()), 96), middle))
            kept = self.allows(q)
        if not np.any(kept):
            aside = self.allows(q, first=1)
            if np.any(aside):
                low, high = np.degrees(limits.middle[0] + limits.position[0] * np.array([-1, 1]))
                angle = np.degrees(q[aside][0, 0])
                raise IKError(
                    f"straight ahead the joint {self.arm.joint_names[0]} of {self.arm.model} "
                    f"stands at {angle:.0f} deg, outside [{low:.0f}, {high:.0f}]: turn the base by "
                    "base_yaw_deg"
                )
            raise IKError(
                f"the arm {self.arm.model} has no posture within its limits and above the table "
                f"whose gripper points straight down with its flange {self.height:.4g} m above the "
                "table: check tip, base_height, base_yaw_deg and gripper_length"
            )
        _, first = np.unique(np.round(q[kept] / 0.1), axis=0, return_index=True)
        q = q[kept][np.sort(first)][:_BRANCH_MAX]
        extent = np.zeros(len(q))
        for way in (-1.0, 1.0):
            moved, going = q.copy(), np.ones(len(q), dtype=bool)
            for number in range(1, round(self.reach / (3 * _STEP))):
                place = middle + way * number * 3 * _STEP
                if place < _RADIUS_MIN or not np.any(going):
                    break
                moved = self.solve(moved, np.full(len(q), place), np.zeros(len(q)))
                going &= self.allows(moved)
                extent += going
        # Of those that reach almost as far as the best and are almost as near to the middle, the
        # one with the highest elbow.
        cost = np.sum(self.weights * (q - self.middle) ** 2, axis=1)
        cost[extent < _ALMOST * extent.max()] = np.inf
        elbow = np.mean([T[:, 2, 3] for T in self.arm.frames(q)], axis=0)
        return middle, q[np.argmax(np.where(cost * _ALMOST <= cost.min(), elbow, -np.inf))]

    def find_end(self, radius: float, q: Array, way: float) -> float:
        """Return the smallest or the largest radius of the branch through a posture [m]."""
        step = _STEP
        while step > _REACH_GAP:
            there = radius + way * step
            if _RADIUS_MIN <= there <= self.reach:
                found = self.solve(q[None], np.array([there]), np.zeros(1))[0]
                if np.all(np.isfinite(found)):
                    radius, q = there, found
                    continue
            step /= 4.0
        return radius

    def allows(self, q: Array, first: int = 0) -> NDArray[np.bool_]:
        """Return which postures are within the limits and above the table, shape [pose].

        The limits count from the joint `first` on.
        """
        limits = self.arm.limits
        within = np.abs(q - limits.middle) <= limits.position
        inside = np.all(within[:, first:], axis=1)
        links = self.arm.links(self.arm.frames(np.nan_to_num(q)))
        # The last link carries the gripper, which works at the table.
        heights = links.ends[:, 2:-1, :, 2].min(axis=-1) - links.safe[2:-1]
        return inside & np.all(heights > 0.0, axis=1)

    def _settled(self, q: Array, radius: Array) -> Array:
        """Return postures straight ahead from far guesses, within half a turn of the middle."""
        q = self.solve(q, radius, np.zeros(len(q)), rough=60)
        q = self.middle + (q - self.middle + np.pi) % (2.0 * np.pi) - np.pi
        return self.solve(q, radius, np.zeros(len(q)))


def _curvature(rates: Array, forces: Array) -> Array:
    """Return the second derivatives of a flange's pose, weighted by forces, [pose, joint, joint].

    Its Jacobian has the shape [pose, 6, joint], forces that of velocity and angular velocity.
    """
    linear, axes = np.swapaxes(rates[:, :3], 1, 2), np.swapaxes(rates[:, 3:], 1, 2)
    # Joint i turns what joint j, beyond it, does.
    bend = np.cross(axes[:, :, None], linear[:, None]) @ forces[:, None, :3, None]
    twist = np.cross(axes[:, :, None], axes[:, None]) @ forces[:, None, 3:, None]
    upper = np.triu((bend + 0.5 * twist)[..., 0])
    return upper + np.swapaxes(np.triu(upper, 1), 1, 2)
