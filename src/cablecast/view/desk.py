"""Desk: what a person does at the table, without a page: point, look at the plan, cast, correct.

Every value that comes from a page is checked here. Methods may be called from any thread; a cast
takes the desk for itself, so that two people never cast at once.
"""

import dataclasses
import enum
import threading
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cablecast.cable import CableParams
from cablecast.engines.base import Engine
from cablecast.errors import InputError, TargetError
from cablecast.evaluation.ellipse import CONFIDENCE
from cablecast.models.features import deviations
from cablecast.motion.action import Action
from cablecast.motion.feasibility import Feasibility, check_grip_paths
from cablecast.motion.servo import ServoModel
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.policies.forward_search import TABLE_MARGIN, ForwardSearchPolicy
from cablecast.policies.refinement import refine_actions
from cablecast.rigs.base import Rig
from cablecast.rigs.engine import status_of
from cablecast.setup import Setup
from cablecast.view.aiming import next_aim
from cablecast.view.shown import FRAME_DT, ShownCast
from cablecast.view.tries import Try, TryStore

RADIUS_OF_CONFIDENCE = float(np.sqrt(-2.0 * np.log(1.0 - CONFIDENCE)))
"""Radius of the circle that holds 95 % of a normal distribution in the plane, in standard
deviations: sqrt(-2 ln(1 - 0.95)), the chi-squared quantile of two degrees of freedom."""

_MOVE_COUNT = 4


class Phase(enum.Enum):
    """State of the table; the value says what to do next."""

    NO_MODEL = "Make a model first: the page does it in a minute."
    READY = "Click on the table to choose a target."
    PLANNED = "Look at the plan, then cast."
    CASTING = "The arm moves: keep clear."
    LANDED = "Correct and cast again, or choose another target."


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Preview:
    """A planned cast and what to expect of it.

    Attributes:
        target_xy: Target [m], shape [2].
        aim_xy: Point that the plan aims at [m], shape [2].
        action: Action.
        trajectory: Motion down to joint set points.
        predicted_xy: Predicted landing [m], shape [2].
        spread: Standard deviation of the landing along each axis [m]; NaN if unknown.
        margin: Predicted distance of the free end from the table's edges [m]; negative off it.
        inside_coverage: Whether simulated casts land near the target.
        cast: Simulated cast.
        limits: Peaks of the joints and their bounds.
    """

    target_xy: NDArray[np.float64]
    aim_xy: NDArray[np.float64]
    action: Action
    trajectory: Trajectory
    predicted_xy: NDArray[np.float64]
    spread: float
    margin: float
    inside_coverage: bool
    cast: ShownCast
    limits: Feasibility

    @property
    def expected_radius(self) -> float:
        """Radius within which 95 % of the landings are expected [m]; NaN if unknown."""
        return RADIUS_OF_CONFIDENCE * self.spread

    @property
    def limit_shares(self) -> NDArray[np.float64]:
        """Largest share of each joint's speed and acceleration limits [-], shape [2, 6]."""
        return np.asarray(self.limits.peaks[0, 1:] / self.limits.bounds[1:])


