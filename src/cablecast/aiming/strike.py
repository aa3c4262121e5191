"""Aiming at strikes: the tip of a cable in the air passes a point, at any time.

The first try is the move whose miss, on average over cables as they are believed to be, is least.
Then the cable is fitted to the tips that were seen (`fit_tips`), and a move is searched for in the
engine. What the engine still gets wrong of tries that were nearly the same is added to its paths.
A move that hit is repeated.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable
from cablecast.conventions import Array
from cablecast.engines.swing import SAMPLE_DT, SwingModel, SwingMotion
from cablecast.errors import TargetError
from cablecast.task import STRIKE, closest
from cablecast.tuning.tips import TipBelief, TipPosterior, TipSwing, fit_tips

MOVE_COUNT, CABLE_COUNT = 512, 16
"""Moves and believed cables of which the first try is chosen."""
OUT_OF_REACH = 0.3
"""Distance of a goal from all that believed cables pass beyond which no cable strikes it [m]."""
ABLE = 0.1
"""Distance by which all moves of a believed cable miss a goal at which it barely counts [m]: some
move is to strike the goal."""
LIKELY_COUNT = 6
"""Cables drawn from a posterior, over which the miss of a move is averaged."""
REFIT = 0.03
"""Miss of the best try up to which its error is corrected without a new fit [m]."""
SWING_COUNT = 3
"""Swings that a fit takes: those nearest to the goal."""
ALIKE = 0.1
"""Distance of moves, in unit coordinates, over which errors of the engine are much alike [-]."""
DOUBT = 0.01
"""Error of a fitted engine where no try was near [m]."""
NOISE = 1e-2
"""Variance of what is particular to a try, over that of an error of the engine [-]."""
REFINEMENTS = ((6, 12, 0.05), (3, 16, 0.015), (2, 16, 0.004))
"""Rounds of the search: best moves, draws about each, and their deviation in unit coordinates."""
SMOOTHING, OFFSET_MAX = 0.04, 0.15
"""Length of a path over which points without time are averaged [m], and distance beyond which they
are of another piece of it [m]."""
SAME_MOVE = 0.02
"""Distance of moves, in unit coordinates, below which one is lost if the other was [-]."""
POOL_COUNT = 48
"""Best moves of the first search, from which later ones start."""
CHECKED = 96
"""Moves of a batch, the nearest to the goal, in which contacts are looked for."""
LATER_STEPS = 30
"""Steps that a search looks beyond the closest points of the best moves."""
MARGIN, MISS_MAX = 0.03, 0.3
"""Distance from the arm below which a likely cable may touch it [m], and the miss that a lost try
counts as at most [m]."""
FINALISTS = 16
"""Moves that are compared by their mean miss with likely cables."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class StrikePrior:
    """Simulated swings of cables as they are believed to be; no goal is known yet.

    Attributes:
        model: Arm and engine.
        belief: What is believed of the cable.
        units: Moves, evenly spread, shape [move, parameter].
        tips: Paths of the tip [m], shape [cable, move, step, 3].
        checked: Whether only moves count that the arm can make without meeting itself.
    """

    model: SwingModel
    belief: TipBelief
    units: Array
    tips: NDArray[np.float32]
    checked: bool = True

    @functools.cached_property
    def motion(self) -> SwingMotion:
        """The moves as the engine plays them."""
        return self.model.motion(self.units)

    @classmethod
    def simulate(
        cls,
        model: SwingModel,
        belief: TipBelief,
        seed: int = 0,
        *,
        checked: bool = True,
        move_count: int = MOVE_COUNT,
        cable_count: int = CABLE_COUNT,
        on_cable: Callable[[int], object] = lambda done: None,
    ) -> "StrikePrior":
        """Simulate cables drawn from what is believed.

        Args:
            model: Arm and engine.
            belief: What is believed of the cable.
            seed: Seed of moves and cables.
            checked: Whether only moves count that the arm can make without meeting itself.
            move_count: Number of moves before this check.
            cable_count: Number of cables.
            on_cable: Told how many cables are simulated, from 0 on.
        """
        from scipy.stats import qmc

        rng = np.random.default_rng(seed)
        # Sobol's sequence is drawn by powers of two: SciPy warns of other numbers.
        sobol = qmc.Sobol(model.moves.size, rng=rng)
        units = sobol.random_base2((move_count - 1).bit_length())[:move_count]
        if checked:
            units = units[model.moves.feasible(units)]
        motion = model.motion(units)
        cables = belief.cables(belief.draw(cable_count, rng))
        rows, tips = np.arange(len(units)), []
        for done, cable in enumerate(cables):
            on_cable(done)
            swings = model.play(motion, cable, nodes=True)
            tip = swings.tip.astype(np.float32)
            tip[np.arange(tip.shape[1]) >= swings.contacts(rows)[:, None]] = np.nan
            tips.append(tip)
        on_cable(len(cables))
        return cls(model=model, belief=belief, units=units, tips=np.stack(tips), checked=checked)

    def misses(self, goal: ArrayLike) -> Array:
        """Return the mean miss of each move over cables that can strike a goal [m], shape [move].

        Raises:
            TargetError: No move of any of the cables comes near the goal.
        """
        goal = np.asarray(goal, dtype=float)
        found, places = closest(self.tips, goal)
        if found.min() > OUT_OF_REACH:
            cable, move = np.unravel_index(np.argmin(found), found.shape)
            nearest = self.tips[cable, move, round(float(places[cable, move]))]
            asked, near = (", ".join(f"{v:.3g}" for v in xyz) for xyz in (goal, nearest))
            raise TargetError(
                f"target ({asked}) m cannot be struck: the nearest point that a swing passes is "
                f"({near}) m, {found.min():.2f} m away"
            )
        square = found.min(axis=1) ** 2
        able = np.exp(-0.5 * (square - square.min()) / ABLE**2)
        return np.asarray(np.average(found, axis=0, weights=able), dtype=float)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class StrikeTry:
    """A try at a goal.

    Attributes:
        unit: Move in unit coordinates, shape [parameter].
        tip: Tip until the first contact [m], shape [sample, 3].
        miss: Closest distance of the tip from the goal [m].
    """

    unit: Array
    tip: Array
    miss: float


