"""ForwardSearchPolicy: feasible action whose predicted landing is nearest (equation 1).

The predicted landings of the candidates do not depend on the target, so they are computed once. A
k-d tree then answers a thousand targets in milliseconds.
"""

import dataclasses
import functools
import pathlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.checks import check_number
from cablecast.conventions import mirror_xy
from cablecast.errors import CheckpointError, InputError
from cablecast.models.features import deviations
from cablecast.models.landing import LandingModel
from cablecast.models.load import load_model
from cablecast.motion.action import ActionRanges
from cablecast.motion.feasibility import feasible_grid
from cablecast.motion.mirrored import played, rightward, side_hands, to_right
from cablecast.policies.base import Plan, check_targets
from cablecast.policies.refinement import refine_actions
from cablecast.policies.storage import ARRAY_SHAPES, StoredPolicy, read_policy, write_policy
from cablecast.setup import Setup

NAME = "forward search"

CANDIDATE_COUNT = 50_000
"""Number of candidate actions (section V-F)."""

TIE_PCT = 0.5
"""Candidates up to this much farther than the nearest are equally near [% of cable length]."""

COVERAGE_PCT = 2.0
"""Distance within which a candidate's predicted landing covers a target [% of cable length]."""

TABLE_MARGIN = 0.0
"""Distance that the free end must keep within the table's edges on its way [m]."""

TABLE_MARGIN_MAX = 5.0

REACH_PCT = 6.0
"""Distance from the target within which candidates are compared by their expected miss, if the
model predicts a spread [% of cable length]. The best one is moved onto the target."""

_NEIGHBOR_COUNT = 16
_REACH_COUNT = 512
_SHORTLIST_COUNT = 8

# The spread is known at the candidate, not at the action moved onto the target. Each metre of the
# move counts as this many metres of spread.
_MOVE_COST = 0.15

