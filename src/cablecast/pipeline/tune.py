"""tune: make the simulator move its cable as the real one moved."""

import dataclasses
import os
import typing
from typing import Any

from cablecast.data.dataset import Dataset
from cablecast.engines import EngineName, make_engine
from cablecast.engines.base import Engine, engine_settings
from cablecast.engines.spread import spread
from cablecast.errors import InputError, check_argument_types
from cablecast.files import write_bytes
from cablecast.pipeline.places import folder_or_temporary, require
from cablecast.report.maps import spread_choice, track_panels
from cablecast.report.style import png_bytes
from cablecast.runs.folder import METRICS_FILE, RunFolder
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, show
from cablecast.runs.workers import LOCAL, connected
from cablecast.tuning.fit import FitConfig
from cablecast.tuning.servo import ServoFit, can_identify_servo, identify_servo
from cablecast.tuning.tracks import MeasuredTracks, TrackObjective, has_measured_joints
from cablecast.tuning.tune import TuneConfig, fit_params, split_tracks, tune_params
from cablecast.tuning.tuned import Tuned, load_tuned, write_params

GENERATIONS_FOLDER = "generations"
TRACKS_FILE = "tracks.png"

HELD_OUT_FROM = 20
"""Number of casts from which on the least-squares fit holds out a quarter of them. With fewer,
all are fitted to, and the result is measured on the same casts."""

PathSource = typing.Literal["auto", "commanded", "measured"]


@check_argument_types
def tune(
    casts: Dataset,
    *,
    config: FitConfig | TuneConfig | None = None,
    validation_count: int | None = None,
    path: PathSource = "auto",
    engine: EngineName = "warp",
    segment_count: int | None = None,
    dt: float | None = None,
    device: str = "cpu",
    workers: str = LOCAL,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = show,
) -> Tuned:
    """Find the ten parameters with which the simulator follows measured casts (section V-D).

    The servo of the arm is identified from the same casts. Where there are enough casts, some are
    held out to measure the result.

    Args:
        casts: Casts that `collect` recorded; two are enough for a fit by least squares.
        config: A `FitConfig` for a fit by least squares with a prior, which is the default, or a
            `TuneConfig` for the paper's search.
        validation_count: Casts that are held out, possibly 0 for a fit by least squares. If None
            a quarter, as in the paper, but 0 for such a fit to fewer than 20 casts.
        path: Motion of the gripper to simulate: the commanded one, or what the arm reported.
            "auto" takes the reported one where there is one.
        engine: Simulator, see `make_engine`. Only "warp" fits material parameters besides the ten,
            and other physics for `aim`.
        segment_count: Segments of the simulated cable; the engine's default if None.
        dt: Time step [s]; the engine's default if None.
        device: "cpu" or "cuda".
        workers: Who simulates: "local", "ray" for a cluster on this machine, or "ray:ADDRESS".
        out: Folder that keeps the results and lets a stopped search go on; none if None.
        progress: Told after every generation how the search stands.

    Returns:
        The parameters, the servo, and how well they follow the held-out casts.

    Raises:
        InputError: Too few casts, a value out of bounds, or a folder that holds something else.
        DatasetError: The casts hold no tracks.
        MissingExtraError: The results are to be kept, and matplotlib is missing.
    """
    config = config or FitConfig()
    if casts.kind == "sim":
        raise InputError("tuning needs casts of a rig: these were simulated")
    if out is not None:
        require("drawing the tracks", "matplotlib")
    tracks = MeasuredTracks.from_dataset(casts, path_source=path)
    split = _split(tracks, config, validation_count)
    if engine != "warp" and isinstance(config, FitConfig):
        config = dataclasses.replace(config, materials=(), ensemble_iterations=0)
    fine = rough = coarse = make_engine(engine, segment_count, dt, device)
    if isinstance(config, FitConfig):
        coarse, rough = (
            make_engine(engine, min(count, fine.segment_count), max(step, fine.dt), device)
            for count, step in (
                (config.coarse_segment_count, config.coarse_dt),
                (config.rough_segment_count, config.rough_dt),
            )
        )
    engines = spread(rough, workers), spread(coarse, workers), spread(fine, workers)
    settings = {
        **casts.setup.to_settings(),
        "dataset_fingerprint": casts.fingerprint,
        "tuning": {"method": method_name(config), **dataclasses.asdict(config)},
        "training_count": len(split[0]),
        "validation_count": 0 if split[1] is None else len(split[1]),
        "path": tracks.path_source,
        "engine": engine_settings(fine),
        "coarse_engine": engine_settings(coarse),
        "rough_engine": engine_settings(rough),
    }
    with folder_or_temporary(out) as folder:
        run = RunFolder.open(folder, "tune", settings)
        if run.metrics is None:
            with run.locked(), connected(workers):
                return _search(run, casts, split, engines, config, progress, out is not None)
        progress(Progress(task=f"Tuning {casts.cable.name}", note=DONE_NOTE))
        try:
            found = load_tuned(folder, casts.setup)
        except InputError as error:
            again = f"Delete {run.path / METRICS_FILE}, and the same command fits anew"
            raise InputError(f"{error}. {again}") from None
        return dataclasses.replace(found, metrics=run.metrics or {}, path=folder)


