"""Coverage of the reachable half disc, and the choice of r0, v_max and action set from it.

The endpoints of a grid of actions and their mirror images about the workspace axis span a concave
hull. The coverage of a combination of r0 and v_max is the area of the hull within the half disc of
radius r_max + r_c, as a share of that half disc (section V-E).

The paper takes the r0 with the largest coverage, and then weighs coverage against repeatability by
eye (section VI-B). Here the second step is a rule: maximise coverage among the repeatable
combinations. With the paper's own figures, the rule makes the paper's choice.
"""

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import CableParams
from cablecast.conventions import mirror_xy
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import InputError, MissingExtraError, check_number
from cablecast.motion.action import grid_actions
from cablecast.motion.feasibility import check_actions, feasible_of_grid, feasible_ranges
from cablecast.motion.polar import PolarReach
from cablecast.setup import Setup

if TYPE_CHECKING:
    from shapely import Polygon

R0_CHOICES = (0.6, 1.0, 2.0)
"""Distances of the polar origin that the paper compares [m] (section V-E)."""
V_MAX_CHOICES = (1.2, 1.5, 1.8)
"""Speeds that the paper compares [m/s] (section V-E)."""

HULL_RATIO = 0.1
"""Concavity of the hull, as defined by shapely: edges longer than this share of the longest edge of
the endpoints' Delaunay triangulation are removed. 0 is the tightest hull, 1 the convex hull. The
paper does not state its value, so every result also gives the shares at 0.05 and 0.2."""
HULL_RATIO_NEIGHBOURS = (0.05, 0.2)

_DISC_SEGMENTS = 180  # Sides of the polygon that approximates the half disc to 0.01 % of its area.


def measure_coverage(
    setup: Setup, dynamics: Dynamics | CableParams, engine: Engine, counts: Sequence[int]
) -> dict[str, Any]:
    """Simulate a grid of actions in one batch, and measure its coverage.

    The counts are the numbers of values of theta1, theta2, r2 and, for the action set A2, of the
    wrist turn.

    Returns:
        Plain values for metrics.json: r0 [m], v_max [m/s] and whether the wrist turns; the number
        of actions that the arm can follow, of the grid over the ranges that suit r0 and of that
        over the same angles at every r0 (`same_angles`), as the paper's words say; the area of the
        concave hull of their landings as a share of the half disc [-], also at other hull ratios;
        and the closed outlines of the hull's parts within the half disc [m].

    Raises:
        InputError: No action of the grid is feasible, or the grid is too large.
    """
    from cablecast.data.simulate import simulate_actions

    radius = setup.workspace.reach(setup.cable.length)

    def landings(actions: NDArray[np.float64]) -> NDArray[np.float64]:
        columns = simulate_actions(actions, dynamics, setup, engine)
        endpoint_xy = np.stack([columns["endpoint_x"], columns["endpoint_y"]], axis=-1)
        return endpoint_xy[np.all(np.isfinite(endpoint_xy), axis=1)]

    actions = feasible_of_grid(counts, setup)
    endpoint_xy = landings(actions)
    hull = concave_hull(endpoint_xy, radius)
    behind = setup.motion.r0 - setup.workspace.reset_y
    same = {"feasible_count": len(actions), "share": covered_share(hull, radius)}
    if behind:
        ranges = feasible_ranges(setup.with_motion(r0=setup.workspace.reset_y))
        low, high = ranges.r2
        ranges = dataclasses.replace(ranges, r2=(low + behind, high + behind))
        grid = grid_actions(ranges, counts)
        grid = grid[check_actions(grid, setup).mask]
        same = {"feasible_count": len(grid), "share": None}
        if len(grid) and len(xy := landings(grid)) > 2:
            same["share"] = covered_share(concave_hull(xy, radius), radius)
    return {
        "r0": setup.motion.r0,
        "v_max": setup.motion.v_max,
        "with_psi": len(counts) == 4,
        "feasible_count": len(actions),
        "same_angles": same,
        "hull_ratio": HULL_RATIO,
        "share": covered_share(hull, radius),
        "share_by_ratio": {
            f"{ratio:g}": covered_share(concave_hull(endpoint_xy, radius, ratio), radius)
            for ratio in HULL_RATIO_NEIGHBOURS
        },
        "hulls_xy": [np.round(outline, 4).tolist() for outline in outlines(hull)],
    }


