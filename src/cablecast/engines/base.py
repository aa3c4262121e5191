"""The Engine contract: many simulated cables at once, each gripped at its near end."""

import dataclasses
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable, CableParams
from cablecast.conventions import GRAVITY
from cablecast.errors import InputError, check_number
from cablecast.motion.grip_path import GripPath
from cablecast.workspace import Workspace


@dataclasses.dataclass(frozen=True, kw_only=True)
class CableRows:
    """Geometry and physics of the cables of a batch.

    Attributes:
        cables: One cable that all worlds share, or one for each.
        length: Length from grip to endpoint [m], shape [1] or [world].
        radius: Half the diameter [m], same shape.
        params: Physics, shared or one value per world.
    """

    cables: tuple[Cable, ...]
    length: NDArray[np.float64]
    radius: NDArray[np.float64]
    params: CableParams

    @classmethod
    def of(cls, cable: Cable | Sequence[Cable]) -> "CableRows":
        """Return the rows of a cable that all worlds share, or of one for each world."""
        cables = (cable,) if isinstance(cable, Cable) else tuple(cable)
        if not cables:
            raise InputError("a batch needs a cable, or one for each world, not none")
        return cls(
            cables=cables,
            length=np.array([c.length for c in cables]),
            radius=np.array([c.radius for c in cables]),
            params=CableParams.stack([c.params for c in cables]),
        )

    @property
    def world_count(self) -> int | None:
        """Number of worlds; None if they share a cable."""
        return len(self.cables) if len(self.cables) > 1 else self.params.world_count

    def rows(self, worlds: NDArray[np.int_]) -> "CableRows":
        """Return the cables of some worlds; one that all share stays so."""
        if len(self.cables) == 1:
            return dataclasses.replace(self, params=self.params.rows(worlds))
        return CableRows(
            cables=tuple(self.cables[world] for world in worlds),
            length=self.length[worlds],
            radius=self.radius[worlds],
            params=self.params.rows(worlds),
        )


def one_cable(cable: Cable | Sequence[Cable]) -> Cable:
    """Return the cable of an engine whose worlds share it."""
    cables = [cable] if isinstance(cable, Cable) else list(cable)
    if len(cables) != 1:
        raise InputError(
            f"this engine simulates one cable at a time, not {len(cables)}: EngineWarp takes one "
            "for each world"
        )
    return cables[0]


REFERENCE_SEGMENT_COUNT = 18
"""Number of capsules of the paper's simulator (its sibling names 18). Angular damping slows the
rotation of such a segment at the given rate, however finely an engine divides the cable itself."""

