"""Regions: where landings lie with some probability, after how far the casts before them missed.

Sizes of misses that are stated beforehand may all be too large, or too small, by one factor, which
differs from cable to cable. A belief about it, an inverse gamma distribution, is what makes
landings follow Student's t distribution, and every cast at a target tells of it.
"""

import dataclasses
import math
from collections.abc import Iterable

from cablecast.errors import check_number

TAIL_FREEDOM = 3.0
"""Degrees of freedom of Student's t distribution that landings follow about the expected one before
any cast at a target: most land nearer than those of a Gaussian of the same covariance would, and a
few far off [-]."""

MISS_WEIGHT = 0.5
"""Casts that one miss is worth in the belief about the factor: misses at one target are alike."""

MISS_MEMORY = 20
"""Number of the last misses that count: a cable changes."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RegionLaw:
    """Law of landings about the expected one: Student's t distribution in the plane.

    Attributes:
        scale: Covariance over that which was stated before anything was known of misses [-].
        freedom: Degrees of freedom, above 2 [-].
    """

    scale: float = 1.0
    freedom: float = TAIL_FREEDOM

    @classmethod
    def after(cls, squares: Iterable[float]) -> "RegionLaw":
        """Return the law after some misses.

        Args:
            squares: d' C^-1 d of each, with d the offset from the expected landing and C the
                covariance that was stated before anything was known of misses [-].
        """
        known = list(squares)[-MISS_MEMORY:]
        freedom = TAIL_FREEDOM + 2.0 * MISS_WEIGHT * len(known)
        scale = (TAIL_FREEDOM - 2.0 + MISS_WEIGHT * sum(known)) / (freedom - 2.0)
        return cls(scale=scale, freedom=freedom)

    def square(self, share: float) -> float:
        """Return the squared distance within which landings lie with some probability.

        Args:
            share: Probability [-].

        Returns:
            Bound of d' C^-1 d [-], with C the covariance of this law.
        """
        check_number("share", share, 0.01, 0.9999)
        return (self.freedom - 2.0) * math.expm1(-2.0 / self.freedom * math.log1p(-share))

    def share(self, square: float) -> float:
        """Return the probability of landings within a squared distance, as in `square`."""
        return -math.expm1(-0.5 * self.freedom * math.log1p(square / (self.freedom - 2.0)))
