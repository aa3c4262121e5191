"""Aimer: chooses casts under uncertainty, and learns from every one of them.

The landings of a policy's candidates are known from the simulator. Others of different physics that
follow the same casts (`EnsembleLandings`) tell which of them to trust. A Gaussian process adds what
real casts showed (`Experience`), and says how surely. For a target the aimer takes the action with
the least expected loss, from the distance left, the uncertainty of the prediction, the scatter
of the action, and the chance of a cast that ends out of sight. After a cast near a target the
process is almost certain there, so the next action is a small step from the last one, damped by the
scatter as in a Kalman filter. An action that scatters more than expected, or stays far off, loses
this advantage to others.
"""

import copy
import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.errors import InputError
from cablecast.models.features import deviations
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
from cablecast.policies.moved_landings import MovedLandings
from cablecast.policies.refinement import refine_actions, within_ranges
from cablecast.policies.shakes import log_shakes
from cablecast.policies.sight import lost_chance
from cablecast.tuning.tracks import MeasuredTracks

# Candidates whose simulated landings are nearest: at least so many, and so many pairs of one and
# a cast. Of these, those whose expected landings are nearest, which the ensemble judges; and of
# these, those with the least expected miss. Without an ensemble more than these would find actions
# that the simulator is too sure of (`LocalSize`).
_NEIGHBOR_COUNT, _PAIR_COUNT, _JUDGED_COUNT, _SHORTLIST_COUNT = 3000, 5_000_000, 64, 16
# Casts that an aimer for one target knows at most; candidates that tell the local size.
_NEAR_COUNT, _SIZE_COUNT = 20, 400
# Earlier casts that came this near to a target [cable lengths] are candidates, too.
_EARLIER_COUNT, _EARLIER_REACH = 4, 0.3
# Newton steps of a correction, and the parts of it that are tried until the arm can follow.
_NEWTON_STEPS, _FRACTIONS = 4, (1.0, 0.5, 0.25)
# Parts of the way from a candidate to the action that is expected on the target.
_PARTS = (1.0, 0.75, 0.5, 0.25, 0.0)
# Share of the scatter that lies along the shifts of the landing with the action, the rest is round.
_ALONG = 0.5