DURATION_MAX = 600.0
"""Longest rollout [s]: ten minutes, far beyond any motion of an arm."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class CableState:
    """State of the cables of a batch; node 0 is gripped, the last node is the free end.

    Attributes:
        positions: Nodes in the base frame, z of the cable's axis above the table's surface [m],
            shape [world, node, 3].
        velocities: Velocities of the nodes [m/s], same shape.
        roll: Roll of each segment about its tangent, against a frame that the cable carries along
            from the grip without turning it about the tangent [rad], shape [world, segment].
        roll_rate: Rate of the roll [rad/s], same shape.
        far_roll: Roll of the gripper at the far end against the same frame, by which the cable is
            twisted in all [rad], one or shape [world]. It counts where the far end is held.
    """

    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    roll: NDArray[np.float64]
    roll_rate: NDArray[np.float64]
    far_roll: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.zeros(1))

    def __post_init__(self):
        far_roll = np.broadcast_to(self.far_roll, len(self.positions)).copy()
        object.__setattr__(self, "far_roll", far_roll)

    @property
    def world_count(self) -> int:
        """Number of worlds."""
        return len(self.positions)

    @property
    def segment_count(self) -> int:
        """Number of segments."""
        return self.positions.shape[1] - 1

    @classmethod
    def at_rest(cls, positions: NDArray[np.float64], twist: ArrayLike = 0.0) -> "CableState":
        """Return cables at rest.

        Args:
            positions: Nodes [m], shape [world, node, 3].
            twist: Turn of the far end against the grip, evenly spread along the cable [rad], one or
                shape [world].
        """
        world_count, node_count, _ = positions.shape
        turn = np.broadcast_to(np.asarray(twist, dtype=float), world_count)
        middles = (np.arange(node_count - 1) + 0.5) / (node_count - 1)
        roll = turn[:, None] * middles
        return cls(
            positions=np.array(positions, dtype=float),
            velocities=np.zeros_like(positions, dtype=float),
            roll=roll,
            roll_rate=np.zeros_like(roll),
            far_roll=turn,
        )

    @classmethod
    def hanging(
        cls,
        cable: Cable | Sequence[Cable],
        grip_path: GripPath,
        segment_count: int,
        gravity: float = GRAVITY,
    ) -> "CableState":
        """Return cables that hang at rest from the grip, whichever way it points.

        It is the equilibrium of an engine's chain without a table: a heavy elastic rod in the
        vertical plane of the grip. An attachment counts as a point mass, and a cable with a curl,
        whose equilibrium lies in no plane, as a straight one.

        Args:
            cable: Cable, shared or a sequence with one per world.
            grip_path: Path whose start gives the grip pose, one row or one per world. A grip that
                points upwards bends the cable down along its yaw.
            segment_count: Number of segments.
            gravity: Acceleration of free fall [m/s²].

        Raises:
            InputError: The cable finds no rest.
        """
        start = grip_path.evaluate(grip_path.knots[:, :1])[:, 0]
        cables = CableRows.of(cable)
        params = cables.params
        world_count = batch_size(len(grip_path), cables.world_count)
        start = np.broadcast_to(start, (world_count, start.shape[1]))
        mass = np.broadcast_to(params.mass, world_count)
        end_mass = np.broadcast_to(params.endpoint_mass, world_count)
        length = np.broadcast_to(cables.length, world_count) / segment_count
        bending = np.broadcast_to(params.bend_stiffness, world_count) / length
        below = segment_count - 0.5 - np.arange(segment_count)
        weight = gravity * (mass[:, None] / segment_count * below + end_mass[:, None])
        angles = _hanging_angles(start[:, 4], bending, weight * length[:, None])
        edges = np.stack(
            [
                np.sin(start[:, 3, None]) * np.cos(angles),
                np.cos(start[:, 3, None]) * np.cos(angles),
                np.sin(angles),
            ],
            axis=-1,
        )
        steps = np.cumsum(length[:, None, None] * edges, axis=1)
        nodes = np.concatenate([np.zeros((world_count, 1, 3)), steps], axis=1)
        return cls.at_rest(nodes + start[:, None, :3])

    @classmethod
    def stack(cls, states: Sequence["CableState"]) -> "CableState":
        """Stack several batches into one."""
        names = [field.name for field in dataclasses.fields(cls)]
        return cls(**{name: np.concatenate([getattr(s, name) for s in states]) for name in names})


_HANGING_STEPS, _AT_REST = 200, 1e-9


def _hanging_angles(
    pitch: NDArray[np.float64], bending: NDArray[np.float64], load: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the pitches of the segments of hanging cables [rad], shape [world, segment].

    Newton's method on the energy EI phi^2 / (2 l) of the cells, half a cell at the grip, and of the
    weight, with as much added to its matrix as makes each step go down.

    Args:
        pitch: Pitch of the grip [rad], shape [world].
        bending: EI / l [N·m], shape [world].
        load: Weight below the middle of each segment times its length [N·m], shape
            [world, segment].
    """
    from scipy.linalg import solveh_banded

    angles = np.empty_like(load)
    for world, (clamp, stiffness, pull) in enumerate(zip(pitch, bending, load, strict=True)):
        # The cable leaves the grip as it points, and turns down on the shorter way.
        down = -0.5 * np.pi + 2.0 * np.pi * np.round((clamp + 0.5 * np.pi) / (2.0 * np.pi))

        def energy(a, clamp=clamp, stiffness=stiffness, pull=pull):
            bends = np.sum(np.diff(a) ** 2) + 8.0 * np.sin(0.5 * (a[0] - clamp)) ** 2
            return 0.5 * stiffness * bends + pull @ np.sin(a)

        reach = np.sqrt(stiffness / max(pull[0], 1e-300))
        now = down + (clamp - down) * np.exp(-(np.arange(len(pull)) + 0.5) / max(reach, 0.1))
        added = 0.0
        for _ in range(_HANGING_STEPS):
            bends = np.diff(now)
            slope = pull * np.cos(now)
            slope[0] += 2.0 * stiffness * np.sin(now[0] - clamp)
            slope[:-1] -= stiffness * bends
            slope[1:] += stiffness * bends
            if np.abs(slope).max() <= _AT_REST * (stiffness + pull[0]):
                break
            matrix = np.full((2, len(pull)), -stiffness)
            matrix[1] = 2.0 * stiffness - pull * np.sin(now)
            matrix[1, 0] += stiffness * (2.0 * np.cos(now[0] - clamp) - 1.0)
            matrix[1, -1] -= stiffness
            matrix[1] += added
            try:
                after = now - solveh_banded(matrix, slope)
                # Up to rounding.
                down_hill = energy(after) <= energy(now) + 1e-13 * (stiffness + pull.sum())
            except np.linalg.LinAlgError:
                down_hill = False
            if down_hill:
                now, added = after, 0.2 * added if added > 1e-6 * pull[0] else 0.0
            else:
                added = max(5.0 * added, 1e-3 * (stiffness + pull[0]))
        else:
            raise InputError(f"a hanging cable finds no rest in {_HANGING_STEPS} Newton steps")
        angles[world] = now
    return angles


