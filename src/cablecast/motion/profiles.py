"""Jerk-limited maximum-velocity profiles, planned with ruckig, as batches of polynomial phases.

Paper, section V-B: a maximum-velocity spline with jerk-limited bang-bang control. ruckig plans each
rest-to-rest move without a limit of acceleration, so that only the jerk switches. Only the phases
are read from ruckig: nothing is sampled in Python.
"""

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError

PHASE_COUNT = 7
"""Number of constant-jerk phases of a rest-to-rest move. Those of constant acceleration last 0 s,
since acceleration is unlimited."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Profiles:
    """Rest-to-rest moves from 0, one per row, in phases of constant jerk.

    Attributes:
        durations: Duration of each phase [s], shape [move, 7].
        jerks: Jerk of each phase [rad/s³], same shape.
    """

    durations: NDArray[np.float64]
    jerks: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.durations)

    @functools.cached_property
    def knots(self) -> NDArray[np.float64]:
        """Times at which the jerk switches, from 0 to the end [s], shape [move, 8]."""
        start = np.zeros((len(self), 1))
        return np.concatenate([start, np.cumsum(self.durations, axis=1)], axis=1)

    @property
    def duration(self) -> NDArray[np.float64]:
        """Duration of each move [s], shape [move]."""
        return self.knots[:, -1]

    @property
    def peak_velocity(self) -> NDArray[np.float64]:
        """Peak speed of each move [rad/s], shape [move]; by symmetry, the speed halfway."""
        return np.abs(self.evaluate(self.duration[:, None] / 2)[1][:, 0])

    def dilated(self, factor: NDArray[np.float64]) -> "Profiles":
        """Return the moves slowed down by a factor.

        Args:
            factor: Factor of all times, at least 1 [-], shape [move].
        """
        factor = factor[:, None]
        return Profiles(durations=self.durations * factor, jerks=self.jerks / factor**3)

    def evaluate(
        self, times: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return position, velocity and acceleration; at rest before the start and after the end.

        Args:
            times: Times since the start of each move [s], shape [move, step].

        Returns:
            Position [rad], velocity [rad/s], acceleration [rad/s²], each of shape [move, step].
        """
        knots = self.knots
        position, velocity, acceleration = self._states
        times = np.clip(times, 0.0, knots[:, -1:])
        phase = np.zeros(times.shape, dtype=np.intp)
        for column in range(1, PHASE_COUNT):
            phase += times >= knots[:, column : column + 1]
        p, v, a, j, start = (
            np.take_along_axis(values, phase, axis=1)
            for values in (position, velocity, acceleration, self.jerks, knots)
        )
        t = times - start
        return (
            p + t * (v + t * (a / 2 + t * j / 6)),
            v + t * (a + t * j / 2),
            a + t * j,
        )

    @functools.cached_property
    def _states(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return position, velocity and acceleration at each knot, each of shape [move, 8]."""
        p, v, a = np.zeros((3, len(self), PHASE_COUNT + 1))
        for phase in range(PHASE_COUNT):
            t, j = self.durations[:, phase], self.jerks[:, phase]
            p0, v0, a0 = p[:, phase], v[:, phase], a[:, phase]
            p[:, phase + 1] = p0 + t * (v0 + t * (a0 / 2 + t * j / 6))
            v[:, phase + 1] = v0 + t * (a0 + t * j / 2)
            a[:, phase + 1] = a0 + t * j
        return p, v, a


def plan_profiles(
    distances: NDArray[np.float64], velocities: NDArray[np.float64], jerks: NDArray[np.float64]
) -> Profiles:
    """Plan the fastest rest-to-rest moves within limits of velocity and jerk.

    Args:
        distances: Signed distances [rad], shape [move].
        velocities: Velocity limit of each move [rad/s], shape [move].
        jerks: Jerk limit of each move [rad/s³], shape [move].

    Raises:
        InputError: ruckig finds no plan because a distance or a limit is invalid.
    """
    import ruckig

    planner = ruckig.Ruckig(1)
    request = ruckig.InputParameter(1)
    request.max_acceleration = [float("inf")]
    trajectory = ruckig.Trajectory(1)
    # Plan all moves forwards and then mirror them, so that mirrored moves are bit-identical. A grid
    # of actions has few distinct moves; each is planned once.
    moves, inverse = np.unique(
        np.stack([np.abs(distances), velocities, jerks], axis=1), axis=0, return_inverse=True
    )
    planned = np.zeros((len(moves), 2, PHASE_COUNT))
    for row, (distance, velocity, jerk) in enumerate(moves.tolist()):
        if distance == 0.0:
            continue
        request.target_position = [distance]
        request.max_velocity = [velocity]
        request.max_jerk = [jerk]
        try:
            planner.calculate(request, trajectory)
        except ruckig.RuckigError as error:
            raise InputError(
                f"no profile over {distance} rad at {velocity} rad/s and {jerk} rad/s³: "
                + str(error).strip()
            ) from None
        profile = trajectory.profiles[0][0]
        planned[row, 0] = profile.t
        planned[row, 1] = profile.j
    planned = planned[inverse.reshape(-1)]
    return Profiles(durations=planned[:, 0], jerks=planned[:, 1] * np.sign(distances)[:, None])
