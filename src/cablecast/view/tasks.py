"""What differs on the page by what is aimed at: points of the table, or points in the air."""

import abc
import dataclasses
import math
import pathlib
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.aiming.session import AimSession, CastSession
from cablecast.aiming.strike_session import StrikeSession, check_reach
from cablecast.cast import Cast, Proposal
from cablecast.conventions import Array, polar_to_xy, xy_to_polar
from cablecast.engines.base import Engine
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import CablecastError, InputError
from cablecast.motion.action import mirror_to_right
from cablecast.motion.casting import Action
from cablecast.motion.joint_move import JointMoves, SwingPlane
from cablecast.motion.limits import check_grip_paths
from cablecast.motion.trajectory import JointPath, Trajectory, plan_trajectory
from cablecast.pipeline.aim import prepare_aim
from cablecast.pipeline.strike import prepare_strike
from cablecast.report.strike_page import envelope_text, plane_text, target_text
from cablecast.report.words import change_text
from cablecast.rigs.swings import move_envelope
from cablecast.runs.progress import ProgressCallback
from cablecast.setup import Setup
from cablecast.view.film import KINDS, FilmConfig, write_film
from cablecast.view.look import ShownCast, open_collection
from cablecast.view.shapes import (
    BLUE,
    MAP_COLORS,
    MAP_FULL_SHARE,
    MapPicture,
    map_image,
    miss_map,
    passed_map,
    swing_extent,
)
from cablecast.view.strike_film import STRIKE_KINDS, write_strike_film

_EDGE = 0.1  # Least distance of a suggested target from the table's edges [m].

Session = TypeVar("Session", bound=CastSession)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Preview:
    """A planned cast and what to expect of it.

    Attributes:
        proposal: Planned cast, with its ellipse.
        cast: Simulated cast.
        limit_shares: Largest share of each joint's speed and acceleration limits [-], [2, joint].
        margin: Predicted distance of the free end from the table's edges [m]; negative off it, NaN
            without a table.
    """

    proposal: Proposal
    cast: ShownCast
    limit_shares: NDArray[np.float64]
    margin: float = math.nan


NumberField = tuple[str, float, float, float, float]
"""A number that a person types: its label, value, least and largest value, and step."""

Filming = Callable[[pathlib.Path, FilmConfig, ProgressCallback], None]
"""Writes a film to a file."""


class PageTask(abc.ABC, Generic[Session]):
    """A task as the page shows it.

    Args:
        setup: Set-up of the rig.
        engine: Simulates previews.

    Attributes:
        verb: What is done with the cable.
        prepare: Gets ready for the first target, and returns the session of a folder.
        moves_first: Whether the arm moves to get ready.
        plans_long: Whether a plan takes so long that a person is told of it.
        heads: What to do next, by the name of the phase, where it is particular.
        steps: Steps up to the first cast; the last two are to point and to cast.
        lost: What becomes of a cast that fails.
        inside: What an outcome does inside the region that was stated.
        map_name: Name of the map.
        shows_map: Whether it is shown from the start.
        sliders: Parameters that have a slider in the tab Look.
        film_kinds: Endings of films.
    """

    verb: ClassVar[str]
    prepare: ClassVar[Callable[..., CastSession]]
    moves_first: ClassVar[bool]
    plans_long: ClassVar[bool]
    heads: ClassVar[Mapping[str, str]]
    steps: ClassVar[tuple[str, ...]]
    lost: ClassVar[str]
    inside: ClassVar[str]
    map_name: ClassVar[str]
    shows_map: ClassVar[bool]
    sliders: ClassVar[tuple[str, ...]]
    film_kinds: ClassVar[tuple[str, ...]]

    def __init__(self, setup: Setup, engine: Engine):
        self.setup, self.engine = setup, engine

    @staticmethod
    def of(setup: Setup, engine: Engine) -> "PageTask":
        """Return the task of a laboratory."""
        return (PageLanding if setup.strike is None else PageStrike)(setup, engine)

    @abc.abstractmethod
    def propose(self, session: Session, target: ArrayLike) -> Proposal:
        """Propose the next cast at a target [m], shape [2], or [3] in the air.

        Raises:
            TargetError: It is not finite, or cannot be hit.
        """

    @abc.abstractmethod
    def preview(self, session: Session, proposal: Proposal) -> Preview:
        """Return a planned cast as it is simulated."""

    @abc.abstractmethod
    def resting(self) -> ShownCast | None:
        """Return a motion that starts after a reset, or the rest there; None if it is not known."""

    @abc.abstractmethod
    def suggested(self, session: Session, rng: np.random.Generator, count: int) -> Array:
        """Return some targets that simulated casts reach [m], shape [count, k]."""

    @abc.abstractmethod
    def fields(self) -> tuple[NumberField, NumberField]:
        """Return the numbers that a target is typed as."""

    @abc.abstractmethod
    def map(self, session: Session) -> MapPicture:
        """Return where casts can come."""

    @abc.abstractmethod
    def legend(self) -> str:
        """Return what the map means, as HTML."""

    @abc.abstractmethod
    def film(self, folder: pathlib.Path, casts: Sequence[Cast]) -> Filming:
        """Return what films casts of the session in a folder."""

    def rehearse(self, session: Session) -> None:
        """Plan for nobody, where the first plan of a session takes longer than others."""

    def from_typed(self, first: float, second: float) -> Array:
        """Return the target of typed numbers, shape [2]."""
        return np.array([first, second])

    def to_typed(self, flat: Array) -> tuple[float, float]:
        """Return the numbers to type for a place on the surface [m], shape [2]."""
        return round(float(flat[0]), 3), round(float(flat[1]), 3)

    def place(self, value: Array) -> str:
        """Return words for a target or an outcome, shape [k]."""
        return target_text(value, self.setup)

    @abc.abstractmethod
    def exact_place(self, value: Array) -> str:
        """Return more words, or digits, for a target or an outcome, shape [k]."""

    @abc.abstractmethod
    def news(self, session: Session, cast: Cast) -> str:
        """Return what follows from a cast with an outcome."""

    def danger(self, session: Session | None) -> str:
        """Return what a person is asked before the arm moves."""
        return "Is everybody out of its reach, and the emergency stop at hand?"


