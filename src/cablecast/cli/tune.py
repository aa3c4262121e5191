"""`cablecast tune`: fit the simulated cable to measured casts."""

import dataclasses
import pathlib
import typing
from typing import Annotated, Any

from cablecast.cli.options import Engine, SimulatorDevice, Workers, argument

if typing.TYPE_CHECKING:
    from cablecast.cable import CableParams


@dataclasses.dataclass(frozen=True, kw_only=True)
class Tune:
    """Fit the parameters of a cable to measured casts.

    Finds the parameters that bring the simulated endpoints nearest to the measured ones, and
    identifies from the same casts how the arm lags behind its set points. The default is a
    least-squares fit that starts from what the cable's file states: it takes seconds, two casts are
    enough, and it states the uncertainty of each parameter. `--method de` is the paper's
    Differential Evolution, which takes some minutes for 80 casts on two cores. The same
    command resumes an interrupted one of either kind. From 20 casts on, a quarter is held out to
    measure the result. Give the resulting params.json to `cablecast simulate --params`.
    """

    setup: Annotated[pathlib.Path | None, argument("FILE", "that of --dataset")] = None
    """Lab file that the casts must have been made with."""
    cable: Annotated[str | None, argument("CABLE", "that of --dataset, or cable_1")] = None
    """Cable of the casts: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    dataset: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/tune-data")] = None
    """Folder that `cablecast collect` wrote."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/tune")] = None
    """Folder of the results."""
    seed: int = 0
    """Seed of the search."""
    method: typing.Literal["least-squares", "de"] = "least-squares"
    """Least squares with a prior or Differential Evolution as in the paper."""
    population_size: int = 10
    """Candidates of a generation (de)."""
    generations: int = 200
    """Largest number of generations (de)."""
    validation_count: Annotated[
        int | None, argument("INT", "a quarter; 0 of fewer than 20 casts by least squares")
    ] = None
    """Number of held-out casts; the paper held out 20 of 80."""
    path: typing.Literal["auto", "commanded", "measured"] = "auto"
    """Motion of the gripper to simulate: the commanded or the measured one; auto takes the measured
    one if the rig reported it."""
    engine: Engine = "warp"
    device: SimulatorDevice = "cpu"
    workers: Workers = "local"
    segment_count: Annotated[int | None, argument("INT", "the engine's")] = None
    """Segments of the simulated cable."""
    dt: Annotated[float | None, argument("S", "the engine's")] = None
    """Time step of the simulation [s]."""

    def run(self) -> None:
        """Tune, and print the table of distances."""
        from cablecast.cli.options import check_same_setup, load_lab, picked
        from cablecast.cli.progress import console_progress
        from cablecast.data.dataset import read_dataset
        from cablecast.pipeline.tune import TRACKS_FILE, tune
        from cablecast.runs.places import TUNE_FOLDER, cable_folder, find_input
        from cablecast.tuning.fit import FitConfig
        from cablecast.tuning.tune import TuneConfig
        from cablecast.tuning.tuned import PARAMS_FILE

        folder = find_input("tune", self.dataset, load_lab(self.setup, self.cable).cable.name)
        casts = read_dataset(folder)
        check_same_setup(self.setup, self.cable, casts.setup, folder)
        # Made whatever the method: a number that no method can have is refused, not ignored.
        config: FitConfig | TuneConfig = TuneConfig(
            population_size=self.population_size, generations=self.generations, seed=self.seed
        )
        if self.method == "least-squares":
            config = FitConfig(seed=self.seed)
        out = self.out or cable_folder(casts.cable.name) / TUNE_FOLDER
        options = picked(self, "validation_count", "path", "segment_count", "dt")
        options |= picked(self, "engine", "device", "workers")
        with console_progress() as progress:
            tuned = tune(casts, config=config, **options, out=out, progress=progress)
        print_table(tuned.metrics, casts.cable.name)
        for line in tuned.metrics["open"]:
            print(f"note: {line}")
        if self.method == "least-squares" or tuned.params.has_material:
            print(f"note: {material_words(tuned.params, casts.cable.length)}")
        print(f"parameters  {out / PARAMS_FILE}\ntracks      {out / TRACKS_FILE}")


def material_words(params: "CableParams", length: float) -> str:
    """Return what a fitted cable of some length [m] has besides the ten parameters, in words."""
    from cablecast.cable import ROD_ARM

    if not params.has_material:
        return "the casts are likelier without a material besides the ten parameters"
    words = []
    if params.drag_coefficient:
        words.append(f"a drag coefficient of {params.drag_coefficient:.2g}")
    if params.damping_time:
        words.append(f"a damping time of {1e3 * params.damping_time:.2g} ms")
    if params.rest_curvature:
        words.append(f"a curl of {params.rest_curvature * length:.2g} rad over the cable")
    if params.friction_ratio != 1.0:
        words.append(f"friction along it {params.friction_ratio:.2f} times that across")
    if params.yield_curvature:
        words.append(f"bends that stay if they are sharper than {params.yield_curvature:.2g} 1/m")
    if params.grip_compliance:
        words.append(f"a grip that gives by {params.grip_compliance:.2g} rad/(N·m)")
    if params.attachment_friction_ratio != 1.0:
        ratio = params.attachment_friction_ratio
        words.append(f"an attachment with {ratio:.2f} times its friction")
    if params.drag_ratio:
        words.append(f"drag along it {params.drag_ratio:.2f} times that across")
    if params.attachment_arm:
        words.append(f"an attachment of {1e3 * params.attachment_arm / ROD_ARM:.0f} mm")
    return f"besides the ten parameters, the cable has {', '.join(words)}"


def print_table(metrics: dict[str, Any], cable_name: str) -> None:
    """Print the distances on the validation tracks next to the paper's for a cable of this name."""
    from cablecast.cli import tables
    from cablecast.evaluation.published import published_tuning
    from cablecast.report.tables import pct

    validation = metrics["validation"]
    kind = "validation" if metrics["held_out_count"] else "fitted"
    title = "Distance from simulated to measured endpoint, in % of cable length"
    heads = ("at rest, median", "q1", "q3", "on the way, mean", "simulations")
    table = tables.make_table(title, f"{kind} casts", *heads)
    published = published_tuning(cable_name)
    for row in ("default", "tuned"):
        values = validation[row]
        names = ("final_median_pct", "final_first_quartile_pct", "final_third_quartile_pct")
        cells = [pct(values[name]) for name in (*names, "mean_pct")]
        count = f"{metrics['simulation_count']:,}" if row == "tuned" else ""
        table.add_row(f"{row} parameters", *cells, count, style="bold" if row == "tuned" else "")
    if published is not None:
        table.add_section()
        table.caption = "The paper's rows are PyBullet against a real UR5."
        for row, final, mean in (
            ("default", published.default_final_pct, published.default_mean_pct),
            ("tuned", published.tuned_final_pct, published.tuned_mean_pct),
        ):
            cells = (pct(final), "", "", pct(mean), "")
            table.add_row(f"paper: {row}", *cells, style="dim")
    statuses = ", ".join(f"{count} {code}" for code, count in validation["trials"].items())
    coarse = metrics["coarse_simulation_count"]
    tables.print_table(
        table,
        f"{kind.capitalize()} casts: {statuses}; only ok has a resting point. {coarse:,} of the "
        f"simulations were coarse; it took {metrics['seconds']:.0f} s.",
    )
