"""Shakes: by how much more equal casts scatter than a usual cast.

Small differences from cast to cast move a landing as a change of the action does, and as a change
of the friction does: a cable that slides far, or that just tips over, is moved by either. How well
the two rank the scatter of casts is told in docs/aim-results.md.
"""

import numpy as np
from numpy.typing import NDArray

from cablecast.policies.candidates import USUAL_FRICTION

# Shares of a usual cast's variance that go with the action and with the friction.
_ACTION_SHARE, _FRICTION_SHARE = 0.3, 0.7
_SHAKE_MIN = 1e-6


def log_shakes(
    sensitivities: NDArray[np.float64], frictions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the logarithm of the scatter of casts over that of a usual one, shape [action].

    Args:
        sensitivities: Sensitivity to the action over the usual one [-], shape [action].
        frictions: Shift per relative change of the friction [cable lengths], shape [action].
    """
    action = _ACTION_SHARE * sensitivities**2
    friction = _FRICTION_SHARE * (frictions / USUAL_FRICTION) ** 2
    return np.log(np.maximum(np.sqrt(action + friction), _SHAKE_MIN))