def _search(
    run: RunFolder,
    casts: Dataset,
    split: tuple[MeasuredTracks, MeasuredTracks | None],
    engines: tuple[Engine, Engine, Engine],
    config: FitConfig | TuneConfig,
    progress: ProgressCallback,
    keep: bool,
) -> Tuned:
    training, validation = split
    *_, fine = engines
    setup, servo = casts.setup, None
    if has_measured_joints(casts) and can_identify_servo(casts):
        progress(Progress(task="Identifying the arm's servo"))
        servo = identify_servo(casts, len(training))
    kept: Any = {
        "checkpoint": run.parts(GENERATIONS_FOLDER) if keep else None,
        "progress": progress,
    }
    if isinstance(config, FitConfig):
        tuned = fit_params(setup, training, validation, engines, config, **kept)
    else:
        tuned = tune_params(setup, training, validation or training, fine, config, **kept)
    tuned = dataclasses.replace(
        tuned.with_servo(None if servo is None else servo.model), fitted_to=casts.fingerprint
    )
    values = {**tuned.to_dict(), **tuned.metrics, "method": method_name(config)}
    metrics = {
        **values,
        "training_count": len(training),
        "held_out_count": 0 if validation is None else len(validation),
        "servo_fit": _servo_metrics(servo),
    }
    if keep:
        progress(Progress(task="Drawing the tracks"))
        figure = _figure(tuned, validation or training, fine)
        write_bytes(run.path / TRACKS_FILE, figure)
        del values["history"]
        write_params(run.path, values)
        run.finish(metrics)
    return dataclasses.replace(tuned, metrics=metrics, path=run.path if keep else None)


def method_name(config: FitConfig | TuneConfig) -> str:
    """Return the name of a method: "least-squares" or "de"."""
    return "least-squares" if isinstance(config, FitConfig) else "de"


def _split(
    tracks: MeasuredTracks, config: FitConfig | TuneConfig, validation_count: int | None
) -> tuple[MeasuredTracks, MeasuredTracks | None]:
    """Return the tracks to fit and those to measure the result with, if there are any."""
    if isinstance(config, FitConfig):
        if len(tracks) < 2:
            raise InputError(f"a fit needs at least 2 casts, not {len(tracks)}")
        if validation_count == 0 or (validation_count is None and len(tracks) < HELD_OUT_FROM):
            return tracks, None
    return split_tracks(tracks, validation_count)


def _servo_metrics(servo: ServoFit | None) -> dict[str, Any] | None:
    if servo is None:
        return None
    return {
        "commanded_rms_m": servo.commanded_rms,
        "model_rms_m": servo.model_rms,
        "trial_count": servo.trial_count,
        "lag_s": servo.model.lag.tolist(),
    }


def _figure(tuned: Tuned, validation: MeasuredTracks, engine: Engine) -> bytes:
    """Return a picture of some held-out tracks, simulated before and after."""
    cable = tuned.setup.cable
    objective = TrackObjective(engine, cable, validation)
    before, after = (objective.tracks_of(p)[0][0, :, :-1] for p in (cable.params, tuned.params))
    figure = track_panels(
        validation,
        before,
        after,
        tuned.setup.workspace,
        spread_choice(objective.distances(tuned.params).mean[0], 9),
        cable.length,
    )
    return png_bytes(figure)
