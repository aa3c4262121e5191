"""The laboratory: plays many trials at once in MuJoCo and watches each cable's endpoint.

The laboratory step by step: an arm that is told one set point at a time, and the cable it holds.

`RigVirtual` knows a whole motion before it begins. A controller does not: set points arrive one by
one, and a motion may be stopped anywhere. The servos, the cable, the table and what differs from
trial to trial are the same.

Between two casts the cable is not simulated. While the arm brings it back, it is carried along as
it is; once the arm rests in the reset pose, it is laid down as a reset leaves it (trials.py), as
for every trial of `RigVirtual`.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.arm.ur import JOINT_COUNT
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.conventions import tangent
from cablecast.engines.mujoco_ import quiet
from cablecast.files import core_count
from cablecast.motion.polar import reset_pose
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.virtual._hidden import (
    HiddenArm,
    HiddenCable,
    hidden_arm,
    hidden_cable,
    hidden_table,
)
from cablecast.rigs.virtual.arm import move_arm, within_torque
from cablecast.rigs.virtual.config import VirtualConfig
from cablecast.rigs.virtual.forces import CableForces, friction_map
from cablecast.rigs.virtual.scene import (
    Scene,
    build_scene,
    cable_motion,
    cable_vertices,
    hand_controls,
    lay_down,
)
from cablecast.rigs.virtual.trials import Trial, find_library, initial_curl, reset_shape
from cablecast.setup import Setup

_WINDOW = 0.002
"""Time after which the forces beside MuJoCo's are renewed, and the endpoint is looked at [s]."""
_OFF_TABLE_TIME = 0.5
"""Time after the motion for which a cable that fell is watched [s]: it hangs and swings. One that
only swept past the edge, and came back to rest on the table, has landed."""
_FALLEN_Z = -0.005
"""Height below which the endpoint hangs beside the table [m]; a contact never gives way so far."""
_REST_MOVE = 5e-4
"""Largest way of an endpoint at rest within _REST_TIME [m]."""
_REST_TIME = 0.1
"""Time between looks for rest [s], however often the cable is recorded for a camera."""
_GROUP_SIZE = 64
"""Trials in memory at once."""


class Laboratory:
    """A table, an arm and one cable.

    Every result of a trial depends on its motion and its draw alone, bit for bit: not on the trials
    beside it, nor on the number of threads.

    Args:
        setup: Cable, workspace, arm and motion settings.
        config: Settings of the laboratory.
    """

    def __init__(self, setup: Setup, config: VirtualConfig):
        self._setup = setup
        self._config = config
        self._truth: HiddenCable = hidden_cable(setup.cable, config.lab_seed)
        self._servos = hidden_arm(config.lab_seed)
        self._map = friction_map(hidden_table(config.lab_seed), setup.workspace)
        self._library = find_library(setup, config.lab_seed) if config.stored_resets else None
        self._scene: Scene = build_scene(
            setup.cable, self._truth, setup.workspace, config.segment_count, config.dt
        )

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


