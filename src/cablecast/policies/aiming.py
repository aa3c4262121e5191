"""Aimer: chooses casts under uncertainty, and learns from every one of them.

A `LandingPredictor` says where a cast is expected to land, and how surely, from simulators and from
all real casts so far. For a target the aimer takes the action with the least expected loss, from
the distance left, the uncertainty of the prediction, the scatter of the action, and the chance of a
cast that ends out of sight. After a cast near a target the process is almost certain there, so the
next action is a small step from the last one, damped by the scatter as in a Kalman filter. An
action that scatters more than expected, or stays far off, loses this advantage to others.
"""

import copy
import dataclasses
import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.camera.sight import CameraSight
from cablecast.errors import InputError
from cablecast.models.few_casts import Places, ResidualScales
from cablecast.models.local_size import LocalSize
from cablecast.motion.feasibility import check_actions
from cablecast.motion.mirrored import played, rightward, to_right
from cablecast.policies.aimed import AimChoice, AimedCast
from cablecast.policies.base import check_targets
from cablecast.policies.candidates import Candidates
from cablecast.policies.ensemble import EnsembleLandings
from cablecast.policies.expected_loss import expected_loss
from cablecast.policies.experience import Experience
from cablecast.policies.forward_search import TABLE_MARGIN, ForwardSearchPolicy
from cablecast.policies.landing_predictor import LandingPredictor
from cablecast.policies.moved_landings import MovedLandings
from cablecast.policies.refinement import refine_actions, within_ranges
from cablecast.policies.sight import lost_chance
from cablecast.tuning.tracks import MeasuredTracks

# The choice narrows in three steps: candidates whose simulated landings are nearest (at least
# _NEIGHBOR_COUNT, more while candidates times casts stay below _PAIR_COUNT); of these, those whose
# expected landings are nearest, which the ensemble judges; of these, those with the least expected
# miss. Without an ensemble, judging more than the last few selects for the simulator's own errors.
_NEIGHBOR_COUNT, _PAIR_COUNT, _JUDGED_COUNT, _SHORTLIST_COUNT = 3000, 5_000_000, 64, 16
# Casts that an aimer for one target knows at most.
_NEAR_COUNT = 20
# Earlier casts that came this near to a target [cable lengths] are candidates, too.
_EARLIER_COUNT, _EARLIER_REACH = 4, 0.3
# Newton steps of a correction, and the parts of it that are tried until the arm can follow.
_NEWTON_STEPS, _FRACTIONS = 4, (1.0, 0.5, 0.25)
# Parts of the way from a candidate to the action that is expected on the target.
_PARTS = (1.0, 0.75, 0.5, 0.25, 0.0)

# Distances from the edge of a blind place at which casts at a target in it are aimed, too [m].
_BLIND_MARGINS = (0.02, 0.06)


