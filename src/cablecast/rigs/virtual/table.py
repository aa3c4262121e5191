"""The table's face: foam boards that are not all alike, worn here and there, with seams between."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.rigs.virtual._hidden import HiddenTable
from cablecast.workspace import Workspace

_CELL = 0.005
"""Resolution of the map [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrictionMap:
    """How the friction of each place compares with the mean.

    Attributes:
        origin: Corner of the map with the smallest x and y [m], shape [2].
        factors: Factor of each cell [-], shape [x, y].
    """

    origin: NDArray[np.float64]
    factors: NDArray[np.float64]

    def factor(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Factors at some places [m], shape [..., 2] -> [...]; the rim's beyond the rim."""
        last = np.array(self.factors.shape) - 1
        index = np.floor((xy - self.origin) / _CELL)
        # A cable that has blown up has no place.
        index = np.where(np.isfinite(index), index, 0.0)
        index = np.clip(index, 0, last).astype(np.intp)
        return self.factors[index[..., 0], index[..., 1]]


def friction_map(table: HiddenTable, workspace: Workspace) -> FrictionMap:
    """Draw the face of a table.

    Args:
        table: How uneven it is, and its seed.
        workspace: Its size.
    """
    rng = np.random.default_rng(table.seed)
    origin = np.array([-workspace.table_width / 2, 0.0])
    counts = [round(workspace.table_width / _CELL) + 1, round(workspace.table_depth / _CELL) + 1]
    x, y = (origin[axis] + (np.arange(counts[axis]) + 0.5) * _CELL for axis in (0, 1))
    worn = np.zeros((len(x), len(y)))
    # A sum of waves in random directions is a smooth random field.
    for _ in range(table.wave_count):
        wave = rng.normal(size=2) / table.wear_length
        phase = rng.uniform(0.0, 2 * np.pi)
        worn += np.cos(wave[0] * x[:, None] + wave[1] * y + phase)
    worn *= table.wear * np.sqrt(2.0 / table.wave_count)
    column, from_x = _boards(x, origin[0] + table.first_seam[0], table.board_size[0])
    row, from_y = _boards(y, table.first_seam[1], table.board_size[1])
    boards = table.board * rng.normal(size=(column.max() + 1, row.max() + 1))
    factors = np.exp(worn + boards[column[:, None], row])
    seam = np.minimum(from_x[:, None], from_y) < table.seam_width / 2
    factors[seam] *= 1.0 + table.seam
    return FrictionMap(origin=origin, factors=factors)


def _boards(
    places: NDArray[np.float64], first: float, size: float
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Index of the board at each place, and the distance to its nearest seam [m]."""
    board = np.floor((places - first) / size)
    within = (places - first) - board * size
    return (board - board.min()).astype(np.intp), np.minimum(within, size - within)
