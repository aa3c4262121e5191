"""Checkpoint: evaluated generations of a search, for bit-exact resume.

Neither the population nor the state of the random generator is stored. A search is a deterministic
function of its seed and of the losses that it receives. Each generation is a part of the run: its
candidates and their losses. A resumed run replays its search from the beginning with the stored
losses, which restores the state in which it stopped. Candidates that differ from the stored ones
raise an error: another library or machine drew them.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import DamagedFileError, InputError
from cablecast.runs.parts import Parts


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
