"""Casts as they are drawn, measured or simulated, and the folders that they are read from."""

import dataclasses
import math
import os
import pathlib
from collections.abc import Sequence

import numpy as np

from cablecast.cable import Cable
from cablecast.cast import Cast, EndpointTrack, TrialStatus
from cablecast.conventions import Array
from cablecast.data.dataset import Dataset, StoredSettings, read_dataset
from cablecast.data.schema import INFO_PATH, read_info
from cablecast.data.store import CastStore, dataset_cast
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.engines.swing import SAMPLE_DT, SwingModel, swing_model
from cablecast.errors import DamagedFileError, DatasetError, InputError, check_count
from cablecast.motion.joint_move import JointMove
from cablecast.motion.trajectory import JointPath, Trajectory, joints_at, plan_trajectory
from cablecast.pipeline.aim import FITS_FOLDER, SESSION_FOLDER
from cablecast.pipeline.evaluate import CASTS_FOLDER
from cablecast.report.strike_page import target_text
from cablecast.runs.folder import Parts, RunFolder
from cablecast.runs.places import TUNE_FOLDER
from cablecast.setup import Setup
from cablecast.task import LANDING, STRIKE
from cablecast.tuning.tuned import PARAMS_FILE, load_tuned

FRAME_DT = 0.02
"""Interval of the shapes that are drawn [s]: half of the time between two pictures on a screen that
shows 25 a second, so that slow motion is smooth, too."""

_TIP_HEIGHT = 0.01  # At which a free end is drawn whose height nobody saw [m].


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ShownCast:
    """One cast as it is drawn.

    Attributes:
        times: Times of the shapes [s], shape [step]; the first is 0.
        path: Free end [m], shape [step, 2], or [step, 3] in the air; NaN where it was not seen.
        nodes: Cable [m], shape [step, node, 3]; None where nobody saw it.
        joint_path: Joints of the arm; None for a rig without joints.
    """

    times: Array
    path: Array
    nodes: Array | None = None
    joint_path: JointPath | None = None

    @classmethod
    def of_cast(cls, cast: Cast) -> "ShownCast":
        """Return a cast on a rig, with the commanded joints where the rig reported none."""
        return cls.of_track(cast.track, cast.joint_path)

    @classmethod
    def of_track(cls, track: EndpointTrack, joint_path: JointPath | None) -> "ShownCast":
        """Return what a rig saw, with these commanded joints where it reported none."""
        # A tip in the air is several times as fast as one on a table.
        step = FRAME_DT if track.endpoint_z is None else SAMPLE_DT
        times = np.arange(0.0, float(track.times[-1]) + 1e-9, step)
        return cls(
            times=times,
            path=_smooth(track.times, track.path, times),
            nodes=None if track.nodes is None else _smooth(track.times, track.nodes, times),
            joint_path=track.joint_path or joint_path,
        )

    @classmethod
    def simulated(
        cls, trajectory: Trajectory, setup: Setup, engine: Engine, dynamics: Dynamics
    ) -> "ShownCast":
        """Return a motion as it is simulated, with the dynamics of a cable and the arm's servo."""
        rollout = dynamics.rollout(
            engine, setup, trajectory.grip_path, sample_dt=FRAME_DT, record_nodes=True
        )
        return cls(
            times=rollout.times,
            path=rollout.endpoint_xy[0],
            nodes=None if rollout.nodes is None else rollout.nodes[0],
            joint_path=trajectory.joint_path,
        )

    @classmethod
    def swung(cls, trajectory: Trajectory, model: SwingModel, cable: Cable) -> "ShownCast":
        """Return a swing as it is simulated with a cable, until it touches something."""
        if not isinstance(trajectory.action, JointMove):
            raise InputError(f"{trajectory.action} is no swing")
        motion = model.motion(model.moves.unit_of(trajectory.action)[None])
        swings = model.play(motion, cable, nodes=True)
        end = max(int(swings.contacts(np.zeros(1, dtype=int))[0]), 1)
        return cls(
            times=SAMPLE_DT * np.arange(end, dtype=float),
            path=swings.tip[0, :end],
            nodes=None if swings.nodes is None else swings.nodes[0, :end],
            joint_path=trajectory.joint_path,
        )

    @classmethod
    def of_motion(cls, motion: Trajectory) -> "ShownCast":
        """Return the commanded motion of the arm alone."""
        times = np.array([0.0, motion.duration])
        return cls(times=times, path=np.full((2, 2), np.nan), joint_path=motion.joint_path)

    @property
    def duration(self) -> float:
        """End of the cast [s]."""
        return float(self.times[-1])

    @property
    def start(self) -> "ShownCast":
        """The first instant alone."""
        joints = self.joint_path
        if joints is not None:
            joints = JointPath(times=joints.times[:1], q=joints.q[:1], qd=joints.qd[:1])
        nodes = None if self.nodes is None else self.nodes[:1]
        return ShownCast(times=self.times[:1], path=self.path[:1], nodes=nodes, joint_path=joints)

    def nodes_at(self, time: float) -> Array | None:
        """Return the cable at a time [s], shape [node, 3]; None where it is not known."""
        if self.nodes is None:
            return None
        shape = self._between(self.nodes, time)
        return shape if np.all(np.isfinite(shape)) else None

    def tip_at(self, time: float) -> Array:
        """Return the free end at a time [m], shape [3]; NaN where it was not seen."""
        nodes = self.nodes_at(time)
        if nodes is not None:
            return nodes[-1]
        return np.append(self._between(self.path, time), _TIP_HEIGHT)[:3]

    def joints_at(self, time: float) -> Array | None:
        """Return the joint angles at a time [rad], shape [joint]; None for a rig without joints."""
        return None if self.joint_path is None else joints_at(self.joint_path, [time])[0]

    def trail(self, until: float) -> Array:
        """Return where the free end was seen up to a time [m], shape [point, 2] or [point, 3]."""
        points = self.path[self.times <= until + 1e-9]
        return points[np.all(np.isfinite(points), axis=1)]

    def _between(self, values: Array, time: float) -> Array:
        """Return the value at a time, between the steps before and after it."""
        place = float(np.interp(time, self.times, np.arange(len(self.times))))
        before, after = math.floor(place), math.ceil(place)
        part = place - before
        return (1.0 - part) * values[before] + part * values[after]


