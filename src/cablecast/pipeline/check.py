"""check: which part of the table casts of a cable can reach, what limits it, and what helps."""

import contextlib
import dataclasses
import functools
import math
import os
import pathlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cablecast.aiming.polar import LAID_OUT
from cablecast.cable import CABLE_NAMES, load_cable
from cablecast.conventions import Array, mirror_xy, polar_to_xy, stream, xy_to_polar
from cablecast.engines import make_engine
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import (
    SEED_MAX,
    CablecastError,
    InputError,
    check_argument_types,
    check_seed,
)
from cablecast.evaluation.coverage import R0_CHOICES
from cablecast.files import read_json, write_bytes
from cablecast.motion.action import ACTION_SIZE
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import (
    check_actions,
    feasible_uniform,
    uniform_actions,
    widest_ranges,
)
from cablecast.motion.grip_path import GripPath
from cablecast.motion.limits import check_grip_paths
from cablecast.motion.polar import PullReach, cast_paces, plan_reset, polar_config, reset_pose
from cablecast.motion.trajectory import plan_trajectory
from cablecast.pipeline.places import require
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import POLAR_SECTION, MotionConfig, Setup
from cablecast.task import LANDING
from cablecast.tuning.swing import tune_swing
from cablecast.tuning.tuned import Tuned

PICTURE_FILE = "check.png"
"""Picture of the places that casts reach."""

OUTLOOK_FILE = pathlib.Path(__file__).with_name("outlook.json")
"""Outlooks for targets, which `python -m benchmarks pages` writes from the casts of a benchmark."""

REACH_GAP = 0.08
"""A place counts as reached if one of 400 simulated casts comes to rest within this distance [m].
Between these casts there are others: of three tables they mark 55, 58 and 66 %, where 3,000 casts
mark 53, 53 and 65 % within 3 cm."""
EDGE_SHARE = 0.1
"""Share of the cable's length about a place within which all others are to be reached, too, for it
not to be at the edge [-]."""
DOUBT_SHARE = 0.1
"""Share of the cable's length by which a landing of the true cable may lie beyond those of all
believed ones [-]."""

# Casts of each believed cable, and of each change that is tried.
_CAST_COUNT, _DRAWS = 400, 4
# Slow casts of the most likely cable, and their paces: equal ones scatter by less than 1 % of its
# length in the virtual rig.
_CALM_COUNT, _CALM_PACES = 150, (0.2, 0.6)
# Steps between the places to which polar casts are planned [m, rad].
_POLAR_STEP = (0.1, np.radians(5.0))
# Densities of cables that are not asked about [kg/l]: from foam to lead.
_DENSITIES = 0.05, 12.0
_SEGMENT_COUNT, _DT, _SAMPLE_DT = 20, 2e-3, 0.05
# Width of the squares of the table that are counted [m].
_CELL = 0.04
_UNITS = {
    **{"r0": "m", "reset_y": "m", "table_near_y": "m", "length": "m", "table_yaw_deg": "deg"},
    **{"v_max": "m/s", "jerk": "m/s³", "mass": "kg", "bend_stiffness": "N·m²"},
}
# A change is named if it reaches so many times as much of the table, and so much more of it.
_BETTER, _BETTER_BY = 1.15, 0.03


@dataclasses.dataclass(frozen=True, kw_only=True)
class Outlook:
    """What became of targets in random laboratories; `python -m benchmarks promises` measures it.

    Attributes:
        count: Number of targets.
        hit: Share of them that was hit within 1, 2, ... 6 tries [-].
        floor: Median distance of equal casts from their middle [cable lengths]: no correction
            comes nearer.
    """

    count: int
    hit: Sequence[float]
    floor: float

    def words(self, length: float) -> str:
        """Return what to expect with a cable of a length [m]."""
        first, second, fourth, sixth = (100.0 * self.hit[tries - 1] for tries in (1, 2, 4, 6))
        return (
            f"of {self.count} such targets of random laboratories {first:.0f} % were hit at the "
            f"first try, {second:.0f} % within two, {fourth:.0f} % within four and {sixth:.0f} % "
            f"within six; equal casts scatter by about {100.0 * self.floor * length:.1f} cm"
        )


