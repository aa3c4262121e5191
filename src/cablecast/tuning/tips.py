"""Fit of a cable to the paths of its tip in the air, cut at the first contact.

In the air only ratios count: a path tells the cable's length, its stiffness and its drag over its
mass, its damping time, and the share of the drag along it. The fit minimises, over the logarithms z
of these numbers in standard deviations of what is believed of them,

    F(z) = 1/2 |z|^2 + sum_k sum_i (dt / CORRELATION_TIME) log(1 + d_ki^2 / (2 s_ki^2)).

d_ki is the distance of the simulated from the measured tip at sample i of swing k, and s_ki the
tolerance, which grows from the whip on, the moment of the fastest tip: what follows is decided by
the smallest differences. Steps are Levenberg's and Marquardt's from the best of many draws of what
is believed; several optima are kept.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import PARAMS, Cable, CableParams
from cablecast.conventions import Array
from cablecast.engines.swing import SAMPLE_DT

CORRELATION_TIME = 0.1
"""Time along a path within which its errors are one error [s]."""
TOLERANCE, GROWTH_TIME, TOLERANCE_MAX = 0.01, 0.25, 0.15
"""Tolerance of a tip before the whip [m], time in which it grows e-fold afterwards [s], and its
largest value [m]: a rope whose numbers are right is followed to a centimetre."""
UNTIMED_TOLERANCE, UNTIMED_DURATION = 0.02, 2.0
"""Tolerance of points without a time [m], and duration of the simulated path that they are compared
with [s]."""
CORRELATION_SHARE, POINTS_MAX = 20.0, 100
"""Independent points that a path without times is worth, and largest number that is compared."""
SAME_OPTIMUM = 0.1
"""Distance in deviations within which two optima are one [-]."""
MOST_DEVIATIONS = 2.5
"""Largest deviation of a number from what is believed of it [-]."""
USUAL_IN_AIR = {"drag_coefficient": 1.0, "drag_ratio": 0.1, "damping_time": 0.03}
"""Numbers of a cable in the air of which its file says nothing."""
MEASURED_DEVIATIONS = (1.03, 1.2, 2.0, 3.0, 2.0)
"""Deviations, see `TipBelief`, of a cable that was measured with a tape, attachment and knot
included, weighed, and whose stiffness was guessed."""
DIFFERENCE = 0.03
"""Step of a finite difference in deviations [-]."""
DAMPINGS = np.array([0.03, 0.3, 3.0, 30.0])


class Swinger(Protocol):
    """What plays swings, such as `SwingModel`."""

    def motion(self, unit: Any, duration: Any, /) -> Any:
        """Return a move, in unit coordinates, for a time [s]."""
        ...

    def play(self, motion: Any, cable: Any, /) -> Any:
        """Return swings of a move with cables: `tip` [m], shape [cable, sample, 3]."""
        ...


@dataclasses.dataclass(frozen=True, kw_only=True)
class TipBelief:
    """What is believed of a cable in the air: log-normal and independent.

    Attributes:
        cable: Cable with the most likely numbers.
        deviations: Standard deviation of each number as a factor: length, mass per length, bending
            stiffness over it, damping time, drag along the cable over that across it, in this
            order; 1 where it is known.
    """

    cable: Cable
    deviations: tuple[float, float, float, float, float]

    @classmethod
    def of(cls, cable: Cable) -> "TipBelief":
        """Return what a person believes of a cable that was measured and weighed.

        What its file leaves at zero, since no landing tells it, has a usual value.
        """
        params = cable.params
        usual = {
            name: value
            for name, value in USUAL_IN_AIR.items()
            if float(getattr(params, name)) == 0.0
        }
        return cls(
            cable=dataclasses.replace(cable, params=dataclasses.replace(params, **usual)),
            deviations=MEASURED_DEVIATIONS,
        )

    def cables(self, points: Array) -> list[Cable]:
        """Return the cables at some points, shape [point, 5]."""
        cable, params = self.cable, self.cable.params
        density = float(params.mass) / cable.length
        end_share = float(params.endpoint_mass) / float(params.mass)
        middle = (
            cable.length,
            density,
            float(params.bend_stiffness) / density,
            float(params.damping_time),
            float(params.drag_ratio),
        )
        most = {name: PARAMS[name].bounds[1] for name in PARAMS}
        made = []
        for values in np.array(middle) * np.exp(points * np.log(self.deviations)):
            length, mu, ratio, time, along = values.tolist()
            stiffness = min(ratio * mu, most["bend_stiffness"])
            physics = dataclasses.replace(
                params,
                mass=mu * length,
                endpoint_mass=end_share * mu * length,
                bend_stiffness=stiffness,
                twist_stiffness=stiffness,
                damping_time=min(time, most["damping_time"]),
                drag_ratio=min(along, most["drag_ratio"]),
            )
            made.append(dataclasses.replace(cable, length=length, params=physics))
        return made

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Return draws of what is believed, the most likely one first, shape [draw, 5].

        They are spread evenly over the probability of each number: a few reach its ends, too.
        """
        from scipy.special import ndtri
        from scipy.stats import qmc

        points = ndtri(qmc.LatinHypercube(len(self.deviations), rng=rng).random(count))
        points = np.clip(points, -MOST_DEVIATIONS, MOST_DEVIATIONS)
        points[0] = 0.0
        return points


