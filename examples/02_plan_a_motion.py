"""From four numbers to what a robot's controller is sent.

An action says where the gripper turns back, where it stops, and where the cable points in the end.
It becomes a smooth path of the gripper, and that a path of the arm's six joints.
"""

import numpy as np

import cablecast as cc


def main() -> None:
    setup = cc.Setup()
    # Sweep 40 degrees to the left, back over the axis to 30 degrees on the right, while the radius
    # goes from 0.60 m to 0.70 m; meanwhile the wrist turns the cable to 50 degrees.
    action = cc.Action(theta1=np.radians(-40), theta2=np.radians(30), r2=0.70, psi=np.radians(50))
    trajectory = cc.plan_trajectory(action, setup)
    print(f"duration {trajectory.duration:.3f} s")

    times = np.linspace(0.0, trajectory.duration, 6)
    for t, (x, y, _, yaw, _) in zip(times, trajectory.grip_path.evaluate(times)[0], strict=True):
        print(
            f"  t = {t:.2f} s: gripper at x = {x:+.3f} m, y = {y:.3f} m, cable leaves it at "
            f"{np.degrees(yaw):+6.1f} deg"
        )

    joint_path = trajectory.joint_path
    print("peak joint speeds [deg/s]:", np.degrees(joint_path.peak_speed).round(1))
    print(f"{len(joint_path.times)} set points at 125 Hz")

    # The mirror image of an action lands the cable at the mirror image of the place.
    mirrored = cc.plan_trajectory(action.mirrored(), setup)
    end, mirrored_end = (
        path.evaluate([9.0])[0, 0] for path in (trajectory.grip_path, mirrored.grip_path)
    )
    print(
        f"the gripper ends at x = {end[0]:+.3f} m, that of the mirror at {mirrored_end[0]:+.3f} m"
    )


if __name__ == "__main__":
    main()
