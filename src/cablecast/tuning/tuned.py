"""Tuned: a simulator that follows the real cable, and params.json, which keeps it."""

import dataclasses
import pathlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import PAPER_PARAMS, CableParams
from cablecast.conventions import finite_or_none
from cablecast.engines import make_engine
from cablecast.engines.base import Engine, Rollout
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import DamagedFileError, InputError, check_name
from cablecast.files import CHECKSUM_KEY, read_json, read_sealed, seal, write_json
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.motion.servo import ServoModel
from cablecast.setup import Setup
from cablecast.tuning.ensemble import Ensemble, believed_ensemble
from cablecast.tuning.space import ParamPosterior
from cablecast.tuning.tracks import TrackDistances
from cablecast.tuning.tune import TuneResult

PARAMS_FILE = "params.json"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tuned:
    """A simulator that follows the real cable as well as was found.

    Attributes:
        setup: Set-up of the casts that it was tuned to.
        dynamics: Parameters of the cable, fitted material, and servo of the arm;
            the latter is None where no joints were reported.
        ensemble: Simulators with other physics that follow the casts as well, without servo; None
            for a search, which makes none.
        posterior: Uncertainty of the parameters; None for a search.
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

    def to_dict(self) -> dict[str, Any]:
        """Return what `load_tuned` reads, as plain values to write with `write_params`."""
        servo, ensemble, posterior = self.dynamics.servo, self.ensemble, self.posterior
        return {
            "cable": self.setup.cable.name,
            "params": self.params.to_dict(),
            "servo": None if servo is None else servo.to_dict(),
            "ensemble": None if ensemble is None else ensemble.to_dict(),
            "posterior": None if posterior is None else posterior.to_dict(),
            "search_range": None if posterior is None else posterior.space.to_dict(),
            "dataset_fingerprint": self.metrics.get("dataset_fingerprint"),
        }

    def rollout(
        self, motion: GripPath | ArrayLike, engine: Engine | None = None, **options: Any
    ) -> Rollout:
        """Play casts as the fit has them: with its cable, material and servo.

        Args:
            motion: Actions (theta1, theta2, r2, psi, pace), shape [5] or [cast, 5]; or paths that
                the gripper is commanded to take.
            engine: Simulator; `EngineWarp` by default, which alone plays a material.
            **options: Arguments of `Engine.rollout` after the path.

        Raises:
            ActionError: An action is not a casting motion.
        """
        if not isinstance(motion, GripPath):
            motion = cast_grip_paths(np.atleast_2d(np.asarray(motion, dtype=float)), self.setup)
        return self.dynamics.rollout(engine or make_engine("warp"), self.setup, motion, **options)

    @classmethod
    def believed(cls, setup: Setup, seed: int = 0) -> "Tuned":
        """Return a simulator of the most likely cable before any cast, and of others it may be.

        The seed draws the others.
        """
        ensemble = believed_ensemble(setup.cable, make_engine("warp"), seed)
        posterior = ParamPosterior.before_casts(setup.cable)
        return cls(
            setup=setup, dynamics=ensemble.members[0], ensemble=ensemble, posterior=posterior
        )

    @classmethod
    def of(cls, value: "Tuned | CableParams | None", setup: Setup) -> "Tuned":
        """Return what to simulate a set-up with: None stands for its cable's own parameters.

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
    """Return what `cablecast tune` left in a folder or in its params.json, or a person wrote.

    A checksum is verified if there is one. A file that a person wrote needs the parameters alone.
    They must be those of the cable of the set-up.

    Raises:
        InputError: There is no such file, it is damaged, was changed since it was written, or holds
            parameters of another cable.
        UnreadableFileError: The system refuses to read it.
    """
    file = pathlib.Path(path)
    file = file / PARAMS_FILE if file.is_dir() else file
    values = _read(file)
    try:
        stored = values.get("cable")
        if stored is not None:
            check_name(stored, "cable")
        params = CableParams.from_dict(values["params"])
        servo, ensemble, posterior, fingerprint = (
            values.get(name) for name in ("servo", "ensemble", "posterior", "dataset_fingerprint")
        )
        tuned = Tuned(
            setup=setup,
            dynamics=Dynamics(
                params=params, servo=None if servo is None else ServoModel.from_dict(servo)
            ),
            ensemble=None if ensemble is None else Ensemble.from_dict(ensemble),
            posterior=None
            if posterior is None
            else ParamPosterior.from_dict(posterior, values["search_range"], params),
            metrics={"dataset_fingerprint": str(fingerprint)} if fingerprint else {},
            path=pathlib.Path(path),
        )
    except (InputError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise _refusal(file, error) from None
    if stored not in (None, setup.cable.name):
        raise InputError(f"{file} holds parameters of {stored}, not of {setup.cable.name}")
    return tuned


def _read(file: pathlib.Path) -> Mapping[str, Any]:
    """Return the entries of params.json, which hold parameters."""
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
    return values


def _refusal(file: pathlib.Path, error: Exception) -> InputError:
    """Return a one-line error that names the file."""
    reason = " ".join(str(error).split())[:300].removeprefix(f"{file} is damaged: ")
    return InputError(f"{file} does not hold tuned parameters: {reason}")


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
    """Return the content of params.json as plain values; see `write_params`."""
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
    """Return distances of one candidate in % of cable length, as in the paper's tuning table."""
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
    """Return minimum, median and maximum of the ten in the final population, by name."""
    values = {name: getattr(population, name) for name in PAPER_PARAMS}
    values |= {name: value(population) for name, value in _DERIVED.items()}
    return {
        name: [float(np.quantile(column, q)) for q in (0.0, 0.5, 1.0)]
        for name, column in values.items()
    }


def write_params(path: pathlib.Path, values: Mapping[str, Any]) -> None:
    """Write params.json, or that of a folder, with a checksum over its content.

    Values are those of `params_file`, and `cable`, the name of the tuned cable.
    """
    file = path / PARAMS_FILE if path.is_dir() else path
    sealed = seal(dict(values))
    # On the first line, so that a person may delete it without breaking the commas.
    write_json(file, {CHECKSUM_KEY: sealed.pop(CHECKSUM_KEY), **sealed})
