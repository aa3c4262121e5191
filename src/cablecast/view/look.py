"""Casts to look at: those of a dataset, of an evaluation, or of a session of `aim`.

Each is shown as it was measured, as the believed cable would have moved, and as the tuned one does.
"""

import dataclasses
import os
import pathlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.checks import check_count
from cablecast.conventions import xy_to_polar
from cablecast.datasets.info import INFO_PATH, read_info
from cablecast.datasets.reader import Dataset, read_dataset
from cablecast.datasets.store import CastStore
from cablecast.datasets.trials import trial_track
from cablecast.dynamics import Dynamics
from cablecast.engines.base import Engine
from cablecast.errors import DatasetError, InputError
from cablecast.motion.action import Action
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.pipeline.aim import SESSION_FOLDER
from cablecast.pipeline.evaluate import CASTS_FOLDER
from cablecast.reading import read_json
from cablecast.runs.folder import CONFIG_FILE, METRICS_FILE, RunFolder
from cablecast.runs.parts import Parts
from cablecast.runs.places import TUNE_FOLDER
from cablecast.setup import SECTIONS, Setup
from cablecast.tuning.result import PARAMS_FILE, read_dynamics
from cablecast.view.album import ALBUM_FOLDER, Album
from cablecast.view.picture import Shot
from cablecast.view.shown import FRAME_DT, ShownCast


@dataclasses.dataclass(frozen=True, kw_only=True)
class LookedCast:
    """One cast of a collection.

    Attributes:
        label: Name in one line.
        action: (theta1, theta2, r2, psi) [rad, rad, m, rad], shape [4].
        target_xy: Target [m], shape [2]; None for a cast without one.
        landed_xy: Landing [m], shape [2]; NaN for a cast without one.
        measured: Function that returns the cast as it was seen; None where nobody looked.
    """

    label: str
    action: NDArray[np.float64]
    target_xy: NDArray[np.float64] | None
    landed_xy: NDArray[np.float64]
    measured: Callable[[], ShownCast] | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class Collection:
    """Casts of one set-up.

    Attributes:
        setup: Set-up of the casts.
        casts: Casts in order.
        tuned: Cable and servo of the arm as they were fitted; None where they were not.
    """

    setup: Setup
    casts: tuple[LookedCast, ...]
    tuned: Dynamics | None = None

    def __len__(self) -> int:
        return len(self.casts)

    @property
    def believed(self) -> Dynamics:
        """Cable as it is believed to be before any fit, on the arm as it was fitted."""
        servo = None if self.tuned is None else self.tuned.servo
        return Dynamics(params=self.setup.cable.params, servo=servo)

    def motion(self, index: int) -> Trajectory:
        """Return the motion of a cast.

        Raises:
            InputError: There is no such cast, or no action describes it.
        """
        check_count("cast", index, 0, len(self) - 1)
        action = self.casts[index].action
        if not np.all(np.isfinite(action)):
            raise InputError(f"no action describes the motion of cast {index}")
        return plan_trajectory(Action.from_array(action), self.setup)

    def simulated(self, index: int, engine: Engine, dynamics: Dynamics | None = None) -> ShownCast:
        """Return a cast as a simulated cable would have moved.

        Args:
            index: Index of the cast.
            engine: Simulator.
            dynamics: Cable and servo; see `believed` where None.
        """
        motion = self.motion(index)
        rollout = (dynamics or self.believed).rollout(
            engine, self.setup, motion.grip_path, sample_dt=FRAME_DT, record_nodes=True
        )
        return ShownCast.of_rollout(rollout, motion)

    def shot(self, index: int, engine: Engine) -> Shot:
        """Return a cast to be filmed: as it was seen, beside the simulator.

        Args:
            index: Index of the cast.
            engine: Simulator.
        """
        check_count("cast", index, 0, len(self) - 1)
        one = self.casts[index]
        simulated = None
        if np.all(np.isfinite(one.action)):
            simulated = self.simulated(index, engine, self.tuned)
        if one.measured is not None:
            return Shot(
                cast=one.measured(),
                other=simulated,
                target_xy=one.target_xy,
                caption=one.label,
                result=one.label + self._miss_text(one),
            )
        if simulated is None:
            raise InputError(f"cast {index} was neither seen nor can it be simulated")
        return Shot(cast=simulated, target_xy=one.target_xy, caption=one.label, result=one.label)

    def _miss_text(self, one: LookedCast) -> str:
        if one.target_xy is None or not np.all(np.isfinite(one.landed_xy)):
            return ""
        miss = float(np.linalg.norm(one.landed_xy - one.target_xy))
        return f": {100 * miss / self.setup.cable.length:.1f} % of the cable's length off"