_Chosen = tuple[
    NDArray[np.intp], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None
]


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ForwardSearchPolicy:
    """Policy that searches candidates by the landings that a model predicts.

    The candidates cover the right half of the table. A target on the left is planned as its mirror
    image, and the action is mirrored back (section V-B). A candidate predicted to land left of the
    axis is stored as its mirror image, which lands on the right.

    Among candidates that are equally near up to `TIE_PCT`, the policy takes the one whose landing
    is least sensitive to errors of the action. A rig's motion and cable never quite match the
    model; this candidate is the most likely to land where predicted.

    The chosen action is then refined so that its predicted landing is on the target; see
    `refine_actions`. That takes a third of a millisecond per target, mostly to check feasibility.

    A model that has learned from real casts also predicts their spread. The policy then takes, of
    all candidates within `REACH_PCT`, the one with the least expected miss: the remaining distance
    to the target and the spread combined (docs/learning.md).

    Attributes:
        model: Model that predicts the landings and refines the plans.
        actions: Candidates that stay on the table, shape [candidate, 4].
        predicted_xy: Their predicted landings, x >= 0 [m], shape [candidate, 2].
        sensitivity: Root of the summed squares of the landing's shifts for 1 degree of theta1, of
            theta2 and of psi and for 1 cm of r2 [m], shape [candidate].
        spread: Standard deviation along each axis of real landings about the predicted ones [m],
            shape [candidate]; NaN if the model has seen no real casts.
        margin: Predicted distance that the free end keeps within the table's edges [m], shape
            [candidate].
        info: Fingerprint of the model, numbers of candidates, seed, table margin.
    """

    model: LandingModel
    actions: NDArray[np.float64]
    predicted_xy: NDArray[np.float64]
    sensitivity: NDArray[np.float64]
    spread: NDArray[np.float64]
    margin: NDArray[np.float64]
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
    ) -> "ForwardSearchPolicy":
        """Choose candidates and predict their landings.

        Args:
            model: Model of landings, with its set-up.
            candidate_count: Number of feasible candidates.
            seed: Seed for choosing candidates from the grid.
            ranges: Ranges of the actions; `ActionRanges.for_setup` if None.
            table_margin: Distance that the free end must keep within the table's edges [m];
                candidates predicted to come nearer are left out.

        Raises:
            InputError: No candidate stays on the table.
        """
        ranges = ActionRanges.for_setup(model.setup) if ranges is None else ranges
        actions = feasible_grid(candidate_count, model.setup, ranges, seed)
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
            actions: Candidates, shape [candidate, 4].
            model: Model of landings, with its set-up.
            table_margin: Distance that the free end must keep within the table's edges [m].
            info: Additional entries of `info`.
        """
        check_number("table_margin", table_margin, -TABLE_MARGIN_MAX, TABLE_MARGIN_MAX, "m")
        predicted_xy, margin = model.predict(actions), model.predict_margin(actions)
        kept = (margin >= table_margin) & model.setup.workspace.on_table(predicted_xy)
        if not np.any(kept):
            raise InputError(
                f"none of {len(actions)} candidates is predicted to keep {table_margin:g} m within "
                "the table's edges"
            )
        facts = {
            "name": NAME,
            "candidate_count": len(actions),
            "kept_count": int(kept.sum()),
            "table_margin": table_margin,
            "model_fingerprint": model.fingerprint,
            "dataset_fingerprint": model.info.get("dataset", {}).get("fingerprint", ""),
        }
        actions, predicted_xy, margin = actions[kept], predicted_xy[kept], margin[kept]
        spread = model.predict_spread(actions)
        sensitivity = model.sensitivity(actions, deviations(actions))
        hands = side_hands(predicted_xy)
        return cls(
            model=model,
            actions=played(actions, hands),
            predicted_xy=to_right(predicted_xy, hands),
            sensitivity=sensitivity,
            spread=np.full(len(actions), np.nan) if spread is None else spread,
            margin=margin,
            info=facts | (info or {}),
        )

    @property
    def setup(self) -> Setup:
        """Set-up that the policy plans for: the model's."""
        return self.model.setup

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
            InputError: Both forms of targets are given, or neither.
            TargetError: A target is not finite, out of reach, or off the table.
        """
        targets = check_targets(self.setup, target_xy, r=r, theta_deg=theta_deg)
        hands = side_hands(targets)
        choose = self._least_sensitive if np.isnan(self.spread[0]) else self._least_risky
        chosen, actions, predicted_xy, spread = choose(to_right(targets, hands))
        return Plan(
            setup=self.setup,
            target_xy=targets,
            actions=played(actions, hands),
            predicted_xy=to_right(predicted_xy, hands),
            inside_coverage=self.inside_coverage(targets),
            spread=np.array(np.nan) if spread is None else spread,
            sensitivity=self.sensitivity[chosen],
        )

    def _least_sensitive(self, targets: NDArray[np.float64]) -> _Chosen:
        """Choose the least sensitive of equally near candidates.

        Args:
            targets: Targets on the right half [m], shape [target, 2].

        Returns:
            Indices of the chosen candidates, their refined actions, the landings of these, and None
            for the unknown spread.
        """
        distance, index = self._neighbors(targets, _NEIGHBOR_COUNT)
        tied = distance <= distance[:, :1] + TIE_PCT / 100 * self.setup.cable.length
        best = np.argmin(np.where(tied, self.sensitivity[index], np.inf), axis=1)
        chosen = index[np.arange(len(targets)), best]
        return chosen, *self._refined(chosen, targets), None

    def _least_risky(self, targets: NDArray[np.float64]) -> _Chosen:
        """Choose the candidate within `REACH_PCT` that has the least expected miss.

        Args:
            targets: Targets on the right half [m], shape [target, 2].

        Returns:
            As `_least_sensitive`, with the spread of the refined actions [m].
        """
        distance, index = self._neighbors(targets, _REACH_COUNT)
        reach = np.maximum(REACH_PCT / 100 * self.setup.cable.length, distance[:, :1])
        risk = (_MOVE_COST * distance) ** 2 + 2.0 * self.spread[index] ** 2
        risk[distance > reach] = np.inf
        short = np.argsort(risk, axis=1)[:, : min(_SHORTLIST_COUNT, risk.shape[1])]
        rows = np.arange(len(targets))
        # Recompute the spread of the shortlist after its actions have been moved.
        candidates = np.take_along_axis(index, short, axis=1).ravel()
        goals = np.repeat(targets, short.shape[1], axis=0)
        actions, predicted_xy = self._refined(candidates, goals)
        spread = self.model.predict_spread(rightward(actions)[0])
        if spread is None:
            raise InputError("the policy's candidates have a spread, but its model predicts none")
        miss = np.sum((predicted_xy - goals) ** 2, axis=1) + 2.0 * spread**2
        # Candidates out of reach are on the shortlist only if there are too few within reach.
        miss[np.isinf(np.take_along_axis(risk, short, axis=1)).ravel()] = np.inf
        best = rows * short.shape[1] + np.argmin(miss.reshape(short.shape), axis=1)
        return candidates[best], actions[best], predicted_xy[best], spread[best]

    def _neighbors(self, targets: NDArray[np.float64], count: int):
        """Return distances and indices of the nearest candidates, shapes [target, candidate]."""
        count = min(count, len(self.actions))
        distance, index = self.tree.query(targets, k=count)
        return np.reshape(distance, (-1, count)), np.reshape(index, (-1, count))

    def _refined(self, chosen: NDArray[np.intp], targets: NDArray[np.float64]):
        """Return candidates moved onto targets, and their predicted landings."""
        return refine_actions(
            self.actions[chosen],
            targets,
            self._changes,
            model=self.model,
            table_margin=self.info.get("table_margin", TABLE_MARGIN),
        )

    def inside_coverage(self, target_xy: ArrayLike) -> NDArray[np.bool_]:
        """Return which targets lie within the simulated coverage, on either half of the table.

        A target is inside if the predicted landing of at least one candidate that stays on the
        table is within `COVERAGE_PCT` of it.

        Args:
            target_xy: Targets [m], shape [..., 2].
        """
        targets = np.asarray(target_xy, dtype=float)
        folded = np.where(targets[..., :1] < 0, mirror_xy(targets), targets)
        distance, _ = self.tree.query(folded)
        return np.asarray(distance <= COVERAGE_PCT / 100 * self.setup.cable.length)

    def save(self, folder: str | pathlib.Path) -> None:
        """Write the model and the candidates, for `load` to read."""
        self.model.save(folder)
        arrays = {name: getattr(self, name) for name in ARRAY_SHAPES}
        write_policy(folder, StoredPolicy(arrays=arrays, setup=self.setup, info=self.info))

    @classmethod
    def load(cls, folder: str | pathlib.Path) -> "ForwardSearchPolicy":
        """Read the model and the candidates from a folder.

        Args:
            folder: Folder that `save` or `cablecast train` wrote.

        Raises:
            CheckpointError: Either is missing, damaged, or of another kind or version, or the
                policy was built with another model.
        """
        model, stored = load_model(folder), read_policy(folder)
        built_with = stored.info.get("model_fingerprint")
        if built_with != model.fingerprint or stored.setup != model.setup:
            raise CheckpointError(
                f"the policy in {folder} was built with another model ({str(built_with)[:40]}, not "
                f"{model.fingerprint}): train again"
            )
        return cls(model=model, info=stored.info, **stored.arrays)

    @functools.cached_property
    def _changes(self) -> NDArray[np.float64]:
        return deviations(self.actions)

    @functools.cached_property
    def tree(self):
        """Tree of the predicted landings, for nearest neighbours."""
        from scipy.spatial import KDTree

        return KDTree(self.predicted_xy)
