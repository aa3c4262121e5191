"""LandingPredictor: where casts are expected to land, and how surely.

In another task than a landing, its outcome stands for the landing, over `Task.units` [m].

A policy's network approximates where every action lands in a simulator. Where the best simulator of
the cable has simulated an action, its own landing is used, and the network only says how the
landing of an action nearby differs from it. Simulators of different physics tell how far off it may
be (`Tuned`). A Gaussian process adds what real casts showed (`Experience`).
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.aiming.polar import PolarLandings
from cablecast.aiming.residual import ArrayRows, Experience, LocalSize, Places, ResidualScales
from cablecast.cast import Cast
from cablecast.conventions import Array
from cablecast.errors import InputError
from cablecast.learning.landing import LandingModel, deviations
from cablecast.learning.policy import ForwardSearchPolicy
from cablecast.motion.action import mirror_to_right
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.polar import PolarCast
from cablecast.tuning.tracks import MeasuredTracks
from cablecast.tuning.tuned import Tuned

TYPICAL_FRICTION, DELICATE = 1.7, 0.065
"""Shift of the landing per relative change of the friction [cable lengths], where 1 degree, 1 cm
and 1 % of the pace together shift it by so many cable lengths. It grows with the square of that."""

SPREAD_COUNT = 120
"""Simulated casts by which to judge how far apart the simulators of an ensemble typically land."""
_SPREAD_SEED = 7

# Casts that a predictor for one target is conditioned on at most.
_NEAR_COUNT = 20
# Shares of a typical cast's variance that go with the action and with the friction.
_ACTION_SHARE, _FRICTION_SHARE = 0.1, 0.9
_SCATTER_MIN = 1e-6
# Candidates of the policy that tell the local size.
_SIZE_COUNT = 400
# Share of the scatter that lies along the shifts of the landing with the action, the rest is round.
_ALONG = 0.5


@dataclasses.dataclass(frozen=True, kw_only=True)
class Candidates(ArrayRows):
    """Actions mirrored to the right, the side that each is cast to, and their simulated landings.

    Attributes:
        actions: (theta1, theta2, r2, psi, pace) [rad, rad, m, rad, -], shape [action, 5].
        side: +1 right, -1 left, shape [action].
        shifts: Landing in the best simulator minus that of the network [cable lengths], shape
            [action, k]; 0 without an ensemble, shape [action, 1].
        leaving: Chance that the free end passes an edge of the table, 0 without an ensemble [-],
            shape [action].
        log_sizes: Logarithm of the size of a miss over the typical one, NaN without an
            ensemble, shape [action].
        frictions: Shift of the landing per relative change of the friction [cable lengths], shape
            [action]; without an ensemble, estimated from the sensitivity to the action.
    """

    actions: Array
    side: Array
    shifts: Array
    leaving: Array
    log_sizes: Array
    frictions: Array

    @classmethod
    def unsimulated(cls, actions: Array, side: Array, sensitivity: Array) -> "Candidates":
        """Return candidates that no ensemble has simulated.

        `sensitivity` is that to the action over the typical one [-], shape [action].
        """
        return cls(
            actions=actions,
            side=side,
            shifts=np.zeros((len(actions), 1)),
            leaving=np.zeros(len(actions)),
            log_sizes=np.full(len(actions), np.nan),
            frictions=TYPICAL_FRICTION * sensitivity**2,
        )

    def at(self, actions: Array) -> "Candidates":
        """Return actions near these, with the same estimates."""
        return dataclasses.replace(self, actions=actions)

    def towards(self, others: "Candidates", part: float) -> "Candidates":
        """Return candidates at a part of the way from each of these to its counterpart."""

        def between(name: str) -> Array:
            start = getattr(self, name)
            return start + part * (getattr(others, name) - start)

        names = ("actions", "shifts", "leaving", "log_sizes", "frictions")
        return Candidates(side=self.side, **{name: between(name) for name in names})


def log_scatters(sensitivities: Array, frictions: Array) -> Array:
    """Return the logarithm of the scatter of equal casts over a typical cast's, shape [action].

    Small differences from cast to cast move a landing as a change of the action does, and as a
    change of the friction does: a cable that slides far, or that just tips over, is moved by
    either. docs/aim-results.md has how well the two rank the scatter of casts.

    Args:
        sensitivities: Sensitivity to the action over the typical one [-], shape [action].
        frictions: Shift per relative change of the friction [cable lengths], shape [action].
    """
    action = _ACTION_SHARE * sensitivities**2
    friction = _FRICTION_SHARE * (frictions / TYPICAL_FRICTION) ** 2
    return np.log(np.maximum(np.sqrt(action + friction), _SCATTER_MIN))


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Beliefs:
    """What is believed of landings before any cast is compared with them.

    Attributes:
        policy: Policy of simulated casts alone.
        tuned: Fit that they were simulated with. If None, nothing is known of the simulator, whose
            landings are taken to be as far off as those of one that follows some casts typically.
        fitted_to: Casts that the simulator was fitted to: their number, if they are the first ones
            of the session; the fingerprint of their dataset, empty if it is unknown; None before
            any cast.
        spread_count: Simulated casts by which to judge how far apart the simulators typically land.

    Raises:
        InputError: The policy has learned from real casts.
    """

    policy: ForwardSearchPolicy
    tuned: Tuned | None = None
    fitted_to: int | str | None = ""
    spread_count: int = SPREAD_COUNT

    def __post_init__(self):
        if self.policy.model.has_real_casts:
            raise InputError(
                "aiming learns from real casts itself: give it a policy of simulated casts alone"
            )

    def has_fitted(self, number: int, cast: Cast) -> bool:
        """Return whether the simulator was fitted to a cast of the session."""
        if isinstance(self.fitted_to, int):
            return number < self.fitted_to
        return bool(self.fitted_to) and cast.origin.partition("/")[0] == self.fitted_to

    @property
    def ensemble(self) -> Tuned | None:
        """Simulators that evaluate each single cast; None where the fit has none."""
        return self.tuned if self.tuned is not None and self.tuned.members else None

    @functools.cached_property
    def size(self) -> LocalSize:
        """By how much more casts to one place may miss than to another."""
        if (ensemble := self.ensemble) is None:
            every = slice(None, None, max(1, len(self.policy.sensitivity) // _SIZE_COUNT))
            return LocalSize(
                landing_xy=self.policy.predicted_xy[every], values=self.policy.sensitivity[every]
            )
        actions = feasible_uniform(
            self.spread_count, ensemble.setup, self.model.action_ranges, seed=_SPREAD_SEED
        )
        found = ensemble.landings(*mirror_to_right(actions), self.model.task)
        finite = np.isfinite(found.landing_xy).all(axis=1)
        return LocalSize(landing_xy=found.landing_xy[finite], values=found.sizes[finite])

    @functools.cached_property
    def scales(self) -> ResidualScales:
        """Scales of real landings about the simulated ones."""
        prior = ResidualScales()
        if self.ensemble is None:
            return prior
        # Casts that scatter cannot be followed more closely than they scatter.
        smaller = min(1.0, self.ensemble.factor)
        return dataclasses.replace(
            prior,
            amplitude=self.size.typical,
            noise=np.sqrt(smaller) * prior.noise,
            friction=smaller * prior.friction,
        )

    @property
    def model(self) -> LandingModel:
        """Network that learned the simulated landings."""
        return self.policy.model

    @property
    def length(self) -> float:
        """Length of the cable [m]."""
        return self.policy.setup.cable.length

    @functools.cached_property
    def changes(self) -> Array:
        """Changes of an action that sensitivities are measured with, shape [change, 4]."""
        return deviations(self.policy.actions)

    @property
    def typical_sensitivity(self) -> float:
        """Sensitivity of a typical landing to these changes [m]."""
        return DELICATE * self.length

    def sensitivities(self, actions: Array) -> Array:
        """Return sensitivities to actions to the right over the typical one, shape [action]."""
        return self.model.sensitivity(actions, self.changes) / self.typical_sensitivity

    def simulated_xy(self, candidates: Candidates) -> Array:
        """Return the simulated landings of candidates to the right [m], shape [action, k]."""
        return self.model.predict(candidates.actions) + self.length * candidates.shifts

    def places(self, candidates: Candidates, simulated_xy: Array, sensitivity: Array) -> Places:
        """Return the places of candidates for the residuals of real casts.

        The ensemble may trust one of two actions more that land at one place. The size is the
        geometric mean of its own and the typical one there, because the action that it trusts most
        of many is trusted too much (docs/aim.md). `simulated_xy` are landings to the right [m].
        """
        typical = self.size.log_sizes(simulated_xy)
        own = np.where(np.isnan(candidates.log_sizes), typical, candidates.log_sizes)
        inputs = np.hstack(
            [
                self.model.normalize(candidates.actions).astype(float),
                self.model.normalize_endpoints(simulated_xy),
                candidates.side[:, None],
            ]
        )
        return Places(
            inputs=inputs,
            log_sizes=0.5 * (typical + own),
            log_scatters=log_scatters(sensitivity, candidates.frictions),
            frictions=candidates.frictions,
        )

    @functools.cached_property
    def policy_candidates(self) -> tuple[Candidates, Array, Places]:
        """The policy's candidates, their simulated landings to the right [m], and their places."""
        actions, side = mirror_to_right(self.policy.actions)
        sensitivity = self.policy.sensitivity / self.typical_sensitivity
        candidates = Candidates.unsimulated(actions, side, sensitivity)
        simulated_xy = self.model.task.mirrored(self.policy.predicted_xy, side)
        return candidates, simulated_xy, self.places(candidates, simulated_xy, sensitivity)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class LandingPredictor:
    """Landings of a policy's simulator, of an ensemble, and of real casts in one.

    Attributes:
        beliefs: What is believed before any cast.
        ensemble: Simulators that evaluate each single cast; None without.
        experience: Residuals of real casts about the simulated landings.
        casts: Casts that it is conditioned on.
        fitted: Whether the simulator was fitted to each: it then lands nearer to its prediction
            than others will, and says less.
        compared: Whether the end of each was compared with the simulated landing.
        polar: Landings of polar casts; None where none are made.
    """

    beliefs: Beliefs
    ensemble: Tuned | None
    experience: Experience
    casts: tuple[Cast, ...] = ()
    fitted: tuple[bool, ...] = ()
    compared: tuple[bool, ...] = ()
    polar: PolarLandings | None = None

    @classmethod
    def of(cls, beliefs: Beliefs, *, polar: bool = False) -> "LandingPredictor":
        """Return the predictor before any cast; `polar` tells whether it knows polar casts, too."""
        experience = Experience.empty(beliefs.scales, len(beliefs.model.units))
        found = PolarLandings.of(beliefs.ensemble, beliefs.model.task) if polar else None
        return cls(beliefs=beliefs, ensemble=beliefs.ensemble, experience=experience, polar=found)

    def with_casts(
        self,
        casts: Sequence[Cast],
        *,
        fitted: Sequence[bool] | None = None,
        ages: Sequence[float] | None = None,
        fit_scales: bool = False,
    ) -> "LandingPredictor":
        """Return the predictor after more casts, in the order in which they were made.

        A cast that left the table is taken to have landed there, unless the simulators expect that.

        Args:
            casts: Casts with or without a landing. Motions of no family are left out.
            fitted: Whether the simulator was fitted to each; to none if None.
            ages: Factors of their noise, shape [cast]; drifts are noticed if None.
            fit_scales: Whether the scales of the process are fitted anew.
        """
        if self.polar is not None:
            self = dataclasses.replace(self, polar=self.polar.with_casts(casts))
        rows = [row for row, cast in enumerate(casts) if isinstance(cast.action, Action)]
        known = [fitted is not None and bool(fitted[row]) for row in rows]
        experience = self.experience
        if not rows:
            fitted_anew = experience.with_fitted_scales() if fit_scales else experience
            return dataclasses.replace(self, experience=fitted_anew)
        # One batch takes barely longer than one cast.
        actions = np.array([casts[row].sweep for row in rows])
        candidates = self.evaluate(*mirror_to_right(actions))
        places, simulated_xy = self._located(candidates)
        table = self.beliefs.policy.setup.workspace
        task, units = self.beliefs.model.task, self.beliefs.model.units
        ends = np.array([casts[row].read(task, table) for row in rows]) / units
        ends = task.mirrored(ends, candidates.side)
        there = np.array([casts[row].landed for row in rows]) | (candidates.leaving < 0.5)
        compared = there & np.isfinite(ends).all(axis=1)
        residuals = (ends - simulated_xy) / self.beliefs.length
        for place, (row, is_fitted) in enumerate(zip(rows, known, strict=True)):
            experience = experience.with_cast(
                places[[place]],
                residuals[place] if compared[place] else None,
                fitted=is_fitted,
                aimed=casts[row].proposal is not None,
                age=None if ages is None else ages[row],
            )
        if fit_scales:
            experience = experience.with_fitted_scales()
        return dataclasses.replace(
            self,
            experience=experience,
            casts=(*self.casts, *(casts[row] for row in rows)),
            fitted=(*self.fitted, *known),
            compared=(*self.compared, *compared.tolist()),
        )

    def near(self, target_xy: Array, tracks: MeasuredTracks) -> "LandingPredictor":
        """Return a predictor for one goal whose simulators take a step towards some casts.

        Simulators that follow the casts near a target predict better what a small change of these
        does. Elsewhere they are no better than before, so casts far from the target are left out,
        which saves the time to simulate them. The simulators were not fitted to those of `tracks`.
        `target_xy` is the value of the goal, shape [k].
        """
        if self.ensemble is None or not self.casts:
            return self
        rows = self._rows_near(target_xy)
        start = LandingPredictor.of(self.beliefs)
        residual = dataclasses.replace(
            start.experience.residual, scales=self.experience.residual.scales
        )
        start = dataclasses.replace(
            start,
            ensemble=self.ensemble.updated(tracks),
            experience=dataclasses.replace(start.experience, residual=residual),
            polar=None,
        )
        ages = iter(self.experience.ages)
        age_of = [next(ages) if compared else 1.0 for compared in self.compared]
        found = start.with_casts(
            [self.casts[row] for row in rows],
            fitted=[self.fitted[row] for row in rows],
            ages=[age_of[row] for row in rows],
        )
        return dataclasses.replace(found, polar=self.polar)

    def _rows_near(self, target_xy: Array) -> NDArray[np.int_]:
        """Return the rows of the casts that tell most of a target, in ascending order.

        A cast is near if it was aimed there or landed there, and of two that are equally near the
        later one counts. One without a landing counts where the network expects it.
        """
        task, units = self.beliefs.model.task, self.beliefs.model.units
        actions, side = mirror_to_right(np.array([cast.sweep for cast in self.casts]))
        outcomes = np.array([cast.read(task) for cast in self.casts])
        expected = units * task.mirrored(self.beliefs.model.predict(actions), side)
        ends = np.where(np.isfinite(outcomes), outcomes, expected)
        goals = np.array([np.nan * units if c.goal is None else c.goal.value for c in self.casts])
        far = np.fmin(*(np.linalg.norm((x - target_xy) / units, axis=1) for x in (ends, goals)))
        return np.sort(np.lexsort((-np.arange(len(far)), far))[:_NEAR_COUNT])

    def evaluate(self, actions: Array, side: Array) -> Candidates:
        """Return candidates with what the ensemble says of them, if there is one."""
        if self.ensemble is None:
            return Candidates.unsimulated(actions, side, self.beliefs.sensitivities(actions))
        found = self.ensemble.landings(actions, side, self.beliefs.model.task)
        shifts = (found.landing_xy - self.beliefs.model.predict(actions)) / self.beliefs.length
        return Candidates(
            actions=actions,
            side=side,
            shifts=np.nan_to_num(shifts),
            leaving=found.leaving,
            log_sizes=np.log(found.sizes / self.beliefs.size.typical),
            frictions=found.frictions,
        )

    def expected(self, candidates: Candidates) -> tuple[Places, Array, Array]:
        """Return places, expected landings to the right [m], [action, k], and their variance.

        The variance is that along each axis without the scatter [square cable lengths], [action].
        """
        places, simulated_xy = self._located(candidates)
        mean, variance = self.experience.residual.predict(places)
        return places, simulated_xy + self.beliefs.length * mean, variance

    def landings(self, candidates: Candidates, sensitivity: Array) -> Array:
        """Return the expected landings of candidates of a sensitivity, to the right [m]."""
        simulated_xy = self.beliefs.simulated_xy(candidates)
        places = self.beliefs.places(candidates, simulated_xy, sensitivity)
        return simulated_xy + self.beliefs.length * self.experience.residual.means(places)

    def moved(self, cast: Cast) -> tuple[Array, float]:
        """Return the outcome that is expected of the motion of a cast, and its scatter [m].

        Raises:
            InputError: No family describes the motion, or none that is predicted.
        """
        if isinstance(cast.action, PolarCast) and self.polar is not None:
            found = self.polar.expectation(cast.action)
            return found.mean, found.scatter
        xy, _, scatter = self.predict(cast.sweep)
        return xy[0], float(scatter[0])

    def predict(self, actions: ArrayLike) -> tuple[Array, Array, Array]:
        """Predict the outcomes of actions on either side, shape [action, 5].

        Returns:
            Expected outcomes, shape [action, k], such as landings [m]; their covariances, scatter
            included, shape [action, k, k]; standard deviation of equal casts along each axis [m],
            shape [action].
        """
        candidates = self.evaluate(
            *mirror_to_right(np.atleast_2d(np.asarray(actions, dtype=float)))
        )
        places, landing_xy, variance = self.expected(candidates)
        scatter, length = self.experience.scatter(places), self.beliefs.length
        # A simulator that follows its casts badly misses by more than the process expects.
        if self.ensemble is not None:
            variance = variance * max(1.0, self.ensemble.factor) ** 2
        shifts = self.beliefs.model.landing_shifts(candidates.actions, self.beliefs.changes)
        along = shifts @ np.swapaxes(shifts, 1, 2)
        along /= np.maximum(np.sum(shifts**2, axis=(1, 2)), 1e-12)[:, None, None]
        count = landing_xy.shape[1]
        covariance = (1.0 - _ALONG) * np.eye(count) + count * _ALONG * along
        covariance *= (length**2 * (variance + scatter))[:, None, None]
        # Seen from the left, x and y vary together the other way.
        model = self.beliefs.model
        factor = model.task.mirrored(model.units, candidates.side)
        covariance *= factor[:, :, None] * factor[:, None, :]
        return factor * landing_xy, covariance, length * np.sqrt(scatter)

    def _located(self, candidates: Candidates) -> tuple[Places, Array]:
        """Return the places of candidates and their simulated landings to the right [m]."""
        simulated_xy = self.beliefs.simulated_xy(candidates)
        sensitivity = self.beliefs.sensitivities(candidates.actions)
        return self.beliefs.places(candidates, simulated_xy, sensitivity), simulated_xy