@functools.cache
def outlooks() -> dict[str, Outlook]:
    """Return what to expect of targets by `LabCheck.outlook_at`."""
    return {name: Outlook(**values) for name, values in read_json(OUTLOOK_FILE).items()}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Change:
    """A change of the laboratory that was tried in simulation.

    Attributes:
        kind: Key that changes, or property of the cable.
        what: What changes, in the words of the lab file.
        reason: What is wrong without it; empty where nothing is.
        setup: Set-up with the change.
        share: Share of the table that casts of the believed cable reach then [-].
        before: That share without the change, by equally many casts [-].
    """

    kind: str
    what: str
    reason: str
    setup: Setup
    share: float
    before: float

    def __str__(self) -> str:
        gain = f"{100 * self.share:.0f} % of the table instead of {100 * self.before:.0f} %"
        return f"{self.what}: {gain}" + f" ({self.reason})" * bool(self.reason)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class LabCheck:
    """What casts of a cable can reach in a laboratory, before any real cast.

    Attributes:
        setup: Set-up that was checked.
        landing_xy: Landings of simulated casts of each believed cable, to both sides [m], shape
            [cable, cast, 2]. The first cable is the most likely one; NaN where the free end passes
            an edge of the table, or the simulation broke off.
        calm_xy: Landings of its slow casts, and of polar casts: equal ones end near each other [m],
            shape [cast, 2].
        leaving_xy: Landings of the casts of the most likely cable that pass an edge [m], shape
            [cast, 2].
        followed: Share of the drawn motions that the arm can follow in front of the table [-].
        broken: Limit that most of the others break; empty where it follows all.
        changes: Changes that reach more, the best first.
        reset_offset: Mean distance from straight ahead at which a simulated reset leaves the free
            end of what the cable may be [m]; infinite where the arm cannot follow a reset.
        lays_out: Whether a simulated swing lays most of these cables out straight; polar casts
            count if so.
    """

    setup: Setup
    landing_xy: Array
    leaving_xy: Array
    calm_xy: Array = dataclasses.field(default_factory=lambda: np.empty((0, 2)))
    followed: float = 1.0
    broken: str = ""
    changes: tuple[Change, ...] = ()
    reset_offset: float = 0.0
    lays_out: bool = True

    @functools.cached_property
    def places(self) -> Array:
        """Middles of the squares of the table [m], shape [place, 2]."""
        workspace = self.setup.workspace
        x = np.arange(-workspace.half_width + _CELL / 2, workspace.half_width, _CELL)
        y = np.arange(workspace.y_min + _CELL / 2, workspace.y_max, _CELL)
        return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)

    def chance(self, xy: ArrayLike) -> Array:
        """Return the share of the believed cables whose casts reach places [m], shape [..., 2]."""
        return np.mean([_distance(xy, landed) <= REACH_GAP for landed in self.landing_xy], axis=0)

    def is_out_of_reach(self, xy: ArrayLike) -> bool:
        """Return whether a place [m], shape [2], is beyond what any believed cable can reach."""
        gap = _distance(xy, self.landing_xy.reshape(-1, 2))
        return bool(gap > REACH_GAP + DOUBT_SHARE * self.setup.cable.length)

    def words_at(self, xy: ArrayLike) -> str:
        """Return whether casts reach a place [m], shape [2], in words, and the nearest landing."""
        if not self.reaches_anything:
            return "no simulated cast stays on the table"
        count = len(self.landing_xy)
        reached = round(float(self.chance(xy)) * count)
        doubt = self.doubt_words_at(xy)
        if not reached:
            return doubt
        lands = f"simulated casts land there for {reached} of {count} cables that this may be"
        if doubt:
            return f"{lands}, but {doubt}"
        return f"{lands}: {outlooks()['calm'].words(self.setup.cable.length)}"

    def is_calm(self, xy: ArrayLike, margin: float = 0.0) -> bool:
        """Return whether slow or polar casts land at a place [m], shape [2], and all about it.

        `margin` is the distance up to which they are to land there [m].
        """
        turn = np.arange(8) * np.pi / 4
        about = margin * np.stack([np.sin(turn), np.cos(turn)], axis=-1)
        return bool(np.all(_distance(np.asarray(xy) + about, self.calm_xy) <= REACH_GAP))

    def outlook_at(self, xy: ArrayLike) -> str:
        """Return what to expect at a place [m], shape [2]: a key of `outlooks`.

        "calm" well within what slow and polar casts reach, "edge" at the edge of it, and "wild"
        where only fast casts land.
        """
        if not self.is_calm(xy):
            return "wild"
        return "calm" if self.is_calm(xy, EDGE_SHARE * self.setup.cable.length) else "edge"

    def doubt_words_at(self, xy: ArrayLike) -> str:
        """Return what to expect at a place [m], shape [2], if not the best; else nothing."""
        if not self.chance(xy):
            where = _nearest_words(xy, self.landing_xy.reshape(-1, 2))
            return (
                f"no simulated cast of what this cable may be lands there: the nearest is {where}"
            )
        kind = self.outlook_at(xy)
        words = outlooks()[kind].words(self.setup.cable.length)
        if kind == "calm":
            return ""
        if kind == "edge":
            return f"it is at the edge of what calm ones reach: {words}"
        near = _nearest_words(xy, self.calm_xy) if len(self.calm_xy) else "nowhere"
        return f"only fast ones: {words}. The nearest landing of a calm cast is {near}"

    @property
    def reaches_anything(self) -> bool:
        """Whether a cast of any believed cable comes to rest on the table."""
        return bool(np.isfinite(self.landing_xy).any())

    @functools.cached_property
    def shares(self) -> Array:
        """Share of the table that the casts of each believed cable reach [-], shape [cable]."""
        reached = [_distance(self.places, landed) <= REACH_GAP for landed in self.landing_xy]
        return np.mean(reached, axis=1)

    @property
    def summary(self) -> str:
        """One line: how much of the table is reached, and how sure that is."""
        name, low, high = self.setup.cable.name, self.shares.min(), self.shares.max()
        return (
            f"casts of {name} reach {100 * self.shares[0]:.0f} % of the table; {100 * low:.0f} to "
            f"{100 * high:.0f} % if its stiffness and friction are not as assumed"
        )

    @property
    def limits(self) -> tuple[str, ...]:
        """What keeps casts of the most likely cable from the rest of the table, by its share."""
        workspace, cable = self.setup.workspace, self.setup.cable
        left = _distance(self.places, self.landing_xy[0]) > REACH_GAP
        far = np.linalg.norm(self.places, axis=1) > workspace.reach(cable.length)
        edge = ~far & (_distance(self.places, self.leaving_xy) <= REACH_GAP)
        words = (
            (far, f"is beyond arm and cable, {workspace.reach(cable.length):.2f} m from the base"),
            (edge, f"is where only casts end that pass the table's {self._passed_edge()} edge"),
            (~far & ~edge, "is within the length of arm and cable, but no cast ended there"),
        )
        rows = [(float(np.mean(left & mask)), text) for mask, text in words]
        lines = [
            f"{100 * share:.0f} % of the table {text}"
            for share, text in sorted(rows, reverse=True)
            if share >= 0.01
        ]
        density = cable.params.mass / (math.pi * cable.radius**2 * cable.length) / 1000.0
        if not _DENSITIES[0] <= float(density) <= _DENSITIES[1]:
            lines.append(
                f"a cable of {float(density):.2g} kg/l is unusual (steel has 7.8): check its "
                f"length, its diameter of {1000 * cable.diameter:.3g} mm and its mass"
            )
        if self.broken:
            lines.append(
                f"the arm can follow {100 * self.followed:.0f} % of the motions that were drawn; "
                f"what rules out most others is the {self.broken}"
            )
        return tuple(lines)

    @property
    def resets_straight(self) -> bool:
        """Whether a simulated reset lays out straight what the cable may be."""
        return self.reset_offset < LAID_OUT * self.setup.cable.length

    @property
    def swing_words(self) -> str:
        """What would be better about the swing of resets and polar casts, in one sentence."""
        setup, by_hand = self.setup, "lay it straight by hand, or take another"
        tunes = setup.polar is None and setup.arm.solves_exactly
        tune = "look for a swing that does with `cablecast check --tune-swing`"
        if math.isinf(self.reset_offset):
            remedy = tune if tunes else f"{by_hand} arm"
            if setup.polar is not None:
                remedy = f"change the section `{POLAR_SECTION}`, or {tune}"
            return f"the {setup.arm.model} cannot make the reset of the cable: {remedy}"
        if self.resets_straight:
            if not tunes:
                return ""
            if not self.lays_out:
                return f"a reset lays the cable out straight, but no polar cast does: {tune}"
            if any(setup.cable == load_cable(name) for name in CABLE_NAMES):
                return ""
            return (
                "the standard one was chosen for other cables: `cablecast check --tune-swing` "
                "looks for one with which polar casts of this cable land where they are aimed"
            )
        hangs = polar_config(setup).hang_height(setup.cable)
        length = setup.cable.length + setup.cable.attachment_length
        why = f", as only {hangs:.2f} m of it hang free" if hangs < length else ""
        return (
            f"in simulation a reset leaves the free end {100.0 * self.reset_offset:.0f} cm from "
            f"straight ahead{why}: {tune if tunes else f'{by_hand} cable'}"
        )

    def _passed_edge(self) -> str:
        workspace, xy = self.setup.workspace, self.leaving_xy
        beyond = {
            "far": xy[:, 1] - workspace.y_max,
            "near": workspace.y_min - xy[:, 1],
            "left or right": np.abs(xy[:, 0]) - workspace.half_width,
        }
        worst = np.argmax(np.stack(list(beyond.values())), axis=0)
        return list(beyond)[int(np.bincount(worst, minlength=3).argmax())] if len(xy) else "far"

    def refusal(self) -> str:
        """Return why no cast is worth making, and what would change that."""
        what = f"no cast of {self.setup.cable.name} stays on the table"
        return f"{what}: {'; '.join(self.limits)}. {remedy(self.changes)}"


