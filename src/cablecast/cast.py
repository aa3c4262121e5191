"""A cast: what was proposed, what was made, and the track of the cable's endpoint.

`EndpointTrack` is what every rig and simulator returns. `Proposal` is a cast that was planned at a
target and not made yet, with the landing that is expected. `Cast` is one that was made; everything
else that is said of it follows from its motion, its track and its proposal.
"""

import dataclasses
import enum
import functools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.motion.action import ACTION_SIZE
from cablecast.motion.casting import Action
from cablecast.motion.trajectory import JointPath, Motion, Trajectory, plan_trajectory
from cablecast.setup import Setup
from cablecast.task import LANDING, Expectation, Goal, Task
from cablecast.workspace import Workspace


class TrialStatus(enum.Enum):
    """End of a trial; the value is a sentence with advice for the user.

    Off the table is a cast whose endpoint came to rest beyond the edge, or left the table and was
    not seen again. One that passed over the edge and came back has landed.
    """

    OK = "The endpoint came to rest on the table and was seen."
    OFF_TABLE = "The endpoint ended beyond the table's edge: choose a slower or narrower motion."
    OCCLUDED = "The endpoint was hidden from the camera at the end: clear its view and look again."
    NON_FINITE = "The simulated cable became non-finite: check its parameters and the step."
    ABORTED = "The trial was stopped before its end: clear the cause and run it again."

    @property
    def code(self) -> str:
        """Short name for tables and columns, e.g. `off_table`."""
        return self.name.lower()

    @property
    def words(self) -> str:
        """Short name for sentences, e.g. `off table`."""
        return self.code.replace("_", " ")

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
    """Reports of an arm's controller during one trial, besides the measured joints.

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
        endpoint_z: Height of an endpoint that was swung in the air [m], shape [step]; None on the
            table.
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
    endpoint_z: NDArray[np.float64] | None = None

    def __post_init__(self):
        for name in ("times", "endpoint_xy", "nodes", "endpoint_z"):
            object.__setattr__(self, name, _numbers(name, getattr(self, name)))
        if self.endpoint_xy.shape != (*self.times.shape, 2) or self.times.ndim != 1:
            raise InputError(
                f"endpoint_xy has shape {self.endpoint_xy.shape}, times {self.times.shape}: "
                "they must be [step, 2] and [step]"
            )
        if self.times.size == 0:
            raise InputError("an endpoint track needs at least one sample")
        if self.endpoint_z is not None and self.endpoint_z.shape != self.times.shape:
            raise InputError(
                f"endpoint_z has shape {self.endpoint_z.shape}, times {self.times.shape}: they "
                "must be alike"
            )
        nodes = self.nodes
        if nodes is not None and (
            nodes.ndim != 3 or len(nodes) != len(self.times) or nodes.shape[2] != 3
        ):
            raise InputError(
                f"nodes have shape {nodes.shape}: {len(self.times)} times require [step, node, 3]"
            )

    @classmethod
    def unseen(cls, status: TrialStatus, note: str = "") -> "EndpointTrack":
        """Return the track of a trial in which nothing was seen."""
        nowhere = np.full((1, 2), np.nan)
        return cls(times=np.zeros(1), endpoint_xy=nowhere, status=status, note=note)

    @property
    def path(self) -> NDArray[np.float64]:
        """Path of the endpoint [m], shape [step, 2], or [step, 3] in the air."""
        if self.endpoint_z is None:
            return self.endpoint_xy
        return np.column_stack([self.endpoint_xy, self.endpoint_z])

    @property
    def final_xy(self) -> NDArray[np.float64]:
        """Resting point of the endpoint [m], shape [2]; NaN unless the status is OK."""
        landed = self.status is TrialStatus.OK
        return LANDING.outcome(self.endpoint_xy) if landed else np.full(2, np.nan)


def _numbers(name: str, values: Any) -> NDArray[np.float64] | None:
    """Return an array of real numbers, NaN where masked; None if there are no nodes."""
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(float), np.nan)
    if isinstance(values, np.ndarray) and np.issubdtype(values.dtype, np.floating):
        return values
    if values is None and name in ("nodes", "endpoint_z"):
        return None
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{name} of an endpoint track must be an array of numbers") from None


_STEPS_UNSEEN = 20  # Samples after the last seen one within which the free end leaves the table.


def _path_to_edge(path: NDArray[np.float64], table: Workspace) -> NDArray[np.float64] | None:
    """Return what was seen of a path [m], and on to beyond an edge, [step, 2]; None if it is far.

    The free end goes on as it moved where it was seen last.
    """
    seen = path[np.all(np.isfinite(path), axis=1)]
    if len(seen) < 2:
        return None
    way = seen[-1] + np.arange(_STEPS_UNSEEN)[:, None] * (seen[-1] - seen[-2])
    off = ~table.on_table(way)
    return np.concatenate([seen, way[: np.argmax(off) + 1]]) if off.any() else None


HIT_CHANCE_MIN = 0.05
"""Chance to hit below which a cast is not worth making [-]."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """A cast that was planned for a goal, and what to expect of it.

    Attributes:
        goal: Goal of the cast, with the set-up.
        number: Number of the cast in its session, from 0.
        try_number: Number of the cast at this goal, from 1.
        action: What its motion is planned from.
        expected: Distribution of the outcome.
        inside_coverage: Whether simulated casts end near the goal.
    """

    goal: Goal
    number: int
    try_number: int
    action: Motion
    expected: Expectation
    inside_coverage: bool

    @property
    def setup(self) -> Setup:
        """Cable, workspace, arm and motion settings."""
        return self.goal.setup

    @functools.cached_property
    def trajectory(self) -> Trajectory:
        """Motion down to joint set points.

        Raises:
            JointLimitError: The arm cannot follow.
        """
        return plan_trajectory(self.action, self.setup)

    @functools.cached_property
    def hit_chance(self) -> float:
        """Probability that the cast hits its goal [-]."""
        return self.expected.hit_chance(self.goal)

    @property
    def expected_miss(self) -> float:
        """Distance of the expected outcome from the goal [cable lengths]."""
        return float(self.goal.miss(self.expected.mean))


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Cast:
    """A cast that was made.

    Attributes:
        action: What its motion was planned from; None for a motion of no family.
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

    action: Motion | None
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
            action=motion.action,
            duration=motion.duration,
            joint_path=motion.joint_path,
            track=track,
            purpose=purpose,
            proposal=proposal,
        )

    @property
    def sweep(self) -> NDArray[np.float64]:
        """(theta1, theta2, r2, psi, pace) [rad, rad, m, rad, -] of a sweep, shape [5]; else NaN."""
        if isinstance(self.action, Action):
            return self.action.to_array()
        return np.full(ACTION_SIZE, np.nan)

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

    def read(self, task: Task, table: Workspace | None = None) -> NDArray[np.float64]:
        """Return the outcome of the cast in a task, shape [k]; NaN for a cast without one.

        It is that at the goal of the cast, if it was aimed in this task.

        With a table, a cast that left it has the outcome of its path to the edge: the free end is
        taken to have gone on from where it was seen last as it moved there.
        """
        path: NDArray[np.float64] | None = None
        if self.status is TrialStatus.OK:
            path = self.track.path
        elif self.status is TrialStatus.OFF_TABLE and table is not None:
            path = _path_to_edge(self.track.endpoint_xy, table)
        if path is None:
            return np.full(len(task.coordinates), np.nan)
        if self.goal is not None and self.goal.task is task:
            return task.outcome_at(path, self.goal.value)
        return task.outcome(path)

    @property
    def goal(self) -> Goal | None:
        """Goal of the cast; None for a cast that was not aimed."""
        return None if self.proposal is None else self.proposal.goal

    @property
    def outcome(self) -> NDArray[np.float64]:
        """Outcome of the cast in its task, shape [k]; NaN for a cast without one.

        A cast that was not aimed has that of a landing.
        """
        return self.read(LANDING if self.goal is None else self.goal.task)

    @property
    def target_xy(self) -> NDArray[np.float64]:
        """Value of the goal, shape [k]; NaN for a cast that was not aimed."""
        return np.full(2, np.nan) if self.goal is None else self.goal.value

    @property
    def expected_xy(self) -> NDArray[np.float64]:
        """Outcome that was expected, shape [k]; NaN for a cast that was not aimed."""
        return np.full(2, np.nan) if self.proposal is None else self.proposal.expected.mean

    @property
    def number(self) -> int:
        """Number of an aimed cast in its session, from 0; -1 for a cast that was not aimed."""
        return -1 if self.proposal is None else self.proposal.number

    @property
    def try_number(self) -> int:
        """Number of the cast at its goal, from 1; 0 for a cast that was not aimed."""
        return 0 if self.proposal is None else self.proposal.try_number

    def is_at(self, value: NDArray[np.float64]) -> bool:
        """Return whether the cast was aimed at a goal of some value, shape [k]."""
        return self.goal is not None and self.goal.is_same(value)

    def with_tolerance(self, within_pct: float) -> "Cast":
        """Return the cast with a tolerance of its goal [% of cable length]; itself if it has it."""
        if self.proposal is None or self.proposal.goal.within_pct == within_pct:
            return self
        goal = dataclasses.replace(self.proposal.goal, within_pct=within_pct)
        return dataclasses.replace(self, proposal=dataclasses.replace(self.proposal, goal=goal))

    @property
    def miss_pct(self) -> float:
        """Distance from goal to outcome [% of cable length]; NaN without either."""
        return math.nan if self.goal is None else 100.0 * float(self.goal.miss(self.outcome))

    @property
    def hit(self) -> bool:
        """Whether the outcome is within the tolerance of the goal."""
        return self.goal is not None and bool(self.goal.hit(self.outcome))

    @property
    def square(self) -> float:
        """Mahalanobis square of the outcome under the law that was stated [-].

        A cast that left the table is taken to have landed there; NaN for any other without an
        outcome, and without an expectation.
        """
        if self.proposal is None:
            return math.nan
        goal = self.proposal.goal
        return self.proposal.expected.square(self.read(goal.task, goal.setup.workspace))