def _smooth(times: Array, values: Array, at: Array) -> Array:
    """Return samples at other times, by curves that do not overshoot.

    Rigs sample every 0.1 s; straight lines between such shapes would let the cable shrink. A value
    between a seen and an unseen sample, which is NaN, is NaN.
    """
    from scipy.interpolate import PchipInterpolator

    flat = values.reshape(len(times), -1)
    # The end of a range that is counted in steps may lie a rounding error beyond the last sample.
    at = np.minimum(at, times[-1])
    seen = np.all(np.isfinite(flat), axis=1)
    result = np.full((len(at), flat.shape[1]), np.nan)
    if np.count_nonzero(seen) >= 2:
        result = PchipInterpolator(times[seen], flat[seen], extrapolate=False)(at)
        # A time is known where the samples on both of its sides were seen.
        after = np.clip(np.searchsorted(times, at, side="left"), 0, len(times) - 1)
        before = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 1)
        result[~(seen[before] & seen[after])] = np.nan
    else:
        result[np.isin(at, times[seen])] = flat[seen]
    return result.reshape(len(at), *values.shape[1:])


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """One cast to be filmed.

    Attributes:
        cast: Cast in blue, solid.
        other: Second cast in purple, thin, e.g. what was expected; none if None.
        target_xy: Target [m], shape [2]; none if None.
        landed: Whether the free end came to rest on the table.
        caption: Line below the picture while the cast plays.
        result: Line below the picture once the cable rests.
    """

    cast: ShownCast
    other: ShownCast | None = None
    target_xy: Array | None = None
    landed: bool = True
    caption: str = ""
    result: str = ""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Collection:
    """Casts of one set-up.

    Attributes:
        dataset: Casts in order.
        labels: Name of each cast in one line.
        target_xy: Targets [m], shape [cast, 2], or [cast, 3] in the air; NaN for casts without one.
        tuned: Cable and servo of the arm as they were fitted; None where they were not.
    """

    dataset: Dataset
    labels: tuple[str, ...]
    target_xy: Array
    tuned: Dynamics | None = None

    def __len__(self) -> int:
        return len(self.dataset)

    @property
    def setup(self) -> Setup:
        """Set-up of the casts."""
        return self.dataset.setup

    @property
    def believed(self) -> Dynamics:
        """Cable as it is believed to be before any fit, on the arm as it was fitted."""
        servo = None if self.tuned is None else self.tuned.servo
        return Dynamics(params=self.setup.cable.params, servo=servo)

    @property
    def fitted(self) -> Dynamics:
        """Cable as it was fitted, or else as it is believed to be."""
        return self.tuned or self.believed

    def measured(self, index: int) -> ShownCast | None:
        """Return a cast as it was seen; None where nobody looked."""
        if self.dataset.extra.get("times") is None:
            return None
        return ShownCast.of_cast(dataset_cast(self.dataset, index))

    def simulated(self, index: int, engine: Engine, dynamics: Dynamics) -> ShownCast:
        """Return a cast as it is simulated with the dynamics of a cable."""
        if (action := self.dataset.motion(index)) is None:
            raise InputError(f"no action describes the motion of cast {index}")
        motion = plan_trajectory(action, self.setup)
        if self.setup.strike is not None:
            cable = dataclasses.replace(self.setup.cable, params=dynamics.params)
            return ShownCast.swung(motion, swing_model(self.setup), cable)
        return ShownCast.simulated(motion, self.setup, engine, dynamics)

    def shot(self, index: int, engine: Engine) -> Shot:
        """Return a cast to be filmed: as it was seen, next to the simulator."""
        check_count("cast", index, 0, len(self) - 1)
        measured = self.measured(index)
        target, label = self.target_xy[index], self.labels[index]
        target_xy = target if np.all(np.isfinite(target)) else None
        if measured is None:
            simulated = self.simulated(index, engine, self.fitted)
            landed = not bool(LANDING.lost(simulated.path, self.setup))
            return Shot(
                cast=simulated, target_xy=target_xy, landed=landed, caption=label, result=label
            )
        simulated, result = None, label
        landed = self.dataset.status[index] == TrialStatus.OK.code
        if self.dataset.motion(index) is not None:
            simulated = self.simulated(index, engine, self.fitted)
        if not landed:
            result += f": {TrialStatus.from_code(str(self.dataset.status[index])).words}"
        elif target_xy is not None:
            miss = float(LANDING.miss(self.dataset.rest_xy[index], target, self.setup))
            result += f": {100 * miss:.1f} % of the cable's length off"
        return Shot(
            cast=measured,
            other=simulated,
            target_xy=target_xy,
            landed=landed,
            caption=label,
            result=result,
        )


