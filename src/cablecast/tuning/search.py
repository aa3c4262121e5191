"""Search methods over the unit cube, with one batch of candidates per generation.

`ask` returns candidates, and `tell` updates the search with their losses. A method is a
deterministic function of its seed and these losses, so that stored losses suffice to resume it.

Checkpoint: evaluated generations of a search, for bit-exact resume.

Neither the population nor the state of the random generator is stored. A search is a deterministic
function of its seed and of the losses that it receives. Each generation is a part of the run: its
candidates and their losses. A resumed run replays its search from the beginning with the stored
losses, which restores the state in which it stopped. Candidates that differ from the stored ones
raise an error: another library or machine drew them.
"""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import (
    DamagedFileError,
    InputError,
    MissingExtraError,
    UnknownNameError,
    check_count,
    check_seed,
)
from cablecast.runs.folder import Parts

METHODS = ("de", "cmaes")

RECOMBINATION = 0.7
MUTATION = (0.5, 1.0)
"""The paper's values, which are SciPy's defaults (arXiv source of the paper)."""

POPULATION_MIN = 4
"""Minimum for the strategy best1bin: a member, the best, and two others."""
POPULATION_MAX = 10_000

_CMA_SIGMA = 0.25


class Search(Protocol):
    """A search over the unit cube.

    Attributes:
        population: Best points so far, from which the search continues, shape [member, dimension].
        losses: Their losses, shape [member].
    """

    population: NDArray[np.float64]
    losses: NDArray[np.float64]

    def ask(self) -> NDArray[np.float64]:
        """Return candidates of the next generation, shape [candidate, dimension]."""
        ...

    def tell(self, candidates: NDArray[np.float64], losses: NDArray[np.float64]) -> None:
        """Update the search with the losses of its last candidates."""
        ...

    def shrink(self, population_size: int) -> None:
        """Keep only the best members.

        Args:
            population_size: Number of members to keep, at most the present number.
        """
        ...

    def restart(self, losses: NDArray[np.float64]) -> None:
        """Continue with another loss function.

        Args:
            losses: Losses of the population under the new function, shape [member].
        """
        ...


class SearchDE:
    """Differential Evolution, strategy best1bin with dithered mutation, updated by generations.

    Each member x is challenged by best + F (x_a - x_b). The challenger takes each coordinate of
    this mutant with the recombination probability, and at least one. F is drawn from the mutation
    range once per generation. Coordinates outside the cube are redrawn. The better of member and
    challenger survives. SciPy's `differential_evolution(updating="deferred")` does the same.

    Args:
        start: First member of the initial population; the others are a Latin hypercube.
        population_size: Number of members.
        rng: Random generator.
        recombination: Crossover probability.
        mutation: Range of F.
    """

    def __init__(
        self,
        start: NDArray[np.float64],
        population_size: int,
        rng: np.random.Generator,
        *,
        recombination: float = RECOMBINATION,
        mutation: tuple[float, float] = MUTATION,
    ):
        check_count("population_size", population_size, POPULATION_MIN, POPULATION_MAX)
        self._rng = rng
        self._recombination = recombination
        self._mutation = mutation
        self.population = latin_hypercube(population_size, len(start), rng)
        self.population[0] = start
        self.losses = np.full(population_size, np.inf)

    def ask(self) -> NDArray[np.float64]:
        """Return the initial population, then one challenger for each member."""
        if not np.isfinite(self.losses).any():
            return self.population.copy()
        rng, (size, dimension) = self._rng, self.population.shape
        best = self.population[np.argmin(self.losses)]
        factor = rng.uniform(*self._mutation)
        # Two others for each member: the first two of a random order of all but the member itself.
        order = np.argsort(rng.random((size, size - 1)), axis=1)[:, :2]
        others = order + (order >= np.arange(size)[:, None])
        mutant = best + factor * (self.population[others[:, 0]] - self.population[others[:, 1]])
        taken = rng.random((size, dimension)) < self._recombination
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

    def shrink(self, population_size: int) -> None:
        """Keep the best members."""
        best = np.argsort(self.losses, kind="stable")[:population_size]
        self.population, self.losses = self.population[best], self.losses[best]

    def restart(self, losses: NDArray[np.float64]) -> None:
        """Keep the population with new losses."""
        self.losses = np.array(losses, dtype=float)


