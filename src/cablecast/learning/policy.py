"""Policies turn targets into motions: forward search over a model, and polar casting.

The predicted landings of the candidates of a forward search do not depend on the target, so they
are computed once. A k-d tree then answers a thousand targets in milliseconds.
"""

import contextlib
import dataclasses
import functools
import io
import json
import pathlib
import typing
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.conventions import mirror_xy, side_of, xy_to_polar
from cablecast.errors import (
    CablecastError,
    CheckpointError,
    InputError,
    JointLimitError,
    UnreadableFileError,
    check_keys,
    check_number,
)
from cablecast.files import read_bytes, write_bytes
from cablecast.learning.checkpoint import read_checkpoint
from cablecast.learning.gaussian_process import GaussianProcessModel
from cablecast.learning.landing import LandingModel, deviations
from cablecast.learning.network import ForwardModel
from cablecast.motion.action import (
    ACTION_SIZE,
    PACE_BOUNDS,
    PSI_MAX,
    THETA_MAX,
    THETA_MIN,
    ActionRanges,
    mirror_actions,
    mirror_to_right,
)
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import check_actions, feasible_actions
from cablecast.motion.polar import PolarCast, PolarReach, polar_config
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.runs.progress import ProgressCallback, ignore
from cablecast.setup import Setup
from cablecast.task import LANDING, Landing, Task


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """One motion per target, with its predicted landing.

    Attributes:
        setup: Set-up that the motions are planned for.
        target_xy: Targets [m], shape [target, 2].
        actions: (theta1, theta2, r2, psi, pace) [rad, rad, m, rad, -], shape [target, 5]; NaN for
            motions without an action.
        predicted_xy: Predicted landings [m], shape [target, 2].
        inside_coverage: Whether the target lies inside the policy's coverage, shape [target].
        sensitivity: Shift of the predicted landing for action errors of 1 degree and 1 cm [m],
            shape [target]; NaN if unknown.
        motions: Planned motions, one per target. If None, `trajectories` plans them from the
            actions.
    """

    setup: Setup
    target_xy: NDArray[np.float64]
    actions: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.array(np.nan))
    predicted_xy: NDArray[np.float64]
    inside_coverage: NDArray[np.bool_]
    sensitivity: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.array(np.nan))
    motions: tuple[Trajectory, ...] | None = None

    def __post_init__(self):
        count = len(np.atleast_2d(self.target_xy))
        for name, shape, kind in (
            ("target_xy", (count, 2), float),
            ("actions", (count, ACTION_SIZE), float),
            ("predicted_xy", (count, 2), float),
            ("inside_coverage", (count,), bool),
            ("sensitivity", (count,), float),
        ):
            values = np.asarray(getattr(self, name), dtype=kind)
            # A single NaN stands for unknown everywhere.
            values = np.full(shape, values) if values.ndim == 0 else values
            if values.shape != shape:
                raise InputError(f"plan {name} has shape {values.shape}: it must be {shape}")
            object.__setattr__(self, name, values)
        if self.motions is None:
            if np.any(bad := ~np.all(np.isfinite(self.actions), axis=1)):
                row = int(np.argmax(bad))
                raise InputError(f"the plan has neither an action nor a motion for target {row}")
        elif len(self.motions) != count:
            raise InputError(f"the plan has {len(self.motions)} motions for {count} targets")

    def __len__(self) -> int:
        return len(self.target_xy)

    def __str__(self) -> str:
        rows = []
        for target, action, landing in zip(
            self.target_xy, self.actions, self.predicted_xy, strict=True
        ):
            theta1, theta2, r2, psi, pace = action
            angles = np.degrees([theta1, theta2, psi])
            motion = "a motion without an action"
            if np.all(np.isfinite(action)):
                motion = "theta1 = {:.1f} deg, theta2 = {:.1f} deg, ".format(*angles)
                motion += f"r2 = {r2:.3f} m, psi = {angles[2]:.1f} deg, pace = {pace:.2f}"
            rows.append(f"target {_place(target)}: {motion}; lands at {_place(landing)}")
        return "\n".join(rows)

    @property
    def miss_pct(self) -> NDArray[np.float64]:
        """Distances from the predicted landings to the targets [% of cable length]."""
        return 100.0 * LANDING.miss(self.predicted_xy, self.target_xy, self.setup)

    @functools.cached_property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """Motions with joint set points, one per target.

        Raises:
            JointLimitError: A motion violates limits of the arm.
        """
        if self.motions is not None:
            return tuple(self.motions)
        return tuple(
            plan_trajectory(Action.from_array(action), self.setup) for action in self.actions
        )