def open_collection(folder: str | os.PathLike[str]) -> Collection:
    """Return the casts of a dataset, or of a folder of `evaluate`, `tune` or `aim`.

    What `tune` found is read from a folder `tune` in it or next to it. The casts that a folder of
    `tune` was fitted to are looked for next to it.

    Raises:
        DatasetError: The folder holds no casts.
        DamagedFileError: A file is not what was written.
    """
    path = pathlib.Path(folder)
    for place in (path, path / CASTS_FOLDER):
        if (place / INFO_PATH).exists():
            return _of_dataset(place, path)
    if (run := RunFolder.read(path / SESSION_FOLDER)) is not None:
        return _of_session(path, run)
    if (path / PARAMS_FILE).exists():
        return _of_tuning(path)
    raise DatasetError(
        f"{path} holds no casts: name a folder that `cablecast collect`, `simulate`, `evaluate`, "
        "`tune` or `aim` wrote"
    )


def _of_dataset(path: pathlib.Path, named: pathlib.Path) -> Collection:
    """Return the casts of a dataset in the folder that a person named, or the same."""
    dataset = read_dataset(path)
    count, targets = len(dataset), np.full((len(dataset), 2), np.nan)
    if aimed := dataset.settings.values.get("targets"):
        # Repeats of a target are consecutive.
        targets = np.repeat(np.array(aimed, dtype=float), count // len(aimed), axis=0)
    return _collection(dataset, named, targets, [0] * count)


def _of_session(path: pathlib.Path, run: RunFolder) -> Collection:
    setup = StoredSettings(run.config, str(path)).setup
    task = LANDING if setup.strike is None else STRIKE
    store = CastStore(setup, run.path, task)
    targets = np.array([cast.target_xy for cast in store.casts])
    targets = targets.reshape(-1, len(task.coordinates))
    tries = [cast.try_number for cast in store.casts]
    return _collection(store.dataset(range(len(store))), path, targets, tries)


def _of_tuning(path: pathlib.Path) -> Collection:
    """Return the casts that parameters were fitted to, which lie next to the result."""
    fingerprint = (Parts(path).get("metrics") or {}).get("dataset_fingerprint", "")
    for place in sorted(path.resolve().parent.iterdir()):
        if (place / INFO_PATH).exists() and read_info(place).get("fingerprint") == fingerprint:
            found = _of_dataset(place, place)
            return dataclasses.replace(found, tuned=load_tuned(path, found.setup).dynamics)
    raise DatasetError(
        f"{path} was fitted to casts that do not lie next to it: open the folder of the casts"
    )


def _collection(
    dataset: Dataset, path: pathlib.Path, targets: Array, tries: Sequence[int]
) -> Collection:
    """Return casts with their names, and with what `tune` found.

    That is the newest fit of a session, or what lies in the folder, or else next to it.
    """
    if not len(dataset):
        raise DatasetError(f"{path} holds no cast yet")
    labels = []
    for number, (target, try_number) in enumerate(zip(targets, tries, strict=True)):
        label = f"cast {number}"
        if np.all(np.isfinite(target)):
            label += f" at {target_text(target, dataset.setup)}"
        labels.append(label + (f", try {try_number}" if try_number else ""))
    tuned = None
    later = [folder / TUNE_FOLDER for folder in sorted((path / FITS_FOLDER).glob("*"))]
    for place in (path.resolve().parent / TUNE_FOLDER, path / TUNE_FOLDER, *later):
        if (place / PARAMS_FILE).exists():
            # What lies next to the casts may be of another cable.
            try:
                tuned = load_tuned(place, dataset.setup).dynamics
            except DamagedFileError:
                raise
            except InputError:
                continue
    return Collection(dataset=dataset, labels=tuple(labels), target_xy=targets, tuned=tuned)