class Aimer:
    """A policy that learns from each of its casts.

    Args:
        policy: Policy of simulated casts alone.
        believed: Scales of the residual that are expected before any cast; the defaults where None.
        size: By how much more casts to one place may miss than to another; from the sensitivity of
            the policy's candidates where None.
        ensemble: Simulators of other physics, by which a cast is judged; by its place where None.

    Attributes:
        predictor: Predictor of landings, which learns from the casts.
        casts: Casts that it learned from.
    """

    def __init__(
        self,
        policy: ForwardSearchPolicy,
        believed: ResidualScales | None = None,
        size: LocalSize | None = None,
        ensemble: EnsembleLandings | None = None,
    ):
        self.predictor = LandingPredictor(policy, Experience(believed), size, ensemble)
        self.casts: list[AimedCast] = []

    def copy(self) -> "Aimer":
        """Return an aimer that knows the same casts and learns on its own."""
        other = copy.copy(self)
        other.casts = list(self.casts)
        other.predictor = self.predictor.with_experience(self.experience.copy())
        return other

    def emptied(self, ensemble: EnsembleLandings | None = None) -> "Aimer":
        """Return an aimer of the same policy and beliefs that has not learned from any cast.

        Args:
            ensemble: Simulators that it judges casts by; the present ones where None.
        """
        other = copy.copy(self)
        fresh = Experience(self.experience.residual.believed)
        other.casts, other.predictor = [], self.predictor.with_experience(fresh, ensemble)
        return other

    def taught(self, tracks: MeasuredTracks, target_xy: NDArray[np.float64]) -> "Aimer":
        """Return an aimer for one target whose simulators learned from some casts, too.

        Simulators that follow the casts near a target predict better what a small change of these
        does. Elsewhere they are no better than before, so casts far from the target are left out,
        which saves the time to simulate them.

        Args:
            tracks: Casts near the target that the simulators were not fitted to.
            target_xy: Target [m], shape [2].
        """
        ensemble = self.predictor.ensemble
        if ensemble is None:
            return self
        other = self.emptied(ensemble.taught(tracks))
        known = other.experience
        known.residual = dataclasses.replace(known.residual, scales=self.experience.residual.scales)
        near = self._near(target_xy)
        ages = iter(self.experience.ages)
        known_ages = [next(ages) if cast.landed else 1.0 for cast in self.casts]
        other.casts = [self.casts[k] for k in near]
        other.predictor.learn(other.casts, [known_ages[k] for k in near])
        return other

    def _near(self, target_xy: NDArray[np.float64]) -> NDArray[np.int_]:
        """Return the rows of the casts that tell most of a target, in ascending order.

        A cast is near if it was aimed there or landed there. One without a landing counts where the
        network expects it.
        """
        actions, hands = rightward(np.array([cast.action for cast in self.casts]))
        landings = np.array([cast.endpoint_xy for cast in self.casts])
        expected = to_right(self.predictor.model.predict(actions), hands)
        ends = np.where(np.isfinite(landings), landings, expected)
        aims = np.array([cast.target_xy for cast in self.casts])
        far = np.fmin(*(np.linalg.norm(xy - target_xy, axis=1) for xy in (ends, aims)))
        return np.sort(np.argsort(far, kind="stable")[:_NEAR_COUNT])

    def learn(self, casts: list[AimedCast], *, refit: bool = True) -> None:
        """Take casts into account, in the order in which they were made.

        Args:
            casts: Casts with or without a landing.
            refit: Whether the scales of the process are fitted anew.
        """
        self.predictor.learn(casts)
        self.casts += casts
        if refit and casts:
            self.experience.refit()

    @property
    def policy(self) -> ForwardSearchPolicy:
        """Policy of simulated casts alone."""
        return self.predictor.policy

    @property
    def experience(self) -> Experience:
        """Residuals of real casts about the simulated landings."""
        return self.predictor.experience

    def choose(
        self, target_xy: ArrayLike, *, tried: bool = False, sight: CameraSight | None = None
    ) -> AimChoice:
        """Choose the action with the least expected loss.

        Args:
            target_xy: Target [m], shape [2].
            tried: True if earlier casts were aimed at this target. A small change of one of them
                nearly always wins, so fewer other candidates are judged.
            sight: Limits of the camera's sight; unknown where None.

        Raises:
            TargetError: The target is not finite, out of reach, or off the table.
        """
        target = check_targets(self.policy.setup, target_xy)[0]
        goals = [target]
        if sight is not None and sight.is_blind_at(target):
            goals += [sight.seen_near(target, margin) for margin in _BLIND_MARGINS]
        some = Candidates.join([self._candidates(goal, tried) for goal in goals])
        risk, failure = self._risks(some, target, sight)
        if self.predictor.ensemble is not None:
            # Moved actions still carry the judgement of the action that they started from.
            few = np.argsort(risk)[:_SHORTLIST_COUNT]
            some = self.predictor.judge(some.actions[few], some.hands[few])
            risk, failure = self._risks(some, target, sight)
        best = int(np.argmin(risk))
        if not np.isfinite(risk[best]):
            raise InputError("the arm can follow none of the policy's actions near this target")
        action = played(some.actions, some.hands)[best]
        xy, covariance, scatter = self.predictor.predict(action)
        return AimChoice(
            target_xy=target,
            action=action,
            expected_xy=xy[0],
            covariance=covariance[0],
            scatter=float(scatter[0]),
            failure=float(failure[best]),
            inside_coverage=bool(self.policy.inside_coverage(target)),
        )

    def _risks(
        self, some: Candidates, target: NDArray[np.float64], sight: CameraSight | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the expected loss of candidates, and their chance of no landing, [action].

        The loss of one that the arm cannot follow, or that leaves the table, is infinite.
        """
        places, landing_xy, variance = self.predictor.expected(some)
        variance = variance + self.experience.scatter(places)
        length = self.predictor.length
        distance = np.linalg.norm(landing_xy - to_right(target, some.hands), axis=1) / length
        motions = played(some.actions, some.hands)
        deviation = length * np.sqrt(variance)
        setup = self.policy.setup
        lost = lost_chance(motions, to_right(landing_xy, some.hands), deviation, setup, sight)
        seen = (1.0 - lost) * (1.0 - some.leaving)
        failure = 1.0 - seen * (1.0 - self.experience.failure_chance(places))
        risk = expected_loss(distance, variance, failure)
        stays = self.predictor.model.predict_margin(some.actions) >= self._table_margin
        # A candidate that somebody else chose may be beyond the arm's limits.
        risk[~(stays & check_actions(some.actions, setup).mask)] = np.inf
        return risk, failure

    def _candidates(self, target: NDArray[np.float64], tried: bool) -> Candidates:
        """Return promising actions, those that are expected on the target, and some in between.

        The uncertainty grows with the change of an action, so a part of the way to the target may
        miss by less than all of it.
        """
        starts = self._shortlist(target, tried)
        ends = self._moved(starts, target)
        if self.predictor.ensemble is not None:
            # The judgement changes over a long step: judge again, and take another one.
            ends = self._moved(self.predictor.judge(ends.actions, ends.hands), target)
        some = Candidates.join([starts.towards(ends, part) for part in _PARTS])
        return some.at(within_ranges(some.actions))

    def _moved(self, some: Candidates, target: NDArray[np.float64]) -> Candidates:
        """Return candidates near others that are expected to land on the target."""
        sensitivity = self.predictor.sensitivities(some.actions)
        moved, _ = refine_actions(
            some.actions,
            to_right(target, some.hands),
            self.predictor.changes,
            model=MovedLandings(some, sensitivity, self.predictor.landings, self.predictor.model),
            table_margin=self._table_margin,
            iterations=_NEWTON_STEPS,
            fractions=_FRACTIONS,
        )
        return some.at(moved)

    @property
    def _table_margin(self) -> float:
        """Distance that the free end must keep within the table's edges [m]."""
        return float(self.policy.info.get("table_margin", TABLE_MARGIN))

    def _shortlist(self, target: NDArray[np.float64], tried: bool) -> Candidates:
        """Return the most promising candidates of the policy, and earlier actions, for a target."""
        side = -1.0 if target[0] < 0 else 1.0
        places, actions, simulated_xy, turns = self._known_candidates
        # The candidates land on the right: for a target on the left all are mirrored.
        hands = side * turns
        goals = to_right(target, hands)
        distance = np.linalg.norm(simulated_xy - goals, axis=1)
        count = max(_NEIGHBOR_COUNT, _PAIR_COUNT // max(1, len(self.casts)))
        near = np.argsort(distance)[:count]
        some = places[near]
        some.inputs[:, -1] = hands[near]
        mean = self.experience.residual.means(some)
        distance = np.linalg.norm(
            simulated_xy[near] + self.predictor.length * mean - goals[near], axis=1
        )
        earlier = self._earlier(target)
        few = self.predictor.ensemble is None or (tried and len(earlier) > 0)
        kept = _SHORTLIST_COUNT if few else _JUDGED_COUNT
        short = near[np.argsort(distance)[:kept]]
        chosen = self.predictor.judge(actions[short], hands[short])
        if len(chosen) > _SHORTLIST_COUNT:
            chosen = self._least_missing(chosen, target)
        return Candidates.join([chosen, self.predictor.judge(*rightward(earlier))])

    def _least_missing(self, some: Candidates, target: NDArray[np.float64]) -> Candidates:
        """Return the candidates with the least expected miss as they are."""
        _, landing_xy, variance = self.predictor.expected(some)
        offset = (landing_xy - to_right(target, some.hands)) / self.predictor.length
        square = np.sum(offset**2, axis=1) + 2.0 * variance
        # A cast without a landing misses by as much as one that lands a cable's length away.
        square = (1.0 - some.leaving) * square + some.leaving
        return some[np.argsort(square)[:_SHORTLIST_COUNT]]

    @functools.cached_property
    def _known_candidates(self) -> tuple[Places, NDArray, NDArray, NDArray]:
        """Places of the policy's candidates, actions and landings to the right [m], and hands."""
        policy = self.policy
        actions, turns = rightward(policy.actions)
        simulated_xy = to_right(policy.predicted_xy, turns)
        unjudged = Candidates.unjudged(actions, turns)
        return (
            self.predictor.places(
                unjudged, simulated_xy, policy.sensitivity / self.predictor.usual_sensitivity
            ),
            actions,
            simulated_xy,
            turns,
        )

    def _earlier(self, target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the actions that landed nearest to a target, shape [action, 4]."""
        landed = [cast for cast in self.casts if cast.landed]
        miss = [
            float(np.linalg.norm(cast.endpoint_xy - target)) / self.predictor.length
            for cast in landed
        ]
        near = [k for k in np.argsort(miss)[:_EARLIER_COUNT] if miss[k] < _EARLIER_REACH]
        return np.array([landed[k].action for k in near]).reshape(-1, 4)