class _Group:
    """Trials that are stepped together."""

    def __init__(
        self, lab: Laboratory, trajectories: Sequence[Trajectory], trials: Sequence[Trial]
    ):
        from mujoco.batch import Batch

        config, scene = lab._config, lab._scene
        self.lab = lab
        self.scene = scene
        self.count = len(trajectories)
        self.window = max(1, round(_WINDOW / config.dt))
        sample_step_count = round(config.sample_dt / config.dt)
        # Samples fall on whole windows.
        self.window_count = max(1, round(sample_step_count / self.window))
        self.sample_dt = float(self.window_count * self.window * config.dt)
        self.motion_time = np.array([trajectory.duration for trajectory in trajectories])
        self.sample_max = np.ceil((self.motion_time + config.rest_time_max) / self.sample_dt)
        self.sample_max = self.sample_max.astype(int)
        self.reset_windows = math.ceil(config.reset_time / (self.window * config.dt))
        step_count = int(self.sample_max.max()) * self.window_count * self.window
        self.arm = move_arm(
            trajectories, trials, lab._setup.arm, lab._servos, config.dt, step_count
        )
        self.controls = self._controls()
        thread_count = min(config.thread_count or core_count(), self.count)
        self.batch: Any = Batch(scene.model, self.count, thread_count)  # pyright: ignore
        self.qpos = self.batch.bind("qpos")
        self.qvel = self.batch.bind("qvel")
        self.force = self.batch.bind("qfrc_applied")
        friction = self.batch.expand("flex_friction")
        tip_friction = self.batch.expand("geom_friction")
        curl = np.empty((self.count, 2, len(scene.arc_lengths) - 2))
        for world, trial in enumerate(trials):
            friction[world, ..., 0] *= trial.friction_factor
            tip_friction[world, :, 0] *= trial.friction_factor
            curl[world] = initial_curl(trial, lab._truth.curl, scene.arc_lengths)
            self._lay_down(world, trial)
        self.forces = CableForces(
            lab._setup.cable,
            lab._truth,
            lab._map,
            scene.arc_lengths,
            scene.masses,
            np.array(friction).reshape(self.count, -1)[:, 0],
            curl,
        )
        self.times = np.arange(int(self.sample_max.max()) + 1) * self.sample_dt
        self.nodes = np.full((self.count, len(self.times), len(scene.arc_lengths), 3), np.nan)
        self.off_table = np.zeros(self.count, dtype=bool)
        self.broken = np.zeros(self.count, dtype=bool)
        self.last_sample = self.sample_max.copy()

    def _lay_down(self, world: int, trial: Trial) -> None:
        """Put a cable where its reset left it."""
        lab, scene = self.lab, self.scene
        pose = self.arm[world].poses[0]
        shape = reset_shape(
            lab._setup.cable, pose, trial, scene.arc_lengths, scene.end_height, lab._library
        )
        lay_down(scene, self.qpos[world], pose, shape, trial.tip_roll)

    def _controls(self) -> NDArray[np.float64]:
        """Return servo targets of every trial from its reset on, shape [world, step, 5]."""
        config, scene = self.lab._config, self.scene
        reset_steps = self.reset_windows * self.window
        controls = []
        for motion in self.arm:
            held = np.repeat(motion.poses[:1], reset_steps, axis=0)
            poses = np.concatenate([held, motion.poses])
            controls.append(hand_controls(poses, config.dt, scene.hand_origin))
        return np.stack(controls)

    def run(self, progress: Callable[[int], None]) -> list[EndpointTrack]:
        """Simulate until every trial is over."""
        active = np.arange(self.count)
        step = 0
        for _ in range(self.reset_windows):
            step = self._advance(active, step)
        self._sample(active, 0)
        for sample in range(1, len(self.times)):
            for _ in range(self.window_count):
                step = self._advance(active, step)
            self._sample(active, sample)
            over = self._over(active, sample)
            if over.any():
                self.last_sample[active[over]] = sample
                active = active[~over]
                progress(self.count - len(active))
            if not len(active):
                break
        return [self._track(world) for world in range(self.count)]

    def _advance(self, active: NDArray[np.intp], step: int) -> int:
        """Advance all trials that still run by one window, and return the step after it."""
        from mujoco.batch import SimulationError

        self._renew_forces(active)
        end = step + self.window
        try:
            self.batch.rollout(
                self.window, control=self.controls[active, step:end], record=(), ids=active
            )
        except SimulationError as error:
            self.broken[np.asarray(error.ids, dtype=int)] = True
        return end

    def _rows(self, active: NDArray[np.intp]) -> NDArray[np.intp] | slice:
        """Return the rows of the trials that still run: no index array, which copies, for all."""
        return slice(None) if len(active) == self.count else active

    def _renew_forces(self, active: NDArray[np.intp]) -> None:
        rows = self._rows(active)
        motion = cable_motion(self.scene, self.qpos[rows], self.qvel[rows])
        # Diverged worlds run on until their trials end.
        with np.errstate(all="ignore"):
            force = self.forces.evaluate(motion, active, self.window * self.lab._config.dt)
        self.force[rows, self.scene.vertex_slice] = force.reshape(len(active), -1)

    def _sample(self, active: NDArray[np.intp], sample: int) -> None:
        vertices = cable_vertices(self.scene, self.qpos[self._rows(active)])
        self.nodes[active, sample] = vertices
        tip = vertices[:, -1]
        on_table = self.lab._setup.workspace.on_table(tip[:, :2]) & (tip[:, 2] > _FALLEN_Z)
        self.off_table[active] = ~on_table
        finite = np.isfinite(vertices).all(axis=(1, 2))
        warned = self.batch.warning[active].reshape(len(active), -1).any(axis=1)
        self.broken[active] |= ~finite | warned

    def _over(self, active: NDArray[np.intp], sample: int) -> NDArray[np.bool_]:
        """Return which trials are over: at rest, fallen, broken, or out of time."""
        config, scene = self.lab._config, self.scene
        after_motion = self.times[sample] - self.motion_time[active]
        speed = np.abs(self.qvel[active, scene.vertex_slice]).max(axis=1)
        back = max(1, round(_REST_TIME / self.sample_dt))
        tip, before = (self.nodes[active, max(k, 0), -1] for k in (sample, sample - back))
        move = np.abs(tip - before).max(axis=1)
        rests = (
            (sample % back == 0)
            & (after_motion > 0)
            & (speed < config.rest_speed)
            & (move < _REST_MOVE)
        )
        fallen = self.off_table[active] & (after_motion > _OFF_TABLE_TIME)
        fallen &= sample % back == 0
        return rests | fallen | self.broken[active] | (sample >= self.sample_max[active])

    def _track(self, world: int) -> EndpointTrack:
        samples = slice(0, self.last_sample[world] + 1)
        nodes = self.nodes[world, samples]
        status = TrialStatus.OK
        if self.broken[world]:
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


