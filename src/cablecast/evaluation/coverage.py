"""Coverage: how much of the reachable half disc a set of actions covers (section V-E).

The endpoints of a grid of actions, with their mirror images about the workspace axis, are wrapped
in a concave hull. Its area within the half disc of radius r_max + r_c, as a share of that half
disc, is the coverage of a combination of r0 and v_max.
"""

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import Cable, CableParams
from cablecast.conventions import mirror_xy
from cablecast.engines.base import Engine
from cablecast.errors import InputError, MissingExtraError
from cablecast.motion.action import ActionRanges, MotionConfig, grid_actions
from cablecast.motion.feasibility import check_actions
from cablecast.motion.polar_cast import PolarReach
from cablecast.motion.servo import ServoModel
from cablecast.track import TrialStatus
from cablecast.workspace import Workspace

if TYPE_CHECKING:
    from shapely import Polygon

R0_CHOICES = (0.6, 1.0, 2.0)
"""Distances of the polar origin that the paper compares [m] (section V-E)."""
V_MAX_CHOICES = (1.2, 1.5, 1.8)
"""Speeds that the paper compares [m/s] (section V-E)."""
GRID_COUNTS = (15, 15, 15)
"""Values of theta1, theta2 and r2 of the action set A1 (section V-E)."""
GRID_COUNTS_PSI = (10, 10, 10, 5)
"""Values of theta1, theta2, r2 and the wrist turn of the action set A2 (section V-E)."""

HULL_RATIO = 0.1
"""How concave the hull is, in shapely's words: edges longer than this share of the longest edge of
the endpoints' Delaunay triangulation are carved away. 0 hugs the points, 1 is the convex hull. The
paper does not state its own, so every result also says what the neighbours 0.05 and 0.2 give."""
HULL_RATIO_NEIGHBOURS = (0.05, 0.2)

_DISC_SEGMENTS = 180  # Sides of the polygon that stands for the half disc: 0.01 % of its area.


