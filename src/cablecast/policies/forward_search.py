"""The policy of equation 1: of many feasible actions, take the one predicted to land nearest.

What the candidates are predicted to do does not depend on the target, so it is computed once and
kept; a k-d tree then answers a thousand targets in milliseconds.
"""

import dataclasses
import functools
import io
import json
import pathlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.conventions import mirror_xy
from cablecast.errors import CheckpointError, InputError
from cablecast.files import write_bytes
from cablecast.models.features import deviations
from cablecast.models.landing import LandingModel
from cablecast.motion.action import ActionRanges, MotionConfig, mirror_actions
from cablecast.policies.refinement import refine_actions
from cablecast.workspace import Workspace

FORMAT = "cablecast.forward_search"
FORMAT_VERSION = 2
POLICY_NAME = "policy.npz"

CANDIDATE_COUNT = 50_000
"""Candidate actions (section V-F)."""

TIE_PCT = 0.5
"""Candidates that land this close to the nearest one count as equally near [% of cable length]."""

COVERAGE_PCT = 2.0
"""A target is covered where a candidate is predicted to land this near [% of cable length]."""

TABLE_MARGIN = 0.0
"""How far the free end must keep within the table's edges on its way [m]."""

REACH_PCT = 6.0
"""Where the model knows how far it may be trusted, candidates that land this near the target are
weighed against each other, and the best of them moved onto it [% of cable length]."""

_NEIGHBOR_COUNT = 16
_REACH_COUNT = 512
_SHORTLIST_COUNT = 8

# Moving an action onto the target leads away from where its spread is known. Each metre that it
# has to move counts as so many metres of spread.
_MOVE_COST = 0.15

_ARRAYS = ("actions", "predicted_xy", "sensitivity", "spread", "margin")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Plan:
    """One action per target.

    Attributes:
        actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [target, 4].
        predicted_xy: Where the model says they land [m], shape [target, 2].
        sensitivity: How far the landing is predicted to move when the action deviates by 1 degree
            and 1 cm [m], shape [target].
        spread: Standard deviation along each axis with which the landing is expected to scatter
            about the predicted one [m], shape [target]; NaN where the model cannot tell.
        inside_coverage: Whether the target lies within the coverage, shape [target].
    """

    actions: NDArray[np.float64]
    predicted_xy: NDArray[np.float64]
    sensitivity: NDArray[np.float64]
    spread: NDArray[np.float64]
    inside_coverage: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.actions)


