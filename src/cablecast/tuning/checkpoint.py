"""Checkpoint: evaluated generations of a search, for bit-exact resume.

Neither the population nor the state of the random generator is stored. A search is a deterministic
function of its seed and of the losses that it receives. The file holds the candidates and losses of
every generation. A resumed run replays its search from the beginning with the stored losses, which
restores the state in which it stopped. Candidates that differ from the stored ones raise an error:
another library or machine drew them.
"""

import json
import pathlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.files import write_text
from cablecast.reading import read_sealed, seal

_GO_ON = "delete it to restart the search"


class Checkpoint:
    """Evaluated generations of a search, stored in a file.

    Args:
        path: File of the generations; None keeps them in memory only.

    Raises:
        InputError: The file is damaged.
        UnreadableFileError: The system refuses to read it.
    """

    def __init__(self, path: pathlib.Path | None):
        self.path = path
        self.generations: list[dict[str, Any]] = []
        self._answered = 0
        if path is None:
            return
        try:
            stored = read_sealed(path)
        except FileNotFoundError:
            return
        except (InputError, RecursionError) as error:
            reason = str(error) if isinstance(error, InputError) else f"{path} is damaged"
            raise InputError(f"{reason}: {_GO_ON}") from None
        self.generations = _generations(path, stored)

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
            raise InputError(
                f"generation {self._answered} of {self.path} holds other candidates than this "
                f"version or machine draws: use another folder, or {_GO_ON}"
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
        """Add a simulated generation and write the file.

        Args:
            stage: Name of the loss function.
            candidates: Candidates of the generation, shape [candidate, dimension].
            losses: Losses of the candidates, shape [candidate].
            seconds: Time of the simulation [s].
        """
        self.generations.append(
            {
                "stage": stage,
                "candidates": candidates.tolist(),
                "losses": losses.tolist(),
                "seconds": seconds,
            }
        )
        self._answered = len(self.generations)
        if self.path is not None:
            # Python writes floats so that they are read back bit-exactly.
            write_text(self.path, json.dumps(seal({"generations": self.generations})) + "\n")


def _generations(path: pathlib.Path, stored: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the generations of a file with a valid checksum."""
    try:
        return [_generation(entry) for entry in stored["generations"]]
    except (ValueError, TypeError, KeyError, OverflowError):
        raise InputError(f"{path} holds no generations of a search: {_GO_ON}") from None


def _generation(entry: dict[str, Any]) -> dict[str, Any]:
    """Check a stored generation and return it."""
    candidates = np.array(entry["candidates"], dtype=float)
    losses = np.array(entry["losses"], dtype=float)
    if candidates.ndim != 2 or losses.shape != (len(candidates),):
        raise ValueError
    return {
        "stage": str(entry["stage"]),
        "candidates": candidates.tolist(),
        "losses": losses.tolist(),
        "seconds": float(entry["seconds"]),
    }
