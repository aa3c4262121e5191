"""Levenberg-Marquardt fit of a cable's parameters, with a prior: accurate from few casts on.

The fit minimises, over the unit coordinates u of the parameters,

    F(u) = TRACK_WEIGHT sum_k mean_i |x_ki(u) - y_ki| / b + 1/2 sum_j ((u_j - m_j) / s_j)^2.

x_ki are the simulated and y_ki the measured endpoints of cast k, as in equation 4 of the paper; m_j
and s_j are what is believed of them (`ParamPrior`); b is the scale of the residual model error,
estimated from the fit itself. A sum of distances, not of squares, keeps one strange cast from
deciding the fit: each step solves the least-squares problem in which sample i of cast k is weighted
by the reciprocal of its distance.

Derivatives are finite differences. All starting points times all coordinates times all casts are
one batch of the engine, and three damping factors per starting point are another. A step takes two
batches, however many starting points there are.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import FITTED_MATERIAL, PAPER_PARAMS
from cablecast.errors import check_count, check_ranges, check_seed
from cablecast.tuning.space import Gaussian, ParamPrior, SearchSpace, check_materials
from cablecast.tuning.tracks import NON_FINITE_DISTANCE, TrackObjective

TRACK_WEIGHT = 2.0
"""Effective independent samples per track. The errors of a track's samples are correlated, so it
says far less than its sample count: a two-dimensional Laplace distribution of |x - y| with scale b
has the mean 2 b, and a track counts as two draws from it."""

MISFIT_START = 0.025
"""Scale b of the model's own error that is expected before any cast [cable lengths]."""

MISFIT_TRACKS = 4.0
"""Number of tracks that this expectation is worth. A handful of casts is followed more closely than
others will be, for ten parameters adapt to them."""

# Finite-difference step in unit coordinates: 2 % of a range is far above the noise of resting
# points that friction decides, and well below the width of a fit.
_DIFFERENCE = 0.02
_DAMPINGS = np.array([0.05, 1.0, 20.0])
_DAMPING_MIN, _DAMPING_MAX = 1e-6, 1e6
_LATERAL, _WORKSURFACE = (
    PAPER_PARAMS.index(name) for name in ("lateral_friction", "worksurface_friction")
)
# A table without friction says as much of that of the cable as one of this friction factor.
_FRICTION_MIN = 1e-3
# Distances below this share of the misfit are all as good as zero.
_DISTANCE_SHARE = 0.5


@dataclasses.dataclass(frozen=True, kw_only=True)
class FitConfig:
    """Settings of the least-squares fit.

    Attributes:
        start_count: Starting points: the believed values, and draws from what is believed.
        rough_iterations: Steps from each at a resolution that is rougher still than the coarse one.
        kept_start_count: Starting points that go on, of the third of them that these steps leave.
        coarse_iterations: Steps from each of these at the coarse resolution.
        fine_iterations: Steps from the third of them that is left, at full resolution.
        rough_segment_count: Number of segments of the rough cable.
        rough_dt: Step of the rough simulation [s].
        coarse_segment_count: Number of segments of the coarse cable. With 30, a rope with a damping
            time would just need steps shorter than `coarse_dt`.
        coarse_dt: Step of the coarse simulation [s].
        materials: Material parameters that are fitted with the ten, some of `FITTED_MATERIAL`,
            unless the cable's file gives them, or the casts are likelier without all.
        ensemble_iterations: Steps with each of some other materials, at the coarse resolution
            (`fit_ensemble`); no ensemble where 0.
        seed: Seed of the starting points.
    """

    start_count: int = 12
    rough_iterations: int = 6
    kept_start_count: int = 4
    coarse_iterations: int = 6
    fine_iterations: int = 4
    rough_segment_count: int = 20
    rough_dt: float = 2e-3
    coarse_segment_count: int = 28
    coarse_dt: float = 1e-3
    materials: tuple[str, ...] = FITTED_MATERIAL
    ensemble_iterations: int = 5
    seed: int = 0

    def __post_init__(self):
        check_materials(self.materials)
        for name, low, high in (
            ("start_count", 1, 1000),
            ("rough_iterations", 1, 1000),
            ("kept_start_count", 1, 1000),
            ("coarse_iterations", 1, 1000),
            ("fine_iterations", 1, 1000),
            ("ensemble_iterations", 0, 1000),
            ("rough_segment_count", 2, 1000),
            ("coarse_segment_count", 2, 1000),
        ):
            check_count(name, getattr(self, name), low, high)
        check_ranges(self, dict.fromkeys(("rough_dt", "coarse_dt"), (1e-7, 1e-2, "s")))
        check_seed(self.seed)


