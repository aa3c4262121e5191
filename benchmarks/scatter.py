"""What limits a cast at a target: scatter, the error of the simulator, uneven friction.

scatter: after the calibration casts the loop of `cablecast aim` chooses a first cast at each of the
targets. Each is made several times, with other random draws. The scatter of its landings, and the
distance from their middle to the landing that the simulators expect, are compared with what is
known before: the sensitivity to the action, the friction, and how far the simulators are apart. The
stated scatter along each axis is that of the plan. No correction of one cast of a rig lands nearer
than the casts scatter. Each target is kept in --out: the same command resumes where it was stopped,
and shares fits and models with `benchmarks casts`.

uneven: the strange rig is cast at random actions without scatter, once as it is and once with one
friction everywhere. The landings of both give the shift by the uneven friction; central differences
about the action give the Jacobian of the landing. A correction by the Jacobian J of the even world
moves the landing in the uneven one, whose Jacobian is J', so that the share |I - J' J^+| of a miss
in the worst direction is left: what a method with no other error would leave.
"""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.places import DIFFERENCES, Luck, ModelArgs, Place, equal_casts, random_targets
from benchmarks.result import Table
from benchmarks.strange_rig import Scatter, StrangeRig
from cablecast.aiming.predictor import log_scatters
from cablecast.cast import TrialStatus
from cablecast.cli.progress import console_progress
from cablecast.errors import JointLimitError
from cablecast.motion.action import ACTION_SIZE, ActionRanges, mirror_to_right
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import feasible_ranges, feasible_uniform
from cablecast.motion.trajectory import plan_trajectory
from cablecast.runs.progress import Progress
from cablecast.setup import Setup

SCATTER_COLUMNS = ("rig", "cable", "targets", "scatter", "stated", "distance", "lost", "error")
RANK_COLUMNS = ("predicted by", "with the scatter", "with the error")


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScatterArgs(ModelArgs):
    """Scatter of equal casts, measured and stated."""

    rig: str = "virtual"
    """Rig: virtual, strange, even, patchy, engine or example."""
    labs: tuple[int, ...] = (0, 1, 2)
    """Seeds of the laboratories."""
    calibration: int = 5
    """Casts before the first target."""
    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Cables."""
    targets: int = 12
    """Targets in each laboratory."""
    repeats: int = 6
    """Equal casts at each."""


def cast_again(place: Place, args: ScatterArgs) -> list[dict[str, Any]]:
    """Return landings of equal casts at each target of a place, and what predicted it."""
    session, rows = None, []
    length = place.setup.cable.length
    for index, target in enumerate(random_targets(args.targets, place.lab)):
        name = f"scatter-{args.calibration}-{args.repeats}-{index:03d}"
        row = place.parts.get(name)
        if row is None:
            session = session or place.session(args.calibration)
            predictor = session.predictor
            proposal = session.propose(target)
            action, side = mirror_to_right(proposal.action.to_array()[None])
            found = predictor.ensemble.landings(action, side)
            luck = Luck(place.rig, 100_000 + 100 * index)
            landings = np.array(equal_casts(luck, proposal.trajectory, args.repeats)) / length
            row = {
                "landings": [xy.tolist() if np.isfinite(xy).all() else None for xy in landings],
                "stated": proposal.expected.scatter / length,
                "simulated": (found.landing_xy[0] * (side[0], 1.0) / length).tolist(),
                "sensitivity": float(predictor.beliefs.sensitivities(action)[0]),
                "friction": float(found.frictions[0]),
                "spread": float(found.spreads[0]),
            }
            place.parts.put(name, row)
        rows.append(row)
        task = f"{place.name} {place.lab} {place.setup.cable.name}, equal casts"
        place.progress(Progress(task=task, done=index + 1, total=args.targets, unit="targets"))
    return rows


def measured(rows: list[dict[str, Any]]) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Return what equal casts did, each of shape [target].

    Returns:
        Standard deviation along each axis, median distance from their middle, distance from there
        to the simulated landing [cable lengths]; and the share without a landing [-].
    """
    found = []
    for row in rows:
        every = row["landings"]
        landings = np.array([xy for xy in every if xy is not None], dtype=float)
        if len(landings) < 2:
            found.append((np.nan, np.nan, np.nan, 1.0))
            continue
        deviation = np.sqrt(landings.var(axis=0, ddof=1).mean())
        middle = np.median(landings, axis=0)
        distance = np.median(np.linalg.norm(landings - middle, axis=1))
        error = np.linalg.norm(middle - row["simulated"])
        found.append((deviation, distance, error, 1.0 - len(landings) / len(every)))
    deviation, distance, error, lost = np.array(found).T
    return deviation, distance, error, lost


