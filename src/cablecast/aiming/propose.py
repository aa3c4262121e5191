"""The choice of a cast: beliefs and casts in, a proposal out.

A `LandingPredictor` says where a cast is expected to land, and how surely, from simulators and from
all real casts so far. For a target, `propose` takes the action with the least expected loss, in
this cast and the next, from the distance left, the uncertainty of the prediction, the scatter of
the action, and the chance of a cast that ends out of sight. So calm casts, which a small change of
the friction barely moves, are taken where they reach. After a cast near a target the process is
almost certain there, so the next action is a small step from the last one, damped by the scatter as
in a Kalman filter. An action that scatters more than expected, or stays far off, loses this
advantage to others.
"""

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cablecast.aiming.polar import PolarLandings
from cablecast.aiming.predictor import Candidates, LandingPredictor
from cablecast.arm.shape import ArmShape, arm_shape, sight_clearance
from cablecast.camera.settings import CameraSight
from cablecast.cast import Proposal
from cablecast.conventions import Array
from cablecast.errors import InputError
from cablecast.learning.landing import central_shifts
from cablecast.learning.policy import COVERAGE_PCT, TABLE_MARGIN, refine_actions, within_ranges
from cablecast.motion.action import ACTION_SIZE, mirror_actions, mirror_to_right
from cablecast.motion.casting import Action, cast_grip_paths
from cablecast.motion.feasibility import check_actions
from cablecast.motion.grip_path import GripPath
from cablecast.motion.polar import PolarCast
from cablecast.motion.trajectory import plan_trajectory
from cablecast.setup import Setup
from cablecast.task import LANDING, Expectation, Goal, Landing, MissLaw, shell_points

# The choice narrows in three steps: candidates whose simulated landings are nearest (at least
# _NEIGHBOR_COUNT, more while candidates times casts stay below _PAIR_COUNT); of these, those whose
# expected landings are nearest, which the ensemble simulates; of these, those with the least
# expected miss. Without an ensemble, more than the last few select for the simulator's own errors.
_NEIGHBOR_COUNT, _PAIR_COUNT, _SIMULATED_COUNT, _SHORTLIST_COUNT = 3000, 5_000_000, 64, 16
# Earlier casts that came this near to a target [cable lengths] are candidates, too.
_EARLIER_COUNT, _EARLIER_REACH = 4, 0.3
# Newton steps of a correction, and the parts of it that are tried until the arm can follow.
_NEWTON_STEPS, _FRACTIONS = 4, (1.0, 0.5, 0.25)
# Parts of the way from a candidate to the action that is expected on the target.
_PARTS = (1.0, 0.75, 0.5, 0.25, 0.0)
# Distances from the edge of a blind place at which casts at a target in it are aimed, too [m].
_BLIND_MARGINS = (0.02, 0.06)

NEAR = 0.08
"""Miss beyond which its size barely matters [cable lengths]."""

NEXT_NEAR, LEFT = 0.04, 0.15
"""The same for the cast after the proposed one, and the share of the variance of the prediction
that it is expected to leave [-]. What a cast shows of the cable corrects the next; what equal
casts scatter by stays, and where no calm cast reaches no correction will."""

CAMERA_HEIGHT = 2.2
"""Height of a camera above the middle of the table, where its place is not known [m]."""

STAYS = (0.6, 0.4)
"""Share of the chance of a hit that a correction has by its size after one miss, and after more
[-]: what a correction did not find stays. Of 60 targets in random laboratories that were missed
once, 0.56 of that hit; of 67 in three laboratories that were missed twice or three times, 0.3 to
0.6."""

POLAR_LEFT, POLAR_COST = 0.02, 0.03
"""Share of the variance that a correction of a polar cast leaves [-], as all polar casts err alike;
and the loss that the 20 s count for by which it takes longer than a sweep [-]."""

MARKER_RADIUS = 0.015
"""Distance from the arm's outline at which a marker of typical size is half hidden [m]."""

SAME_ACTION = np.array([np.radians(0.1), np.radians(0.1), 1e-3, np.radians(0.1), 1e-3])
"""Two actions nearer to each other than this make the same cast [rad, rad, m, rad, -]."""

