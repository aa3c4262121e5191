"""Settings of polar casting: the lift, the swing in the vertical plane, and the slow pull."""

import dataclasses

from cablecast.cable import Cable
from cablecast.checks import check_ranges
from cablecast.workspace import Workspace

_SAME_REACH = 1.05
"""Reach as a multiple of the paper's up to which the paper's radii serve."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Swing:
    """Fixed casting motion in the vertical plane, given by three via points.

    The gripper draws back, moves fast forward and up, tips up, follows the flying cable downwards,
    and comes down. Heights run from 0 where it comes down to 1 where the cable hangs; radii run
    from 0 at the hanging cable to 1 where it comes down. One swing thus serves every cable and
    every landing.

    The via points were optimised with the fast engine for the cable to land taut and straight. The
    search covered the three presets, perturbed masses, stiffnesses and frictions, lagging servos,
    swings up to 4 % faster or slower, and the slight swinging that a lift leaves behind. A cable
    that lands slack folds to one side and amplifies its earlier sideways swing.

    Attributes:
        durations: Durations between the points [s]: from the hanging cable to the first point, to
            the second, to the third, and to rest.
        draw_back: Distance that the gripper is drawn back at the first point [m].
        radii: Share of the way out at the second and the third point [-].
        heights: Share of the hanging height at the three points [-].
        pitches: Pitch of the gripper at the three points [rad]; it is level at both ends.
    """

    durations: tuple[float, float, float, float] = (0.809, 0.213, 0.497, 0.569)
    draw_back: float = 0.072
    radii: tuple[float, float] = (0.371, 1.129)
    heights: tuple[float, float, float] = (1.207, 0.996, 0.929)
    pitches: tuple[float, float, float] = (0.560, 0.511, 0.996)

    @property
    def duration(self) -> float:
        """Time from the hanging cable to the gripper's rest [s]."""
        return sum(self.durations)


@dataclasses.dataclass(frozen=True, kw_only=True)
class PolarCastConfig:
    """Settings of the lift, the swing and the pull.

    The lift keeps the free end on the table as long as possible (section V-A). A cable that leaves
    the table at an angle swings like a pendulum, and three seconds do not damp it out. The gripper
    drags the cable near the base and rises until the free end is below the hanging point. It then
    follows an arc about the free end, slightly smaller than the cable's length, and goes straight
    up. The last rise is slow where the free end leaves the table: at a lower speed, the end has
    slid closer to the plumb line by then. The defaults were optimised with the fast engine after 10
    casts, with perturbed masses, stiffnesses and frictions, for the least swing of the hanging
    cable.

    Attributes:
        hang_radius: Distance of the hanging cable from the base axis [m].
        clearance: Height of the lowest point above the table for a cable that hangs straight [m];
            the bend at the gripper adds about 10 mm.
        hang_height_max: Largest height of the lift [m]; a longer cable keeps its end on the table.
            The swing rises a fifth higher, where the arm can follow it up to 0.71 m.
        carry_height: Height at which the cable is carried in front of the base [m].
        carry_radius: Radius to which it is carried [m].
        carry_speed: Mean speed of the carry [m/s].
        carry_time_min: Shortest duration of the carry and of the rise before it [s]; a faster rise
            near the base demands too much of the wrist.
        draw_radius: Radius to which the cable is dragged at that height [m].
        rise_radius: Radius of the gripper while it rises [m].
        arc_share: Final radius of the arc about the free end, as a share of the cable's length [-].
        bend_out_share, bend_up_share: Shares of `bend_offsets` by which the place of the free end
            and the cable's length are corrected [-].
        draw_time, rise_time, arc_time, lift_time: Durations of these moves and of the final,
            straight lift [s].
        cast_rise_time: Duration of the rise of a polar cast [s], in place of `rise_time`. The cable
            was dragged aside and lies askew of the plane; with a faster rise its free end swings in
            over the base.
        hang_time: Time for the hanging cable to come to rest [s] (section V-A).
        swing: Casting motion.
        cast_radius: Largest radius at which the gripper comes down [m]. It leaves room below r_max
            for the gripper to swing out beyond it and for the elbow to stay bent.
        reach_margin: Distance of the swing's outermost point within r_max [m]; the spline
            overshoots this point by slightly less.
        table_margin: Smallest distance of the landed endpoint from the table's edges [m].
        settle_time: Pause between the swing and the pull [s].
        pull_speed: Mean speed of the slow pull [m/s].
        pull_time_min: Shortest duration of the pull [s].
    """

    hang_radius: float = 0.483
    clearance: float = 0.005
    hang_height_max: float = 0.70
    carry_height: float = 0.19
    carry_radius: float = 0.784
    carry_speed: float = 0.50
    carry_time_min: float = 0.7
    draw_radius: float = 0.359
    rise_radius: float = 0.265
    arc_share: float = 0.981
    bend_out_share: float = 0.379
    bend_up_share: float = 0.593
    draw_time: float = 0.919
    rise_time: float = 1.293
    cast_rise_time: float = 3.0
    arc_time: float = 1.505
    lift_time: float = 3.727
    hang_time: float = 3.0
    swing: Swing = dataclasses.field(default_factory=Swing)
    cast_radius: float = 0.88
    reach_margin: float = 0.01
    table_margin: float = 0.01
    settle_time: float = 0.5
    pull_speed: float = 0.12
    pull_time_min: float = 0.5

    def __post_init__(self):
        check_ranges(
            self,
            {
                "hang_radius": (0.2, 1.7, "m"),
                "carry_radius": (0.2, 1.7, "m"),
                "draw_radius": (0.2, 1.7, "m"),
                "rise_radius": (0.1, 1.7, "m"),
                "arc_share": (0.5, 1.0, ""),
                "bend_out_share": (0.0, 2.0, ""),
                "bend_up_share": (0.0, 2.0, ""),
                "draw_time": (0.2, 30.0, "s"),
                "rise_time": (0.2, 30.0, "s"),
                "cast_rise_time": (0.2, 30.0, "s"),
                "arc_time": (0.2, 30.0, "s"),
                "clearance": (0.0, 0.3, "m"),
                "hang_height_max": (0.1, 2.0, "m"),
                "carry_height": (0.02, 0.5, "m"),
                "carry_speed": (0.01, 1.0, "m/s"),
                "carry_time_min": (0.1, 10.0, "s"),
                "lift_time": (0.2, 30.0, "s"),
                "hang_time": (0.1, 30.0, "s"),
                "cast_radius": (0.3, 1.9, "m"),
                "reach_margin": (0.0, 0.3, "m"),
                "table_margin": (0.0, 0.5, "m"),
                "settle_time": (0.0, 10.0, "s"),
                "pull_speed": (0.01, 1.0, "m/s"),
                "pull_time_min": (0.1, 10.0, "s"),
            },
            "polar casting",
        )

    @classmethod
    def of(cls, workspace: Workspace) -> "PolarCastConfig":
        """Return the settings for an arm's reach.

        The radii of an arm that reaches farther grow with its reach: so near to its base as the
        paper's its joints would have to turn faster than they can.

        Args:
            workspace: Gives the reach r_max.
        """
        config, share = cls(), workspace.r_max / Workspace().r_max
        if share <= _SAME_REACH:
            return config
        names = ("hang_radius", "carry_radius", "draw_radius", "rise_radius", "cast_radius")
        return dataclasses.replace(config, **{n: share * getattr(config, n) for n in names})

    def hang_height(self, cable: Cable) -> float:
        """Height of the gripper above the table while the cable hangs [m]."""
        height = cable.length + cable.attachment_length + self.clearance
        return min(height, self.hang_height_max)
