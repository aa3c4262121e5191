"""`cablecast tune`: make the simulator move its cable as the real one moved."""

import contextlib
import dataclasses
import pathlib
import sys
import typing
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any

from cablecast.cli.collect import DATA_FOLDERS
from cablecast.cli.options import (
    DEFAULT_CABLE,
    Device,
    argument,
    cable_folder,
    check_same_cable,
)

if TYPE_CHECKING:
    from cablecast.cable import Cable
    from cablecast.datasets.reader import Dataset
    from cablecast.tuning.servo import ServoFit
    from cablecast.tuning.tracks import MeasuredTracks
    from cablecast.tuning.tune import TuneProgress, TuneResult

TUNE_FOLDER = "tune"
CHECKPOINT_FILE = "generations.json"
TRACKS_FILE = "tracks.png"

_SHOW_EVERY = 5


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tune:
    """Find the ten parameters of a cable with which the simulator follows measured casts.

    Searches with Differential Evolution for the parameters whose simulated endpoints are nearest to
    the measured ones, and learns from the same casts how the arm lags behind its set points. A
    quarter of the casts is held out to measure the result. A search that was interrupted, in
    whatever way, goes on when it is started again. Give the resulting params.json to `cablecast
    simulate --params`.
    """

    cable: Annotated[str | None, argument("CABLE", "that of --dataset, or cable_1")] = None
    """Which cable: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    dataset: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/tune-data")] = None
    """Folder that `cablecast collect` wrote."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/tune")] = None
    """Where to put the results."""
    seed: int = 0
    """Chooses everything that the search draws."""
    method: typing.Literal["de", "cmaes"] = "de"
    """How to search: Differential Evolution as in the paper, or CMA-ES."""
    population_size: int = 48
    """Parameter sets that are simulated at a time."""
    coarse_generations: int = 60
    """How many times, on a coarse cable."""
    fine_population_size: int = 24
    """How many of the best go on at full resolution (Differential Evolution only)."""
    fine_generations: int = 25
    """How many times more, at full resolution."""
    validation_count: Annotated[int | None, argument("INT", "a quarter of the casts")] = None
    """How many casts are held out; the paper held out 20 of 80."""
    path: typing.Literal["auto", "commanded", "measured"] = "auto"
    """Which motion of the gripper to simulate: the commanded one, or what the arm reported; auto
    takes the reported one where there is one."""
    device: Device = "cpu"
    """Simulate on the processor or on an NVIDIA graphics card."""
    segment_count: Annotated[int | None, argument("INT", "what the convergence study chose")] = None
    """How many segments the simulated cable has in the end."""
    dt: Annotated[float | None, argument("S", "what the convergence study chose")] = None
    """Time step of the simulation in the end [s]."""

    def run(self) -> None:
        """Tune, write the results, and print the table of distances."""
        from cablecast.cable import load_cable
        from cablecast.cli.run_folder import RunFolder
        from cablecast.datasets.reader import read_dataset
        from cablecast.datasets.simulate import engine_settings
        from cablecast.engines.warp_ import EngineWarp
        from cablecast.tuning.tracks import MeasuredTracks
        from cablecast.tuning.tune import TuneConfig, split_tracks

        asked = load_cable(self.cable) if self.cable else None
        folder = find_tune_data(self.dataset, asked)
        dataset = read_dataset(folder)
        cable = check_same_cable(asked, dataset.cable, folder)
        config = TuneConfig(
            method=self.method,
            population_size=self.population_size,
            coarse_generations=self.coarse_generations,
            fine_population_size=min(self.fine_population_size, self.population_size),
            fine_generations=self.fine_generations,
            seed=self.seed,
        )
        tracks = MeasuredTracks.from_dataset(dataset, path_source=self.path)
        training, validation = split_tracks(tracks, self.validation_count)
        resolution = {"segment_count": self.segment_count, "dt": self.dt}
        engine = EngineWarp(
            device=self.device, **{k: v for k, v in resolution.items() if v is not None}
        )
        coarse_engine = EngineWarp(
            segment_count=min(config.coarse_segment_count, engine.segment_count),
            dt=max(config.coarse_dt, engine.dt),
            device=self.device,
        )
        settings = {
            "cable": cable.to_dict(),
            "dataset_fingerprint": dataset.fingerprint,
            "tuning": dataclasses.asdict(config),
            "training_count": len(training),
            "validation_count": len(validation),
            "path": tracks.path_source,
            "engine": engine_settings(engine),
            "coarse_engine": engine_settings(coarse_engine),
        }
        out = self.out or cable_folder(cable.name) / TUNE_FOLDER
        run = RunFolder.open(out, "tune", settings)
        if run.metrics is None:
            run.begin()
            self._search(run, cable, dataset, (training, validation), (coarse_engine, engine))
        metrics = run.metrics or {}
        print_table(metrics, cable.name)
        print(f"parameters  {out / 'params.json'}\ntracks      {out / TRACKS_FILE}")

    def _search(
        self,
        run: Any,
        cable: "Cable",
        dataset: "Dataset",
        split: tuple["MeasuredTracks", "MeasuredTracks"],
        engines: tuple[Any, Any],
    ) -> None:
        from cablecast.files import write_bytes, write_json
        from cablecast.report.style import png_bytes
        from cablecast.tuning.result import PARAMS_FILE, params_file
        from cablecast.tuning.servo import identify_servo
        from cablecast.tuning.tracks import has_measured_joints
        from cablecast.tuning.tune import TuneConfig, tune_params

        training, validation = split
        servo = None
        if has_measured_joints(dataset):
            print("Identifying the arm's servo", file=sys.stderr)
            servo = identify_servo(dataset, len(training))
        config = TuneConfig(**run.config["settings"]["tuning"])
        with search_progress(f"Tuning {cable.name}") as progress:
            result = tune_params(
                cable,
                training,
                validation,
                *engines,
                config,
                checkpoint=run.path / CHECKPOINT_FILE,
                progress=progress,
            )
        print("Drawing the tracks", file=sys.stderr)
        figure = _figure(cable, dataset, validation, engines[1], result)
        write_bytes(run.path / TRACKS_FILE, png_bytes(figure))
        values = params_file(result, cable.length, None if servo is None else servo.model)
        values = {"cable": cable.name, "dataset_fingerprint": dataset.fingerprint} | values
        write_json(run.path / PARAMS_FILE, values)
        run.finish(
            values
            | {"servo_fit": _servo_metrics(servo)}
            | {
                "history": [
                    {"stage": stage, "best_pct": best, "spread_pct": spread}
                    for stage, best, spread in (
                        (s, 100 * b / cable.length, 100 * d / cable.length)
                        for s, b, d in result.history
                    )
                ]
            }
        )


