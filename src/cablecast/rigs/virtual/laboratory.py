"""The laboratory: plays many trials at once in MuJoCo and watches each cable's endpoint."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.engines.mujoco_ import quiet
from cablecast.files import core_count
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.virtual._hidden import HiddenCable, hidden_arm, hidden_cable, hidden_table
from cablecast.rigs.virtual.arm import move_arm
from cablecast.rigs.virtual.config import VirtualConfig
from cablecast.rigs.virtual.forces import CableForces
from cablecast.rigs.virtual.reset_library import find_library
from cablecast.rigs.virtual.scene import Scene, build_scene, hand_controls
from cablecast.rigs.virtual.state import cable_motion, cable_vertices, lay_down
from cablecast.rigs.virtual.table import friction_map
from cablecast.rigs.virtual.trials import Trial, initial_curl, reset_shape
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
