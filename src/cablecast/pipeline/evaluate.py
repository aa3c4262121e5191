"""evaluate: cast at targets, and measure how near the cable landed."""

import dataclasses
import os
from typing import Any

from numpy.typing import ArrayLike

from cablecast.data.record import REPEAT_MAX
from cablecast.engines import engine_name, make_engine
from cablecast.errors import InputError, check_argument_types, check_count
from cablecast.evaluation.evaluate import (
    Evaluation,
    evaluate_policy,
    evaluation_metrics,
    save_trials,
    split_errors,
)
from cablecast.files import write_bytes, write_text
from cablecast.learning.landing import LandingModel
from cablecast.learning.policy import ForwardSearchPolicy, PlanMethod, Policy
from cablecast.pipeline.places import folder_or_temporary, require
from cablecast.report.maps import landing_map
from cablecast.report.page import report_page
from cablecast.report.style import png_bytes
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.engine import RigEngine
from cablecast.rigs.make import make_rig
from cablecast.runs.folder import RunFolder, refuse_other_work, settings_differences
from cablecast.runs.progress import Progress, ProgressCallback, show
from cablecast.task import LANDING
from cablecast.workspace import load_targets

TRIALS_FILE = "trials.csv"
MAP_FILE = "landings.png"
REPORT_FILE = "report.html"
CASTS_FOLDER = "casts"


@check_argument_types
def evaluate(
    policy: Policy,
    rig: CheckedRig,
    targets: ArrayLike | None = None,
    *,
    repeats: int = 1,
    method: PlanMethod = "refined",
    device: str = "cpu",
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = show,
) -> Evaluation:
    """Cast at targets and measure how far from them the cable lands (section VI).

    Args:
        policy: Policy that `train` returned, or any other.
        rig: Rig that `make_rig` returned, with the set-up of the policy.
        targets: Targets [m], shape [target, 2]; the paper's 32 if None.
        repeats: Casts at each target; the paper makes 5.
        method: How a policy of a model plans: "refined", or "paper" for equation 1 alone.
        device: Device of the simulator that splits the errors, "cpu" or "cuda".
        out: Folder that keeps the casts, metrics.json, trials.csv, a map of the landings and a
            report, and lets a stopped evaluation go on; none if None.
        progress: Receives the number of casts done.

    Returns:
        The casts; `summary` holds the quartiles of the errors in % of cable length.

    Raises:
        InputError: The rig has another set-up than the policy, a value is out of bounds, the device
            is not here, or the folder holds other work.
        TargetError: A target that cannot be asked for.
        RigError: A cast failed too often.
        MissingExtraError: A report is to be written, and matplotlib or jinja2 is missing.
    """
    if out is not None:
        require("the report", "matplotlib", "jinja2")
    if isinstance(policy, ForwardSearchPolicy):
        policy = policy.by(method)
    check_rig_setup(rig, policy)
    target_xy = LANDING.values(policy.setup, load_targets() if targets is None else targets)
    settings = {
        **policy.setup.to_settings(),
        "policy": policy.info,
        "rig": dict(rig.description),
        "repeats": repeats,
        "targets": target_xy.tolist(),
    }
    with folder_or_temporary(out) as folder:
        run = RunFolder.open(folder, "evaluate", settings)
        stored = run.metrics
        with run.locked():
            evaluation = evaluate_policy(
                run.path / CASTS_FOLDER,
                policy,
                rig,
                target_xy,
                repeats=repeats,
                progress=progress,
            )
            # Missing casts were just made again: the old metrics are not of these.
            known = stored is not None and stored.get("casts_fingerprint") == evaluation.fingerprint
            if known and (run.path / REPORT_FILE).is_file():
                return dataclasses.replace(evaluation, metrics=stored)
            metrics = evaluation_metrics(evaluation)
            if out is not None:
                progress(Progress(task="Drawing the report"))
                metrics["error_split"] = _split(evaluation, policy, device)
                _write_files(run, evaluation, policy)
                run.finish(metrics)
        return dataclasses.replace(evaluation, metrics=metrics)


def check_evaluate(
    policy: Policy,
    *,
    repeats: int,
    device: str = "cpu",
    out: str | os.PathLike[str] | None = None,
) -> None:
    """Raise the errors of `evaluate` that are known before a rig is connected."""
    check_count("repeats", repeats, high=REPEAT_MAX)
    if out is not None:
        require("the report", "matplotlib", "jinja2")
        refuse_other_work(out, "evaluate")
    if isinstance(policy, ForwardSearchPolicy) and policy.model.settings.is_simulated:
        engine_rig(policy.model, device).close()


def engine_rig(model: LandingModel, device: str = "cpu", engine: str | None = None) -> CheckedRig:
    """Return the simulator of a model's training casts as a rig, or another engine of its cable."""
    settings = model.settings
    if not settings.is_simulated:
        raise InputError("the model was not trained on simulated casts: its simulator is unknown")
    stored = settings.values["engine"]
    made = make_engine(engine_name(stored), stored["segment_count"], stored["dt"], device)
    if engine is not None and engine != engine_name(stored):
        made = make_engine(engine, device=device)
    return make_rig(RigEngine(made, model.setup, settings.dynamics), model.setup)


def check_rig_setup(rig: CheckedRig, policy: Policy) -> None:
    """Refuse a rig whose set-up is not that of a policy; the error names each value."""
    there, here = rig.setup.to_settings(), policy.setup.to_settings()
    # The rig makes any motion: r0 and v_max are the policy's. What a cable is believed to be does
    # not matter to a rig either, but which cable it is does.
    for values in (there, here):
        del values["motion"]
        del values["cable"]["params"]
    if differences := settings_differences(there, here):
        raise InputError(f"the rig and the policy differ: {'; '.join(differences)}")


def _split(evaluation: Evaluation, policy: Policy, device: str) -> dict[str, Any] | None:
    """Return the parts of the errors; None for a policy without simulated casts."""
    if not (isinstance(policy, ForwardSearchPolicy) and policy.model.settings.is_simulated):
        return None
    with engine_rig(policy.model, device) as engine:
        split = split_errors(evaluation, engine)
    return None if split is None else split.to_dict()


def _write_files(run: RunFolder, evaluation: Evaluation, policy: Policy) -> None:
    save_trials(evaluation, run.path / TRIALS_FILE)
    simulated_xy, info = None, {}
    if isinstance(policy, ForwardSearchPolicy):
        simulated_xy, info = policy.predicted_xy, policy.model.info
    figure = landing_map(evaluation, simulated_xy)
    write_bytes(run.path / MAP_FILE, png_bytes(figure))
    page = report_page(evaluation, info, run.config, simulated_xy=simulated_xy)
    write_text(run.path / REPORT_FILE, page)
