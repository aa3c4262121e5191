"""A cast: what was proposed, what was made, and the track of the cable's endpoint.

`EndpointTrack` is what every rig and simulator returns. `Proposal` is a cast that was planned at a
target and not made yet, with the landing that is expected. `Cast` is one that was made; everything
else that is said of it follows from its motion, its track and its proposal.
"""

import dataclasses
import enum
import functools
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.conventions import Ellipse
from cablecast.errors import InputError, check_number
from cablecast.motion.action import Action
from cablecast.motion.trajectory import JointPath, Trajectory, plan_trajectory
from cablecast.setup import Setup
from cablecast.workspace import Workspace


class TrialStatus(enum.Enum):
    """End of a trial; the value is a sentence with advice for the user.

    Off the table is a cast whose endpoint came to rest beyond the edge, or left the table and was
    not seen again. One that passed over the edge and came back has landed.
    """

    OK = "The endpoint came to rest on the table and was seen."
    OFF_TABLE = "The endpoint ended beyond the table's edge: choose a slower or narrower motion."
    OCCLUDED = (
        "The endpoint was hidden from the camera at the end: move the arm away and look again."
    )
    NON_FINITE = "The simulated cable became non-finite: check its parameters and the step."
    ABORTED = "The trial was stopped before its end: clear the cause and run it again."

    @property
    def code(self) -> str:
        """Short name for tables and columns, e.g. `off_table`."""
        return self.name.lower()

    @classmethod
    def from_code(cls, code: str) -> "TrialStatus":
        """Return the status whose `code` this is.

        Raises:
            InputError: No status has this code.
        """
        try:
            return cls[code.upper()]
        except KeyError:
            codes = ", ".join(status.code for status in cls)
            raise InputError(f"unknown trial status {code!r}: one of {codes}") from None


@dataclasses.dataclass(frozen=True, kw_only=True)
class ControllerLog:
    """Reports of an arm's controller during one trial, beside the measured joints.

    There is one report for each time of the track's `joint_path`.

    Attributes:
        times: Times of the reports by the controller's clock [s], shape [report].
        target_q: Set points that the controller followed [rad], shape [report, joint].
        speed_scaling: Speed scaling, the slider's included [-], shape [report].
        safety_bits: Safety status bits, shape [report].
    """

    times: NDArray[np.float64]
    target_q: NDArray[np.float64]
    speed_scaling: NDArray[np.float64]
    safety_bits: NDArray[np.float64]

    def __post_init__(self):
        count = len(self.times)
        shapes = {
            "target_q": (count, *self.target_q.shape[1:2]),
            "speed_scaling": (count,),
            "safety_bits": (count,),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise InputError(
                    f"{name} of a controller's log has shape {getattr(self, name).shape}: "
                    f"{count} reports require {shape}"
                )


@dataclasses.dataclass(frozen=True, kw_only=True)
class EndpointTrack:
    """Path of the cable's endpoint during one trial.

    Attributes:
        times: Times since the start of the motion [s], shape [step].
        endpoint_xy: Endpoint on the table [m], shape [step, 2]; NaN where it was not seen.
        status: End of the trial.
        nodes: Cable shape at the same times for pictures, base frame [m], shape
            [step, node, 3]; None if the executor cannot see it.
        joint_path: Measured joints, with the times at which the arm reported them; None if the
            executor has no joints or does not report them. The commanded joints are those of the
            trajectory.
        controller_log: Reports of the arm's controller at the times of `joint_path`; None where
            there is no controller.
        note: Why a trial was aborted, or what was corrected in it, in one line; empty where there
            is nothing to say.
    """

    times: NDArray[np.float64]
    endpoint_xy: NDArray[np.float64]
    status: TrialStatus
    nodes: NDArray[np.float64] | None = None
    joint_path: JointPath | None = None
    controller_log: ControllerLog | None = None
    note: str = ""

    def __post_init__(self):
        for name in ("times", "endpoint_xy", "nodes"):
            object.__setattr__(self, name, _numbers(name, getattr(self, name)))
        if self.endpoint_xy.shape != (*self.times.shape, 2) or self.times.ndim != 1:
            raise InputError(
                f"endpoint_xy has shape {self.endpoint_xy.shape}, times {self.times.shape}: "
                "they must be [step, 2] and [step]"
            )
        if self.times.size == 0:
            raise InputError("an endpoint track needs at least one sample")
        nodes = self.nodes
        if nodes is not None and (
            nodes.ndim != 3 or len(nodes) != len(self.times) or nodes.shape[2] != 3
        ):
            raise InputError(
                f"nodes have shape {nodes.shape}: {len(self.times)} times require [step, node, 3]"
            )

    @property
    def final_xy(self) -> NDArray[np.float64]:
        """Resting point of the endpoint [m], shape [2]; NaN unless the status is OK."""
        return self.endpoint_xy[-1] if self.status is TrialStatus.OK else np.full(2, np.nan)


def _numbers(name: str, values: Any) -> NDArray[np.float64] | None:
    """Return an array of real numbers, NaN where masked; None if there are no nodes."""
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(float), np.nan)
    if isinstance(values, np.ndarray) and np.issubdtype(values.dtype, np.floating):
        return values
    if values is None and name == "nodes":
        return None
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} of an endpoint track must be an array of numbers") from None


