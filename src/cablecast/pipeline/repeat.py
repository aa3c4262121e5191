"""repeat: measure how far apart equal casts land."""

import contextlib
import dataclasses
import os
import typing
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cablecast.conventions import Array
from cablecast.data.dataset import read_dataset
from cablecast.data.record import REPEAT_MAX
from cablecast.errors import (
    DamagedFileError,
    DatasetError,
    InputError,
    check_argument_types,
    check_count,
    check_seed,
)
from cablecast.evaluation.repeatability import (
    REPEAT_COUNT,
    Repeatability,
    measure_repeatability,
    repeat_actions,
    save_actions,
)
from cablecast.files import read_numbers, write_bytes
from cablecast.motion.action import check_action_values
from cablecast.motion.feasibility import ACTION_COUNT_MAX
from cablecast.pipeline.places import folder_or_temporary, require
from cablecast.report.maps import repeatability_map
from cablecast.report.style import png_bytes
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.folder import RunFolder, plain_settings, refuse_other_work
from cablecast.runs.progress import Progress, ProgressCallback, show

FIGURE_FILE = "repeatability.png"
ACTIONS_FILE = "actions.csv"
_CASTS_FOLDER = "casts"

Combination = typing.Literal["1.2", "1.5", "1.5-psi", "1.8", "1.8-psi"]

COMBINATIONS: dict[Combination, tuple[float, bool]] = {
    "1.2": (1.2, False),
    "1.5": (1.5, False),
    "1.5-psi": (1.5, True),
    "1.8": (1.8, False),
    "1.8-psi": (1.8, True),
}
"""Combinations that the paper repeated: speed [m/s], and whether the wrist turns. Its section V-E
names 1.2 and 1.5 m/s without psi, its section VI-B gives numbers of 1.2 and 1.8 m/s."""

_MOTION_COLUMNS = ("theta1_deg", "theta2_deg", "r2_m", "psi_deg")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Repeated:
    """Scatter of equal casts by the name of their combination of speed and wrist turn.

    The metrics have those of other combinations, too, that earlier runs measured into the folder.
    """

    results: dict[str, Repeatability]
    metrics: dict[str, Any]


@check_argument_types
def repeat(
    rig: CheckedRig,
    *,
    combinations: Sequence[Combination] = ("1.5-psi",),
    repeats: int = REPEAT_COUNT,
    action_count: int | None = None,
    actions: ArrayLike | None = None,
    seed: int = 0,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = show,
) -> Repeated:
    """Repeat casts on a rig, and measure how far apart equal casts land (section VI-B).

    Args:
        rig: Rig that `make_rig` returned; its set-up gives r0, the combination the speed.
        combinations: Speeds of the gripper [m/s], with psi where the wrist turns, too.
        repeats: Casts of each action.
        action_count: Number of actions of each of the paper's grids, drawn at random; all that the
            arm can make if None.
        actions: Actions to repeat instead, shape [action, 5].
        seed: Seed of the choice of actions.
        out: Folder that keeps the casts, a table of the actions and a picture, and lets a stopped
            run go on; none if None.
        progress: Receives the number of casts done.

    Raises:
        RigError: A cast failed too often.
        InputError: A value out of bounds, or a folder that holds something else.
        MissingExtraError: A picture is to be drawn, and matplotlib is missing.
    """
    check_repeat(combinations, repeats, action_count, actions, seed, out)
    chosen = None if actions is None else check_action_values(actions)
    settings = {
        **rig.setup.to_settings(),
        "rig": dict(rig.description),
        "repeats": repeats,
        "action_count": action_count,
        "actions": None if chosen is None else chosen.tolist(),
        "seed": seed,
    }
    # Each combination has a speed of its own, and further ones may be added to a folder.
    del settings["motion"]["v_max"]
    plans = {}
    for name in combinations:
        v_max, with_psi = COMBINATIONS[name]
        setup = rig.setup.with_motion(v_max=v_max)
        made = chosen
        if made is None:
            made = repeat_actions(setup, with_psi=with_psi, action_count=action_count, seed=seed)
        plans[name] = setup, made
    with folder_or_temporary(out) as folder:
        run = RunFolder.open(folder, "repeat", settings)
        results = {}
        with run.locked():
            for name, (setup, made) in plans.items():
                results[name] = measure_repeatability(
                    run.path / name / _CASTS_FOLDER,
                    rig,
                    setup,
                    actions=made,
                    repeats=repeats,
                    progress=progress,
                )
                if out is not None:
                    save_actions(results[name], run.path / name / ACTIONS_FILE)
            metrics = _with_earlier(run.metrics, list(results.values()))
            # Unless an earlier run has done so.
            stored = run.metrics == plain_settings(metrics) and (run.path / FIGURE_FILE).is_file()
            if out is not None and not stored:
                progress(Progress(task="Drawing the landings"))
                figure = repeatability_map(_drawn(run, metrics, results), rig.setup.workspace)
                write_bytes(run.path / FIGURE_FILE, png_bytes(figure))
                run.finish(metrics)
    return Repeated(results=results, metrics=metrics)


