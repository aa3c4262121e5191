"""Energy of EngineWarp: worlds that gain energy unmarked, and what an undamped swing loses.

stability: a world fails silently if it gains energy and is not marked. EngineWarp marks by its own
account of energy and work; here it is computed from recorded shapes, over the search space and at
many resolutions, undamped worlds included. Once the gripper has stopped no work is done, so that
kinetic, potential and elastic energy together can only fall.

swing: a cable clamped at an angle below the horizontal is let go from straight. Nothing resists it,
so that its energy should stay. Small swings keep it; a whip turns segments by so much within a step
that the length solve iterates along the turned edges, and that takes energy.
"""

import dataclasses
import sys
from collections.abc import Generator, Iterator

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import random_casts
from benchmarks.result import Table
from cablecast.cable import CABLE_NAMES, FITTED_MATERIAL, Cable, CableParams, load_cable
from cablecast.conventions import GRAVITY, tangent
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.engines.warp_.constants import clamp_cells
from cablecast.engines.warp_.engine import DEFAULT_DT, DEFAULT_SEGMENT_COUNT
from cablecast.motion.grip_path import GripPath
from cablecast.setup import Setup
from cablecast.tuning.space import SearchSpace

WORLD_COUNTS = {20: 2262, 30: 1800, 50: 600, 70: 240, 100: 96, 160: 24, 240: 9}
"""Worlds for each number of segments, at each step: fewer where they cost more."""
SCAN_STEPS = (1e-3, 5e-4, 2.5e-4, 1.25e-4)
V_MAX = 1.8
"""Speed of the paper's fastest casts [m/s]."""
CAST_COUNT = 240
SETTLE = 0.6
"""Time after the motion for which a world is watched [s]."""
SAMPLE_DT = 4e-3
BATCH = 96
"""Worlds at a time, as their shapes are recorded."""
GROWN = 0.5
"""Growth that counts, as a share of the greatest kinetic energy, as in the engine. Recorded shapes
give mean speeds between two samples only, and no twist, which may give back as much as a third, at
any step."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class StabilityArgs:
    """Worlds over the search space at many resolutions: none may gain energy and go unmarked.

    Attributes:
        cables: Names of presets.
        share: Share of the 20,124 worlds to play.
        materials: Draw a material for each world, too: what a fit can find of the cable.
        seed: Seed of the draws.
    """

    cables: tuple[str, ...] = CABLE_NAMES
    share: float = 1.0
    materials: bool = False
    seed: int = 0


def draw_worlds(cable: Cable, count: int, seed: int) -> CableParams:
    """Return parameters over the search space of a cable; every second world is undamped."""
    space = SearchSpace.for_cable(cable)
    unit = np.random.default_rng(seed).uniform(size=(count, space.dimension))
    params = space.to_params(unit)
    damped = np.arange(count) % 2
    return dataclasses.replace(
        params,
        linear_damping=damped * params.linear_damping,
        angular_damping=damped * params.angular_damping,
    )


def with_materials(cable: Cable, params: CableParams, seed: int) -> CableParams:
    """Return parameters with a material for each world, over the whole range that a fit searches.

    The attachment stays a point mass: shapes do not show the energy of a rod that turns.
    """
    names = [name for name in FITTED_MATERIAL if name != "attachment_arm"]
    space = SearchSpace.for_cable(cable, names)
    unit = space.to_unit(params)
    size = (len(unit), len(names))
    unit[:, -len(names) :] = np.random.default_rng([seed, 1]).uniform(size=size)
    drawn = space.to_params(unit)
    material = {name: getattr(drawn, name) for name in (*names, "yield_time")}
    return dataclasses.replace(params, **material)


def energies(
    cable: Cable, params: CableParams, paths: GripPath, nodes: NDArray[np.float64], dt: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the kinetic energy between samples, and the potential one once grippers rest [J].

    Args:
        cable: Geometry.
        params: One value per world.
        paths: Motion of the grippers, whose last pose clamps the cable.
        nodes: Shapes [m], shape [world, step, node, 3].
        dt: Time between samples [s].

    Returns:
        Two arrays of shape [world, step - 1].
    """
    segment_count = nodes.shape[2] - 1
    values = dict(zip(params.names(), params.to_array().T, strict=True))
    mass = np.repeat(values["mass"][:, None] / segment_count, segment_count + 1, axis=1)
    mass[:, -1] = 0.5 * mass[:, -1] + values["endpoint_mass"]
    mass[:, 0] = 0.0
    speed = np.diff(nodes, axis=1) / dt
    kinetic = 0.5 * np.einsum("wn,wtnc,wtnc->wt", mass, speed, speed)
    length = cable.length / segment_count
    edges = np.diff(nodes, axis=2) / length
    bend = 0.5 * np.linalg.norm(np.diff(edges, axis=2), axis=-1)
    angle = 2.0 * np.arcsin(np.clip(bend, 0.0, 1.0))
    last = paths.evaluate(paths.duration[:, None])[:, 0]
    clamp = tangent(last[:, 3], last[:, 4])
    held = ((edges[:, :, 0] - clamp[:, None]) ** 2).sum(axis=2)
    bent = 0.5 * (angle**2).sum(axis=2)
    bent += 0.5 * clamp_cells(values, np.full(len(mass), length))[:, None] * held
    potential = GRAVITY * np.einsum("wn,wtn->wt", mass, nodes[..., 2])
    potential += values["bend_stiffness"][:, None] / length * bent
    return kinetic, 0.5 * (potential[:, 1:] + potential[:, :-1])


