"""MovedLandings: landings of candidates that are moved, as `refine_actions` asks for them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cablecast.models.landing import LandingModel, central_shifts
from cablecast.policies.candidates import Candidates

_Array = NDArray[np.float64]


class MovedLandings:
    """Landings of actions near candidates, of which an ensemble says the same.

    Args:
        some: Candidates.
        sensitivity: Sensitivity of each over the usual one, which hardly changes nearby, [action].
        landings: Given candidates and sensitivities, returns expected landings [m], [action, 2].
        model: Gives the set-up and the distance that the free end keeps from the table's edges.
    """

    def __init__(
        self,
        some: Candidates,
        sensitivity: _Array,
        landings: Callable[[Candidates, _Array], _Array],
        model: LandingModel,
    ):
        self.some = some
        self.sensitivity = sensitivity
        self.landings = landings
        self.model = model
        self.setup = model.setup

    def predict(self, actions: _Array) -> _Array:
        """Return the expected landings [m], shape [action, 2].

        Args:
            actions: Actions to the right, the candidates' in turn, any number of times.
        """
        rows = np.tile(np.arange(len(self.some)), len(actions) // len(self.some))
        return self.landings(self.some[rows].at(actions), self.sensitivity[rows])

    def landing_shifts(self, actions: _Array, changes: _Array) -> _Array:
        """Return the shift of the landing for each change of an action, [action, 2, change]."""
        return central_shifts(self.predict, actions, changes)

    def predict_margin(self, actions: _Array) -> _Array:
        """Return the distance that the free end keeps from the table's edges [m], [action]."""
        return self.model.predict_margin(actions)
