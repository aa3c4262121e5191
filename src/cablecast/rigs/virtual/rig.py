"""RigVirtual: the virtual laboratory behind the Rig contract."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cablecast.cable import Cable
from cablecast.errors import InputError, RigError
from cablecast.rigs.base import RigLifecycle
from cablecast.rigs.virtual.config import VirtualConfig
from cablecast.rigs.virtual.laboratory import Laboratory
from cablecast.rigs.virtual.sensing import RECORD_DT, make_sensor
from cablecast.rigs.virtual.trials import Trial
from cablecast.track import EndpointTrack
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from cablecast.motion.trajectory import Trajectory

_SENSING_STREAM = 7
"""Keeps what the camera draws by chance apart from what the trial draws."""

LABORATORY_VERSION = 3
"""Counts the changes after which equal trials end elsewhere. It is part of the description that
datasets keep, so that casts in one laboratory are never continued in another."""


class RigVirtual(RigLifecycle):
    """A robot, a table and a cable that exist in MuJoCo only.

    The n-th trial of a rig draws its own small differences from the seed and n, so a rig made again
    with the same seed repeats the same sequence of trials.

    Args:
        cable: The cable in the gripper. Its parameters are what is believed of it; the laboratory
            has its own.
        workspace: Table and arm.
        seed: Seed of what differs from trial to trial.
        config: Settings of the laboratory.

    Raises:
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(
        self, cable: Cable, workspace: Workspace, seed: int, config: VirtualConfig | None = None
    ):
        super().__init__()
        if not isinstance(seed, (int, np.integer)) or seed < 0:
            raise InputError(f"seed = {seed!r} must be a whole number of at least 0")
        self.config = VirtualConfig() if config is None else config
        self._seed = int(seed)
        self._trial_count = 0
        sample_dt, sensing = self.config.sample_dt, self.config.sensing
        self._sensor = make_sensor(sensing, cable, workspace, sample_dt, self.config.lab_seed)
        recorded = self.config
        if self._sensor is not None:
            recorded = dataclasses.replace(self.config, sample_dt=RECORD_DT)
        self._lab: Laboratory | None = Laboratory(cable, workspace, recorded)
        self.description: dict[str, Any] = {
            "rig": "virtual",
            "laboratory_version": LABORATORY_VERSION,
            "cable": cable.name,
            "seed": int(seed),
            "config": dataclasses.asdict(self.config),
            "workspace": dataclasses.asdict(workspace),
        }

    def seek(self, index: int) -> None:
        """Let the next trial be the index-th, so that a resumed collection draws the same chance.

        Args:
            index: From 0.
        """
        self._check_open()
        if index < 0:
            raise InputError(f"trial {index} must be at least 0")
        self._trial_count = int(index)

    def execute(self, trajectory: "Trajectory") -> EndpointTrack:
        """Play one motion from the reset state, and report where the endpoint went."""
        self._use_reset()
        return self._run([trajectory], None)[0]

    def execute_many(
        self,
        trajectories: Sequence["Trajectory"],
        progress: Callable[[int], None] | None = None,
    ) -> list[EndpointTrack]:
        """Reset and execute for each trajectory, at once on all cores.

        The tracks equal those of one reset and execute after another.

        Args:
            trajectories: One per trial.
            progress: Called with the number of finished trials whenever it grows.
        """
        self._check_open()
        self._is_reset = False
        return self._run(trajectories, progress) if trajectories else []

    def close(self) -> None:
        """Forget the laboratory."""
        super().close()
        self._lab = None

    def _run(
        self,
        trajectories: Sequence["Trajectory"],
        progress: Callable[[int], None] | None,
    ) -> list[EndpointTrack]:
        if self._lab is None:
            raise RigError("the virtual rig is closed: make a new rig")
        first = self._trial_count
        trials = [
            Trial.draw(self.config.noise, self._seed, first + index)
            for index in range(len(trajectories))
        ]
        tracks = self._lab.run(trajectories, trials, progress)
        self._trial_count = first + len(trajectories)
        if self._sensor is None:
            return tracks
        return [
            self._sensor.observe(
                track,
                track.joint_path or trajectory.joint_path,
                np.random.default_rng([self._seed, first + index, _SENSING_STREAM]),
            )
            for index, (track, trajectory) in enumerate(zip(tracks, trajectories, strict=True))
        ]