def is_better(tuned: LabCheck, old: LabCheck) -> bool:
    """Return whether a swing lays the cable out where another did not, or straighter.

    The reset counts first, as every cast needs it; then polar casts.
    """

    def rank(found: LabCheck) -> tuple[bool, bool, float]:
        return found.resets_straight, found.lays_out, -found.reset_offset

    return math.isfinite(tuned.reset_offset) and rank(tuned) > rank(old)


def check_tuned(
    checked: LabCheck, *, seed: int = 0, progress: ProgressCallback = ignore
) -> LabCheck | None:
    """Return what is found with a tuned swing; None where that is not better.

    Raises:
        InputError: See `tune_swing`.
    """
    tuned = tune_swing(checked.setup, seed=seed, progress=progress)
    found = check(tuned, changes=False, seed=seed)
    return found if is_better(found, checked) else None


def remedy(changes: tuple[Change, ...]) -> str:
    """Return what would reach more of the table, in one sentence."""
    if not changes:
        return "No change that was tried reaches clearly more"
    return f"Simulated casts reach more with {'; '.join(str(change) for change in changes)}"


@check_argument_types
def check(
    setup: Setup,
    *,
    target_xy: ArrayLike = (),
    changes: bool = True,
    out: str | os.PathLike[str] | None = None,
    seed: int = 0,
    progress: ProgressCallback = ignore,
) -> LabCheck:
    """Check what casts of a cable can reach in a laboratory, in seconds and before any real cast.

    Casts that the arm can follow are drawn and simulated, with the most likely cable and with
    others that it may be as well, by the deviations of its file. Then changes of the laboratory are
    tried: each is simulated, too.

    Args:
        setup: Cable, workspace, arm and motion settings.
        target_xy: Targets that the picture marks [m], shape [target, 2].
        changes: Whether to try changes of the laboratory.
        out: Folder for a picture; none is drawn if None.
        seed: Seed of casts and cables.
        progress: Receives the number of changes tried.

    Raises:
        InputError: The arm can follow no cast; the error names the limit, and what helps.
        MissingExtraError: A picture is asked for, and matplotlib is missing.
    """
    check_seed(seed)
    if setup.cable.params.world_count is not None:
        raise InputError("check takes a cable with one set of parameters, not one per world")
    if out is not None:
        require("the picture of check", "matplotlib")
    try:
        found = _believed(setup, seed)
    except InputError as error:
        helped = _try_changes(setup, 0.0, seed, progress, True) if changes else ()
        raise InputError(f"{error}. {remedy(helped)}" if changes else str(error)) from None
    if changes:
        helped = _try_changes(setup, float(found.shares[0]), seed, progress, found.lays_out)
        found = dataclasses.replace(found, changes=helped)
    if out is not None:
        from cablecast.report.maps import reach_map
        from cablecast.report.style import png_bytes

        targets = np.reshape(target_xy, (-1, 2))
        figure = reach_map(setup, found.places, found.chance(found.places), _CELL, targets)
        write_bytes(pathlib.Path(out) / PICTURE_FILE, png_bytes(figure))
    return found


