"""aim: from a cable never seen to casts that hit their targets."""

import contextlib
import dataclasses
import functools
import math
import os
import pathlib
import re
import tempfile
import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.aiming.config import AimConfig
from cablecast.aiming.predictor import SPREAD_COUNT, Beliefs
from cablecast.aiming.session import (
    AimSession,
    CastSession,
    RefitDue,
    Stop,
)
from cablecast.cast import Cast, Proposal
from cablecast.data.dataset import Dataset, read_dataset
from cablecast.data.store import CastStore
from cablecast.engines import make_engine
from cablecast.errors import CablecastError, InputError, check_argument_types
from cablecast.evaluation.evaluate import (
    Evaluation,
    evaluation_metrics,
    save_trials,
    summarise_errors,
)
from cablecast.files import write_bytes, write_text
from cablecast.learning.checkpoint import check_device, import_torch
from cablecast.learning.policy import COVERAGE_PCT, ForwardSearchPolicy
from cablecast.motion.feasibility import feasible_actions, feasible_ranges
from cablecast.pipeline.collect import collect
from cablecast.pipeline.evaluate import REPORT_FILE, TRIALS_FILE
from cablecast.pipeline.places import require
from cablecast.pipeline.simulate import simulate_to_aim
from cablecast.pipeline.train import train
from cablecast.pipeline.tune import tune
from cablecast.report.aim_page import Beyond, Tried, aim_page
from cablecast.report.style import png_bytes
from cablecast.report.words import refit_text
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.folder import (
    METRICS_FILE,
    Parts,
    RunFolder,
    hold_folder,
    plain_settings,
    run_facts,
    settings_differences,
)
from cablecast.runs.places import CALIBRATION_FOLDER, DATASET_FOLDER, MODEL_FOLDER, TUNE_FOLDER
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, show
from cablecast.setup import Setup
from cablecast.tuning.fit import FitConfig
from cablecast.tuning.tuned import PARAMS_FILE, Tuned, load_tuned, write_params

SESSION_FOLDER = "session"
PRIOR_FILE = "prior.npz"
"""Simulated swings of believed cables, in the folder of a session of strikes."""
FITS_FOLDER = "fits"
"""A later fit lies in `fits/NNNNN-MMMMM`: the session had NNNNN casts then, and MMMMM of them were
discarded. The newest that is finished is the one that the session goes on with."""
REPORT_FOLDER = "report"
HIDDEN_WIDTH = 128
"""Units of each hidden layer of the network. It finds candidates, and tells what a small change of
an action does; where they land is simulated. So it may be smaller than that of the paper."""
TRIES_FILE = "tries.png"

RIG_PART = "rig"
"""Part of a session's folder, a JSON file, that describes the rig on which it casts."""