@dataclasses.dataclass(frozen=True, kw_only=True)
class FitState:
    """Points of a fit and what is known at them.

    Attributes:
        points: Unit coordinates, the ten parameters first, shape [start, coordinate].
        costs: F at the points, shape [start].
        losses: Equation 4 at the points [cable lengths], shape [start].
        dampings: Damping factor of the next step, shape [start].
        misfit: Scale b of the model's own error [cable lengths].
    """

    points: NDArray[np.float64]
    costs: NDArray[np.float64]
    losses: NDArray[np.float64]
    dampings: NDArray[np.float64]
    misfit: float

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else float(value)
            for name, value in vars(self).items()
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "FitState":
        """Return the state that `to_dict` described."""
        arrays = {name: np.array(value, dtype=float) for name, value in values.items()}
        return cls(**{**arrays, "misfit": float(values["misfit"])})

    def best(self, count: int = 1) -> "FitState":
        """Return the points of least cost, the best first."""
        order = np.argsort(self.costs, kind="stable")[:count]
        return dataclasses.replace(
            self,
            points=self.points[order],
            costs=self.costs[order],
            losses=self.losses[order],
            dampings=self.dampings[order],
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Curvature:
    """Quadratic model of F at one point.

    Attributes:
        loss: Equation 4 at the point [cable lengths].
        gradient: Derivative of F, shape [coordinate].
        hessian: Gauss-Newton matrix of F, prior included, shape [coordinate, coordinate].
    """

    loss: float
    gradient: NDArray[np.float64]
    hessian: NDArray[np.float64]


class TrackFit:
    """F and its derivatives for one objective.

    Args:
        objective: Simulator and measured tracks.
        space: Ranges of the parameters.
        prior: What is believed of them before these tracks.
    """

    def __init__(self, objective: TrackObjective, space: SearchSpace, prior: ParamPrior | Gaussian):
        self.objective = objective
        self.space = space
        self.prior = prior
        self.simulation_count = 0

    def start(self, points: NDArray[np.float64], misfit: float) -> FitState:
        """Return the state of a fit that starts at some points, where F is not known yet."""
        unknown = np.full(len(points), np.nan)
        dampings = np.ones(len(points))
        return FitState(
            points=points, costs=unknown, losses=unknown, dampings=dampings, misfit=misfit
        )

    def step(self, state: FitState, curvatures: Sequence[Curvature] | None = None) -> FitState:
        """Take one damped Gauss-Newton step from every point; a point that it worsens stays.

        The quadratic models of F at the points are simulated where none are given.
        """
        curvatures = curvatures or self.curvatures(state.points, state.misfit)
        here = np.array([curve.loss for curve in curvatures])
        state = dataclasses.replace(
            state, costs=self._cost(state.points, here, state.misfit), losses=here
        )
        tried_dampings = np.clip(state.dampings[:, None] * _DAMPINGS, _DAMPING_MIN, _DAMPING_MAX)
        moves = np.stack(
            [
                [_damped_step(curve, point, damping) for damping in row]
                for curve, point, row in zip(curvatures, state.points, tried_dampings, strict=True)
            ]
        )
        tried = state.points[:, None] + moves
        flat = tried.reshape(-1, tried.shape[-1])
        losses = self._losses(self._offsets(flat)[0])
        costs = self._cost(flat, losses, state.misfit).reshape(tried_dampings.shape)
        losses = losses.reshape(costs.shape)
        rows = np.arange(len(state.points))
        best = np.argmin(costs, axis=1)
        better = costs[rows, best] < state.costs
        return dataclasses.replace(
            state,
            points=np.where(better[:, None], tried[rows, best], state.points),
            costs=np.where(better, costs[rows, best], state.costs),
            losses=np.where(better, losses[rows, best], state.losses),
            dampings=np.where(
                better, tried_dampings[rows, best], np.minimum(100.0 * state.dampings, 1e4)
            ),
        )

    def rescaled(self, state: FitState) -> FitState:
        """Return a state whose misfit is that of its best point, with costs to match."""
        misfit = self._misfit(state)
        costs = self._cost(state.points, state.losses, misfit)
        return dataclasses.replace(state, costs=costs, misfit=misfit)

    def neg_log_posterior(self, state: FitState) -> float:
        """Return the negative log posterior density at the best point and its likeliest misfit."""
        best = state.best()
        draws = 2.0 * TRACK_WEIGHT * (MISFIT_TRACKS + self.track_count)
        return float(draws * np.log(self._misfit(best)) + self.prior.cost(best.points)[0])

    def _misfit(self, state: FitState) -> float:
        """Return the likeliest misfit at the best point [cable lengths]."""
        counts, known = (MISFIT_TRACKS, self.track_count), 0.5 * float(state.best().losses[0])
        return float(np.average((MISFIT_START, known), weights=counts))

    def curvatures(
        self, points: NDArray[np.float64], misfit: float, *, expected: bool = False
    ) -> list[Curvature]:
        """Return gradient and Gauss-Newton matrix of F at some points, from one batch.

        Args:
            points: Unit coordinates, shape [point, coordinate].
            misfit: Scale b of the model's own error [cable lengths].
            expected: Whether to weight samples as is expected of an error of scale b, whatever
                their distances: the Fisher information, for a posterior.
        """
        count, dimension = points.shape
        # Differences point inwards, so that no point leaves the cube.
        signs = np.where(points > 0.5, -1.0, 1.0) * _DIFFERENCE
        # A simulation knows the product of the two frictions only.
        moved = np.delete(np.arange(dimension), _WORKSURFACE)
        shifted = points[:, None] + np.eye(dimension)[moved] * signs[:, None]
        batch = np.concatenate([points[:, None], shifted], axis=1).reshape(-1, dimension)
        offsets, broken = self._offsets(batch)
        offsets = offsets.reshape(count, dimension, *offsets.shape[1:])
        broken = broken.reshape(offsets.shape[:-1])
        # Nothing is known of the slope where a simulation broke: what is believed stands there.
        sound = ~(broken[:, 1:] | broken[:, :1])[..., None]
        weights = self._weights(offsets[:, 0], misfit)
        if expected:
            # Of exp(-|r| / b) in the plane, the information along each axis is 1 / (2 b²).
            counts = np.maximum(self.objective.tracks.compared.sum(axis=1), 1)[:, None]
            weight = TRACK_WEIGHT * self.objective.tracks.compared / (2.0 * misfit**2 * counts)
            weights = np.broadcast_to(weight, weights.shape)
        losses = self._losses(offsets[:, 0])
        curvatures = []
        for row in range(count):
            base = offsets[row, 0]
            jacobian = np.empty((dimension, *base.shape))
            changes = np.where(sound[row], offsets[row, 1:] - base, 0.0)
            jacobian[moved] = changes / signs[row, moved, None, None, None]
            jacobian[_WORKSURFACE] = jacobian[_LATERAL] * self._friction_ratio(points[row])
            weighted = weights[row][..., None] * base
            hessian = np.einsum("atic,ti,btic->ab", jacobian, weights[row], jacobian)
            gradient = np.einsum("atic,tic->a", jacobian, weighted)
            curvatures.append(
                Curvature(
                    loss=float(losses[row]),
                    gradient=gradient + self.prior.slope(points[row]),
                    hessian=hessian + self.prior.precision,
                )
            )
        return curvatures

    def _friction_ratio(self, point: NDArray[np.float64]) -> float:
        """Return the effect of worksurface over that of lateral friction in unit coordinates."""
        values = self.space.to_params(point)
        widths = self.space.high - self.space.low
        worksurface = np.maximum(values.worksurface_friction, _FRICTION_MIN)
        return float(values.lateral_friction / worksurface) * float(
            widths[_WORKSURFACE] / widths[_LATERAL]
        )

    def _offsets(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return offsets of simulated from measured endpoints at points of the unit cube.

        They are in cable lengths, 0 where none was measured, shape [point, trial, sample, 2], with
        whether the simulation broke there, shape [point, trial, sample].
        """
        objective = self.objective
        tracks = objective.tracks
        xy, finite = objective.tracks_of(self.space.to_params(points))
        self.simulation_count += finite.size
        offsets = (xy[:, :, :-1] - tracks.endpoint_xy) / objective.cable.length
        broken = ~np.isfinite(offsets).all(axis=-1) | ~finite[:, :, None]
        offsets[broken] = (NON_FINITE_DISTANCE, 0.0)
        return np.where(tracks.compared[None, :, :, None], offsets, 0.0), broken

    def _weights(self, offsets: NDArray[np.float64], misfit: float) -> NDArray[np.float64]:
        """Return the weights of squared offsets whose gradient is that of F, [point, trial, i]."""
        compared = self.objective.tracks.compared
        counts = np.maximum(compared.sum(axis=1), 1)
        distances = np.maximum(np.linalg.norm(offsets, axis=-1), _DISTANCE_SHARE * misfit)
        return TRACK_WEIGHT * compared / (distances * counts[:, None] * misfit)

    @property
    def track_count(self) -> int:
        """Number of tracks with samples to compare."""
        return int(np.count_nonzero(self.objective.tracks.compared.any(axis=1)))

    def _losses(self, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return equation 4 [cable lengths], shape [point]."""
        counts = self.objective.tracks.compared.sum(axis=1)
        tracks = np.linalg.norm(offsets, axis=-1).sum(axis=-1)[:, counts > 0]
        return np.mean(tracks / counts[counts > 0], axis=1)

    def _cost(
        self, points: NDArray[np.float64], losses: NDArray[np.float64], misfit: float
    ) -> NDArray[np.float64]:
        """Return F, shape [point]."""
        tracks = TRACK_WEIGHT * self.track_count * losses / misfit
        return tracks + self.prior.cost(points)


def _damped_step(
    curve: Curvature, point: NDArray[np.float64], damping: float
) -> NDArray[np.float64]:
    """Return the step of a damping factor that stays in the unit cube.

    Coordinates that the step would push out of the cube go to its face, and the rest is solved
    again without them.
    """
    diagonal = np.diag(curve.hessian)
    matrix = curve.hessian + np.diag(damping * diagonal)
    step = np.zeros_like(point)
    free = np.ones(len(point), dtype=bool)
    for _ in range(len(point)):
        right = -curve.gradient[free] - matrix[np.ix_(free, ~free)] @ step[~free]
        step[free] = np.linalg.solve(matrix[np.ix_(free, free)], right)
        out = free & ((point + step < 0.0) | (point + step > 1.0))
        if not out.any():
            return step
        step[out] = np.clip(point + step, 0.0, 1.0)[out] - point[out]
        free &= ~out
        if not free.any():
            break
    return step
