"""tune_swing: a lift and a swing that lay the cable of a set-up out straight.

The swing of `PolarCastConfig` serves cables like the paper's, on a table that is deep enough for
the gripper to come down far out. A longer, lighter or softer cable folds, and so does one on a
short table. Then no reset leaves it alike, and no polar cast lands. What lays it out is a matter of
simulation: via points are searched for by covariance matrix adaptation (CMA-ES; N. Hansen, The CMA
Evolution Strategy: A Tutorial, arXiv 1604.00772), such that each cable that this may be ends
straight, and that the arm can follow.
"""

import contextlib
import dataclasses

import numpy as np
from numpy.typing import NDArray

from cablecast.conventions import stream
from cablecast.engines import make_engine
from cablecast.engines.base import CableState
from cablecast.engines.dynamics import Dynamics
from cablecast.errors import CablecastError, InputError, check_argument_types, check_seed
from cablecast.motion.action import ActionRanges
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.grip_path import GripPath
from cablecast.motion.limits import check_grip_paths
from cablecast.motion.polar import (
    PolarReach,
    highest_lift,
    lift_path,
    reset_pose,
    swing_path,
)
from cablecast.motion.trajectory import follow
from cablecast.rigs.arm import RESET_DT
from cablecast.rigs.path import JointCurve, check_path
from cablecast.runs.progress import Progress, ProgressCallback, ignore
from cablecast.setup import PolarCastConfig, Setup, Swing
from cablecast.tuning.tuned import Tuned

GENERATIONS, POPULATION = 80, 16
"""Most generations of the search, and candidates in each."""

STEPS = Swing(
    durations=(0.3, 0.3, 0.3, 0.3),
    draw_back=0.1,
    radii=(0.3, 0.3),
    heights=(0.15, 0.15, 0.15),
    pitches=(0.3, 0.3, 0.3),
)
"""Typical changes of the via points, over which the search begins; those of durations are relative.
"""

STRAIGHT = 0.02
"""Mean distance of the free ends from those of straight cables at which the search ends [cable
lengths]."""

LIFT_SLOWER = 1.5
"""Duration of the lift over that of the default one, which suits cables of about 0.6 m. A cable of
0.75 m, and one of 1.1 m, swung by 0.21 and 0.23 m after its 3 s of rest, and by 0.01 and 0.05 m
after the slower one (the most likely of six such cables, fast engine)."""

_CASTS, _ASIDE = 8, 0.75
_SEGMENT_COUNT, _DT, _SAMPLE_DT = 20, 0.002, 0.05
# Costs of candidates that the arm cannot follow begin here; a folded cable costs at most the other.
_INFEASIBLE, _FOLDED = 4.0, 1.5
# Distance of the flange's edge behind the flange, and its least height [m].
_FLANGE_EDGE, _WRIST_MIN = 0.08, 0.1
# Settings that are not searched for.
_KEPT = ("hang_time", "settle_time", "pull_speed", "pull_time_min", "table_margin", "clearance")
# Samples of a path at which its height is checked.
_HEIGHTS = 200


@check_argument_types
def tune_swing(setup: Setup, *, seed: int = 0, progress: ProgressCallback = ignore) -> Setup:
    """Return the set-up with a lift and a swing of its own, with which its cable lies straight.

    These are the section `polar` of a lab file, of which times of rest and of the pull are kept.
    Resets use them, and polar casts.

    Args:
        setup: Cable, workspace and arm.
        seed: Seed of the search, and of what the cable may be.
        progress: Told how many generations of candidates were simulated.

    Raises:
        InputError: The arm can make no cast, lift the cable nowhere, or follow no swing; its joints
            are searched for, which would take hours; or the cable is swung in the air.
    """
    check_seed(seed)
    if setup.strike is not None:
        raise InputError(
            "a swing is tuned for casts onto a table: this set-up has a strike section"
        )
    if not setup.arm.solves_exactly:
        raise InputError(
            f"the swing is tuned for arms whose joints are solved for, such as a UR: for "
            f"{setup.arm.model} the search would take hours"
        )
    return _Search(setup, seed).run(progress)