_OWN = {
    f"{RIG_PART}.json",
    *(CALIBRATION_FOLDER, TUNE_FOLDER, DATASET_FOLDER, MODEL_FOLDER),
    *(SESSION_FOLDER, FITS_FOLDER, REPORT_FOLDER, PRIOR_FILE),
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class SimulatorConfig:
    """Settings of the simulators of a session; those of the verbs if None.

    Attributes:
        fit: Settings of the fit.
        segment_count: Segments of the simulated cable.
        dt: Time step [s].
        spread_count: Casts that tell how far apart the simulators of an ensemble typically land.
    """

    fit: FitConfig | None = None
    segment_count: int | None = None
    dt: float | None = None
    spread_count: int = SPREAD_COUNT


@dataclasses.dataclass(frozen=True, kw_only=True)
class AimResult:
    """Casts at some targets.

    Attributes:
        session: Session, which further targets can be aimed at in.
        target_xy: Targets [m], shape [target, 2], or [target, 3] in the air.
        casts: Casts at each target, in order.
        stops: Why no further cast was made at each target; None if it was hit, or if all tries were
            used.
    """

    session: CastSession
    target_xy: NDArray[np.float64]
    casts: tuple[tuple[Cast, ...], ...]
    stops: tuple[Stop | None, ...]

    @property
    def hit(self) -> NDArray[np.bool_]:
        """True for each target that was hit, shape [target]."""
        return np.array([any(cast.hit for cast in casts) for casts in self.casts])

    def misses_pct(self, try_number: int) -> NDArray[np.float64]:
        """Return the miss of one try at each target [% of cable length], shape [target].

        A target that was hit before keeps the miss of that cast. A cast without a landing is NaN.
        Tries count from 1.
        """
        return np.array(
            [
                casts[min(try_number, len(casts)) - 1].miss_pct if casts else math.nan
                for casts in self.casts
            ]
        )

    @property
    def try_rows(self) -> list[dict[str, Any]]:
        """Errors after each try, casts without a landing counted as misses; a row for each try."""
        rows = []
        for number in range(1, max((len(casts) for casts in self.casts), default=0) + 1):
            misses = self.misses_pct(number)
            row = summarise_errors(np.nan_to_num(misses, nan=np.inf)).to_dict()
            rows.append({"try": number, "without_landing": int(np.isnan(misses).sum()), **row})
        return rows

    @property
    def metrics(self) -> dict[str, Any]:
        """The tries, targets and hits as plain values."""
        return {
            "tries": self.try_rows,
            "cast_count": len(self.session.casts),
            "targets": self.target_xy.tolist(),
            "hit": self.hit.tolist(),
        }

    def report_run(self, folder: pathlib.Path, rig: CheckedRig, **settings: Any) -> RunFolder:
        """Return the run that writes a report of these casts on a rig, made with some settings."""
        require("the report of aim", "matplotlib", "jinja2")
        every = {
            **self.session.setup.to_settings(),
            "rig": dict(rig.description),
            **settings,
            **dataclasses.asdict(self.session.config),
        }
        config = {"command": "aim", "settings": plain_settings(every), **run_facts()}
        return RunFolder(path=folder, config=config)


def check_aim(config: AimConfig, folder: str | os.PathLike[str]) -> None:
    """Raise the errors of aiming with a report that are known before its rig is connected.

    Raises:
        OSError: The folder cannot be written.
    """
    check_folder(pathlib.Path(folder))
    with hold_folder(pathlib.Path(folder), InputError), tempfile.TemporaryFile(dir=folder):
        pass
    _check_machine(config, "matplotlib", "jinja2")


def check_folder(path: pathlib.Path) -> None:
    """Check that a folder holds nothing but what aiming made."""
    if path.exists() and not path.is_dir():
        raise InputError(f"{path} is a file: aiming needs a folder")
    names = [f.name for f in path.iterdir() if f.name[0] != "."] if path.exists() else []
    if other := sorted(set(names) - _OWN):
        raise InputError(f"{path} holds {other[0]}, which aiming did not make: give a new folder")


def _check_machine(config: AimConfig, *modules: str) -> None:
    """Check that the libraries and the device are here."""
    require("aiming", "torch", "safetensors", *modules)
    make_engine("warp", device=config.device)
    check_device(config.device)


@check_argument_types
def prepare_aim(
    rig: CheckedRig,
    config: AimConfig | None = None,
    *,
    casts: Dataset | None = None,
    tuned: Tuned | None = None,
    fit_all: bool = False,
    simulators: SimulatorConfig | None = None,
    out: str | os.PathLike[str] | None = None,
    progress: ProgressCallback = show,
) -> AimSession:
    """Make a few casts, fit the simulator to them, learn from it, and open a session.

    A folder whose session began with given casts, a given fit, or none of them goes on so without
    these.

    Args:
        rig: Rig that `make_rig` returned; gives the set-up.
        config: Settings.
        casts: Casts on the rig that were made before; some are made if None.
        tuned: Result of `tune`, in place of a fit to the casts; without casts none are made then.
        fit_all: Fit the simulator anew now to all casts that the session in `out` has, and learn
            anew from it. Later calls for the same folder go on with the newest such fit.
        simulators: Settings of the simulators.
        out: Folder that keeps everything and lets stopped work go on; none if None.
        progress: Told how far each step is.

    Raises:
        InputError: A value is out of bounds, the device is not here, or the folder holds something
            else.
        RigError: A cast failed too often.
        MissingExtraError: A library that a later step needs is missing.
    """
    config, simulators = config or AimConfig(), simulators or SimulatorConfig()
    folder = None if out is None else pathlib.Path(out)
    # Before any cast.
    _check_machine(config, *(() if folder is None else ("matplotlib",)))
    if folder is not None:
        keep_rig(folder, rig)
    learning = _Learning(rig.setup, config, simulators, folder)
    session_folder = None if folder is None else folder / SESSION_FOLDER
    store = CastStore(rig.setup, session_folder)
    calibrates = False
    if casts is not None and fit_all:
        store.add_dataset(casts)
    model = _later_model(learning, store, fit_all, progress)
    if folder is not None and casts is None and tuned is None and _began_otherwise(folder):
        tuned = _kept_fit(folder, rig.setup)
    elif tuned is not None:
        _keep_fit(folder, tuned)
    elif model is None and casts is None and config.calibration_count:
        calibrates = True
        casts = _calibration_casts(rig, config, folder, progress)
    elif model is None and casts is None and folder and (folder / CALIBRATION_FOLDER).exists():
        raise InputError(
            f"{folder} began with calibration casts, and goes on with them: give their number "
            "(--calibration-count), or another folder (--out)"
        )
    session = AimSession(
        model or learning.first(casts, tuned, progress),
        casts=casts,
        out=store,
        config=config,
        refitting=learning,
    )
    session.look(rig)
    if calibrates and all(cast.proposal is None for cast in session.casts):
        session.pilot(rig, progress)
    return session


def keep_rig(folder: pathlib.Path, rig: CheckedRig) -> None:
    """Record whose casts a folder holds, to refuse another rig, and what aiming did not make."""
    check_folder(folder)
    parts, here = Parts(folder), plain_settings({"rig": dict(rig.description)})
    there = parts.get(RIG_PART)
    if there is None:
        parts.put(RIG_PART, here)
    elif differences := settings_differences(there, here):
        raise InputError(
            f"{folder} holds casts of another rig: {'; '.join(differences)}. Give another folder "
            "(--out)"
        )


def _began_otherwise(folder: pathlib.Path) -> bool:
    """Return whether a session began without calibration casts: it goes on without them."""
    return not (folder / CALIBRATION_FOLDER).exists() and any(
        (folder / name).exists() for name in (TUNE_FOLDER, DATASET_FOLDER)
    )


def _keep_fit(folder: pathlib.Path | None, tuned: Tuned) -> None:
    """Copy a given fit into the folder of the session."""
    file = folder and folder / TUNE_FOLDER / PARAMS_FILE
    if file is not None and not file.exists():
        write_params(file, tuned.to_dict())


def _kept_fit(folder: pathlib.Path, setup: Setup) -> Tuned | None:
    """Return the fit that a session began with; None for the believed cable."""
    if not (folder / TUNE_FOLDER).exists():
        return None
    if not (folder / TUNE_FOLDER / PARAMS_FILE).is_file():
        raise InputError(
            f"{folder} was stopped before the fit that it began with was kept: give the same casts "
            "or the same fit again"
        )
    return load_tuned(folder / TUNE_FOLDER, setup)


def _calibration_casts(
    rig: CheckedRig,
    config: AimConfig,
    folder: pathlib.Path | None,
    progress: ProgressCallback,
) -> Dataset:
    """Return the calibration casts."""
    count = config.calibration_count
    path = folder and folder / CALIBRATION_FOLDER
    task = f"1/4 {count} casts to fit to"
    if path is not None and (path / METRICS_FILE).exists():
        # Choosing their actions anew would simulate thousands of casts.
        made = read_dataset(path)
        description = plain_settings({"rig": dict(rig.description)})["rig"]
        is_same = (len(made), made.settings.values["rig"]) == (count, description)
        if is_same and made.setup.to_settings() == rig.setup.to_settings():
            progress(Progress(task=task, note=DONE_NOTE))
            return made
    progress(Progress(task=task))
    compile_for_fits()
    threading.Thread(target=_get_ready, args=(rig.setup, config), daemon=True).start()
    return collect(
        rig,
        purpose="tune",
        count=count,
        sampling="spread",
        seed=config.seed,
        pace=config.pace,
        out=path,
        progress=progress,
    )


@functools.cache
def compile_for_fits() -> None:
    """Start, once in a process, to compile the kernel that simulates the materials of a fit."""
    from cablecast.engines.warp_.rollout import compile_ahead
    from cablecast.engines.warp_.world import Features

    compile_ahead(Features(remembers=True, surface=True))


def _get_ready(setup: Setup, config: AimConfig) -> None:
    """Prepare, during the first casts, what does not depend on them.

    What fails here fails again where it is needed.
    """
    with contextlib.suppress(CablecastError, ImportError):
        import_torch("aiming")
        import matplotlib.figure  # noqa: F401

        # Those of the model keep to no robot's box yet.
        bare = Setup.from_dict(setup.to_settings())
        for count, one in ((config.simulated_count, setup), (config.candidate_count, bare)):
            ranges = feasible_ranges(one, pace=config.pace)
            feasible_actions(count, one, ranges, config.seed)


def _later_model(
    learning: "_Learning", store: CastStore, fit_all: bool, progress: ProgressCallback
) -> Beliefs | None:
    """Return the model of a fit to all casts of a session; None for the one to its first casts."""
    newest = learning.newest_fit()
    if newest is None and not fit_all:
        return None
    if learning.folder is None or not len(store):
        raise InputError("fitting to all casts needs the folder of a session that has some")
    if newest is not None and newest[0] > len(store):
        raise InputError(
            f"{learning.folder / FITS_FOLDER} has a fit to {newest[0]} casts, but the session has "
            f"{len(store)}"
        )
    if newest is None or fit_all:
        return learning(store, progress)
    return learning.kept(*newest, progress)


class _Learning:
    """Makes the models of a session: a fit, simulated casts, training."""

    def __init__(
        self,
        setup: Setup,
        config: AimConfig,
        simulators: SimulatorConfig,
        folder: pathlib.Path | None,
    ):
        self.setup, self.config, self.simulators, self.folder = setup, config, simulators, folder
        self._resolution = {"segment_count": simulators.segment_count, "dt": simulators.dt}

    def first(
        self, casts: Dataset | None, tuned: Tuned | None, progress: ProgressCallback
    ) -> Beliefs:
        """Return the first model of a session: of a fit to casts, of a given one, or believed."""
        if casts is not None and tuned is None:
            tuned = self.fit(casts, self.folder, progress)
        elif tuned is None:
            tuned = Tuned.believed(self.setup, self.config.seed)
        return self._model(tuned, self.folder, tuned.fitted_to, progress)

    def __call__(self, store: CastStore, progress: ProgressCallback) -> Beliefs:
        """Return the model of a later fit; see `Refitting`."""
        # A page may cast meanwhile.
        count, casts = len(store), store.dataset(store.sweeps)
        name = f"{count:05d}-{len(store.undone):05d}"
        # A fork keeps nothing.
        folder = store.folder and self.folder and self.folder / FITS_FOLDER / name
        tuned = self.fit(casts, folder, progress, validation_count=0)
        return self._model(tuned, folder, count, progress)

    def kept(self, count: int, folder: pathlib.Path, progress: ProgressCallback) -> Beliefs:
        """Return the model of a later fit to so many casts that is finished."""
        progress(Progress(task=f"2/4 fit to {count} casts", note=DONE_NOTE))
        tuned = load_tuned(folder / TUNE_FOLDER, self.setup)
        return self._model(tuned, folder, count, progress)

    def newest_fit(self) -> tuple[int, pathlib.Path] | None:
        """Return the number of casts and the folder of the newest finished later fit."""
        if self.folder is None:
            return None
        finished = f"{FITS_FOLDER}/*/{MODEL_FOLDER}/{METRICS_FILE}"
        names = [file.parts[-3] for file in self.folder.glob(finished)]
        # A copy that somebody kept there is none.
        names = [name for name in names if re.fullmatch(r"\d{5,}-\d{5,}", name)]
        if not names:
            return None
        # Casts are only ever added and discarded, so more of either came later.
        newest = max(names, key=lambda name: [int(count) for count in name.split("-")])
        return int(newest.partition("-")[0]), self.folder / FITS_FOLDER / newest

    def fit(
        self,
        casts: Dataset,
        folder: pathlib.Path | None,
        progress: ProgressCallback,
        validation_count: int | None = None,
    ) -> Tuned:
        """Return the fit to some casts, which the folder keeps."""
        progress(Progress(task=f"2/4 fit to {len(casts)} casts"))
        return tune(
            casts,
            config=self.simulators.fit,
            **self._resolution,
            validation_count=validation_count,
            out=None if folder is None else folder / TUNE_FOLDER,
            progress=progress,
        )

    def _model(
        self,
        tuned: Tuned,
        folder: pathlib.Path | None,
        fitted_to: int | str | None,
        progress: ProgressCallback,
    ) -> Beliefs:
        """Return the model of a fit to some casts, see `Beliefs`; the folder keeps it."""
        config = self.config
        shared: Any = {"seed": config.seed, "device": config.device, "progress": progress}
        progress(Progress(task="3/4 simulate"))
        simulated = simulate_to_aim(
            self.setup,
            tuned,
            count=config.simulated_count,
            pace=config.pace,
            out=None if folder is None else folder / DATASET_FOLDER,
            **{name: value for name, value in self._resolution.items() if value is not None},
            **shared,
        )
        progress(Progress(task="4/4 train"))
        policy = train(
            simulated,
            epochs=config.epochs,
            hidden_width=HIDDEN_WIDTH,
            candidate_count=config.candidate_count,
            out=None if folder is None else folder / MODEL_FOLDER,
            **shared,
        )
        return Beliefs(
            policy=policy.in_lab(self.setup),
            tuned=tuned,
            fitted_to=fitted_to,
            spread_count=self.simulators.spread_count,
        )


@check_argument_types
def aim(
    session: CastSession | ForwardSearchPolicy,
    rig: CheckedRig,
    target_xy: ArrayLike | None = None,
    *,
    r: ArrayLike | None = None,
    theta_deg: ArrayLike | None = None,
    on_proposal: Callable[[Proposal], None] | None = None,
    on_cast: Callable[[Cast], None] | None = None,
    on_stop: Callable[[Stop], None] | None = None,
    on_refit: Callable[[CastSession, RefitDue], None] | None = None,
    progress: ProgressCallback = show,
) -> AimResult:
    """Cast at targets one after another, each until it is hit or all tries are used.

    A target that the session has cast at before goes on where it stopped. Casts that are not worth
    making are not made, see `AimSession.stop`. Before a new target the
    simulator is fitted anew to all casts where `AimSession.refit_due` says that it is worth it,
    unless `AimConfig.refit` is False.

    Args:
        session: Session that `prepare_aim` or `prepare_strike` returned, or a policy of simulated
            casts alone.
        rig: Rig that `make_rig` returned, with the set-up of the session.
        target_xy: Targets [m], shape [2] or [target, 2]; or else r and theta_deg. Those of strikes
            are a distance ahead and a height in the plane of the swing.
        r: Distances from the robot's base [m], a number or shape [target].
        theta_deg: Angles from straight ahead, positive to the robot's right [deg], a number or
            shape [target].
        on_proposal: Called with every proposal before its cast is made.
        on_cast: Called with every cast after it was made.
        on_stop: Called with a proposed cast that is not worth making.
        on_refit: Called with the session and the reason of a new fit that is due, in place of
            `session.refit(progress)`.
        progress: Told how many targets are done, and how far a new fit is.

    Raises:
        TargetError: A target is not finite, out of reach, or off the table.
        RigError: A cast failed too often. Earlier casts are kept.
    """
    session = session if isinstance(session, CastSession) else AimSession(session)
    goals = session.goals(target_xy, r=r, theta_deg=theta_deg)
    stops = []
    for done, goal in enumerate(goals):
        # Never between the tries at a target: a correction relies on the model of the last try.
        refits = session.config.refit and not session.casts_at(goal.value)
        due = session.refit_due if refits else None
        if due is not None and on_refit is not None:
            on_refit(session, due)
        elif due is not None:
            progress(Progress(task="A new fit to all casts", note=refit_text(due)))
            session.refit(progress)
        stop = None
        while not session.is_done(goal.value):
            proposal = session.propose(goal)
            if stop := session.stop(proposal):
                if on_stop is not None:
                    on_stop(stop)
                break
            if on_proposal is not None:
                on_proposal(proposal)
            cast = session.cast(rig, proposal)
            if on_cast is not None:
                on_cast(cast)
        stops.append(stop)
        progress(Progress(task="Aiming", done=done + 1, total=len(goals), unit="targets"))
    return AimResult(
        session=session,
        target_xy=np.array([goal.value for goal in goals]),
        casts=tuple(tuple(session.casts_at(goal.value)) for goal in goals),
        stops=tuple(stops),
    )


def _evaluation(result: AimResult, session: AimSession, rig: CheckedRig) -> Evaluation:
    """Return all casts at some targets as an evaluation; `repeat` counts the tries from 0."""
    setup = session.setup
    casts = [cast for casts in result.casts for cast in casts]
    return Evaluation(
        setup=setup,
        rig=dict(rig.description),
        target_xy=result.target_xy,
        inside_coverage=session.model.policy.inside_coverage(
            result.target_xy, max(session.config.within_pct, COVERAGE_PCT)
        ),
        casts=tuple(casts),
        motions=tuple(cast.proposal.trajectory for cast in casts if cast.proposal is not None),
        target_index=np.repeat(np.arange(len(result.casts)), [len(c) for c in result.casts]),
        predicted_xy=np.array([cast.expected_xy for cast in casts]).reshape(-1, 2),
    )


def write_aim_report(
    result: AimResult,
    rig: CheckedRig,
    folder: str | os.PathLike[str],
    beyond: Sequence[Beyond] = (),
) -> Evaluation:
    """Write metrics, casts, the map of the tries, and the report.

    An earlier report in the folder is overwritten. The last cast at each target is returned, with
    metrics; `tries` among these has one row per try.

    Args:
        result: Result of `aim`.
        rig: Rig of the casts.
        folder: Folder to write to.
        beyond: Further targets that were asked for and are out of reach, with the reason of each.

    Raises:
        MissingExtraError: A library that draws is missing.
    """
    folder, session = pathlib.Path(folder), result.session
    if not isinstance(session, AimSession):
        raise InputError("this report is of casts onto a table: write_strike_report is of strikes")
    run = result.report_run(folder, rig, policy=session.model.policy.info)
    every = _evaluation(result, session, rig)
    tried = Tried(session=session, every=every, stops=result.stops, beyond=beyond)
    last = tried.last
    out_of_reach = [xy.tolist() for xy, _ in beyond]
    metrics = evaluation_metrics(last) | result.metrics | {"out_of_reach": out_of_reach}
    last = dataclasses.replace(last, metrics=metrics)
    with run.locked(replaces=True):
        save_trials(every, folder / TRIALS_FILE)
        write_bytes(folder / TRIES_FILE, png_bytes(tried.map()))
        write_text(folder / REPORT_FILE, aim_page(tried, run.config))
        run.finish(metrics)
    return last
