"""Tuned: a simulator that follows the real cable, and params.json, which keeps it."""

import collections
import concurrent.futures
import dataclasses
import functools
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import CableParams
from cablecast.engines import make_engine
from cablecast.engines.base import Engine, Rollout, engine_settings
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import DamagedFileError, InputError, check_count, check_name, check_number
from cablecast.files import (
    CHECKSUM_KEY,
    core_count,
    read_json,
    read_sealed,
    seal,
    write_json,
)
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.grip_path import GripPath
from cablecast.motion.servo import ServoModel
from cablecast.runs.folder import fingerprint
from cablecast.runs.places import TUNE_FOLDER, check_not_aim
from cablecast.setup import Setup
from cablecast.task import LANDING, Task
from cablecast.tuning.ensemble import MEMBER_COUNT, ParamUpdate
from cablecast.tuning.fit import FitConfig
from cablecast.tuning.landings import (
    APART_MAX,
    FRICTION_STEP,
    SLIDES_OFF,
    SLIPPERY,
    KnownLandings,
    LandingEstimate,
    estimate_landings,
    miss_factor,
)
from cablecast.tuning.space import ParamPosterior, ParamPrior, SearchSpace
from cablecast.tuning.tracks import MeasuredTracks

PARAMS_FILE = "params.json"


Resolution = tuple[int | None, float | None]
"""Segments of a simulated cable and time step [s]; the engine's default if None."""