@dataclasses.dataclass(frozen=True, kw_only=True)
class Coverage:
    """What a grid of actions of one combination of system parameters covers.

    Attributes:
        config: The combination: r0 and v_max.
        counts: Values of each action variable in the grid; four where psi is among them.
        feasible_count: Actions of the grid that the arm can follow.
        off_table_share: Share of these whose free end left the table on its way [-].
        endpoint_xy: Where their free ends came to rest [m], shape [action, 2].
        hulls_xy: Closed outlines of the concave hull's parts within the half disc [m], each of
            shape [vertex, 2].
        share: Its area as a share of the half disc [-].
        share_by_ratio: The same at other hull ratios.
    """

    config: MotionConfig
    counts: tuple[int, ...]
    feasible_count: int
    off_table_share: float
    endpoint_xy: NDArray[np.float64]
    hulls_xy: tuple[NDArray[np.float64], ...]
    share: float
    share_by_ratio: dict[float, float]

    @property
    def with_psi(self) -> bool:
        """Whether the wrist turns (the action set A2)."""
        return len(self.counts) == 4

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a JSON file; the endpoints are left out."""
        return {
            "r0": self.config.r0,
            "v_max": self.config.v_max,
            "with_psi": self.with_psi,
            "grid_counts": list(self.counts),
            "action_count": int(np.prod(self.counts)),
            "feasible_count": self.feasible_count,
            "off_table_share": self.off_table_share,
            "hull_ratio": HULL_RATIO,
            "share": self.share,
            "share_by_ratio": {f"{ratio:g}": share for ratio, share in self.share_by_ratio.items()},
            "hulls_xy": [np.round(hull, 4).tolist() for hull in self.hulls_xy],
        }


def measure_coverage(
    config: MotionConfig,
    cable: Cable,
    params: CableParams,
    engine: Engine,
    workspace: Workspace,
    counts: Sequence[int] = GRID_COUNTS,
    servo: ServoModel | None = None,
) -> Coverage:
    """Simulate a grid of actions in one batch, and measure what it covers.

    Args:
        config: The combination of r0 and v_max.
        cable: The cable.
        params: Its parameters, tuned or believed.
        engine: The simulator.
        workspace: Table and arm.
        counts: Values of theta1, theta2, r2 and, for the action set A2, of the wrist turn.
        servo: How the arm follows its set points; exactly where None.

    Raises:
        InputError: No action of the grid is feasible.
    """
    from cablecast.datasets.simulate import simulate_actions

    counts = tuple(int(count) for count in counts)
    grid = grid_actions(ActionRanges.for_config(config), counts)
    actions = grid[check_actions(grid, config, workspace).mask]
    if len(actions) == 0:
        raise InputError(
            f"no action of the grid {counts} with r0 = {config.r0} m and v_max = {config.v_max} "
            "m/s is feasible"
        )
    columns = simulate_actions(actions, cable, params, engine, config, workspace, servo)
    endpoint_xy = np.stack([columns["endpoint_x"], columns["endpoint_y"]], axis=-1)
    endpoint_xy = endpoint_xy[np.all(np.isfinite(endpoint_xy), axis=1)]
    radius = workspace.reach(cable.length)
    hull = concave_hull(endpoint_xy, radius)
    return Coverage(
        config=config,
        counts=counts,
        feasible_count=len(actions),
        off_table_share=float(np.mean(np.array(columns["status"]) == TrialStatus.OFF_TABLE.code)),
        endpoint_xy=endpoint_xy,
        hulls_xy=outlines(hull),
        share=covered_share(hull, radius),
        share_by_ratio={
            ratio: covered_share(concave_hull(endpoint_xy, radius, ratio), radius)
            for ratio in HULL_RATIO_NEIGHBOURS
        },
    )


def concave_hull(endpoint_xy: ArrayLike, radius: float, ratio: float = HULL_RATIO) -> "Polygon":
    """The concave hull of endpoints and their mirror images, cut to the half disc.

    Casts can come to rest behind the robot's base; what they cover there is no target.

    Args:
        endpoint_xy: Endpoints of actions for one side [m], shape [action, 2].
        radius: Radius of the half disc, r_max + r_c [m].
        ratio: See `HULL_RATIO`.
    """
    shapely = _shapely()
    points = np.asarray(endpoint_xy, dtype=float)
    both_sides = np.concatenate([points, mirror_xy(points)])
    if not 0.0 <= ratio <= 1.0:
        raise InputError(f"hull ratio = {ratio} is outside [0, 1]")
    hull = shapely.concave_hull(shapely.MultiPoint(both_sides), ratio=ratio)
    return shapely.intersection(shapely.make_valid(hull), half_disc(radius))  # pyright: ignore


def half_disc(radius: float) -> "Polygon":
    """The reachable half disc in front of the robot as a polygon.

    Args:
        radius: r_max + r_c [m].
    """
    angle = np.linspace(-np.pi / 2, np.pi / 2, _DISC_SEGMENTS + 1)
    return _shapely().Polygon(radius * np.stack([np.sin(angle), np.cos(angle)], axis=-1))


def polar_casting_region(cable: Cable, workspace: Workspace) -> "Polygon":
    """Where polar casting can lay the cable's endpoint, see `PolarReach`, as a polygon.

    Args:
        cable: Gives r_c.
        workspace: Gives the arm's reach, the table, and the edge of the robot's own table.
    """
    return _shapely().Polygon(PolarReach.of(cable, workspace).outline())


def covered_share(region: "Polygon", radius: float) -> float:
    """Area of a region as a share of the half disc [-].

    Args:
        region: A region within the half disc.
        radius: r_max + r_c [m].
    """
    return float(region.area / half_disc(radius).area)


def outlines(region: "Polygon") -> tuple[NDArray[np.float64], ...]:
    """The closed outline of each part of a region [m], each of shape [vertex, 2]."""
    parts = _shapely().get_parts(region)
    return tuple(np.asarray(part.exterior.coords) for part in parts if part.area > 0)


def _shapely():
    try:
        import shapely
    except ImportError:
        raise MissingExtraError("shapely", "report", "measuring coverage") from None
    return shapely
