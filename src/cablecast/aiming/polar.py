"""PolarLandings: where polar casts are expected to land, from a simulator and from real ones.

A polar cast swings the cable out in the same way at every target and pulls it slowly along the
table, so that equal casts end within some thousandths of its length, and all err alike: to one side
by as much as the cable is curled, the less the longer the pull, and short by as much as it is not
laid out straight. What the simulator does not have of this is modelled as a Gaussian process with a
Matern 3/2 kernel over the cast's parameters, for the error along the cable and across it. So one
cast corrects most of the others, and the next is aimed as far the other way.
"""

import contextlib
import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.cast import Cast
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import CablecastError, InputError
from cablecast.learning.kernel import matern
from cablecast.motion.polar import PolarCast, PullReach
from cablecast.motion.trajectory import plan_trajectory
from cablecast.setup import Setup
from cablecast.task import LANDING, Expectation, Landing, MissLaw, Task
from cablecast.tuning.tuned import Tuned

AMPLITUDES = np.array([0.04, 0.15])
"""Standard deviation of the error of the simulator along the cable and, before the pull, across it
[cable lengths]. The pull lets the latter decay as exp(-s / L), with s its way and L the length of
the cable. Polar casts of cable 1 in laboratory 0 of the virtual rig erred by up to 3 % along it,
and by 5 to 16 % across it where the pull was short."""

SCALES = np.array([1.0, 0.4, 0.4])
"""Changes of azimuth, x and y over which these errors change [rad, m, m]."""

PACES = (0.9, 0.8, 1.0)
"""Paces of the swing in the order in which they are tried. In seven pairs of a laboratory and a
cable, swings at 0.9 erred by 0.5 to 14 %; at 1.0 a light cable was left in a heap, and at 0.83 a
stiff one after a short pull."""

LAID_OUT = 0.08
"""Error up to which a swing has laid the cable out [cable lengths]; else another pace is tried."""

SCATTER = 0.008
"""Standard deviation of equal polar casts along each axis [cable lengths]: 0.1 to 0.6 % there, and
up to 3 % where the gripper comes down straight ahead and barely pulls."""

# Steps of the aim point towards the one that is expected on the target, and the distance from it
# at which they end [m].
_STEPS, _CLOSE = 4, 0.002
# Distance of two casts in units of `SCALES` below which they are alike.
_SAME = 0.05
# Errors that the belief about their size is worth.
_BELIEVED = 4.0

_Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class PolarLandings:
    """Landings of polar casts.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        dynamics: Simulator whose landings are expected.
        engine: Engine that simulates it.
        reach: Places to which they bring a straight cable's end.
        casts: Polar casts that landed.
        lost: Polar casts that did not; none is made again.
    """

    setup: Setup
    dynamics: Dynamics
    engine: Engine
    reach: PullReach
    casts: tuple[Cast, ...] = ()
    lost: tuple[PolarCast, ...] = ()
    _known: dict[PolarCast, _Array] = dataclasses.field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, ensemble: Tuned | None, task: Task = LANDING) -> "PolarLandings | None":
        """Return the landings before any cast; None for another task, or where none is reached."""
        if ensemble is None or not isinstance(task, Landing):
            return None
        try:
            reach = PullReach.of(ensemble.setup)
        except InputError:
            return None
        return cls(
            setup=ensemble.setup,
            dynamics=ensemble.dynamics,
            engine=ensemble.member_engine,
            reach=reach,
        )

    def with_casts(self, casts: Sequence[Cast]) -> "PolarLandings":
        """Return the landings after more casts, of which only polar ones count."""
        new = [cast for cast in casts if isinstance(cast.action, PolarCast)]
        if not new:
            return self
        landed = [cast for cast in new if cast.landed]
        lost = [cast.action for cast in new if not cast.landed]
        return dataclasses.replace(self, casts=(*self.casts, *landed), lost=(*self.lost, *lost))

    @functools.cached_property
    def pace(self) -> float:
        """Pace of the casts: the first that lays the cable out, or the best of all."""
        typical = []
        for pace in PACES:
            offsets = [
                np.linalg.norm(cast.final_xy - self._simulated_xy(action))
                for cast, action in self._made
                if action.pace == pace
            ]
            typical.append(float(np.median(offsets)) / self.setup.cable.length if offsets else 0.0)
            if typical[-1] < LAID_OUT:
                return pace
        return PACES[int(np.argmin(typical))]

    @property
    def pilot(self) -> PolarCast | None:
        """The cast from which most is learned of the others, straight ahead with a middling pull.

        None once there is a polar cast of its pace, and where the arm cannot follow.
        """
        pace = self.pace
        if any(action.pace == pace for action in (*self.lost, *(one for _, one in self._made))):
            return None
        back = self.reach.back
        radius = 0.5 * float(back.landing_radius(0.0) + back.pulled_radius(0.0))
        cast = PolarCast.back_to([0.0, radius], back, pace)
        with contextlib.suppress(CablecastError):
            plan_trajectory(cast, self.setup)
            return cast
        return None

    def aimed_at(self, target_xy: _Array) -> PolarCast | None:
        """Return the cast that is expected nearest to a target [m], shape [2].

        None for a target beyond the reach, where the arm cannot follow, and where a cast like it
        was lost.
        """
        found: list[tuple[float, PolarCast]] = []
        aim_xy = target_xy
        with contextlib.suppress(CablecastError):
            for _ in range(_STEPS):
                if (cast := self.reach.cast_to(aim_xy, self.pace)) is None:
                    break
                offset = target_xy - self.expectation(cast).mean
                plan_trajectory(cast, self.setup)
                found.append((float(np.linalg.norm(offset)), cast))
                if found[-1][0] < _CLOSE:
                    break
                aim_xy = aim_xy + offset
        if not found:
            return None
        best = min(found, key=lambda one: one[0])[1]
        steps = [_point(best) - _point(other) for other in self.lost if other.pace == best.pace]
        return None if any(np.linalg.norm(step) < _SAME for step in steps) else best

    def expectation(self, cast: PolarCast, law: MissLaw | None = None) -> Expectation:
        """Return where a cast is expected to land.

        Raises:
            CablecastError: There is no such cast.
        """
        length, axes = self.setup.cable.length, self._axes(cast)
        mean, sizes = self._simulated_xy(cast), self._sizes(cast)
        variance = np.ones(2)
        if self._own:
            kernel = matern(_point(cast)[None], self._points)[0]
            gains = np.array([inverse @ kernel for inverse in self._inverses])
            errors = sizes * np.sum(gains * self._errors.T, axis=1)
            mean = mean + length * errors @ axes
            variance = self._scale**2 * np.maximum(variance - gains @ kernel, 0.0)
        covariance = length**2 * axes.T @ np.diag(sizes**2 * variance + SCATTER**2) @ axes
        return Expectation(
            mean=mean, covariance=covariance, law=law or MissLaw(), scatter=SCATTER * length
        )

    def _simulated_xy(self, cast: PolarCast) -> _Array:
        """Return where a cast lands in the simulator [m], shape [2]."""
        if cast not in self._known:
            path = self.dynamics.follow(cast.grip_path(self.setup), self.setup)
            rollout = self.dynamics.rollout(self.engine, self.setup, path)
            self._known[cast] = rollout.endpoint_xy[0, -1]
        return self._known[cast]

    def _axes(self, cast: PolarCast) -> _Array:
        """Return the unit vectors along the resting cable and across it, to its right, [2, 2]."""
        offset = self.reach.end_xy(cast.to_array()) - np.array([cast.x, cast.y])
        along = offset / self.setup.cable.length
        return np.stack([along, np.array([along[1], -along[0]])])

    def _sizes(self, cast: PolarCast) -> _Array:
        """Return the typical size of the error on these axes [cable lengths], shape [2]."""
        decay = np.exp(-self.reach.way(cast) / self.setup.cable.length)
        return AMPLITUDES * np.array([1.0, decay])

    @functools.cached_property
    def _scale(self) -> float:
        """Size of the errors over the typical one [-]: a swing may not lay out a light cable."""
        squares = np.sum(self._errors**2)
        return float(np.sqrt((_BELIEVED + squares) / (_BELIEVED + self._errors.size)))

    @functools.cached_property
    def _made(self) -> list[tuple[Cast, PolarCast]]:
        """The casts that landed, with their motions."""
        return [(cast, cast.action) for cast in self.casts if isinstance(cast.action, PolarCast)]

    @functools.cached_property
    def _own(self) -> list[tuple[Cast, PolarCast]]:
        """Those of them at the pace of the next one: swings at another pace err otherwise."""
        return [(cast, action) for cast, action in self._made if action.pace == self.pace]

    @functools.cached_property
    def _points(self) -> _Array:
        return np.array([_point(action) for _, action in self._own])

    @functools.cached_property
    def _errors(self) -> _Array:
        """Errors of the simulator on the axes over their standard deviations, shape [cast, 2]."""
        rows = []
        for cast, action in self._own:
            offset = (cast.final_xy - self._simulated_xy(action)) / self.setup.cable.length
            rows.append(self._axes(action) @ offset / self._sizes(action))
        return np.reshape(rows, (-1, 2))

    @functools.cached_property
    def _inverses(self) -> list[_Array]:
        """Inverse covariance of these errors for each axis, shape [cast, cast]."""
        noise = (SCATTER / np.array([self._sizes(action) for _, action in self._own])) ** 2
        kernel = matern(self._points, self._points)
        return [np.linalg.inv(kernel + np.diag(one)) for one in noise.T]


def _point(cast: PolarCast) -> _Array:
    """Return the parameters of a cast that the errors change with over their scales, [3]."""
    return cast.to_array()[:3] / SCALES
