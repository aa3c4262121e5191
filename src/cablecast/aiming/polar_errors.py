"""PolarErrors: what a simulator of polar casts errs by, a Gaussian process over their parameters.

Errors are those along the resting cable and across it. All casts share a part of them, which tells
how far the swing leaves the cable from straight. Another part grows with the angle by which the
pull turns the cable, and others change from cast to cast.
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from cablecast.conventions import Array
from cablecast.learning.kernel import matern
from cablecast.motion.polar import PolarCast, PullReach

LEVELS = np.array([0.013, 0.02])
"""Standard deviation of the part of the simulator's error that all casts share, along the cable and
across it [cable lengths]. These were chosen by 134 polar casts of three cables in three virtual
laboratories; with three pilots the others landed 1.3 % from where they were expected in the median
(4.4 % with one straight ahead)."""

TURNING = 0.08
"""That of the error across the cable per angle by which the pull turns it [cable lengths/rad]."""

CHANGES = np.array([0.015, 0.045])
"""That of the part that changes from cast to cast as a Matern 3/2 process [cable lengths]."""

SCALES = np.array([1.0, 0.8, 0.8])
"""Changes of azimuth, x and y over which it changes [rad, m, m]."""

LOCAL, LOCAL_SCALE = np.array([0.015, 0.03]), 0.15
"""The same of a part that changes over a share of these scales only. Equal casts end within some
thousandths of the length, so what is left of an error at a target is removed by the next cast
there. Without this part it was taken for scatter, and a third of it followed."""

FLOOR = 0.003
"""Standard deviation of equal casts along each axis after a long pull [cable lengths]."""

SWAY = np.array([0.003, 0.015])
"""That of how a swing lays the cable down, along it and across it [cable lengths]. A pull lets the
free end trail, and takes it down by exp(-way / length)."""

ERROR_SIZES, SWAY_SIZES = np.geomspace(0.5, 5.0, 7), np.geomspace(0.5, 8.0, 5)
"""Sizes of the simulator's errors and of the sway over the typical ones, all of which are believed
in part, by the casts that were made: a light cable may not be laid out, or never twice alike."""

SIZES = np.reshape(np.meshgrid(ERROR_SIZES, SWAY_SIZES, indexing="ij"), (2, -1))
"""All pairs of these, shape [2, size]."""

SIZE_DEVIATIONS = np.array([0.6, 0.6])
"""Standard deviation of the logarithms of these sizes about 0 before any cast."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class PolarErrors:
    """Errors of a simulator in polar casts at one pace.

    Attributes:
        reach: Where casts bring the end of a straight cable.
        actions: Casts that were made.
        errors: Their errors along the cable and across it [cable lengths], shape [cast, 2].
    """

    reach: PullReach
    actions: tuple[PolarCast, ...]
    errors: Array

    def at(self, cast: PolarCast) -> tuple[Array, Array, Array]:
        """Return the expected error of a cast, what is not known of it, and the scatter of equals.

        Each is along the cable and across it, shape [2]: the first in cable lengths, the others as
        variances [square cable lengths].
        """
        errors, sways = SIZES
        alone = self._covariances([cast], [cast])[:, 0, 0]
        squares = errors[:, None, None] ** 2
        kernels = squares * self._covariances([cast], self.actions)[:, 0]
        gains = np.einsum("sanm,sam->san", self._inverses, kernels)
        means = np.einsum("san,na->sa", gains, self.errors)
        left = np.maximum(squares[:, 0] * alone - np.sum(gains * kernels, axis=2), 0.0)
        mean, left = self._weights @ means, self._weights @ (left + means**2)
        noise = self._weights @ self._noise([cast], sways)[:, :, 0]
        return mean, left - mean**2, noise

    def deviation(self, casts: Sequence[PolarCast]) -> float:
        """Return how far from where they are expected some casts land [cable lengths]."""
        return float(np.sqrt(np.mean([np.sum(self.at(cast)[1:]) for cast in casts])))

    def _covariances(self, first: Sequence[PolarCast], second: Sequence[PolarCast]) -> Array:
        """Return the covariance of the errors, shape [2, first, second]."""
        points = [np.reshape([scaled(c) for c in casts], (-1, 3)) for casts in (first, second)]
        turns = np.outer(
            [self.reach.turn(cast) for cast in first], [self.reach.turn(cast) for cast in second]
        )
        level, change, local = (size[:, None, None] ** 2 for size in (LEVELS, CHANGES, LOCAL))
        fine = matern(*(rows / LOCAL_SCALE for rows in points))
        along, across = level + change * matern(*points) + local * fine
        return np.stack([along, across + TURNING**2 * turns])

    def _noise(self, casts: Sequence[PolarCast], sways: Array) -> Array:
        """Return the variance of equal casts, by the sway, shape [size, 2, cast]."""
        left = np.exp([-self.reach.way(cast) / self.reach.back.cable_length for cast in casts])
        return FLOOR**2 + (np.multiply.outer(sways, SWAY)[:, :, None] * left) ** 2

    @functools.cached_property
    def _spreads(self) -> Array:
        """Covariance of the errors that were seen, by the sizes, shape [size, 2, cast, cast]."""
        errors, sways = SIZES
        own = self._covariances(self.actions, self.actions)
        noise = self._noise(self.actions, sways)[..., None] * np.eye(len(self.actions))
        return errors[:, None, None, None] ** 2 * own + noise

    @functools.cached_property
    def _inverses(self) -> Array:
        """Their inverses."""
        return np.asarray(np.linalg.inv(self._spreads), dtype=float)

    @functools.cached_property
    def _weights(self) -> Array:
        """How much each pair of sizes is believed after these errors, shape [size]."""
        squares = np.einsum("na,sanm,ma->s", self.errors, self._inverses, self.errors)
        squares += np.linalg.slogdet(self._spreads)[1].sum(axis=1)
        squares += np.sum((np.log(SIZES) / SIZE_DEVIATIONS[:, None]) ** 2, axis=0)
        weights = np.exp(-0.5 * (squares - squares.min()))
        return weights / weights.sum()


def scaled(cast: PolarCast) -> Array:
    """Return the parameters of a cast that the errors change with over their scales, [3]."""
    return cast.to_array()[:3] / SCALES
