"""AimedCast and AimChoice: a cast that an aimer learned from, and one that it proposes.

Candidates: actions among which an aimer chooses, and what an ensemble says of them.

Shakes: by how much more equal casts scatter than a usual cast.

Small differences from cast to cast move a landing as a change of the action does, and as a change
of the friction does: a cable that slides far, or that just tips over, is moved by either. How well
the two rank the scatter of casts is told in docs/aim-results.md.

Expected loss of a cast: what an aimer chooses by.

Chance that a cast has no landing: off the table, or where the camera cannot see the marker.

LandingPredictor: where casts are expected to land, and how surely.

A policy's network approximates where every action lands in a simulator. Where the best simulator of
the cable has played an action, its own landing is used, and the network only says how the landing
of an action nearby differs from it. Simulators of different physics tell how far off it may be
(`EnsembleLandings`). A Gaussian process adds what real casts showed (`Experience`).

MovedLandings: landings of candidates that are moved, as `refine_actions` asks for them.

Aimer: chooses casts under uncertainty, and learns from every one of them.

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
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.aiming.ensemble import EnsembleLandings
from cablecast.aiming.residual import ArrayRows, Experience, LocalSize, Places, ResidualScales
from cablecast.arm.shape import ArmShape, arm_shape, sight_clearance
from cablecast.camera.settings import CameraSight
from cablecast.conventions import mirror_xy
from cablecast.errors import InputError
from cablecast.learning.landing import LandingModel, central_shifts, deviations
from cablecast.learning.policy import (
    TABLE_MARGIN,
    ForwardSearchPolicy,
    refine_actions,
    within_ranges,
)
from cablecast.motion.action import mirror_actions, mirror_to_right
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import check_actions
from cablecast.setup import Setup
from cablecast.tuning.tracks import MeasuredTracks


@dataclasses.dataclass(frozen=True, kw_only=True)
class AimedCast:
    """A cast that the aimer learned from.

    Attributes:
        action: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [4].
        endpoint_xy: Landing [m], shape [2]; NaN for a cast without one.
        fitted: True if the simulator was fitted to it: it then lands nearer to its prediction than
            others will, and teaches less.
        target_xy: Target that it was aimed at [m], shape [2]; NaN for a cast without one.
    """

    action: NDArray[np.float64]
    endpoint_xy: NDArray[np.float64]
    fitted: bool = False
    target_xy: NDArray[np.float64] = dataclasses.field(default_factory=lambda: np.full(2, np.nan))

    @property
    def aimed(self) -> bool:
        """True if it was aimed at a target: other casts do not tell how far such casts miss."""
        return bool(np.all(np.isfinite(self.target_xy)))

    @property
    def landed(self) -> bool:
        """True if the cast has a landing."""
        return bool(np.all(np.isfinite(self.endpoint_xy)))


@dataclasses.dataclass(frozen=True, kw_only=True)
class AimChoice:
    """An action for a target, and what to expect of it.

    Attributes:
        target_xy: Target [m], shape [2].
        action: Action, shape [4].
        expected_xy: Expected landing [m], shape [2].
        covariance: Covariance of the landing, scatter included [m²], shape [2, 2].
        scatter: Standard deviation along each axis of equal casts [m].
        failure: Chance that the cast ends without a landing [-].
        inside_coverage: True if simulated casts land near the target.
    """

    target_xy: NDArray[np.float64]
    action: NDArray[np.float64]
    expected_xy: NDArray[np.float64]
    covariance: NDArray[np.float64]
    scatter: float
    failure: float
    inside_coverage: bool


USUAL_FRICTION = 1.7
"""Shift of a usual landing per relative change of the friction [cable lengths]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Candidates(ArrayRows):
    """Actions to the right and the sides to which they are cast.

    Attributes:
        actions: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [action, 4].
        side: +1, or -1 for actions that are cast to the left, shape [action].
        shifts: From the landing that the policy's network says to that in the best simulator, 0
            where there is no ensemble [cable lengths], shape [action, 2].
        leaving: Chance that the free end passes an edge of the table, as the ensemble says, 0 where
            there is none [-], shape [action].
        log_sizes: Logarithm of the size of a miss over the usual one, as the ensemble says, NaN
            where there is none, shape [action].
        frictions: Shift of the landing per relative change of the friction, a usual one where there
            is no ensemble [cable lengths], shape [action].
    """

    actions: NDArray[np.float64]
    side: NDArray[np.float64]
    shifts: NDArray[np.float64]
    leaving: NDArray[np.float64]
    log_sizes: NDArray[np.float64]
    frictions: NDArray[np.float64]

    @classmethod
    def unjudged(cls, actions: NDArray[np.float64], side: NDArray[np.float64]) -> "Candidates":
        """Return candidates of which no ensemble says anything."""
        return cls(
            actions=actions,
            side=side,
            shifts=np.zeros((len(actions), 2)),
            leaving=np.zeros(len(actions)),
            log_sizes=np.full(len(actions), np.nan),
            frictions=np.full(len(actions), USUAL_FRICTION),
        )

    def at(self, actions: NDArray[np.float64]) -> "Candidates":
        """Return actions near these, of which the same is taken to be true."""
        return dataclasses.replace(self, actions=actions)

    def towards(self, others: "Candidates", part: float) -> "Candidates":
        """Return candidates at a part of the way from each of these to one of others."""
        return Candidates(
            actions=self.actions + part * (others.actions - self.actions),
            side=self.side,
            shifts=self.shifts + part * (others.shifts - self.shifts),
            leaving=self.leaving + part * (others.leaving - self.leaving),
            log_sizes=self.log_sizes + part * (others.log_sizes - self.log_sizes),
            frictions=self.frictions + part * (others.frictions - self.frictions),
        )


