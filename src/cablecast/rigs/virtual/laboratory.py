"""The laboratory: cables in MuJoCo, played trial by trial or followed live, and their endpoints.

`Laboratory` plays whole motions, many at once. A controller does not know a motion before it
starts: `LiveCable` follows the grip of an arm that may be stopped anywhere. The cables, the table
and what differs from trial to trial are the same.

Between two casts a live cable is not simulated. While the arm brings it back, it is carried along
as it is; once the arm rests in the reset pose, it is laid down as a reset leaves it (trials.py), as
for every trial of `Laboratory`.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.conventions import Array, tangent
from cablecast.engines.mujoco_ import quiet
from cablecast.files import core_count
from cablecast.motion.polar import reset_pose
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.virtual._hidden import (
    HiddenCable,
    effect_strengths,
    hidden_arm,
    hidden_cable,
    hidden_table,
)
from cablecast.rigs.virtual.arm import move_arm
from cablecast.rigs.virtual.config import VirtualConfig
from cablecast.rigs.virtual.forces import LabForces, friction_map
from cablecast.rigs.virtual.scene import Scene, build_scene
from cablecast.rigs.virtual.trials import Drift, Trial, initial_curl, reset_shape
from cablecast.setup import Setup

_WINDOW = 0.002
"""Time after which the forces that MuJoCo lacks are renewed, and the endpoint is looked at [s]."""
_OFF_TABLE_TIME = 0.5
"""Time after the motion for which a cable that fell is watched [s]: it hangs and swings. One that
only swept past the edge, and came back to rest on the table, has landed."""
_FALLEN_Z = -0.005
"""Height below which the endpoint hangs over the edge [m]; a contact never gives way so far."""
_REST_MOVE = 5e-4
"""Largest way of an endpoint at rest within _REST_TIME [m]."""
_REST_TIME = 0.1
"""Time between looks for rest [s], however often the cable is recorded for a camera."""
_GROUP_SIZE = 64
"""Trials in memory at once."""
_RESET_REACH = 0.003
"""Distance from the reset pose within which a cable is laid down [m and rad]."""
_AWAY = 0.05
"""Distance from the reset pose beyond which the next reset starts [m]."""
_GRAVITY, _SLIDING = 9.81, 4.0
"""Acceleration of gravity, and of friction on the table [m/s²]."""
_SLIP_SHARE = 0.2
"""Share of its length that a cable loses when it slips in the jaws [-]."""


class Laboratory:
    """A table, an arm and one cable.

    Every result of a trial depends on its motion and its draw alone, bit for bit: not on the trials
    beside it, nor on the number of threads.

    Args:
        setup: Cable, workspace, arm and motion settings.
        config: Settings of the laboratory.
        seed: Seed of what differs from day to day.
    """

    def __init__(self, setup: Setup, config: VirtualConfig, seed: int = 0):
        self.setup = setup
        self.config = config
        self.window = max(1, round(_WINDOW / config.dt))
        strengths = effect_strengths(config.lab_seed, config.without)
        self._truth: HiddenCable = hidden_cable(setup.cable, config.lab_seed, strengths)
        self._servos = hidden_arm(config.lab_seed, strengths)
        table = hidden_table(config.lab_seed, strengths)
        self._map = friction_map(table, setup.workspace)
        self.drift = Drift.of(table, seed)
        self.scene: Scene = build_scene(
            setup.cable, self._truth, setup.workspace, config.segment_count, config.dt, table.tilt
        )

    def reset_shape(self, pose: Array, trial: Trial) -> Array:
        """Return the cable as the reset of a trial leaves it [m], shape [vertex, 3]."""
        scene, cable, spread = self.scene, self.setup.cable, self._truth.reset_spread
        return reset_shape(cable, pose, trial, scene.arc_lengths, scene.end_height, spread)

    def run(
        self,
        trajectories: Sequence[Trajectory],
        trials: Sequence[Trial],
        progress: Callable[[int], None] | None = None,
    ) -> list[EndpointTrack]:
        """Play trials, each from its own reset state.

        Args:
            trajectories: Commanded motion of each trial.
            trials: Draw of each trial.
            progress: Called with the number of finished trials whenever it grows.
        """
        tracks: list[EndpointTrack] = []
        for start in range(0, len(trajectories), _GROUP_SIZE):
            group = slice(start, start + _GROUP_SIZE)

            def grown(count: int, before: int = start) -> None:
                if progress is not None:
                    progress(before + count)

            with quiet():
                tracks += _Group(self, trajectories[group], trials[group]).run(grown)
        return tracks


class Cables:
    """Cables that are stepped together, each in a trial of its own.

    Args:
        lab: Laboratory that they lie in.
        trials: Draw of each trial.
        poses: Pose of each grip at the start: x, y, z [m], yaw, pitch [rad], shape [world, 5].
        shapes: Cables at the start [m], each of shape [vertex, 3].

    Attributes:
        broken: Worlds that MuJoCo gave up, shape [world].
    """

    def __init__(
        self, lab: Laboratory, trials: Sequence[Trial], poses: Array, shapes: Sequence[Array]
    ):
        from mujoco.batch import Batch

        config, scene, count = lab.config, lab.scene, len(trials)
        thread_count = min(config.thread_count or core_count(), count)
        self._lab = lab
        self._batch: Any = Batch(scene.model, count, thread_count)  # pyright: ignore
        self._qpos, self._qvel, self._force = (
            self._batch.bind(name) for name in ("qpos", "qvel", "qfrc_applied")
        )
        friction, tip_friction = (
            self._batch.expand(name) for name in ("flex_friction", "geom_friction")
        )
        for world, trial in enumerate(trials):
            friction[world, ..., 0] *= trial.friction_factor
            tip_friction[world, :, 0] *= trial.friction_factor
            scene.lay_down(self._qpos[world], poses[world], shapes[world], trial.tip_roll)
        self._forces = LabForces(
            lab.setup.cable,
            lab._truth,
            lab._map,
            scene.arc_lengths,
            scene.masses,
            np.array(friction).reshape(count, -1)[:, 0],
            np.stack([initial_curl(trial, lab._truth, scene.arc_lengths) for trial in trials]),
            scene.stiffness,
        )
        self.broken = np.zeros(count, dtype=bool)

    def _rows(self, active: NDArray[np.intp]) -> NDArray[np.intp] | slice:
        """Return the rows of some worlds: no index array, which copies, for all."""
        return slice(None) if len(active) == len(self.broken) else active

    def advance(self, active: NDArray[np.intp], controls: Array) -> None:
        """Advance some worlds by a window or less, after renewing the forces that MuJoCo lacks.

        Args:
            active: Indices of the worlds.
            controls: Targets of the hand's servos, shape [active, step, 5].
        """
        from mujoco.batch import SimulationError

        lab, rows = self._lab, self._rows(active)
        motion = lab.scene.motion(self._qpos[rows], self._qvel[rows])
        # Diverged worlds run on until their trials end.
        with np.errstate(all="ignore"):
            force = self._forces.evaluate(motion, active, lab.window * lab.config.dt)
        self._force[rows, lab.scene.vertex_slice] = force.reshape(len(active), -1)
        try:
            self._batch.rollout(controls.shape[1], control=controls, record=(), ids=active)
        except SimulationError as error:
            self.broken[np.asarray(error.ids, dtype=int)] = True

    def vertices(self, active: NDArray[np.intp]) -> Array:
        """Return the vertices of some worlds' cables [m], shape [active, vertex, 3]."""
        return self._lab.scene.vertices(self._qpos[self._rows(active)])

    def warned(self, active: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Return of which of some worlds MuJoCo has warned, shape [active]."""
        return self._batch.warning[active].reshape(len(active), -1).any(axis=1)

    def rest(self, active: NDArray[np.intp], tips: Array, before: Array) -> NDArray[np.bool_]:
        """Return which cables are at rest, from endpoints now and _REST_TIME ago [m], [active]."""
        speed = np.abs(self._qvel[active, self._lab.scene.vertex_slice]).max(axis=1)
        move = np.abs(tips - before).max(axis=1)
        return (speed < self._lab.config.rest_speed) & (move < _REST_MOVE)


class _Group:
    """Trials that are stepped together."""

    def __init__(
        self, lab: Laboratory, trajectories: Sequence[Trajectory], trials: Sequence[Trial]
    ):
        config, scene = lab.config, lab.scene
        self.lab = lab
        self.count = len(trajectories)
        # Samples fall on whole windows.
        self.window_count = max(1, round(round(config.sample_dt / config.dt) / lab.window))
        self.sample_dt = float(self.window_count * lab.window * config.dt)
        self.motion_time = np.array([trajectory.duration for trajectory in trajectories])
        sample_max = np.ceil((self.motion_time + config.rest_time_max) / self.sample_dt)
        self.last_sample = sample_max.astype(int)
        self.times = np.arange(int(self.last_sample.max()) + 1) * self.sample_dt
        step_count = int(self.last_sample.max()) * self.window_count * lab.window
        self.arm = move_arm(trajectories, trials, lab.setup.arm, lab._servos, config.dt, step_count)
        self.reset_windows = math.ceil(config.reset_time / (lab.window * config.dt))
        controls = []
        for motion in self.arm:
            held = np.repeat(motion.poses[:1], self.reset_windows * lab.window, axis=0)
            poses = np.concatenate([held, motion.poses])
            controls.append(scene.controls(poses, config.dt))
        self.controls = np.stack(controls)
        starts = np.stack([motion.poses[0] for motion in self.arm])
        shapes = [lab.reset_shape(*values) for values in zip(starts, trials, strict=True)]
        self.cables = Cables(lab, trials, starts, shapes)
        self.nodes = np.full((self.count, len(self.times), len(scene.arc_lengths), 3), np.nan)
        self.off_table = np.zeros(self.count, dtype=bool)

    def run(self, progress: Callable[[int], None]) -> list[EndpointTrack]:
        """Simulate until every trial is over."""
        active = np.arange(self.count)
        step = self._advance(active, 0, self.reset_windows)
        self._sample(active, 0)
        for sample in range(1, len(self.times)):
            step = self._advance(active, step, self.window_count)
            self._sample(active, sample)
            over = self._over(active, sample)
            if over.any():
                self.last_sample[active[over]] = sample
                active = active[~over]
                progress(self.count - len(active))
            if not len(active):
                break
        return [self._track(world) for world in range(self.count)]

    def _advance(self, active: NDArray[np.intp], step: int, window_count: int) -> int:
        """Advance all trials that still run by some windows, and return the step after them."""
        for _ in range(window_count):
            end = step + self.lab.window
            self.cables.advance(active, self.controls[active, step:end])
            step = end
        return step

    def _sample(self, active: NDArray[np.intp], sample: int) -> None:
        vertices = self.cables.vertices(active)
        self.nodes[active, sample] = vertices
        tip = vertices[:, -1]
        on_table = self.lab.setup.workspace.on_table(tip[:, :2]) & (tip[:, 2] > _FALLEN_Z)
        self.off_table[active] = ~on_table
        finite = np.isfinite(vertices).all(axis=(1, 2))
        self.cables.broken[active] |= ~finite | self.cables.warned(active)

    def _over(self, active: NDArray[np.intp], sample: int) -> NDArray[np.bool_]:
        """Return which trials are over: at rest, fallen, broken, or out of time."""
        over = self.cables.broken[active] | (sample >= self.last_sample[active])
        back = max(1, round(_REST_TIME / self.sample_dt))
        if sample % back == 0:
            after_motion = self.times[sample] - self.motion_time[active]
            tips, before = (self.nodes[active, max(k, 0), -1] for k in (sample, sample - back))
            over |= (after_motion > 0) & self.cables.rest(active, tips, before)
            over |= self.off_table[active] & (after_motion > _OFF_TABLE_TIME)
        return over

    def _track(self, world: int) -> EndpointTrack:
        samples = slice(0, self.last_sample[world] + 1)
        nodes = self.nodes[world, samples]
        status = TrialStatus.OK
        if self.cables.broken[world]:
            status = TrialStatus.NON_FINITE
        elif self.off_table[world]:
            status = TrialStatus.OFF_TABLE
        return EndpointTrack(
            times=np.array(self.times[samples], dtype=float),
            endpoint_xy=nodes[:, -1, :2].copy(),
            status=status,
            nodes=nodes.copy(),
            joint_path=self.arm[world].joint_path,
        )


class LiveCable:
    """One cable in the gripper, simulated while it may move.

    Args:
        setup: Cable, table and reset pose.
        config: Settings of the laboratory.
        seed: Seed of what differs from trial to trial.

    Attributes:
        nodes: Cable from grip to endpoint [m], shape [vertex, 3].
        trial_count: Cables that were laid down.
        is_simulated: Whether the cable may move.
        lies_aside: Angle to the right by which the next reset leaves the cable aside [rad].
    """

    def __init__(self, setup: Setup, config: VirtualConfig, seed: int = 0):
        self._lab = Laboratory(setup, config, seed)
        self._seed = seed
        self._home = np.asarray(reset_pose(setup.workspace), dtype=float)
        self._cables: Cables | None = None
        self._poses = np.zeros((2, 5))
        self._rest_check = (0.0, np.zeros(3))
        self._settle_until = 0.0
        self._slipped = False
        self.trial_count = 0
        self._time = 0.0
        self._was_away = True
        self.is_simulated = False
        self.lies_aside = 0.0
        # Straight ahead until the arm first rests in the reset pose.
        scene = self._lab.scene
        self.nodes = self._home[:3] + scene.arc_lengths[:, None] * tangent(self._home[3], 0.0)
        self.nodes[2:, 2] = scene.end_height
        self._velocity = np.zeros_like(self.nodes)
        self._loose: Array | None = None

    def update(self, poses: Array, at_rest: bool, is_reset: bool = False) -> Trial | None:
        """Follow the grip.

        Args:
            poses: x, y, z [m], yaw, pitch [rad] of the grip after each step, shape [step, 5].
            at_rest: True where the arm rests.
            is_reset: True while the arm brings the cable back, which is carried as if it were
                stiff: how a reset ends is drawn, and to simulate it would take as long as a cast.

        Returns:
            Draw of the trial that starts, where a cable was laid down; otherwise None.
        """
        duration = len(poses) * self._lab.config.dt
        self._time += duration
        if self._loose is not None:
            self._fly(duration)
            self._poses = np.concatenate([self._poses, poses])[-2:]
            return None
        before = self.nodes
        trial = self._follow(poses, at_rest, is_reset)
        self._velocity = (self.nodes - before) / duration
        return trial

    def _follow(self, poses: Array, at_rest: bool, is_reset: bool) -> Trial | None:
        """Follow the grip with a cable that it holds."""
        pose = poses[-1]
        off = np.abs(pose - self._home)
        if off[:3].max() > _AWAY:
            self._was_away = True
        if self._was_away and at_rest and off.max() < _RESET_REACH:
            return self._lay_down(pose)
        moved = np.abs(pose - self._poses[-1]).max() > 1e-6
        if is_reset and moved and off.max() >= _RESET_REACH:
            self._was_away, self.is_simulated = True, False
            self._carry(pose)
        elif not self._was_away or self.is_simulated:
            if moved or self.is_simulated or self._time < self._settle_until:
                self._simulate(poses)
                self._look_for_rest(moved)
        elif moved:
            self._carry(pose)
        self._poses = np.concatenate([self._poses, poses])[-2:]
        return None

    def slip(self) -> None:
        """Let the cable slip in the jaws: until it is gripped anew, less of it is free.

        It goes on as a picture of the whole one, made smaller about the grip.
        """
        if not self._slipped:
            self._slipped = True
            self.nodes = self._free_part(self.nodes)

    @property
    def is_held(self) -> bool:
        """Whether the jaws hold the cable, wherever."""
        return self._loose is None

    def drop(self) -> None:
        """Let the cable slip out of the jaws: until it is gripped anew, no pose moves it.

        Its nodes fly on as if each were alone, and slide to rest on the table.
        """
        if self._loose is None:
            self._loose = self._velocity

    def _fly(self, duration: float) -> None:
        """Move a cable that nobody holds."""
        if self._loose is None:
            return
        self._loose[:, 2] -= _GRAVITY * duration
        speed = np.linalg.norm(self._loose[:, :2], axis=1, keepdims=True)
        lies = self.nodes[:, 2:] <= self._lab.scene.end_height
        slower = np.where(lies, np.maximum(speed - _SLIDING * duration, 0.0), speed)
        self._loose[:, :2] *= slower / np.maximum(speed, 1e-9)
        self.nodes = self.nodes + self._loose * duration
        low = self.nodes[:, 2] < self._lab.scene.end_height
        self.nodes[low, 2], self._loose[low, 2] = self._lab.scene.end_height, 0.0

    def grip_anew(self) -> None:
        """Let a cable that slipped be gripped at its end again, and laid down."""
        if self._slipped or self._loose is not None:
            self._slipped, self._loose, self._was_away = False, None, True
            # Where its simulation stands, the grip no longer is.
            self.is_simulated = False

    def _free_part(self, nodes: Array) -> Array:
        """Return the nodes of what is free of a cable that may have slipped."""
        return nodes[0] + (nodes - nodes[0]) * (1.0 - _SLIP_SHARE) if self._slipped else nodes

    def _carry(self, pose: Array) -> None:
        """Move the cable along with the grip, as if it were stiff."""
        self.nodes = _turned(self.nodes - self.nodes[0], pose[3] - self._poses[-1, 3]) + pose[:3]

    def _lay_down(self, pose: Array) -> Trial:
        """Start a trial with the cable as a reset leaves it."""
        config = self._lab.config
        drift = self._lab.drift.factor("", self.trial_count)
        trial = Trial.draw(config.noise, self._seed, self.trial_count, drift)
        self.trial_count += 1
        shape = self._lab.reset_shape(pose, trial)
        if self.lies_aside:
            shape[2:] = (_turned(shape - shape[0], self.lies_aside) + shape[0])[2:]
        with quiet():
            self._cables = Cables(self._lab, [trial], pose[None], [shape])
        self._poses = np.repeat(pose[None], 2, axis=0)
        self._settle_until = self._time + config.reset_time
        self._was_away, self.is_simulated = False, True
        self.nodes = self._free_part(shape)
        self._rest_check = (self._time, shape[-1].copy())
        return trial

    def _simulate(self, poses: Array) -> None:
        """Step the cable along the poses."""
        if self._cables is None:
            return
        lab = self._lab
        sampled = np.concatenate([self._poses, poses])
        controls = lab.scene.controls(sampled, lab.config.dt)[None, 1:]
        self.is_simulated = True
        world = np.zeros(1, dtype=int)
        with quiet():
            for start in range(0, controls.shape[1], lab.window):
                self._cables.advance(world, controls[:, start : start + lab.window])
                if self._cables.broken[0]:
                    self.is_simulated, self._cables = False, None
                    return
        nodes = self._cables.vertices(world)[0]
        if np.all(np.isfinite(nodes)):
            self.nodes = self._free_part(nodes)

    def _look_for_rest(self, moved: bool) -> None:
        """Stop simulating once arm and cable have come to rest."""
        since, before = self._rest_check
        if self._time - since < _REST_TIME or self._cables is None:
            return
        tip = self.nodes[-1].copy()
        still = self._cables.rest(np.zeros(1, dtype=int), tip[None], before[None])[0]
        self._rest_check = (self._time, tip)
        if still and not moved and self._time >= self._settle_until:
            self.is_simulated = False


def _turned(nodes: Array, angle: float) -> Array:
    """Return points turned about the vertical by an angle to the right [rad], shape [node, 3]."""
    cos, sin = math.cos(angle), math.sin(angle)
    turned = nodes.copy()
    turned[:, 0] = cos * nodes[:, 0] + sin * nodes[:, 1]
    turned[:, 1] = cos * nodes[:, 1] - sin * nodes[:, 0]
    return turned
