"""Tuned: a simulator that follows the real cable, as `tune` finds it."""

import dataclasses
import pathlib
from typing import Any

from cablecast.cable import CableParams
from cablecast.engines import make_engine
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import InputError
from cablecast.setup import Setup
from cablecast.tuning.ensemble import Ensemble, believed_ensemble
from cablecast.tuning.space import ParamPosterior


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tuned:
    """A simulator that follows the real cable as well as was found.

    Attributes:
        setup: Set-up of the casts that it was tuned to.
        dynamics: Parameters of the cable, fitted material, and servo of the arm;
            the latter is None where no joints were reported.
        ensemble: Simulators with other physics that follow the casts as well, without servo; None
            for a search, which makes none.
        posterior: What is known of the parameters; None for a search, which does not tell.
        metrics: Distances before and after, search history and the like, as metrics.json holds
            them; nothing but the fingerprint of the casts where a folder was read, and empty where
            nothing was searched.
        path: Folder of the results, if they were kept.
    """

    setup: Setup
    dynamics: Dynamics
    ensemble: Ensemble | None = None
    posterior: ParamPosterior | None = None
    metrics: dict[str, Any] = dataclasses.field(default_factory=dict)
    path: pathlib.Path | None = None

    @property
    def params(self) -> CableParams:
        """Parameters of the cable."""
        return self.dynamics.params

    @classmethod
    def believed(cls, setup: Setup, seed: int = 0) -> "Tuned":
        """Return a simulator of the most likely cable before any cast, and of others it may be.

        Args:
            setup: Set-up with the cable, its believed values and deviations.
            seed: Seed of the others.
        """
        ensemble = believed_ensemble(setup.cable, make_engine("warp"), seed)
        posterior = ParamPosterior.before_casts(setup.cable)
        return cls(
            setup=setup, dynamics=ensemble.members[0], ensemble=ensemble, posterior=posterior
        )

    @classmethod
    def of(cls, value: "Tuned | CableParams | None", setup: Setup) -> "Tuned":
        """Return what to simulate with.

        Args:
            value: Result of `tune`, parameters alone, or None for the cable's own.
            setup: Set-up to simulate.

        Raises:
            InputError: The parameters were tuned for another cable.
        """
        if value is None or isinstance(value, CableParams):
            return cls(setup=setup, dynamics=Dynamics.of(value, setup))
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
    from cablecast.tuning.tune import ParamsFile

    found = ParamsFile.read(path)
    fingerprint = found.casts_fingerprint()
    return Tuned(
        setup=setup,
        dynamics=found.dynamics(setup.cable),
        ensemble=found.ensemble(),
        posterior=found.posterior(),
        metrics={"dataset_fingerprint": fingerprint} if fingerprint else {},
        path=pathlib.Path(path),
    )
