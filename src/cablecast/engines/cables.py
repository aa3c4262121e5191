"""Cables of a batch: one that all worlds share, or one for each world."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable
from cablecast.errors import InputError
from cablecast.material import Material


@dataclasses.dataclass(frozen=True, kw_only=True)
class CableRows:
    """Geometry and material of the cables of a batch, which have their parameters beside them.

    Attributes:
        cables: One cable that all worlds share, or one for each.
        length: Length from grip to endpoint [m], shape [1] or [world].
        radius: Half the diameter [m], same shape.
        material: Material, shared or one value per world.
    """

    cables: tuple[Cable, ...]
    length: NDArray[np.float64]
    radius: NDArray[np.float64]
    material: Material

    @classmethod
    def of(cls, cable: Cable | Sequence[Cable]) -> "CableRows":
        """Return the rows of a cable that all worlds share, or of one for each world.

        Raises:
            InputError: There is no cable, or one of several has a material for each world.
        """
        cables = (cable,) if isinstance(cable, Cable) else tuple(cable)
        if not cables:
            raise InputError("a batch needs a cable, or one for each world, not none")
        return cls(
            cables=cables,
            length=np.array([c.length for c in cables]),
            radius=np.array([c.radius for c in cables]),
            material=Material.stack([c.material for c in cables]),
        )

    @property
    def world_count(self) -> int | None:
        """Number of worlds; None if they share a cable."""
        return len(self.cables) if len(self.cables) > 1 else self.material.world_count

    def kinds(self, world_count: int) -> NDArray[np.int_]:
        """Return for each world the number of its length and diameter, shape [world]."""
        shapes = np.stack([self.length, self.radius], axis=1)
        kinds = np.unique(shapes, axis=0, return_inverse=True)[1].reshape(-1)
        return np.broadcast_to(kinds, world_count)

    def cable(self, worlds: NDArray[np.int_]) -> Cable:
        """Return the cable of some worlds that are of one kind, with a material for each."""
        cable = self.cables[worlds[0] if len(self.cables) > 1 else 0]
        return cable.with_material(self.material.rows(worlds))


def one_cable(cable: Cable | Sequence[Cable]) -> Cable:
    """Return the cable of an engine whose worlds share it.

    Raises:
        InputError: There are several.
    """
    cables = [cable] if isinstance(cable, Cable) else list(cable)
    if len(cables) != 1:
        raise InputError(
            f"this engine simulates one cable at a time, not {len(cables)}: EngineWarp takes one "
            "for each world"
        )
    return cables[0]