@dataclasses.dataclass(frozen=True, kw_only=True)
class CableForces:
    """What the cables of a batch bear, each the mean over the engine's step before a sample.

    At time 0 there is no such step: the values are NaN.

    Attributes:
        tension: Axial force in each segment, positive where it pulls [N], shape [world, step,
            segment].
        grip: Force of the cable on the gripper [N], shape [world, step, 3].
        far_grip: The same at the far end; None where it is free.
    """

    tension: NDArray[np.float64]
    grip: NDArray[np.float64]
    far_grip: NDArray[np.float64] | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Rollout:
    """Result of a batch of simulated motions.

    Attributes:
        times: Sample times [s], shape [step]; the first is 0.
        endpoint_xyz: Path of the free end in the base frame [m], shape [world, step, 3].
        final_state: State at the end of the rollout.
        finite: False for a world that became non-finite, or whose energy was seen to grow without
            work; its samples are NaN from then on, shape [world].
        nodes: Cable shapes at the sample times [m], shape [world, step, node, 3]; None unless
            `record_nodes` was set.
        forces: What the cable bears at the sample times; None unless `record_forces` was set.
    """

    times: NDArray[np.float64]
    endpoint_xyz: NDArray[np.float64]
    final_state: CableState
    finite: NDArray[np.bool_]
    nodes: NDArray[np.float64] | None = None
    forces: "CableForces | None" = None

    @property
    def endpoint_xy(self) -> NDArray[np.float64]:
        """Path of the free end on the table [m], shape [world, step, 2]."""
        return self.endpoint_xyz[..., :2]


class Engine(Protocol):
    """A cable simulator: `EngineWarp`, `EngineMujoco` and `EnginePybullet` answer this call."""

    segment_count: int
    dt: float

    def rollout(
        self,
        cable: Cable | Sequence[Cable],
        grip_path: GripPath,
        initial_state: CableState | None = None,
        duration: float | None = None,
        sample_dt: float = 0.1,
        *,
        far_path: GripPath | None = None,
        edges: Workspace | None = None,
        record_nodes: bool = False,
    ) -> Rollout:
        """Simulate a batch; every argument is shared (one row) or per world.

        Args:
            cable: Cable whose `params` are shared or one value per world, or a sequence with one
                cable per world, which `EngineWarp` alone takes.
            grip_path: Path of the gripper, one row or one per world.
            initial_state: State at time 0, one row or one per world; by default `reset_state`.
            duration: Simulated time [s]; by default the longest motion plus `SETTLE_TIME`.
            sample_dt: Time between samples [s], rounded to whole steps of the engine.
            far_path: Path that the far end is held on; free if None. Its direction is that in
                which the cable arrives there, as the cable leaves the near gripper along that of
                `grip_path`. `EngineWarp` clamps the far end in this direction and turns it by the
                roll; the other engines hold its place only.
            edges: Table whose edges the cable may hang over, in `EngineWarp`; that of the other
                engines, and of None, is endless.
            record_nodes: True to return the cable's shapes, too.

        Raises:
            InputError: Batches of different sizes, or a duration or interval out of bounds.
        """
        ...


# The descent is nowhere steeper than 0.6, so that 6 steps leave no error beyond rounding.
_NEWTON_STEPS = 6

