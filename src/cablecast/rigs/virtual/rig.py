"""RigVirtual: the virtual laboratory behind the Rig contract."""

import dataclasses
import importlib.util
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cablecast.camera.settings import CameraSight
from cablecast.cast import EndpointTrack
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.virtual._hidden import effect_strengths, hidden_camera
from cablecast.rigs.virtual.config import LABORATORY_VERSION, CameraConfig, VirtualConfig
from cablecast.rigs.virtual.laboratory import Laboratory
from cablecast.rigs.virtual.sensing import RECORD_DT, Sensor, SensorCamera, SensorErrorModel
from cablecast.rigs.virtual.trials import RigOfTrials, Trial
from cablecast.setup import Setup

if TYPE_CHECKING:
    from cablecast.rigs.virtual.camera import VirtualCamera

_SENSING_STREAM = 7
"""Keeps the chances of the camera apart from those of the trial."""


class RigVirtual(RigOfTrials):
    """A robot, a table and a cable that exist in MuJoCo only.

    The n-th trial of a purpose draws its own small differences, so that a rig made again with the
    same seed repeats the same sequence of trials. The table's friction drifts on one clock for all
    purposes.

    Args:
        setup: Cable, workspace, arm and motion settings. The cable's parameters are what is
            believed of it; the laboratory has its own.
        seed: Seed of what differs from trial to trial.
        config: Settings of the laboratory.

    Raises:
        InputError: The seed is out of bounds.
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(self, setup: Setup, seed: int = 0, config: VirtualConfig | None = None):
        super().__init__(seed)
        self.setup = setup
        self.config = VirtualConfig() if config is None else config
        recorded, sample_dt = self.config, self.config.sample_dt
        self._sensor: Sensor | None = None
        if recorded.sensing == "error_model":
            self._sensor = SensorErrorModel(setup, sample_dt)
        elif recorded.sensing == "camera":
            lab_seed = recorded.lab_seed
            strengths = effect_strengths(lab_seed, recorded.without)
            camera = CameraConfig.over(setup.workspace).troubled(hidden_camera(lab_seed, strengths))
            self._sensor = SensorCamera(setup, sample_dt, lab_seed, camera)
        if self._sensor is not None:
            recorded = dataclasses.replace(self.config, sample_dt=RECORD_DT)
        self._lab = Laboratory(setup, recorded, self.seed)
        # The last trial as it really was, and the picture of its end once it was asked for.
        self._last: EndpointTrack | None = None
        self._camera: VirtualCamera | None = None
        self._picture: tuple[EndpointTrack, NDArray[np.uint8] | None] | None = None
        settings = setup.to_settings()
        self.description: dict[str, Any] = {
            "rig": "virtual",
            "laboratory_version": LABORATORY_VERSION,
            "cable": setup.cable.name,
            "seed": self.seed,
            "config": dataclasses.asdict(self.config),
            "workspace": settings["workspace"],
            "arm": settings["arm"],
        }

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """Play one motion from the reset state, and report where the endpoint went."""
        self._use_reset()
        return self._run([trajectory], None)[0]

    def execute_many(
        self, trajectories: Sequence[Trajectory], progress: Callable[[int], None] | None = None
    ) -> list[EndpointTrack]:
        """Reset and execute for each trajectory, at once on all cores; see `run_trials`.

        The tracks equal those of one reset and execute after another.
        """
        self._check_open()
        self._is_reset = False
        return self._run(trajectories, progress) if trajectories else []

    def picture(self) -> NDArray[np.uint8] | None:
        """Return what a camera above the table sees at the end of the last trial, BGR.

        Returns:
            Picture, shape [v, u, 3]; None before the first trial, and without OpenCV.
        """
        last = self._last
        if last is None or importlib.util.find_spec("cv2") is None:
            return None
        if self._picture is None or self._picture[0] is not last:
            from cablecast.rigs.virtual.camera import VirtualCamera

            if self._camera is None:
                self._camera = VirtualCamera.of(self.setup, seed=self.config.lab_seed)
            self._picture = last, self._camera.picture(last, self.setup, self.seed)
        return self._picture[1]

    def sight(self) -> CameraSight | None:
        """Return what the camera cannot see; None for a rig that sees exactly."""
        self._check_open()
        return None if self._sensor is None else self._sensor.sight

    def close(self) -> None:
        """Forget the last trial."""
        super().close()
        self._picture = self._last = None

    def _run(
        self, trajectories: Sequence[Trajectory], progress: Callable[[int], None] | None
    ) -> list[EndpointTrack]:
        seed, first = self._next
        trials = [
            Trial.draw(self.config.noise, seed, index, self._lab.drift.factor(self._purpose, index))
            for index in range(first, first + len(trajectories))
        ]
        tracks = self._lab.run(trajectories, trials, progress)
        self._trial_count = first + len(trajectories)
        self._last = tracks[-1]
        if self._sensor is None:
            return tracks
        return [
            self._sensor.observe(
                track,
                track.joint_path or trajectory.joint_path,
                np.random.default_rng([seed, first + index, _SENSING_STREAM]),
            )
            for index, (track, trajectory) in enumerate(zip(tracks, trajectories, strict=True))
        ]
