"""Differential Evolution over the unit cube, and its evaluated generations for bit-exact resume.

`ask` returns the candidates of a generation, and `tell` updates the search with their losses. The
search is a deterministic function of its seed and of these losses, so neither the population nor
the state of the random generator is stored: a resumed run replays its search with the stored losses
of each generation. Candidates that differ from the stored ones raise an error: another library or
machine drew them.
"""

import time
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cablecast.conventions import stream
from cablecast.errors import (
    DamagedFileError,
    InputError,
    check_count,
    check_seed,
)
from cablecast.runs.folder import Parts

RECOMBINATION = 0.7
MUTATION = (0.5, 1.0)
"""The paper's values, which are SciPy's defaults (arXiv source of the paper)."""
TOLERANCE = 0.01
"""A search has converged when the standard deviation of its losses is this share of their mean, as
SciPy's does by default: the paper states no end."""

POPULATION_MIN = 4
"""Minimum for the strategy best1bin: a member, the best, and two others."""
POPULATION_MAX = 10_000


class SearchDE:
    """Differential Evolution, strategy best1bin with dithered mutation, updated by generations.

    Each member x is challenged by best + F (x_a - x_b). The challenger takes each coordinate of
    this mutant with the recombination probability, and at least one. F is drawn from the mutation
    range once per generation. Coordinates outside the cube are redrawn. The better of member and
    challenger survives. SciPy's `differential_evolution(updating="deferred")` does the same.

    Args:
        start: First member of the initial population; the others are a Latin hypercube.
        population_size: Number of members.
        seed: Seed of the search.

    Attributes:
        population: Best points so far, from which the search continues, shape [member, dimension].
        losses: Their losses, shape [member].

    Raises:
        InputError: The population size or the seed is out of bounds.
    """

    def __init__(self, start: NDArray[np.float64], population_size: int, seed: int):
        check_count("population_size", population_size, POPULATION_MIN, POPULATION_MAX)
        self._rng = rng = stream(check_seed(seed), "evolution")
        self.population = latin_hypercube(population_size, len(start), rng)
        self.population[0] = start
        self.losses = np.full(population_size, np.inf)

    def ask(self) -> NDArray[np.float64]:
        """Return the initial population, then one challenger for each member."""
        if not np.isfinite(self.losses).any():
            return self.population.copy()
        rng, (size, dimension) = self._rng, self.population.shape
        best = self.population[np.argmin(self.losses)]
        factor = rng.uniform(*MUTATION)
        # Two others for each member: the first two of a random order of all but the member itself.
        order = np.argsort(rng.random((size, size - 1)), axis=1)[:, :2]
        others = order + (order >= np.arange(size)[:, None])
        mutant = best + factor * (self.population[others[:, 0]] - self.population[others[:, 1]])
        taken = rng.random((size, dimension)) < RECOMBINATION
        taken[np.arange(size), rng.integers(dimension, size=size)] = True
        challengers = np.where(taken, mutant, self.population)
        outside = (challengers < 0.0) | (challengers > 1.0)
        challengers[outside] = rng.random(int(outside.sum()))
        return challengers

    def tell(self, candidates: NDArray[np.float64], losses: NDArray[np.float64]) -> None:
        """Replace each member by its challenger if that is not worse."""
        better = losses <= self.losses
        self.population = np.where(better[:, None], candidates, self.population)
        self.losses = np.where(better, losses, self.losses)

    @property
    def converged(self) -> bool:
        """Whether the members are equally good, see `TOLERANCE`."""
        return bool(self.losses.std() <= TOLERANCE * abs(self.losses.mean()))


def latin_hypercube(count: int, dimension: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return points of the unit cube, one in each of `count` intervals of every coordinate.

    Their shape is [count, dimension].
    """
    cells = np.argsort(rng.random((dimension, count)), axis=1).T
    return (cells + rng.random((count, dimension))) / count


Result = TypeVar("Result")


class StoredSteps:
    """Evaluated generations of a search, or the steps of a fit.

    Args:
        parts: Folder of the generations; None where they are not kept.

    Attributes:
        seconds: Total time of the generations so far, stored ones included [s].
    """

    def __init__(self, parts: Parts | None):
        self.parts = parts
        self.seconds = 0.0
        self._count = 0

    def losses(
        self,
        stage: str,
        candidates: NDArray[np.float64],
        evaluate: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    ) -> tuple[NDArray[np.float64], bool]:
        """Return the losses of the next generation, and whether they were evaluated now.

        Args:
            stage: Name of the loss function.
            candidates: Candidates of the generation, shape [candidate, dimension].
            evaluate: Loss function, for a generation that is not stored.

        Raises:
            InputError: Other candidates are stored.
            DamagedFileError: The generation is not what was stored.
            UnreadableFileError: The system refuses to read it.
        """
        losses, is_new = self.step(
            stage,
            {"candidates": candidates.tolist()},
            lambda: {"losses": evaluate(candidates).tolist()},
            lambda values: np.array(values["losses"], dtype=float).reshape(len(candidates)),
        )
        return losses, is_new

    def step(
        self,
        stage: str,
        start: dict[str, Any],
        make: Callable[[], dict[str, Any]],
        read: Callable[[dict[str, Any]], Result],
    ) -> tuple[Result, bool]:
        """Return the result of the next step, and whether it was taken now.

        Args:
            stage: Name of the stage.
            start: What the step starts from, as plain values: a stored one must start from the
                same.
            make: Takes a step that is not stored, and returns plain values.
            read: Makes the result of these.

        Raises:
            InputError: A step from another start is stored.
            DamagedFileError: The step is not what was stored.
            UnreadableFileError: The system refuses to read it.
        """
        number, self._count = self._count, self._count + 1
        name = f"{number:04d}"
        stored = None if self.parts is None else self.parts.get(name)
        if self.parts is not None and stored is not None:
            try:
                is_same = stored["stage"] == stage and all(stored[k] == start[k] for k in start)
                result, seconds = read(stored) if is_same else None, float(stored["seconds"])
            except (ValueError, TypeError, KeyError, OverflowError):
                raise DamagedFileError(
                    f"{self.parts.file(name)} holds no step of a search. {self.parts.remedy}"
                ) from None
            if result is None:
                raise InputError(
                    f"generation {number} in {self.parts.folder} holds other candidates than this "
                    "version or machine draws: use another folder, or delete this one to restart "
                    "the search"
                )
            self.seconds += seconds
            return result, False
        begin = time.monotonic()
        values = make()
        seconds = time.monotonic() - begin
        if self.parts is not None:
            # Python writes floats so that they are read back bit-exactly.
            self.parts.put(name, {"stage": stage, **start, **values, "seconds": seconds})
        self.seconds += seconds
        return read(values), True