def open_collection(folder: str | os.PathLike[str]) -> Collection:
    """Return the casts of a folder.

    Args:
        folder: Dataset of `collect` or `simulate`, folder of `evaluate`, `tune` or `aim`. What
            `tune` found is read from a folder `tune` in it or beside it. The casts that a folder of
            `tune` was fitted to are looked for beside it.

    Raises:
        DatasetError: The folder holds no casts.
        DamagedFileError: A file is not what was written.
    """
    path = pathlib.Path(folder)
    if (path / INFO_PATH).exists():
        return _of_dataset(read_dataset(path), path)
    if (path / CASTS_FOLDER / INFO_PATH).exists():
        return _of_dataset(read_dataset(path / CASTS_FOLDER), path)
    if (path / SESSION_FOLDER / CONFIG_FILE).exists():
        return _of_session(path)
    if (path / PARAMS_FILE).exists():
        return _of_tuning(path)
    raise DatasetError(
        f"{path} holds no casts: name a folder that `cablecast collect`, `simulate`, `evaluate`, "
        "`tune` or `aim` wrote"
    )


def _of_tuning(path: pathlib.Path) -> Collection:
    """Return the casts that parameters were fitted to, which lie beside the result."""
    metrics = read_json(path / METRICS_FILE) if (path / METRICS_FILE).exists() else {}
    fingerprint = metrics.get("dataset_fingerprint", "")
    for place in sorted(path.resolve().parent.iterdir()):
        if (place / INFO_PATH).exists() and read_info(place).get("fingerprint") == fingerprint:
            dataset = read_dataset(place)
            found = _of_dataset(dataset, place)
            return dataclasses.replace(found, tuned=read_dynamics(path, dataset.setup.cable))
    raise DatasetError(
        f"{path} was fitted to casts that do not lie beside it: open the folder of the casts"
    )


def _of_dataset(dataset: Dataset, path: pathlib.Path) -> Collection:
    settings: dict[str, Any] = dataset.info["settings"]
    targets = settings.get("targets")
    repeats = 1 if not targets else max(1, len(dataset) // len(targets))

    def looked(row: int) -> LookedCast:
        target = None if not targets else np.array(targets[row // repeats], dtype=float)
        measured = None
        if dataset.extra.get("times") is not None:
            measured = lambda: ShownCast.of_track(trial_track(dataset, row))  # noqa: E731
        return LookedCast(
            label=_label(row, target),
            action=dataset.actions[row],
            target_xy=target,
            landed_xy=np.where(dataset.status[row] == "ok", dataset.endpoint_xy[row], np.nan),
            measured=measured,
        )

    casts = tuple(looked(row) for row in range(len(dataset)))
    return Collection(setup=dataset.setup, casts=casts, tuned=_tuned(path, dataset.setup))


def _of_session(path: pathlib.Path) -> Collection:
    config = RunFolder.read_config(path / SESSION_FOLDER) or {"settings": {}}
    setup = Setup.from_dict({name: config["settings"].get(name, {}) for name in SECTIONS})
    store = CastStore(setup, path / SESSION_FOLDER)
    album = Album(Parts(path / ALBUM_FOLDER))

    def looked(number: int) -> LookedCast:
        cast = store.casts[number]
        target = cast.note.get("target_xy")
        target = None if target is None else np.array(target, dtype=float)

        def measured() -> ShownCast:
            return album.get(number) or ShownCast.of_values(cast.values)

        tries = int(cast.note.get("try_number", 0))
        return LookedCast(
            label=_label(number, target) + (f", try {tries}" if tries else ""),
            action=cast.action,
            target_xy=target,
            landed_xy=cast.endpoint_xy,
            measured=measured,
        )

    casts = tuple(looked(number) for number in range(len(store)))
    return Collection(setup=setup, casts=casts, tuned=_tuned(path, setup))


def _tuned(path: pathlib.Path, setup: Setup) -> Dynamics | None:
    """Return what `tune` found for the casts of a folder, if it lies in it or beside it."""
    for place in (path / TUNE_FOLDER, path.parent / TUNE_FOLDER):
        if (place / PARAMS_FILE).exists():
            return read_dynamics(place, setup.cable)
    return None


def _label(number: int, target_xy: NDArray[np.float64] | None) -> str:
    if target_xy is None:
        return f"cast {number}"
    r, theta = xy_to_polar(target_xy)
    return f"cast {number} at {r:.2f} m, {np.degrees(theta):.0f}°"