def growth(
    kinetic: NDArray[np.float64],
    potential: NDArray[np.float64],
    stopped: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return the most energy that each world gains once its gripper has stopped.

    Args:
        kinetic: Kinetic energy [J], shape [world, step].
        potential: Potential energy [J], same shape.
        stopped: True once the gripper rests, same shape.

    Returns:
        Greatest gain from any time to a later one, as a share of the greatest kinetic energy [-],
        shape [world]; NaN where a world is marked.
    """
    total = np.where(stopped, kinetic + potential, np.inf)
    with np.errstate(invalid="ignore"):
        gained = np.where(stopped, total - np.minimum.accumulate(total, axis=1), 0.0)
    return gained.max(axis=1) / kinetic.max(axis=1)


def scan(
    cable: Cable, segment_count: int, dt: float, count: int, seed: int, materials: bool
) -> tuple[int, int, float]:
    """Return the number of marked worlds, of those that grow unmarked, and the most growth.

    Args:
        cable: Cable around which parameters are drawn.
        segment_count: Number of segments.
        dt: Step [s].
        count: Number of worlds.
        seed: Seed of parameters and casts.
        materials: True to draw materials. What their springs and bends hold is not counted: such a
            world may seem to gain what it gives back.
    """
    casts = random_casts(CAST_COUNT, seed, Setup().with_motion(v_max=V_MAX))
    params = draw_worlds(cable, count, seed)
    if materials:
        params = with_materials(cable, params, seed)
    engine = EngineWarp(segment_count=segment_count, dt=dt)
    marked, grown, most = 0, 0, 0.0
    for start in range(0, count, BATCH):
        rows = np.arange(start, min(start + BATCH, count))
        paths = casts[rows % CAST_COUNT]
        part = params.rows(rows)
        rollout = engine.rollout(
            cable.with_params(part),
            paths,
            duration=float(paths.duration.max()) + SETTLE,
            sample_dt=SAMPLE_DT,
            record_nodes=True,
        )
        kinetic, potential = energies(cable, part, paths, rollout.nodes, SAMPLE_DT)
        stopped = rollout.times[:-1] > np.asarray(paths.duration)[:, None]
        gained = growth(kinetic, potential, stopped)
        most = max(most, float(np.nanmax(gained)))
        marked += int((~rollout.finite).sum())
        grown += int((rollout.finite & ~(gained <= GROWN)).sum())
    return marked, grown, most


def stability(args: StabilityArgs) -> Generator[Table, None, int]:
    """Yield marked worlds and those that grow unmarked; status 1 where there is one."""
    table = Table(
        f"Parameters over the search space, every second world undamped, v_max {V_MAX:g} m/s",
        ("segments", "step [ms]", "worlds", "marked", "grown and not marked", "most growth"),
        [],
    )
    for segment_count, count in WORLD_COUNTS.items():
        for dt in SCAN_STEPS:
            each = max(1, round(args.share * count / len(args.cables)))
            found = [
                scan(load_cable(name), segment_count, dt, each, args.seed + index, args.materials)
                for index, name in enumerate(args.cables)
            ]
            marked, grown, most = zip(*found, strict=True)
            worlds = each * len(args.cables)
            row = (segment_count, dt * 1e3, worlds, sum(marked), sum(grown), round(max(most), 3))
            table.rows.append(row)
            print(*row, file=sys.stderr, flush=True)
    worlds, marked, grown = (sum(row[i] for row in table.rows) for i in (2, 3, 4))
    table.rows.append(("all", "", worlds, marked, grown, max(row[5] for row in table.rows)))
    yield table
    return 1 if grown else 0


PITCHES_DEG = (-45.0, -30.0, 0.0)
"""Directions of the clamp: steep ones swing little, a level one whips."""
SWING_STEPS = (1e-3, DEFAULT_DT, 2.5e-4, 1.25e-4)
WINDOW = 0.05
"""Time over which the energy is averaged at the start and at the end [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SwingArgs:
    """Energy lost by an undamped swing.

    Attributes:
        cables: Names of presets.
        duration: Duration of the swing [s].
        segment_count: Number of segments.
    """

    cables: tuple[str, ...] = CABLE_NAMES
    duration: float = 2.5
    segment_count: int = DEFAULT_SEGMENT_COUNT


def swing_losses(
    cable: Cable, pitches: NDArray[np.float64], segment_count: int, dt: float, duration: float
) -> NDArray[np.float64]:
    """Return the energy lost, as a share of the greatest kinetic energy [-], shape [pitch].

    Args:
        cable: Cable, whose damping is left out.
        pitches: Directions of clamp and cable [rad], shape [pitch].
        segment_count: Number of segments.
        dt: Step [s].
        duration: Duration of the swing [s].
    """
    params = dataclasses.replace(cable.params, linear_damping=0.0, angular_damping=0.0)
    along = np.linspace(0.0, cable.length, segment_count + 1)
    nodes = np.zeros((len(pitches), segment_count + 1, 3))
    nodes[..., 1] = along * np.cos(pitches)[:, None]
    nodes[..., 2] = along * np.sin(pitches)[:, None]
    paths = GripPath.stack([GripPath.hold([0.0, 0.0, 0.0, 0.0, p], 1.0) for p in pitches])
    engine = EngineWarp(segment_count=segment_count, dt=dt, precision="double", table=False)
    rollout = engine.rollout(
        cable.with_params(params),
        paths,
        CableState.at_rest(nodes),
        duration=duration,
        sample_dt=dt,
        record_nodes=True,
    )
    worlds = CableParams.from_array(np.tile(params.to_array(), (len(pitches), 1)))
    kinetic, potential = energies(cable, worlds, paths, rollout.nodes, dt)
    total, window = kinetic + potential, round(WINDOW / dt)
    lost = total[:, :window].mean(axis=1) - total[:, -window:].mean(axis=1)
    return lost / kinetic.max(axis=1)


def swing(args: SwingArgs) -> Iterator[Table]:
    """Yield the loss of each cable, step and clamp."""
    pitches = np.radians(PITCHES_DEG)
    table = Table(
        f"Energy lost in {args.duration:g} s, {args.segment_count} segments, in % of the greatest "
        "kinetic energy, by the pitch of the clamp",
        ("cable", "step [ms]", *(f"{pitch:g} deg" for pitch in PITCHES_DEG)),
        [],
    )
    for name in args.cables:
        for dt in SWING_STEPS:
            losses = swing_losses(load_cable(name), pitches, args.segment_count, dt, args.duration)
            table.rows.append((name, dt * 1e3, *(100.0 * losses).round(2).tolist()))
    yield table