TAIL_FREEDOM = 3.0
"""Degrees of freedom of Student's t distribution that landings follow about the expected one before
any cast at a target: most land nearer than those of a Gaussian of the same covariance would, and a
few far off [-]."""

MISS_WEIGHT = 0.5
"""Weight of each miss in the belief about the scale: misses at one target are correlated."""

MISS_MEMORY = 20
"""Number of the last misses that count: a cable changes."""

SAME_TARGET = 1e-6
"""Two targets nearer to each other than this are the same [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class RegionLaw:
    """Law of landings about the expected one: Student's t distribution in the plane.

    Stated covariances may all be too large, or too small, by one factor, which differs from cable
    to cable. An inverse gamma belief about it makes landings follow Student's t distribution, and
    every miss updates it.

    Attributes:
        scale: Covariance over that which was stated before any miss [-].
        freedom: Degrees of freedom, above 2 [-].
    """

    scale: float = 1.0
    freedom: float = TAIL_FREEDOM

    @classmethod
    def after(cls, squares: Iterable[float]) -> "RegionLaw":
        """Return the law after misses of some d' C^-1 d [-].

        d is the offset from the expected landing, and C the covariance that was stated before any.
        """
        last = list(squares)[-MISS_MEMORY:]
        freedom = TAIL_FREEDOM + 2.0 * MISS_WEIGHT * len(last)
        scale = (TAIL_FREEDOM - 2.0 + MISS_WEIGHT * sum(last)) / (freedom - 2.0)
        return cls(scale=scale, freedom=freedom)

    def square(self, share: float) -> float:
        """Return the bound of d' C^-1 d [-] that landings keep with some probability [-].

        C is the covariance of this law.
        """
        check_number("share", share, 0.01, 0.9999)
        return (self.freedom - 2.0) * math.expm1(-2.0 / self.freedom * math.log1p(-share))


_NOTED_ARRAYS = ("target_xy", "expected_xy", "covariance")
_NOTED_VALUES = ("scatter", "failure", "inside_coverage")
# The law is told from a share of 1 % on.
_RINGS, _SPOKES = 48, 32


def ring_points(
    radius: NDArray[np.float64], turn: NDArray[np.floating], spokes: int
) -> NDArray[np.float64]:
    """Return points on rings about the origin, shape [ring * spoke, 2].

    `radius` is that of each ring, `turn` its turn in spokes, shape [ring].
    """
    angle: NDArray[np.float64] = (np.arange(spokes) + turn[:, None]) * 2.0 * np.pi / spokes
    ring = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return ring.reshape(-1, 2)


_STEPS_UNSEEN = 20  # Samples after the last seen one within which the free end leaves the table.

HIT_CHANCE_MIN = 0.05
"""Chance to hit below which a cast is hardly worth making [-]."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """A cast that was planned at a target, and what to expect of it.

    Attributes:
        setup: Cable, workspace, arm and motion settings.
        number: Number of the cast in its session, from 0.
        try_number: Number of the cast at this target, from 1.
        target_xy: Target [m], shape [2].
        within_pct: Distance from the target at which the cast has hit [% of cable length].
        action: Action.
        expected_xy: Expected landing [m], shape [2].
        covariance: Covariance of the landing about it [m²], shape [2, 2].
        law: Law of the landing about it, with what earlier misses say of that covariance.
        scatter: Standard deviation along each axis of equal casts, a part of it [m].
        failure: Chance that the cast leaves the table or ends hidden [-].
        inside_coverage: Whether simulated casts land near the target.
    """

    setup: Setup
    number: int
    try_number: int
    target_xy: NDArray[np.float64]
    within_pct: float
    action: Action
    expected_xy: NDArray[np.float64]
    covariance: NDArray[np.float64]
    law: RegionLaw
    scatter: float
    failure: float
    inside_coverage: bool

    @functools.cached_property
    def trajectory(self) -> Trajectory:
        """Motion down to joint set points.

        Raises:
            JointLimitError: The arm cannot follow.
        """
        return plan_trajectory(self.action, self.setup)

    @functools.cached_property
    def hit_chance(self) -> float:
        """Chance that the cast lands within `within_pct` of the target [-]."""
        # Points of equal probability: rings that halve equal shares, turned against each other.
        share = (np.arange(_RINGS) + 0.5) / _RINGS
        radius = np.sqrt([self.law.square(float(value)) for value in share])
        unit = ring_points(radius, share, _SPOKES)
        points = self.expected_xy + unit @ np.linalg.cholesky(self.covariance).T
        within = self.within_pct / 100.0 * self.setup.cable.length
        near = np.linalg.norm(points - self.target_xy, axis=-1) <= within
        return (1.0 - self.failure) * float(np.mean(near))

    @property
    def reason(self) -> str:
        """Why a hit is not to be expected, in words; empty where it is."""
        likely = self.inside_coverage and self.hit_chance >= HIT_CHANCE_MIN
        return "" if likely else self.outlook

    @property
    def outlook(self) -> str:
        """What is to be expected of the cast, in words."""
        miss = 100.0 * float(np.linalg.norm(self.expected_xy - self.target_xy))
        wide, narrow = 200.0 * self.ellipse().semi_axes
        outside = "no simulated cast of this cable lands near this target, and "
        # The one that was found by search does, where the target is expected to be hit.
        beside = miss > self.within_pct * self.setup.cable.length
        return outside * (beside and not self.inside_coverage) + (
            f"the next cast would hit it with a chance of {100 * self.hit_chance:.0f} %: it is "
            f"expected {miss:.1f} cm beside it, somewhere in {wide:.0f} by {narrow:.0f} cm"
        )

    def ellipse(self, share: float = 0.9) -> Ellipse:
        """Return the ellipse that the landing lies in with some probability [-]."""
        return Ellipse.of_covariance(self.expected_xy, self.covariance, self.law.square(share))

    def to_note(self) -> dict[str, Any]:
        """Return what a stored cast keeps of its proposal, beside number and action."""
        return {
            "try_number": self.try_number,
            **{name: getattr(self, name).tolist() for name in _NOTED_ARRAYS},
            "law": dataclasses.asdict(self.law),
            **{name: getattr(self, name) for name in _NOTED_VALUES},
        }

    @classmethod
    def from_note(cls, note: Mapping[str, Any], **values: Any) -> "Proposal":
        """Return the proposal of a stored cast, with what `to_note` leaves out."""
        return cls(
            try_number=int(note["try_number"]),
            **{name: np.array(note[name], dtype=float) for name in _NOTED_ARRAYS},
            law=RegionLaw(**note["law"]),
            **{name: note[name] for name in _NOTED_VALUES},
            **values,
        )


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Cast:
    """A cast that was made.

    Attributes:
        action: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [4]; NaN for a motion that no
            action describes.
        duration: Duration of the gripper's motion [s].
        joint_path: Commanded joints; None for a rig without joints.
        track: What the rig saw of it.
        purpose: What it was made for, e.g. "tune" or "aim".
        proposal: What was proposed and expected; None for a cast that was not aimed in its session.
        origin: Fingerprint of the dataset and the row that it came from; empty where it was made in
            its session.
        grip: Times [s], shape [sample], and poses x, y, z [m], yaw and pitch [rad] of the tracked
            grip, shape [sample, 5]; None where it was not tracked.
    """

    action: NDArray[np.float64]
    duration: float
    joint_path: JointPath | None
    track: EndpointTrack
    purpose: str
    proposal: Proposal | None = None
    origin: str = ""
    grip: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    @classmethod
    def of_motion(
        cls,
        motion: Trajectory,
        track: EndpointTrack,
        purpose: str,
        proposal: Proposal | None = None,
    ) -> "Cast":
        """Return the cast of a motion that was executed."""
        return cls(
            action=np.full(4, np.nan) if motion.action is None else motion.action.to_array(),
            duration=motion.duration,
            joint_path=motion.joint_path,
            track=track,
            purpose=purpose,
            proposal=proposal,
        )

    @property
    def status(self) -> TrialStatus:
        """End of the cast."""
        return self.track.status

    @property
    def final_xy(self) -> NDArray[np.float64]:
        """Landing [m], shape [2]; NaN for a cast without one."""
        return self.track.final_xy

    @property
    def landed(self) -> bool:
        """Whether the cast has a landing."""
        return bool(np.all(np.isfinite(self.final_xy)))

    def end_xy(self, workspace: Workspace) -> NDArray[np.float64]:
        """Return the landing, or where the free end left the table [m], shape [2]; NaN for neither.

        It is taken to have gone on from where it was seen last as it moved there.
        """
        seen = self.track.endpoint_xy[np.all(np.isfinite(self.track.endpoint_xy), axis=1)]
        if self.status is not TrialStatus.OFF_TABLE or len(seen) < 2:
            return self.final_xy
        way = seen[-1] + np.arange(_STEPS_UNSEEN)[:, None] * (seen[-1] - seen[-2])
        off = ~workspace.on_table(way)
        return way[np.argmax(off)] if off.any() else self.final_xy

    @property
    def target_xy(self) -> NDArray[np.float64]:
        """Target [m], shape [2]; NaN for a cast that was not aimed."""
        return np.full(2, np.nan) if self.proposal is None else self.proposal.target_xy

    @property
    def expected_xy(self) -> NDArray[np.float64]:
        """Landing that was expected [m], shape [2]; NaN for a cast that was not aimed."""
        return np.full(2, np.nan) if self.proposal is None else self.proposal.expected_xy

    @property
    def number(self) -> int:
        """Number of an aimed cast in its session, from 0; -1 for a cast that was not aimed."""
        return -1 if self.proposal is None else self.proposal.number

    @property
    def try_number(self) -> int:
        """Number of the cast at its target, from 1; 0 for a cast that was not aimed."""
        return 0 if self.proposal is None else self.proposal.try_number

    def is_at(self, target_xy: NDArray[np.float64]) -> bool:
        """Return whether the cast was aimed at a target [m], shape [2]."""
        return bool(np.linalg.norm(self.target_xy - target_xy) < SAME_TARGET)

    @property
    def miss_pct(self) -> float:
        """Distance from target to landing [% of cable length]; NaN without either."""
        if self.proposal is None:
            return math.nan
        miss = float(np.linalg.norm(self.final_xy - self.target_xy))
        return 100.0 * miss / self.proposal.setup.cable.length

    @property
    def hit(self) -> bool:
        """Whether it landed near enough to its target."""
        return self.proposal is not None and self.miss_pct <= self.proposal.within_pct

    @property
    def square(self) -> float:
        """Return d' C^-1 d, with d the offset from the expected landing and C its covariance [-].

        A cast that left the table is taken to have landed there; NaN for any other without a
        landing, and without an expectation.
        """
        if self.proposal is None:
            return math.nan
        offset = self.end_xy(self.proposal.setup.workspace) - self.expected_xy
        return float(offset @ np.linalg.solve(self.proposal.covariance, offset))