def concave_hull(endpoint_xy: ArrayLike, radius: float, ratio: float = HULL_RATIO) -> "Polygon":
    """Return the concave hull of endpoints and their mirror images, cut to the half disc.

    Casts can come to rest behind the robot's base, where there are no targets. Endpoints [m] have
    the shape [action, 2], the half disc the radius r_max + r_c [m]; for the ratio see `HULL_RATIO`.

    Raises:
        InputError: The ratio is outside [0, 1].
    """
    check_number("hull ratio", ratio, 0.0, 1.0)
    shapely = _shapely()
    points = np.asarray(endpoint_xy, dtype=float)
    both_sides = np.concatenate([points, mirror_xy(points)])
    hull = shapely.concave_hull(shapely.MultiPoint(both_sides), ratio=ratio)
    return shapely.intersection(shapely.make_valid(hull), half_disc(radius))  # pyright: ignore


def half_disc(radius: float) -> "Polygon":
    """Return the reachable half disc in front of the robot, of a radius r_max + r_c [m]."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, _DISC_SEGMENTS + 1)
    return _shapely().Polygon(radius * np.stack([np.sin(angle), np.cos(angle)], axis=-1))


def polar_casting_region(setup: Setup) -> "Polygon":
    """Return the region in which polar casting can lay the endpoint; see `PolarReach`.

    It is empty where the cable is too long for the table.
    """
    try:
        return _shapely().Polygon(PolarReach.of(setup).outline())
    except InputError:
        return _shapely().Polygon()


def covered_share(region: "Polygon", radius: float) -> float:
    """Return the area of a region as a share of the half disc of a radius r_max + r_c [m]."""
    return float(region.area / half_disc(radius).area)


def outlines(region: "Polygon") -> tuple[NDArray[np.float64], ...]:
    """Return the closed outline of each part of a region [m], each of shape [vertex, 2]."""
    parts = _shapely().get_parts(region)
    return tuple(np.asarray(part.exterior.coords) for part in parts if part.area > 0)


def _shapely():
    try:
        import shapely
    except ImportError:
        raise MissingExtraError("shapely", "report", "measuring coverage") from None
    return shapely


SCATTER_BOUNDS = 1e-3, 1e4
"""Bounds of such a limit [% of cable length]."""

SCATTER_MAX_PCT = 3.0
"""Largest scatter of a repeatable combination, by the paper's words (`distance_sd_pct`) [% of cable
length]. The paper accepted 1.93 and rejected 3.70."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """Combination of r0 [m], v_max [m/s] and use of the wrist (the action set A2).

    It has a coverage, the share of the reachable half disc [-], and if repeated casts were made the
    mean over actions of their standard deviation [% of cable length] and the share of them that
    left the table [-].
    """

    r0: float
    v_max: float
    with_psi: bool
    coverage: float
    scatter_pct: float | None = None
    off_table_share: float | None = None

    def __post_init__(self):
        # Rounding may lift a share of area above 1.
        check_number("coverage", self.coverage, 0.0, 1.0 + 1e-9)
        if self.scatter_pct is not None:
            check_number("scatter", self.scatter_pct, 0.0, 1e6, "% of cable length")
        if self.off_table_share is not None:
            check_number("off_table_share", self.off_table_share, 0.0, 1.0)

    @property
    def speed(self) -> str:
        """Speed and action set, e.g. `v_max = 1.5 m/s with psi`."""
        return f"v_max = {self.v_max:g} m/s" + " with psi" * self.with_psi

    @property
    def landed_coverage(self) -> float:
        """Coverage times the share of repeated casts that stayed on the table [-]."""
        return self.coverage * (1.0 - (self.off_table_share or 0.0))


# Source: arXiv 2405.09581, section VI-B, and the shares off the table from its arXiv source:
# coverage in simulation tuned to cable 1, and repeated casts of cable 1 on a real UR5.
PUBLISHED_CANDIDATES = (
    Candidate(0.6, 1.2, False, 0.213, 1.27),
    Candidate(0.6, 1.5, True, 0.769, 1.93, 0.129),
    Candidate(0.6, 1.8, False, 0.663, 3.70),
    Candidate(0.6, 1.8, True, 0.797, 4.72, 0.30),
)
"""Combinations that the paper compared."""


def published_candidate(v_max: float, with_psi: bool) -> Candidate | None:
    """Return the paper's values for a speed and an action set; None if not published."""
    for candidate in PUBLISHED_CANDIDATES:
        if abs(candidate.v_max - v_max) < 1e-9 and candidate.with_psi == with_psi:
            return candidate
    return None


