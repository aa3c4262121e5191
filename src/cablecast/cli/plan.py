"""`cablecast plan`: the motion for one target."""

import dataclasses
import math
import pathlib
from typing import TYPE_CHECKING, Annotated

from cablecast.cli.options import argument, check_same_cable, find_model, polar_text

if TYPE_CHECKING:
    from cablecast.motion.joint_path import JointPath


@dataclasses.dataclass(frozen=True, kw_only=True)
class Plan:
    """Find the motion that lands the cable's free end on a target.

    Prints the motion, where the model expects the free end to come to rest, how long the motion
    takes and how fast the joints turn. Needs a trained model: see `cablecast train`.
    """

    target: Annotated[tuple[float, float], argument("R THETA")]
    """Where to land: distance from the robot's base [m], and angle from straight ahead [deg],
    positive to the robot's right."""
    cable: Annotated[str | None, argument("CABLE", "that of --model, or cable_1")] = None
    """Which cable: cable_1, cable_2, cable_3, or a YAML file that describes your own."""
    model: Annotated[pathlib.Path | None, argument("DIR", "runs/CABLE/model")] = None
    """Folder that `cablecast train` wrote."""
    save: Annotated[pathlib.Path | None, argument("FILE", "not saved")] = None
    """Also write the motion for a robot, as CSV: time t [s], joint angles q1 to q6 [rad] and speeds
    qd1 to qd6 [rad/s], 125 rows a second."""
    force: bool = False
    """Overwrite the file of --save if it exists."""

    def run(self) -> None:
        """Plan, print, and save if asked to."""
        import numpy as np

        from cablecast.cable import load_cable
        from cablecast.conventions import polar_to_xy
        from cablecast.errors import InputError, TargetError
        from cablecast.models.load import load_model
        from cablecast.motion.action import Action
        from cablecast.motion.trajectory import plan_trajectory
        from cablecast.policies.forward_search import ForwardSearchPolicy

        if self.save and self.save.exists() and not self.force:
            raise InputError(f"{self.save} exists: give --force to overwrite it")
        asked = load_cable(self.cable) if self.cable else None
        folder = find_model(self.model, asked)
        policy = ForwardSearchPolicy.load(folder, load_model(folder))
        cable = check_same_cable(asked, policy.cable, folder)
        r, theta_deg = self.target
        if not (math.isfinite(r) and math.isfinite(theta_deg)):
            raise TargetError(f"target r = {r} m, theta = {theta_deg} deg must be finite numbers")
        if r < 0:
            raise TargetError(f"target r = {r:g} m must not be negative")
        target_xy = polar_to_xy([r, math.radians(theta_deg)])
        plan = policy.plan(target_xy)
        action = Action.from_array(plan.actions[0])
        trajectory = plan_trajectory(action, policy.config, policy.workspace)
        joint_path = trajectory.joint_path
        if joint_path is None:
            raise InputError("the planned motion has no joint path")

        offset_pct = 100 * float(np.linalg.norm(plan.predicted_xy[0] - target_xy)) / cable.length
        theta1_deg, theta2_deg, psi_deg = np.degrees(
            [action.theta1, action.theta2, plan.actions[0, 3]]
        )
        peaks_deg = np.degrees(joint_path.peak_speed)
        print(f"cable      {cable.name}, {cable.length:.2f} m")
        print(f"target     {polar_text(target_xy)}")
        print(
            f"action     theta1 = {theta1_deg:.2f} deg, theta2 = {theta2_deg:.2f} deg, "
            f"r2 = {action.r2:.4f} m, psi = {psi_deg:.2f} deg"
        )
        print(f"predicted  {polar_text(plan.predicted_xy[0])}")
        print(f"           {offset_pct:.2f} % of cable length from the target")
        if math.isfinite(plan.spread[0]):
            spread_pct = 100 * float(plan.spread[0]) / cable.length
            print(f"expected   real landings within {spread_pct:.1f} % of that along x and y (rms)")
        print(f"duration   {float(joint_path.times[-1]):.3f} s")
        speeds = ", ".join(f"q{k} {speed:.0f}" for k, speed in enumerate(peaks_deg, start=1))
        print(f"peak joint speeds [deg/s]  {speeds}")
        if not plan.inside_coverage[0]:
            print(
                "note: no simulated cast of this cable lands near this target; the action is the "
                "one predicted to land nearest to it"
            )
        if self.save:
            save_motion(joint_path, self.save)
            print(f"saved      {self.save} ({len(joint_path.times)} rows)")


def save_motion(joint_path: "JointPath", path: pathlib.Path) -> None:
    """Write a joint path as CSV: t [s], q1..q6 [rad], qd1..qd6 [rad/s].

    Args:
        joint_path: The motion at the robot's control cycle.
        path: The file.
    """
    from cablecast.files import write_text

    joints = range(1, joint_path.q.shape[1] + 1)
    lines = [",".join(["t", *(f"q{k}" for k in joints), *(f"qd{k}" for k in joints)])]
    for t, q, qd in zip(joint_path.times, joint_path.q, joint_path.qd, strict=True):
        lines.append(",".join([f"{t:.6f}", *(f"{value:.9f}" for value in (*q, *qd))]))
    write_text(path, "\n".join(lines) + "\n")
