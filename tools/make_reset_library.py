"""Simulate resets after random casts, and store where they leave the cable.

    python tools/make_reset_library.py --cable cable_1 --count 48
    python tools/make_reset_library.py --cable cable_1 --report

The virtual rig begins its trials with the stored states. What an interrupted run has saved is kept,
and the next run goes on from there.
"""

import argparse
import dataclasses
import hashlib
import json
import pathlib
import sys
import time

import numpy as np
from numpy.typing import NDArray

from cablecast.cable import CABLE_NAMES, Cable
from cablecast.cast import TrialStatus
from cablecast.errors import CablecastError, InputError, RigError
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.grip_path import GripPath
from cablecast.motion.polar import PolarCastConfig, reset_path
from cablecast.motion.trajectory import Trajectory, joint_path
from cablecast.rigs.virtual import RigVirtual, VirtualConfig
from cablecast.rigs.virtual._hidden import hidden_arm, hidden_cable, hidden_table
from cablecast.rigs.virtual.trials import ResetLibrary, library_path
from cablecast.setup import Setup

NODE_SPACING = 0.02
"""Distance between stored nodes along the cable [m]: they describe a cable that lies straight to
within centimetres to a tenth of a millimetre."""

REST_TIME = 1.0
"""Time from the end of a cast to the beginning of the reset [s]."""

BATCH_SIZE = 8
"""Resets that are simulated, and saved, at a time."""


def cast_and_reset(
    setup: Setup, count: int, seed: int
) -> tuple[list[Trajectory], NDArray[np.float64]]:
    """Return motions that cast somewhere, wait, and reset, each with another action.

    Args:
        setup: Cable, workspace, arm and motion settings.
        count: Number of motions.
        seed: Seed of the actions, which are uniform among the feasible ones.

    Returns:
        The motions, and the time at which the reset begins in each [s], shape [count].
    """
    actions = feasible_uniform(count, setup, seed=seed)
    trajectories, begins = [], []
    for cast in (cast_grip_paths(actions[i : i + 1], setup) for i in range(count)):
        end = cast.evaluate(cast.duration[:, None])[0, 0]
        path = _chained([cast, GripPath.hold(end, REST_TIME), reset_path(end, setup)])
        joints = joint_path(path, setup)
        trajectories.append(Trajectory(action=None, grip_path=path, joint_path=joints))
        begins.append(float(cast.duration[0]) + REST_TIME)
    return trajectories, np.array(begins)


def _chained(paths: list[GripPath]) -> GripPath:
    """Return paths of one row, each of which starts where the last one ends, as one."""
    ends = np.cumsum([0.0, *(float(path.duration[0]) for path in paths)])
    knots = [end + path.knots[0, 1:] for end, path in zip(ends, paths, strict=False)]
    coefficients = np.concatenate([path.coefficients for path in paths], axis=1)
    return GripPath(
        knots=np.concatenate([[0.0], *knots])[None], coefficients=coefficients
    ).levelled()


def simulate_resets(
    setup: Setup, count: int, seed: int, config: VirtualConfig | None = None
) -> ResetLibrary:
    """Play casts, each followed by a reset, in the laboratory, and keep how the cable lies.

    Args:
        setup: Cable, workspace, arm and motion settings.
        count: Number of resets.
        seed: Seed of the actions and of the trials.
        config: Settings of the laboratory.
    """
    if count < 1:
        raise InputError(f"count = {count} resets must be at least 1")
    # Drawn shapes, so that a library does not depend on the one before it.
    config = dataclasses.replace(config or VirtualConfig(version=4), stored_resets=False)
    fine_config = dataclasses.replace(config, dt=config.dt / 2)
    trajectories, begins = cast_and_reset(setup, count, seed)
    with RigVirtual(setup, seed, config) as rig, RigVirtual(setup, seed, fine_config) as fine_rig:
        tracks = rig.execute_many(trajectories)
        for index, track in enumerate(tracks):
            # The end of a twisted cable may whip so that the step does not follow it.
            if track.status is TrialStatus.NON_FINITE:
                fine_rig.seek(index)
                tracks[index] = fine_rig.execute_many(trajectories[index : index + 1])[0]
    length = setup.cable.length
    arc_lengths = np.linspace(0.0, length, round(length / NODE_SPACING) + 1)
    positions, before = [], []
    for begin, track in zip(begins, tracks, strict=True):
        if track.nodes is None or track.status in (TrialStatus.NON_FINITE, TrialStatus.ABORTED):
            raise RigError(f"a simulated reset failed: {track.status.value}")
        positions.append(_seen_from_grip(track.nodes[-1], arc_lengths))
        before.append(track.nodes[np.searchsorted(track.times, begin, "right") - 1, -1, :2])
    return ResetLibrary(
        cable=setup.cable.name,
        arc_lengths=arc_lengths,
        positions=np.array(positions),
        before_xy=np.array(before),
        info={},
    )