# Quadrature points of an isotropic Gaussian: shares of equal probability, each at the
# distance from the middle that halves it.
_RINGS, _SPOKES = 4, 8


def propose(
    predictor: LandingPredictor,
    goal: Goal,
    *,
    number: int = 0,
    try_number: int = 1,
    laws: Mapping[str, MissLaw] | None = None,
    sight: CameraSight | None = None,
) -> Proposal:
    """Propose the cast with the least expected loss at a goal, never one made there before.

    Args:
        predictor: Beliefs, conditioned on the casts so far.
        goal: Checked goal.
        number: Number of the cast in its session.
        try_number: Number of the cast at this target. After the first, a small change of an earlier
            action nearly always wins, so fewer other candidates are simulated.
        laws: Law of the landing about the expected one by family of motions; that before any miss
            if a family has none.
        sight: Limits of the camera's sight; None if unknown.

    Raises:
        InputError: The arm can follow no action near this target.
    """
    setup = goal.setup
    target = goal.value / predictor.beliefs.model.units
    goals = [target]
    if isinstance(goal.task, Landing) and sight is not None and sight.is_blind_at(target):
        goals += [sight.seen_near(target, margin) for margin in _BLIND_MARGINS]
    tried = try_number > 1
    candidates = Candidates.join([_candidates(predictor, place, tried) for place in goals])
    risk, failure = _risks(predictor, candidates, goal, sight)
    if predictor.ensemble is not None:
        # Moved actions still carry the estimate of the action that they started from.
        few = np.argsort(risk)[:_SHORTLIST_COUNT]
        candidates = predictor.evaluate(candidates.actions[few], candidates.side[few])
        risk, failure = _risks(predictor, candidates, goal, sight)
    best = int(np.argmin(risk))
    within = max(goal.within_pct, COVERAGE_PCT)
    inside = bool(predictor.beliefs.policy.inside_coverage(goal.value, within))
    laws = laws or {}
    planned = functools.partial(Proposal, goal=goal, number=number, try_number=try_number)
    if predictor.polar is not None and (cast := predictor.polar.aimed_at(goal.value)) is not None:
        expected = predictor.polar.expectation(cast, laws.get(PolarCast.family))
        deviation = np.sqrt(0.5 * np.trace(expected.covariance)).reshape(1)
        path = plan_trajectory(cast, setup).grip_path
        lost = lost_chance(path, expected.mean[None], deviation, setup, sight)
        expected = dataclasses.replace(expected, failure=float(lost[0]))
        proposal = planned(
            action=cast,
            expected=expected,
            inside_coverage=100.0 * float(goal.miss(expected.mean)) < within,
        )
        if _polar_risk(proposal, predictor.polar) < risk[best]:
            return proposal
    if not np.isfinite(risk[best]):
        raise InputError("the arm can follow none of the policy's actions near this target")
    action = mirror_actions(candidates.actions, candidates.side)[best]
    xy, covariance, scatter = predictor.predict(action)
    return planned(
        action=Action.from_array(action),
        expected=Expectation(
            mean=xy[0],
            covariance=covariance[0],
            law=laws.get(Action.family, MissLaw()),
            scatter=float(scatter[0]),
            failure=float(failure[best]),
        ),
        inside_coverage=inside,
    )


def hit_chances(
    expected: Expectation, goal: Goal, family: str, count: int, try_number: int = 1
) -> Array:
    """Return the chance of a hit within 1, 2, ... tries, shape [count].

    Each correction is expected on the goal. It leaves the same share of the variance as the choice
    of a cast assumes, and the scatter of two equal casts: that of the last one and its own.

    Args:
        expected: Distribution of the outcome of the first of these tries.
        goal: Goal of all of them.
        family: Family of the motions.
        count: Number of tries.
        try_number: Number of the first of them at this goal.
    """
    left = {Action.family: LEFT, PolarCast.family: POLAR_LEFT}[family]
    size, scatter = len(goal.value), expected.scatter**2
    variance = max(float(np.trace(expected.covariance)) / size - scatter, 0.0)
    chances = [expected.hit_chance(goal)]
    for number in range(1, count):
        variance *= left
        covariance = (variance + 2.0 * scatter) * np.eye(size)
        later = dataclasses.replace(expected, mean=goal.value, covariance=covariance)
        stays = STAYS[min(try_number + number, 3) - 2]
        chances.append(stays * later.hit_chance(goal))
    return np.asarray(1.0 - np.cumprod(1.0 - np.array(chances)), dtype=float)


