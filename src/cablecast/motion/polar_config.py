"""Settings of polar casting: the lift, the swing in the vertical plane, and the slow pull."""

import dataclasses

from cablecast.cable import Cable
from cablecast.checks import check_ranges


@dataclasses.dataclass(frozen=True, kw_only=True)
class Swing:
    """The fixed casting motion in the vertical plane, by the points it passes.

    It draws the gripper back, throws it forward and up, tips it up and lowers it behind the cable
    that flies out, and sets it down. Heights run from 0 where the gripper comes down to 1 where the
    cable hangs, radii likewise, so that one swing serves every cable and every landing.

    The points were searched with the fast engine over the three presets, with cables of other mass,
    stiffness and friction than believed, with servos that lag behind and with swings up to 4 %
    faster or slower, from the states in which lifts left the cable swinging a little: for the cable
    to come down taut and straight. A cable that lands slack folds to one side, and magnifies how it
    swung aside before.

    Attributes:
        durations: From each point to the next [s]; the first from the hanging cable to the first
            point, the last to the gripper's rest.
        draw_back: How far the gripper is drawn back at the first point [m].
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

    The lift keeps the free end on the table for as long as it can (section V-A), for a cable that
    comes off the table aslant swings like a pendulum, which three seconds do not still: the gripper
    drags the cable near the base, rises until the free end must be where the cable shall hang,
    follows an arc about it, a little inside the cable's length, and goes straight up from there.
    The last rise is slow where the free end leaves the table: the lower the speed, the nearer to
    the plumb line the table has let it slide by then. The defaults were searched with the fast
    engine after 10 casts, with cables of other mass, stiffness and friction than believed, for the
    hanging cable to swing the least.

    Attributes:
        hang_radius: Where the cable hangs, from the base axis [m].
        clearance: How far the hanging cable's lowest point would keep above the table if it hung
            straight [m]; its bend at the gripper lifts it by some 10 mm more.
        hang_height_max: How high the arm lifts at most [m]; a longer cable keeps its end on the
            table.
        carry_height: Height at which the cable is carried in front of the base [m].
        carry_radius: Where it is carried to [m].
        carry_speed: Mean speed of that [m/s].
        carry_time_min: It takes at least this long, and so does the rise before it: a faster rise
            near the base asks too much of the wrist [s].
        draw_radius: Where it is dragged to at that height [m].
        rise_radius: Where the gripper is while it rises [m].
        arc_share: Share of the cable's length at which the arc about the free end closes [-].
        bend_out_share, bend_up_share: Shares of `bend_offsets` that the place of the free end and
            the cable's length allow for [-].
        draw_time, rise_time, arc_time, lift_time: How long these moves and the last, straight lift
            take [s].
        hang_time: How long the cable hangs to come to rest [s] (section V-A).
        swing: The casting motion.
        cast_radius: Where the gripper comes down at most [m]: so far short of r_max that it can
            swing out beyond, and that the elbow is not stretched.
        reach_margin: The swing's outermost point keeps this far within r_max [m]: the spline
            through it goes on by a little less.
        table_margin: How far inside the table's edges the cable's endpoint lands at least [m].
        settle_time: From the end of the swing to the pull [s].
        pull_speed: Mean speed of the slow pull [m/s].
        pull_time_min: It takes at least this long [s].
    """

    hang_radius: float = 0.483
    clearance: float = 0.005
    hang_height_max: float = 0.73
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
                "hang_radius": (0.2, 0.9, "m"),
                "carry_radius": (0.2, 0.9, "m"),
                "draw_radius": (0.2, 0.9, "m"),
                "rise_radius": (0.1, 0.9, "m"),
                "arc_share": (0.5, 1.0, ""),
                "bend_out_share": (0.0, 2.0, ""),
                "bend_up_share": (0.0, 2.0, ""),
                "draw_time": (0.2, 30.0, "s"),
                "rise_time": (0.2, 30.0, "s"),
                "arc_time": (0.2, 30.0, "s"),
                "clearance": (0.0, 0.3, "m"),
                "hang_height_max": (0.1, 2.0, "m"),
                "carry_height": (0.02, 0.5, "m"),
                "carry_speed": (0.01, 1.0, "m/s"),
                "carry_time_min": (0.1, 10.0, "s"),
                "lift_time": (0.2, 30.0, "s"),
                "hang_time": (0.1, 30.0, "s"),
                "cast_radius": (0.3, 1.5, "m"),
                "reach_margin": (0.0, 0.3, "m"),
                "table_margin": (0.0, 0.5, "m"),
                "settle_time": (0.0, 10.0, "s"),
                "pull_speed": (0.01, 1.0, "m/s"),
                "pull_time_min": (0.1, 10.0, "s"),
            },
            "polar casting",
        )

    def hang_height(self, cable: Cable) -> float:
        """Height of the gripper above the table while the cable hangs [m]."""
        height = cable.length + cable.attachment_length + self.clearance
        return min(height, self.hang_height_max)