Array = NDArray[np.float64]

REST_SPEED = 0.01
"""Joint speed below which the arm rests [rad/s]."""
_RESET_REACH = 0.003
"""Distance from the reset pose within which a cable is laid down [m and rad]."""
_AWAY = 0.05
"""Distance from the reset pose beyond which the next reset begins [m]."""
_HISTORY_TIME = 0.1
"""Time for which set points are kept: longer than any dead time [s]."""
_STILL_ERROR, _STILL_SPEED = 1e-7, 1e-6
"""Distance from its set point [rad], and speed [rad/s], below which a joint is put to rest."""
_SLIP_SHARE = 0.2


class LiveArm:
    """Joints that follow set points as those of `RigVirtual` do.

    Args:
        setup: Gives the arm.
        q: Joint angles at rest [rad], shape [6].
        dt: Step of the servos [s].
        lab_seed: Seed of the laboratory.
    """

    def __init__(self, setup: Setup, q: ArrayLike, dt: float = 1e-3, lab_seed: int = 0):
        self.arm = setup.arm
        self.dt = dt
        self._servos: HiddenArm = hidden_arm(lab_seed)
        self.q = np.array(q, dtype=float)
        self.qd = np.zeros(JOINT_COUNT)
        self.time = 0.0
        self._factor = np.ones(JOINT_COUNT)
        self._torque_factor = 1.0
        self._times = [-1.0, 0.0]
        self._set_points = [self.q.copy(), self.q.copy()]

    def prepare(self, trial: Trial) -> None:
        """Let the servos respond as in a trial."""
        self._factor = trial.servo_factor(JOINT_COUNT)
        self._torque_factor = trial.torque_factor

    def command(self, q: ArrayLike) -> None:
        """Give a set point that holds from now on [rad], shape [6]."""
        q = np.array(q, dtype=float)
        last, before = self._set_points[-1], self._set_points[-2]
        if np.array_equal(q, last) and np.array_equal(last, before):
            # It holds on; the next one is a step from here.
            self._times[-1] = self.time
            return
        self._times.append(self.time)
        self._set_points.append(q)
        while len(self._times) > 3 and self._times[1] < self.time - _HISTORY_TIME:
            del self._times[0], self._set_points[0]

    def freeze(self) -> None:
        """Put on the brakes: the joints stop at once and stay."""
        self.qd[:] = 0.0
        self._times = [self.time - 1.0, self.time]
        self._set_points = [self.q.copy(), self.q.copy()]

    def _is_still(self) -> bool:
        """Put the joints to rest where they have reached a set point that holds."""
        last = self._set_points[-1]
        held = self._times[-2] <= self.time - _HISTORY_TIME
        if not (held and np.array_equal(last, self._set_points[-2])):
            return False
        if np.abs(self.q - last).max() > _STILL_ERROR or np.abs(self.qd).max() > _STILL_SPEED:
            return False
        self.q, self.qd = last.copy(), np.zeros(JOINT_COUNT)
        return True

    def advance(self, step_count: int) -> Array:
        """Move on, and return the poses of the grip at each step.

        Args:
            step_count: Number of steps.

        Returns:
            x, y, z [m], yaw, pitch [rad], shape [step, 5].
        """
        if self._is_still():
            self.time += step_count * self.dt
            return np.repeat(self.arm.grip_pose(self.q)[None], step_count, axis=0)
        servos = self._servos
        times, points = np.array(self._times), np.stack(self._set_points)
        now = self.time + self.dt * np.arange(1, step_count + 1)
        set_points = np.empty((step_count, JOINT_COUNT))
        set_rates = np.empty_like(set_points)
        for joint, delay in enumerate(servos.delay):
            late = now - delay
            set_points[:, joint] = np.interp(late, times, points[:, joint])
            segment = np.clip(np.searchsorted(times, late, "right"), 1, len(times) - 1)
            rise = points[segment, joint] - points[segment - 1, joint]
            set_rates[:, joint] = rise / np.maximum(times[segment] - times[segment - 1], 1e-4)
            set_rates[late >= times[-1], joint] = 0.0
        omega = 2 * math.pi * np.array(servos.frequency) * self._factor
        stiffness, drag = omega * omega, 2 * np.array(servos.damping_ratio) * omega
        x, y = self.arm.grip_pose(points[-1])[:2]
        inertia = servos.inertia + servos.stretch_mass * (x * x + y * y)
        strength = np.array([servos.torque * self._torque_factor / inertia])
        path = np.empty((step_count, JOINT_COUNT))
        for step in range(step_count):
            share = servos.feedforward * set_rates[step]
            acceleration = stiffness * (set_points[step] - self.q) + drag * (share - self.qd)
            acceleration[:1] = within_torque(
                acceleration[:1], self.qd[:1], strength, servos.free_speed
            )
            self.qd = self.qd + self.dt * acceleration
            self.q = self.q + self.dt * self.qd
            path[step] = self.q
        self.time += step_count * self.dt
        return self.arm.grip_pose(path)