def _place(xy: NDArray[np.float64]) -> str:
    r, theta = xy_to_polar(xy)
    return f"r = {r:.3f} m, theta = {np.degrees(theta):z.1f} deg"


@runtime_checkable
class Policy(Protocol):
    """Interface of policies, which turn targets into motions; implement it to evaluate your own."""

    @property
    def setup(self) -> Setup:
        """Set-up that the policy plans for."""
        ...

    @property
    def info(self) -> dict[str, Any]:
        """Description of the policy as plain values, for the settings of a run."""
        ...

    def plan(
        self,
        target_xy: ArrayLike | None = None,
        *,
        r: ArrayLike | None = None,
        theta_deg: ArrayLike | None = None,
    ) -> Plan:
        """Plan a motion for each target; see `Landing.values` for the arguments."""
        ...


FORMAT = "cablecast.forward_search"
FORMAT_VERSION = 4
POLICY_NAME = "policy.npz"

ARRAY_SHAPES: dict[str, tuple[int, ...]] = {
    "actions": (ACTION_SIZE,),
    "predicted_xy": (2,),
    "sensitivity": (),
}
"""Arrays of the file, and the shape of each after the candidate axis."""


def _read_policy(
    folder: str | pathlib.Path,
) -> tuple[dict[str, NDArray[np.float64]], Setup, dict[str, Any]]:
    """Return the candidates, the set-up and the description in a `policy.npz`."""
    file = pathlib.Path(folder) / POLICY_NAME
    try:
        content = read_bytes(file)
    except UnreadableFileError:
        raise
    except FileNotFoundError:
        raise CheckpointError(
            f"there is no policy at {file}: make it with `cablecast train`"
        ) from None
    except InputError as error:
        raise CheckpointError(str(error)) from None
    # Damaged bytes make zipfile, zlib and NumPy raise a dozen types of errors.
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            meta = json.loads(str(archive["meta"]))
            kind, version = meta["format"], meta["format_version"]
            known = (kind, version) == (FORMAT, FORMAT_VERSION)
            arrays = {name: archive[name] for name in ARRAY_SHAPES} if known else {}
    except Exception as error:
        raise CheckpointError(
            f"{file} is damaged or not a policy ({_line(error)}): train again"
        ) from None
    if not known:
        raise CheckpointError(
            f"{file} holds {_line(kind)} of version {_line(version)}: it must be {FORMAT} of "
            f"version {FORMAT_VERSION}, train again"
        )
    try:
        check_keys(meta, {"format", "format_version", "setup", "info"}, "it", required={"setup"})
        info = meta.get("info")
        if not isinstance(info, Mapping):
            raise InputError("info must be a mapping")
        setup = Setup.from_dict(meta["setup"])
        return _checked(arrays), setup, dict(info)
    except (CablecastError, TypeError) as error:
        raise CheckpointError(
            f"{file} does not match this version of cablecast ({_line(error)}): train again"
        ) from None


def _checked(arrays: dict[str, NDArray]) -> dict[str, NDArray[np.float64]]:
    """Check that the arrays have consistent shapes and types, and return them."""
    count = len(arrays["actions"]) if arrays["actions"].ndim else 0
    if count == 0:
        raise InputError("it holds no candidates")
    for name, shape in ARRAY_SHAPES.items():
        values = arrays[name]
        if values.dtype != np.float64 or values.shape != (count, *shape):
            raise InputError(f"{name} has shape {values.shape} and type {values.dtype}")
        if not np.all(np.isfinite(values)):
            raise InputError(f"{name} is not finite")
    return arrays


