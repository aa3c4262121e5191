"""LandingPredictor: where casts are expected to land, and how surely.

A policy's network approximates where every action lands in a simulator. Where the best simulator of
the cable has played an action, its own landing is used, and the network only says how the landing
of an action nearby differs from it. Simulators of different physics tell how far off it may be
(`EnsembleLandings`). A Gaussian process adds what real casts showed (`Experience`).
"""

import copy
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.models.features import deviations
from cablecast.models.few_casts import Places
from cablecast.models.local_size import LocalSize
from cablecast.motion.mirrored import rightward
from cablecast.policies.aimed import AimedCast
from cablecast.policies.candidates import Candidates
from cablecast.policies.ensemble import EnsembleLandings
from cablecast.policies.experience import Experience
from cablecast.policies.forward_search import ForwardSearchPolicy
from cablecast.policies.shakes import log_shakes

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
            self.judge(*rightward(np.array([cast.action for cast in casts])))
        for cast, age in zip(casts, known, strict=True):
            place, simulated_xy, hand = self._place(cast.action)
            landing = cast.endpoint_xy * np.array([hand, 1.0])
            residual = (landing - simulated_xy) / self.length if cast.landed else None
            self.experience.add(place, residual, fitted=cast.fitted, aimed=cast.aimed, age=age)

    def judge(self, actions: NDArray[np.float64], hands: NDArray[np.float64]) -> Candidates:
        """Return candidates with what the ensemble says of them, if there is one.

        Args:
            actions: Actions to the right, shape [action, 4].
            hands: +1, or -1 for those that are played to the left, shape [action].
        """
        if self.ensemble is None:
            return Candidates.unjudged(actions, hands)
        said = self.ensemble.judge(actions, hands)
        shifts = (said.landing_xy - self.model.predict(actions)) / self.length
        return Candidates(
            actions=actions,
            hands=hands,
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
                some.hands[:, None],
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
        """Return the place of a cast, its simulated landing to the right [m], and its hand."""
        cast = self.judge(*rightward(action[None]))
        places, simulated_xy = self._located(cast)
        return places, simulated_xy[0], float(cast.hands[0])

    def _located(self, some: Candidates) -> tuple[Places, NDArray[np.float64]]:
        """Return the places of candidates and their simulated landings to the right [m]."""
        simulated_xy = self._simulated(some)
        return self.places(some, simulated_xy, self.sensitivities(some.actions)), simulated_xy

    def _simulated(self, some: Candidates) -> NDArray[np.float64]:
        """Return the simulated landings of candidates [m], shape [action, 2]."""
        return self.model.predict(some.actions) + self.length * some.shifts

    def _predict_one(self, action: NDArray[np.float64]):
        place, simulated_xy, hand = self._place(action)
        mean, variance = self.experience.residual.predict(place)
        scatter = self.experience.scatter(place)
        actions, _ = rightward(action[None])
        shifts = self.model.landing_shifts(actions, self.changes)[0]
        along = shifts @ shifts.T / max(float(np.sum(shifts**2)), 1e-12)
        shape = (1.0 - _ALONG) * np.eye(2) + 2.0 * _ALONG * along
        covariance = (variance[0] + scatter[0]) * self.length**2 * shape
        flip = np.array([hand, 1.0])
        xy = flip * (simulated_xy + self.length * mean[0])
        return xy, covariance * np.outer(flip, flip), float(np.sqrt(scatter[0])) * self.length