# The verbs that check a laboratory follow each other in one process.
@functools.lru_cache(maxsize=8)
def _believed(setup: Setup, seed: int) -> LabCheck:
    """Simulate casts of what the cable may be."""
    # Materials shift landings, but barely what is reached, and need a kernel of their own, which
    # compiles for half a minute.
    members = tuple(
        member.with_params(member.params.without_material())
        for member in Tuned.believed(setup, seed).members
    )
    offset, lays_out = _swings(setup, members)
    found = _simulated(setup, members, seed, lays_out)
    drawn = check_actions(_drawn(setup, _CAST_COUNT, seed), setup)
    return dataclasses.replace(
        found,
        followed=float(drawn.mask.mean()),
        broken=next(iter(drawn.counts()), ""),
        reset_offset=offset,
        lays_out=lays_out,
    )


def _swings(setup: Setup, members: tuple[Dynamics, ...]) -> tuple[float, bool]:
    """Return where a reset leaves the free end, and whether a swing lays most cables out straight.

    The first is its mean distance from straight ahead over the cables that it may be [m], infinite
    where the arm cannot follow; none is farther than its length. An arm whose joints are searched
    for would take minutes, and is given the benefit of the doubt.
    """
    if not setup.arm.solves_exactly:
        return 0.0, True
    workspace, length = setup.workspace, setup.cable.length
    paths, ends = [], []
    with contextlib.suppress(CablecastError):
        paths.append(plan_reset(reset_pose(workspace), setup).grip_path)
        ends.append((0.0, workspace.reset_y + length))
    has_reset = bool(paths)
    with contextlib.suppress(CablecastError):
        reach = PullReach.of(setup)
        for pace in cast_paces(setup):
            cast = reach.ahead(pace)
            with contextlib.suppress(CablecastError):
                paths.append(plan_trajectory(cast, setup).grip_path)
                ends.append(tuple(reach.end_xy(cast.to_array()).tolist()))
    if not paths:
        return math.inf, False
    engine = make_engine("warp", _SEGMENT_COUNT, _DT)
    path = GripPath.stack(paths)
    rollouts = [member.rollout(engine, setup, path, sample_dt=_SAMPLE_DT) for member in members]
    landed = np.stack([rollout.endpoint_xy[:, -1] for rollout in rollouts])
    off = np.linalg.norm(landed - np.array(ends), axis=2)
    off = np.where(np.isfinite(off), np.minimum(off, length), length)
    reset = float(np.mean(off[:, 0])) if has_reset else math.inf
    straight = np.mean(off[:, has_reset:] < LAID_OUT * length, axis=0)
    return reset, bool(np.any(straight > 0.5))