SETTLE_TIME = 2.0
"""Time that a rollout goes on after the motion by default [s]: casts settle within 1.5 s."""


def batch_size(*counts: int | None) -> int:
    """Return the number of worlds that several arguments agree on; None and 1 go with any."""
    sizes = sorted({count for count in counts if count not in (None, 1)})
    if len(sizes) > 1:
        raise InputError(f"arguments have different numbers of worlds: {sizes}")
    return sizes[0] if sizes else 1


def reset_state(
    cable: Cable | Sequence[Cable], grip_path: GripPath, segment_count: int
) -> CableState:
    """Return the cable as the paper's reset leaves it: straight, at rest, pulled to the robot.

    The gripper holds the near end a little above the table; from there the cable descends as a
    heavy elastic beam, clamped level at height h, that touches down with no slope and no moment:
    z = h (1 - s)^3 (1 + 3 s) over the touchdown length (72 EI h / (rho g))^(1/4). Every segment
    has the same length.

    Args:
        cable: Cable, shared or a sequence with one per world; its bend stiffness and mass shape the
            descent.
        grip_path: Path whose start gives the grip pose; the cable points along its yaw.
        segment_count: Number of segments.

    Returns:
        One state, or one per world where cables or grip paths differ.
    """
    start = grip_path.evaluate(grip_path.knots[:, :1])[:, 0]
    cables = CableRows.of(cable)
    params = cables.params
    world_count = batch_size(len(grip_path), cables.world_count)
    start = np.broadcast_to(start, (world_count, start.shape[1]))
    segment_length = cables.length / segment_count
    height = start[:, 2] - cables.radius
    weight = GRAVITY * np.asarray(params.mass) / cables.length
    touchdown = (72.0 * np.asarray(params.bend_stiffness) * np.abs(height) / weight) ** 0.25
    # A cable softer than it is high would fall steeply; a stiffer one than it is long reaches the
    # table only with its end.
    touchdown = np.clip(touchdown, 3.0 * np.abs(height) + 1e-9, cables.length)

    def descent(at):
        u = np.clip(at / touchdown, 0.0, 1.0)
        slope = -12.0 * height / touchdown * u * (1.0 - u) ** 2
        return height * (1.0 - u) ** 3 * (1.0 + 3.0 * u), slope

    s = np.zeros((world_count, segment_count + 1))
    z = np.zeros_like(s)
    z[:, 0] = height
    for node in range(segment_count):
        # Newton's method for the horizontal step whose end lies one segment length away.
        step = np.broadcast_to(segment_length, world_count).copy()
        for _ in range(_NEWTON_STEPS):
            end, slope = descent(s[:, node] + step)
            fall = end - z[:, node]
            excess = step**2 + fall**2 - segment_length**2
            step -= 0.5 * excess / (step + fall * slope)
        s[:, node + 1] = s[:, node] + step
        z[:, node + 1] = descent(s[:, node + 1])[0]
    positions = np.empty((*s.shape, 3))
    positions[..., 0] = start[:, None, 0] + s * np.sin(start[:, None, 3])
    positions[..., 1] = start[:, None, 1] + s * np.cos(start[:, None, 3])
    positions[..., 2] = cables.radius[:, None] + z
    return CableState.at_rest(positions)


@dataclasses.dataclass(frozen=True, kw_only=True)
class RolloutPlan:
    """Arguments of a rollout with every default filled in.

    Attributes:
        initial_state: State at time 0, one row or one per world.
        world_count: Number of worlds.
        steps_per_sample: Steps of the engine between two samples.
        sample_count: Number of samples, the first at time 0.
    """

    initial_state: CableState
    world_count: int
    steps_per_sample: int
    sample_count: int


def default_duration(grip_path: GripPath) -> float:
    """Return the simulated time of a batch whose caller names none [s]."""
    return float(grip_path.duration.max()) + SETTLE_TIME