@dataclasses.dataclass(frozen=True, kw_only=True)
class TipSwing:
    """A swing that was seen.

    Attributes:
        unit: Move, in unit coordinates, shape [parameter].
        tip: Tip at every `SAMPLE_DT` from the start until the first contact [m], shape [sample, 3].
            Where it is not timed, points of the path in any order, shape [point, 3].
        timed: Whether the time of each point is known.
    """

    unit: Array
    tip: Array
    timed: bool = True

    @property
    def relevant(self) -> "TipSwing":
        """The swing as long as its tolerance is small enough for a sample to count."""
        if not self.timed:
            return dataclasses.replace(self, tip=self.tip[:: max(len(self.tip) // POINTS_MAX, 1)])
        return dataclasses.replace(self, tip=self.tip[self.tolerance < TOLERANCE_MAX])

    @property
    def tolerance(self) -> Array:
        """Tolerance of each sample [m], shape [sample]."""
        speed = np.linalg.norm(np.diff(self.tip, axis=0), axis=-1)
        whip = int(np.argmax(speed)) if len(speed) else 0
        after = SAMPLE_DT * np.maximum(np.arange(len(self.tip)) - whip, 0)
        return np.minimum(TOLERANCE * np.exp(after / GROWTH_TIME), TOLERANCE_MAX)


@dataclasses.dataclass(frozen=True, kw_only=True)
class TipPosterior:
    """Optima of a fit, the best first.

    Attributes:
        belief: What was believed before.
        points: Optima in deviations, shape [optimum, 5].
        costs: F at each, shape [optimum].
        covariances: Covariance about each, shape [optimum, 5, 5].
    """

    belief: TipBelief
    points: Array
    costs: Array
    covariances: Array

    @property
    def cable(self) -> Cable:
        """Most likely cable."""
        return self.belief.cables(self.points[:1])[0]

    def draw(self, count: int, rng: np.random.Generator) -> list[Cable]:
        """Return cables as likely as they are, the most likely one first."""
        volumes = np.linalg.slogdet(self.covariances)[1]
        logs = -(self.costs - self.costs.min()) + 0.5 * (volumes - volumes[0])
        weights = np.exp(logs - logs.max())
        chosen = rng.choice(len(self.points), count, p=weights / weights.sum())
        factors = np.linalg.cholesky(self.covariances)
        points = self.points[chosen] + np.einsum(
            "nij,nj->ni", factors[chosen], rng.normal(size=(count, self.points.shape[1]))
        )
        points[0] = self.points[0]
        return self.belief.cables(np.clip(points, -MOST_DEVIATIONS, MOST_DEVIATIONS))


def fit_tips(
    model: Swinger,
    belief: TipBelief,
    swings: Sequence[TipSwing],
    *,
    known: Array | None = None,
    draw_count: int = 192,
    start_count: int = 6,
    steps: int = 8,
    seed: int = 0,
) -> TipPosterior:
    """Fit a cable to swings.

    Args:
        model: Arm and engine that made the swings.
        belief: What is believed of the cable.
        swings: Swings that were seen.
        known: Points to start from beside the draws, such as optima of fewer swings, [point, 5].
        draw_count: Number of draws, of which the best are started from.
        start_count: Number of starts.
        steps: Largest number of steps from each.
        seed: Seed of the draws.
    """
    fit = _TipFit(model, belief, swings)
    points = belief.draw(draw_count, np.random.default_rng(seed))
    if known is not None:
        points = np.concatenate([known, points])
    costs = fit.costs(points)
    order = np.argsort(costs, kind="stable")[:start_count]
    points, costs = points[order], costs[order]
    damping = np.ones(len(points))
    hessians = np.tile(np.eye(points.shape[1]), (len(points), 1, 1))
    for _ in range(steps):
        gradients, hessians = fit.curvatures(points)
        tried = np.stack(
            [
                [
                    point - np.linalg.solve(h + factor * d * np.diag(np.diag(h)), g)
                    for factor in DAMPINGS
                ]
                for point, h, g, d in zip(points, hessians, gradients, damping, strict=True)
            ]
        )
        tried = np.clip(tried, -MOST_DEVIATIONS, MOST_DEVIATIONS)
        found = fit.costs(tried.reshape(-1, points.shape[1])).reshape(tried.shape[:2])
        best, rows = np.argmin(found, axis=1), np.arange(len(points))
        better = found[rows, best] < costs
        gain = np.where(better, costs - found[rows, best], 0.0)
        points = np.where(better[:, None], tried[rows, best], points)
        costs = np.where(better, found[rows, best], costs)
        damping = np.clip(damping * np.where(better, DAMPINGS[best], 10.0), 1e-4, 1e4)
        if gain.max() < 0.02:
            break
    order = np.argsort(costs, kind="stable")
    kept: list[int] = []
    for row in order:
        apart = [np.linalg.norm(points[row] - points[other]) for other in kept]
        if not apart or min(apart) > SAME_OPTIMUM:
            kept.append(int(row))
    return TipPosterior(
        belief=belief,
        points=points[kept],
        costs=costs[kept],
        covariances=np.asarray(np.linalg.inv(hessians[kept]), dtype=float),
    )


class _TipFit:
    """F and its derivatives.

    Args:
        model: Arm and engine.
        belief: What is believed of the cable.
        swings: Swings that were seen.
    """

    def __init__(self, model: Swinger, belief: TipBelief, swings: Sequence[TipSwing]):
        self.belief, self.swings = belief, swings
        self.model = model
        self.motions = [
            model.motion(
                one.unit,
                SAMPLE_DT * max(len(one.tip) - 1, 4) if one.timed else UNTIMED_DURATION,
            )
            for one in swings
        ]
        timed, untimed = SAMPLE_DT / CORRELATION_TIME, CORRELATION_SHARE
        self.shares = [timed if one.timed else untimed / len(one.tip) for one in swings]

    def offsets(self, points: Array) -> list[Array]:
        """Return the offsets of each swing in tolerances, shape [point, sample, 3] each."""
        cables = self.belief.cables(points)
        found = []
        for swing, motion in zip(self.swings, self.motions, strict=True):
            tip = self.model.play(motion, cables).tip
            if swing.timed:
                offset = (tip[:, : len(swing.tip)] - swing.tip) / swing.tolerance[:, None]
            else:
                near = np.array([nearest(path, swing.tip)[0] for path in tip])
                offset = (near - swing.tip) / UNTIMED_TOLERANCE
            # A world that broke is far off.
            found.append(np.nan_to_num(offset, nan=1e3))
        return found

    def costs(self, points: Array) -> Array:
        """Return F at some points, shape [point]."""
        total = 0.5 * np.sum(points**2, axis=1)
        for offset, share in zip(self.offsets(points), self.shares, strict=True):
            total += share * np.sum(np.log1p(0.5 * np.sum(offset**2, axis=-1)), axis=-1)
        return total

    def curvatures(self, points: Array) -> tuple[Array, Array]:
        """Return gradient and Gauss-Newton matrix of F at some points."""
        count, size = points.shape
        moved = points[:, None] + DIFFERENCE * np.eye(size)
        batch = np.concatenate([points[:, None], moved], axis=1).reshape(-1, size)
        gradient, hessian = points.copy(), np.tile(np.eye(size), (count, 1, 1))
        for offset, share in zip(self.offsets(batch), self.shares, strict=True):
            offset = offset.reshape(count, size + 1, *offset.shape[1:])
            slope = (offset[:, 1:] - offset[:, :1]) / DIFFERENCE
            weight = share / (1.0 + 0.5 * np.sum(offset[:, 0] ** 2, axis=-1))
            weighted = slope * weight[:, None, :, None]
            gradient += np.einsum("njsx,nsx->nj", weighted, offset[:, 0])
            hessian += np.einsum("njsx,nksx->njk", weighted, slope)
        return gradient, hessian


def nearest(path: Array, points: Array) -> tuple[Array, NDArray[np.int_]]:
    """Return the points of a path, [step, 3], nearest to others, [point, 3], and the steps before.

    NaN in the path are pieces that it does not have.
    """
    start, way = path[:-1], np.diff(path, axis=0)
    offset = points[:, None] - start
    length = np.maximum(np.sum(way * way, axis=-1), 1e-12)
    along = np.clip(np.sum(offset * way, axis=-1) / length, 0.0, 1.0)
    square = np.sum((offset - along[..., None] * way) ** 2, axis=-1)
    step = np.argmin(np.where(np.isnan(square), np.inf, square), axis=1)
    share = along[np.arange(len(points)), step]
    return start[step] + share[:, None] * way[step], step


def air_cable(
    length: float,
    density: float,
    bend_ratio: float,
    damping_time: float,
    diameter: float,
    drag_ratio: float = 0.1,
) -> Cable:
    """Return a cable in the air, of which friction does not count.

    Args:
        length: Length [m].
        density: Mass per length [kg/m].
        bend_ratio: Bending stiffness over mass per length [m^4/s²].
        damping_time: Damping time [s].
        diameter: Diameter [m]; the drag coefficient is 1.
        drag_ratio: Drag along the cable over that across it [-].
    """
    params = CableParams(
        twist_stiffness=bend_ratio * density,
        bend_stiffness=bend_ratio * density,
        mass=density * length,
        damping_time=damping_time,
        drag_coefficient=1.0,
        drag_ratio=drag_ratio,
    )
    return Cable(name="rope", length=length, diameter=diameter, params=params)
