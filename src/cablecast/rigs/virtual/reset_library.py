"""States in which the simulated reset leaves the cable, computed once, stored, and drawn per trial.

A whole reset takes 14 s of simulated time, ten times as long as a cast. So the laboratory plays it
in advance, many times, each time after another cast, and keeps where the cable came to rest:

    python -m cablecast.rigs.virtual.reset_library --cable cable_1 --count 48

A trial then starts from one of these states. Only the presets in the default laboratory have them;
any other cable starts from a drawn bow (trials.py).
"""

import contextvars
import dataclasses
import functools
import hashlib
import importlib.resources
import io
import json
import pathlib
import sys
import time

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import CABLE_NAMES, Cable, load_cable
from cablecast.errors import DatasetError, InputError, RigError
from cablecast.files import write_bytes
from cablecast.motion.action import MotionConfig
from cablecast.motion.cast import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.grip_path import GripPath
from cablecast.motion.joint_path import joint_path
from cablecast.motion.polar_cast import PolarCastConfig
from cablecast.motion.reset import reset_path
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.virtual._hidden import hidden_arm, hidden_cable, hidden_table
from cablecast.rigs.virtual.config import VirtualConfig
from cablecast.track import TrialStatus
from cablecast.workspace import Workspace

FORMAT = "cablecast.reset_library"
FORMAT_VERSION = 1

NODE_SPACING = 0.02
"""Distance between stored nodes along the cable [m]: lying straight to within centimetres, it is
described by them to a tenth of a millimetre."""

REST_TIME = 1.0
"""From the end of a cast to the beginning of the reset [s]."""

BATCH_SIZE = 8
"""Resets that are simulated, and saved, at a time."""

ASIDE_MAX = 0.012
"""A reset whose endpoint lies farther aside of straight ahead is seen by the camera and done again
[m]."""
AHEAD_MIN = 0.97
"""So is one whose endpoint lies less far ahead, as a share of the cable's length: it is folded."""