def _seen_from_grip(
    nodes: NDArray[np.float64], arc_lengths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return a cable's shape relative to the grip, whose yaw is 0 after a reset.

    Args:
        nodes: Shape in the base frame, from the grip to the endpoint [m], shape [vertex, 3].
        arc_lengths: Arc lengths of the result [m], shape [node].
    """
    from scipy.interpolate import CubicSpline

    steps = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    # The rod of the laboratory stretches by less than a thousandth.
    return CubicSpline(arc * (arc_lengths[-1] / arc[-1]), nodes - nodes[0])(arc_lengths)


def hidden_digest(cable: Cable, lab_seed: int) -> str:
    """Return a short name for all that is hidden about a cable, the arm and the table."""
    truth = (hidden_cable(cable, lab_seed), hidden_arm(lab_seed), hidden_table(lab_seed))
    return hashlib.sha256(repr(truth).encode()).hexdigest()[:16]


def report(library: ResetLibrary) -> dict[str, float]:
    """Return how straight, and how alike, the states are, in [% of cable length] and [deg]."""
    length = float(library.arc_lengths[-1])
    x, y = library.endpoints.T
    # The sideways distance of the cable from the straight line between its ends.
    nodes = library.positions[..., :2]
    chord = nodes[:, -1] / np.linalg.norm(nodes[:, -1], axis=1, keepdims=True)
    aside = nodes[..., 0] * chord[:, None, 1] - nodes[..., 1] * chord[:, None, 0]
    pct = {
        "before_scatter": np.sqrt(library.before_xy.var(axis=0).sum()),
        "short_mean": np.mean(length - np.hypot(x, y)),
        "short_max": np.max(length - np.hypot(x, y)),
        "aside_mean": np.mean(x),
        "aside_scatter": np.std(x),
        "ahead_scatter": np.std(y),
        "bow_mean": np.mean(np.max(np.abs(aside), axis=1)),
    }
    values = {f"{name}_pct": float(value) / length * 100 for name, value in pct.items()}
    heading = float(np.std(np.degrees(np.arctan2(x, y))))
    return {"states": len(library), **values, "heading_scatter_deg": heading}


def joined(first: ResetLibrary, second: ResetLibrary) -> ResetLibrary:
    """Return both libraries' states in one, the first's before the second's."""
    return dataclasses.replace(
        first,
        positions=np.concatenate([first.positions, second.positions]),
        before_xy=np.concatenate([first.before_xy, second.before_xy]),
    )


def make_library(cable_name: str, count: int, seed: int, path: pathlib.Path) -> None:
    """Simulate resets, and store them batch by batch, after those that are there.

    Args:
        cable_name: Name of a preset.
        count: Number of resets that the library shall have at least.
        seed: Seed of the casts and of all that the laboratory leaves to chance.
        path: File of the library.
    """
    setup, config = Setup(cable=cable_name), VirtualConfig(version=4)
    info = {
        "seed": seed,
        "batch_size": BATCH_SIZE,
        "lab": dataclasses.asdict(config),
        "reset": dataclasses.asdict(PolarCastConfig()),
        "setup": setup.to_settings(),
        # Tells another true cable from this one without telling its values.
        "truth": hidden_digest(setup.cable, config.lab_seed),
    }
    library = None
    if path.is_file():
        library = ResetLibrary.load(path)
        # A library of other settings is replaced, not continued.
        if library.info != json.loads(json.dumps(info)):
            library = None
    begun, start = len(library) if library else 0, time.monotonic()
    while (done := len(library) if library else 0) < count:
        # Whole batches, each with its own seed, so that a resumed library is the same.
        batch = simulate_resets(setup, BATCH_SIZE, seed * 10_000 + done, config)
        batch = dataclasses.replace(batch, info=info)
        library = joined(library, batch) if library else batch
        library.save(path)
        done += BATCH_SIZE
        left = (time.monotonic() - start) / (done - begun) * max(count - done, 0)
        print(f"{cable_name}: {done} resets, about {left:.0f} s to go", file=sys.stderr)


def main(arguments: list[str] | None = None) -> None:
    """Simulate resets after random casts, store where they leave the cable, and print a report."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--cable", choices=CABLE_NAMES, required=True, help="preset")
    parser.add_argument("--count", type=int, default=48, help="number of resets")
    parser.add_argument("--seed", type=int, default=0, help="seed of the casts and of the trials")
    parser.add_argument("--out", type=pathlib.Path, help="file to write; the package's by default")
    parser.add_argument("--report", action="store_true", help="only print how the states scatter")
    args = parser.parse_args(arguments)
    path = args.out or library_path(args.cable)
    try:
        if not args.report:
            make_library(args.cable, args.count, args.seed, path)
        library = ResetLibrary.load(path)
    except CablecastError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    print(f"{path} ({path.stat().st_size / 1024:.1f} KiB)")
    for name, value in report(library).items():
        print(f"  {name:22} {value:.4g}")


if __name__ == "__main__":
    main()
