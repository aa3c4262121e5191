"""Two scenes that simulators of cables have in common, with their converged solutions.

A swing needs no table: a cable without damping, clamped at one end, is let go from straight. A cast
needs Coulomb's friction, which is the only resistance here: few simulators know air, damped
rotation, rolling and spinning friction, and each has laws of its own for them.
"""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import random_casts
from cablecast.cable import Cable, CableParams
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.grip_path import GripPath

FINE = (160, 1.25e-4)
NEXT_FINE = (120, 1.25e-4)
"""Segments and step [s] of the converged solution, and of that whose distance tells its error."""

HEIGHT = 1.0
SWING_TIME = 1.0
CAST_TIME = 2.5
SAMPLE_DT = 0.02
STRETCHED = 1.05
"""Distance of the free end from the grip, over the cable's length, at which a world is broken."""

_RESISTANCES = ("linear_damping", "angular_damping", "rolling_friction", "spinning_friction")


def bare_params(cable: Cable) -> CableParams:
    """Return a cable's parameters with Coulomb's friction as the only resistance."""
    return dataclasses.replace(cable.params, **dict.fromkeys(_RESISTANCES, 0.0))


@dataclasses.dataclass(frozen=True)
class Scene:
    """Motions with the tracks of the free end that the converged EngineWarp finds.

    Attributes:
        cable: Cable.
        params: Parameters, shared.
        paths: Motions of the grip.
        state: Returns the initial state for a number of segments; None for the reset state.
        duration: Simulated time [s].
        times: Times of the tracks [s], shape [time].
        tracks: Tracks where segments roll, and where they slide only [m], each of shape
            [motion, time, 3].
    """

    cable: Cable
    params: CableParams
    paths: GripPath
    state: Callable[[int], CableState | None]
    duration: float
    times: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.zeros(0))
    tracks: dict[bool, NDArray[np.float64]] = dataclasses.field(default_factory=dict)

    def play(self, engine: Any, world_count: int | None = None, *, rolls: bool = True):
        """Return a rollout and the time that this process computed for it [s].

        Args:
            engine: Answers `Engine.rollout`.
            world_count: Worlds; the motions are repeated. One of each by default.
            rolls: False for a rolling friction that keeps EngineWarp's segments from rolling.
        """
        rows = np.arange(world_count or len(self.paths)) % len(self.paths)
        state, params = self.state(engine.segment_count), self.params
        if state is not None and state.world_count > 1:
            state = CableState.at_rest(state.positions[rows])
        if not rolls:
            params = dataclasses.replace(params, rolling_friction=0.1, twist_stiffness=0.0)
        start = time.process_time()
        rollout = engine.rollout(
            self.cable.with_params(params), self.paths[rows], state, self.duration, SAMPLE_DT
        )
        return rollout, time.process_time() - start

    def solved(self, segment_count: int, dt: float) -> "Scene":
        """Return the scene with the tracks of EngineWarp at a number of segments and a step [s]."""
        tracks, times = {}, self.times
        for rolls in (True, False):
            rollout = self.play(fine_engine(segment_count, dt), rolls=rolls)[0]
            tracks[rolls], times = rollout.endpoint_xyz, rollout.times
        return dataclasses.replace(self, times=times, tracks=tracks)

    def errors(self, rollout: Any, rolls: bool) -> NDArray[np.float64]:
        """Return distances of the free end from the converged tracks.

        Args:
            rollout: Rollout whose first worlds are the motions.
            rolls: True to compare with segments that roll.

        Returns:
            Distances in % of cable length, shape [motion, time].
        """
        track = np.empty_like(self.tracks[rolls])
        # An engine whose step does not divide the interval samples at times of its own.
        for world, axis in np.ndindex(len(track), 3):
            values = rollout.endpoint_xyz[world, :, axis]
            track[world, :, axis] = np.interp(self.times, rollout.times, values)
        return 100.0 * np.linalg.norm(track - self.tracks[rolls], axis=-1) / self.cable.length

    def whole(self, rollout: Any) -> NDArray[np.bool_]:
        """Return which worlds stayed finite, their cable neither torn nor thrown, shape [world]."""
        count = len(rollout.endpoint_xyz)
        grips = self.paths[np.arange(count) % len(self.paths)].evaluate(rollout.times)[..., :3]
        with np.errstate(invalid="ignore", over="ignore"):
            reach = np.linalg.norm(rollout.endpoint_xyz - grips, axis=-1)
        return np.all(reach <= STRETCHED * self.cable.length, axis=1)


def fine_engine(segment_count: int, dt: float) -> EngineWarp:
    """Return EngineWarp in double precision that plays to the end."""
    return EngineWarp(segment_count=segment_count, dt=dt, precision="double", rest_speed=0.0)


def swings(cable: Cable, pitches: NDArray[np.float64], duration: float = SWING_TIME) -> Scene:
    """Return cables that are let go from straight; those from level whip.

    Args:
        cable: Cable.
        pitches: Directions of clamp and cable above the horizontal [rad], shape [motion].
        duration: Simulated time [s].
    """
    paths = GripPath.stack([GripPath.hold([0.0, 0.0, HEIGHT, 0.0, p], 1.0) for p in pitches])

    def state(segment_count: int) -> CableState:
        along = np.linspace(0.0, cable.length, segment_count + 1)
        nodes = np.zeros((len(pitches), segment_count + 1, 3))
        nodes[..., 1] = along * np.cos(pitches)[:, None]
        nodes[..., 2] = HEIGHT + along * np.sin(pitches)[:, None]
        return CableState.at_rest(nodes)

    return Scene(cable, bare_params(cable), paths, state, duration)


def casts(cable: Cable, count: int, seed: int) -> Scene:
    """Return random feasible casts from the reset state, at v_max 1.5 m/s with psi."""
    paths = random_casts(count, seed)
    return Scene(cable, bare_params(cable), paths, lambda _: None, CAST_TIME)
