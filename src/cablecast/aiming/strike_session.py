"""StrikeSession: goals in the air, swings at them, and what follows from each.

All swings of a cable count for each goal: an aim at a new one starts from those that passed nearest
to it (`StrikeAim`). The servo of the arm is identified from the joints that it reports in the first
swings, and the engine's arm then follows its set points so.
"""

import dataclasses
import os

import numpy as np

from cablecast.aiming.config import AimConfig
from cablecast.aiming.session import CastSession
from cablecast.aiming.strike import StrikeAim, StrikePrior, StrikeTry
from cablecast.cast import Cast, EndpointTrack, Proposal, TrialStatus
from cablecast.conventions import Array
from cablecast.data.store import CastStore
from cablecast.engines.swing import SAMPLE_DT
from cablecast.errors import InputError, TargetError
from cablecast.motion.joint_move import JointMove, JointMoves, SwingPlane
from cablecast.setup import Setup
from cablecast.task import STRIKE, Expectation, Goal, MissLaw, closest
from cablecast.tuning.servo import can_identify_servo, identify_servo
from cablecast.tuning.tips import TipPosterior

NEAREST = 8
"""Swings of other goals that an aim starts from: a plan takes the longer, the more there are."""
SERVO_COUNT = 3
"""First swings whose joints tell the servo."""
GAP_MAX = 0.05
"""Longest time without a sight of the tip that is bridged by a line [s]; a path ends before it."""
SCATTER = 0.005
"""Deviation of the closest point of equal swings along each axis, camera included [m]."""
LOST_TRIALS = 10.0
"""Prior strength of the belief that few swings are lost [swings]."""


class StrikeSession(CastSession):
    """Aims at goals one after another, and corrects by every swing.

    No swing is stopped, as `propose` refuses what cannot be struck, and no new fit is ever due: the
    cable is fitted with each swing where it is worth it.

    Args:
        setup: Set-up with a strike section.
        prior: Simulated swings of cables as they are believed to be, with this set-up.
        out: Folder that keeps the swings; none if None.
        config: Settings; `tries`, `within_pct`, `force` and `seed` are used.

    Raises:
        InputError: The folder holds something else, or swings of another set-up.
    """

    task = STRIKE

    def __init__(
        self,
        setup: Setup,
        prior: StrikePrior,
        *,
        out: str | os.PathLike[str] | None = None,
        config: AimConfig | None = None,
    ):
        self.setup, self.config = setup, config or AimConfig()
        self.store = CastStore(setup, out, STRIKE)
        self.store.set_tolerance(self.config.within_pct)
        self.moves = JointMoves.of(setup)
        self.plane = SwingPlane.of(self.moves)
        self.sight = None
        self._believed = prior
        self._condition()

    def _condition(self) -> None:
        # Arm and cable are fitted anew, where they are needed.
        self._prior, self._servo_count = self._believed, 0
        self._posterior: TipPosterior | None = None
        self._aim: tuple[tuple, StrikeAim] | None = None

    @property
    def prior(self) -> StrikePrior:
        """Simulated swings; their model has the servo that the first swings told."""
        rows = [number for number, _ in self.active_casts()][:SERVO_COUNT]
        if rows and len(rows) != self._servo_count:
            self._servo_count = len(rows)
            casts = self.store.dataset(rows)
            if can_identify_servo(casts):
                respond = identify_servo(casts).model.respond
                model = dataclasses.replace(self._prior.model, respond=respond)
                self._prior = dataclasses.replace(self._prior, model=model)
        return self._prior

    @property
    def posterior(self) -> TipPosterior | None:
        """What the swings told of the cable; None before the first fit."""
        return self._posterior

    def propose(self, target_xy: Goal) -> Proposal:
        """Propose the next swing at a goal, and say what to expect of it.

        Raises:
            TargetError: No move of any cable that this may be comes near the goal.
        """
        goal = target_xy
        aim = self._aim_at(goal)
        unit = aim.propose()
        self._posterior = aim.posterior or self._posterior
        found = aim.outcomes(unit)
        found = found[np.isfinite(found).all(axis=1)]
        lost = sum(not cast.landed for _, cast in self.active_casts())
        spread = np.cov(found.T) if len(found) > 1 else np.zeros((3, 3))
        return Proposal(
            goal=goal,
            number=len(self.store),
            try_number=len(self.casts_at(goal.value)) + 1,
            action=self.moves.move(unit),
            expected=Expectation(
                mean=found.mean(axis=0) if len(found) else goal.value,
                covariance=spread + SCATTER**2 * np.eye(3),
                law=self.miss_laws().get(JointMove.family, MissLaw()),
                scatter=SCATTER,
                failure=(lost + 0.1) / (len(self.active_casts()) + LOST_TRIALS),
            ),
            inside_coverage=len(found) > 0,
        )

    def observe(self, proposal: Proposal, track: EndpointTrack) -> Cast:
        """Take in a proposed swing that was made, and what the rig saw of it.

        Raises:
            InputError: The proposal is not the next swing of the session.
        """
        self._check_next(proposal)
        if track.endpoint_z is None:
            if track.status is TrialStatus.OK:
                raise InputError("the track of a strike needs the height of the tip, endpoint_z")
            track = dataclasses.replace(track, endpoint_z=np.full(len(track.times), np.nan))
        cast = Cast.of_motion(proposal.trajectory, track, "aim", proposal)
        self.store.add(cast)
        return cast

    def _aim_at(self, goal: Goal) -> StrikeAim:
        """Return an aim at a goal that knows all swings at it, and the nearest others."""
        active = self.active_casts()
        key = (tuple(goal.value.tolist()), goal.within_pct, tuple(number for number, _ in active))
        if self._aim is not None and self._aim[0] == key:
            return self._aim[1]
        aim = StrikeAim(
            self.prior,
            goal.value,
            within=goal.within_pct / 100.0 * self.setup.cable.length,
            seed=self.config.seed,
        )
        swings = []
        for number, cast in active:
            tip = sampled(cast.track)
            if not isinstance(cast.action, JointMove):
                continue
            if len(tip) < 3:
                aim.lost.append(self.moves.unit_of(cast.action))
                continue
            miss = float(closest(tip, goal.value)[0])
            swings.append((not cast.is_at(goal.value), miss, number, cast.action, tip))
        others = sorted(row[:3] for row in swings if row[0])[:NEAREST]
        for row in swings:
            if not row[0] or row[:3] in others:
                _, miss, _, action, tip = row
                unit = self.moves.unit_of(action)
                aim.tries.append(StrikeTry(unit=unit, tip=tip, miss=miss))
        aim.posterior = self._posterior
        self._aim = key, aim
        return aim