# Shares of a usual cast's variance that go with the action and with the friction.
_ACTION_SHARE, _FRICTION_SHARE = 0.3, 0.7
_SHAKE_MIN = 1e-6


def log_shakes(
    sensitivities: NDArray[np.float64], frictions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the logarithm of the scatter of casts over that of a usual one, shape [action].

    Args:
        sensitivities: Sensitivity to the action over the usual one [-], shape [action].
        frictions: Shift per relative change of the friction [cable lengths], shape [action].
    """
    action = _ACTION_SHARE * sensitivities**2
    friction = _FRICTION_SHARE * (frictions / USUAL_FRICTION) ** 2
    return np.log(np.maximum(np.sqrt(action + friction), _SHAKE_MIN))


NEAR = 0.08
"""Miss beyond which it hardly matters how large a miss is [cable lengths]."""


def expected_loss(
    distance: NDArray[np.float64], variance: NDArray[np.float64], failure: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the expected loss of casts.

    The loss of a miss m is 1 - exp(-m² / (2 w²)) with w = `NEAR`, and 1 for a cast without a
    landing. Small misses count by their square, as in a Kalman filter. A large miss that is certain
    counts for as much as one that is only possible: it is no reason to stay.

    Args:
        distance: Distance from expected landing to target [cable lengths], shape [action].
        variance: Variance of the landing along each axis [square cable lengths], [action].
        failure: Chance of a cast without a landing [-], shape [action].

    Returns:
        Loss [-], shape [action].
    """
    width = NEAR**2 + variance
    near = NEAR**2 / width * np.exp(-(distance**2) / (2.0 * width))
    return 1.0 - (1.0 - failure) * near


CAMERA_HEIGHT = 2.2
"""Height of a camera above the middle of the table, where its place is not known [m]."""

MARKER_RADIUS = 0.015
"""Distance from the arm's outline at which a marker of usual size is half hidden [m]."""

# Points that stand for a round normal distribution: shares of equal probability, each at the
# distance from the middle that halves it.
_RINGS, _SPOKES = 4, 8


def lost_chance(
    actions: NDArray[np.float64],
    landing_xy: NDArray[np.float64],
    deviation: NDArray[np.float64],
    setup: Setup,
    sight: CameraSight | None = None,
) -> NDArray[np.float64]:
    """Return the chance that a landing lies off the table, or is not seen.

    What the resting arm hides is not seen, and what lies in a blind place of the camera.

    Args:
        actions: Actions on either side, shape [action, 4].
        landing_xy: Their expected landings [m], shape [action, 2].
        deviation: Standard deviation of the landings along each axis [m], shape [action].
        setup: Set-up with the arm and the table.
        sight: Limits of the camera's sight; those of a camera above the middle of the table,
            without blind places, where None.

    Returns:
        Chance [-], shape [action]. An arm that cannot follow an action hides nothing.
    """
    paths = cast_grip_paths(actions, setup)
    poses = paths.evaluate(paths.duration[:, None])[:, 0]
    still = np.zeros_like(poses)
    q = setup.arm.inverse_motion(poses, still, still).q
    points = landing_xy[:, None] + deviation[:, None, None] * _unit_points()
    count = points.shape[1]
    ground = np.concatenate([points, np.zeros((*points.shape[:2], 1))], axis=-1)
    table = setup.workspace
    if sight is None:
        middle = 0.5 * (table.y_min + table.y_max)
        sight = CameraSight(position=(0.0, middle, CAMERA_HEIGHT))
    shape = arm_shape(q, setup.arm)
    each = ArmShape(ends=np.repeat(shape.ends, count, axis=0), radii=shape.radii)
    clearance = sight_clearance(ground.reshape(-1, 3), sight.position, each).reshape(-1, count)
    unseen = (clearance < MARKER_RADIUS) | sight.is_blind_at(points)
    return np.mean(unseen | ~table.on_table(points), axis=1)


def _unit_points() -> NDArray[np.float64]:
    """Return points of a round normal distribution of deviation 1, shape [point, 2]."""
    share = (np.arange(_RINGS) + 0.5) / _RINGS
    radius = np.sqrt(-2.0 * np.log1p(-share))
    # Every other ring is turned by half a spoke.
    turn = (np.arange(_SPOKES) + 0.5 * (np.arange(_RINGS)[:, None] % 2)) * 2.0 * np.pi / _SPOKES
    ring = radius[:, None, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return ring.reshape(-1, 2)


# Candidates of the policy that tell the local size.
_SIZE_COUNT = 400
# Share of the scatter that lies along the shifts of the landing with the action, the rest is round.
_ALONG = 0.5


class LandingPredictor:
    """Landings of a policy's simulator, of an ensemble, and of real casts in one.

    Args:
        policy: Policy of simulated casts alone.
        experience: Residuals of real casts about the simulated landings.
        size: By how much more casts to one place may miss than to another; from the sensitivity of
            the policy's candidates where None.
        ensemble: Simulators of other physics, by which a cast is judged; by its place where None.

    Attributes:
        model: Network that learned the simulated landings.
        length: Length of the cable [m].
        changes: Changes of an action that sensitivities are measured with, shape [change, 4].
        usual_sensitivity: Sensitivity of a usual landing to these changes.
    """

    def __init__(
        self,
        policy: ForwardSearchPolicy,
        experience: Experience,
        size: LocalSize | None = None,
        ensemble: EnsembleLandings | None = None,
    ):
        self.policy = policy
        self.experience = experience
        self.ensemble = ensemble
        self.model = policy.model
        self.length = policy.setup.cable.length
        self.changes = deviations(policy.actions)
        self.usual_sensitivity = float(np.median(policy.sensitivity))
        xy, values = policy.predicted_xy, policy.sensitivity
        some = slice(None, None, max(1, len(values) // _SIZE_COUNT))
        self.size = size or LocalSize(landing_xy=xy[some], values=values[some])

    def with_experience(
        self, experience: Experience, ensemble: EnsembleLandings | None = None
    ) -> "LandingPredictor":
        """Return a predictor of the same policy that knows other casts.

        Args:
            experience: Residuals of real casts about the simulated landings.
            ensemble: Simulators that learned from some of them; the present ones where None.
        """
        other = copy.copy(self)
        other.experience = experience
        other.ensemble = ensemble or self.ensemble
        return other

    def learn(self, casts: Sequence[AimedCast], ages: Sequence[float] | None = None) -> None:
        """Take casts into account, in the order in which they were made.

        Args:
            casts: Casts with or without a landing.
            ages: Factors of their noise, shape [cast]; drifts are noticed where None.
        """
        known = [None] * len(casts) if ages is None else ages
        if casts:
            # One batch takes hardly longer than one cast.
            self.judge(*mirror_to_right(np.array([cast.action for cast in casts])))
        for cast, age in zip(casts, known, strict=True):
            place, simulated_xy, side = self._place(cast.action)
            landing = cast.endpoint_xy * np.array([side, 1.0])
            residual = (landing - simulated_xy) / self.length if cast.landed else None
            self.experience.add(place, residual, fitted=cast.fitted, aimed=cast.aimed, age=age)

    def judge(self, actions: NDArray[np.float64], side: NDArray[np.float64]) -> Candidates:
        """Return candidates with what the ensemble says of them, if there is one.

        Args:
            actions: Actions to the right, shape [action, 4].
            side: +1, or -1 for those that are cast to the left, shape [action].
        """
        if self.ensemble is None:
            return Candidates.unjudged(actions, side)
        said = self.ensemble.judge(actions, side)
        shifts = (said.landing_xy - self.model.predict(actions)) / self.length
        return Candidates(
            actions=actions,
            side=side,
            shifts=np.nan_to_num(shifts),
            leaving=said.leaving,
            log_sizes=np.log(said.sizes / self.size.usual),
            frictions=said.frictions,
        )

    def expected(self, some: Candidates) -> tuple[Places, NDArray[np.float64], NDArray[np.float64]]:
        """Return places, expected landings to the right [m], and how surely these are known.

        Returns:
            Places; landings [m], shape [action, 2]; their variance along each axis without the
            scatter [square cable lengths], shape [action].
        """
        places, simulated_xy = self._located(some)
        mean, variance = self.experience.residual.predict(places)
        return places, simulated_xy + self.length * mean, variance

    def landings(self, some: Candidates, sensitivity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the expected landings of candidates to the right [m], shape [action, 2].

        Args:
            some: Candidates.
            sensitivity: Sensitivity of each over the usual one, shape [action].
        """
        simulated_xy = self._simulated(some)
        places = self.places(some, simulated_xy, sensitivity)
        return simulated_xy + self.length * self.experience.residual.means(places)

    def sensitivities(self, actions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return sensitivities of the landing to the action over the usual one, shape [action].

        Args:
            actions: Actions to the right, shape [action, 4].
        """
        return self.model.sensitivity(actions, self.changes) / self.usual_sensitivity

    def places(
        self,
        some: Candidates,
        simulated_xy: NDArray[np.float64],
        sensitivity: NDArray[np.float64],
    ) -> Places:
        """Return the places of candidates for the residuals of real casts.

        The ensemble may trust one of two actions more that land at one place. The size is the
        geometric mean of its own and the usual one there, because the action that it trusts most
        of many is trusted too much (docs/aim.md).

        Args:
            some: Candidates.
            simulated_xy: Their simulated landings to the right [m], shape [action, 2].
            sensitivity: Sensitivity of each over the usual one, shape [action].
        """
        usual = self.size.log_sizes(simulated_xy)
        own = np.where(np.isnan(some.log_sizes), usual, some.log_sizes)
        inputs = np.hstack(
            [
                self.model.normalize(some.actions).astype(float),
                self.model.normalize_endpoints(simulated_xy),
                some.side[:, None],
            ]
        )
        return Places(
            inputs=inputs,
            log_sizes=0.5 * (usual + own),
            log_shakes=log_shakes(sensitivity, some.frictions),
            frictions=some.frictions,
        )

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

    def _place(self, action: NDArray[np.float64]) -> tuple[Places, NDArray[np.float64], float]:
        """Return the place of a cast, its simulated landing to the right [m], and its side."""
        cast = self.judge(*mirror_to_right(action[None]))
        places, simulated_xy = self._located(cast)
        return places, simulated_xy[0], float(cast.side[0])

    def _located(self, some: Candidates) -> tuple[Places, NDArray[np.float64]]:
        """Return the places of candidates and their simulated landings to the right [m]."""
        simulated_xy = self._simulated(some)
        return self.places(some, simulated_xy, self.sensitivities(some.actions)), simulated_xy

    def _simulated(self, some: Candidates) -> NDArray[np.float64]:
        """Return the simulated landings of candidates [m], shape [action, 2]."""
        return self.model.predict(some.actions) + self.length * some.shifts

    def _predict_one(self, action: NDArray[np.float64]):
        place, simulated_xy, side = self._place(action)
        mean, variance = self.experience.residual.predict(place)
        scatter = self.experience.scatter(place)
        actions, _ = mirror_to_right(action[None])
        shifts = self.model.landing_shifts(actions, self.changes)[0]
        along = shifts @ shifts.T / max(float(np.sum(shifts**2)), 1e-12)
        shape = (1.0 - _ALONG) * np.eye(2) + 2.0 * _ALONG * along
        covariance = (variance[0] + scatter[0]) * self.length**2 * shape
        flip = np.array([side, 1.0])
        xy = flip * (simulated_xy + self.length * mean[0])
        return xy, covariance * np.outer(flip, flip), float(np.sqrt(scatter[0])) * self.length


_Array = NDArray[np.float64]


class MovedLandings:
    """Landings of actions near candidates, of which an ensemble says the same.

    Args:
        some: Candidates.
        sensitivity: Sensitivity of each over the usual one, which hardly changes nearby, [action].
        landings: Given candidates and sensitivities, returns expected landings [m], [action, 2].
        model: Gives the set-up and the distance that the free end keeps from the table's edges.
    """

    def __init__(
        self,
        some: Candidates,
        sensitivity: _Array,
        landings: Callable[[Candidates, _Array], _Array],
        model: LandingModel,
    ):
        self.some = some
        self.sensitivity = sensitivity
        self.landings = landings
        self.model = model
        self.setup = model.setup

    def predict(self, actions: _Array) -> _Array:
        """Return the expected landings [m], shape [action, 2].

        Args:
            actions: Actions to the right, the candidates' in turn, any number of times.
        """
        rows = np.tile(np.arange(len(self.some)), len(actions) // len(self.some))
        return self.landings(self.some[rows].at(actions), self.sensitivity[rows])

    def landing_shifts(self, actions: _Array, changes: _Array) -> _Array:
        """Return the shift of the landing for each change of an action, [action, 2, change]."""
        return central_shifts(self.predict, actions, changes)

    def predict_margin(self, actions: _Array) -> _Array:
        """Return the distance that the free end keeps from the table's edges [m], [action]."""
        return self.model.predict_margin(actions)


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
        actions, side = mirror_to_right(np.array([cast.action for cast in self.casts]))
        landings = np.array([cast.endpoint_xy for cast in self.casts])
        expected = mirror_xy(self.predictor.model.predict(actions), side)
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
            target_xy: Target within reach and on the table [m], shape [2].
            tried: True if earlier casts were aimed at this target. A small change of one of them
                nearly always wins, so fewer other candidates are judged.
            sight: Limits of the camera's sight; unknown where None.

        Raises:
            InputError: The arm can follow none of the policy's actions near the target.
        """
        target = np.asarray(target_xy, dtype=float)
        goals = [target]
        if sight is not None and sight.is_blind_at(target):
            goals += [sight.seen_near(target, margin) for margin in _BLIND_MARGINS]
        some = Candidates.join([self._candidates(goal, tried) for goal in goals])
        risk, failure = self._risks(some, target, sight)
        if self.predictor.ensemble is not None:
            # Moved actions still carry the judgement of the action that they started from.
            few = np.argsort(risk)[:_SHORTLIST_COUNT]
            some = self.predictor.judge(some.actions[few], some.side[few])
            risk, failure = self._risks(some, target, sight)
        best = int(np.argmin(risk))
        if not np.isfinite(risk[best]):
            raise InputError("the arm can follow none of the policy's actions near this target")
        action = mirror_actions(some.actions, some.side)[best]
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
        distance = np.linalg.norm(landing_xy - mirror_xy(target, some.side), axis=1) / length
        motions = mirror_actions(some.actions, some.side)
        deviation = length * np.sqrt(variance)
        setup = self.policy.setup
        lost = lost_chance(motions, mirror_xy(landing_xy, some.side), deviation, setup, sight)
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
            ends = self._moved(self.predictor.judge(ends.actions, ends.side), target)
        some = Candidates.join([starts.towards(ends, part) for part in _PARTS])
        return some.at(within_ranges(some.actions))

    def _moved(self, some: Candidates, target: NDArray[np.float64]) -> Candidates:
        """Return candidates near others that are expected to land on the target."""
        sensitivity = self.predictor.sensitivities(some.actions)
        moved, _ = refine_actions(
            some.actions,
            mirror_xy(target, some.side),
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
        half = -1.0 if target[0] < 0 else 1.0
        places, actions, simulated_xy, turns = self._known_candidates
        # The candidates land on the right: for a target on the left all are mirrored.
        side = half * turns
        goals = mirror_xy(target, side)
        distance = np.linalg.norm(simulated_xy - goals, axis=1)
        count = max(_NEIGHBOR_COUNT, _PAIR_COUNT // max(1, len(self.casts)))
        near = np.argsort(distance)[:count]
        some = places[near]
        some.inputs[:, -1] = side[near]
        mean = self.experience.residual.means(some)
        distance = np.linalg.norm(
            simulated_xy[near] + self.predictor.length * mean - goals[near], axis=1
        )
        earlier = self._earlier(target)
        few = self.predictor.ensemble is None or (tried and len(earlier) > 0)
        kept = _SHORTLIST_COUNT if few else _JUDGED_COUNT
        short = near[np.argsort(distance)[:kept]]
        chosen = self.predictor.judge(actions[short], side[short])
        if len(chosen) > _SHORTLIST_COUNT:
            chosen = self._least_missing(chosen, target)
        return Candidates.join([chosen, self.predictor.judge(*mirror_to_right(earlier))])

    def _least_missing(self, some: Candidates, target: NDArray[np.float64]) -> Candidates:
        """Return the candidates with the least expected miss as they are."""
        _, landing_xy, variance = self.predictor.expected(some)
        offset = (landing_xy - mirror_xy(target, some.side)) / self.predictor.length
        square = np.sum(offset**2, axis=1) + 2.0 * variance
        # A cast without a landing misses by as much as one that lands a cable's length away.
        square = (1.0 - some.leaving) * square + some.leaving
        return some[np.argsort(square)[:_SHORTLIST_COUNT]]

    @functools.cached_property
    def _known_candidates(self) -> tuple[Places, NDArray, NDArray, NDArray]:
        """Places of the policy's candidates, actions and landings to the right [m], and sides."""
        policy = self.policy
        actions, turns = mirror_to_right(policy.actions)
        simulated_xy = mirror_xy(policy.predicted_xy, turns)
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
