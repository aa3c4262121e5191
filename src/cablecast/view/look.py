"""ShownCast: one cast as it is drawn, measured or simulated, at any instant.

Album: shapes of the casts of a session, for replays, and which tries were taken back.

A session of `aim` keeps what teaches: the track of the free end and the joints. What is only looked
at, the shape of the whole cable, is kept here.

Casts to look at: those of a dataset, of an evaluation, or of a session of `aim`.

Each is shown as it was measured, as the believed cable would have moved, and as the tuned one does.
"""

import dataclasses
import os
import pathlib
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from cablecast.errors import InputError
from cablecast.runs.folder import METRICS_FILE, Parts

if TYPE_CHECKING:
    pass

from typing import TYPE_CHECKING

from numpy.typing import NDArray

from cablecast.errors import check_count
from cablecast.setup import Setup

if TYPE_CHECKING:
    pass
from collections.abc import Mapping

from numpy.typing import ArrayLike

from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.conventions import xy_to_polar
from cablecast.data.dataset import Dataset, read_dataset
from cablecast.data.schema import INFO_PATH, read_info
from cablecast.data.store import CastStore
from cablecast.engines.base import Engine, Rollout
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import DatasetError
from cablecast.files import read_json
from cablecast.motion.action import Action
from cablecast.motion.trajectory import JointPath, Trajectory, joints_at, plan_trajectory
from cablecast.pipeline.aim import SESSION_FOLDER
from cablecast.pipeline.evaluate import CASTS_FOLDER
from cablecast.runs.folder import CONFIG_FILE, RunFolder
from cablecast.runs.places import TUNE_FOLDER
from cablecast.setup import SECTIONS
from cablecast.tuning.tune import PARAMS_FILE, read_dynamics

