"""`cablecast aim`: a few casts to know the cable, then casts at targets until they hit."""

import dataclasses
import math
import pathlib
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cablecast.cli.options import Device, argument
from cablecast.errors import InputError

if TYPE_CHECKING:
    from cablecast.pipeline.aim import AimResult
    from cablecast.pipeline.aim_casts import AimProposal, AimTrial
    from cablecast.pipeline.aim_session import AimSession

EXIT_MISSED = 3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Aim:
    """Cast at targets, look, correct, and cast again until they are hit.

    The first time, the rig makes five casts, the simulator is fitted to them, and a model learns
    from simulated casts; that takes a few minutes on two cores, less with --model. Then each target
    is aimed at. Before each cast the command says where it expects the free end to land and how
    surely, after it where it landed and what changes. Once there are many more casts than the
    simulator was fitted to, it is fitted to all of them before the next target. Every cast is kept
    in --out and teaches: give further targets with the same command. An interrupted one goes on
    where it stopped. The exit status is 3 if a target was missed by all tries.
    """

    target: Annotated[
        tuple[tuple[float, float], ...], tyro.conf.UseAppendAction, argument("R THETA")
    ]
    """Target: distance from the robot's base [m], and angle from straight ahead [deg], positive to
    the robot's right. Give it again for more targets, one after another."""
    rig: Annotated[str, argument("RIG")] = "virtual"
    """Rig that makes the casts: virtual (a laboratory in software), ur (an arm), engine (the
    simulator), or your own robot as package.module:factory."""
    within: Annotated[float, argument("PCT")] = 3.0
    """Distance from the target at which a cast has hit, in % of cable length."""
    tries: int = 6
    """Casts at one target at most."""
    setup: Annotated[pathlib.Path | None, argument("FILE", "the paper's set-up")] = None
    """Lab file that describes cable, table, arm and motion."""
    cable: Annotated[str | None, argument("CABLE", "that of --setup, or cable_1")] = None
    """Cable in the gripper: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    casts: Annotated[pathlib.Path | None, argument("DIR", "made on the rig")] = None
    """Casts of this cable that `cablecast collect` recorded; with them the rig makes none to begin
    with."""
    params: Annotated[pathlib.Path | None, argument("FILE", "fitted to the casts")] = None
    """Cable parameters and servo lag that `cablecast tune` found (params.json, or its folder); with
    them and no --casts the rig makes no casts to begin with."""
    refit: bool = True
    """Fit the simulator to all casts, and learn anew from it, before a target where it is worth it:
    at three times as many casts as it was fitted to, or at twice as many if first tries land
    farther off than was stated. Takes minutes; --no-refit keeps the model."""
    fit_all: bool = False
    """Do so now. The same folder goes on with the newest fit from then on."""
    calibration_count: int = 5
    """Casts that the rig makes to begin with. With 0 it aims at once with the believed cable, and
    the simulator is fitted to the first casts."""
    count: int = 16_000
    """Number of simulated casts that the model learns from."""
    candidate_count: int = 20_000
    """Number of motions to choose from."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/aim")] = None
    """Folder of all casts and results."""
    seed: int = 0
    """Seed of all random numbers."""
    device: Device = "cpu"
    """Simulate and train on the processor or on an NVIDIA graphics card."""
    time_limit: Annotated[float, argument("S")] = 120.0
    """Time limit of a reset or a cast [s]."""

    def run(self) -> int:
        """Aim, and print every cast; return the exit status."""
        from cablecast.cli.options import load_lab, open_rig
        from cablecast.cli.progress import console_progress
        from cablecast.data.dataset import read_dataset
        from cablecast.errors import check_count, check_number
        from cablecast.pipeline.aim import aim, prepare_aim
        from cablecast.runs.places import AIM_FOLDER, cable_folder
        from cablecast.tuning.tuned import load_tuned

        if not self.target:
            raise InputError("aim needs at least one --target R THETA")
        check_number("within", self.within, 0.01, 100.0, "%")
        check_count("tries", self.tries, 1, 1000)
        setup = load_lab(self.setup, self.cable)
        out = self.out or cable_folder(setup.cable.name) / AIM_FOLDER
        targets = setup.workspace.check_targets(
            r=[r for r, _ in self.target],
            theta_deg=[theta_deg for _, theta_deg in self.target],
            cable_length=setup.cable.length,
        )
        casts = None if self.casts is None else read_dataset(self.casts)
        tuned = None if self.params is None else load_tuned(self.params, setup)
        with open_rig(self.rig, setup, self.seed, out, self.time_limit) as rig:
            with console_progress() as progress:
                session = prepare_aim(
                    rig,
                    casts=casts,
                    tuned=tuned,
                    fit_all=self.fit_all,
                    calibration_count=self.calibration_count,
                    count=self.count,
                    candidate_count=self.candidate_count,
                    within_pct=self.within,
                    tries=self.tries,
                    seed=self.seed,
                    device=self.device,
                    out=out,
                    progress=progress,
                )
            known, fitted = len(session.history), session.fitted_count
            name = setup.cable.name
            if known:
                print(f"{known} casts of {name} are known; the simulator is fitted to {fitted}")
            else:
                print(f"no cast of {name} is known yet: the simulator has the believed values")
            result = aim(
                session,
                rig,
                targets,
                refit=self.refit,
                on_proposal=print_proposal,
                on_trial=print_trial,
                on_refit=refit_and_say,
            )
        print_result(result)
        return 0 if result.hit.all() else EXIT_MISSED


