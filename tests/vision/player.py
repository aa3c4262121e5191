"""Motions of a cable, and a laboratory that plays them before a camera with its own clock."""

import threading
import time

import numpy as np

from cablecast.cable import load_cable
from cablecast.rigs.virtual.drawing import FilmedTrial
from cablecast.vision.trials import TrialTiming
from cablecast.workspace import Workspace

CABLE = load_cable("cable_1")
DT = 0.01


def glide(start, end, duration=0.4, rest=0.1, z=None, joint_path=None, grip=(0.0, 0.6), bow=0.3):
    """Return a cable whose end goes from one place to another and rests; it follows in a bow."""
    times = np.arange(round((duration + rest) / DT) + 1) * DT
    u = np.clip(times / duration, 0, 1)
    s = (u**3 * (10 - 15 * u + 6 * u * u))[:, None]
    path = np.asarray(start) + s * (np.asarray(end) - np.asarray(start))
    share = np.linspace(0, 1, 12)[:, None]
    chord = path[:, None] - np.asarray(grip)
    across = np.stack([-chord[..., 1], chord[..., 0]], axis=-1)
    xy = np.asarray(grip) + share * chord + bow * np.sin(np.pi * share) * across
    height = np.full((*xy.shape[:2], 1), CABLE.radius)
    if z is not None:
        # Beyond the table the cable hangs: everything past the edge is below it.
        height = np.where(np.abs(xy[..., :1]) > Workspace().half_width, z, height)
    nodes = np.concatenate([xy, height], axis=-1)
    return FilmedTrial(cable=CABLE, times=times, nodes=nodes, joint_path=joint_path)


class Player:
    """Shows a still scene, and a motion whenever one is asked for.

    Args:
        stream: Camera to show it to.
        trial: Motion of cable and arm; its first instant is the still scene.
    """

    def __init__(self, stream, trial):
        self.stream = stream
        self.trial = trial
        self.time = 10.0
        self._start = np.inf
        self._running = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def cast(self):
        """Play the motion, and return when it took place in the laboratory's clock."""
        start = self.time + 3 * DT
        self._start = start
        end = start + float(self.trial.times[-1])
        while self.time < end:
            time.sleep(0.005)
        pairs = np.array([[self.time, time.monotonic()]])
        return TrialTiming(start_time=start, end_time=end, clock_pairs=pairs)

    def rewind(self, trial=None):
        """Go back to the still scene before a motion, and return since when it is shown."""
        self._start = np.inf
        self.trial = trial or self.trial
        # The instant that is being shown, and the picture between it and the next, are of before.
        return self.time + 5 * DT

    def close(self):
        """Stop the clock."""
        self._running = False
        self._thread.join()

    def _run(self):
        while self._running:
            self.time += DT
            since = np.array([self.time - self._start]) if np.isfinite(self._start) else np.zeros(1)
            q = None
            if self.trial.joint_path is not None:
                path = self.trial.joint_path
                q = [float(np.interp(since[0], path.times, joint)) for joint in path.q.T]
            self.stream.show(self.time, q, self.trial.shape_at(since)[0])
            # No faster than a real laboratory.
            time.sleep(DT / 2)
