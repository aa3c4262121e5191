"""What `cablecast aim` prints of casts, try by try: on a table, and in the air."""

import abc
import math
import pathlib
from collections.abc import Sequence
from typing import ClassVar, Generic, TypeVar

from cablecast.aiming.session import AimSession, CastSession, RefitDue, Stop
from cablecast.aiming.strike_session import StrikeSession
from cablecast.cast import Cast, Proposal
from cablecast.cli import tables
from cablecast.cli.options import polar_text
from cablecast.cli.progress import console_progress
from cablecast.conventions import Array, xy_to_polar
from cablecast.pipeline.aim import REPORT_FOLDER, AimResult, aim
from cablecast.report.strike_page import plane_text
from cablecast.report.tables import pct
from cablecast.report.words import (
    chance_text,
    change_text,
    counted,
    distance_text,
    floor_text,
    hit_text,
    miss_text,
    motion_text,
    reason_text,
    refit_text,
    stop_text,
    verdict_text,
)
from cablecast.rigs.checked import CheckedRig
from cablecast.runs.progress import ignore
from cablecast.task import Goal

Session = TypeVar("Session", bound=CastSession)


class Tries(abc.ABC, Generic[Session]):
    """Prints the tries of a session.

    Attributes:
        title: What the misses are of.
    """

    title: ClassVar[str]

    def __init__(self, session: Session):
        self.session = session

    @abc.abstractmethod
    def place(self, outcome: Array) -> str:
        """Return words for an outcome, shape [k]."""

    def short_place(self, outcome: Array) -> str:
        """Return fewer words for an outcome, shape [k]."""
        return self.place(outcome)

    @abc.abstractmethod
    def plan(self, proposal: Proposal) -> list[str]:
        """Return lines about what is planned; the first stands next to the number of the try."""

    @abc.abstractmethod
    def expected(self, proposal: Proposal) -> list[str]:
        """Return lines about what to expect: the chance of a hit, and more."""

    @abc.abstractmethod
    def seen(self, cast: Cast) -> str:
        """Return where a cast came that has an outcome."""

    def changes(self, cast: Cast) -> str:
        """Return what follows from a cast; nothing if empty."""
        return ""

    def cast_at(self, rig: CheckedRig, targets: Array) -> AimResult:
        """Cast at targets, shape [target, k], and print every cast."""
        for goal in self.session.goals(targets):
            if self.session.is_done(goal.value):
                self.print_done(goal)
        return aim(
            self.session,
            rig,
            targets,
            on_proposal=self._print_proposal,
            on_cast=self._print_cast,
            on_stop=self._print_stop,
            on_refit=lambda _, due: self._refit(due),
            progress=ignore,
        )

    def _print_target(self, proposal: Proposal) -> None:
        if proposal.try_number == 1:
            print(f"\ntarget    {self.place(proposal.goal.value)}")

    def print_done(self, goal: Goal) -> None:
        """Print why no cast at a goal is made: it was hit, or its tries are used."""
        casts = self.session.casts_at(goal.value)
        hits = [cast.try_number for cast in casts if cast.hit]
        why = "its only try was" if len(casts) == 1 else f"all {len(casts)} tries were"
        why = f"hit before, by try {hits[0]}" if hits else f"{why} made before (--tries)"
        print(f"\ntarget    {self.place(goal.value)}\n          {why}", flush=True)

    def _print_proposal(self, proposal: Proposal) -> None:
        self._print_target(proposal)
        first, *plan = self.plan(proposal)
        print(f"try {proposal.try_number}     {first}")
        for line in plan:
            print(f"  motion  {line}")
        chance, *expected = self.expected(proposal)
        print(f"  expect  a hit with a chance of {chance}")
        for line in expected:
            print(f"          {line}", flush=True)

    def _print_stop(self, stop: Stop) -> None:
        self._print_target(stop.proposal)
        words = _stop_words(stop.proposal.try_number - 1)
        print(f"{words}: {stop_text(stop)} (--force casts all the same)", flush=True)

    def _print_cast(self, cast: Cast) -> None:
        if math.isfinite(cast.miss_pct):
            print(f"  saw     {self.seen(cast)}")
            verdict = "hit" if cast.hit else "missed"
            centimetres = cast.miss_pct * self.session.setup.cable.length
            off = f"{centimetres:.1f} cm off, {cast.miss_pct:.1f} % of the cable"
            print(f"          {verdict}: {off}")
        else:
            # The advice behind the colon is for those who choose motions.
            print(f"  saw     {cast.status.value.partition(':')[0].rstrip('.').lower()}")
        if then := self.changes(cast):
            print(f"  then    {then}")

    def _refit(self, due: RefitDue) -> None:
        print(f"\nnew fit   {refit_text(due)} (--no-refit keeps the model)", flush=True)
        with console_progress() as progress:
            self.session.refit(progress)
        print(f"          the simulator is fitted to {due.cast_count} casts now")

    def print_result(self, result: AimResult, beyond_count: int = 0) -> None:
        """Print one line per target, and how many were hit of these and of others out of reach."""
        tries = max((len(casts) for casts in result.casts), default=0)
        heads = ("target", *(str(number) for number in range(1, tries + 1)))
        table = tables.make_table(self.title, *heads)
        stopped = []
        for target, casts, stop in zip(result.target_xy, result.casts, result.stops, strict=True):
            place = self.short_place(target)
            cells = [self._cell(cast) for cast in casts] + [""] * (tries - len(casts))
            style = "bold" if any(cast.hit for cast in casts) else ""
            table.add_row(place, *cells, style=style)
            if stop:
                stopped.append(f"{place}: {_stop_words(len(casts))}, as said above")
        tables.print_table(table, f"{verdict_text(result.casts, beyond_count)}.")
        for line in stopped:
            print(line)

    def _cell(self, cast: Cast) -> str:
        if not math.isfinite(cast.miss_pct):
            return miss_text(cast)
        return f"{cast.miss_pct * self.session.setup.cable.length:.1f}, {cast.miss_pct:.1f} %"


