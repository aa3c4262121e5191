"""Candidates: actions among which an aimer chooses, and what an ensemble says of them."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.models.array_rows import ArrayRows

USUAL_FRICTION = 1.7
"""Shift of a usual landing per relative change of the friction [cable lengths]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Candidates(ArrayRows):
    """Actions to the right and the hands that play them.

    Attributes:
        actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].
        hands: +1, or -1 for actions that are played to the left, shape [action].
        shifts: From the landing that the policy's network says to that in the best simulator, 0
            where there is no ensemble [cable lengths], shape [action, 2].
        leaving: Chance that the free end passes an edge of the table, as the ensemble says, 0 where
            there is none [-], shape [action].
        log_sizes: Logarithm of the size of a miss over the usual one, as the ensemble says, NaN
            where there is none, shape [action].
        frictions: Shift of the landing per relative change of the friction, a usual one where there
            is no ensemble [cable lengths], shape [action].
    """

    actions: NDArray[np.float64]
    hands: NDArray[np.float64]
    shifts: NDArray[np.float64]
    leaving: NDArray[np.float64]
    log_sizes: NDArray[np.float64]
    frictions: NDArray[np.float64]

    @classmethod
    def unjudged(cls, actions: NDArray[np.float64], hands: NDArray[np.float64]) -> "Candidates":
        """Return candidates of which no ensemble says anything."""
        return cls(
            actions=actions,
            hands=hands,
            shifts=np.zeros((len(actions), 2)),
            leaving=np.zeros(len(actions)),
            log_sizes=np.full(len(actions), np.nan),
            frictions=np.full(len(actions), USUAL_FRICTION),
        )

    def at(self, actions: NDArray[np.float64]) -> "Candidates":
        """Return actions near these, of which the same is taken to be true."""
        return dataclasses.replace(self, actions=actions)

    def towards(self, others: "Candidates", part: float) -> "Candidates":
        """Return candidates at a part of the way from each of these to one of others."""
        return Candidates(
            actions=self.actions + part * (others.actions - self.actions),
            hands=self.hands,
            shifts=self.shifts + part * (others.shifts - self.shifts),
            leaving=self.leaving + part * (others.leaving - self.leaving),
            log_sizes=self.log_sizes + part * (others.log_sizes - self.log_sizes),
            frictions=self.frictions + part * (others.frictions - self.frictions),
        )