class _Search:
    """Candidates of the swing after one lift, which is the highest that the arm can follow."""

    def __init__(self, setup: Setup, seed: int):
        self.setup, self.seed = setup, seed
        self.engine = make_engine("warp", _SEGMENT_COUNT, _DT)
        believed = Tuned.believed(setup, seed).members
        # Materials barely change how a cable falls, and need a kernel of their own.
        self.members = [member.with_params(member.params.without_material()) for member in believed]
        self.thrown, end = self._thrown()
        # A reset begins wherever a cast left the cable, a polar cast after a reset.
        self.starts = np.stack([reset_pose(setup.workspace), end])
        if (config := highest_lift(setup, self.starts, self._may_make)) is None:
            raise InputError(f"the {setup.arm.model} cannot lift {setup.cable.name}")
        config, own = config.paced(LIFT_SLOWER, 1.0), setup.polar or config
        kept = {name: getattr(own, name) for name in _KEPT}
        self.config = dataclasses.replace(config, **kept)
        self.hanging = [self._hung(member) for member in self.members]
        # Where the gripper comes down and is pulled to.
        self.ways = [
            (PolarReach.reset_radius(setup, self.config), setup.workspace.reset_y),
            *((radius, radius) for radius in self._cast_radii()),
        ]

    def run(self, progress: ProgressCallback) -> Setup:
        """Return the set-up with the best swing that was found."""
        import cma

        rng = stream(self.seed, "swing")
        options = {
            "popsize": POPULATION,
            "verbose": -9,
            # It would read options from a file of the working folder.
            "signals_filename": "",
            # All candidates of a generation may cost the same.
            "tolfun": 0.0,
            "tolfunhist": 0.0,
            # It would seed NumPy's own generator.
            "seed": np.nan,
            "randn": lambda *shape: rng.standard_normal(shape),
        }
        search = cma.CMAEvolutionStrategy(np.zeros(_DIMENSION), 0.5, options)
        best, cost = np.zeros(_DIMENSION), np.inf
        state = Progress(task="Tuning the swing", total=GENERATIONS, unit="generations")
        for generation in range(GENERATIONS):
            progress(dataclasses.replace(state, done=generation))
            points = np.array(search.ask())
            costs = self.costs(points)
            while costs.min() < min(cost, _INFEASIBLE):
                row = int(np.argmin(costs))
                if self._is_driven(points[row]):
                    best, cost = points[row], float(costs[row])
                else:
                    costs[row] = _INFEASIBLE
            search.tell(points, costs.tolist())
            if cost < STRAIGHT or search.stop():
                break
        if np.isinf(cost):
            raise InputError(
                f"the {self.setup.arm.model} can follow no swing of this cable that was tried"
            )
        progress(dataclasses.replace(state, done=GENERATIONS))
        return dataclasses.replace(self.setup, polar=self.config_of(best))

    def config_of(self, point: NDArray[np.float64]) -> PolarCastConfig:
        """Return the settings of a point of the search, shape [dimension]."""
        return dataclasses.replace(self.config, swing=_swing(point))

    def costs(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how far from straight candidates leave the free end [cable lengths], [candidate].

        Where the arm cannot follow, it is a larger number, by how much it cannot. The shape of the
        points is [candidate, dimension].
        """
        costs = np.full(len(points), 2.0 * _INFEASIBLE)
        rows, paths = [], []
        for row, point in enumerate(points):
            with contextlib.suppress(CablecastError):
                found = self._paths(self.config_of(point))
                excess = self._excess(found)
                costs[row] = _INFEASIBLE + excess
                if excess == 0.0:
                    rows.append(row)
                    paths.append(found)
        if rows:
            costs[rows] = self._offsets(paths)
        return costs

    def _cast_radii(self) -> list[float]:
        """Return where the gripper of polar casts comes down, straight ahead and aside [m]."""
        try:
            reach = PolarReach.of(self.setup, self.config)
        except InputError:
            return []
        length = self.setup.cable.length
        ahead, aside = (
            float(reach.landing_radius(share * reach.theta_max)) - length for share in (0.0, _ASIDE)
        )
        return [ahead, aside] if abs(aside - ahead) > 1e-3 else [ahead]

    def _paths(self, config: PolarCastConfig) -> list[GripPath]:
        """Return the swings of a candidate."""
        return [swing_path(radius, rest, self.setup, config) for radius, rest in self.ways]

    def _excess(self, paths: list[GripPath]) -> float:
        """Return by how much paths are beyond the limits of the arm [-]; 0 where it can follow."""
        stacked = GripPath.stack(paths)
        times = np.linspace(0.0, 1.0, _HEIGHTS) * stacked.duration[:, None]
        poses = stacked.evaluate(times)
        low = self.setup.workspace.grip_height - 1e-4 - poses[..., 2]
        wrist = -self._wrist_height(poses)
        wrist += min(_WRIST_MIN, float(self._wrist_height(self.starts[0])))
        excess = 10.0 * (max(float(low.max()), 0.0) + max(float(wrist.max()), 0.0))
        found = check_grip_paths(stacked, self.setup)
        for row in np.flatnonzero(~found.mask):
            if np.isnan(found.peaks[row]).any():
                excess += 3.0 + 10.0 * abs(float(found.place[row] - found.place_bound[row]))
            else:
                excess += float(np.maximum(found.peaks[row] / found.bounds - 1.0, 0.0).sum())
        return excess

    def _wrist_height(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the height of the flange's edge at poses of shape [..., 5] [m], shape [...]."""
        back = self.setup.arm.gripper_length + _FLANGE_EDGE
        return poses[..., 2] + back * np.cos(poses[..., 4])

    def _may_make(self, path: GripPath) -> bool:
        """Return whether a real arm may make a motion; true where there is none."""
        if self.setup.robot is None:
            return True
        setup = self.setup.with_motion(control_dt=RESET_DT)
        with contextlib.suppress(CablecastError):
            check_path(JointCurve.fit(follow(path, setup, "the swing")), setup, "the swing")
            return True
        return False

    def _is_driven(self, point: NDArray[np.float64]) -> bool:
        """Return whether a real arm may make the swings of a candidate, shape [dimension]."""
        return all(self._may_make(path) for path in self._paths(self.config_of(point)))

    def _offsets(self, candidates: list[list[GripPath]]) -> NDArray[np.float64]:
        """Return how far from straight candidates leave the free end [lengths], [candidate]."""
        length = self.setup.cable.length
        ends = np.array([[0.0, rest + length] for _, rest in self.ways])
        cases = [(0, 1), *((way, 0) for way in range(len(self.ways)))]
        path = GripPath.stack([paths[way] for paths in candidates for way, _ in cases])
        off = []
        for member, hanging in zip(self.members, self.hanging, strict=True):
            state = _rows(hanging, [start for _, start in cases] * len(candidates))
            landed = self._rollout(member, path, state).positions[:, -1, :2]
            target = np.tile(ends[[way for way, _ in cases]], (len(candidates), 1))
            distance = np.linalg.norm(landed - target, axis=1) / length
            off.append(np.where(np.isfinite(distance), distance, _FOLDED))
        each = np.minimum(np.stack(off), _FOLDED).reshape(len(off), len(candidates), -1)
        return each.mean(axis=(0, 2))

    def _thrown(self) -> tuple[CableState, NDArray[np.float64]]:
        """Return how a cast leaves the most likely cable, and the pose of the gripper then, [5]."""
        setup = self.setup
        casts = cast_grip_paths(feasible_uniform(_CASTS, setup, ranges=ActionRanges()), setup)
        left = self._rollout(self.members[0], casts)
        done = np.flatnonzero(np.isfinite(left.positions).all(axis=(1, 2)))
        if not len(done):
            raise InputError(f"none of {_CASTS} casts of {setup.cable.name} could be simulated")
        row = int(done[0])
        return _rows(left, [row]), casts.evaluate(casts.duration[:, None])[row, 0]

    def _hung(self, member: Dynamics) -> CableState:
        """Return how a cable hangs after the lift: after a reset, and after a cast."""
        found = []
        for pose, state in zip(self.starts, (None, self.thrown), strict=True):
            path = lift_path(pose, self.setup, self.config)
            duration = float(path.duration[0])
            found.append(self._rollout(member, path, state, duration))
        fields = [field.name for field in dataclasses.fields(CableState)]
        return CableState(
            **{name: np.concatenate([getattr(state, name) for state in found]) for name in fields}
        )

    def _rollout(
        self,
        member: Dynamics,
        path: GripPath,
        state: CableState | None = None,
        duration: float | None = None,
    ) -> CableState:
        """Return the states at the end of some paths."""
        return member.rollout(
            self.engine,
            self.setup,
            path,
            initial_state=state,
            duration=duration,
            sample_dt=_SAMPLE_DT,
        ).final_state


def _rows(states: CableState, rows: list[int]) -> CableState:
    """Return some rows of a batch of states."""
    fields = [field.name for field in dataclasses.fields(states)]
    return CableState(**{name: getattr(states, name)[rows] for name in fields})


def _swing(point: NDArray[np.float64]) -> Swing:
    """Return the swing of a point of the search, shape [dimension]."""
    default, changes, left = Swing(), {}, point.tolist()
    for name, step in vars(STEPS).items():
        start = np.atleast_1d(getattr(default, name))
        moved = np.atleast_1d(step) * left[: len(start)]
        left = left[len(start) :]
        values = start * np.exp(moved) if name == "durations" else start + moved
        changes[name] = tuple(np.round(values, 4).tolist())
    (draw_back,) = changes.pop("draw_back")
    return Swing(draw_back=draw_back, **changes)


_DIMENSION = sum(np.size(step) for step in vars(STEPS).values())
