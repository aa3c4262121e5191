"""A second world to evaluate methods in: fast, and different in other ways than the virtual rig.

The rod has half as many segments as the simulator that is fitted to it, each of its parameters
differs from the believed one, friction differs from place to place on the table, the cable keeps a
curl to one side, the arm lags and its base joint saturates, and equal casts scatter. Each of these
is drawn from `lab_seed`. A cast takes about 20 ms, so that hundreds of targets can be cast at.
"""

import dataclasses
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.capsule_chain import CapsuleChain
from cablecast.cable import CableParams
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.engines.base import SETTLE_TIME, CableState, reset_state
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.measured import grip_path_from_joints
from cablecast.motion.servo import ServoModel
from cablecast.motion.trajectory import JointPath, Trajectory
from cablecast.rigs.base import RigLifecycle, purpose_seed
from cablecast.setup import Setup

SEGMENT_COUNT, DT = 25, 1e-3
SAMPLE_DT = 0.05
HIDDEN_RADIUS = 0.07
"""Landings nearer to the gripper than this are hidden below the arm [m]."""

BELIEF_SPREAD = {
    "twist_stiffness": 0.45,
    "bend_stiffness": 0.45,
    "mass": 0.08,
    "endpoint_mass": 0.2,
    "lateral_friction": 0.2,
    "spinning_friction": 0.7,
    "rolling_friction": 0.7,
    "linear_damping": 0.7,
    "angular_damping": 0.7,
}
"""Standard deviations of the logarithm of the truth over what is believed."""


def world_draws(setup: Setup, lab_seed: int) -> np.random.Generator:
    """Return what draws the properties of a world."""
    return np.random.default_rng([lab_seed, zlib.crc32(setup.cable.name.encode()), 3])


def other_params(setup: Setup, rng: np.random.Generator) -> dict[str, float]:
    """Return parameters as far from what is believed of a cable as they often are."""
    believed = setup.cable.params.to_dict()
    return {
        name: believed[name] * float(np.exp(BELIEF_SPREAD.get(name, 0.0) * rng.normal()))
        for name in believed
    }


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scatter:
    """Standard deviations of what differs between equal casts.

    Attributes:
        angle: Direction of the cable after a reset [rad].
        bow: Sideways bow of the cable after a reset [1/m].
        friction: Relative change of the friction [-].
    """

    angle: float = 0.004
    bow: float = 0.04
    friction: float = 0.01


