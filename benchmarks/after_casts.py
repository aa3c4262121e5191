"""Arguments of benchmarks that begin after a few casts, and share fits and models with `casts`."""

import dataclasses

from benchmarks.places import ModelArgs, PlaceArgs


@dataclasses.dataclass(frozen=True, kw_only=True)
class AfterCasts(ModelArgs):
    """Rig, laboratories, and casts before the first target."""

    rig: str = "virtual"
    """Rig: virtual, strange, scattering, even, patchy, engine or example."""
    labs: tuple[int, ...] = (0, 1, 2)
    """Seeds of the laboratories."""
    calibration: int = 5
    """Casts before the first target."""

    def place_args(self) -> PlaceArgs:
        """Return the arguments of a place in this benchmark."""
        return PlaceArgs(
            counts=(self.calibration,),
            simulated=self.simulated,
            epochs=self.epochs,
            candidates=self.candidates,
            out=self.out,
        )
