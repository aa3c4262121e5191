"""The laboratory: plays many trials at once in MuJoCo and watches each cable's endpoint."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable
from cablecast.conventions import tangent
from cablecast.machine import core_count
from cablecast.motion.grip_path import GripPath
from cablecast.rigs.virtual._hidden import HiddenCable, hidden_cable
from cablecast.rigs.virtual.config import VirtualConfig
from cablecast.rigs.virtual.scene import HAND_DOF_COUNT, Scene, build_scene, hand_controls
from cablecast.rigs.virtual.trials import Trial, arm_poses, reset_shape
from cablecast.track import EndpointTrack, TrialStatus
from cablecast.workspace import Workspace

AIR_DENSITY = 1.2
_WINDOW = 0.002
"""Air drag is renewed, and the endpoint looked at, this often [s]."""
_OFF_TABLE_TIME = 0.5
"""A cable whose endpoint fell is watched this long after the motion [s]: it hangs and swings."""
_FALLEN_Z = -0.005
"""Below this height the endpoint hangs beside the table [m]; a contact never gives way so far."""
_REST_MOVE = 5e-4
"""At rest the endpoint moves less than this between two samples [m]."""
_GROUP_SIZE = 64
"""Trials in memory at once."""


class Laboratory:
    """A table, an arm and one cable.

    Every result of a trial depends on its path and its draw alone, bit for bit: not on the trials
    beside it, nor on the number of threads.
    """

    def __init__(self, cable: Cable, workspace: Workspace, config: VirtualConfig):
        self._cable = cable
        self._workspace = workspace
        self._config = config
        self._truth: HiddenCable = hidden_cable(cable, config.lab_seed)
        self._scene: Scene = build_scene(
            cable, self._truth, workspace, config.segment_count, config.dt
        )

    def run(
        self,
        paths: Sequence[GripPath],
        trials: Sequence[Trial],
        progress: Callable[[int], None] | None = None,
    ) -> list[EndpointTrack]:
        """Play trials, each from its own reset state.

        Args:
            paths: Commanded motion of each trial, one row each.
            trials: Draw of each trial.
            progress: Called with the number of finished trials whenever it grows.
        """
        tracks: list[EndpointTrack] = []
        for start in range(0, len(paths), _GROUP_SIZE):
            group = slice(start, start + _GROUP_SIZE)

            def grown(count: int, before: int = start) -> None:
                if progress is not None:
                    progress(before + count)

            tracks += _Group(self, paths[group], trials[group]).run(grown)
        return tracks


class _Group:
    """Trials that are stepped together."""

    def __init__(self, lab: Laboratory, paths: Sequence[GripPath], trials: Sequence[Trial]):
        from mujoco.batch import Batch

        config, scene = lab._config, lab._scene
        self.lab = lab
        self.scene = scene
        self.count = len(paths)
        self.window = max(1, round(_WINDOW / config.dt))
        sample_step_count = round(config.sample_dt / config.dt)
        # Samples fall on whole windows.
        self.window_count = max(1, round(sample_step_count / self.window))
        self.sample_dt = float(self.window_count * self.window * config.dt)
        self.motion_time = np.array([float(path.duration[0]) for path in paths])
        self.sample_max = np.ceil((self.motion_time + config.rest_time_max) / self.sample_dt)
        self.sample_max = self.sample_max.astype(int)
        self.reset_windows = math.ceil(config.reset_time / (self.window * config.dt))
        thread_count = min(config.thread_count or core_count(), self.count)
        self.batch: Any = Batch(scene.model, self.count, thread_count)  # pyright: ignore
        self.controls = self._controls(paths, trials)
        self.qpos = self.batch.bind("qpos")
        self.qvel = self.batch.bind("qvel")
        self.force = self.batch.bind("qfrc_applied")
        friction = self.batch.expand("flex_friction")
        for world, (path, trial) in enumerate(zip(paths, trials, strict=True)):
            friction[world, ..., 0] *= trial.friction_factor
            pose = path.evaluate(path.knots[:, :1])[0, 0]
            shape = reset_shape(lab._cable, path, trial, scene.arc_lengths)
            self.qpos[world, :HAND_DOF_COUNT] = pose - scene.hand_origin
            self.qpos[world, scene.vertex_slice] = (shape[2:] - scene.vertex_origin).ravel()
        edge = np.diff(scene.arc_lengths)
        self.drag_factor = 0.5 * AIR_DENSITY * lab._truth.drag * lab._cable.diameter * edge
        self.damping = lab._truth.linear_damping * scene.masses[2:]
        self.times = np.arange(int(self.sample_max.max()) + 1) * self.sample_dt
        node_count = scene.endpoint + 1
        self.nodes = np.full((self.count, len(self.times), node_count, 3), np.nan)
        self.left_table = np.zeros(self.count, dtype=bool)
        self.broken = np.zeros(self.count, dtype=bool)
        self.last_sample = self.sample_max.copy()

    def _controls(self, paths, trials) -> NDArray[np.float64]:
        """Servo targets of every trial from its reset on, shape [world, step, 5]."""
        config, scene = self.lab._config, self.scene
        reset_steps = self.reset_windows * self.window
        step_count = int(self.sample_max.max()) * self.window_count * self.window
        controls = np.empty((self.count, reset_steps + step_count, HAND_DOF_COUNT))
        for world, (path, trial) in enumerate(zip(paths, trials, strict=True)):
            poses = arm_poses(path, trial, self.lab._truth.arm_lag, config.dt, step_count)
            held = np.repeat(poses[:1], reset_steps, axis=0)
            controls[world] = hand_controls(
                np.concatenate([held, poses]), config.dt, scene.hand_origin
            )
        return controls

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
        """One window of all trials that still run."""
        self._renew_drag(active)
        end = step + self.window
        self.batch.rollout(
            self.window,
            control=self.controls[active, step:end],
            record=(),
            ids=active,
        )
        tip = self._vertices(self.qpos, active)[:, self.scene.endpoint]
        on_table = self.lab._workspace.on_table(tip[:, :2]) & (tip[:, 2] > _FALLEN_Z)
        self.left_table[active] |= ~on_table
        return end

    def _vertices(self, state, active: NDArray[np.intp]) -> NDArray[np.float64]:
        """Positions of all vertices of the cable [m], shape [world, vertex, 3]."""
        scene = self.scene
        vertices = np.empty((len(active), len(scene.arc_lengths), 3))
        pose = state[active, :HAND_DOF_COUNT] + scene.hand_origin
        vertices[:, 0] = pose[:, :3]
        vertices[:, 1] = pose[:, :3] + scene.arc_lengths[1] * tangent(pose[:, 3], pose[:, 4])
        free = state[active, scene.vertex_slice].reshape(len(active), -1, 3)
        vertices[:, 2:] = free + scene.vertex_origin
        return vertices

    def _renew_drag(self, active: NDArray[np.intp]) -> None:
        """Quadratic drag on the normal velocity of each edge, shared by its ends, and damping."""
        scene = self.scene
        vertices = self._vertices(self.qpos, active)
        velocity = np.zeros_like(vertices)
        velocity[:, :2] = self.qvel[active, None, :3]
        free = self.qvel[active, scene.vertex_slice].reshape(len(active), -1, 3)
        velocity[:, 2:] = free
        direction = np.diff(vertices, axis=1)
        direction /= np.sqrt(_dot(direction, direction))[..., None]
        v = (velocity[:, 1:] + velocity[:, :-1]) / 2
        v -= _dot(v, direction)[..., None] * direction
        half = -(self.drag_factor * np.sqrt(_dot(v, v)))[..., None] * v / 2
        force = half[:, 1:] - self.damping[:, None] * free
        force[:, :-1] += half[:, 2:]
        self.force[active, scene.vertex_slice] = force.reshape(len(active), -1)

    def _sample(self, active: NDArray[np.intp], sample: int) -> None:
        vertices = self._vertices(self.qpos, active)
        self.nodes[active, sample] = vertices[:, : self.scene.endpoint + 1]
        finite = np.isfinite(vertices).all(axis=(1, 2))
        warned = self.batch.warning[active].reshape(len(active), -1).any(axis=1)
        self.broken[active] |= ~finite | warned

    def _over(self, active: NDArray[np.intp], sample: int) -> NDArray[np.bool_]:
        """Which trials are over: at rest, fallen, broken, or out of time."""
        config, scene = self.lab._config, self.scene
        after_motion = self.times[sample] - self.motion_time[active]
        speed = np.abs(self.qvel[active, scene.vertex_slice]).max(axis=1)
        tip = self.nodes[active, sample - 1 : sample + 1, scene.endpoint]
        move = np.abs(tip[:, 1] - tip[:, 0]).max(axis=1)
        rests = (after_motion > 0) & (speed < config.rest_speed) & (move < _REST_MOVE)
        fallen = self.left_table[active] & (after_motion > _OFF_TABLE_TIME)
        return rests | fallen | self.broken[active] | (sample >= self.sample_max[active])

    def _track(self, world: int) -> EndpointTrack:
        samples = slice(0, self.last_sample[world] + 1)
        nodes = self.nodes[world, samples]
        status = TrialStatus.OK
        if self.broken[world]:
            status = TrialStatus.NON_FINITE
        elif self.left_table[world]:
            status = TrialStatus.OFF_TABLE
        return EndpointTrack(
            times=np.array(self.times[samples], dtype=float),
            endpoint_xy=nodes[:, self.scene.endpoint, :2].copy(),
            status=status,
            nodes=nodes.copy(),
        )


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scalar products over the last axis, in one order of summation whatever the batch."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]