def rank_rows(rows: list[dict[str, Any]]) -> list[tuple[str, str, str]]:
    """Return the rank correlations of predictors with scatter and error."""
    from scipy.stats import spearmanr

    deviation, _, error, _ = measured(rows)
    finite = np.isfinite(deviation) & np.isfinite(error)
    sensitivity, friction = (
        np.array([row[key] for row in rows]) for key in ("sensitivity", "friction")
    )
    kinds = {
        "sensitivity to the action": sensitivity,
        "friction": friction,
        "both": log_scatters(sensitivity, friction),
        "spread of the simulators": np.array([row["spread"] for row in rows]),
    }
    return [
        (
            kind,
            f"{spearmanr(values[finite], deviation[finite]).statistic:.2f}",
            f"{spearmanr(values[finite], error[finite]).statistic:.2f}",
        )
        for kind, values in kinds.items()
    ]


def scatter(args: ScatterArgs) -> Iterator[Table]:
    """Yield scatter and error of each cable, and what predicts them."""
    every, table = [], []
    with console_progress() as progress:
        for cable in args.cables:
            here = []
            for lab in args.labs:
                here += cast_again(
                    Place(args, args.rig, lab, cable, args.calibration, progress), args
                )
            deviation, distance, error, lost = measured(here)
            stated = np.median([row["stated"] for row in here])
            numbers = (np.nanmedian(deviation), stated, np.nanmedian(distance), np.mean(lost))
            percent = (f"{100.0 * number:.1f}" for number in (*numbers, np.nanmedian(error)))
            table.append((args.rig, cable, len(here), *percent))
            every += here
    title = "Medians over targets in % of cable length; lost: casts without a landing [%]"
    yield Table(title=title, columns=SCATTER_COLUMNS, rows=table)
    title = f"Rank correlation at {len(every)} targets"
    yield Table(title=title, columns=RANK_COLUMNS, rows=rank_rows(every))


STEP = 0.02
"""Half the way of a central difference, as a share of the range of each number of an action."""
STILL = Scatter(angle=0.0, bow=0.0, friction=0.0)
UNEVEN = ("strange", "patchy")
"""Rigs that are compared with the one of even friction."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class UnevenArgs:
    """Effect of uneven friction on landings and corrections.

    Attributes:
        cable: Name of a preset.
        labs: Seeds of the laboratories.
        count: Actions in each laboratory whose casts come to rest on the table.
    """

    cable: str = "cable_1"
    labs: tuple[int, ...] = (0, 1, 2)
    count: int = 24


def landing(rig: StrangeRig, action: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return where a cast comes to rest [m], shape [2]; None unless it is made and seen there."""
    try:
        motion = plan_trajectory(Action.from_array(action), rig.setup)
    except JointLimitError:
        return None
    # The camera errs alike in every cast, which differences don't see.
    rig.seek(0)
    rig.reset()
    track = rig.execute(motion)
    return track.endpoint_xy[-1] if track.status is TrialStatus.OK else None


