"""AimProposal and AimTrial: a cast at a target before and after it was made."""

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cast import TrialStatus
from cablecast.data.store import StoredCast
from cablecast.motion.action import Action
from cablecast.motion.trajectory import Trajectory
from cablecast.pipeline.aim_regions import RegionLaw

SAME_TARGET = 1e-6
"""Two targets nearer to each other than this are the same [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class AimProposal:
    """A cast that was planned and not made yet.

    Attributes:
        number: Number of the cast in the session, from 0.
        try_number: Number of the cast at this target, from 1.
        target_xy: Target [m], shape [2].
        action: Action.
        trajectory: Motion down to joint set points.
        expected_xy: Expected landing [m], shape [2].
        covariance: Covariance of the landing about it [m²], shape [2, 2].
        law: Law of the landing about it, with what earlier misses say of that covariance.
        scatter: Standard deviation along each axis of equal casts, a part of it [m].
        failure: Chance that the cast leaves the table or ends hidden [-].
        inside_coverage: Whether simulated casts land near the target.
        cable_length: Length of the cable [m].
        reason: Why this action, in words.
    """

    number: int
    try_number: int
    target_xy: NDArray[np.float64]
    action: Action
    trajectory: Trajectory
    expected_xy: NDArray[np.float64]
    covariance: NDArray[np.float64]
    law: RegionLaw
    scatter: float
    failure: float
    inside_coverage: bool
    cable_length: float
    reason: str

    def ellipse(self, share: float = 0.9) -> tuple[float, float, float]:
        """Return the ellipse that the landing lies in with some probability.

        Args:
            share: Probability [-].

        Returns:
            Both half axes [m], the longer one first, and the angle of that one from the x axis
            towards the y axis [rad].
        """
        values, vectors = np.linalg.eigh(self.covariance)
        minor, major = np.sqrt(values * self.law.square(share))
        return float(major), float(minor), float(math.atan2(vectors[1, 1], vectors[0, 1]))

    def to_note(self) -> dict[str, Any]:
        """Return what a stored cast keeps of its plan, as plain values."""
        return {
            "target_xy": self.target_xy.tolist(),
            "try_number": self.try_number,
            "expected_xy": self.expected_xy.tolist(),
            "covariance": self.covariance.tolist(),
            "law": dataclasses.asdict(self.law),
            "reason": self.reason,
        }

    @property
    def expected_miss_pct(self) -> float:
        """Root of the expected squared distance to the target [% of cable length]."""
        left = float(np.sum((self.expected_xy - self.target_xy) ** 2))
        return 100.0 * math.sqrt(left + float(np.trace(self.covariance))) / self.cable_length


@dataclasses.dataclass(frozen=True, kw_only=True)
class AimTrial:
    """A cast that was made.

    Attributes:
        number: Number of the cast in the session, from 0.
        purpose: "aim", or what else the cast was made for.
        try_number: Number of the cast at its target, from 1; 0 for a cast without a target.
        target_xy: Target [m], shape [2]; NaN for a cast without a target.
        action: Action, shape [4].
        expected_xy: Landing that was expected [m], shape [2]; NaN where none was.
        covariance: Covariance of that landing [m²], shape [2, 2].
        status: How the cast ended.
        final_xy: Landing [m], shape [2]; NaN for a cast without one.
        miss_pct: Distance from the target [% of cable length]; NaN for a cast without a landing.
        hit: Whether it landed near enough to the target.
        law: Law of that landing about the expected one.
        change: What the cast taught, in words; empty for one that was read from a folder.
    """

    number: int
    purpose: str
    try_number: int
    target_xy: NDArray[np.float64]
    action: NDArray[np.float64]
    expected_xy: NDArray[np.float64]
    covariance: NDArray[np.float64]
    status: TrialStatus
    final_xy: NDArray[np.float64]
    miss_pct: float
    hit: bool
    law: RegionLaw = dataclasses.field(default_factory=RegionLaw)
    change: str = ""

    @classmethod
    def of_cast(
        cls, number: int, cast: StoredCast, *, cable_length: float, within_pct: float
    ) -> "AimTrial":
        """Return a stored cast as a trial.

        Args:
            number: Number of the cast in its session.
            cast: Stored cast.
            cable_length: Length of the cable [m].
            within_pct: Distance from a target at which a cast has hit [% of cable length].
        """
        note = cast.note
        target = target_of(cast)
        final_xy = cast.endpoint_xy
        miss_pct = 100.0 * float(np.linalg.norm(final_xy - target)) / cable_length
        return cls(
            number=number,
            purpose=cast.purpose,
            try_number=int(note.get("try_number", 0)),
            target_xy=target,
            action=cast.action,
            expected_xy=np.array(note.get("expected_xy", (np.nan, np.nan)), dtype=float),
            covariance=np.array(note.get("covariance", np.full((2, 2), np.nan)), dtype=float),
            law=RegionLaw(**note.get("law", {})),
            status=TrialStatus.from_code(cast.status),
            final_xy=final_xy,
            miss_pct=miss_pct,
            hit=bool(miss_pct <= within_pct),
        )

    @property
    def square(self) -> float:
        """Return d' C^-1 d, with d the offset from the expected landing and C its covariance [-].

        NaN for a cast without a landing or without an expectation.
        """
        offset = self.final_xy - self.expected_xy
        if not np.all(np.isfinite(offset)):
            return math.nan
        return float(offset @ np.linalg.solve(self.covariance, offset))

    @property
    def surprise(self) -> float:
        """Squared distance from expected to actual landing over that expected; 1 on average."""
        return 0.5 * self.square


def law_after(trials: Iterable[AimTrial]) -> RegionLaw:
    """Return the law of the next landing after some casts; those without an expectation tell none.

    Args:
        trials: Casts in the order in which they were made.
    """
    squares = (trial.law.scale * trial.square for trial in trials)
    return RegionLaw.after(square for square in squares if math.isfinite(square))


def target_of(cast: StoredCast) -> NDArray[np.float64]:
    """Return the target that a stored cast was aimed at in its own session [m], shape [2].

    Args:
        cast: Stored cast; one that came from a dataset has no target, NaN, whatever it was made for
            there.
    """
    return np.array(cast.note.get("target_xy", (np.nan, np.nan)), dtype=float)