def find_tune_data(folder: pathlib.Path | None, cable: "Cable | None") -> pathlib.Path:
    """The dataset that was named, or the one that `cablecast collect` writes by default.

    Raises:
        DatasetError: Neither was named and there is none; says how to make one.
    """
    from cablecast.errors import DatasetError

    if folder is not None:
        return folder
    name = cable.name if cable else DEFAULT_CABLE
    folder = cable_folder(name) / DATA_FOLDERS["tune"]
    if not folder.is_dir():
        raise DatasetError(
            f"no casts of {name} to tune with in {folder}: make them with `cablecast collect "
            f"--purpose tune --cable {name}`, or name them with --dataset"
        )
    return folder


@contextlib.contextmanager
def search_progress(label: str) -> "Iterator[Callable[[TuneProgress], None]]":
    """A callback that shows how a search stands, on standard error.

    Args:
        label: What is being tuned.
    """
    import datetime

    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    from cablecast.datasets.progress import duration_text

    def phrase(state: "TuneProgress") -> str:
        end = datetime.datetime.now() + datetime.timedelta(seconds=state.seconds_left)
        return (
            f"{state.stage}, best {state.best_pct:.2f} %, spread {state.spread_pct:.2f} %, "
            f"about {duration_text(state.seconds_left)} to go, until {end:%H:%M}"
        )

    console = Console(stderr=True)
    if not console.is_terminal:

        def show_line(state: "TuneProgress") -> None:
            done, total = state.generation, state.generation_count
            if done == 1 or done % _SHOW_EVERY == 0 or done == total:
                line = f"{label}: generation {done} of {total}, {phrase(state)}"
                print(line, file=console.file, flush=True)

        yield show_line
        return
    with Progress(
        TextColumn(label), BarColumn(), TextColumn("{task.fields[state]}"), console=console
    ) as bar:
        task = bar.add_task(label, total=None, state="")
        yield lambda state: bar.update(
            task, completed=state.generation, total=state.generation_count, state=phrase(state)
        )


