"""Files of aimed casts: metrics.json, trials.csv, a map of the tries, and the report."""

import dataclasses
import pathlib
from typing import Any

import numpy as np

from cablecast.evaluation.evaluate import (
    Evaluation,
    TargetCast,
    evaluation_metrics,
    save_trials,
    summarise_errors,
)
from cablecast.files import write_bytes, write_text
from cablecast.learning.policy import COVERAGE_PCT
from cablecast.motion.action import Action
from cablecast.motion.trajectory import plan_trajectory
from cablecast.pipeline.aim import AimResult
from cablecast.pipeline.evaluate import REPORT_FILE, TRIALS_FILE
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.folder import RunFolder

TRIES_FILE = "tries.png"


def aim_evaluation(result: AimResult, rig: CheckedRig) -> Evaluation:
    """Return all casts at some targets as an evaluation; `repeat` counts the tries from 0.

    Args:
        result: Casts at the targets.
        rig: Rig that made them.
    """
    session = result.session
    casts = session.store.dataset()
    policy = session.aimer.policy
    inside = policy.inside_coverage(result.target_xy)
    trials = [
        TargetCast(
            target_index=index,
            repeat=trial.try_number - 1,
            target_xy=result.target_xy[index],
            predicted_xy=trial.expected_xy,
            track=casts.track(trial.number),
            trajectory=plan_trajectory(Action.from_array(trial.action), session.setup),
        )
        for index, own in enumerate(result.trials)
        for trial in own
    ]
    return Evaluation(
        setup=session.setup,
        rig=dict(rig.description),
        target_xy=result.target_xy,
        inside_coverage=inside,
        trials=tuple(trials),
    )


def last_tries(evaluation: Evaluation) -> Evaluation:
    """Return the last cast at each target: the hit, or the one that used up the tries."""
    last = {trial.target_index: trial for trial in evaluation.trials}
    return dataclasses.replace(evaluation, trials=tuple(last[key] for key in sorted(last)))


def write_aim_report(result: AimResult, rig: CheckedRig, run: RunFolder) -> Evaluation:
    """Write metrics, casts, the map of the tries, and the report of the last tries.

    Args:
        result: Casts at the targets.
        rig: Rig that made them.
        run: Folder of the results.

    Returns:
        The last cast at each target, with metrics; `tries` among these has one row per try.
    """
    from cablecast.report.maps import tries_map
    from cablecast.report.page import report_page
    from cablecast.report.style import png_bytes, svg_uri

    every = aim_evaluation(result, rig)
    last = last_tries(every)
    metrics = evaluation_metrics(last) | {
        "tries": tries_metrics(result),
        "cast_count": len(result.session.history),
    }
    last = dataclasses.replace(last, metrics=metrics)
    policy = result.session.aimer.policy
    save_trials(every, run.path / TRIALS_FILE)
    figure = tries_map(every)
    write_bytes(run.path / pathlib.Path(TRIES_FILE), png_bytes(figure))
    page = report_page(
        last,
        policy.model.info,
        run.config,
        simulated_xy=policy.predicted_xy,
        simulated_radius=COVERAGE_PCT / 100 * last.cable.length,
        tries=svg_uri(figure),
    )
    write_text(run.path / REPORT_FILE, page)
    run.finish(metrics)
    return last


def tries_metrics(result: AimResult) -> list[dict[str, Any]]:
    """Return the errors after each try, casts without a landing counted as misses.

    Args:
        result: Casts at the targets. A target that was hit keeps the miss of that cast.
    """
    tries = max((len(trials) for trials in result.trials), default=0)
    rows = []
    for number in range(1, tries + 1):
        misses = result.misses_pct(number)
        row = summarise_errors(np.nan_to_num(misses, nan=np.inf)).to_dict()
        rows.append({"try": number, "without_landing": int(np.isnan(misses).sum()), **row})
    return rows
