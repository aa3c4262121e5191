"""`cablecast plan`: the motion for one target."""

import dataclasses
import pathlib
from typing import TYPE_CHECKING, Annotated

import tyro

from cablecast.cli.options import (
    EXIT_FALLS_SHORT,
    Method,
    Places,
    TargetOptions,
    argument,
    load_lab,
    load_policy,
    polar_text,
)
from cablecast.errors import InputError, check_number

if TYPE_CHECKING:
    from cablecast.learning.policy import Plan
    from cablecast.motion.trajectory import JointPath


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlanVerb(TargetOptions):
    """Plan the motion that lands the cable's free end on a target.

    Prints the action, the predicted landing, the duration of the motion and the peak speeds of the
    joints. Takes about a second. Needs a trained model: see `cablecast train`. The exit status is 3
    if the best motion is predicted to miss the target by more than --miss-max.
    """

    target: Annotated[
        Places,
        tyro.conf.UseAppendAction,
        argument("R THETA", hint="(this or --target-xy)"),
    ] = ()
    """Target: distance from the robot's base [m], and angle from straight ahead [deg], positive to
    the robot's right."""
    target_xy: Annotated[
        Places, tyro.conf.UseAppendAction, argument("X Y", hint="(this or --target)")
    ] = ()
    """Target in the base frame [m], x to the robot's right and y ahead."""
    setup: Annotated[pathlib.Path | None, argument("FILE", "that of --model")] = None
    """Lab file that the model must have been trained for; --save needs one with a measured arm."""
    cable: Annotated[str | None, argument("CABLE", "that of --model, or cable_1")] = None
    """Cable in the gripper: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    model: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/model")] = None
    """Folder that `cablecast train` wrote."""
    method: Method = "refined"
    miss_max: Annotated[float, argument("PCT")] = 25.0
    """Largest predicted miss in % of cable length that still gives exit status 0."""
    save: Annotated[pathlib.Path | None, argument("FILE", "not saved")] = None
    """Write the motion as CSV for a robot with the arm of --setup: time t [s], joint angles q1, q2
    ... [rad] and joint speeds qd1, qd2 ... [rad/s], a row each control_dt."""
    force: bool = False
    """Overwrite the file of --save if it exists."""

    def run(self) -> int:
        """Plan, print, and save if asked to; return the exit status."""
        from cablecast.pipeline.plan import (
            check_measured,
            check_writable,
            plan_motion,
            save_motion,
        )

        check_number("miss_max", self.miss_max, 0.0, 1e4, "%")
        if not self.target and not self.target_xy:
            raise InputError("plan needs a target: --target R THETA or --target-xy X Y")
        lab = load_lab(self.setup, self.cable)
        if self.save is not None:
            check_measured(lab)
            check_writable(self.save, self.force)
        policy = load_policy(self.model, self.setup, self.cable)
        target_xy = self.targets(policy.setup, most=1)[0]
        plan = plan_motion(policy, target_xy=target_xy, method=self.method)
        path = plan.trajectories[0].joint_path
        if path is None:
            raise InputError("the planned motion has no joint path")
        _print_plan(plan, path)
        if self.save is not None:
            save_motion(plan, self.save, lab, force=self.force)
            print(f"saved      {self.save} ({len(path.times)} rows)")
        miss_pct = float(plan.miss_pct[0])
        if miss_pct > self.miss_max:
            print(
                f"note: the predicted miss of {miss_pct:.1f} % is above --miss-max "
                f"{self.miss_max:g} %"
            )
            return EXIT_FALLS_SHORT
        return 0


def _print_plan(plan: "Plan", path: "JointPath") -> None:
    import numpy as np

    cable, action = plan.setup.cable, plan.actions[0]
    print(f"cable      {cable.name}, {cable.length:.2f} m")
    print(f"target     {polar_text(plan.target_xy[0])}")
    theta1_deg, theta2_deg, psi_deg = np.degrees(action[[0, 1, 3]])
    pace = "" if action[4] == 1.0 else f", pace = {action[4]:.3f}"
    print(
        f"action     theta1 = {theta1_deg:z.2f} deg, theta2 = {theta2_deg:z.2f} deg, "
        f"r2 = {action[2]:.4f} m, psi = {psi_deg:z.2f} deg{pace}"
    )
    print(f"predicted  {polar_text(plan.predicted_xy[0])}")
    print(f"           {plan.miss_pct[0]:.2f} % of cable length from the target")
    print(f"duration   {float(path.times[-1]):.3f} s")
    peaks_deg = np.degrees(path.peak_speed)
    speeds = ", ".join(f"q{k} {speed:.0f}" for k, speed in enumerate(peaks_deg, start=1))
    print(f"peak joint speeds [deg/s]  {speeds}")
    if not plan.inside_coverage[0]:
        print(
            "note: no simulated cast of this cable lands near this target; this is the action with "
            "the nearest predicted landing"
        )