def _simulated(setup: Setup, members: tuple[Dynamics, ...], seed: int, lays_out: bool) -> LabCheck:
    """Return where casts of some cables land, the most likely one first.

    Polar casts are among them where their swing lays the cable out.
    """
    actions = _draw(setup, _CAST_COUNT, seed)
    landed, left = zip(
        *(_landings(setup, xy) for xy in _tracks(setup, members, actions)), strict=True
    )
    slow = _draw(setup, _CALM_COUNT, seed, _CALM_PACES)
    calm, _ = _landings(setup, _tracks(setup, members[:1], slow)[0])
    # The motion settings are those of sweeps: changes of them find these again.
    calm = calm[np.isfinite(calm).all(axis=1)]
    if lays_out:
        polar = _polar_landings(dataclasses.replace(setup, motion=MotionConfig()))
        calm = np.concatenate([calm, polar])
    return LabCheck(
        setup=setup,
        landing_xy=np.array([np.concatenate([one, calm]) for one in landed]),
        calm_xy=calm,
        leaving_xy=left[0],
    )


@functools.lru_cache(maxsize=64)
def _polar_landings(setup: Setup) -> Array:
    """Return where polar casts end that the arm can follow, of a straight cable [m], [cast, 2]."""
    try:
        reach = PullReach.of(setup)
    except InputError:
        return np.empty((0, 2))
    step, turn = _POLAR_STEP
    table = setup.workspace
    ends = []
    for theta in np.arange(0.0, 0.5 * np.pi, turn):
        r = np.arange(step, reach.back.radius + step, step)
        places = polar_to_xy(np.stack([r, np.full_like(r, theta)], axis=-1))
        found = [
            (xy, cast)
            for xy in places[table.on_table(places)]
            if (cast := reach.cast_to(xy, cast_paces(setup)[0])) is not None
        ]
        # An arm that follows the nearest and the farthest follows those between them.
        outer = [cast.grip_path(setup) for _, cast in (found[:1] + found[-1:])]
        if outer and check_grip_paths(GripPath.stack(outer), setup, both_sides=True).mask.all():
            ends += [xy for xy, _ in found]
    right = np.reshape(ends, (-1, 2))
    return np.concatenate([right, mirror_xy(right)])


