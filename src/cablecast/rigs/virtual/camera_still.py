"""CameraStill: one picture of the virtual table, as the camera above it would take it."""

import numpy as np

from cablecast.cast import EndpointTrack
from cablecast.motion.trajectory import JointPath, joints_at
from cablecast.rigs.virtual.camera import Image, VirtualCamera
from cablecast.rigs.virtual.camera_drawing import FilmedTrial
from cablecast.setup import Setup


class CameraStill:
    """Draws how a trial ended.

    Args:
        setup: Gives the table, its tags, the cable and the arm.
        lab_seed: Seed of the laboratory, and so of the table's looks.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """

    def __init__(self, setup: Setup, lab_seed: int = 0):
        self._setup = setup
        layout = None if setup.camera is None else setup.camera.tags
        self._camera = VirtualCamera(None, setup.workspace, layout, lab_seed)

    def picture(self, track: EndpointTrack, seed: int = 0) -> Image | None:
        """Return the table at the end of a trial, BGR, shape [v, u, 3].

        Args:
            track: Trial with its nodes.
            seed: Seed of light and noise.

        Returns:
            The picture; None where the trial has no shape to draw.
        """
        if track.nodes is None or not np.all(np.isfinite(track.nodes[-1])):
            return None
        now, path = np.zeros(1), None
        if track.joint_path is not None:
            q = joints_at(track.joint_path, track.times[-1:])
            path = JointPath(times=now, q=q, qd=np.zeros_like(q))
        trial = FilmedTrial(
            cable=self._setup.cable,
            times=now,
            nodes=track.nodes[-1:],
            joint_path=path,
            arm=self._setup.arm,
        )
        film = self._camera.film(trial, seed)
        return film.frame(film.LEAD)