def check_repeat(
    combinations: Sequence[Combination],
    repeats: int,
    action_count: int | None,
    actions: ArrayLike | None,
    seed: int,
    out: str | os.PathLike[str] | None = None,
) -> None:
    """Raise the errors of `repeat` that are known before a rig is connected."""
    if not combinations or any(name not in COMBINATIONS for name in combinations):
        raise InputError(
            f"combinations {str(list(combinations))[:80]} must be some of {', '.join(COMBINATIONS)}"
        )
    check_count("repeats", repeats, 2, REPEAT_MAX)
    if action_count is not None:
        check_count("action_count", action_count, high=ACTION_COUNT_MAX)
    if actions is not None:
        if action_count is not None:
            raise InputError("actions are given: action_count is the number of chosen ones")
        speeds = [COMBINATIONS[name][0] for name in dict.fromkeys(combinations)]
        if len(set(speeds)) < len(speeds):
            raise InputError("actions say themselves whether the wrist turns: name each speed once")
    check_seed(seed)
    if out is not None:
        require("drawing the landings", "matplotlib")
        refuse_other_work(out, "repeat")


def combination(row: dict[str, Any]) -> tuple[float, float, bool]:
    """Return r0, v_max and whether the wrist turns, as coverage and repeatability name them."""
    return row["r0"], row["v_max"], row["with_psi"]


def _with_earlier(stored: dict[str, Any] | None, results: list[Repeatability]) -> dict[str, Any]:
    """Return the metrics of results, and the stored ones of combinations that are not in them."""
    rows = [result.to_dict() for result in results]
    measured = {combination(row) for row in rows}
    earlier = stored["combinations"] if stored is not None else []
    kept = [row for row in earlier if combination(row) not in measured]
    return {"combinations": sorted([*kept, *rows], key=combination)}


def _drawn(
    run: RunFolder, metrics: dict[str, Any], results: dict[str, Repeatability]
) -> list[Repeatability]:
    """Return the results, and those of the metrics' other combinations from their casts."""
    drawn = list(results.values())
    wanted = {combination(row) for row in metrics["combinations"]}
    wanted -= {combination(result.to_dict()) for result in drawn}
    for name in COMBINATIONS:
        if name in results:
            continue
        # A combination whose casts are gone or damaged keeps its figures, and cannot be drawn.
        with contextlib.suppress(DatasetError, DamagedFileError):
            earlier = Repeatability.from_dataset(read_dataset(run.path / name / _CASTS_FOLDER))
            if combination(earlier.to_dict()) in wanted:
                drawn.append(earlier)
    return sorted(drawn, key=lambda result: combination(result.to_dict()))


def read_actions(path: str | os.PathLike[str]) -> Array:
    """Return the actions of a CSV file, with a pace of 1 where it has none, shape [action, 5]."""
    actions = np.array(read_numbers(os.fspath(path), _MOTION_COLUMNS, 1, optional=("pace",)))
    actions[:, [0, 1, 3]] = np.radians(actions[:, [0, 1, 3]])
    return check_action_values(actions)