def _polar_risk(proposal: Proposal, polar: PolarLandings) -> float:
    """Return the expected loss of a polar cast, and what its duration counts for."""
    expected, length = proposal.expected, polar.setup.cable.length
    variance = 0.5 * np.trace(expected.covariance) / length**2
    scatter = (expected.scatter / length) ** 2
    left = POLAR_LEFT * (variance - scatter) + 2.0 * scatter
    miss, lost = np.array([proposal.expected_miss]), np.array([expected.failure])
    return float(_loss_of_both(miss, np.array([variance]), np.array([left]), lost)[0]) + POLAR_COST


def _loss_of_both(
    distance: Array, variance: Array, left: Array, failure: Array, dimension: int = 2
) -> Array:
    """Return the mean of the expected losses of casts and of the next ones, [action].

    `left` is the variance of the next ones [square cable lengths], the rest as in `expected_loss`.
    """
    loss = 0.5 * expected_loss(distance, variance, failure, dimension=dimension)
    return loss + 0.5 * expected_loss(distance, left, failure, NEXT_NEAR, dimension)


def _risks(
    predictor: LandingPredictor, candidates: Candidates, goal: Goal, sight: CameraSight | None
) -> tuple[Array, Array]:
    """Return the expected loss of candidates, and their chance of no landing, [action].

    The loss of one that the arm cannot follow, that leaves the table, or that was made at this
    target before, is infinite.
    """
    setup, side = predictor.beliefs.policy.setup, candidates.side
    model, count = predictor.beliefs.model, len(goal.value)
    places, landing_xy, variance = predictor.expected(candidates)
    scatter = predictor.experience.scatter(places)
    left, variance = LEFT * variance + 2.0 * scatter, variance + scatter
    length = predictor.beliefs.length
    target = goal.task.mirrored(goal.value / model.units, side)
    distance = np.linalg.norm(landing_xy - target, axis=1) / length
    motions = mirror_actions(candidates.actions, side)
    paths = cast_grip_paths(motions, setup)
    rest_xy = LANDING.mirrored(model.rest(candidates.actions, landing_xy), side)
    lost = lost_chance(paths, rest_xy, length * np.sqrt(variance), setup, sight)
    seen = (1.0 - lost) * (1.0 - candidates.leaving)
    failure = 1.0 - seen * (1.0 - predictor.experience.failure_chance(places))
    risk = _loss_of_both(distance, variance, left, failure, count)
    margin = model.predict_margin(candidates.actions)
    # An action of an earlier cast may be beyond the arm's limits.
    feasible = check_actions(candidates.actions, setup).mask
    made = [cast.sweep for cast in predictor.casts if cast.is_at(goal.value)]
    step = np.abs(motions[:, None] - np.reshape(made, (-1, ACTION_SIZE))) / SAME_ACTION
    feasible &= np.all(np.max(step, axis=2) > 1.0, axis=1)
    risk[~((margin >= _table_margin(predictor)) & feasible)] = np.inf
    return risk, failure


def _candidates(predictor: LandingPredictor, target: Array, tried: bool) -> Candidates:
    """Return promising actions, those that are expected on the target, and some in between.

    The uncertainty grows with the change of an action, so a part of the way to the target may miss
    by less than all of it.
    """
    starts = _shortlist(predictor, target, tried)
    ends = _moved(predictor, starts, target)
    if predictor.ensemble is not None:
        # The estimate changes over a long step: simulate, and take another one.
        ends = _moved(predictor, predictor.evaluate(ends.actions, ends.side), target)
    candidates = Candidates.join([starts.towards(ends, part) for part in _PARTS])
    return candidates.at(within_ranges(candidates.actions))


