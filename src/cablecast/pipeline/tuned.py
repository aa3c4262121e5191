"""Tuned: parameters of a cable and servo of an arm, as `tune` finds them."""

import dataclasses
import pathlib
from typing import Any

from cablecast.cable import CableParams
from cablecast.errors import InputError
from cablecast.material import Material
from cablecast.motion.servo import ServoModel
from cablecast.setup import Setup
from cablecast.tuning.posterior import ParamPosterior


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tuned:
    """A simulator that follows the real cable as well as was found.

    Attributes:
        setup: Set-up of the casts that it was tuned to.
        params: Parameters of the cable.
        servo: Servo of the arm; None where no joints were reported.
        material: Material of the cable that the casts asked for; None for that of the set-up.
        posterior: What is known of the parameters; None for a search, which does not tell.
        metrics: Distances before and after, search history and the like, as metrics.json holds
            them; empty where nothing was searched.
        path: Folder of the results, if they were kept.
    """

    setup: Setup
    params: CableParams
    servo: ServoModel | None = None
    material: Material | None = None
    posterior: ParamPosterior | None = None
    metrics: dict[str, Any] = dataclasses.field(default_factory=dict)
    path: pathlib.Path | None = None

    @classmethod
    def of(cls, value: "Tuned | CableParams | None", setup: Setup) -> "Tuned":
        """Return what to simulate with.

        Args:
            value: Result of `tune`, parameters alone, or None for the cable's own.
            setup: Set-up to simulate.

        Raises:
            InputError: The parameters were tuned for another cable.
        """
        if value is None:
            return cls(setup=setup, params=setup.cable.params)
        if isinstance(value, CableParams):
            return cls(setup=setup, params=value)
        if value.setup.cable.name != setup.cable.name:
            raise InputError(
                f"the parameters are those of {value.setup.cable.name}, not of {setup.cable.name}"
            )
        return value


def load_tuned(path: str | pathlib.Path, setup: Setup) -> Tuned:
    """Return what `cablecast tune` left in a folder or in its params.json.

    Args:
        path: The folder, or the file.
        setup: Set-up to simulate; the parameters must be those of its cable.

    Raises:
        InputError: There is no such file, it is damaged, or holds parameters of another cable.
    """
    from cablecast.tuning.result import read_material, read_params, read_posterior, read_servo

    return Tuned(
        setup=setup,
        params=read_params(path, setup.cable),
        servo=read_servo(path),
        material=read_material(path),
        posterior=read_posterior(path),
        path=pathlib.Path(path),
    )
