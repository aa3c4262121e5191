"""Strikes: what swings of a cable can pass in the air, and a session that aims at such points."""

import dataclasses
import io
import os
import pathlib
import zipfile
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

import cablecast
from cablecast.aiming.config import AimConfig
from cablecast.aiming.strike import CABLE_COUNT, MOVE_COUNT, StrikePrior
from cablecast.aiming.strike_session import StrikeSession, check_reach
from cablecast.conventions import Array
from cablecast.engines.swing import swing_model
from cablecast.errors import InputError, TargetError, check_argument_types
from cablecast.files import write_bytes, write_text
from cablecast.motion.joint_move import JointMoves, SwingPlane
from cablecast.pipeline.aim import PRIOR_FILE, SESSION_FOLDER, AimResult, keep_rig
from cablecast.report.strike_page import (
    STRIKE_PAGE,
    STRIKE_PICTURE,
    envelope_text,
    strike_map,
    strike_page,
)
from cablecast.report.style import png_bytes
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.swings import move_envelope
from cablecast.runs.folder import fingerprint
from cablecast.runs.progress import DONE_NOTE, Progress, ProgressCallback, ignore, show
from cablecast.setup import Setup
from cablecast.task import STRIKE
from cablecast.tuning.tips import TipBelief

HANG_MARGIN = 0.05
"""Least height above the floor of a cable that hangs at the start [m]."""
CHECK_MOVES, CHECK_CABLES = 256, 6
"""Moves and believed cables that a check simulates."""


@check_argument_types
def prepare_strike(
    rig: CheckedRig,
    config: AimConfig | None = None,
    *,
    out: str | os.PathLike[str] | None = None,
    move_count: int | None = None,
    cable_count: int | None = None,
    progress: ProgressCallback = show,
) -> StrikeSession:
    """Simulate swings of cables that this one may be, and open a session of strikes.

    No swing is made for it: the first try at the first target is the move that hits best with all
    of these cables. `aim` then aims at targets, by their distance ahead and height.

    Args:
        rig: Rig that `make_rig` returned for a set-up with a strike section.
        config: Settings; `tries`, `within_pct` and `seed` are used.
        out: Folder that keeps everything and lets stopped work go on; none if None.
        move_count: Moves that are simulated; `MOVE_COUNT` if None.
        cable_count: Cables that are simulated; `CABLE_COUNT` if None.
        progress: Told how far each step is.

    Raises:
        InputError: The set-up has no strike section, or the folder holds something else.
    """
    config = config or AimConfig()
    folder = None if out is None else pathlib.Path(out)
    if folder is not None:
        keep_rig(folder, rig)
    counts = move_count or MOVE_COUNT, cable_count or CABLE_COUNT
    prior = _prior(rig.setup, folder, config.seed, *counts, progress)
    session_folder = None if folder is None else folder / SESSION_FOLDER
    return StrikeSession(rig.setup, prior, out=session_folder, config=config)


def _check_hangs_free(setup: Setup) -> None:
    """Refuse a cable that hangs onto the floor at the start, where every swing ends at once."""
    moves, cable = JointMoves.of(setup), setup.cable
    root = float(moves.stick.root(moves.arm.frames(np.array(moves.start))[-1])[2])
    length, floor = cable.length + cable.attachment_length, setup.strike_section.floor
    if root - length < floor + HANG_MARGIN:
        raise InputError(
            f"{cable.name} of {length:.2f} m hangs onto the floor: the stick ends "
            f"{root - floor:.2f} m above it at the start, which must be {HANG_MARGIN:g} m more "
            f"than the cable: state the floor where it is (strike.floor = {floor:g} m), start "
            "higher (strike.start_deg), or take a shorter cable"
        )