def _line(value: Any) -> str:
    return " ".join(str(value).split())[:120] or type(value).__name__


ITERATION_COUNT = 2
"""Number of Newton steps; the second lands within 0.1 % of the cable's length of the target."""

# Longest step in units of DEVIATION. Beyond it the landing is not linear in the action. Longer
# steps are not needed: neighbouring candidates of the grid are about 5 degrees and 3 cm apart.
_STEP_MAX = 2.0


class Landings(Protocol):
    """Interface of models for refinement; see `LandingModel`."""

    setup: Any

    @property
    def task(self) -> Task:
        """Task whose outcomes are predicted."""
        ...

    def predict(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Predict outcomes [m], shape [action, k]."""
        ...

    def landing_shifts(
        self, actions: NDArray[np.float64], changes: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the shift of the outcome for each change of an action, [action, k, change]."""
        ...

    def predict_margin(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Predict the distance that the free end keeps from the table's edges [m]."""
        ...


def refine_actions(
    actions: NDArray[np.float64],
    target_xy: NDArray[np.float64],
    changes: NDArray[np.float64],
    *,
    model: Landings,
    table_margin: float,
    iterations: int = ITERATION_COUNT,
    fractions: Sequence[float] = (1.0,),
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Move the predicted outcomes onto the targets by the smallest changes of the actions.

    Many changes of the variables move the landing to the same point of the plane. Each Newton
    step takes the smallest of them, in units of `DEVIATION`. If the arm could not follow the
    refined action, or the free end would leave the table, the action is left unchanged.

    Args:
        actions: Feasible actions for either side, shape [target, 5].
        target_xy: Outcomes to reach [m], shape [target, k].
        changes: Perturbations of an action, see `deviations`, shape [change, 5].
        model: Model of outcomes, valid for theta2 > 0.
        table_margin: Distance that the free end must keep within the table's edges [m].
        iterations: Number of Newton steps.
        fractions: Parts of the way that are tried in turn until the arm can follow.

    Returns:
        Actions and their predicted outcomes [m], shapes [target, 5] and [target, k].
    """
    start, side = mirror_to_right(actions)
    targets = model.task.mirrored(target_xy, side)
    start_xy = model.predict(start)
    moved, moved_xy = start.copy(), start_xy
    for _ in range(iterations):
        shifts = model.landing_shifts(moved, changes)
        step = (np.linalg.pinv(shifts, rcond=1e-3) @ (targets - moved_xy)[..., None])[..., 0]
        length = np.linalg.norm(step, axis=1, keepdims=True)
        step *= np.minimum(1.0, _STEP_MAX / np.maximum(length, 1e-12))
        moved += step @ changes
        moved = within_ranges(moved)
        moved_xy = model.predict(moved)
    final, final_xy = start.copy(), start_xy.copy()
    left_over = np.ones(len(start), dtype=bool)
    start_miss = np.linalg.norm(start_xy - targets, axis=1)
    for fraction in fractions:
        tried = moved if fraction == 1.0 else within_ranges(start + fraction * (moved - start))
        tried_xy = moved_xy if fraction == 1.0 else model.predict(tried)
        taken = left_over & (np.linalg.norm(tried_xy - targets, axis=1) < start_miss)
        if np.any(taken):
            rows = np.flatnonzero(taken)
            stays = model.predict_margin(tried[rows]) >= table_margin
            taken[rows] = stays & check_actions(tried[rows], model.setup).mask
        final[taken], final_xy[taken] = tried[taken], tried_xy[taken]
        left_over &= ~taken
    return mirror_actions(final, side), model.task.mirrored(final_xy, side)


def within_ranges(actions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return actions to the right whose angles and pace are clipped to their bounds."""
    clipped = actions.copy()
    clipped[:, 0] = np.clip(actions[:, 0], -THETA_MAX, -THETA_MIN)
    clipped[:, 1] = np.clip(actions[:, 1], THETA_MIN, THETA_MAX)
    clipped[:, 3] = np.clip(actions[:, 3], clipped[:, 1], PSI_MAX)
    clipped[:, 4] = np.clip(actions[:, 4], *PACE_BOUNDS)
    return clipped


PlanMethod = typing.Literal["refined", "paper"]
"""How a policy plans: our search with refinement, or the paper's equation 1 alone."""

CANDIDATE_COUNT = 50_000
"""Number of candidate actions (section V-F)."""

TIE_PCT = 0.5
"""Candidates up to this much farther than the nearest are equally near [% of cable length]."""

COVERAGE_PCT = 2.0
"""Distance within which a candidate's predicted landing covers a target [% of cable length]."""

TABLE_MARGIN = 0.0
"""Distance that the free end must keep within the table's edges on its way [m]."""

TABLE_MARGIN_MAX = 5.0

_NEIGHBOR_COUNT = 16


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ForwardSearchPolicy:
    """Policy that searches candidates by the landings that a model predicts.

    The candidates cover the right half of the table. A target on the left is planned as its mirror
    image, and the action is mirrored back (section V-B). A candidate predicted to land left of the
    axis is stored as its mirror image, which lands on the right.

    Among candidates that are equally near up to `TIE_PCT`, the policy takes the one whose landing
    is least sensitive to errors of the action. Since a rig never quite matches the model, it is
    the most likely to land where predicted.

    The chosen action is then refined so that its predicted landing is on the target; see
    `refine_actions`. That takes a third of a millisecond per target, mostly to check feasibility.

    Attributes:
        model: Model that predicts the landings and refines the plans.
        actions: Candidates that stay on the table, shape [candidate, 5].
        predicted_xy: Their predicted landings, x >= 0 [m], shape [candidate, 2]; outcomes over
            `LandingModel.units` of another task.
        sensitivity: Root of the summed squares of the landing's shifts for 1 degree of theta1, of
            theta2 and of psi, for 1 cm of r2 and for 0.01 of a pace that varies [m], shape
            [candidate].
        info: Fingerprint of the model, numbers of candidates, seed, table margin.
    """

    model: LandingModel
    actions: NDArray[np.float64]
    predicted_xy: NDArray[np.float64]
    sensitivity: NDArray[np.float64]
    info: dict[str, Any] = dataclasses.field(default_factory=dict)

    @classmethod
    def build(
        cls,
        model: LandingModel,
        candidate_count: int = CANDIDATE_COUNT,
        seed: int = 0,
        *,
        ranges: ActionRanges | None = None,
        table_margin: float = TABLE_MARGIN,
        progress: ProgressCallback = ignore,
    ) -> "ForwardSearchPolicy":
        """Choose candidates and predict their landings.

        Args:
            model: Model of landings, with its set-up.
            candidate_count: Number of feasible candidates.
            seed: Seed for choosing candidates from the grid.
            ranges: Ranges of the actions; those of the model's casts if None.
            table_margin: Distance that the free end must keep within the table's edges [m];
                candidates predicted to come nearer are left out.
            progress: Told how many candidates are found.

        Raises:
            InputError: No candidate stays on the table.
        """
        ranges = model.action_ranges if ranges is None else ranges
        actions = feasible_actions(candidate_count, model.setup, ranges, seed, progress)
        return cls.from_candidates(actions, model, table_margin, {"seed": seed})

    @classmethod
    def from_candidates(
        cls,
        actions: NDArray[np.float64],
        model: LandingModel,
        table_margin: float = TABLE_MARGIN,
        info: dict[str, Any] | None = None,
    ) -> "ForwardSearchPolicy":
        """Predict the landings of given candidates; see `build`.

        Args:
            actions: Candidates, shape [candidate, 5].
            model: Model of landings, with its set-up.
            table_margin: Distance that the free end must keep within the table's edges [m].
            info: Additional entries of `info`.
        """
        check_number("table_margin", table_margin, -TABLE_MARGIN_MAX, TABLE_MARGIN_MAX, "m")
        predicted_xy, margin = model.predict(actions), model.predict_margin(actions)
        rest_xy = model.rest(actions, predicted_xy)
        kept = (margin >= table_margin) & model.setup.workspace.on_table(rest_xy)
        if not np.any(kept):
            raise InputError(
                f"none of {len(actions)} candidates is predicted to keep {table_margin:g} m within "
                "the table's edges"
            )
        facts = {
            "name": "forward search",
            "candidate_count": len(actions),
            "kept_count": int(kept.sum()),
            "table_margin": table_margin,
            "model_fingerprint": model.fingerprint,
            "dataset_fingerprint": model.dataset_fingerprint,
        }
        actions, predicted_xy = actions[kept], predicted_xy[kept]
        sensitivity = model.sensitivity(actions, deviations(actions))
        side = model.task.side_of(predicted_xy)
        return cls(
            model=model,
            actions=mirror_actions(actions, side),
            predicted_xy=model.task.mirrored(predicted_xy, side),
            sensitivity=sensitivity,
            info=facts | (info or {}),
        )

    @property
    def setup(self) -> Setup:
        """Set-up that the policy plans for: the model's."""
        return self.model.setup

    def in_lab(self, setup: Setup) -> "ForwardSearchPolicy":
        """Return the policy for a set-up of the same settings, within the box of its robot.

        Raises:
            InputError: No candidate keeps within the box.
        """
        if setup.robot is None:
            return self
        found = check_actions(self.actions, setup)
        if not np.any(found.mask):
            raise InputError(f"no motion of the model keeps to this robot: {found.describe(0)}")
        arrays = {name: getattr(self, name)[found.mask] for name in ARRAY_SHAPES}
        info = self.info | {"kept_count": int(found.mask.sum())}
        return dataclasses.replace(self, model=self.model.in_lab(setup), info=info, **arrays)

    def by(self, method: PlanMethod) -> "ForwardSearchPolicy":
        """Return the policy that plans by a method, "refined" or "paper"; see `PaperPolicy`.

        Raises:
            InputError: There is no such method, or the candidates were not drawn by `build`.
        """
        if method not in typing.get_args(PlanMethod):
            raise InputError(f"method {str(method)[:40]!r} must be refined or paper")
        return PaperPolicy.of(self) if method == "paper" else self

    def plan(
        self,
        target_xy: ArrayLike | None = None,
        *,
        r: ArrayLike | None = None,
        theta_deg: ArrayLike | None = None,
    ) -> Plan:
        """Choose an action for each target.

        Args:
            target_xy: Targets [m], shape [2] or [target, 2]; alternative to r and theta_deg.
            r: Distances from the robot's base [m], a number or shape [target].
            theta_deg: Angles from straight ahead, positive to the robot's right [deg], a number or
                shape [target].

        Raises:
            InputError: Both forms of targets are given, or neither, or the model has another task.
            TargetError: A target is not finite, out of reach, or off the table.
        """
        if not isinstance(self.model.task, Landing):
            raise InputError(f"a plan is of landings, the model of {self.model.task.name}")
        targets = LANDING.values(self.setup, target_xy, r=r, theta_deg=theta_deg)
        side = side_of(targets)
        chosen, actions, predicted_xy = self._choose(mirror_xy(targets, side))
        return Plan(
            setup=self.setup,
            target_xy=targets,
            actions=mirror_actions(actions, side),
            predicted_xy=mirror_xy(predicted_xy, side),
            inside_coverage=self.inside_coverage(targets),
            sensitivity=self.sensitivity[chosen],
        )

    def _choose(
        self, targets: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
        """Return rows of candidates, actions and landings for targets on the right half."""
        chosen = self._least_sensitive(targets)
        actions, predicted_xy = refine_actions(
            self.actions[chosen],
            targets,
            self._changes,
            model=self.model,
            table_margin=self.info.get("table_margin", TABLE_MARGIN),
        )
        return chosen, actions, predicted_xy

    def _least_sensitive(self, targets: NDArray[np.float64]) -> NDArray[np.intp]:
        """Return the least sensitive of equally near candidates for targets on the right half."""
        count = min(_NEIGHBOR_COUNT, len(self.actions))
        distance, index = self.tree.query(targets, k=count)
        distance, index = (np.reshape(values, (-1, count)) for values in (distance, index))
        tied = distance <= distance[:, :1] + TIE_PCT / 100 * self.setup.cable.length
        best = np.argmin(np.where(tied, self.sensitivity[index], np.inf), axis=1)
        return index[np.arange(len(targets)), best]

    def nearest_landing(self, target_xy: ArrayLike) -> NDArray[np.float64]:
        """Return the predicted outcome of a candidate that is nearest to each goal, shape [..., k].

        Args:
            target_xy: Values of the goals, shape [..., k].
        """
        task, units = self.model.task, self.model.units
        side = task.side_of(target_xy)
        _, row = self.tree.query(task.mirrored(target_xy, side) / units)
        return units * task.mirrored(self.tree.data[row], side)

    def inside_coverage(
        self, target_xy: ArrayLike, within_pct: float = COVERAGE_PCT
    ) -> NDArray[np.bool_]:
        """Return which goals lie within the simulated coverage, on either half of the table.

        A goal is inside if the predicted outcome of at least one candidate that stays on the table
        is near it.

        Args:
            target_xy: Values of the goals, shape [..., k].
            within_pct: Distance that is near [% of cable length].
        """
        task = self.model.task
        folded = task.mirrored(target_xy, task.side_of(target_xy))
        distance, _ = self.tree.query(folded / self.model.units)
        return np.asarray(distance <= within_pct / 100 * self.setup.cable.length)

    def save(self, folder: str | pathlib.Path) -> None:
        """Write the model and the candidates atomically, for `load` to read.

        Raises:
            InputError: The policy is one of equation 1, or of another task than a landing.
        """
        arrays = _checked({name: getattr(self, name) for name in ARRAY_SHAPES})
        self.model.save(folder)
        meta = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "setup": self.setup.to_settings(),
            "info": self.info,
        }
        text = json.dumps(meta, ensure_ascii=False, allow_nan=False)
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, meta=np.array(text), **arrays)
        write_bytes(pathlib.Path(folder) / POLICY_NAME, buffer.getvalue())

    @classmethod
    def load(cls, folder: str | pathlib.Path) -> "ForwardSearchPolicy":
        """Read the model and the candidates from a folder.

        Args:
            folder: Folder that `save` or `cablecast train` wrote.

        Raises:
            CheckpointError: Either is missing, damaged, or of another kind or version, or the
                policy was built with another model.
            UnreadableFileError: The system refuses to read a file.
        """
        model, (arrays, setup, info) = load_model(folder), _read_policy(folder)
        built_with = info.get("model_fingerprint")
        same = setup.to_settings() == model.setup.to_settings()
        if built_with != model.fingerprint or not same:
            raise CheckpointError(
                f"the policy in {folder} was built with another model ({str(built_with)[:40]}, not "
                f"{model.fingerprint}): train again"
            )
        return cls(model=model, info=info, **arrays)

    @functools.cached_property
    def _changes(self) -> NDArray[np.float64]:
        return deviations(self.actions)

    @functools.cached_property
    def tree(self):
        """Tree of the predicted landings, for nearest neighbours."""
        from scipy.spatial import KDTree

        return KDTree(self.predicted_xy)


class PaperPolicy(ForwardSearchPolicy):
    """Policy of the paper's equation 1: the candidate whose predicted landing is nearest.

    No candidate is left out, whether it stays on the table or not; none is preferred for its
    sensitivity, which is unknown here, nor refined.
    """

    @classmethod
    def of(cls, policy: ForwardSearchPolicy) -> "PaperPolicy":
        """Return the policy of equation 1 with the model and all candidates of another.

        Raises:
            InputError: The candidates were not drawn by `ForwardSearchPolicy.build`.
        """
        info, model = policy.info, policy.model
        if isinstance(policy, cls):
            return policy
        if "seed" not in info:
            raise InputError("equation 1 needs a policy whose candidates `train` has drawn")
        ranges = model.action_ranges
        actions = feasible_actions(info["candidate_count"], policy.setup, ranges, info["seed"])
        predicted_xy, unknown = model.predict(actions), np.full(len(actions), np.nan)
        return cls(
            model=model,
            actions=actions,
            predicted_xy=predicted_xy,
            sensitivity=unknown,
            info={**info, "name": "equation 1", "kept_count": len(actions)},
        )

    def _choose(
        self, targets: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
        chosen = np.asarray(self.tree.query(targets)[1], dtype=np.intp)
        return chosen, self.actions[chosen], self.predicted_xy[chosen]


_POLAR_PACES = (1.0, 0.9, 0.8)
"""Paces of the swing of the paper's polar casts: a long cable comes down near to the base, and an
arm may not follow the quickest back there."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolarCastingPolicy:
    """The paper's baseline, which plans by geometry alone: nothing is learned or simulated.

    Attributes:
        setup: Cable, table and arm.
    """

    setup: Setup

    @property
    def info(self) -> dict[str, Any]:
        """Name of the policy, and settings of its motions."""
        cast = polar_config(self.setup, casts=True)
        return {"name": "polar casting"} | dataclasses.asdict(cast)

    @functools.cached_property
    def reach(self) -> PolarReach:
        """Region in which the endpoint can be laid down."""
        return PolarReach.of(self.setup)

    def plan(
        self,
        target_xy: ArrayLike | None = None,
        *,
        r: ArrayLike | None = None,
        theta_deg: ArrayLike | None = None,
    ) -> Plan:
        """Plan a motion for each target; outside `reach`, it ends as near as possible.

        See `Landing.values` for the arguments and errors.

        Raises:
            JointLimitError: The arm cannot follow the motion.
        """
        targets = LANDING.values(self.setup, target_xy, r=r, theta_deg=theta_deg)
        nearest = self.reach.nearest(targets)
        return Plan(
            setup=self.setup,
            target_xy=targets,
            predicted_xy=nearest,
            inside_coverage=self.reach.contains(targets),
            motions=tuple(self._cast(xy) for xy in nearest),
        )

    def _cast(self, xy: NDArray[np.float64]) -> Trajectory:
        """Return the quickest cast to a place of the reach that the arm can follow."""
        *quicker, slowest = (PolarCast.back_to(xy, self.reach, pace) for pace in _POLAR_PACES)
        for cast in quicker:
            with contextlib.suppress(JointLimitError):
                return plan_trajectory(cast, self.setup)
        return plan_trajectory(slowest, self.setup)


_KINDS: dict[str, type[LandingModel]] = {
    kind.FORMAT: kind for kind in (ForwardModel, GaussianProcessModel)
}


def load_model(folder: str | pathlib.Path) -> LandingModel:
    """Read a checkpoint of any kind of model.

    Args:
        folder: Folder that the model was saved to.

    Raises:
        CheckpointError: The file is missing, truncated, damaged, or not a model.
    """
    checkpoint = read_checkpoint(folder)
    if checkpoint.kind not in _KINDS:
        raise CheckpointError(
            f"{checkpoint.file} holds {checkpoint.kind or 'something'}: "
            f"it must be {' or '.join(_KINDS)}"
        )
    return _KINDS[checkpoint.kind].from_checkpoint(checkpoint)