def _servo_metrics(servo: "ServoFit | None") -> dict[str, Any] | None:
    if servo is None:
        return None
    return {
        "commanded_rms_m": servo.commanded_rms,
        "model_rms_m": servo.model_rms,
        "trial_count": servo.trial_count,
        "lag_s": servo.model.lag.tolist(),
    }


def _figure(
    cable: "Cable",
    dataset: "Dataset",
    validation: "MeasuredTracks",
    engine: Any,
    result: "TuneResult",
):
    import numpy as np

    from cablecast.cable import CableParams
    from cablecast.report.tracks import chosen_tracks, track_panels
    from cablecast.tuning.objective import TrackObjective

    both = CableParams.from_array(np.stack([cable.params.to_array(), result.params.to_array()]))
    xy, _ = TrackObjective(engine, cable, validation).tracks_of(both)
    return track_panels(
        validation,
        [("default parameters", xy[0, :, :-1]), ("tuned parameters", xy[1, :, :-1])],
        dataset.workspace,
        chosen_tracks(result.validation.mean[1]),
        cable.length,
    )


def print_table(metrics: dict[str, Any], cable_name: str) -> None:
    """Print our distances on the validation tracks beside the paper's.

    Args:
        metrics: What metrics.json holds.
        cable_name: Which of the paper's cables to compare with.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from cablecast.tuning.published import PUBLISHED_SIMULATION_COUNT, published_tuning

    validation = metrics["validation"]
    table = Table(
        title="Distance from simulated to measured endpoint, in % of cable length", box=box.SIMPLE
    )
    table.add_column("validation casts", no_wrap=True)
    for name in ("at rest, median", "q1", "q3", "on the way, mean", "simulations"):
        table.add_column(name, justify="right")
    published = published_tuning(cable_name)
    for row in ("default", "tuned"):
        values = validation[row]
        names = ("final_median_pct", "final_first_quartile_pct", "final_third_quartile_pct")
        cells = [
            "-" if values[name] is None else f"{values[name]:.1f}" for name in (*names, "mean_pct")
        ]
        count = f"{metrics['simulation_count']:,}" if row == "tuned" else ""
        table.add_row(f"{row} parameters", *cells, count, style="bold" if row == "tuned" else "")
    if published is not None:
        table.add_section()
        table.caption = "The paper's rows are PyBullet against a real UR5."
        for row, final, mean, count in (
            ("default", published.default_final_pct, published.default_mean_pct, ""),
            (
                "tuned",
                published.tuned_final_pct,
                published.tuned_mean_pct,
                f"about {PUBLISHED_SIMULATION_COUNT:,}",
            ),
        ):
            cells = (f"{final:.1f}", "", "", f"{mean:.1f}", count)
            table.add_row(f"paper: {row}", *cells, style="dim")
    console = Console()
    console.print(table)
    statuses = ", ".join(f"{count} {code}" for code, count in validation["trials"].items())
    coarse = metrics["coarse_simulation_count"]
    console.print(
        f"Validation casts: {statuses}; only ok has a resting point. {coarse:,} of the simulations "
        f"were coarse; the search took {metrics['seconds']:.0f} s.",
        highlight=False,
        soft_wrap=True,
    )