_MAKING: contextvars.ContextVar[bool] = contextvars.ContextVar("making a library", default=False)
"""While a library is made none is drawn from, so that it does not depend on the one before it."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ResetLibrary:
    """Where resets left one cable.

    Attributes:
        cable: Name of the cable.
        arc_lengths: Distance of each node from the grip along the cable [m], shape [node].
        positions: Nodes seen from the grip: x to its right, y ahead, z up [m], shape
            [state, node, 3].
        before_xy: Where the endpoint was before each reset, in the base frame [m], shape
            [state, 2].
        info: What it was computed with.
    """

    cable: str
    arc_lengths: NDArray[np.float64]
    positions: NDArray[np.float64]
    before_xy: NDArray[np.float64]
    info: dict

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def endpoints(self) -> NDArray[np.float64]:
        """Endpoints seen from the grip, x to the right and y ahead [m], shape [state, 2]."""
        return self.positions[:, -1, :2]

    def report(self) -> dict[str, float]:
        """How straight, and how alike, the resets left the cable, in [% of cable length], [deg]."""
        length = float(self.arc_lengths[-1])
        x, y = self.endpoints.T
        heading = np.degrees(np.arctan2(x, y))
        # The sideways distance of the cable from the straight line between its ends.
        nodes = self.positions[..., :2]
        chord = nodes[:, -1] / np.linalg.norm(nodes[:, -1], axis=1, keepdims=True)
        aside = nodes[..., 0] * chord[:, None, 1] - nodes[..., 1] * chord[:, None, 0]
        return {
            "states": len(self),
            "before_scatter_pct": float(np.sqrt(self.before_xy.var(axis=0).sum())) / length * 100,
            "short_mean_pct": float(np.mean(length - np.hypot(x, y))) / length * 100,
            "short_max_pct": float(np.max(length - np.hypot(x, y))) / length * 100,
            "aside_mean_pct": float(np.mean(x)) / length * 100,
            "aside_scatter_pct": float(np.std(x)) / length * 100,
            "ahead_scatter_pct": float(np.std(y)) / length * 100,
            "heading_scatter_deg": float(np.std(heading)),
            "bow_mean_pct": float(np.mean(np.max(np.abs(aside), axis=1))) / length * 100,
        }

    def accepted(self) -> NDArray[np.intp]:
        """States that a trial may begin with, of those that resets left: all where none is near."""
        aside, ahead = self.endpoints.T
        stretched = ahead >= AHEAD_MIN * self.arc_lengths[-1]
        near = np.flatnonzero((np.abs(aside) <= ASIDE_MAX) & stretched)
        return near if len(near) else np.arange(len(self))

    def resample(self, index: int, arc_lengths: ArrayLike) -> NDArray[np.float64]:
        """One state at other nodes.

        Args:
            index: Which state.
            arc_lengths: Distance of each node from the grip along the cable [m]; beyond the
                endpoint it goes on straight and level, as an attachment lies. Shape [vertex].

        Returns:
            Nodes seen from the grip [m], shape [vertex, 3].
        """
        from scipy.interpolate import CubicSpline

        arc_lengths = np.asarray(arc_lengths, dtype=float)
        spline = CubicSpline(self.arc_lengths, self.positions[index])
        end = self.arc_lengths[-1]
        beyond = np.maximum(arc_lengths - end, 0.0)[:, None]
        onwards = spline(end, 1) * [1.0, 1.0, 0.0]
        onwards /= np.linalg.norm(onwards)
        return spline(np.minimum(arc_lengths, end)) + beyond * onwards

    def save(self, path: pathlib.Path) -> None:
        """Write it whole or not at all; nothing in it is pickled."""
        meta = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "cable": self.cable,
            "info": self.info,
        }
        buffer = io.BytesIO()
        np.savez_compressed(
            buffer,
            allow_pickle=False,
            meta=np.array(json.dumps(meta)),
            arc_lengths=self.arc_lengths,
            # Micrometres are more than anyone can tell.
            positions=np.round(self.positions, 6).astype(np.float32),
            before_xy=np.round(self.before_xy, 6),
        )
        write_bytes(path, buffer.getvalue())

    @classmethod
    def load(cls, path: pathlib.Path) -> "ResetLibrary":
        """Read what `save` wrote.

        Raises:
            DatasetError: It is missing, damaged, or of another kind.
        """
        import zipfile
        import zlib

        try:
            with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as stored:
                meta = json.loads(str(stored["meta"]))
                arrays = {
                    name: np.asarray(stored[name], dtype=float)
                    for name in ("arc_lengths", "positions", "before_xy")
                }
            if (meta["format"], meta["format_version"]) != (FORMAT, FORMAT_VERSION):
                raise DatasetError(f"{path} is no reset library of version {FORMAT_VERSION}")
            return cls(cable=meta["cable"], info=meta["info"], **arrays)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile, zlib.error) as error:
            if isinstance(error, DatasetError):
                raise
            raise DatasetError(f"no reset library at {path}: {error}") from None


def library_path(cable_name: str) -> pathlib.Path:
    """Where the library of a preset lies in the package."""
    folder = importlib.resources.files("cablecast.rigs.virtual")
    return pathlib.Path(str(folder)) / f"reset_{cable_name}.npz"


@functools.cache
def _packaged(cable_name: str) -> ResetLibrary | None:
    path = library_path(cable_name)
    return ResetLibrary.load(path) if path.is_file() else None


def find_library(cable: Cable, lab_seed: int = 0) -> ResetLibrary | None:
    """The library of a cable in a laboratory, where there is one.

    Args:
        cable: A preset; a user's own has none, nor has a preset whose geometry was changed.
        lab_seed: Which laboratory; only the default one has any.
    """
    if lab_seed != 0 or cable.name not in CABLE_NAMES or _MAKING.get():
        return None
    preset = load_cable(cable.name)
    names = ("length", "diameter", "attachment", "attachment_length")
    if any(getattr(cable, name) != getattr(preset, name) for name in names):
        return None
    return _packaged(cable.name)


def sample_reset(
    cable: Cable, arc_lengths: ArrayLike, rng: np.random.Generator, lab_seed: int = 0
) -> NDArray[np.float64] | None:
    """A state as one of the simulated resets left the cable.

    Args:
        cable: The cable.
        arc_lengths: Distance of each vertex from the grip along the cable [m], shape [vertex].
        rng: Chooses the state.
        lab_seed: Which laboratory.

    Returns:
        Vertices seen from the grip: x to its right, y ahead, z up [m], shape [vertex, 3]; None for
        a cable without a library, for which a shape must be drawn.
    """
    library = find_library(cable, lab_seed)
    if library is None:
        return None
    return library.resample(int(rng.integers(len(library))), arc_lengths)


def cast_and_reset(
    cable: Cable, workspace: Workspace, count: int, seed: int, config: MotionConfig | None = None
) -> tuple[list[Trajectory], NDArray[np.float64]]:
    """Motions that cast somewhere, wait, and reset, each with another action.

    Args:
        cable: Gives the lengths of the reset.
        workspace: Table and arm.
        count: How many.
        seed: Chooses the actions, uniformly among the feasible ones.
        config: System parameters of the casts.

    Returns:
        The motions, and when the reset begins in each [s], shape [count].
    """
    config = config or MotionConfig()
    actions = feasible_uniform(count, config, workspace, seed=seed)
    trajectories, begins = [], []
    for cast in (cast_grip_paths(actions[i : i + 1], config, workspace) for i in range(count)):
        end = cast.evaluate(cast.duration[:, None])[0, 0]
        path = GripPath.chain(
            [cast, GripPath.hold(end, REST_TIME), reset_path(end, cable, workspace)]
        )
        joints = joint_path(path, workspace, config)
        trajectories.append(Trajectory(action=None, grip_path=path, joint_path=joints))
        begins.append(float(cast.duration[0]) + REST_TIME)
    return trajectories, np.array(begins)


def simulate_resets(
    cable: Cable,
    workspace: Workspace,
    count: int,
    seed: int,
    config: VirtualConfig | None = None,
    motion: MotionConfig | None = None,
) -> ResetLibrary:
    """Play casts, each followed by a reset, in the laboratory, and keep how the cable lies.

    Args:
        cable: The cable.
        workspace: Table and arm.
        count: How many.
        seed: Of the actions and of the trials.
        config: Settings of the laboratory.
        motion: System parameters of the casts.
    """
    from cablecast.rigs.virtual.rig import RigVirtual

    if count < 1:
        raise InputError(f"count = {count} resets must be at least 1")
    config = config or VirtualConfig()
    fine_config = dataclasses.replace(config, dt=config.dt / 2)
    rig, fine_rig = (RigVirtual(cable, workspace, seed, c) for c in (config, fine_config))
    trajectories, begins = cast_and_reset(cable, workspace, count, seed, motion)
    making = _MAKING.set(True)
    try:
        tracks = rig.execute_many(trajectories)
        for index, track in enumerate(tracks):
            # The end of a twisted cable may whip so that the step does not follow it.
            if track.status is TrialStatus.NON_FINITE:
                fine_rig.seek(index)
                tracks[index] = fine_rig.execute_many(trajectories[index : index + 1])[0]
    finally:
        _MAKING.reset(making)
        rig.close()
        fine_rig.close()
    arc_lengths = np.linspace(0.0, cable.length, round(cable.length / NODE_SPACING) + 1)
    positions, before = [], []
    for begin, track in zip(begins, tracks, strict=True):
        if track.nodes is None or track.status in (TrialStatus.NON_FINITE, TrialStatus.ABORTED):
            raise RigError(f"a simulated reset failed: {track.status.value}")
        positions.append(_seen_from_grip(track.nodes[-1], arc_lengths))
        before.append(track.nodes[np.searchsorted(track.times, begin, "right") - 1, -1, :2])
    return ResetLibrary(
        cable=cable.name,
        arc_lengths=arc_lengths,
        positions=np.array(positions),
        before_xy=np.array(before),
        info={},
    )


def _seen_from_grip(
    nodes: NDArray[np.float64], arc_lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """A cable's shape at given arc lengths, relative to the grip, whose yaw is 0 after a reset.

    Args:
        nodes: Shape in the base frame, from the grip to the endpoint [m], shape [vertex, 3].
        arc_lengths: Where to look [m], shape [node].
    """
    from scipy.interpolate import CubicSpline

    steps = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    # The rod of the laboratory stretches by less than a thousandth.
    return CubicSpline(arc * (arc_lengths[-1] / arc[-1]), nodes - nodes[0])(arc_lengths)


def joined(first: ResetLibrary, second: ResetLibrary) -> ResetLibrary:
    """Both libraries' states in one, the first's before the second's."""
    return dataclasses.replace(
        first,
        positions=np.concatenate([first.positions, second.positions]),
        before_xy=np.concatenate([first.before_xy, second.before_xy]),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class MakeLibrary:
    """Simulate resets after random casts, and store where they leave the cable.

    What an interrupted run has saved is kept, and the next run goes on from there.
    """

    cable: str
    """Which cable: cable_1, cable_2 or cable_3."""
    count: int = 48
    """How many resets."""
    seed: int = 0
    """Chooses the casts and all that the laboratory leaves to chance."""
    out: pathlib.Path | None = None
    """Where to write; the file of the package by default."""
    report: bool = False
    """Only print how the stored resets scatter."""

    def run(self) -> None:
        """Simulate, saving as it goes, and print how the states scatter."""
        path = self.out or library_path(self.cable)
        if not self.report:
            self._make(path)
        library = ResetLibrary.load(path)
        print(f"{path} ({path.stat().st_size / 1024:.1f} KiB)")
        for name, value in library.report().items():
            print(f"  {name:22} {value:.4g}")

    def _make(self, path: pathlib.Path) -> None:
        cable, workspace = load_cable(self.cable), Workspace()
        config, motion = VirtualConfig(), MotionConfig()
        info = {
            "seed": self.seed,
            "batch_size": BATCH_SIZE,
            "lab": dataclasses.asdict(config),
            "motion": dataclasses.asdict(motion),
            "reset": dataclasses.asdict(PolarCastConfig()),
            "workspace": dataclasses.asdict(workspace),
            # Tells another true cable from this one without telling its values.
            "truth": hidden_digest(cable, config.lab_seed),
        }
        library = None
        if path.is_file():
            library = ResetLibrary.load(path)
            # A library of other settings is replaced, not continued.
            if library.info != json.loads(json.dumps(info)):
                library = None
        begun, start = len(library) if library else 0, time.monotonic()
        while (done := len(library) if library else 0) < self.count:
            # Whole batches, each with its own seed, so that a resumed library is the same.
            batch = simulate_resets(
                cable, workspace, BATCH_SIZE, self.seed * 10_000 + done, config, motion
            )
            batch = dataclasses.replace(batch, info=info)
            library = joined(library, batch) if library else batch
            library.save(path)
            done += BATCH_SIZE
            left = (time.monotonic() - start) / (done - begun) * max(self.count - done, 0)
            print(f"{self.cable}: {done} resets, about {left:.0f} s to go", file=sys.stderr)


def hidden_digest(cable: Cable, lab_seed: int) -> str:
    """A short name for all that is hidden about a cable, the arm and the table of a laboratory.

    Args:
        cable: The cable.
        lab_seed: Which laboratory.
    """
    truth = (hidden_cable(cable, lab_seed), hidden_arm(lab_seed), hidden_table(lab_seed))
    return hashlib.sha256(repr(truth).encode()).hexdigest()[:16]


def main() -> None:
    """Entry point of `python -m cablecast.rigs.virtual.reset_library`."""
    import tyro

    from cablecast.errors import CablecastError

    try:
        tyro.cli(MakeLibrary).run()
    except CablecastError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