class Desk:
    """State of the table and of the tries at it.

    Args:
        rig: Rig that casts.
        setup: Set-up of the rig.
        engine: Simulator of the previews.
        policy: Policy that plans; None until one was made.
        params: Parameters of the simulated cable; those of the model, or the cable's own, if None.
        servo: Servo of the simulated arm.
        store: Store of the tries.

    Attributes:
        tries: All tries in order, with those that were undone.
        preview: Plan for the current target; None before the first.
        message: Latest news in one sentence; empty if there are none.
    """

    def __init__(
        self,
        rig: Rig,
        setup: Setup,
        engine: Engine,
        *,
        policy: ForwardSearchPolicy | None = None,
        params: CableParams | None = None,
        servo: ServoModel | None = None,
        store: TryStore | None = None,
    ):
        self.rig, self.setup, self.engine = rig, setup, engine
        self._policy = policy
        self._params, self._servo = params, servo
        self._store = store or TryStore()
        self._lock = threading.RLock()
        self._casting = False
        self.tries = self._store.read()
        self.preview: Preview | None = None
        self.message = ""
        if (target_xy := self._store.cut_off()) is not None:
            self.message = (
                f"A cast at x = {target_xy[0]:.3f}, y = {target_xy[1]:.3f} m was cut off: nothing "
                "was seen of it."
            )

    @property
    def policy(self) -> ForwardSearchPolicy | None:
        """Policy that plans."""
        return self._policy

    @property
    def phase(self) -> Phase:
        """State of the table."""
        with self._lock:
            if self._casting:
                return Phase.CASTING
            if self._policy is None:
                return Phase.NO_MODEL
            if self.preview is None:
                return Phase.READY
            last = self.last
            done = last is not None and last.is_at(self.preview.target_xy)
            return Phase.LANDED if done else Phase.PLANNED

    @property
    def last(self) -> Try | None:
        """Latest try that was not undone."""
        return next((one for one in reversed(self.tries) if not one.undone), None)

    @property
    def params(self) -> CableParams:
        """Parameters of the simulated cable."""
        return self.setup.cable.params if self._params is None else self._params

    def set_model(
        self,
        policy: ForwardSearchPolicy,
        params: CableParams | None = None,
        servo: ServoModel | None = None,
    ) -> None:
        """Plan with another policy from now on.

        Args:
            policy: Policy for the set-up of the rig.
            params: Parameters of the cable that its casts were simulated with.
            servo: Servo of the arm in these casts.

        Raises:
            InputError: It was made for another set-up, or a cast is under way.
        """
        if policy.setup.to_settings() != self.setup.to_settings():
            raise InputError("the model was made for another set-up than the rig's")
        with self._lock:
            self._refuse_casting()
            self._policy, self._params, self._servo = policy, params, servo
            self.preview = None

    def aim(self, target_xy: ArrayLike) -> Preview:
        """Choose a target and plan the cast at it.

        Args:
            target_xy: Target [m], shape [2].

        Raises:
            TargetError: It is not finite, out of reach, or off the table.
            InputError: There is no model, or a cast is under way.
        """
        with self._lock:
            self._refuse_casting()
            target = np.asarray(target_xy, dtype=float)
            if target.shape != (2,):
                raise TargetError(f"a target has shape {target.shape}: it must be [2]")
            policy = self._need_policy()
            plan = policy.plan(target)
            self.preview = self._preview(
                target,
                target,
                plan.actions[0],
                plan.predicted_xy[0],
                float(plan.spread[0]),
                bool(plan.inside_coverage[0]),
            )
            self.message = ""
            return self.preview

    def correct(self) -> Preview:
        """Plan the next cast at the target of the last one, moved against its misses.

        The action is the last one, changed as little as moves its predicted landing to the new
        point of aim: another action would miss in another way.

        Raises:
            InputError: Nothing was cast, or a cast is under way.
        """
        with self._lock:
            self._refuse_casting()
            last, policy = self.last, self._need_policy()
            if last is None:
                raise InputError("there is nothing to correct yet: cast first")
            tries = self.tries_at(last.target_xy)
            landed = [one for one in tries if np.all(np.isfinite(one.landed_xy))]
            if not landed:
                raise InputError("no try at this target came to rest on the table: aim anew")
            aim = next_aim(landed, self.setup.cable.length)
            aim = np.clip(aim, *self._table_bounds())
            actions = landed[-1].action[None]
            # One call moves an action a bounded way; a large miss needs some.
            for _ in range(_MOVE_COUNT):
                actions, predicted = refine_actions(
                    actions,
                    aim[None],
                    deviations(policy.actions),
                    model=policy.model,
                    table_margin=policy.info.get("table_margin", TABLE_MARGIN),
                )
            spread = policy.model.predict_spread(actions)
            self.preview = self._preview(
                last.target_xy,
                aim,
                actions[0],
                predicted[0],
                np.nan if spread is None else float(spread[0]),
                bool(policy.inside_coverage(last.target_xy)),
            )
            return self.preview

    def cast(self) -> Try:
        """Cast as planned, and see where the free end comes to rest.

        To be called in the thread that may use the rig.

        Raises:
            InputError: Nothing is planned, or another cast is under way.
            RigError: The rig failed; the table can be used again.
        """
        with self._lock:
            self._refuse_casting()
            preview = self.preview
            if preview is None:
                raise InputError("nothing is planned: choose a target first")
            number = len(self.tries) + 1
            self._casting = True
        try:
            self._store.begin(number, preview.target_xy)
            self.rig.reset()
            track = self.rig.execute(preview.trajectory)
            one = Try(
                number=number,
                target_xy=preview.target_xy,
                aim_xy=preview.aim_xy,
                action=preview.action.to_array(),
                predicted_xy=preview.predicted_xy,
                cast=ShownCast.of_track(track, preview.trajectory),
                landed_xy=np.array(track.final_xy, dtype=float),
            )
            self._store.write(one)
            with self._lock:
                self.tries.append(one)
                self.message = "" if np.isfinite(one.miss) else track.status.value
            return one
        finally:
            with self._lock:
                self._casting = False

    def undo(self) -> Try:
        """Take the last try back: it is kept, and teaches nothing.

        Raises:
            InputError: There is none, or a cast is under way.
        """
        with self._lock:
            self._refuse_casting()
            last = self.last
            if last is None:
                raise InputError("there is no try to undo")
            undone = dataclasses.replace(last, undone=True)
            self._store.write(undone)
            self.tries[last.number - 1] = undone
            return undone

    def tries_at(self, target_xy: NDArray[np.float64]) -> list[Try]:
        """Return the tries at a target that were not undone, in order."""
        return [one for one in self.tries if one.is_at(target_xy) and not one.undone]

    def simulate(
        self, trajectory: Trajectory, params: CableParams | None = None, engine: Any = None
    ) -> ShownCast:
        """Return a motion as the simulator sees it.

        Args:
            trajectory: Motion.
            params: Parameters of the cable; those of the desk if None.
            engine: Another engine than that of the desk.
        """
        path = trajectory.grip_path
        if self._servo is not None:
            path = self._servo.apply(path, self.setup.arm)
        rollout = (engine or self.engine).rollout(
            self.setup.cable,
            self.params if params is None else params,
            path,
            sample_dt=FRAME_DT,
            record_nodes=True,
        )
        status = status_of(rollout.endpoint_xy[0], self.setup.workspace)
        return ShownCast.of_rollout(rollout, trajectory, status=status)

    def _preview(
        self,
        target: NDArray[np.float64],
        aim: NDArray[np.float64],
        action: NDArray[np.float64],
        predicted: NDArray[np.float64],
        spread: float,
        inside: bool,
    ) -> Preview:
        trajectory = plan_trajectory(Action.from_array(action), self.setup)
        side = action if action[1] > 0 else action * [-1.0, -1.0, 1.0, -1.0]
        return Preview(
            target_xy=target,
            aim_xy=aim,
            action=Action.from_array(action),
            trajectory=trajectory,
            predicted_xy=predicted,
            spread=spread,
            margin=float(self._need_policy().model.predict_margin(side[None])[0]),
            inside_coverage=inside,
            cast=self.simulate(trajectory),
            limits=check_grip_paths(trajectory.grip_path, self.setup),
        )

    def _table_bounds(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        table = self.setup.workspace
        low = np.array([-table.half_width, table.y_min])
        return low, np.array([table.half_width, table.y_max])

    def _need_policy(self) -> ForwardSearchPolicy:
        if self._policy is None:
            raise InputError("there is no model yet: make one first")
        return self._policy

    def _refuse_casting(self) -> None:
        if self._casting:
            raise InputError("a cast is under way: wait until the cable rests")
