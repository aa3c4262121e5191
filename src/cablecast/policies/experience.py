"""Experience: what casts taught beyond the simulator: residuals, scatter, failures, and drift."""

import copy
import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.models.few_casts import FewCastResidual, Places, ResidualScales

FAILURE_SHARE = 0.02
"""Share of casts without a landing that is expected before any cast."""

# Casts that the belief about scatter and failures is worth.
_SCATTER_CASTS, _FAILURE_CASTS = 2.0, 3.0
_SCATTER_MIN, _SCATTER_MAX = 0.25, 25.0
# A cast that the simulator was fitted to counts as if it scattered more, by this share.
_FITTED_NOISE = 0.5
# A drift is noticed where so many casts surprise by so much on average (1 is expected), of which
# none counts for more than a few, and not before there are enough casts to know the usual. The
# noise of earlier casts then grows by a factor.
_DRIFT_CASTS, _DRIFT_SURPRISE, _SURPRISE_MAX, _DRIFT_FROM = 10, 2.0, 4.0, 20
_OLD_NOISE = 3.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Lesson:
    """Lesson of one cast with a landing.

    Attributes:
        surprise: Squared distance from expected to actual landing over the expected one.
        weight: Share of the scatter in the expected one: what the process did not know says
            nothing about scatter.
        fitted: Whether the simulator was fitted to the cast.
        aimed: True if the cast was aimed at a target.
        age: Factor of its noise, which a drift lets grow.
    """

    surprise: float
    weight: float
    fitted: bool
    aimed: bool
    age: float = 1.0


class Experience:
    """Residuals of the casts so far, and what they say of scatter, failures and drift.

    Args:
        believed: Scales of the residual that are expected before any cast; the defaults where None.

    Attributes:
        residual: What real casts added to the simulated landings.
        drifts: Numbers of casts with a landing after which a drift was noticed.
    """

    def __init__(self, believed: ResidualScales | None = None):
        self.residual = FewCastResidual.empty(believed)
        self.drifts: list[int] = []
        self._lessons: list[_Lesson] = []
        self._failed = self._ended = self.residual.places

    def copy(self) -> "Experience":
        """Return an experience of the same casts that grows on its own."""
        other = copy.copy(self)
        other.drifts, other._lessons = list(self.drifts), list(self._lessons)
        return other

    @property
    def surprises(self) -> list[float]:
        """Surprise of each cast with a landing; 1 on average."""
        return [lesson.surprise for lesson in self._lessons]

    @property
    def ages(self) -> list[float]:
        """Factor of the noise of each cast with a landing, which drifts let grow."""
        return [lesson.age for lesson in self._lessons]

    def add(
        self,
        place: Places,
        residual: NDArray[np.float64] | None,
        *,
        fitted: bool = False,
        aimed: bool = True,
        age: float | None = None,
    ) -> None:
        """Learn from one cast.

        Args:
            place: Place of the cast.
            residual: Measured minus simulated landing [cable lengths], shape [2]; None for a cast
                without a landing.
            fitted: Whether the simulator was fitted to the cast.
            aimed: True if the cast was aimed at a target.
            age: Factor of its noise as it is known; drifts are noticed where None.
        """
        self._ended = Places.join([self._ended, place])
        if residual is None:
            self._failed = Places.join([self._failed, place])
            return
        mean, variance = self.residual.predict(place)
        scatter = self.residual.scatter_variance(place)
        total = float(variance[0] + scatter[0])
        self._lessons.append(
            _Lesson(
                surprise=float(np.sum((residual - mean[0]) ** 2) / (2.0 * total)),
                weight=0.0 if fitted else float(scatter[0]) / total,
                fitted=fitted,
                aimed=aimed,
                age=age or 1.0,
            )
        )
        self.residual = self.residual.with_cast(place, residual)
        if age is None:
            self._notice_drift()
        self._renew_scatter()

    def refit(self) -> None:
        """Fit the scales of the process anew to the casts that were aimed.

        The others miss by less: a cast that is chosen for where it is expected to land is often one
        whose expected landing is wrong, and many targets are reached by delicate casts only.
        """
        telling = [lesson.aimed and not lesson.fitted for lesson in self._lessons]
        self.residual = self.residual.fitted(np.array(telling, dtype=bool))
        self._renew_scatter()

    def scatter(self, places: Places) -> NDArray[np.float64]:
        """Return the variance of equal casts along each axis [square cable lengths], [action]."""
        return self.residual.scatter_variance(places) * self._scatter_factor(places)

    def failure_chance(self, places: Places) -> NDArray[np.float64]:
        """Return the chance of a cast without a landing, from casts nearby, shape [action]."""
        failed = (self.residual.correlation(places, self._failed) ** 4).sum(axis=1)
        ended = (self.residual.correlation(places, self._ended) ** 4).sum(axis=1)
        return (_FAILURE_CASTS * FAILURE_SHARE + failed) / (_FAILURE_CASTS + ended)

    def _scatter_factor(self, places: Places) -> NDArray[np.float64]:
        """Return the variance of the scatter over that expected, from surprises nearby."""
        weights = np.array([lesson.weight for lesson in self._lessons])
        near = self.residual.correlation(places) ** 4 * weights
        surprise = near @ np.array(self.surprises)
        factor = (_SCATTER_CASTS + surprise) / (_SCATTER_CASTS + near.sum(axis=1))
        return np.clip(factor, _SCATTER_MIN, _SCATTER_MAX)

    def _renew_scatter(self) -> None:
        """Let each cast of the process scatter as casts like it do."""
        noise = np.sqrt(self._scatter_factor(self.residual.places))
        noise = noise * [lesson.age for lesson in self._lessons]
        noise = noise + _FITTED_NOISE * np.array([lesson.fitted for lesson in self._lessons])
        self.residual = dataclasses.replace(self.residual, scatter=noise)

    def _notice_drift(self) -> None:
        """Let earlier casts count less where the last ones surprise by more than they should."""
        count = len(self._lessons)
        if count < _DRIFT_FROM or count - max(self.drifts, default=0) < _DRIFT_CASTS:
            return
        last = np.minimum(self.surprises[-_DRIFT_CASTS:], _SURPRISE_MAX)
        if float(np.mean(last)) > _DRIFT_SURPRISE:
            self.drifts.append(count)
            for row in range(count - _DRIFT_CASTS):
                old = self._lessons[row]
                self._lessons[row] = dataclasses.replace(old, age=_OLD_NOISE * old.age)