class TableTries(Tries[AimSession]):
    """Prints casts onto a table."""

    title = "Miss of each try in cm, and in % of the cable's length"

    def place(self, outcome: Array) -> str:
        """Return a place on the table, polar and Cartesian."""
        return polar_text(outcome)

    def short_place(self, outcome: Array) -> str:
        """Return a place on the table, polar alone."""
        r, theta = xy_to_polar(outcome)
        return f"r = {r:.2f} m, theta = {math.degrees(theta):z.1f} deg"

    def plan(self, proposal: Proposal) -> list[str]:
        """Return why a motion is proposed, and the motion."""
        return [reason_text(proposal, self.session), motion_text(proposal)]

    def expected(self, proposal: Proposal) -> list[str]:
        """Return the chances of a hit, how far off it will land, and what may go wrong."""
        tries, failure = self.session.config.tries, 100 * proposal.expected.failure
        lines = [
            hit_text(proposal, tries),
            distance_text(proposal),
            floor_text(proposal.expected.scatter),
        ]
        lost = f"{failure:.0f} % chance that it is hidden or off the table"
        return lines + [lost] * (failure > 10)

    def seen(self, cast: Cast) -> str:
        """Return where a cast landed."""
        return self.place(cast.outcome)

    def changes(self, cast: Cast) -> str:
        """Return what the simulators make of a cast."""
        return change_text(cast, self.session)


class StrikeTries(Tries[StrikeSession]):
    """Prints swings in the air."""

    title = "Closest point of each try in cm, and in % of the cable's length"

    def place(self, outcome: Array) -> str:
        """Return a place in the plane of the swing."""
        return plane_text(outcome, self.session.plane)

    def plan(self, proposal: Proposal) -> list[str]:
        """Return the swing."""
        return [f"{proposal.action}, {proposal.trajectory.duration:.2f} s"]

    def expected(self, proposal: Proposal) -> list[str]:
        """Return the chance of a hit, and how far off it will pass."""
        return [chance_text(proposal.hit_chance), distance_text(proposal)]

    def seen(self, cast: Cast) -> str:
        """Return where a swing passed."""
        return f"the tip pass {self.place(cast.outcome)}"


def _stop_words(cast_count: int) -> str:
    return "stopped" if cast_count else "not cast at"


def print_medians(result: AimResult, beyond_count: int = 0) -> None:
    """Print the errors after each try, and how many targets were hit; some are out of reach."""
    title = "Miss after each try, in % of cable length; no landing is a miss"
    table = tables.make_table(title, "try", "median", "q1", "q3", "without landing")
    for row in result.try_rows:
        names = ("median_pct", "first_quartile_pct", "third_quartile_pct")
        cells = [pct(row[name]) for name in names]
        table.add_row(str(row["try"]), *cells, str(row["without_landing"]))
    count = len(result.session.casts)
    tables.print_table(
        table,
        f"{verdict_text(result.casts, beyond_count)}. {counted(count, 'cast')} in all.",
    )


def print_folder(out: pathlib.Path, files: Sequence[str]) -> None:
    """Print where everything lies, and picture and report, `files`, in it."""
    print(f"folder    {out}")
    for name, file in zip(("picture", "report"), files, strict=False):
        print(f"{name:<10}{out / REPORT_FOLDER / file}")