def linear(rig: StrangeRig, actions: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the landing of an action, then its change with each number, shape [1 + number, 2].

    Args:
        rig: Rig without scatter.
        actions: An action, then those a step up and those a step down in each of its numbers,
            shape [1 + 2 number, number].
    """
    found = []
    for action in actions:
        xy = landing(rig, action)
        if xy is None:
            return None
        found.append(xy)
    middle, up, down = np.split(np.array(found), (1, 1 + len(found) // 2))
    return np.concatenate([middle, (up - down) / 2])


def stencils(setup: Setup, count: int, seed: int) -> NDArray[np.float64]:
    """Return feasible actions with their steps up and down, shape [action, 1 + 2 number, number].

    psi moves with theta2, so that theta2 can take a step where the wrist does not turn.
    """
    ranges = feasible_ranges(setup)
    bounds = np.array([ranges.theta1, ranges.theta2, ranges.r2, ranges.wrist])
    inner = bounds + STEP * np.diff(bounds) * [1.0, -1.0]
    theta1, theta2, r2, wrist = ((float(low), float(high)) for low, high in inner)
    within = ActionRanges(theta1=theta1, theta2=theta2, r2=r2, wrist=wrist)
    actions = feasible_uniform(count, setup, within, seed=seed)
    steps = STEP * np.diff(bounds) * np.eye(len(bounds), ACTION_SIZE)
    steps[1, 3] = steps[1, 1]
    around = np.concatenate([np.zeros((1, ACTION_SIZE)), steps, -steps])
    return actions[:, None] + around


def after_correction(
    believed: NDArray[np.float64], true: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the relative error of a Jacobian, and the share of a miss that a step by it leaves.

    Args:
        believed: Jacobian that the correction inverts, shape [2, number].
        true: Jacobian of the rig, shape [2, number].
    """
    change = np.linalg.norm(true - believed) / np.linalg.norm(believed)
    left = np.linalg.norm(np.eye(2) - true @ np.linalg.pinv(believed), 2)
    return float(change), float(left)


def still_rig(name: str, args: UnevenArgs, lab: int) -> StrangeRig:
    """Return a rig of a laboratory, without scatter."""
    differences = DIFFERENCES[name] | {"scatter": STILL}
    return StrangeRig(Setup(cable=args.cable), lab_seed=lab, **differences)


def compare(args: UnevenArgs) -> dict[str, NDArray[np.float64]]:
    """Return shift [%], change of the Jacobian [-] and share left [-] by rig, [action, 3].

    The actions are those that come to rest on the table on all rigs.
    """
    length = Setup(cable=args.cable).cable.length
    rows: dict[str, list[tuple[float, float, float]]] = {name: [] for name in UNEVEN}
    for number, lab in enumerate(args.labs, 1):
        rigs = [still_rig(name, args, lab) for name in ("even", *UNEVEN)]
        for actions in stencils(rigs[0].setup, 10 * args.count, lab):
            casts = [cast for rig in rigs if (cast := linear(rig, actions)) is not None]
            if len(casts) < len(rigs):
                continue
            smooth, *others = casts
            for name, rough in zip(UNEVEN, others, strict=True):
                shift = 100.0 * float(np.linalg.norm(rough[0] - smooth[0])) / length
                rows[name].append((shift, *after_correction(smooth[1:].T, rough[1:].T)))
            if len(rows[UNEVEN[0]]) == number * args.count:
                break
    return {name: np.array(of) for name, of in rows.items()}


def uneven(args: UnevenArgs) -> Iterator[Table]:
    """Yield medians and quartiles on both rigs."""
    table = Table(
        f"Uneven friction and one friction, {args.cable}: medians (quartiles)",
        ("rig", "actions", "shift of the landing [%]", "change of the Jacobian", "miss left"),
        [],
    )
    for name, found in compare(args).items():
        q1, median, q3 = np.quantile(found, (0.25, 0.5, 0.75), axis=0)
        cells = (f"{m:.2f} ({a:.2f} to {b:.2f})" for m, a, b in zip(median, q1, q3, strict=True))
        table.rows.append((name, len(found), *cells))
    yield table