@dataclasses.dataclass(frozen=True, kw_only=True)
class ForwardSearchPolicy:
    """Plans by searching candidates whose landings a forward model has predicted.

    The candidates plan the right half of the table; a target on the left is planned for its mirror
    image, and the action mirrored back (section V-B). A candidate that is predicted to land left of
    the axis is kept as its mirror image, which lands on the right, so none goes to waste.

    Of the candidates that land within `TIE_PCT` of the nearest one, the policy takes the one whose
    landing moves least when the action deviates a little: on a rig, whose motion and cable are
    never quite those of the model, it is the likeliest to land where predicted.

    With a `model` the chosen action is also moved a little, until the model predicts that it lands
    on the target; see `refine_actions`. That costs a third of a millisecond a target, for the check
    that the arm can still follow.

    A model that has learned from real casts knows how far they scatter about its predictions. The
    policy then takes, of all candidates within `REACH_PCT`, the one with the least expected miss:
    what remains to the target and the spread together (docs/learning.md).

    Attributes:
        actions: Candidates that stay on the table, shape [candidate, 4].
        predicted_xy: Their predicted landings, x >= 0 [m], shape [candidate, 2].
        sensitivity: Root of the summed squares of how far the landing moves for 1 degree of theta1,
            of theta2 and of psi and for 1 cm of r2 [m], shape [candidate].
        spread: Standard deviation along each axis of real landings about the predicted ones [m],
            shape [candidate]; NaN where the model has seen no real casts.
        margin: How far the free end is predicted to keep within the table's edges [m],
            shape [candidate].
        cable: The cable.
        workspace: Table and arm.
        config: System parameters of the motions.
        info: Fingerprint of the model, numbers of candidates, seed.
        model: Refines plans, where given; it is not saved.
    """

    actions: NDArray[np.float64]
    predicted_xy: NDArray[np.float64]
    sensitivity: NDArray[np.float64]
    spread: NDArray[np.float64]
    margin: NDArray[np.float64]
    cable: Cable
    workspace: Workspace
    config: MotionConfig
    info: dict[str, Any] = dataclasses.field(default_factory=dict)
    model: LandingModel | None = None

    @classmethod
    def build(
        cls,
        model: LandingModel,
        config: MotionConfig,
        workspace: Workspace,
        candidate_count: int = CANDIDATE_COUNT,
        seed: int = 0,
        *,
        ranges: ActionRanges | None = None,
        table_margin: float = TABLE_MARGIN,
    ) -> "ForwardSearchPolicy":
        """Choose candidates and predict their landings.

        Args:
            model: The forward model.
            config: System parameters of the motions.
            workspace: Table and arm.
            candidate_count: Number of feasible candidates.
            seed: Chooses them from the grid.
            ranges: Ranges of the actions; those that suit the config where None.
            table_margin: Leave out candidates whose free end is predicted to come nearer to an edge
                of the table than this [m].

        Raises:
            InputError: No candidate stays on the table.
        """
        from cablecast.motion.feasibility import feasible_grid

        ranges = ActionRanges.for_config(config) if ranges is None else ranges
        actions = feasible_grid(candidate_count, config, workspace, ranges, seed)
        info = {
            "candidate_count": len(actions),
            "seed": seed,
            "table_margin": table_margin,
            "model_fingerprint": model.fingerprint,
            "dataset_fingerprint": model.info.get("dataset", {}).get("fingerprint", ""),
        }
        return cls.from_candidates(actions, model, config, workspace, table_margin, info)

    @classmethod
    def from_candidates(
        cls,
        actions: NDArray[np.float64],
        model: LandingModel,
        config: MotionConfig,
        workspace: Workspace,
        table_margin: float = TABLE_MARGIN,
        info: dict[str, Any] | None = None,
    ) -> "ForwardSearchPolicy":
        """Like `build`, with candidates of one's own, shape [candidate, 4]."""
        predicted_xy, margin = model.predict(actions), model.predict_margin(actions)
        kept = (margin >= table_margin) & workspace.on_table(predicted_xy)
        if not np.any(kept):
            raise InputError(
                f"none of {len(actions)} candidates is predicted to keep {table_margin:g} m within "
                "the table's edges"
            )
        actions, predicted_xy, margin = actions[kept], predicted_xy[kept], margin[kept]
        spread = model.predict_spread(actions)
        sensitivity = model.sensitivity(actions, deviations(actions))
        left = predicted_xy[:, :1] < 0
        return cls(
            actions=np.where(left, mirror_actions(actions), actions),
            predicted_xy=np.where(left, mirror_xy(predicted_xy), predicted_xy),
            sensitivity=sensitivity,
            spread=np.full(len(actions), np.nan) if spread is None else spread,
            margin=margin,
            cable=model.cable,
            workspace=workspace,
            config=config,
            info=(info or {}) | {"kept_count": int(kept.sum())},
        )

    def plan(self, target_xy: ArrayLike) -> Plan:
        """Choose an action for each target.

        Args:
            target_xy: Targets [m], shape [2] or [target, 2].

        Raises:
            TargetError: A target is not finite, out of reach, or off the table.
        """
        targets = np.atleast_2d(self.workspace.check_target(target_xy, self.cable.length))
        left = targets[:, :1] < 0
        folded = np.where(left, mirror_xy(targets), targets)
        choose = self._least_sensitive if np.isnan(self.spread[0]) else self._least_risky
        chosen, actions, predicted_xy, spread = choose(folded)
        nearest, _ = self._tree.query(folded)
        return Plan(
            actions=np.where(left, mirror_actions(actions), actions),
            predicted_xy=np.where(left, mirror_xy(predicted_xy), predicted_xy),
            sensitivity=self.sensitivity[chosen],
            spread=spread,
            inside_coverage=nearest <= COVERAGE_PCT / 100 * self.cable.length,
        )

    def _least_sensitive(self, targets: NDArray[np.float64]):
        """Of the candidates that are equally near, the one whose landing moves least.

        Args:
            targets: Targets on the right half [m], shape [target, 2].

        Returns:
            Index of the chosen candidates, their actions once refined, where these land, and NaN
            for the spread.
        """
        distance, index = self._neighbors(targets, _NEIGHBOR_COUNT)
        tied = distance <= distance[:, :1] + TIE_PCT / 100 * self.cable.length
        best = np.argmin(np.where(tied, self.sensitivity[index], np.inf), axis=1)
        chosen = index[np.arange(len(targets)), best]
        actions, predicted_xy = self._refined(chosen, targets)
        return chosen, actions, predicted_xy, np.full(len(targets), np.nan)

    def _least_risky(self, targets: NDArray[np.float64]):
        """Of the candidates within reach, the one with the least expected miss.

        Args:
            targets: Targets on the right half [m], shape [target, 2].

        Returns:
            As `_least_sensitive`, with the spread of the refined actions [m].
        """
        distance, index = self._neighbors(targets, _REACH_COUNT)
        cost = 1.0 if self.model is None else _MOVE_COST
        reach = np.maximum(REACH_PCT / 100 * self.cable.length, distance[:, :1])
        spread = self.spread[index]
        risk = (cost * distance) ** 2 + 2.0 * spread**2
        risk[distance > reach] = np.inf
        short = np.argsort(risk, axis=1)[:, : min(_SHORTLIST_COUNT, risk.shape[1])]
        rows = np.arange(len(targets))
        if self.model is None:
            chosen = index[rows, short[:, 0]]
            return chosen, self.actions[chosen], self.predicted_xy[chosen], self.spread[chosen]
        # The spread of the shortlist is taken again after each action has been moved.
        candidates = np.take_along_axis(index, short, axis=1).ravel()
        goals = np.repeat(targets, short.shape[1], axis=0)
        actions, predicted_xy = self._refined(candidates, goals)
        on_left = actions[:, 1:2] < 0
        spread = self.model.predict_spread(np.where(on_left, mirror_actions(actions), actions))
        if spread is None:
            raise InputError("the policy's candidates have a spread, but its model knows none")
        miss = np.sum((predicted_xy - goals) ** 2, axis=1) + 2.0 * spread**2
        # A candidate out of reach is on the list only where there are too few within it.
        miss[np.isinf(np.take_along_axis(risk, short, axis=1)).ravel()] = np.inf
        best = rows * short.shape[1] + np.argmin(miss.reshape(short.shape), axis=1)
        return candidates[best], actions[best], predicted_xy[best], spread[best]

    def _neighbors(self, targets: NDArray[np.float64], count: int):
        """Distances and indices of the nearest candidates, nearest first, [target, candidate]."""
        count = min(count, len(self.actions))
        distance, index = self._tree.query(targets, k=count)
        return np.reshape(distance, (-1, count)), np.reshape(index, (-1, count))

    def _refined(self, chosen: NDArray[np.intp], targets: NDArray[np.float64]):
        """Candidates moved onto targets where there is a model, and their predicted landings."""
        actions, predicted_xy = self.actions[chosen], self.predicted_xy[chosen]
        if self.model is None:
            return actions, predicted_xy
        return refine_actions(
            actions,
            targets,
            deviations(self.actions),
            model=self.model,
            config=self.config,
            workspace=self.workspace,
            table_margin=self.info.get("table_margin", TABLE_MARGIN),
        )

    def inside_coverage(self, target_xy: ArrayLike) -> NDArray[np.bool_]:
        """Whether targets lie within the simulated coverage, on either half of the table.

        A target is inside where at least one candidate that stays on the table is predicted to land
        within `COVERAGE_PCT` of the cable's length of it.

        Args:
            target_xy: Targets [m], shape [..., 2].
        """
        targets = np.asarray(target_xy, dtype=float)
        folded = np.where(targets[..., :1] < 0, mirror_xy(targets), targets)
        distance, _ = self._tree.query(folded)
        return np.asarray(distance <= COVERAGE_PCT / 100 * self.cable.length)

    def save(self, folder: str | pathlib.Path) -> None:
        """Write `policy.npz`, whole or not at all; nothing in it is pickled."""
        meta = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "cable": self.cable.to_dict(),
            "workspace": dataclasses.asdict(self.workspace),
            "motion": dataclasses.asdict(self.config),
            "info": self.info,
        }
        buffer = io.BytesIO()
        np.savez(
            buffer,
            allow_pickle=False,
            meta=np.array(json.dumps(meta, ensure_ascii=False)),
            **{name: getattr(self, name) for name in _ARRAYS},
        )
        write_bytes(pathlib.Path(folder) / POLICY_NAME, buffer.getvalue())

    @classmethod
    def load(
        cls, folder: str | pathlib.Path, model: LandingModel | None = None
    ) -> "ForwardSearchPolicy":
        """Read what `save` wrote.

        Args:
            folder: The folder given to `save`.
            model: Refine plans with this model, the one that the policy was built with.

        Raises:
            CheckpointError: It is missing, truncated, damaged, of another kind, or was built with
                another model.
        """
        file = pathlib.Path(folder) / POLICY_NAME
        try:
            content = file.read_bytes()
        except OSError as error:
            raise CheckpointError(f"no policy at {file}: {error.strerror}") from None
        import zipfile
        import zlib

        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as stored:
                meta = json.loads(str(stored["meta"]))
                kind, version = meta["format"], meta["format_version"]
                known = (kind, version) == (FORMAT, FORMAT_VERSION)
                arrays = {name: stored[name] for name in _ARRAYS} if known else {}
        except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
            raise CheckpointError(f"{file} is truncated or no policy: {error}") from None
        except (zipfile.BadZipFile, zlib.error, AttributeError) as error:
            raise CheckpointError(f"{file} is truncated or damaged: {error}") from None
        if not known:
            raise CheckpointError(
                f"{file} holds {kind} of version {version}: it must be {FORMAT} of version "
                f"{FORMAT_VERSION}, train again"
            )
        built_with = meta["info"].get("model_fingerprint") if "info" in meta else None
        if model is not None and built_with != model.fingerprint:
            raise CheckpointError(
                f"{file} was built with another model ({built_with}, not {model.fingerprint}): "
                "train again"
            )
        try:
            return cls(
                **arrays,
                model=model,
                cable=Cable.from_dict(meta["cable"]),
                workspace=Workspace(**meta["workspace"]),
                config=MotionConfig(**meta["motion"]),
                info=meta["info"],
            )
        except (KeyError, TypeError, InputError) as error:
            raise CheckpointError(
                f"{file} was written by another version of cablecast ({error}): train again"
            ) from None

    @functools.cached_property
    def _tree(self):
        from scipy.spatial import KDTree

        return KDTree(self.predicted_xy)