class Aimer:
    """A policy that learns from each of its casts.

    Args:
        policy: Policy of simulated casts alone.
        believed: Scales of the residual that are expected before any cast; the defaults where None.
        size: By how much more casts to one place may miss than to another; from the sensitivity of
            the policy's candidates where None.
        ensemble: Simulators of other physics, by which a cast is judged; by its place where None.

    Attributes:
        experience: What real casts added to the simulated landings.
        casts: Casts that it learned from.
        ensemble: Simulators of other physics, or None.
    """

    def __init__(
        self,
        policy: ForwardSearchPolicy,
        believed: ResidualScales | None = None,
        size: LocalSize | None = None,
        ensemble: EnsembleLandings | None = None,
    ):
        self.policy = policy
        self.model = policy.model
        self.length = policy.setup.cable.length
        self.experience = Experience(believed)
        self.casts: list[AimedCast] = []
        self.ensemble = ensemble
        self._changes = deviations(policy.actions)
        self._usual = float(np.median(policy.sensitivity))
        xy, values = policy.predicted_xy, policy.sensitivity
        some = slice(None, None, max(1, len(values) // _SIZE_COUNT))
        self.size = size or LocalSize(landing_xy=xy[some], values=values[some])

    def copy(self) -> "Aimer":
        """Return an aimer that knows the same casts and learns on its own."""
        other = copy.copy(self)
        other.casts, other.experience = list(self.casts), self.experience.copy()
        return other

    def emptied(self) -> "Aimer":
        """Return an aimer of the same policy and beliefs that has not learned from any cast."""
        other = copy.copy(self)
        other.casts, other.experience = [], Experience(self.experience.residual.believed)
        return other

    def taught(self, tracks: MeasuredTracks, target_xy: NDArray[np.float64]) -> "Aimer":
        """Return an aimer for one target whose simulators learned from some casts, too.

        Simulators that were moved towards casts near a target say better what a small change of
        these does. Elsewhere they are no better than before, so casts that landed far from the
        target are left out: what simulators say of a cast takes time.

        Args:
            tracks: Casts near the target that the simulators were not fitted to.
            target_xy: Target [m], shape [2].
        """
        if self.ensemble is None:
            return self
        other = self.emptied()
        other.ensemble = self.ensemble.taught(tracks)
        known = other.experience
        known.residual = dataclasses.replace(known.residual, scales=self.experience.residual.scales)
        # A cast without a landing may have been near.
        ends = np.array([c.endpoint_xy if c.landed else target_xy for c in self.casts])
        far = np.linalg.norm(ends.reshape(-1, 2) - target_xy, axis=1)
        near = np.sort(np.argsort(far, kind="stable")[:_NEAR_COUNT])
        ages = iter(self.experience.ages)
        known_ages = [next(ages) if cast.landed else 1.0 for cast in self.casts]
        other._add([self.casts[k] for k in near], [known_ages[k] for k in near])
        return other

    def learn(self, casts: list[AimedCast], *, refit: bool = True) -> None:
        """Take casts into account, in the order in which they were made.

        Args:
            casts: Casts with or without a landing.
            refit: Whether the scales of the process are fitted anew.
        """
        self._add(casts, [None] * len(casts))
        if refit and casts:
            self.experience.refit()

    def _add(self, casts: Sequence[AimedCast], ages: Sequence[float | None]) -> None:
        """Add casts to what is known, with the factors of their noise where these are known."""
        if casts:
            # All at once takes hardly longer than one.
            self._judge(*rightward(np.array([cast.action for cast in casts])))
        for cast, age in zip(casts, ages, strict=True):
            place, simulated_xy, hand = self._place(cast.action)
            landing = cast.endpoint_xy * np.array([hand, 1.0])
            residual = (landing - simulated_xy) / self.length if cast.landed else None
            self.experience.add(place, residual, fitted=cast.fitted, aimed=cast.aimed, age=age)
            self.casts.append(cast)

    def _place(self, action: NDArray[np.float64]) -> tuple[Places, NDArray[np.float64], float]:
        """Return the place of a cast, its simulated landing to the right [m], and its hand."""
        cast = self._judge(*rightward(action[None]))
        simulated_xy = self._simulated(cast)
        sensitivity = self.sensitivities(cast.actions)
        return self._places(cast, simulated_xy, sensitivity), simulated_xy[0], float(cast.hands[0])

    def _judge(self, actions: NDArray[np.float64], hands: NDArray[np.float64]) -> Candidates:
        """Return actions to the right with what the ensemble says of them, if there is one."""
        if self.ensemble is None:
            return Candidates.unjudged(actions, hands)
        said = self.ensemble.judge(actions, hands)
        return Candidates(
            actions=actions,
            hands=hands,
            shifts=said.shifts,
            leaving=said.leaving,
            log_sizes=np.log(said.sizes / self.size.usual),
            frictions=said.frictions,
        )

    def _simulated(self, some: Candidates) -> NDArray[np.float64]:
        """Return the simulated landings of candidates [m], shape [action, 2]."""
        return self.model.predict(some.actions) + self.length * some.shifts

    def _places(
        self,
        some: Candidates,
        simulated_xy: NDArray[np.float64],
        sensitivity: NDArray[np.float64],
    ) -> Places:
        """Return the places of candidates.

        Of two actions that land at one place the ensemble may trust one more. It is right by half:
        the action that it trusts most is trusted too much (docs/aim.md).
        """
        usual = self.size.log_sizes(simulated_xy)
        own = np.where(np.isnan(some.log_sizes), usual, some.log_sizes)
        inputs = np.hstack(
            [
                self.model.normalize(some.actions).astype(float),
                self.model.normalize_endpoints(simulated_xy),
                some.hands[:, None],
            ]
        )
        return Places(
            inputs=inputs,
            log_sizes=0.5 * (usual + own),
            log_shakes=log_shakes(sensitivity, some.frictions),
            frictions=some.frictions,
        )

    def sensitivities(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return sensitivities of the landing to the action over the usual one, shape [action].

        Args:
            actions: Actions to the right, shape [action, 4].
        """
        return self.model.sensitivity(actions, self._changes) / self._usual

    def predict(
        self, actions: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Predict landings.

        Args:
            actions: Actions on either side, shape [action, 4].

        Returns:
            Expected landings [m], shape [action, 2]; their covariances, scatter included [m²],
            shape [action, 2, 2]; standard deviation of equal casts along each axis [m], shape
            [action].
        """
        actions = np.atleast_2d(np.asarray(actions, dtype=float))
        rows = [self._predict_one(action) for action in actions]
        xy, covariance, scatter = zip(*rows, strict=True)
        return np.array(xy), np.array(covariance), np.array(scatter)

    def _predict_one(self, action: NDArray[np.float64]):
        place, simulated_xy, hand = self._place(action)
        mean, variance = self.experience.residual.predict(place)
        scatter = self.experience.scatter(place)
        actions, _ = rightward(action[None])
        shifts = self.model.landing_shifts(actions, self._changes)[0]
        along = shifts @ shifts.T / max(float(np.sum(shifts**2)), 1e-12)
        shape = (1.0 - _ALONG) * np.eye(2) + 2.0 * _ALONG * along
        covariance = (variance[0] + scatter[0]) * self.length**2 * shape
        flip = np.array([hand, 1.0])
        xy = flip * (simulated_xy + self.length * mean[0])
        return xy, covariance * np.outer(flip, flip), float(np.sqrt(scatter[0])) * self.length

    def choose(self, target_xy: ArrayLike, *, tried: bool = False) -> AimChoice:
        """Choose the action with the least expected loss.

        Args:
            target_xy: Target [m], shape [2].
            tried: True if earlier casts were aimed at this target. A small change of one of them
                nearly always wins, so fewer other candidates are judged.

        Raises:
            TargetError: The target is not finite, out of reach, or off the table.
        """
        target = check_targets(self.policy.setup, target_xy)[0]
        some = self._candidates(target, tried)
        risk, failure = self._risks(some, target)
        if self.ensemble is not None:
            # Of actions that were moved it said what is true of those nearby.
            few = np.argsort(risk)[:_SHORTLIST_COUNT]
            some = self._judge(some.actions[few], some.hands[few])
            risk, failure = self._risks(some, target)
        best = int(np.argmin(risk))
        if not np.isfinite(risk[best]):
            raise InputError("the arm can follow none of the policy's actions near this target")
        action = played(some.actions, some.hands)[best]
        xy, covariance, scatter = self.predict(action)
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
        self, some: Candidates, target: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the expected loss of candidates, and their chance of no landing, [action].

        The loss of one that the arm cannot follow, or that leaves the table, is infinite.
        """
        places, landing_xy, variance = self._expected(some)
        variance = variance + self.experience.scatter(places)
        distance = np.linalg.norm(landing_xy - to_right(target, some.hands), axis=1) / self.length
        motions = played(some.actions, some.hands)
        deviation = self.length * np.sqrt(variance)
        setup = self.policy.setup
        lost = lost_chance(motions, to_right(landing_xy, some.hands), deviation, setup)
        seen = (1.0 - lost) * (1.0 - some.leaving)
        failure = 1.0 - seen * (1.0 - self.experience.failure_chance(places))
        risk = expected_loss(distance, variance, failure)
        stays = self.model.predict_margin(some.actions) >= self._table_margin
        # A candidate that somebody else chose may be beyond the arm's limits.
        risk[~(stays & check_actions(some.actions, setup).mask)] = np.inf
        return risk, failure

    def _expected(
        self, some: Candidates
    ) -> tuple[Places, NDArray[np.float64], NDArray[np.float64]]:
        """Return places, landings to the right [m] and their variance without scatter."""
        simulated_xy = self._simulated(some)
        sensitivity = self.sensitivities(some.actions)
        places = self._places(some, simulated_xy, sensitivity)
        mean, variance = self.experience.residual.predict(places)
        return places, simulated_xy + self.length * mean, variance

    def _landings(self, some: Candidates, sensitivity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the expected landings of candidates to the right [m], shape [action, 2]."""
        simulated_xy = self._simulated(some)
        places = self._places(some, simulated_xy, sensitivity)
        return simulated_xy + self.length * self.experience.residual.means(places)

    def _candidates(self, target: NDArray[np.float64], tried: bool) -> Candidates:
        """Return promising actions, those that are expected on the target, and some in between.

        What is known of an action holds the less, the farther it is changed: a part of the way to
        the target may miss by less than all of it.
        """
        starts = self._shortlist(target, tried)
        ends = self._moved(starts, target)
        if self.ensemble is not None:
            # It says something else of an action that was moved far.
            ends = self._moved(self._judge(ends.actions, ends.hands), target)
        some = Candidates.join([starts.towards(ends, part) for part in _PARTS])
        return some.at(within_ranges(some.actions))

    def _moved(self, some: Candidates, target: NDArray[np.float64]) -> Candidates:
        """Return candidates near others that are expected to land on the target."""
        sensitivity = self.sensitivities(some.actions)
        moved, _ = refine_actions(
            some.actions,
            to_right(target, some.hands),
            self._changes,
            model=MovedLandings(some, sensitivity, self._landings, self.model),
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
        distance = np.linalg.norm(simulated_xy[near] + self.length * mean - goals[near], axis=1)
        earlier = self._earlier(target)
        few = self.ensemble is None or (tried and len(earlier) > 0)
        kept = _SHORTLIST_COUNT if few else _JUDGED_COUNT
        short = near[np.argsort(distance)[:kept]]
        chosen = self._judge(actions[short], hands[short])
        if len(chosen) > _SHORTLIST_COUNT:
            chosen = self._least_missing(chosen, target)
        return Candidates.join([chosen, self._judge(*rightward(earlier))])

    def _least_missing(self, some: Candidates, target: NDArray[np.float64]) -> Candidates:
        """Return the candidates with the least expected miss as they are."""
        _, landing_xy, variance = self._expected(some)
        offset = (landing_xy - to_right(target, some.hands)) / self.length
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
            self._places(unjudged, simulated_xy, policy.sensitivity / self._usual),
            actions,
            simulated_xy,
            turns,
        )

    def _earlier(self, target: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the actions that landed nearest to a target, shape [action, 4]."""
        landed = [cast for cast in self.casts if cast.landed]
        miss = [float(np.linalg.norm(cast.endpoint_xy - target)) / self.length for cast in landed]
        near = [k for k in np.argsort(miss)[:_EARLIER_COUNT] if miss[k] < _EARLIER_REACH]
        return np.array([landed[k].action for k in near]).reshape(-1, 4)