def _drawn(setup: Setup, count: int, seed: int, pace: tuple[float, float] = (1.0, 1.0)) -> Array:
    """Return `_DRAWS` times as many random actions, which the arm may not be able to follow."""
    return uniform_actions(widest_ranges(setup, pace), _DRAWS * count, stream(seed, "check"))


def _draw(setup: Setup, count: int, seed: int, pace: tuple[float, float] = (1.0, 1.0)) -> Array:
    """Return at most `count` actions that the arm can follow.

    Where it can follow few of them, drawing until there are enough would take minutes.

    Raises:
        InputError: It can follow none; the error names the limit.
    """
    found = np.empty((0, ACTION_SIZE))
    for block in np.split(_drawn(setup, count, seed, pace), _DRAWS):
        if len(found) < count:
            found = np.concatenate([found, block[check_actions(block, setup).mask]])
    return found[:count] if len(found) else feasible_uniform(1, setup, seed=seed)


def _tracks(setup: Setup, members: tuple[Dynamics, ...], actions: Array) -> Array:
    """Return how the free end moves in each cast of each cable [m], [cable, cast, sample, 2]."""
    count, kinds = len(actions), len(members)
    paths = cast_grip_paths(actions, setup)[np.repeat(np.arange(count), kinds)]
    dynamics = Dynamics.stack(members)
    dynamics = dynamics if kinds == 1 else dynamics.rows(np.tile(np.arange(kinds), count))
    engine = make_engine("warp", _SEGMENT_COUNT, _DT)
    xy = dynamics.rollout(engine, setup, paths, sample_dt=_SAMPLE_DT).endpoint_xy
    return np.swapaxes(xy.reshape(count, kinds, *xy.shape[1:]), 0, 1)


def _landings(setup: Setup, xy: Array) -> tuple[Array, Array]:
    """Return the landings to both sides, NaN where the free end passes an edge, and those others.

    Args:
        setup: Gives the table.
        xy: Tracks of the free end [m], shape [cast, sample, 2].
    """
    passes = np.any(setup.workspace.edge_distance(xy) < 0.0, axis=1)
    end = LANDING.outcome(xy)
    stays = np.where((passes | ~np.isfinite(xy).all(axis=(1, 2)))[:, None], np.nan, end)
    both = np.stack([stays, mirror_xy(stays)], axis=1).reshape(-1, 2)
    left = end[passes & np.isfinite(end).all(axis=1)]
    return both, np.concatenate([left, mirror_xy(left)])


def _nearest_words(xy: ArrayLike, landed: Array) -> str:
    """Return the nearest of some landings [m], shape [cast, 2], in words."""
    gaps = np.linalg.norm(landed - np.asarray(xy, dtype=float), axis=1)
    nearest = np.nanargmin(gaps)
    r, theta = xy_to_polar(landed[nearest])
    return f"r = {r:.2f} m, theta = {np.degrees(theta):z.1f} deg, {100 * gaps[nearest]:.0f} cm away"


def _distance(xy: ArrayLike, landed: Array) -> Array:
    """Return the distance from places to the nearest of some landings, infinite without any."""
    from scipy.spatial import KDTree

    landed = landed[np.isfinite(landed).all(axis=1)]
    if not len(landed):
        return np.full(np.shape(xy)[:-1], np.inf)
    return KDTree(landed).query(np.asarray(xy, dtype=float))[0]