class SearchCMAES:
    """Covariance matrix adaptation (CMA-ES), from the `cma` library.

    The population holds the best candidates since the loss function last changed.

    Args:
        start: Mean of the first generation.
        population_size: Number of candidates of a generation.
        rng: Random generator.
    """

    def __init__(self, start: NDArray[np.float64], population_size: int, rng: np.random.Generator):
        try:
            import cma
        except ImportError:
            raise MissingExtraError("cma", "tune", "the search method cmaes") from None
        check_count("population_size", population_size, POPULATION_MIN, POPULATION_MAX)
        options = {
            "bounds": [0.0, 1.0],
            "popsize": population_size,
            # The library would seed NumPy's global generator; pass ours instead.
            "seed": np.nan,
            "randn": lambda *shape: rng.standard_normal(shape),
            "verbose": -9,
            "verb_log": 0,
        }
        self._strategy = cma.CMAEvolutionStrategy(np.clip(start, 0.02, 0.98), _CMA_SIGMA, options)
        self._size = population_size
        self.population = np.empty((0, len(start)))
        self.losses = np.empty(0)

    def ask(self) -> NDArray[np.float64]:
        """Return a sample of the adapted distribution."""
        return np.array(self._strategy.ask())

    def tell(self, candidates: NDArray[np.float64], losses: NDArray[np.float64]) -> None:
        """Adapt the distribution."""
        self._strategy.tell(list(candidates), list(losses))
        self._keep(np.concatenate([self.population, candidates]), np.append(self.losses, losses))

    def shrink(self, population_size: int) -> None:
        """Keep only the best points.

        The size of a generation does not change, since the step of its mean depends on the size.
        """
        self._keep(self.population, self.losses)
        self.population = self.population[:population_size]
        self.losses = self.losses[:population_size]

    def restart(self, losses: NDArray[np.float64]) -> None:
        """Keep the distribution and the best points, with new losses."""
        self._keep(self.population, np.array(losses, dtype=float))

    def _keep(self, points: NDArray[np.float64], losses: NDArray[np.float64]) -> None:
        best = np.argsort(losses, kind="stable")[: self._size]
        self.population, self.losses = points[best], losses[best]


def latin_hypercube(count: int, dimension: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return points of the unit cube, one in each of `count` intervals of every coordinate.

    Args:
        count: Number of points.
        dimension: Number of coordinates.
        rng: Random generator.

    Returns:
        Points, shape [count, dimension].
    """
    cells = np.argsort(rng.random((dimension, count)), axis=1).T
    return (cells + rng.random((count, dimension))) / count


def make_search(method: str, start: NDArray[np.float64], population_size: int, seed: int) -> Search:
    """Return a search by the name of its method.

    Args:
        method: One of `METHODS`.
        start: Starting point of the search, shape [dimension].
        population_size: Number of candidates of a generation.
        seed: Seed of the search.

    Raises:
        UnknownNameError: There is no such method.
        InputError: The population size or the seed is out of bounds.
        MissingExtraError: The method needs a library that is not installed.
    """
    rng = np.random.default_rng(check_seed(seed))
    if method == "de":
        return SearchDE(start, population_size, rng)
    if method == "cmaes":
        return SearchCMAES(start, population_size, rng)
    raise UnknownNameError(f"unknown search method {method!r}: one of {', '.join(METHODS)}")


class Checkpoint:
    """Evaluated generations of a search.

    Args:
        parts: Folder of the generations; None keeps them in memory only.

    Raises:
        DamagedFileError: A generation is not what was stored.
        UnreadableFileError: The system refuses to read it.
    """

    def __init__(self, parts: Parts | None):
        self.parts = parts
        self.generations: list[dict[str, Any]] = []
        self._answered = 0
        while parts is not None and (stored := parts.get(self._name())) is not None:
            self.generations.append(_generation(stored, parts, self._name()))

    @property
    def seconds(self) -> float:
        """Total time of the stored generations [s]."""
        return sum(entry["seconds"] for entry in self.generations)

    def answer(self, stage: str, candidates: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Return the stored losses of the next generation; None if it was not simulated yet.

        Args:
            stage: Name of the loss function.
            candidates: Candidates of the generation, shape [candidate, dimension].

        Raises:
            InputError: Other candidates are stored.
        """
        if self._answered == len(self.generations):
            return None
        entry = self.generations[self._answered]
        if entry["stage"] != stage or not np.array_equal(entry["candidates"], candidates):
            folder = None if self.parts is None else self.parts.folder
            raise InputError(
                f"generation {self._answered} in {folder} holds other candidates than this version "
                "or machine draws: use another folder, or delete this one to restart the search"
            )
        self._answered += 1
        return np.array(entry["losses"])

    def store(
        self,
        stage: str,
        candidates: NDArray[np.float64],
        losses: NDArray[np.float64],
        seconds: float,
    ) -> None:
        """Add a simulated generation.

        Args:
            stage: Name of the loss function.
            candidates: Candidates of the generation, shape [candidate, dimension].
            losses: Losses of the candidates, shape [candidate].
            seconds: Time of the simulation [s].
        """
        entry = {
            "stage": stage,
            "candidates": candidates.tolist(),
            "losses": losses.tolist(),
            "seconds": seconds,
        }
        if self.parts is not None:
            # Python writes floats so that they are read back bit-exactly.
            self.parts.put(self._name(), entry)
        self.generations.append(entry)
        self._answered = len(self.generations)

    def _name(self) -> str:
        """Return the name of the part of the generation after those at hand."""
        return f"{len(self.generations):04d}"


def _generation(stored: dict[str, Any], parts: Parts, name: str) -> dict[str, Any]:
    """Return a stored generation, if it is one."""
    try:
        candidates = np.array(stored["candidates"], dtype=float)
        losses = np.array(stored["losses"], dtype=float)
        if candidates.ndim != 2 or losses.shape != (len(candidates),):
            raise ValueError
        return {
            "stage": str(stored["stage"]),
            "candidates": candidates.tolist(),
            "losses": losses.tolist(),
            "seconds": float(stored["seconds"]),
        }
    except (ValueError, TypeError, KeyError, OverflowError):
        raise DamagedFileError(
            f"{parts.file(name)} holds no generation of a search. Delete it, and the same command "
            "makes it again"
        ) from None
