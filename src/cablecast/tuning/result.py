"""The file that tuning leaves, params.json, and what other verbs read from it."""

import json
import pathlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import Cable, CableParams
from cablecast.errors import InputError
from cablecast.motion.servo import ServoModel
from cablecast.tuning.objective import TrackDistances
from cablecast.tuning.tune import TuneResult

PARAMS_FILE = "params.json"

# What a simulation depends on: the masses and stiffnesses only by their ratios, the frictions by
# their product. Parameters that spread widely while these do not are not badly fitted, but of no
# consequence.
_DERIVED = {
    "friction": lambda p: p.friction,
    "bend_stiffness_per_mass": lambda p: p.bend_stiffness / p.mass,
    "twist_stiffness_per_mass": lambda p: p.twist_stiffness / p.mass,
    "endpoint_mass_per_mass": lambda p: p.endpoint_mass / p.mass,
}


def params_file(result: TuneResult, cable_length: float, servo: ServoModel | None) -> dict:
    """What params.json holds, as plain values.

    Args:
        result: What tuning found.
        cable_length: Cable length r_c [m].
        servo: How the arm follows its set points, where it was identified.
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
        "search_range": result.space.to_dict(),
        **rows,
        "simulation_count": result.simulation_count,
        "coarse_simulation_count": result.coarse_simulation_count,
        "seconds": round(result.seconds, 1),
    }


def distance_summary(
    distances: TrackDistances, candidate: int, cable_length: float
) -> dict[str, Any]:
    """Distances of one candidate in % of cable length, as the paper's table of tuning has them.

    Args:
        distances: Of some tracks.
        candidate: Which row.
        cable_length: Cable length r_c [m].
    """
    mean = 100 * distances.mean[candidate] / cable_length
    final = 100 * distances.final[candidate] / cable_length
    return {
        "mean_pct": _number(np.nanmean, mean),
        "median_mean_pct": _number(np.nanmedian, mean),
        "final_median_pct": _number(np.nanmedian, final),
        "final_first_quartile_pct": _number(lambda v: np.nanquantile(v, 0.25), final),
        "final_third_quartile_pct": _number(lambda v: np.nanquantile(v, 0.75), final),
        "final_max_pct": _number(np.nanmax, final),
        "track_count": int(np.isfinite(mean).sum()),
        "final_count": int(np.isfinite(final).sum()),
        "non_finite_count": int((~distances.finite[candidate]).sum()),
    }


def status_counts(status: NDArray[np.str_]) -> dict[str, int]:
    """How many trials ended in each way."""
    codes, counts = np.unique(status, return_counts=True)
    return {str(code): int(count) for code, count in zip(codes, counts, strict=True)}


def _number(reduce, values: NDArray[np.float64]) -> float | None:
    return float(reduce(values)) if np.isfinite(values).any() else None


def _spread(population: CableParams) -> dict[str, list[float]]:
    """Least, median and greatest value in the final population, by name."""
    values = {name: getattr(population, name) for name in CableParams.names()}
    values |= {name: value(population) for name, value in _DERIVED.items()}
    return {
        name: [float(np.quantile(column, q)) for q in (0.0, 0.5, 1.0)]
        for name, column in values.items()
    }


def read_params(path: str | pathlib.Path, cable: Cable | None = None) -> CableParams:
    """The parameters that `cablecast tune` found.

    Args:
        path: Its params.json, or the folder that holds it.
        cable: The cable that they are meant for; not checked where None.

    Raises:
        InputError: There is no such file, it does not hold ten parameters, or those of another
            cable.
    """
    file, values = _read(path)
    if cable is not None and values.get("cable", cable.name) != cable.name:
        raise InputError(f"{file} holds parameters of {values['cable']}, not of {cable.name}")
    try:
        return CableParams(**{name: values["params"][name] for name in CableParams.names()})
    except (KeyError, TypeError) as error:
        raise InputError(f"{file} does not hold ten parameters ({error!r})") from None


def read_servo(path: str | pathlib.Path) -> ServoModel | None:
    """How the arm follows its set points, where `cablecast tune` could identify it.

    Args:
        path: Its params.json, or the folder that holds it.

    Raises:
        InputError: There is no such file, or it is damaged.
    """
    _, values = _read(path)
    stored = values.get("servo")
    return None if stored is None else ServoModel.from_dict(stored)


def _read(path: str | pathlib.Path) -> tuple[pathlib.Path, dict[str, Any]]:
    file = pathlib.Path(path)
    file = file / PARAMS_FILE if file.is_dir() else file
    try:
        values = json.loads(file.read_text())
    except FileNotFoundError:
        raise InputError(
            f"there are no tuned parameters at {file}: make them with `cablecast tune`"
        ) from None
    except (OSError, ValueError) as error:
        raise InputError(f"{file} does not hold tuned parameters: {error}") from None
    if not isinstance(values, dict) or "params" not in values:
        raise InputError(f"{file} does not hold tuned parameters")
    return file, values
