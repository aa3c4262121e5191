"""`cablecast aim`: a few casts to know the cable, then casts at targets until they hit."""

import dataclasses
import os
import pathlib
import shlex
import warnings
from typing import TYPE_CHECKING, Annotated

from cablecast.aiming.config import AimConfig
from cablecast.cli.evaluate import print_table
from cablecast.cli.options import (
    EXIT_FALLS_SHORT,
    AnyTargetOptions,
    CableName,
    LabFile,
    RigName,
    TaskName,
    TimeLimit,
    WithPolar,
    argument,
    casts_text,
    load_lab,
    open_rig,
    paper_targets,
    polar_text,
)
from cablecast.errors import InputError
from cablecast.evaluation.published import published_rows
from cablecast.runs.places import AIM_FOLDER, cable_folder

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cablecast.report.aim_page import Beyond
    from cablecast.setup import Setup

# From so many targets on, a table of medians says more than one of targets.
_MANY_TARGETS = 12

# A tolerance below this is rather meant as a part of the whole [% of cable length].
_WITHIN_PCT_SMALL = 0.5

# Settings that decide the model of a session, which the page needs as well.
_MODEL_OPTIONS = ("calibration_count", "simulated_count", "epochs", "candidate_count")
_MODEL_OPTIONS += ("fast", "polar", "seed", "device")


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Targets(AnyTargetOptions):
    paper_targets: bool = False
    """Aim at the paper's 32 targets, and compare its errors with those of the last tries."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Aim(AimConfig, _Targets):
    """Cast at targets, look, correct, and cast again until they are hit.

    The first time, the rig makes five casts, the simulator is fitted to them, and a model learns
    from simulated casts; that takes a minute or two of computing. Three polar casts follow, which
    correct later ones. Then each target is aimed at. Before each cast the command says how likely
    it is to hit, and how far from the target it may land; after it, where it landed and what
    changes. Once there are many more casts than the simulator was fitted to, it is fitted to all of
    them before the next target. Every cast is kept in --out: give further targets with the same
    command. An interrupted one goes on where it stopped. It ends with a report of the tries. The
    exit status is 3 if a target was not hit: missed by all tries, given up, or not cast at.

    With --task strike the cable hangs from a stick, and is swung so that its free end passes a
    point in the air; no swing is made before the first target.
    """

    task: TaskName = None
    rig: RigName = "virtual"
    setup: LabFile = None
    cable: CableName = None
    refit: Annotated[
        bool,
        argument(
            "",
            "fit anew where it is worth it",
            "Keep the fit. Otherwise the simulator is fitted to all casts before a target at three "
            "times as many casts as it was fitted to, or at twice as many if first tries land "
            "farther off than was stated.",
        ),
    ] = True
    polar: WithPolar = True
    casts: Annotated[pathlib.Path | None, argument("DIR", "made on the rig")] = None
    """Casts of this cable that `cablecast collect` recorded; with them the rig makes none before
    the first target."""
    params: Annotated[pathlib.Path | None, argument("FILE", "fitted to the casts")] = None
    """Cable parameters and servo lag that `cablecast tune` found (params.json, or its folder); with
    them and no --casts the rig makes no casts before the first target."""
    fit_all: bool = False
    """Refit to all casts before aiming. The folder goes on with the newest fit from then on."""
    out: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/aim")] = None
    """Folder of all casts and results."""
    time_limit: TimeLimit = 120.0

    def run(self) -> int:
        """Aim, and print every cast; return the exit status."""
        # As for the page: a second thread for small matrices mostly waits.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        setup = load_lab(self.setup, self.cable, self.task)
        if setup.strike is not None:
            from cablecast.cli.strike import aim_strike

            status = aim_strike(self, setup)
            print(f"next      {_view_command(self)}")
            print("          shows these swings and makes more")
            return status
        from cablecast.cli.progress import console_progress
        from cablecast.cli.tries import TableTries, print_folder, print_medians
        from cablecast.data.dataset import read_dataset
        from cablecast.pipeline.aim import (
            REPORT_FILE,
            REPORT_FOLDER,
            SESSION_FOLDER,
            TRIES_FILE,
            check_aim,
            compile_for_fits,
            prepare_aim,
            write_aim_report,
        )
        from cablecast.rigs.make import check_rig
        from cablecast.tuning.tuned import load_tuned

        if bool(self.target or self.target_xy) == self.paper_targets:
            raise InputError(
                "aim needs either --target R THETA or --target-xy X Y, once or more, or "
                "--paper-targets"
            )
        out = self.out or cable_folder(setup.cable.name) / AIM_FOLDER
        targets = paper_targets(setup) if self.paper_targets else self.targets(setup)
        # The paper's errors are those of all its targets.
        config = dataclasses.replace(AimConfig.of(self), force=self.force or self.paper_targets)
        check_rig(self.rig, setup)
        check_aim(config, out)
        if self.within_pct < _WITHIN_PCT_SMALL:
            warnings.warn(_small_text(self.within_pct, setup), stacklevel=1)
        # While it is simulated which targets are within reach.
        compile_for_fits()
        # What is fitted to casts tells more than what is believed of the cable.
        known_fit = self.params is not None or (out / SESSION_FOLDER).exists()
        targets, beyond = _within_reach(setup, targets, force=config.force or known_fit)
        if not len(targets):
            return EXIT_FALLS_SHORT
        casts = None if self.casts is None else read_dataset(self.casts)
        tuned = None if self.params is None else load_tuned(self.params, setup)
        with open_rig(self.rig, setup, self.seed, out, self.time_limit) as rig:
            with console_progress() as progress:
                session = prepare_aim(
                    rig,
                    config,
                    casts=casts,
                    tuned=tuned,
                    fit_all=self.fit_all,
                    out=out,
                    progress=progress,
                )
            known, name = len(session.active_casts()), setup.cable.name
            if known:
                count = session.fitted_count
                print(f"{casts_text(known, name)} known; the simulator is fitted to {count}")
            else:
                values = "believed" if session.model.fitted_to is None else "fitted"
                print(f"no cast of {name} is known yet: the simulator has the {values} values")
            tries = TableTries(session)
            result = tries.cast_at(rig, targets)
            evaluation = None
            if any(result.casts):
                evaluation = write_aim_report(result, rig, out / REPORT_FOLDER, beyond)
        if len(targets) < _MANY_TARGETS:
            tries.print_result(result, len(beyond))
        else:
            print_medians(result, len(beyond))
        if self.paper_targets and evaluation is not None:
            print_table(evaluation.metrics, published_rows(name))
        for xy, why in beyond:
            print(_beyond_line(xy, why))
        print_folder(out, () if evaluation is None else (TRIES_FILE, REPORT_FILE))
        print(f"next      {_view_command(self)}")
        print("          shows these casts and makes more; the same command with another --target")
        print("          goes on with all that they tell of the cable")
        return 0 if result.hit.all() and not beyond else EXIT_FALLS_SHORT


def _small_text(within_pct: float, setup: "Setup") -> str:
    """Return what a small tolerance [% of cable length] says."""
    return (
        f"--within-pct {within_pct:g} is {within_pct:g} % of the cable's length, "
        f"{10 * within_pct * setup.cable.length:.1f} mm: for "
        f"{100 * within_pct:g} % give --within-pct {100 * within_pct:g}"
    )


def _view_command(options: Aim) -> str:
    """Return the command that opens the page on the casts and the model of a session."""
    same = {name: getattr(options, name) for name in ("task", "rig", "setup", "cable", "out")}
    same |= {
        field.name: value
        for field in dataclasses.fields(AimConfig)
        if field.name in _MODEL_OPTIONS and (value := getattr(options, field.name)) != field.default
    }
    given = "".join(
        f" --{'no-' * (value is False)}{name.replace('_', '-')}"
        + f" {shlex.quote(str(value))}" * (not isinstance(value, bool))
        for name, value in same.items()
        if value is not None
    )
    return f"cablecast view{given}"


def _within_reach(
    setup: "Setup", targets: "NDArray[np.float64]", *, force: bool
) -> "tuple[NDArray[np.float64], list[Beyond]]":
    """Return the targets to cast at, and the others, which no believed cable reaches."""
    import numpy as np

    from cablecast.cli.progress import console_progress
    from cablecast.pipeline.check import check, remedy

    if force:
        return targets, []
    found = check(setup, changes=False)
    if found.swing_words:
        print(f"the swing: {found.swing_words}", flush=True)
    is_beyond = [found.is_out_of_reach(target) for target in targets]
    beyond = [(target, found.words_at(target)) for target in targets[is_beyond]]
    for xy, why in beyond:
        print(_beyond_line(xy, why), flush=True)
    for xy in targets[np.logical_not(is_beyond)]:
        if words := found.doubt_words_at(xy):
            print(f"{polar_text(xy)}: {words}", flush=True)
    if all(is_beyond):
        with console_progress() as progress:
            changes = check(setup, progress=progress).changes
        print(f"no target is within reach. {remedy(changes)}")
    return targets[np.logical_not(is_beyond)], beyond


def _beyond_line(xy: "NDArray[np.float64]", why: str) -> str:
    return f"{polar_text(xy)}: out of reach: {why} (--force casts all the same)"