def choose_r0(candidates: Sequence[Candidate]) -> tuple[float, str]:
    """Return the r0 with the largest coverage, averaged over the speeds without psi, and why."""
    shares: dict[float, list[float]] = {}
    for candidate in candidates:
        if not candidate.with_psi:
            shares.setdefault(candidate.r0, []).append(candidate.coverage)
    if not shares:
        raise InputError("choosing r0 needs candidates without psi, and there are none")
    means = {r0: sum(values) / len(values) for r0, values in shares.items()}
    best = max(means, key=lambda r0: means[r0])
    listed = ", ".join(f"{100 * means[r0]:.1f} % with {r0:g} m" for r0 in sorted(means))
    return best, f"r0 = {best:g} m has the largest coverage, averaged over the speeds: {listed}."


def choose(
    candidates: Sequence[Candidate], scatter_max_pct: float = SCATTER_MAX_PCT
) -> tuple[Candidate, tuple[str, ...]]:
    """Choose r0, v_max and the action set, and give the reasons as sentences.

    Candidates with the best r0 may have a scatter; if none has, coverage alone decides. Those are
    repeatable whose scatter is at most `scatter_max_pct` [% of cable length].

    Raises:
        InputError: There are no candidates without psi to choose r0 from, or scatter_max_pct is out
            of bounds.
    """
    check_number("scatter_max_pct", scatter_max_pct, *SCATTER_BOUNDS, "% of cable length")
    r0, why_r0 = choose_r0(candidates)
    same_r0 = [candidate for candidate in candidates if candidate.r0 == r0]
    scatter = {c: c.scatter_pct for c in same_r0 if c.scatter_pct is not None}
    steady = [candidate for candidate in scatter if scatter[candidate] <= scatter_max_pct]
    listed = ", ".join(
        f"{100 * candidate.landed_coverage:.1f} % at a scatter of {scatter[candidate]:.2f} % with "
        f"{candidate.speed}"
        for candidate in sorted(scatter, key=lambda c: -c.landed_coverage)
    )
    if not scatter:
        best = max(same_r0, key=lambda candidate: candidate.coverage)
        why = (
            f"{best.speed} has the largest coverage, {100 * best.coverage:.1f} %. Repeatability "
            f"was not measured with r0 = {r0:g} m, so coverage alone decides."
        )
    elif steady:
        best = max(steady, key=lambda candidate: candidate.landed_coverage)
        why = (
            f"{best.speed} has the largest coverage by casts that stay on the table, among "
            f"settings with a scatter of at most {scatter_max_pct:g} % of cable length: {listed}."
        )
    else:
        best = min(scatter, key=lambda candidate: scatter[candidate])
        why = (
            f"No setting has a scatter of at most {scatter_max_pct:g} % of cable length; "
            f"{best.speed} has the smallest: {listed}."
        )
    return best, (why_r0, why)
