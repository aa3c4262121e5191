"""params.json: result of tuning, with a checksum, which other commands read."""

import dataclasses
import pathlib
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import PARAM_BOUNDS, PARAM_UNITS, Cable, CableParams
from cablecast.checks import check_keys, check_name, check_number
from cablecast.conventions import finite_or_none
from cablecast.dynamics import Dynamics
from cablecast.errors import DamagedFileError, InputError
from cablecast.files import write_json
from cablecast.material import Material
from cablecast.motion.servo import ServoModel
from cablecast.reading import CHECKSUM_KEY, read_json, read_sealed, seal
from cablecast.tuning.ensemble import Ensemble
from cablecast.tuning.objective import TrackDistances
from cablecast.tuning.posterior import ParamPosterior
from cablecast.tuning.tune import TuneResult

PARAMS_FILE = "params.json"

_Part = TypeVar("_Part")

# A simulation depends only on the ratios of masses and stiffnesses, and on the product of the
# frictions. If the parameters spread widely but these do not, the fit is good and the spread has no
# effect.
_DERIVED = {
    "friction": lambda p: p.friction,
    "bend_stiffness_per_mass": lambda p: p.bend_stiffness / p.mass,
    "twist_stiffness_per_mass": lambda p: p.twist_stiffness / p.mass,
    "endpoint_mass_per_mass": lambda p: p.endpoint_mass / p.mass,
}


def params_file(
    result: TuneResult, cable_length: float, servo: ServoModel | None
) -> dict[str, Any]:
    """Return the content of params.json as plain values; see `write_params`.

    Args:
        result: Result of tuning.
        cable_length: Cable length r_c [m].
        servo: Servo of the arm, if it was identified.
    """
    rows = {}
    for name, distances, status in (
        ("training", result.training, result.training_status),
        ("validation", result.validation, result.validation_status),
    ):
        rows[name] = {"trials": status_counts(status)} | {
            row: distance_summary(distances, index, cable_length)
            for index, row in enumerate(("default", "tuned"))
        }
    return {
        "params": result.params.to_dict(),
        "derived": {name: float(value(result.params)) for name, value in _DERIVED.items()},
        "spread": _spread(result.population),
        "servo": None if servo is None else servo.to_dict(),
        "material": None if result.material is None else result.material.to_dict(),
        "ensemble": None if result.ensemble is None else result.ensemble.to_dict(),
        "posterior": None if result.posterior is None else result.posterior.to_dict(),
        "open": [] if result.posterior is None else result.posterior.sentences(),
        "search_range": result.space.to_dict(),
        **rows,
        "simulation_count": result.simulation_count,
        "coarse_simulation_count": result.coarse_simulation_count,
        "seconds": round(result.seconds, 1),
    }


def distance_summary(
    distances: TrackDistances, candidate: int, cable_length: float
) -> dict[str, Any]:
    """Return distances of one candidate in % of cable length, as in the paper's tuning table.

    Args:
        distances: Distances between simulated and measured tracks.
        candidate: Row of the candidate.
        cable_length: Cable length r_c [m].
    """
    mean = 100 * distances.mean[candidate] / cable_length
    final = 100 * distances.final[candidate] / cable_length
    return {
        "mean_pct": _reduced(np.mean, mean),
        "median_mean_pct": _reduced(np.median, mean),
        "final_median_pct": _reduced(np.median, final),
        "final_first_quartile_pct": _reduced(lambda v: np.quantile(v, 0.25), final),
        "final_third_quartile_pct": _reduced(lambda v: np.quantile(v, 0.75), final),
        "final_max_pct": _reduced(np.max, final),
        "track_count": int(np.isfinite(mean).sum()),
        "final_count": int(np.isfinite(final).sum()),
        "non_finite_count": int((~distances.finite[candidate]).sum()),
    }


def status_counts(status: NDArray[np.str_]) -> dict[str, int]:
    """Return the number of trials by status."""
    codes, counts = np.unique(status, return_counts=True)
    return {str(code): int(count) for code, count in zip(codes, counts, strict=True)}


def _reduced(
    reduce: Callable[[NDArray[np.float64]], Any], values: NDArray[np.float64]
) -> float | None:
    """Return a statistic of the finite values; None if there are none."""
    known = values[np.isfinite(values)]
    return finite_or_none(reduce(known)) if len(known) else None


def _spread(population: CableParams) -> dict[str, list[float]]:
    """Return minimum, median and maximum of each value in the final population, by name."""
    values = {name: getattr(population, name) for name in CableParams.names()}
    values |= {name: value(population) for name, value in _DERIVED.items()}
    return {
        name: [float(np.quantile(column, q)) for q in (0.0, 0.5, 1.0)]
        for name, column in values.items()
    }


def write_params(path: pathlib.Path, values: Mapping[str, Any]) -> None:
    """Write params.json with a checksum over its content.

    Args:
        path: File, or its folder.
        values: Content, see `params_file`; also `cable`, the name of the tuned cable.
    """
    file = path / PARAMS_FILE if path.is_dir() else path
    sealed = seal(dict(values))
    # On the first line, so that a person may delete it without breaking the commas.
    write_json(file, {CHECKSUM_KEY: sealed.pop(CHECKSUM_KEY), **sealed})