class PageLanding(PageTask[AimSession]):
    """Casts onto the table."""

    verb, prepare = "Cast", staticmethod(prepare_aim)
    moves_first, plans_long = True, False
    heads: ClassVar[Mapping[str, str]] = {}
    # The first three are the steps of `prepare_aim`.
    steps = (
        "**Cast a few times.** The rig casts, and it is seen where the cable goes.",
        "**Fit.** The simulated cable is changed until it moves as yours did.",
        "**Simulate.** It casts in every way that the arm can move.",
        "**Point.** Choose a target with a click: a ghost shows the planned cast.",
        "**Cast.** Watch the cable, and read how far it missed. Then correct, and cast again.",
    )
    lost = "hidden or off the table"
    inside = "landed"
    map_name, shows_map = "Where it can land", False
    # Of both frictions the product alone counts.
    sliders = (
        "bend_stiffness",
        "twist_stiffness",
        "mass",
        "endpoint_mass",
        "worksurface_friction",
        "rolling_friction",
        "linear_damping",
    )
    film_kinds = KINDS

    def propose(self, session: AimSession, target: ArrayLike) -> Proposal:
        """Propose the next cast at a target."""
        return session.propose(target)

    def preview(self, session: AimSession, proposal: Proposal) -> Preview:
        """Return a planned cast as it is simulated with the cable of the training casts."""
        table, model = self.setup.workspace, session.model.policy.model
        margin = float(table.edge_distance(proposal.expected.mean))
        if isinstance(proposal.action, Action):
            rightward, _ = mirror_to_right(proposal.action.to_array()[None])
            margin = float(model.predict_margin(rightward)[0])
        limits = check_grip_paths(proposal.trajectory.grip_path, self.setup)
        dynamics = model.settings.dynamics if model.settings.is_simulated else None
        return Preview(
            proposal=proposal,
            cast=self._simulated(proposal.trajectory, dynamics),
            limit_shares=np.asarray(limits.peaks[0, 1:] / limits.bounds[1:]),
            margin=margin,
        )

    def _simulated(self, trajectory: Trajectory, dynamics: Dynamics | None = None) -> ShownCast:
        dynamics = dynamics or Dynamics.of(None, self.setup)
        return ShownCast.simulated(trajectory, self.setup, self.engine, dynamics)

    def resting(self) -> ShownCast | None:
        """Return a motion from its start; None where none starts after a reset."""
        action = Action(theta1=np.radians(-30), theta2=np.radians(20), r2=0.6)
        try:
            return self._simulated(plan_trajectory(action, self.setup))
        except CablecastError:
            return None

    def suggested(self, session: AimSession, rng: np.random.Generator, count: int) -> Array:
        """Return landings of simulated casts, half of them mirrored."""
        xy, table = session.model.policy.predicted_xy, self.setup.workspace
        xy = xy[table.edge_distance(xy) > _EDGE]
        xy = xy[np.linalg.norm(xy, axis=1) < table.reach(self.setup.cable.length)]
        if not len(xy):
            raise InputError(
                f"no simulated cast lands {_EDGE} m within the table's edges: click on the table"
            )
        sides = np.stack([rng.choice([-1, 1], count), np.ones(count)], axis=1)
        return rng.choice(xy, count) * sides

    def rehearse(self, session: AimSession) -> None:
        """Plan for nobody: the first plan of a session takes several times as long as others."""
        landings = session.model.policy.predicted_xy
        away = np.linalg.norm(landings - np.median(landings, axis=0), axis=1)
        self.preview(session, session.propose(landings[np.argmin(away)]))

    def fields(self) -> tuple[NumberField, NumberField]:
        """Return the distance from the base and the angle."""
        table = self.setup.workspace
        reach = table.reach(self.setup.cable.length)
        # A table may reach behind the base.
        side = 180.0 if table.y_min < 0.0 else 90.0
        return (
            ("r [m]", round(min(1.1, reach), 3), 0.0, round(reach, 3), 0.01),
            ("theta [deg]", 0.0, -side, side, 0.5),
        )

    def from_typed(self, first: float, second: float) -> Array:
        """Return the target of a distance [m] and an angle [deg]."""
        return polar_to_xy([first, np.radians(second)])

    def to_typed(self, flat: Array) -> tuple[float, float]:
        """Return the distance [m] and the angle [deg] of a target."""
        r, theta = xy_to_polar(flat)
        return round(float(r), 3), round(math.degrees(theta), 1)

    def exact_place(self, value: Array) -> str:
        """Return a place in polar coordinates."""
        r, theta = xy_to_polar(value)
        return f"{r:.3f} m, {math.degrees(theta):z.1f}°"

    def news(self, session: AimSession, cast: Cast) -> str:
        """Return what the simulators make of a landing."""
        return change_text(cast, session)

    def map(self, session: AimSession) -> MapPicture:
        """Return how far casts are expected to miss."""
        table = self.setup.workspace
        return MapPicture(
            image=map_image(miss_map(session.model.policy), self.setup),
            low=np.array([-table.half_width, table.y_min]),
            high=np.array([table.half_width, table.y_max]),
        )

    def legend(self) -> str:
        """Return the scale of the map of expected misses, as HTML."""
        colors = ", ".join(f"rgb({r:.0f}, {g:.0f}, {b:.0f})" for r, g, b in MAP_COLORS)
        ends = np.linspace(0.0, 1.0, len(MAP_COLORS))
        ends *= 100.0 * MAP_FULL_SHARE * self.setup.cable.length
        ticks = "".join(f"<span>{end:.0f} cm</span>" for end in ends[:-1])
        return (
            "Expected miss of a first cast"
            f'<div style="height: 1em; background: linear-gradient(90deg, {colors})"></div>'
            '<div style="display: flex; justify-content: space-between">'
            f"{ticks}<span>{ends[-1]:.0f} cm and more</span></div>"
        )

    def film(self, folder: pathlib.Path, casts: Sequence[Cast]) -> Filming:
        """Return what films casts from behind the robot, next to the simulator."""
        collection = open_collection(folder)
        shots = [collection.shot(one.number, self.engine) for one in casts]
        return lambda path, config, report: write_film(path, self.setup, shots, config, report)