class StrikeAim:
    """Aims at one goal with one cable.

    Args:
        prior: Arm, engine, and what is believed of the cable.
        goal: Point to strike [m], shape [3].
        within: Distance at which a try has hit [m].
        cable: Cable, where it is known and is that of the prior: no try is needed before a search.
        loss: What else counts of a path of the tip until its first contact, [step, 3]: an addition
            to its miss [m], such as for the direction of arrival.
        corrects: Whether errors of the engine in tries are added to its paths.
        fits: Whether the cable is fitted to tries.
        timed: Whether tips come with their times; points of their paths in any order otherwise.
        seed: Seed of the search.

    Attributes:
        tries: Tries whose tip was seen.
        lost: Moves of tries whose tip was not seen, shape [parameter] each; none like them is made.

    Raises:
        TargetError: The goal is out of reach.
    """

    def __init__(
        self,
        prior: StrikePrior,
        goal: ArrayLike,
        *,
        within: float = 5e-3,
        cable: Cable | None = None,
        loss: Callable[[Array], float] | None = None,
        corrects: bool = True,
        fits: bool = True,
        timed: bool = True,
        seed: int = 0,
    ):
        self.prior, self.model = prior, prior.model
        self.goal = np.asarray(goal, dtype=float)
        self.loss, self.cable = loss, cable
        self.within, self.corrects, self.fits = within, corrects, fits
        self.timed = timed
        self.tries: list[StrikeTry] = []
        self.lost: list[Array] = []
        self.posterior: TipPosterior | None = None
        self.expected = np.nan
        self._first = prior.misses(self.goal)
        self._rng = np.random.default_rng([seed, *(np.round(1e3 * self.goal).astype(int) % 2**31)])
        self._pool: Array | None = None
        if cable is not None:
            self._pool = prior.units[np.argsort(self._first)[:CHECKED]]

    def propose(self) -> Array:
        """Return the next move in unit coordinates, shape [parameter]."""
        if not self.tries:
            if self.cable is not None:
                return self._search([self.cable])
            first = np.where(self._is_lost(self.prior.units), np.inf, self._first)
            self.expected = float(first.min())
            return self.prior.units[np.argmin(first)]
        best = min(self.tries, key=lambda one: one.miss)
        if best.miss <= self.within:
            self.expected = best.miss
            return best.unit
        if self.cable is not None:
            return self._search([self.cable])
        if not self.fits:
            return self._search_prior()
        posterior = self.posterior
        if posterior is None or best.miss > REFIT or not self.corrects:
            posterior = self._fit()
        return self._search(posterior.draw(LIKELY_COUNT, self._rng))

    def observe(self, unit: ArrayLike, tip: Array) -> float:
        """Take note of a try, and return its miss [m]; arguments are those of `StrikeTry`."""
        unit = np.asarray(unit, dtype=float)
        if not self.timed:
            # Without an order there is no line from point to point.
            miss = float(np.linalg.norm(tip - self.goal, axis=1).min())
            self.tries.append(StrikeTry(unit=unit, tip=tip, miss=miss))
            return miss
        miss = float(closest(tip, self.goal)[0])
        if self.loss is not None:
            miss += self.loss(tip)
        self.tries.append(StrikeTry(unit=unit, tip=tip, miss=miss))
        return miss

    def outcomes(self, unit: ArrayLike) -> Array:
        """Return the points of likely paths of a move that are closest to the goal, [cable, 3].

        Before the first fit they are those of the cables of the prior, whose move it must be.
        """
        unit = np.asarray(unit, dtype=float)
        if self.posterior is None:
            row = int(np.argmin(np.abs(self.prior.units - unit).max(axis=1)))
            tips = np.asarray(self.prior.tips[:, row], dtype=float)
        else:
            likely = self.posterior.draw(LIKELY_COUNT, np.random.default_rng(len(self.tries)))
            rows = np.zeros(len(likely), dtype=int)
            swings = self.model.play(self.model.motion(unit).rows(rows), likely, nodes=True)
            units = np.tile(unit, (len(likely), 1))
            tips = self._corrected(units, swings.tip, self._residuals(likely))
            first = swings.contacts(np.arange(len(likely)))
            tips[np.arange(tips.shape[1]) >= first[:, None]] = np.nan
        return STRIKE.outcome_at(tips, self.goal)

    def _fit(self) -> TipPosterior:
        """Fit the cable to the best tries, and return what they tell."""
        chosen = sorted(self.tries, key=lambda one: one.miss)[:SWING_COUNT]
        known = None if self.posterior is None else self.posterior.points
        again = known is not None
        self.posterior = found = fit_tips(
            self.model,
            self.prior.belief,
            [TipSwing(unit=one.unit, tip=one.tip, timed=self.timed).relevant for one in chosen],
            known=known,
            draw_count=48 if again else 192,
            start_count=3 if again else 6,
            seed=len(self.tries),
        )
        return found

    def _search(self, likely: Sequence[Cable]) -> Array:
        """Return the move with the least mean miss, as the engine tells it with likely cables."""
        best, duration, size = likely[0], self.model.duration, self.prior.units.shape[1]
        tried = sorted(self.tries, key=lambda one: one.miss)[:1]
        near = np.array([one.unit for one in tried]).reshape(-1, size)
        if self._pool is None:
            units, motion = self.prior.units, self.prior.motion
        else:
            units = self._pool
            motion = self.model.motion(units)
        residual = self._residuals([best])
        misses, steps = self._misses(units, motion, best, residual)
        self._pool = units[np.argsort(misses)[:POOL_COUNT]]
        for count, draws, deviation in REFINEMENTS:
            order = np.argsort(misses)[:count]
            # The best moves are known so far as they matter.
            duration = min(duration, SAMPLE_DT * (float(steps[order].max()) + LATER_STEPS))
            top = np.concatenate([units[order], near])
            noise = self._rng.normal(size=(len(top), draws, units.shape[1]))
            drawn = np.clip(top[:, None] + deviation * noise, 0.0, 1.0).reshape(-1, units.shape[1])
            if self.prior.checked:
                # What was tried is feasible, and stays where no draw is.
                drawn = np.concatenate([near, drawn[self.model.moves.feasible(drawn)]])
            found = self._misses(drawn, self.model.motion(drawn, duration), best, residual)
            units = np.concatenate([units, drawn])
            misses, steps = (
                np.concatenate(two) for two in zip((misses, steps), found, strict=True)
            )
        order = np.argsort(misses)[:FINALISTS]
        self._pool = np.concatenate([self._pool, units[order]])
        finalists = units[order]
        duration = SAMPLE_DT * min(
            float(steps[order].max()) + LATER_STEPS, self.model.duration / SAMPLE_DT
        )
        # All likely cables in one batch, cable by cable.
        cable, move = np.divmod(np.arange(len(likely) * len(finalists)), len(finalists))
        found = self._misses(
            finalists[move],
            self.model.motion(finalists, duration).rows(move),
            [likely[number] for number in cable],
            np.repeat(self._residuals(likely), len(finalists), axis=0),
            MARGIN * cable / len(likely),
        )[0]
        means = np.minimum(found, MISS_MAX).reshape(len(likely), -1).mean(axis=0)
        self.expected = float(means.min())
        return finalists[np.argmin(means)]

    def _misses(
        self,
        units: Array,
        motion: SwingMotion,
        cables: Cable | Sequence[Cable],
        residuals: Array,
        margin: Array | None = None,
    ) -> tuple[Array, Array]:
        """Return the miss of moves [m], and the step of the closest point, both [move].

        Contacts are looked for in those nearest to the goal; others count as lost. With a margin
        [m], shape [move], cables are thicker by it.
        """
        swings = self.model.play(motion, cables, nodes=True)
        tips = self._corrected(units, swings.tip, residuals)
        misses, steps = closest(tips, self.goal)
        order = np.argsort(misses)
        kept = order[:CHECKED]
        misses[order[CHECKED:]] = np.inf
        first = swings.contacts(kept, 0.0 if margin is None else margin[kept])
        cut = tips[kept]
        cut[np.arange(cut.shape[1]) >= first[:, None]] = np.nan
        misses[kept], steps[kept] = closest(cut, self.goal)
        misses += self._doubt(units)
        misses[self._is_lost(units)] = np.inf
        if self.loss is not None:
            extra = [
                self.loss(tip[:end]) for tip, end in zip(cut, np.maximum(first, 2), strict=True)
            ]
            misses[kept] += extra
        return misses, steps

    def _is_lost(self, units: Array) -> NDArray[np.bool_]:
        """Return which moves are like one whose tip was not seen, shape [move]."""
        like = [np.abs(units - lost).max(axis=1) < SAME_MOVE for lost in self.lost]
        return np.any(like, axis=0) if like else np.zeros(len(units), dtype=bool)

    def _search_prior(self) -> Array:
        """Return the move of the prior with the least mean miss that was not tried yet."""
        misses = self._first.copy()
        tried = [np.abs(self.prior.units - one.unit).max(axis=1) < 1e-9 for one in self.tries]
        misses[np.any(tried, axis=0)] = np.inf
        self.expected = float(misses.min())
        return self.prior.units[np.argmin(misses)]

    def _residuals(self, cables: Sequence[Cable]) -> Array:
        """Return what the engine gets wrong of each try [m], shape [cable, try, step, 3].

        It is NaN from where the tip was not seen any more.
        """
        if not self.tries:
            return np.zeros((len(cables), 0, 1, 3))
        motion = self.model.motion(np.array([one.unit for one in self.tries]))
        cable, row = np.divmod(np.arange(len(cables) * len(self.tries)), len(self.tries))
        simulated = self.model.play(motion.rows(row), [cables[k] for k in cable]).tip
        simulated = simulated.reshape(-1, len(self.tries), *simulated.shape[1:])
        if not self.timed:
            return np.array(
                [
                    [_offsets(path, one.tip) for path, one in zip(paths, self.tries, strict=True)]
                    for paths in simulated
                ]
            )
        seen = np.full(simulated.shape[1:], np.nan)
        for track, one in zip(seen, self.tries, strict=True):
            track[: len(one.tip)] = one.tip[: len(track)]
        return seen - simulated

    def _weights(self, units: Array) -> tuple[Array, Array]:
        """Return weights of the errors of tries, and likeness of moves to them, [move, try]."""
        tried = np.array([one.unit for one in self.tries]).reshape(-1, units.shape[1])
        own, cross = (
            np.exp(-0.5 * np.sum((some[:, None] - tried) ** 2, axis=-1) / ALIKE**2)
            for some in (tried, units)
        )
        return np.linalg.solve(own + NOISE * np.eye(len(own)), cross.T).T, cross

    def _doubt(self, units: Array) -> Array:
        """Return the error of the engine that tries leave [m], shape [move]."""
        if not self.corrects:
            return np.zeros(len(units))
        weights, cross = self._weights(units)
        return DOUBT * np.sqrt(np.clip(1.0 - np.sum(weights * cross, axis=1), 0.0, 1.0))

    def _corrected(self, units: Array, tips: Array, residuals: Array) -> Array:
        """Return simulated tips plus what near tries tell of their error [m], [move, step, 3].

        Residuals have shape [move or 1, try, step, 3].
        """
        if not self.corrects:
            return tips
        weights, cross = self._weights(units)
        residuals = residuals[:, :, : tips.shape[1]]
        residuals = np.broadcast_to(residuals, (len(units), *residuals.shape[1:]))
        shift = np.einsum("mk,mksx->msx", weights, np.nan_to_num(residuals))
        # A contact cuts the path of a move that is all but the same.
        unseen = np.isnan(residuals[..., 0]) & (cross > 0.9)[..., None]
        shift[np.any(unseen, axis=1)] = np.nan
        return tips + shift


def _offsets(path: Array, points: Array) -> Array:
    """Return how far a path, [step, 3], lies from points of the true one, [point, 3], across it.

    NaN where there are none. Offsets are means over the points about the nearest one.
    """
    way = np.gradient(path, axis=0)
    way /= np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9)
    offset = points - path[:, None]
    along = np.sum(offset * way[:, None], axis=-1)
    across = offset - along[..., None] * way[:, None]
    square = np.nan_to_num(np.sum(offset**2, axis=-1), nan=np.inf)
    nearest = np.argmin(square, axis=1)
    steps = np.arange(len(path))
    # Points of the same piece of the path: not far along it, and as far from it as the nearest.
    apart = np.linalg.norm(across - across[steps, nearest][:, None], axis=-1)
    shift = along - along[steps, nearest][:, None]
    weight = np.exp(-0.5 * (shift / SMOOTHING) ** 2) * (apart < 2.0 * SMOOTHING)
    mean = np.sum(weight[..., None] * across, axis=1) / np.sum(weight, axis=1)[:, None]
    mean[~(square[steps, nearest] < OFFSET_MAX**2)] = np.nan
    return mean