FRAME_DT = 0.02
"""Interval of the shapes that are drawn [s]: half of the time between two pictures on a screen that
shows 25 a second, so that slow motion is smooth, too."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class ShownCast:
    """One cast as it is drawn.

    Attributes:
        times: Times of the shapes [s], shape [step]; the first is 0.
        endpoint_xy: Free end [m], shape [step, 2]; NaN where it was not seen.
        nodes: Cable [m], shape [step, node, 3]; None where nobody saw it.
        joint_path: Joints of the arm; None for a rig without joints.
        status: End of the cast.
    """

    times: NDArray[np.float64]
    endpoint_xy: NDArray[np.float64]
    nodes: NDArray[np.float64] | None
    joint_path: JointPath | None
    status: TrialStatus = TrialStatus.OK

    @classmethod
    def of_track(cls, track: EndpointTrack, trajectory: Trajectory | None = None) -> "ShownCast":
        """Return a cast on a rig.

        Args:
            track: Answer of the rig.
            trajectory: Planned motion, whose joints are shown where the rig reported none.
        """
        planned = None if trajectory is None else trajectory.joint_path
        times = np.arange(0.0, float(track.times[-1]) + 1e-9, FRAME_DT)
        return cls(
            times=times,
            endpoint_xy=_smooth(track.times, track.endpoint_xy, times),
            nodes=None if track.nodes is None else _smooth(track.times, track.nodes, times),
            joint_path=track.joint_path or planned,
            status=track.status,
        )

    @classmethod
    def of_rollout(
        cls, rollout: Rollout, trajectory: Trajectory, world: int = 0, status=TrialStatus.OK
    ) -> "ShownCast":
        """Return a cast in the simulator.

        Args:
            rollout: Answer of the engine, with the nodes recorded.
            trajectory: Motion that was simulated.
            world: Row of the rollout.
            status: End of the cast.
        """
        return cls(
            times=rollout.times,
            endpoint_xy=rollout.endpoint_xy[world],
            nodes=None if rollout.nodes is None else rollout.nodes[world],
            joint_path=trajectory.joint_path,
            status=status,
        )

    @classmethod
    def of_values(cls, values: Mapping[str, Any]) -> "ShownCast":
        """Return a cast of a store (datasets/store.py), which keeps the free end and the joints.

        Args:
            values: Columns of motion and track, see `trial_values`.
        """
        joints = None
        for name in ("actual", "joint"):
            if joints is None and values.get(f"{name}_q") is not None:
                times, q = np.asarray(values[f"{name}_times"]), np.asarray(values[f"{name}_q"])
                joints = joint_path_through(times, q.reshape(len(times), -1))
        track = EndpointTrack(
            times=np.asarray(values["times"], dtype=float),
            endpoint_xy=np.stack([values["track_x"], values["track_y"]], axis=-1),
            status=TrialStatus.from_code(values["status"]),
            joint_path=joints,
        )
        return cls.of_track(track)

    @property
    def duration(self) -> float:
        """End of the cast [s]."""
        return float(self.times[-1])

    def nodes_at(self, time: float) -> NDArray[np.float64] | None:
        """Return the cable at a time [s], shape [node, 3]; None where it is not known."""
        if self.nodes is None:
            return None
        step, part = self._place(time)
        shape = (1.0 - part) * self.nodes[step] + part * self.nodes[min(step + 1, self._last)]
        return shape if np.all(np.isfinite(shape)) else None

    def endpoint_at(self, time: float) -> NDArray[np.float64]:
        """Return the free end at a time [s], shape [2]; NaN where it was not seen."""
        step, part = self._place(time)
        after = self.endpoint_xy[min(step + 1, self._last)]
        return (1.0 - part) * self.endpoint_xy[step] + part * after

    def joints_at(self, time: float) -> NDArray[np.float64] | None:
        """Return the joint angles at a time [rad], shape [6]; None for a rig without joints."""
        return None if self.joint_path is None else joints_at(self.joint_path, [time])[0]

    def trail(self, until: float) -> NDArray[np.float64]:
        """Return where the free end was seen up to a time [m], shape [point, 2]."""
        points = self.endpoint_xy[self.times <= until + 1e-9]
        return points[np.all(np.isfinite(points), axis=1)]

    @property
    def _last(self) -> int:
        return len(self.times) - 1

    def _place(self, time: float) -> tuple[int, float]:
        """Return the step before a time, and the part of the interval that has passed."""
        time = float(np.clip(time, 0.0, self.duration))
        step = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, self._last))
        if step == self._last:
            return step, 0.0
        return step, (time - self.times[step]) / (self.times[step + 1] - self.times[step])


def joint_path_through(times: NDArray[np.float64], q: NDArray[np.float64]) -> JointPath:
    """Return the path through joint angles, with rates by differences.

    Args:
        times: Times [s], shape [tick].
        q: Joint angles [rad], shape [tick, 6].
    """
    qd = np.asarray(np.gradient(q, times, axis=0)) if len(times) > 1 else np.zeros_like(q)
    return JointPath(times=times, q=q, qd=qd)


def _smooth(
    times: NDArray[np.float64], values: NDArray[np.float64], at: ArrayLike
) -> NDArray[np.float64]:
    """Return samples at other times, by curves that do not overshoot.

    Rigs sample every 0.1 s; straight lines between such shapes would let the cable shrink. A value
    between a seen and an unseen sample is NaN.

    Args:
        times: Times of the samples [s], shape [step].
        values: Samples, shape [step, ...]; NaN where not seen.
        at: Times asked for [s], shape [time].
    """
    from scipy.interpolate import PchipInterpolator

    at = np.asarray(at, dtype=float)
    flat = values.reshape(len(times), -1)
    seen = np.all(np.isfinite(flat), axis=1)
    result = np.full((len(at), flat.shape[1]), np.nan)
    if np.count_nonzero(seen) >= 2:
        result = PchipInterpolator(times[seen], flat[seen], extrapolate=False)(at)
        # A time is known where the samples on both of its sides were seen.
        after = np.clip(np.searchsorted(times, at, side="left"), 0, len(times) - 1)
        before = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 1)
        result[~(seen[before] & seen[after])] = np.nan
    elif seen[0]:
        result[:] = flat[0]
    return result.reshape(len(at), *values.shape[1:])


ALBUM_FOLDER = "shapes"
"""Folder of the shapes beside a session of `aim`."""

_UNDONE = "undone"

_METRES, _RADIANS, _SECONDS = 4, 5, 4
"""Decimals that are stored: a tenth of a millisecond and of a millimetre, which nobody sees."""

_KEPT_COUNT = 40
"""Casts that are held in memory; older ones are read again when they are asked for."""


class Album:
    """Shapes of casts by the number of the cast in its session.

    Args:
        parts: Folder of the shapes; they are kept in memory alone where None.

    Attributes:
        undone: Numbers of the casts that were taken back.

    Raises:
        DamagedFileError: A file is not what was written.
    """

    def __init__(self, parts: Parts | None = None):
        self._parts = parts
        self._shown: dict[int, ShownCast] = {}
        noted = None if parts is None else parts.get(_UNDONE)
        self.undone: set[int] = set() if noted is None else set(noted["numbers"])

    def keep(self, number: int, cast: ShownCast) -> None:
        """Keep a cast."""
        self._hold(number, cast)
        if self._parts is not None:
            self._parts.put(f"{number:05d}", cast_to_plain(cast))

    def get(self, number: int) -> ShownCast | None:
        """Return a cast; None where it was not kept."""
        if number not in self._shown and self._parts is not None:
            values = self._parts.get(f"{number:05d}")
            if values is not None:
                self._hold(number, cast_from_plain(values))
        return self._shown.get(number)

    def mark_undone(self, number: int) -> None:
        """Note that a cast was taken back."""
        self.undone = self.undone | {number}
        if self._parts is not None:
            self._parts.put(_UNDONE, {"numbers": sorted(self.undone)})

    def _hold(self, number: int, cast: ShownCast) -> None:
        self._shown[number] = cast
        if self._parts is not None and len(self._shown) > _KEPT_COUNT:
            del self._shown[min(self._shown)]


def cast_to_plain(cast: ShownCast) -> dict[str, Any]:
    """Return a cast as plain values for JSON; see `cast_from_plain`."""
    joints = cast.joint_path
    return {
        "status": cast.status.code,
        "times": _plain(cast.times, _SECONDS),
        "endpoint_xy": _plain(cast.endpoint_xy, _METRES),
        "nodes": None if cast.nodes is None else _plain(cast.nodes, _METRES),
        "joint_times": None if joints is None else _plain(joints.times, _SECONDS),
        "joint_q": None if joints is None else _plain(joints.q, _RADIANS),
    }


def cast_from_plain(values: dict[str, Any]) -> ShownCast:
    """Return the cast that `cast_to_plain` described."""
    joints = None
    if values["joint_times"] is not None:
        joints = joint_path_through(_array(values["joint_times"]), _array(values["joint_q"]))
    return ShownCast(
        times=_array(values["times"]),
        endpoint_xy=_array(values["endpoint_xy"]),
        nodes=None if values["nodes"] is None else _array(values["nodes"]),
        joint_path=joints,
        status=TrialStatus.from_code(values["status"]),
    )


def _plain(values: NDArray[np.float64], decimals: int) -> Any:
    """Return nested lists, None for what is not finite: JSON has no NaN."""
    values = np.round(values, decimals)
    plain = values.astype(object)
    plain[~np.isfinite(values)] = None
    return plain.tolist()


def _array(values: Any) -> NDArray[np.float64]:
    return np.array(values, dtype=float)


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


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """One cast to be filmed.

    Attributes:
        cast: Cast in blue, solid.
        other: Second cast in purple, thin, e.g. what was expected; none where None.
        target_xy: Target [m], shape [2]; none where None.
        caption: Line below the picture while the cast plays.
        result: Line below the picture once the cable rests.
    """

    cast: ShownCast
    other: ShownCast | None = None
    target_xy: NDArray[np.float64] | None = None
    caption: str = ""
    result: str = ""


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
    targets = dataset.settings.values.get("targets")
    repeats = 1 if not targets else max(1, len(dataset) // len(targets))

    def looked(row: int) -> LookedCast:
        target = None if not targets else np.array(targets[row // repeats], dtype=float)
        measured = None
        if dataset.extra.get("times") is not None:
            measured = lambda: ShownCast.of_track(dataset.track(row))  # noqa: E731
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


FRAMES_PER_SECOND = 25.0


PAUSE = 0.8
"""Time that the end of a cast is shown before it begins again [s]."""


class Shows(Protocol):
    """Something that can show a cast at an instant."""

    def show(self, cast: ShownCast, time: float) -> None:
        """Show a cast at a time [s]."""
        ...


class Player:
    """Plays casts side by side in a thread of its own.

    Args:
        on_frame: Called with the time [s] at every frame, e.g. to move a slider.

    Attributes:
        time: Time that is shown [s].
        speed: Shown seconds per second.
        playing: True while the time runs.
        frame_count: Number of frames shown so far.
    """

    def __init__(self, on_frame: Callable[[float], None] | None = None):
        self.time = 0.0
        self.speed = 1.0
        self.playing = False
        self.frame_count = 0
        self._on_frame = on_frame or (lambda time: None)
        self._acts: list[tuple[Shows, ShownCast]] = []
        self._rounds = 1
        self._done: Callable[[], None] | None = None
        self._lock = threading.RLock()
        self._wake = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="player", daemon=True)
        self._thread.start()

    @property
    def duration(self) -> float:
        """Length of the longest cast [s]."""
        return max((cast.duration for _, cast in self._acts), default=0.0)

    def play(
        self,
        acts: Sequence[tuple[Shows, ShownCast]],
        *,
        rounds: int = 1,
        start: float = 0.0,
        done: Callable[[], None] | None = None,
    ) -> None:
        """Play casts from a time on, instead of what is playing.

        Args:
            acts: Figures and their casts.
            rounds: Number of times that the casts are played, with a pause between.
            start: Time to begin at [s].
            done: Called at the first end, in the player's thread; it must not wait.
        """
        with self._lock:
            self._acts, self._rounds, self._done = list(acts), rounds, done
            self.time, self.playing = start, True
            self._draw()
        self._wake.set()

    def show(self, acts: Sequence[tuple[Shows, ShownCast]], at: float) -> None:
        """Show casts at a time [s], at rest."""
        with self._lock:
            self._acts, self.playing, self._done = list(acts), False, None
            self.time = at
            self._draw()

    def seek(self, at: float) -> None:
        """Show another time [s], at rest."""
        with self._lock:
            self.playing, self.time = False, min(max(at, 0.0), self.duration)
            self._draw()

    def toggle(self) -> None:
        """Halt, or go on; at the end begin again."""
        with self._lock:
            if not self.playing and self.time >= self.duration:
                self.time = 0.0
            self.playing = not self.playing and bool(self._acts)
        self._wake.set()

    def close(self) -> None:
        """End the thread."""
        self._ended = True
        self._wake.set()
        self._thread.join(timeout=2.0)

    def _draw(self) -> None:
        for figure, cast in self._acts:
            figure.show(cast, self.time)
        self.frame_count += 1
        self._on_frame(self.time)

    def _run(self) -> None:
        before = time.monotonic()
        while not self._ended:
            if not self.playing:
                self._wake.wait()
                self._wake.clear()
                before = time.monotonic()
                continue
            now = time.monotonic()
            with self._lock:
                if self.playing:
                    self._advance(now - before)
            before = now
            # What drawing took is part of the frame.
            time.sleep(max(0.002, 1.0 / FRAMES_PER_SECOND - (time.monotonic() - now)))

    def _advance(self, seconds: float) -> None:
        end = self.duration
        at_end = self.time >= end
        # Between two rounds the time runs on through the pause.
        self.time += self.speed * seconds
        if self.time >= end and not at_end and self._done is not None:
            self._done()
        if self._rounds > 1 and self.time >= end + PAUSE * self.speed:
            self.time, self._rounds = 0.0, self._rounds - 1
        elif self._rounds <= 1 and self.time >= end:
            self.time, self.playing = end, False
        self._draw()