class LiveCable:
    """One cable in the gripper, simulated while it may move.

    Args:
        setup: Cable, table and reset pose.
        config: Settings of the laboratory.
        seed: Seed of what differs from trial to trial.
    """

    def __init__(self, setup: Setup, config: VirtualConfig, seed: int = 0):
        self._setup = setup
        self._config = config
        self._seed = seed
        self._truth = hidden_cable(setup.cable, config.lab_seed)
        self._map = friction_map(hidden_table(config.lab_seed), setup.workspace)
        self._library = find_library(setup, config.lab_seed) if config.stored_resets else None
        self._scene = build_scene(
            setup.cable, self._truth, setup.workspace, config.segment_count, config.dt
        )
        self._home = np.asarray(reset_pose(setup.workspace), dtype=float)
        self._window = max(1, round(0.002 / config.dt))
        self._batch: Any = None
        self._poses = np.zeros((2, 5))
        self._rest_check = (0.0, np.zeros(3))
        self._settle_until = 0.0
        self.trial_count = 0
        self.time = 0.0
        self.was_away = True
        self.is_simulated = False
        self.lies_aside = 0.0
        self._slipped = False
        self.nodes = self._straight(self._home)

    def _straight(self, pose: Array) -> Array:
        """Return a straight cable that lies ahead of the grip [m], shape [vertex, 3]."""
        arc = self._scene.arc_lengths[:, None]
        nodes = pose[:3] + arc * tangent(pose[3], 0.0)
        nodes[2:, 2] = self._scene.end_height
        return nodes

    def update(
        self, poses: Array, dt: float, at_rest: bool, is_reset: bool = False
    ) -> Trial | None:
        """Follow the grip.

        Args:
            poses: x, y, z [m], yaw, pitch [rad] of the grip every `dt`, shape [step, 5].
            dt: Step, that of the laboratory [s].
            at_rest: True where the arm rests.
            is_reset: True while the arm brings the cable back, which is carried as if it were
                stiff: how a reset ends is drawn, and to simulate it would take as long as a cast.

        Returns:
            Draw of the trial that begins, where a cable was laid down; otherwise None.
        """
        pose = poses[-1]
        self.time += len(poses) * dt
        off = np.abs(pose - self._home)
        if off[:3].max() > _AWAY:
            self.was_away = True
        if self.was_away and at_rest and off.max() < _RESET_REACH:
            return self._lay_down(pose)
        moved = np.abs(pose - self._poses[-1]).max() > 1e-6
        if is_reset and moved and off.max() >= _RESET_REACH:
            self.was_away, self.is_simulated = True, False
            self._carry(pose)
        elif not self.was_away or self.is_simulated:
            if moved or self.is_simulated or self.time < self._settle_until:
                self._simulate(poses)
                self._judge_rest(moved)
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

    def grip_anew(self) -> None:
        """Let a cable that slipped be gripped at its end again, and laid down."""
        if self._slipped:
            self._slipped, self.was_away = False, True

    def _free_part(self, nodes: Array) -> Array:
        """Return the nodes of what is free of a cable that may have slipped."""
        return nodes[0] + (nodes - nodes[0]) * (1.0 - _SLIP_SHARE) if self._slipped else nodes

    def _carry(self, pose: Array) -> None:
        """Move the cable along with the grip, as if it were stiff."""
        before = self._poses[-1]
        turn = pose[3] - before[3]
        cos, sin = math.cos(turn), math.sin(turn)
        local = self.nodes - self.nodes[0]
        turned = local.copy()
        turned[:, 0] = cos * local[:, 0] + sin * local[:, 1]
        turned[:, 1] = -sin * local[:, 0] + cos * local[:, 1]
        self.nodes = turned + pose[:3]

    def _lay_down(self, pose: Array) -> Trial:
        """Begin a trial with the cable as a reset leaves it."""
        from mujoco.batch import Batch

        scene, config = self._scene, self._config
        trial = Trial.draw(config.noise, self._seed, self.trial_count)
        self.trial_count += 1
        with quiet():
            self._batch = Batch(scene.model, 1, 1)  # pyright: ignore
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._force = self._batch.bind("qfrc_applied")
        friction = self._batch.expand("flex_friction")
        friction[0, ..., 0] *= trial.friction_factor
        self._batch.expand("geom_friction")[0, :, 0] *= trial.friction_factor
        shape = reset_shape(
            self._setup.cable, pose, trial, scene.arc_lengths, scene.end_height, self._library
        )
        if self.lies_aside:
            shape = _turned(shape, self.lies_aside)
        lay_down(scene, self._qpos[0], pose, shape, trial.tip_roll)
        self._forces = CableForces(
            self._setup.cable,
            self._truth,
            self._map,
            scene.arc_lengths,
            scene.masses,
            np.array(friction).reshape(1, -1)[:, 0],
            initial_curl(trial, self._truth.curl, scene.arc_lengths)[None],
        )
        self._poses = np.repeat(pose[None], 2, axis=0)
        self._settle_until = self.time + config.reset_time
        self.was_away, self.is_simulated = False, True
        self.nodes = self._free_part(shape)
        self._rest_check = (self.time, shape[-1].copy())
        return trial

    def _simulate(self, poses: Array) -> None:
        """Step MuJoCo along the poses, in windows after which the other forces are renewed."""
        from mujoco.batch import SimulationError

        if self._batch is None:
            return
        scene, dt = self._scene, self._config.dt
        sampled = np.concatenate([self._poses, poses])
        controls = hand_controls(sampled, dt, scene.hand_origin)[1:]
        self.is_simulated = True
        world = np.zeros(1, dtype=int)
        with quiet(), np.errstate(all="ignore"):
            for start in range(0, len(controls), self._window):
                self._renew_forces()
                part = controls[None, start : start + self._window]
                try:
                    self._batch.rollout(part.shape[1], control=part, record=(), ids=world)
                except SimulationError:
                    self.is_simulated, self._batch = False, None
                    return
        nodes = cable_vertices(scene, self._qpos)[0]
        if np.all(np.isfinite(nodes)):
            self.nodes = self._free_part(nodes)

    def _judge_rest(self, moved: bool) -> None:
        """Stop simulating once arm and cable have come to rest."""
        begin, before = self._rest_check
        if self.time - begin < _REST_TIME or self._batch is None:
            return
        tip = self.nodes[-1].copy()
        speed = np.abs(self._qvel[0, self._scene.vertex_slice]).max()
        still = np.abs(tip - before).max() < _REST_MOVE and speed < self._config.rest_speed
        self._rest_check = (self.time, tip)
        if still and not moved and self.time >= self._settle_until:
            self.is_simulated = False

    def _renew_forces(self) -> None:
        force = self._forces.evaluate(
            cable_motion(self._scene, self._qpos, self._qvel),
            np.zeros(1, dtype=np.intp),
            self._window * self._config.dt,
        )
        self._force[:, self._scene.vertex_slice] = force.reshape(1, -1)


def _turned(shape: Array, angle: float) -> Array:
    """Return a cable that lies turned about its grip by an angle to the right [rad]."""
    cos, sin = math.cos(angle), math.sin(angle)
    local = shape - shape[0]
    turned = local.copy()
    turned[2:, 0] = cos * local[2:, 0] + sin * local[2:, 1]
    turned[2:, 1] = cos * local[2:, 1] - sin * local[2:, 0]
    return turned + shape[0]
