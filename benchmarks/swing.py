"""Energy that an undamped swing loses: the method's own damping, by step and strength of the swing.

A cable clamped at an angle below the horizontal is let go from straight. Nothing resists it, so
that its energy should stay. Small swings keep it; a whip turns segments by so much within a step
that the length solve iterates along the turned edges, and that takes energy.
"""

import dataclasses
import pathlib

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Table, write_json
from benchmarks.stability import energies
from cablecast.cable import CABLE_NAMES, Cable, CableParams, load_cable
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.engines.warp_.engine import DEFAULT_DT, DEFAULT_SEGMENT_COUNT
from cablecast.motion.grip_path import GripPath

PITCHES_DEG = (-45.0, -30.0, 0.0)
"""Directions of the clamp: steep ones swing little, a level one whips."""
STEPS = (1e-3, DEFAULT_DT, 2.5e-4, 1.25e-4)
WINDOW = 0.05
"""Time over which the energy is averaged at the start and at the end [s]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Energy lost by an undamped swing.

    Attributes:
        cables: Names of presets.
        duration: Duration of the swing [s].
        segment_count: Number of segments.
        json: File that gets the figures, too.
    """

    cables: tuple[str, ...] = CABLE_NAMES
    duration: float = 2.5
    segment_count: int = DEFAULT_SEGMENT_COUNT
    json: pathlib.Path | None = None


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
    assert rollout.nodes is not None
    worlds = CableParams.from_array(np.tile(params.to_array(), (len(pitches), 1)))
    kinetic, potential = energies(cable, worlds, paths, rollout.nodes, dt)
    total, window = kinetic + potential, round(WINDOW / dt)
    lost = total[:, :window].mean(axis=1) - total[:, -window:].mean(axis=1)
    return lost / kinetic.max(axis=1)


def main(args: Args) -> None:
    """Print the loss of each cable, step and clamp."""
    pitches = np.radians(PITCHES_DEG)
    table = Table(
        f"Energy lost in {args.duration:g} s, {args.segment_count} segments, in % of the greatest "
        "kinetic energy, by the pitch of the clamp",
        ("cable", "step [ms]", *(f"{pitch:g} deg" for pitch in PITCHES_DEG)),
        [],
    )
    for name in args.cables:
        for dt in STEPS:
            losses = swing_losses(load_cable(name), pitches, args.segment_count, dt, args.duration)
            table.rows.append((name, dt * 1e3, *(100.0 * losses).round(2).tolist()))
    print(table)
    write_json(args.json, [table])
