"""Arguments of benchmarks that begin after a few casts, and share fits and models with `casts`."""

import dataclasses
import pathlib

from benchmarks import casts


@dataclasses.dataclass(frozen=True, kw_only=True)
class AfterCasts:
    """Rig, laboratories, and how the models learn."""

    rig: str = "virtual"
    """Rig: virtual, strange, scattering, even, patchy, engine or example."""
    labs: tuple[int, ...] = (0, 1, 2)
    """Seeds of the laboratories."""
    calibration: int = 5
    """Casts before the first target."""
    simulated: int = 16_000
    """Simulated casts that each model learns from."""
    epochs: int = 60
    """Largest number of passes over them."""
    candidates: int = 20_000
    """Motions that planning chooses from."""
    out: pathlib.Path = pathlib.Path("runs/benchmarks/casts")
    """Folder of the results, which the same command goes on with."""

    def place_args(self) -> casts.Args:
        """Return the arguments of `benchmarks casts` that a place takes."""
        return casts.Args(
            rigs=(self.rig,),
            counts=(self.calibration,),
            simulated=self.simulated,
            epochs=self.epochs,
            candidates=self.candidates,
            out=self.out,
        )
