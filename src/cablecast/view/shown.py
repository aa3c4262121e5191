"""ShownCast: one cast as it is drawn, measured or simulated, at any instant."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.engines.base import Rollout
from cablecast.motion.joint_path import JointPath, joints_at
from cablecast.motion.trajectory import Trajectory
from cablecast.track import EndpointTrack, TrialStatus

FRAME_DT = 0.02
"""Interval of the shapes that are drawn [s]: half of the time between two pictures on a screen that
shows 25 a second, so that slow motion is smooth, too."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ShownCast:
    """One cast as it is drawn.

    Attributes:
        times: Times of the shapes [s], shape [step]; the first is 0.
        endpoint_xy: Free end [m], shape [step, 2]; NaN where it was not seen.
        nodes: Cable [m], shape [step, node, 3]; None where nobody saw it.
        joint_path: Joints of the arm; None for a rig without joints.
        status: End of the cast.
    """

    times: NDArray[np.float64]
    endpoint_xy: NDArray[np.float64]
    nodes: NDArray[np.float64] | None
    joint_path: JointPath | None
    status: TrialStatus = TrialStatus.OK

    @classmethod
    def of_track(cls, track: EndpointTrack, trajectory: Trajectory | None = None) -> "ShownCast":
        """Return a cast on a rig.

        Args:
            track: Answer of the rig.
            trajectory: Planned motion, whose joints are shown where the rig reported none.
        """
        planned = None if trajectory is None else trajectory.joint_path
        times = np.arange(0.0, float(track.times[-1]) + 1e-9, FRAME_DT)
        return cls(
            times=times,
            endpoint_xy=_smooth(track.times, track.endpoint_xy, times),
            nodes=None if track.nodes is None else _smooth(track.times, track.nodes, times),
            joint_path=track.joint_path or planned,
            status=track.status,
        )

    @classmethod
    def of_rollout(
        cls, rollout: Rollout, trajectory: Trajectory, world: int = 0, status=TrialStatus.OK
    ) -> "ShownCast":
        """Return a cast in the simulator.

        Args:
            rollout: Answer of the engine, with the nodes recorded.
            trajectory: Motion that was simulated.
            world: Row of the rollout.
            status: End of the cast.
        """
        return cls(
            times=rollout.times,
            endpoint_xy=rollout.endpoint_xy[world],
            nodes=None if rollout.nodes is None else rollout.nodes[world],
            joint_path=trajectory.joint_path,
            status=status,
        )

    @classmethod
    def of_values(cls, values: Mapping[str, Any]) -> "ShownCast":
        """Return a cast of a store (datasets/store.py), which keeps the free end and the joints.

        Args:
            values: Columns of motion and track, see `trial_values`.
        """
        joints = None
        for name in ("actual", "joint"):
            if joints is None and values.get(f"{name}_q") is not None:
                times, q = np.asarray(values[f"{name}_times"]), np.asarray(values[f"{name}_q"])
                joints = joint_path_through(times, q.reshape(len(times), -1))
        track = EndpointTrack(
            times=np.asarray(values["times"], dtype=float),
            endpoint_xy=np.stack([values["track_x"], values["track_y"]], axis=-1),
            status=TrialStatus.from_code(values["status"]),
            joint_path=joints,
        )
        return cls.of_track(track)

    @property
    def duration(self) -> float:
        """End of the cast [s]."""
        return float(self.times[-1])

    def nodes_at(self, time: float) -> NDArray[np.float64] | None:
        """Return the cable at a time [s], shape [node, 3]; None where it is not known."""
        if self.nodes is None:
            return None
        step, part = self._place(time)
        shape = (1.0 - part) * self.nodes[step] + part * self.nodes[min(step + 1, self._last)]
        return shape if np.all(np.isfinite(shape)) else None

    def endpoint_at(self, time: float) -> NDArray[np.float64]:
        """Return the free end at a time [s], shape [2]; NaN where it was not seen."""
        step, part = self._place(time)
        after = self.endpoint_xy[min(step + 1, self._last)]
        return (1.0 - part) * self.endpoint_xy[step] + part * after

    def joints_at(self, time: float) -> NDArray[np.float64] | None:
        """Return the joint angles at a time [rad], shape [6]; None for a rig without joints."""
        return None if self.joint_path is None else joints_at(self.joint_path, [time])[0]

    def trail(self, until: float) -> NDArray[np.float64]:
        """Return where the free end was seen up to a time [m], shape [point, 2]."""
        points = self.endpoint_xy[self.times <= until + 1e-9]
        return points[np.all(np.isfinite(points), axis=1)]

    @property
    def _last(self) -> int:
        return len(self.times) - 1

    def _place(self, time: float) -> tuple[int, float]:
        """Return the step before a time, and the part of the interval that has passed."""
        time = float(np.clip(time, 0.0, self.duration))
        step = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, self._last))
        if step == self._last:
            return step, 0.0
        return step, (time - self.times[step]) / (self.times[step + 1] - self.times[step])


def joint_path_through(times: NDArray[np.float64], q: NDArray[np.float64]) -> JointPath:
    """Return the path through joint angles, with rates by differences.

    Args:
        times: Times [s], shape [tick].
        q: Joint angles [rad], shape [tick, 6].
    """
    qd = np.asarray(np.gradient(q, times, axis=0)) if len(times) > 1 else np.zeros_like(q)
    return JointPath(times=times, q=q, qd=qd)


def _smooth(
    times: NDArray[np.float64], values: NDArray[np.float64], at: ArrayLike
) -> NDArray[np.float64]:
    """Return samples at other times, by curves that do not overshoot.

    Rigs sample every 0.1 s; straight lines between such shapes would let the cable shrink. A value
    between a seen and an unseen sample is NaN.

    Args:
        times: Times of the samples [s], shape [step].
        values: Samples, shape [step, ...]; NaN where not seen.
        at: Times asked for [s], shape [time].
    """
    from scipy.interpolate import PchipInterpolator

    at = np.asarray(at, dtype=float)
    flat = values.reshape(len(times), -1)
    seen = np.all(np.isfinite(flat), axis=1)
    result = np.full((len(at), flat.shape[1]), np.nan)
    if np.count_nonzero(seen) >= 2:
        result = PchipInterpolator(times[seen], flat[seen], extrapolate=False)(at)
        # A time is known where the samples on both of its sides were seen.
        after = np.clip(np.searchsorted(times, at, side="left"), 0, len(times) - 1)
        before = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 1)
        result[~(seen[before] & seen[after])] = np.nan
    elif seen[0]:
        result[:] = flat[0]
    return result.reshape(len(at), *values.shape[1:])
