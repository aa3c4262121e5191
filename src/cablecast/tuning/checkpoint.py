"""What a search has paid for so far, so that it goes on bit by bit after being killed.

Neither the population nor the state of the random numbers is stored. A search is a deterministic
function of its seed and of the losses that it was told; the file keeps the losses of every
generation beside the candidates that they belong to. A run that goes on asks its search again from
the beginning, answers from the file while it can, and so arrives at the very state in which it was
stopped. That the candidates agree is checked, so a library or machine that would have drawn others
is noticed.
"""

import json
import pathlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.files import write_text


class Checkpoint:
    """Generations of a search on the disk.

    Args:
        path: The file; None keeps them in memory only.

    Raises:
        InputError: The file is damaged.
    """

    def __init__(self, path: pathlib.Path | None):
        self.path = path
        self.generations: list[dict[str, Any]] = []
        self._answered = 0
        if path is None or not path.exists():
            return
        try:
            self.generations = [
                {
                    "stage": str(entry["stage"]),
                    "candidates": [[float(v) for v in row] for row in entry["candidates"]],
                    "losses": [float(v) for v in entry["losses"]],
                    "seconds": float(entry["seconds"]),
                }
                for entry in json.loads(path.read_text())["generations"]
            ]
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise InputError(f"{path} is damaged ({error!r}): delete it to begin again") from None

    @property
    def seconds(self) -> float:
        """Time that the stored generations took [s]."""
        return sum(entry["seconds"] for entry in self.generations)

    def answer(self, stage: str, candidates: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The stored losses of the next generation; None where it was not yet simulated.

        Args:
            stage: Which loss function.
            candidates: What the search asks for, shape [candidate, dimension].

        Raises:
            InputError: Other candidates are stored.
        """
        if self._answered == len(self.generations):
            return None
        entry = self.generations[self._answered]
        if entry["stage"] != stage or not np.array_equal(entry["candidates"], candidates):
            raise InputError(
                f"generation {self._answered} of {self.path} holds other candidates than this "
                "version or machine draws: give another folder, or delete the file to begin again"
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
        """Add a generation that was simulated, and write the file.

        Args:
            stage: Which loss function.
            candidates: Shape [candidate, dimension].
            losses: Shape [candidate].
            seconds: How long it took [s].
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
            # Python writes floats so that they are read back bit by bit.
            write_text(self.path, json.dumps({"generations": self.generations}) + "\n")