class StrangeRig(RigLifecycle):
    """A rig whose physics the fitted simulator lacks.

    Args:
        setup: Cable, workspace, arm and motion settings.
        seed: Seed of what differs from trial to trial.
        lab_seed: Seed of the world.
        scatter: Differences between equal casts.
        unevenness: Standard deviation of the friction from place to place over its mean [-].
        along: True for a cast with the mean friction along the way of its free end; False for one
            with the friction of the place where it comes to rest.
        chain: True for a chain of capsules in MuJoCo in place of the engine; a cast takes a second.
    """

    def __init__(
        self,
        setup: Setup,
        seed: int = 0,
        lab_seed: int = 0,
        scatter: Scatter | None = None,
        unevenness: float = 0.08,
        along: bool = False,
        chain: bool = False,
    ):
        super().__init__()
        self.setup, self.seed = setup, seed
        self.scatter, self.unevenness, self.along = scatter or Scatter(), unevenness, along
        self._draw = (seed, 0)
        rng = world_draws(setup, lab_seed)
        self.params = other_params(setup, rng)
        self.curl = 0.25 * float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.5, 1.5))
        self.waves = rng.normal(scale=8.0, size=(12, 2))
        self.phases = rng.uniform(0.0, 2 * np.pi, 12)
        self.servo = ServoModel(
            delay=np.full(6, 0.012),
            frequency=2 * np.pi * 7.0 * np.exp(0.05 * rng.normal(size=6)),
            damping=np.full(6, 0.78),
        )
        self.rate_max = float(rng.uniform(2.1, 2.5))
        self.engine = CapsuleChain() if chain else EngineWarp(SEGMENT_COUNT, DT, thread_count=1)
        self.description: dict[str, Any] = {
            "rig": "strange",
            "seed": seed,
            "lab_seed": lab_seed,
            "scatter": dataclasses.asdict(self.scatter),
            "unevenness": unevenness,
            "along": along,
            "chain": chain,
        }

    def seek(self, index: int, purpose: str = "") -> None:
        self._draw = (purpose_seed(self.seed, purpose), index)

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        self._use_reset()
        rng = np.random.default_rng(self._draw)
        self._draw = (self._draw[0], self._draw[1] + 1)
        angle, bow, friction = rng.normal(size=3) * dataclasses.astuple(self.scatter)
        joints = self._move(trajectory)
        path = grip_path_from_joints(joints, self.setup.arm)
        duration = float(trajectory.duration) + SETTLE_TIME
        factor, xy, times = 1.0 + friction, np.empty((0, 2)), np.empty(0)
        # The friction follows from where the cable goes: find its way, then the friction there.
        for _ in range(2):
            params = self._params(factor)
            cable = self.setup.cable.with_params(params)
            state = reset_state(cable, path, self.engine.segment_count)
            rollout = self.engine.rollout(
                cable,
                path,
                _bent(state, angle, self.curl + bow),
                duration=duration,
                sample_dt=SAMPLE_DT,
            )
            xy, times = rollout.endpoint_xy[0], rollout.times
            factor = (1.0 + friction) * self._friction_of(xy)
            if not self.unevenness:
                break
        seen = xy + rng.normal(scale=0.001, size=xy.shape)
        status = self._status(xy, trajectory)
        if status is TrialStatus.OCCLUDED:
            seen[-1] = np.nan
        return EndpointTrack(times=times, endpoint_xy=seen, status=status, joint_path=joints)

    def _status(self, xy: NDArray[np.float64], trajectory: Trajectory) -> TrialStatus:
        if not np.isfinite(xy).all():
            return TrialStatus.NON_FINITE
        if not self.setup.workspace.on_table(xy[-1]):
            return TrialStatus.OFF_TABLE
        path = trajectory.grip_path
        grip = path.evaluate(path.duration[None, :1])[0, 0, :2]
        if np.linalg.norm(xy[-1] - grip) < HIDDEN_RADIUS:
            return TrialStatus.OCCLUDED
        return TrialStatus.OK

    def _params(self, factor: float) -> CableParams:
        values = dict(self.params)
        values["lateral_friction"] = float(np.clip(values["lateral_friction"] * factor, 0.05, 2.0))
        return CableParams(**values)

    def _friction_of(self, xy: NDArray[np.float64]) -> float:
        """Return the friction of a cast over the mean of the table, shape of the way [step, 2]."""
        places = np.nan_to_num(xy)
        waves = np.cos(places @ self.waves.T + self.phases)
        friction = 1.0 + self.unevenness * np.sqrt(2.0 / len(self.waves)) * waves.sum(axis=1)
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        if not self.along or not steps.any():
            return float(friction[-1])
        return float(np.average((friction[1:] + friction[:-1]) / 2, weights=steps))

    def _move(self, trajectory: Trajectory) -> JointPath:
        """Return the joints as they move: late, and the base no faster than it can."""
        path = trajectory.joint_path
        if path is None:
            raise ValueError("the strange rig plays motions with joints only")
        dt = float(path.times[1] - path.times[0])
        tail = round(0.6 / dt)
        q = np.concatenate([path.q, np.repeat(path.q[-1:], tail, axis=0)])
        limited = q.copy()
        step = self.rate_max * dt
        for tick in range(1, len(q)):
            limited[tick, 0] = limited[tick - 1, 0] + np.clip(
                q[tick, 0] - limited[tick - 1, 0], -step, step
            )
        moved = self.servo.respond(limited, dt)
        times = path.times[0] + dt * np.arange(len(q))
        return JointPath(times=times, q=moved, qd=np.gradient(moved, times, axis=0))


def _bent(state: CableState, angle: float, curl: float) -> CableState:
    """Return a cable that is turned about the grip and curved sideways, with segments as long."""
    steps = np.diff(state.positions[0], axis=0)
    level = np.hypot(steps[:, 0], steps[:, 1])
    heading = np.arctan2(steps[:, 0], steps[:, 1])
    along = np.cumsum(level)
    # Straight on average: curved about the chord, not away from it.
    heading = heading + angle + curl * (along - along.mean())
    turned = np.stack([level * np.sin(heading), level * np.cos(heading), steps[:, 2]], axis=1)
    positions = state.positions.copy()
    positions[0, 1:] = positions[0, 0] + np.cumsum(turned, axis=0)
    return CableState.at_rest(positions)