def plan_rollout(
    engine: Engine,
    cable: Cable | Sequence[Cable],
    grip_path: GripPath,
    initial_state: CableState | None,
    duration: float | None,
    sample_dt: float,
    far_path: GripPath | None,
    plays_material: bool = False,
) -> RolloutPlan:
    """Check the arguments of `Engine.rollout` and fill in their defaults, alike for every engine.

    Raises:
        InputError: A material that the engine does not play, batches of different sizes, a state of
            another number of segments, or a duration or interval out of bounds.
    """
    cables = CableRows.of(cable)
    if not plays_material and cables.params.has_material:
        raise InputError("this engine knows no material beside the ten parameters: EngineWarp does")
    if not plays_material and not grip_path.is_level:
        raise InputError("the gripper of this engine keeps its side level: EngineWarp's may roll")
    twisted = initial_state is not None and bool(np.any(initial_state.far_roll))
    rolled = far_path is not None and far_path.roll is not None and bool(np.any(far_path.roll))
    if not plays_material and far_path is not None and (twisted or rolled):
        raise InputError("this engine lets the far end turn about itself: EngineWarp may twist it")
    if initial_state is None:
        initial_state = reset_state(cable, grip_path, engine.segment_count)
    elif initial_state.segment_count != engine.segment_count:
        raise InputError(
            f"the initial state has {initial_state.segment_count} segments, the engine "
            f"{engine.segment_count}"
        )
    if duration is None:
        duration = default_duration(grip_path)
    check_number("duration", duration, 1e-6, DURATION_MAX, "s")
    check_number("sample_dt", sample_dt, 1e-6, DURATION_MAX, "s")
    steps_per_sample = max(1, round(sample_dt / engine.dt))
    return RolloutPlan(
        initial_state=initial_state,
        world_count=batch_size(
            len(grip_path),
            initial_state.world_count,
            None if far_path is None else len(far_path),
            cables.world_count,
        ),
        steps_per_sample=steps_per_sample,
        sample_count=1 + int(np.ceil(duration / (steps_per_sample * engine.dt) - 1e-6)),
    )


def rows_of(values: Any, worlds: NDArray[np.int_]) -> Any:
    """Return the rows of some worlds: of cables, a state, a path, or an array.

    What all worlds share, a single row or None, is returned as it is.
    """
    if values is None or isinstance(values, (int, float)):
        return values
    if isinstance(values, Cable):
        return values.with_params(values.params.rows(worlds))
    if isinstance(values, (list, tuple)):
        return values if len(values) == 1 else [values[world] for world in worlds]
    if isinstance(values, CableState):
        if values.world_count == 1:
            return values
        fields = {f.name: getattr(values, f.name)[worlds] for f in dataclasses.fields(values)}
        return CableState(**fields)
    return values if len(values) == 1 else values[worlds]


def merge(parts: list[tuple[NDArray[np.int_], Rollout]]) -> Rollout:
    """Return the rollout of a batch from those of its parts, and the indices of their worlds.

    Together they name each world once.
    """
    if len(parts) == 1:
        return parts[0][1]
    order = np.argsort(np.concatenate([worlds for worlds, _ in parts]))
    rollouts = [rollout for _, rollout in parts]

    def joined(arrays: list[NDArray]) -> NDArray:
        return np.concatenate(arrays)[order]

    states = [rollout.final_state for rollout in rollouts]
    nodes = [rollout.nodes for rollout in rollouts if rollout.nodes is not None]
    forces = [rollout.forces for rollout in rollouts if rollout.forces is not None]
    return Rollout(
        times=rollouts[0].times,
        endpoint_xyz=joined([rollout.endpoint_xyz for rollout in rollouts]),
        final_state=rows_of(CableState.stack(states), order),
        finite=joined([rollout.finite for rollout in rollouts]),
        nodes=joined(nodes) if nodes else None,
        forces=CableForces(
            tension=joined([part.tension for part in forces]),
            grip=joined([part.grip for part in forces]),
            far_grip=None
            if forces[0].far_grip is None
            else joined([part.far_grip for part in forces if part.far_grip is not None]),
        )
        if forces
        else None,
    )


# Settings of an engine that affect its use of the machine, not its results.
_MACHINE_FIELDS = {"thread_count"}


def engine_settings(engine: Engine) -> dict[str, Any]:
    """Return the settings of an engine that decide its results: its class and public attributes.

    Only plain values are included, and the device by its name.
    """
    settings: dict[str, Any] = {"class": type(engine).__name__}
    for name, value in vars(engine).items():
        if name.startswith("_") or name in _MACHINE_FIELDS:
            continue
        if name == "device" or (isinstance(value, float) and not np.isfinite(value)):
            value = str(value)
        if isinstance(value, (bool, int, float, str)):
            settings[name] = value
    return settings
