"""AimedCast and AimChoice: a cast that an aimer learned from, and one that it proposes."""

import dataclasses

import numpy as np
from numpy.typing import NDArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class AimedCast:
    """A cast that the aimer learned from.

    Attributes:
        action: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [4].
        endpoint_xy: Landing [m], shape [2]; NaN for a cast without one.
        fitted: True if the simulator was fitted to it: it then lands nearer to its prediction than
            others will, and teaches less.
        target_xy: Target that it was aimed at [m], shape [2]; NaN for a cast without one.
    """

    action: NDArray[np.float64]
    endpoint_xy: NDArray[np.float64]
    fitted: bool = False
    target_xy: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.full(2, np.nan))

    @property
    def aimed(self) -> bool:
        """True if it was aimed at a target: other casts do not tell how far such casts miss."""
        return bool(np.all(np.isfinite(self.target_xy)))

    @property
    def landed(self) -> bool:
        """True if the cast has a landing."""
        return bool(np.all(np.isfinite(self.endpoint_xy)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class AimChoice:
    """An action for a target, and what to expect of it.

    Attributes:
        target_xy: Target [m], shape [2].
        action: Action, shape [4].
        expected_xy: Expected landing [m], shape [2].
        covariance: Covariance of the landing, scatter included [m²], shape [2, 2].
        scatter: Standard deviation along each axis of equal casts [m].
        failure: Chance that the cast ends without a landing [-].
        inside_coverage: True if simulated casts land near the target.
    """

    target_xy: NDArray[np.float64]
    action: NDArray[np.float64]
    expected_xy: NDArray[np.float64]
    covariance: NDArray[np.float64]
    scatter: float
    failure: float
    inside_coverage: bool