# Between samples the free end moves by some centimetres where it turns at the back [s].
_SAMPLE_DT = 0.05


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Tuned:
    """Simulators that follow the real cable as well as was found.

    The best one is simulated at full resolution. Where a fit made an ensemble, its members follow
    the same casts with other physics, and are simulated more coarsely. Landings that were simulated
    once are known from then on.

    Attributes:
        setup: Set-up of the casts that it was tuned to.
        dynamics: Parameters of the cable, fitted material, and servo of the arm;
            the latter is None where no joints were reported.
        members: Ensemble, with the servo of the best one; the first has the material that was
            found. Empty for a search, which makes none.
        resolution: Resolution at which the best simulator was fitted.
        member_resolution: Resolution at which the members were fitted.
        posterior: Uncertainty of the parameters; None for a search.
        fitted_to: Fingerprint of the casts that it was fitted to, empty where it is unknown; None
            before any cast.
        metrics: Content of metrics.json: distances before and after, search history and the like.
            Empty where a folder was read, and where nothing was searched.
        path: Folder of the results, if they were kept.
    """

    setup: Setup
    dynamics: Dynamics
    members: tuple[Dynamics, ...] = ()
    resolution: Resolution = (None, None)
    member_resolution: Resolution = (None, None)
    posterior: ParamPosterior | None = None
    fitted_to: str | None = ""
    metrics: dict[str, Any] = dataclasses.field(default_factory=dict)
    path: pathlib.Path | None = None

    @property
    def params(self) -> CableParams:
        """Parameters of the cable."""
        return self.dynamics.params

    @functools.cached_property
    def engine(self) -> Engine:
        """Engine of the best simulator."""
        return make_engine("warp", *self.resolution)

    @functools.cached_property
    def member_engine(self) -> Engine:
        """Engine of the members."""
        return make_engine("warp", *self.member_resolution)

    def with_servo(self, servo: ServoModel | None) -> "Tuned":
        """Return the same cables on an arm with a servo."""
        best, *members = (
            dataclasses.replace(one, servo=servo) for one in (self.dynamics, *self.members)
        )
        return dataclasses.replace(self, dynamics=best, members=tuple(members))

    def to_dict(self) -> dict[str, Any]:
        """Return what `load_tuned` reads, as plain values to write with `write_params`."""
        servo, posterior = self.dynamics.servo, self.posterior
        return {
            "cable": self.setup.cable.name,
            "dataset_fingerprint": self.fitted_to,
            "params": self.params.to_dict(),
            "servo": None if servo is None else servo.to_dict(),
            "ensemble": self._ensemble_dict() if self.members else None,
            "posterior": None if posterior is None else posterior.to_dict(),
            "search_range": None if posterior is None else posterior.space.to_dict(),
        }

    def _ensemble_dict(self) -> dict[str, Any]:
        return {
            "members": [{"params": member.params.to_dict()} for member in self.members],
            "segment_count": self.member_engine.segment_count,
            "dt": self.member_engine.dt,
            "fine_segment_count": self.engine.segment_count,
            "fine_dt": self.engine.dt,
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

    def tracks(
        self,
        actions: NDArray[np.float64],
        side: NDArray[np.float64] | None = None,
        simulators: Sequence[Dynamics] = (),
        engine: Engine | None = None,
    ) -> NDArray[np.float64]:
        """Return how the free end moves in simulators [m], shape [simulator, action, sample, 2].

        Casts to the left are seen as if they were to the right: each is the mirror image of one to
        the right with a cable that curls to the other side.

        Args:
            actions: Actions to the right, shape [action, 5].
            side: +1, or -1 for those that are cast to the left, shape [action]; all to the right
                if None.
            simulators: Simulators with one servo; the members where empty.
            engine: Engine that simulates them; that of the members if None.

        Returns:
            Positions every `_SAMPLE_DT`, the landing last; NaN where a simulation broke off.
        """
        side = np.ones(len(actions)) if side is None else side
        simulators = simulators or self.members
        paths = simulators[0].follow(cast_grip_paths(actions, self.setup), self.setup)
        count = len(simulators)
        # One batch: neighbouring worlds follow the same motion, and rest at about the same time.
        left = [one.mirrored() for one in simulators]
        rows = np.arange(count) + np.where(side < 0, count, 0)[:, None]
        worlds = Dynamics.stack([*simulators, *left]).rows(rows.ravel())
        paths = paths[np.repeat(np.arange(len(actions)), count)]
        engine = engine or self.member_engine
        xy = worlds.rollout(engine, self.setup, paths, sample_dt=_SAMPLE_DT).endpoint_xy
        return np.swapaxes(xy.reshape(len(actions), count, *xy.shape[1:]), 0, 1)

    def updated(self, tracks: MeasuredTracks) -> "Tuned":
        """Return the simulators after one step each towards casts that they were not fitted to.

        Simulators without a posterior stay as they are.
        """
        if not self._updates or not tracks.compared.any():
            return self
        # A few casts do not fill the cores, so the simulators run side by side.
        with concurrent.futures.ThreadPoolExecutor(core_count()) as pool:
            params = list(pool.map(lambda update: update.params_after(tracks), self._updates))
        best, *members = [
            one.with_params(found)
            for one, found in zip((self.dynamics, *self.members), params, strict=True)
        ]
        return dataclasses.replace(self, dynamics=best, members=tuple(members))

    @functools.cached_property
    def _updates(self) -> list[ParamUpdate]:
        """Update of each simulator's parameters, the best first; none without a posterior."""
        if self.posterior is None:
            return []
        cable, posterior = self.setup.cable, self.posterior
        engines = [self.engine, *(self.member_engine for _ in self.members)]
        return [
            ParamUpdate(engine, cable, posterior, one.params)
            for engine, one in zip(engines, (self.dynamics, *self.members), strict=True)
        ]

    def landings(
        self,
        actions: NDArray[np.float64],
        side: NDArray[np.float64] | None = None,
        task: Task = LANDING,
    ) -> LandingEstimate:
        """Simulate where casts land, as `tracks`, or look up those that were simulated before.

        The outcomes of a task stand for the landings.
        """
        side = np.ones(len(actions)) if side is None else side
        known = self._known[task.name]
        keys = [row.tobytes() for row in np.column_stack([actions, side])]
        row_of = {key: row for row, key in enumerate(keys) if key not in known}
        if row_of:
            new = list(row_of.values())
            count = len(self.members)
            simulators = (*self.members, *self._other_frictions, *self._slippery)
            # A few casts do not fill the cores, so both resolutions run side by side.
            with concurrent.futures.ThreadPoolExecutor(1) as pool:
                best = pool.submit(
                    self.tracks, actions[new], side[new], (self.dynamics,), self.engine
                )
                tracks = self.tracks(actions[new], side[new], simulators)
            units = task.units(self.setup)
            found = estimate_landings(
                tracks[:count],
                self.setup,
                landing_xy=task.outcome(best.result()[0]) / units,
                friction_xy=task.outcome(tracks[count : count + 2]) / units,
                slippery=tracks[-1] if self._slippery else None,
                task=task,
            )
            known.add(list(row_of), found)
        return known.estimate(keys, len(task.coordinates), min(1.0, self.factor))

    def keep_landings(self, file: pathlib.Path, task: Task = LANDING) -> None:
        """Write the landings that were simulated so far to a file, if they are not there yet."""
        self._known[task.name].keep(file, self._landings_name(task))

    def recall_landings(self, file: pathlib.Path, task: Task = LANDING) -> None:
        """Read what `keep_landings` wrote, if it was simulated by the same simulators."""
        self._known[task.name].recall(file, self._landings_name(task))

    def _landings_name(self, task: Task) -> str:
        """Return a short name of all that decides the landings."""
        resolutions = [engine_settings(engine) for engine in (self.member_engine, self.engine)]
        physics = [one.to_dict() for one in (self.dynamics, *self.members)]
        steps = [FRICTION_STEP, SLIPPERY, SLIDES_OFF, APART_MAX, _SAMPLE_DT, task.name]
        return fingerprint([self.setup.to_settings(), physics, resolutions, steps])

    @functools.cached_property
    def _known(self) -> dict[str, KnownLandings]:
        """Landings that were simulated so far, by task."""
        return collections.defaultdict(KnownLandings)

    @property
    def factor(self) -> float:
        """Size of misses over the median one [-], from how closely the fit follows its casts."""
        if self.posterior is None:
            return 1.0
        return miss_factor(self.posterior.distance, self.posterior.track_count)

    @functools.cached_property
    def _other_frictions(self) -> tuple[Dynamics, Dynamics]:
        """The first member with less and with more friction."""
        steps = (-FRICTION_STEP, FRICTION_STEP)
        less, more = (self._with_friction(np.exp(step)) for step in steps)
        return less, more

    @functools.cached_property
    def _slippery(self) -> tuple[Dynamics, ...]:
        """The first member on a slippery table, if the gripper may pass a side of the table."""
        table = self.setup.workspace
        return (self._with_friction(SLIPPERY),) if table.half_width < table.r_max else ()

    def _with_friction(self, factor: float) -> Dynamics:
        """Return the first member with its friction multiplied."""
        first = self.members[0]
        friction = np.asarray(first.params.lateral_friction) * factor
        return first.with_params(dataclasses.replace(first.params, lateral_friction=friction))

    @classmethod
    def believed(cls, setup: Setup, seed: int = 0) -> "Tuned":
        """Return a simulator of the most likely cable before any cast, and of others it may be.

        The members are drawn by the seed from what is believed of the cable; the first one, and the
        best simulator, have its most likely parameters and material.
        """
        config, cable = FitConfig(), setup.cable
        space = SearchSpace.for_cable(cable, config.materials)
        points = ParamPrior.for_cable(cable, space).draw(MEMBER_COUNT, seed)
        members = tuple(Dynamics(params=space.to_params(point)) for point in points)
        return cls(
            setup=setup,
            dynamics=members[0],
            members=members,
            member_resolution=(config.coarse_segment_count, config.coarse_dt),
            posterior=ParamPosterior.before_casts(cable),
            fitted_to=None,
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
    check_not_aim(file, TUNE_FOLDER, "its fit", InputError)
    file = file / PARAMS_FILE if file.is_dir() else file
    values = _read(file)
    try:
        stored = values.get("cable")
        if stored is not None:
            check_name(stored, "cable")
        params = CableParams.from_dict(values["params"])
        ensemble, posterior = values.get("ensemble"), values.get("posterior")
        fitted_to = values.get("dataset_fingerprint", "")
        tuned = Tuned(
            setup=setup,
            dynamics=Dynamics.from_dict(values),
            posterior=None
            if posterior is None
            else ParamPosterior.from_dict(posterior, values["search_range"], params),
            fitted_to=None if fitted_to is None else str(fitted_to),
            path=pathlib.Path(path),
            **({} if ensemble is None else _ensemble(ensemble, values.get("servo"))),
        )
    except (InputError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise _refusal(file, error) from None
    if stored not in (None, setup.cable.name):
        raise InputError(f"{file} holds parameters of {stored}, not of {setup.cable.name}")
    return tuned


def _ensemble(values: Mapping[str, Any], servo: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the fields of a fit that are stored as its ensemble."""
    members = tuple(Dynamics.from_dict({**row, "servo": servo}) for row in values["members"])
    if not members:
        raise InputError("an ensemble has no members")
    resolutions = [
        (
            check_count(prefix + "segment_count", values[prefix + "segment_count"], 2),
            check_number(prefix + "dt", values[prefix + "dt"], 1e-7, 1e-2, "s"),
        )
        for prefix in ("", "fine_")
    ]
    return {
        "members": members,
        "member_resolution": resolutions[0],
        "resolution": resolutions[1],
    }


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


def write_params(path: pathlib.Path, values: Mapping[str, Any]) -> None:
    """Write params.json, or that of a folder, with a checksum over its content.

    Values are those of `Tuned.to_dict`, and possibly others that a person reads.
    """
    file = path / PARAMS_FILE if path.is_dir() else path
    sealed = seal(dict(values))
    # On the first line, so that a person may delete it without breaking the commas.
    write_json(file, {CHECKSUM_KEY: sealed.pop(CHECKSUM_KEY), **sealed})