def _try_changes(
    setup: Setup, before: float, seed: int, progress: ProgressCallback, lays_out: bool
) -> tuple[Change, ...]:
    """Return the best change of each kind of those that reach clearly more."""
    best: dict[str, Change] = {}
    rows = list(_possible(setup))

    def report(done: int) -> None:
        progress(Progress(task="Trying changes", done=done, total=len(rows), unit="changes"))

    for done, (kind, reason, values) in enumerate(rows):
        report(done)
        least = max(_BETTER * before, before + _BETTER_BY)
        try:
            changed = _with(setup, values)
            share = _share(changed, seed, lays_out)
            # The best of many owes much to chance: it must reach as much with other casts.
            if share >= max(least, best[kind].share if kind in best else 0.0):
                share = 0.5 * (share + _share(changed, (seed + 1) % (SEED_MAX + 1), lays_out))
        except InputError:
            continue
        if share >= max(least, best[kind].share if kind in best else 0.0):
            what = ", ".join(
                f"{name} = {value:.3g} {_UNITS[name]}" for name, value in values.items()
            )
            best[kind] = Change(
                kind=kind, what=what, reason=reason, setup=changed, share=share, before=before
            )
    report(len(rows))
    return tuple(sorted(best.values(), key=lambda change: -change.share))


def _share(setup: Setup, seed: int, lays_out: bool) -> float:
    """Return the share of the table that some casts of the believed cable reach [-]."""
    return float(_simulated(setup, (Dynamics.of(None, setup),), seed, lays_out).shares[0])


def _possible(setup: Setup) -> Iterator[tuple[str, str, dict[str, float]]]:
    """Yield changes: a kind, what that says of the laboratory, and new values by name."""
    workspace, motion, cable = setup.workspace, setup.motion, setup.cable
    mass, stiffness = float(cable.params.mass), float(cable.params.bend_stiffness)
    for r0 in sorted({*R0_CHOICES, round(workspace.reset_y, 3)} - {motion.r0}):
        yield "r0", "", {"r0": r0}
    for factor in (0.6, 0.8, 1.25, 1.5):
        reason = f"casts at {motion.v_max:g} m/s are too fast"
        reason = reason if factor < 1 else "faster casts reach farther, and scatter more"
        yield "v_max", reason, {"v_max": factor * motion.v_max}
    for factor in (0.1, 0.4):
        reason = f"the arm cannot follow a jerk of {motion.jerk:g} m/s³"
        yield "jerk", reason, {"jerk": factor * motion.jerk}
    for step in (-0.2, -0.1, 0.1, 0.2):
        reset_y = round(workspace.reset_y + step, 3)
        # Arcs about the base stay so.
        about_base = {"r0": reset_y} if motion.r0 == workspace.reset_y else {}
        yield "reset_y", "", {"reset_y": reset_y, **about_base}
    yield "table", "", {"table_yaw_deg": (workspace.table_yaw_deg + 90.0) % 180.0}
    for step in (-0.2, 0.2):
        yield "table", "", {"table_near_y": round(workspace.table_near_y + step, 3)}
    for factor, word in ((0.7, "long"), (1.3, "short")):
        values = {"length": factor * cable.length, "mass": factor * mass}
        yield "length", f"the cable is too {word}", values
    yield "mass", "the cable is too light", {"mass": 3.0 * mass}
    yield "stiffness", "the cable is too stiff", {"bend_stiffness": 0.1 * stiffness}


def _with(setup: Setup, values: dict[str, float]) -> Setup:
    """Return a set-up with other values of its motion, workspace and cable.

    Raises:
        InputError: They do not fit together.
    """

    def own(part: Any) -> dict[str, float]:
        return {name: value for name, value in values.items() if hasattr(part, name)}

    support = min(setup.workspace.support_depth, values.get("reset_y", np.inf))
    table = {"support_depth": support, **own(setup.workspace)}
    params = dataclasses.replace(setup.cable.params, **own(setup.cable.params))
    cable = dataclasses.replace(setup.cable, params=params, **own(setup.cable))
    workspace = dataclasses.replace(setup.workspace, **table)
    setup = setup.with_motion(**own(setup.motion))
    return dataclasses.replace(setup, workspace=workspace, cable=cable)
