"""LocalSize: by how much more casts to one place of the table may miss than casts to another.

Far and sideways landings depend more on what is not known of the cable. Where simulators of
different physics follow the same casts, the spread of their landings tells the size. Otherwise the
sensitivity of landings to the action does: over the whole table it tells where the simulator errs,
but not among actions with the same landing (docs/aim-results.md).
"""

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

# Smaller values are taken for this share of the usual one: their logarithm would say too much.
_SHARE_MIN = 0.05
# Each value is known to a third or so only, from a handful of simulators.
_SMOOTHING = 10.0


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class LocalSize:
    """Smooth map of the size over the table.

    Attributes:
        landing_xy: Simulated landings of some actions to the right [m], shape [action, 2].
        values: Size of a miss or sensitivity of these landings, in any unit, shape [action].
    """

    landing_xy: NDArray[np.float64]
    values: NDArray[np.float64]

    @property
    def usual(self) -> float:
        """Value of a usual action."""
        return float(np.median(self.values))

    def log_sizes(self, landing_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the logarithm of the size over that of a usual landing, shape [action].

        Args:
            landing_xy: Simulated landings of actions to the right [m], shape [action, 2].
        """
        # Beyond the landings that are known the map would grow without bounds.
        found = self._map((landing_xy - self._middle) / self._scale)
        return np.asarray(np.clip(found, *self._bounds), dtype=float)

    @functools.cached_property
    def _logs(self) -> NDArray[np.float64]:
        return np.log(np.maximum(self.values / self.usual, _SHARE_MIN))

    @functools.cached_property
    def _bounds(self) -> tuple[float, float]:
        return float(self._logs.min()), float(self._logs.max())

    @functools.cached_property
    def _middle(self) -> NDArray[np.float64]:
        return self.landing_xy.mean(axis=0)

    @functools.cached_property
    def _scale(self) -> float:
        return max(float(self.landing_xy.std(axis=0).mean()), 1e-6)

    @functools.cached_property
    def _map(self):
        from scipy.interpolate import RBFInterpolator

        points = (self.landing_xy - self._middle) / self._scale
        return RBFInterpolator(points, self._logs, kernel="linear", smoothing=_SMOOTHING)