@dataclasses.dataclass(frozen=True, kw_only=True)
class ParamsFile:
    """Content of params.json: what `cablecast tune` found, or a person wrote.

    The methods raise InputError where an entry is damaged.

    Attributes:
        file: File that it was read from.
        values: Entries. Without a checksum, only the key `params` is required, a mapping of the
            ten parameters.
    """

    file: pathlib.Path
    values: Mapping[str, Any]

    @classmethod
    def read(cls, path: str | pathlib.Path) -> "ParamsFile":
        """Read params.json; a checksum, if present, is verified.

        Args:
            path: The file, or its folder.

        Raises:
            InputError: There is no such file, it does not hold parameters, or it was changed since
                it was written.
            UnreadableFileError: The system refuses to read it.
        """
        file = pathlib.Path(path)
        file = file / PARAMS_FILE if file.is_dir() else file
        try:
            values = read_json(file)
        except FileNotFoundError:
            raise InputError(
                f"there are no tuned parameters at {file}: make them with `cablecast tune`"
            ) from None
        except InputError as error:
            raise _refusal(file, error) from None
        if CHECKSUM_KEY in values:
            try:
                values = read_sealed(file)
            except (DamagedFileError, RecursionError):
                raise InputError(
                    f"{file} was changed since it was written: delete its {CHECKSUM_KEY} line to "
                    "use it anyway"
                ) from None
        if "params" not in values:
            raise InputError(f"{file} does not hold tuned parameters: it lacks the key params")
        return cls(file=file, values=values)

    def params(self, cable: Cable | None = None) -> CableParams:
        """Return the parameters.

        Args:
            cable: Cable that they must belong to; not checked if None.
        """
        names = CableParams.names()
        stored = self.values.get("cable")
        try:
            if stored is not None:
                check_name(stored, "cable")
            params = check_keys(self.values["params"], set(names), "params", required=set(names))
            numbers = {
                name: check_number(name, params[name], *PARAM_BOUNDS[name], PARAM_UNITS[name])
                for name in names
            }
        except (InputError, OverflowError) as error:
            raise _refusal(self.file, error) from None
        if cable is not None and stored not in (None, cable.name):
            raise InputError(f"{self.file} holds parameters of {stored}, not of {cable.name}")
        return CableParams(**numbers)

    def dynamics(self, cable: Cable | None = None) -> Dynamics:
        """Return parameters, material and servo; a person may have written parameters alone.

        Args:
            cable: Cable that they must belong to; not checked if None.
        """
        return Dynamics(
            params=self.params(cable),
            material=self._part("material", Material.from_dict),
            servo=self._part("servo", ServoModel.from_dict),
        )

    def ensemble(self) -> Ensemble | None:
        """Return the simulators with other physics; None for the result of a search."""
        return self._part("ensemble", Ensemble.from_dict)

    def posterior(self) -> ParamPosterior | None:
        """Return what the fit knows of the parameters; None for the result of a search."""
        return self._part(
            "posterior",
            lambda stored: ParamPosterior.from_dict(stored, self.values["search_range"]),
        )

    def casts_fingerprint(self) -> str:
        """Return the fingerprint of the casts; empty for parameters that a person wrote."""
        return self._part("dataset_fingerprint", str) or ""

    def _part(self, name: str, make: Callable[[Any], _Part]) -> _Part | None:
        """Return what a function makes of an entry; None where there is none."""
        stored = self.values.get(name)
        if stored is None:
            return None
        try:
            return make(stored)
        except (InputError, KeyError, AttributeError, OverflowError) as error:
            raise _refusal(self.file, error) from None


def read_params(path: str | pathlib.Path, cable: Cable | None = None) -> CableParams:
    """Read the parameters that `cablecast tune` found, or that a person wrote.

    Args:
        path: params.json, or its folder.
        cable: Cable that the parameters must belong to; not checked if None.

    Raises:
        InputError: There is no such file, it does not hold the ten parameters, it belongs to
            another cable, or it was changed since it was written.
        UnreadableFileError: The system refuses to read it.
    """
    return ParamsFile.read(path).params(cable)


def read_dynamics(path: str | pathlib.Path, cable: Cable | None = None) -> Dynamics:
    """Read the dynamics that `cablecast tune` found: a person may have written parameters alone.

    Args:
        path: params.json, or its folder.
        cable: Cable that the parameters must belong to; not checked if None.

    Raises:
        InputError: There is no such file, it is damaged, or belongs to another cable.
        UnreadableFileError: The system refuses to read it.
    """
    return ParamsFile.read(path).dynamics(cable)


def _refusal(file: pathlib.Path, error: Exception) -> InputError:
    """Return a one-line error that names the file."""
    reason = " ".join(str(error).split())[:300].removeprefix(f"{file} is damaged: ")
    return InputError(f"{file} does not hold tuned parameters: {reason}")
