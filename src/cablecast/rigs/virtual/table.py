"""The table's face: foam boards that are not all alike, worn here and there, with seams between."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.rigs.virtual._hidden import HiddenTable
from cablecast.workspace import Workspace

CELL = 0.005
"""Resolution of the map [m]."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class FrictionMap:
    """Friction of each place of the table, as a multiple of the mean.

    Attributes:
        origin: Corner of the map with the smallest x and y [m], shape [2].
        factors: Factor of each cell [-], shape [x, y].
    """

    origin: NDArray[np.float64]
    factors: NDArray[np.float64]

    def factor(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the factors at some places; beyond the rim those of the rim.

        Args:
            xy: Places [m], shape [..., 2].

        Returns:
            Factors [-], shape [...].
        """
        last = np.array(self.factors.shape) - 1
        index = np.floor((xy - self.origin) / CELL)
        # A cable that has blown up has no place.
        index = np.where(np.isfinite(index), index, 0.0)
        index = np.clip(index, 0, last).astype(np.intp)
        return self.factors[index[..., 0], index[..., 1]]


def friction_map(table: HiddenTable, workspace: Workspace) -> FrictionMap:
    """Draw the face of a table.

    The face belongs to the table, and moves and turns with it.

    Args:
        table: Unevenness of the table, and its seed.
        workspace: Gives the table's size and place.
    """
    origin = np.array([-workspace.half_width, workspace.y_min])
    size = np.array([2 * workspace.half_width, workspace.y_max - workspace.y_min])
    quarter_turns = round(workspace.table_yaw_deg / 90.0) % 4
    factors = _face(table, size[::-1] if quarter_turns % 2 else size)
    # Turned to the right, which is against the sense of rot90.
    return FrictionMap(origin=origin, factors=np.rot90(factors, -quarter_turns))


def _face(table: HiddenTable, size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the factors of a table that is not turned, shape [x, y].

    Args:
        table: Unevenness of the table, and its seed.
        size: Extent along x and y [m], shape [2].
    """
    rng = np.random.default_rng(table.seed)
    origin = np.array([-float(size[0]) / 2, 0.0])
    counts = [round(float(extent) / CELL) + 1 for extent in size]
    x, y = (origin[axis] + (np.arange(counts[axis]) + 0.5) * CELL for axis in (0, 1))
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
    return factors


def _boards(
    places: NDArray[np.float64], first: float, size: float
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the index of the board at each place, and the distance to its nearest seam [m]."""
    board = np.floor((places - first) / size)
    within = (places - first) - board * size
    return (board - board.min()).astype(np.intp), np.minimum(within, size - within)
