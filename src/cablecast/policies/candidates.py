"""Candidates: actions among which an aimer chooses, and what an ensemble says of them."""

import dataclasses

import numpy as np
from numpy.typing import NDArray


@dataclasses.dataclass(frozen=True, kw_only=True)
class Candidates:
    """Actions to the right and the hands that play them.

    Attributes:
        actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].
        hands: +1, or -1 for actions that are played to the left, shape [action].
        shifts: From the landing in the policy's simulator to the mean of an ensemble, 0 where there
            is none [cable lengths], shape [action, 2].
        leaving: Chance that the free end passes an edge of the table, as the ensemble says, 0 where
            there is none [-], shape [action].
        log_sizes: Logarithm of the size of a miss over the usual one, as the ensemble says, shape
            [action]; None where there is none.
    """

    actions: NDArray[np.float64]
    hands: NDArray[np.float64]
    shifts: NDArray[np.float64]
    leaving: NDArray[np.float64]
    log_sizes: NDArray[np.float64] | None

    @classmethod
    def unjudged(cls, actions: NDArray[np.float64], hands: NDArray[np.float64]) -> "Candidates":
        """Return candidates of which no ensemble says anything."""
        nothing = np.zeros((len(actions), 2))
        return cls(
            actions=actions, hands=hands, shifts=nothing, leaving=nothing[:, 0], log_sizes=None
        )

    def __len__(self) -> int:
        return len(self.actions)

    def __getitem__(self, rows) -> "Candidates":
        return Candidates(
            actions=self.actions[rows],
            hands=self.hands[rows],
            shifts=self.shifts[rows],
            leaving=self.leaving[rows],
            log_sizes=None if self.log_sizes is None else self.log_sizes[rows],
        )

    def at(self, actions: NDArray[np.float64]) -> "Candidates":
        """Return actions near these, of which the same is taken to be true."""
        return dataclasses.replace(self, actions=actions)

    def towards(self, others: "Candidates", part: float) -> "Candidates":
        """Return candidates at a part of the way from each of these to one of others."""
        logs = None
        if self.log_sizes is not None and others.log_sizes is not None:
            logs = self.log_sizes + part * (others.log_sizes - self.log_sizes)
        return Candidates(
            actions=self.actions + part * (others.actions - self.actions),
            hands=self.hands,
            shifts=self.shifts + part * (others.shifts - self.shifts),
            leaving=self.leaving + part * (others.leaving - self.leaving),
            log_sizes=logs,
        )

    @classmethod
    def join(cls, parts: "list[Candidates]") -> "Candidates":
        """Return several as one."""
        logs = [part.log_sizes for part in parts if part.log_sizes is not None]
        return cls(
            actions=np.concatenate([part.actions for part in parts]),
            hands=np.concatenate([part.hands for part in parts]),
            shifts=np.concatenate([part.shifts for part in parts]),
            leaving=np.concatenate([part.leaving for part in parts]),
            log_sizes=np.concatenate(logs) if logs else None,
        )
