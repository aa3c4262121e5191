"""Features of cables: what of the ten parameters decides where a cast lands.

Stiffnesses, inertia, weight and friction are all proportional to the mass, so a cable that is twice
as heavy and twice as stiff lands in the same place. The two frictions act by their product alone.
Ten parameters leave eight features.
"""

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams

CABLE_FEATURES = (
    "twist stiffness per mass",
    "bend stiffness per mass",
    "endpoint mass per mass",
    "friction",
    "spinning friction",
    "rolling friction",
    "linear damping",
    "angular damping",
)
"""Names of the features, in the order of `cable_features`."""

# Values far below these have no effect on a cast. The logarithm of the value plus its floor is
# nearly linear below the floor, so that the network spends nothing on telling such cables apart.
_STIFFNESS_FLOOR = 1e-4
_ENDPOINT_FLOOR = 0.02
_FRICTION_FLOOR = 0.02
_LEVER_FLOOR = 0.02
_LINEAR_FLOOR = 0.03
_ANGULAR_FLOOR = 0.3


def cable_features(params: CableParams, cable: Cable) -> NDArray[np.float64]:
    """Return the features of cables.

    Args:
        params: Parameters, shared or one value per cable.
        cable: Cable that gives the radius, which levers of friction are measured by.

    Returns:
        Logarithms of the quantities of `CABLE_FEATURES`, shape [cable, feature].
    """
    mass = np.asarray(params.mass, dtype=float)
    quantities = (
        (np.asarray(params.twist_stiffness) / mass, _STIFFNESS_FLOOR),
        (np.asarray(params.bend_stiffness) / mass, _STIFFNESS_FLOOR),
        (np.asarray(params.endpoint_mass) / mass, _ENDPOINT_FLOOR),
        (np.asarray(params.friction), _FRICTION_FLOOR),
        (np.asarray(params.spinning_friction) / cable.radius, _LEVER_FLOOR),
        (np.asarray(params.rolling_friction) / cable.radius, _LEVER_FLOOR),
        (np.asarray(params.linear_damping), _LINEAR_FLOOR),
        (np.asarray(params.angular_damping), _ANGULAR_FLOOR),
    )
    columns = [np.log(np.atleast_1d(value) + floor) for value, floor in quantities]
    return np.stack(np.broadcast_arrays(*columns), axis=-1)