class PageStrike(PageTask[StrikeSession]):
    """Strikes in the air."""

    verb, prepare = "Swing", staticmethod(prepare_strike)
    moves_first, plans_long = False, True
    heads: ClassVar[Mapping[str, str]] = {
        "NO_MODEL": "Get ready first: swings of cables that this may be are simulated.",
        "READY": "Click on the plane of the swing to choose a target.",
        "PLANNED": "Look at the plan, then swing.",
        "LANDED": "Correct and swing again, or choose another target.",
    }
    steps = (
        "**Simulate.** All cables that this may be swing; the arm does not move.",
        "**Point.** Choose a target with a click on the plane: a ghost shows the planned swing.",
        "**Swing.** Watch the tip, and read how far it missed. Then correct, and swing again.",
    )
    lost = "lost"
    inside = "passed"
    map_name, shows_map = "Where it can strike", True
    sliders = (
        "bend_stiffness",
        "mass",
        "endpoint_mass",
        "drag_coefficient",
        "drag_ratio",
        "damping_time",
    )
    film_kinds = STRIKE_KINDS

    def propose(self, session: StrikeSession, target: ArrayLike) -> Proposal:
        """Propose the next swing at a target, given in space or in the plane."""
        (goal,) = session.goals(target)
        if not session.config.force:
            check_reach(session.prior, goal, session.plane)
        return session.propose(goal)

    def preview(self, session: StrikeSession, proposal: Proposal) -> Preview:
        """Return a planned swing as it is simulated with the likeliest cable."""
        posterior, limits = session.posterior, self.setup.arm.limits
        cable = self.setup.cable if posterior is None else posterior.cable
        joints = proposal.trajectory.joint_path
        if joints is None:
            raise InputError("a swing needs the joints of a motion, and this one has none")
        asked = joints.qd, np.diff(joints.qd, axis=0) / np.diff(joints.times)[:, None]
        bounds = limits.velocity, limits.acceleration
        shares = [np.abs(row).max(axis=0) / high for row, high in zip(asked, bounds, strict=True)]
        return Preview(
            proposal=proposal,
            cast=ShownCast.swung(proposal.trajectory, session.prior.model, cable),
            limit_shares=np.array(shares),
        )

    def resting(self) -> ShownCast:
        """Return the cable as it hangs straight from the stick at the start."""
        moves, cable = JointMoves.of(self.setup), self.setup.cable
        q, times = np.array([moves.start] * 2), np.arange(2.0)
        root = moves.stick.root(moves.arm.frames(q[0])[-1])
        drop = np.linspace(0.0, cable.length + cable.attachment_length, 3)
        nodes = np.array([root - drop[:, None] * [0.0, 0.0, 1.0]] * 2)
        return ShownCast(
            times=times,
            path=nodes[:, -1],
            nodes=nodes,
            joint_path=JointPath(times=times, q=q, qd=np.zeros_like(q)),
        )

    def suggested(self, session: StrikeSession, rng: np.random.Generator, count: int) -> Array:
        """Return points that the tips of believed cables pass."""
        points = np.asarray(session.prior.tips, dtype=float).reshape(-1, 3)
        points = rng.choice(points[np.isfinite(points[:, 0])], count)
        plane = session.plane
        return plane.points(plane.coordinates(points)[:, :2])

    def fields(self) -> tuple[NumberField, NumberField]:
        """Return the distance ahead and the height."""
        low, high = swing_extent(self.setup)
        ahead, height = np.clip([1.2, 0.9], low, high).round(2).tolist()
        (near, far), (bottom, top) = np.round(np.stack([low, high], axis=1), 2).tolist()
        return ("ahead [m]", ahead, near, far, 0.01), ("height [m]", height, bottom, top, 0.01)

    def news(self, session: StrikeSession, cast: Cast) -> str:
        """Return where the tip passed."""
        note = f"{cast.track.note}. " if cast.track.note else ""
        return f"{note}the nearest point of its path is {self.exact_place(cast.outcome)}"

    def exact_place(self, value: Array) -> str:
        """Return a place in the plane of the swing."""
        return plane_text(value, SwingPlane.of(JointMoves.of(self.setup)))

    def danger(self, session: StrikeSession | None) -> str:
        """Return the box that the cable can be in, and what a person is asked."""
        if session is None:
            return super().danger(session)
        box = envelope_text(*move_envelope(self.setup, session.prior.units))
        ask = "Are people and things out of it, and is the emergency stop at hand?"
        return f"{box[:1].upper()}{box[1:]}. {ask}"

    def map(self, session: StrikeSession) -> MapPicture:
        """Return where tips of believed cables pass."""
        return passed_map(session.prior.tips, self.setup)

    def legend(self) -> str:
        """Return what the map means, as HTML."""
        square = f'<span style="color: rgb{BLUE}">■</span>'
        return f"{square} Simulated swings of cables that this may be pass there"

    def film(self, folder: pathlib.Path, casts: Sequence[Cast]) -> Filming:
        """Return what films swings from the side."""
        return lambda path, config, report: write_strike_film(path, casts, config, report)