def _moved(predictor: LandingPredictor, candidates: Candidates, target: Array) -> Candidates:
    """Return candidates near others that are expected to land on the target."""
    moved, _ = refine_actions(
        candidates.actions,
        predictor.beliefs.model.task.mirrored(target, candidates.side),
        predictor.beliefs.changes,
        model=_MovedLandings(predictor, candidates),
        table_margin=_table_margin(predictor),
        iterations=_NEWTON_STEPS,
        fractions=_FRACTIONS,
    )
    return candidates.at(moved)


class _MovedLandings:
    """Landings of actions near candidates, as `refine_actions` asks for them."""

    def __init__(self, predictor: LandingPredictor, candidates: Candidates):
        self.predictor, self.candidates = predictor, candidates
        self.setup, self.task = predictor.beliefs.policy.setup, predictor.beliefs.model.task
        # It barely changes nearby.
        self.sensitivity = predictor.beliefs.sensitivities(candidates.actions)

    def predict(self, actions: Array) -> Array:
        """Return the expected landings of the candidates' actions in turn, any number of times."""
        rows = np.tile(np.arange(len(self.candidates)), len(actions) // len(self.candidates))
        return self.predictor.landings(self.candidates[rows].at(actions), self.sensitivity[rows])

    def landing_shifts(self, actions: Array, changes: Array) -> Array:
        """Return the shift of the landing for each change of an action, [action, k, change]."""
        return central_shifts(self.predict, actions, changes)

    def predict_margin(self, actions: Array) -> Array:
        """Return the distance that the free end keeps from the table's edges [m], [action]."""
        return self.predictor.beliefs.model.predict_margin(actions)


def _table_margin(predictor: LandingPredictor) -> float:
    """Return the distance that the free end must keep within the table's edges [m]."""
    return float(predictor.beliefs.policy.info.get("table_margin", TABLE_MARGIN))


def _shortlist(predictor: LandingPredictor, target: Array, tried: bool) -> Candidates:
    """Return the most promising candidates of the policy, and earlier actions, for a target."""
    task = predictor.beliefs.model.task
    candidates, simulated_xy, places = predictor.beliefs.policy_candidates
    # The candidates land on the right: for a target on the left all are mirrored.
    side = task.side_of(target) * candidates.side
    goals = task.mirrored(target, side)
    distance = np.linalg.norm(simulated_xy - goals, axis=1)
    count = max(_NEIGHBOR_COUNT, _PAIR_COUNT // max(1, len(predictor.casts)))
    near = np.argsort(distance)[:count]
    near_places = places[near]
    near_places.inputs[:, -1] = side[near]
    mean, variance = predictor.experience.residual.predict(near_places)
    expected_xy = simulated_xy[near] + predictor.beliefs.length * mean
    distance = np.linalg.norm(expected_xy - goals[near], axis=1) / predictor.beliefs.length
    # Calm ones, which may be moved onto the target, and the nearest, where no calm one reaches.
    square = distance**2 + len(target) * (variance + predictor.experience.scatter(near_places))
    earlier = _earlier_actions(predictor, target)
    few = predictor.ensemble is None or (tried and len(earlier) > 0)
    half = (_SHORTLIST_COUNT if few else _SIMULATED_COUNT) // 2
    short = near[np.union1d(np.argsort(square)[:half], np.argsort(distance)[:half])]
    chosen = predictor.evaluate(candidates.actions[short], side[short])
    if len(chosen) > _SHORTLIST_COUNT:
        chosen = _least_missing(predictor, chosen, target)
    return Candidates.join([chosen, predictor.evaluate(*mirror_to_right(earlier))])


def _least_missing(
    predictor: LandingPredictor, candidates: Candidates, target: Array
) -> Candidates:
    """Return the candidates with the least expected miss as they are."""
    _, landing_xy, variance = predictor.expected(candidates)
    goals = predictor.beliefs.model.task.mirrored(target, candidates.side)
    offset = (landing_xy - goals) / predictor.beliefs.length
    square = np.sum(offset**2, axis=1) + len(target) * variance
    # A cast without a landing misses by as much as one that lands a cable's length away.
    square = (1.0 - candidates.leaving) * square + candidates.leaving
    return candidates[np.argsort(square)[:_SHORTLIST_COUNT]]


def _earlier_actions(predictor: LandingPredictor, target: Array) -> Array:
    """Return the actions of casts that landed nearest to a target, shape [action, 5]."""
    landed = [cast for cast in predictor.casts if cast.landed]
    model = predictor.beliefs.model
    ends = np.array([cast.read(model.task) / model.units - target for cast in landed])
    miss = np.linalg.norm(ends.reshape(-1, len(target)), axis=1) / predictor.beliefs.length
    near = [row for row in np.argsort(miss)[:_EARLIER_COUNT] if miss[row] < _EARLIER_REACH]
    return np.array([landed[row].sweep for row in near]).reshape(-1, ACTION_SIZE)


def expected_loss(
    distance: NDArray[np.float64],
    variance: NDArray[np.float64],
    failure: NDArray[np.float64],
    near: float = NEAR,
    dimension: int = 2,
) -> NDArray[np.float64]:
    """Return the expected loss of casts.

    The loss of a miss m is 1 - exp(-m² / (2 w²)) with w = `near`, and 1 for a cast without a
    landing. Small misses count by their square, as in a Kalman filter. A large miss that is certain
    counts for as much as one that is only possible: it is no reason to stay.

    Args:
        distance: Distance from expected landing to target [cable lengths], shape [action].
        variance: Variance of the landing along each axis [square cable lengths], shape [action].
        failure: Chance of a cast without a landing [-], shape [action].
        near: Miss beyond which its size barely matters [cable lengths].
        dimension: Number of components of the outcome.
    """
    width = near**2 + variance
    gain = (near**2 / width) ** (0.5 * dimension) * np.exp(-(distance**2) / (2.0 * width))
    return 1.0 - (1.0 - failure) * gain


def lost_chance(
    paths: GripPath,
    landing_xy: NDArray[np.float64],
    deviation: NDArray[np.float64],
    setup: Setup,
    sight: CameraSight | None = None,
) -> NDArray[np.float64]:
    """Return the chance that a landing lies off the table, or is not seen.

    What the resting arm hides is not seen, and what lies in a blind place of the camera. An arm
    that cannot follow an action hides nothing.

    Args:
        paths: Paths of the gripper, a row for each cast.
        landing_xy: Their expected landings [m], shape [action, 2].
        deviation: Standard deviation of the landings along each axis [m], shape [action].
        setup: Set-up with the arm and the table.
        sight: Limits of the camera's sight; if None, those of a camera above the middle of the
            table, without blind places.
    """
    poses = paths.evaluate(paths.duration[:, None])[:, 0]
    still = np.zeros_like(poses)
    q = setup.arm.inverse_motion(poses, still, still).q
    points = landing_xy[:, None] + deviation[:, None, None] * _unit_points()
    count = points.shape[1]
    ground = np.concatenate([points, np.zeros((*points.shape[:2], 1))], axis=-1)
    table = setup.workspace
    if sight is None:
        middle = 0.5 * (table.y_min + table.y_max)
        sight = CameraSight(position=(0.0, middle, CAMERA_HEIGHT))
    shape = arm_shape(q, setup.arm)
    each = ArmShape(ends=np.repeat(shape.ends, count, axis=0), radii=shape.radii)
    clearance = sight_clearance(ground.reshape(-1, 3), sight.position, each).reshape(-1, count)
    unseen = (clearance < MARKER_RADIUS) | sight.is_blind_at(points)
    return np.mean(unseen | ~table.on_table(points), axis=1)


def _unit_points() -> NDArray[np.float64]:
    """Return quadrature points of an isotropic Gaussian of deviation 1, shape [point, 2]."""
    share = (np.arange(_RINGS) + 0.5) / _RINGS
    radius = np.sqrt(-2.0 * np.log1p(-share))
    # Every other ring is turned by half a spoke.
    return shell_points(radius, 0.5 * (np.arange(_RINGS) % 2), _SPOKES)
