"""No silent failure: worlds over the search space, at many resolutions, undamped ones included.

A world fails silently if it gains energy and is not marked. EngineWarp marks by its own account of
energy and work; here the recorded shapes are judged. Once the gripper has stopped no work is done,
so that kinetic, potential and elastic energy together can only fall.
"""

import dataclasses
import pathlib

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Table, random_casts, write_json
from cablecast.cable import CABLE_NAMES, FITTED_MATERIAL, Cable, CableParams, load_cable
from cablecast.conventions import GRAVITY, tangent
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.grip_path import GripPath
from cablecast.setup import Setup
from cablecast.tuning.space import SearchSpace

WORLD_COUNTS = {20: 2262, 30: 1800, 50: 600, 70: 240, 100: 96, 160: 24, 240: 9}
"""Worlds for each number of segments, at each step: fewer where they cost more."""
STEPS = (1e-3, 5e-4, 2.5e-4, 1.25e-4)
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
tell speeds only as a mean over the time between two samples, and nothing of the twist, which may
give back as much as a third, at any step."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Worlds over the search space at many resolutions: none may gain energy and go unmarked.

    Attributes:
        cables: Names of presets.
        share: Share of the 20,124 worlds to play.
        materials: Draw a material for each world, too: what a fit can find of the cable.
        seed: Seed of the draws.
        json: File that gets the figures, too.
    """

    cables: tuple[str, ...] = CABLE_NAMES
    share: float = 1.0
    materials: bool = False
    seed: int = 0
    json: pathlib.Path | None = None


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

    The attachment stays a point mass: shapes tell nothing of the energy of a rod that turns.
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
    # Half a cell at the grip.
    bent = 0.5 * (angle**2).sum(axis=2) + ((edges[:, :, 0] - clamp[:, None]) ** 2).sum(axis=2)
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
    cable: Cable, segment_count: int, dt: float, count: int, seed: int, materials: bool = False
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
        assert rollout.nodes is not None
        kinetic, potential = energies(cable, part, paths, rollout.nodes, SAMPLE_DT)
        stopped = rollout.times[:-1] > np.asarray(paths.duration)[:, None]
        gained = growth(kinetic, potential, stopped)
        most = max(most, float(np.nanmax(gained)))
        marked += int((~rollout.finite).sum())
        grown += int((rollout.finite & ~(gained <= GROWN)).sum())
    return marked, grown, most


def main(args: Args) -> int:
    """Print marked worlds and those that grow unmarked; status 1 where there is one."""
    table = Table(
        f"Parameters over the search space, every second world undamped, v_max {V_MAX:g} m/s",
        ("segments", "step [ms]", "worlds", "marked", "grown and not marked", "most growth"),
        [],
    )
    for segment_count, count in WORLD_COUNTS.items():
        for dt in STEPS:
            each = max(1, round(args.share * count / len(args.cables)))
            found = [
                scan(load_cable(name), segment_count, dt, each, args.seed + index, args.materials)
                for index, name in enumerate(args.cables)
            ]
            marked, grown, most = zip(*found, strict=True)
            worlds = each * len(args.cables)
            row = (segment_count, dt * 1e3, worlds, sum(marked), sum(grown), round(max(most), 3))
            table.rows.append(row)
            print(*row, flush=True)
    worlds, marked, grown = (sum(row[i] for row in table.rows) for i in (2, 3, 4))
    table.rows.append(("all", "", worlds, marked, grown, max(row[5] for row in table.rows)))
    print(table)
    write_json(args.json, [table])
    return 1 if grown else 0