def _prior(
    setup: Setup,
    folder: pathlib.Path | None,
    seed: int,
    move_count: int,
    cable_count: int,
    progress: ProgressCallback,
) -> StrikePrior:
    """Return the simulated swings of believed cables, which the folder keeps."""
    _check_hangs_free(setup)
    model, belief = swing_model(setup), TipBelief.of(setup.cable)
    task = f"Simulating {move_count} swings of each cable that this may be"
    made_of = [setup.to_settings(), seed, move_count, cable_count, cablecast.__version__]
    key, file = fingerprint(made_of), None if folder is None else folder / PRIOR_FILE
    if file is not None and file.is_file():
        try:
            with np.load(file) as stored:
                if str(stored["key"]) == key:
                    progress(Progress(task=task, note=DONE_NOTE))
                    units, tips = stored["units"], stored["tips"]
                    return StrikePrior(model=model, belief=belief, units=units, tips=tips)
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            # It is simulated anew.
            pass
    prior = StrikePrior.simulate(
        model,
        belief,
        seed,
        move_count=move_count,
        cable_count=cable_count,
        on_cable=lambda done: progress(
            Progress(task=task, done=done, total=cable_count, unit="cables")
        ),
    )
    if not len(prior.units):
        raise InputError(
            "the arm can make none of the moves of the strike section: they break its limits, or "
            "the arm meets itself"
        )
    if file is not None:
        content = io.BytesIO()
        np.savez(content, key=np.array(key), units=prior.units, tips=prior.tips)
        write_bytes(file, content.getvalue())
    return prior


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class StrikeCheck:
    """What swings of a cable pass, before any real one.

    Attributes:
        setup: Set-up that was checked.
        prior: Simulated swings of cables that this one may be.
        followed: Share of the moves of the strike section that the arm can make [-].
    """

    setup: Setup
    prior: StrikePrior
    followed: float

    @property
    def plane(self) -> SwingPlane:
        """Plane of the swings."""
        return SwingPlane.of(self.prior.model.moves)

    @property
    def passed(self) -> NDArray[np.float64]:
        """Places that tips pass: distance ahead and height [m], shape [place, 2]."""
        points = self.prior.tips.reshape(-1, 3)
        return self.plane.coordinates(points[np.isfinite(points[:, 0])])[:, :2]

    @property
    def summary(self) -> str:
        """Where tips come, and how much of the moves the arm can make, in words."""
        (low_u, low_v), (high_u, high_v) = self.passed.min(axis=0), self.passed.max(axis=0)
        return (
            f"swings of this cable pass {low_u:.2f} to {high_u:.2f} m ahead and {low_v:.2f} to "
            f"{high_v:.2f} m high; the arm can make {100 * self.followed:.0f} % of the moves of "
            "the lab file"
        )

    @property
    def envelope(self) -> tuple[Array, Array]:
        """Corners of the box that arm, stick and cable never leave, whatever the cable [m]."""
        return move_envelope(self.setup, self.prior.units)

    def refusal_at(self, place: ArrayLike) -> str:
        """Return why no swing strikes a place ahead and high [m], shape [2]; empty if one does."""
        (goal,) = STRIKE.goals(self.setup, place)
        try:
            check_reach(self.prior, goal, self.plane)
        except TargetError as error:
            return str(error)
        return ""

    def words_at(self, place: ArrayLike) -> str:
        """Return whether a swing strikes a place ahead and high [m], shape [2], in words."""
        if refusal := self.refusal_at(place):
            return refusal
        (goal,) = STRIKE.goals(self.setup, place)
        misses = np.sort(self.prior.misses(goal.value))
        return (
            "a swing passes there; the best first try misses by "
            f"{100 * misses[0]:.1f} cm on average over what this cable may be"
        )


@check_argument_types
def check_strike(
    setup: Setup, *, seed: int = 0, progress: ProgressCallback = ignore
) -> StrikeCheck:
    """Check what swings of a cable pass in the air, in seconds and before any real one.

    Args:
        setup: Set-up with a strike section.
        seed: Seed of moves and cables.
        progress: Told what is simulated.

    Raises:
        InputError: The set-up has no strike section, or the arm can make none of its moves.
    """
    prior = _prior(setup, None, seed, CHECK_MOVES, CHECK_CABLES, progress)
    followed = len(prior.units) / CHECK_MOVES
    return StrikeCheck(setup=setup, prior=prior, followed=followed)


def write_strike_report(
    result: AimResult,
    rig: CheckedRig,
    folder: str | os.PathLike[str],
    refusals: Sequence[str] = (),
) -> None:
    """Write metrics, the picture of the plane of the swing, and the report.

    An earlier report in the folder is overwritten.

    Args:
        result: Targets and tries.
        rig: Rig of the swings.
        folder: Folder of the report.
        refusals: Why each further target cannot be struck.

    Raises:
        MissingExtraError: A library that draws is missing.
    """
    session, folder = result.session, pathlib.Path(folder)
    if not isinstance(session, StrikeSession):
        raise InputError("this report is of strikes: write_aim_report is of casts onto a table")
    run, setup = result.report_run(folder, rig), session.setup
    box = envelope_text(*move_envelope(setup, session.prior.units))
    facts = [f"In the swings of this lab file {box}"]
    if (posterior := session.posterior) is not None:
        facts.append(
            f"The swings tell a cable of {100 * posterior.cable.length:.0f} cm, knot and "
            "attachment included"
        )
    with run.locked(replaces=True):
        figure = strike_map(result.casts, setup)
        write_bytes(folder / STRIKE_PICTURE, png_bytes(figure))
        page = strike_page(result.casts, setup, run.config, facts, refusals)
        write_text(folder / STRIKE_PAGE, page)
        run.finish(result.metrics)