def refit_and_say(session: "AimSession", reason: str) -> None:
    """Say why a new fit is due, and make it."""
    from cablecast.cli.progress import console_progress

    print(f"\nnew fit   {reason} (--no-refit keeps the model)", flush=True)
    with console_progress() as progress:
        session.refit(progress)
    print(f"          the simulator is fitted to {session.fitted_count} casts now")


def print_proposal(proposal: "AimProposal") -> None:
    """Say what a cast is expected to do."""
    from cablecast.cli.options import polar_text

    if proposal.try_number == 1:
        print(f"\ntarget    {polar_text(proposal.target_xy)}")
        if not proposal.inside_coverage:
            print("note: no simulated cast of this cable lands near this target")
    major, minor, angle = proposal.ellipse(0.9)
    scale = 100.0 / proposal.cable_length
    print(f"try {proposal.try_number}     {proposal.reason}")
    print(f"  expect  {polar_text(proposal.expected_xy)}")
    print(
        f"          within {scale * major:.1f} by {scale * minor:.1f} % of the cable's length "
        f"(nine of ten casts; the longer axis {math.degrees(angle) % 180:.0f} deg from x)"
    )
    if proposal.failure > 0.1:
        print(f"          {100 * proposal.failure:.0f} % chance that it is hidden or off the table")


def print_trial(proposal: "AimProposal", trial: "AimTrial") -> None:
    """Say what a cast did, and what that changes."""
    from cablecast.cli.options import polar_text

    del proposal
    if math.isfinite(trial.miss_pct):
        print(f"  saw     {polar_text(trial.final_xy)}")
        verdict = "hit" if trial.hit else "missed"
        print(f"          {verdict}: {trial.miss_pct:.1f} % of the cable's length off")
    else:
        print(f"  saw     {trial.status.code}: {trial.status.value}")
    print(f"  learned {trial.change}")


def print_result(result: "AimResult") -> None:
    """Print one line per target."""
    from cablecast.cli import tables
    from cablecast.conventions import xy_to_polar

    table: Any = tables.make_table("Miss of each try, in % of cable length")
    table.add_column("target", no_wrap=True)
    tries = max((len(trials) for trials in result.trials), default=0)
    for number in range(1, tries + 1):
        table.add_column(str(number), justify="right")
    for target, trials in zip(result.target_xy, result.trials, strict=True):
        r, theta = xy_to_polar(target)
        cells = [
            f"{trial.miss_pct:.1f}" if math.isfinite(trial.miss_pct) else trial.status.code
            for trial in trials
        ]
        cells += [""] * (tries - len(cells))
        style = "bold" if any(trial.hit for trial in trials) else ""
        table.add_row(f"r = {r:.2f} m, theta = {math.degrees(theta):.1f} deg", *cells, style=style)
    tables.print_table(table, f"{int(result.hit.sum())} of {len(result.trials)} targets were hit.")