def sampled(track: EndpointTrack) -> Array:
    """Return the tip of a track every `SAMPLE_DT` from the start on, until it is not seen [m].

    Shape [sample, 3]; empty for a track without a path.
    """
    path, times = track.path, track.times
    seen = np.isfinite(path).all(axis=1)
    if track.status is not TrialStatus.OK or path.shape[1] != 3 or seen.sum() < 2:
        return np.zeros((0, 3))
    path, times = path[seen], times[seen]
    late = np.flatnonzero(np.diff(times, prepend=0.0) > GAP_MAX)
    if len(late):
        path, times = path[: late[0]], times[: late[0]]
    if len(times) < 2:
        return np.zeros((0, 3))
    grid = SAMPLE_DT * np.arange(int(times[-1] / SAMPLE_DT + 1e-9) + 1)
    return np.stack([np.interp(grid, times, values) for values in path.T], axis=-1)


def nearest_point(prior: StrikePrior, goal: Array) -> tuple[float, Array]:
    """Return how near believed cables come to a goal [m], shape [3], and the nearest point."""
    found, places = closest(prior.tips, goal)
    row = np.unravel_index(np.argmin(found), found.shape)
    return float(found[row]), np.asarray(prior.tips[(*row, round(float(places[row])))], float)


def check_reach(session_prior: StrikePrior, goal: Goal, plane: SwingPlane) -> None:
    """Refuse a goal that no believed cable strikes, with the nearest point that one does.

    Raises:
        TargetError: The goal is out of reach.
    """
    distance, point = nearest_point(session_prior, goal.value)
    bound = goal.within_pct / 100.0 * goal.setup.cable.length + REACH_SLACK
    if distance > bound:
        (ahead, height, _), (u, v, _) = plane.coordinates(np.stack([goal.value, point]))
        raise TargetError(
            f"target {ahead:.2f} m ahead, {height:.2f} m high cannot be struck: the nearest point "
            f"that a swing of this cable passes is {u:.2f} m ahead, {v:.2f} m high, "
            f"{100 * distance:.0f} cm away"
        )


REACH_SLACK = 0.08
"""Distance from all simulated swings of believed cables beyond which a goal is out of reach [m]:
between some hundred of them there are others."""
