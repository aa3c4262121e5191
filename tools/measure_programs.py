"""Run the program of each kind of motion on the twin's controller: its size, and how true it is.

    python tools/measure_programs.py

Deviations are those of the set points that the controller followed from the planned path.
"""

import pathlib

import numpy as np

from cablecast.motion.casting import Action
from cablecast.motion.polar import plan_reset, reset_pose
from cablecast.motion.trajectory import JointPath, plan_trajectory
from cablecast.rigs.arm import REHEARSAL_SLOWNESS
from cablecast.rigs.path import JointCurve, check_path
from cablecast.rigs.ur.program import HOLD_TIME, motion_program
from cablecast.rigs.ur.rtde import BEAT
from cablecast.rigs.ur.twin.controller import Controller
from cablecast.setup import Setup, load_setup

ROOT = pathlib.Path(__file__).parents[1]
ACTION = Action(-0.7, 0.6, 0.65, 1.0)


def plan(kind: str, setup: Setup) -> JointPath:
    """Return the planned path of a reset, or of a cast."""
    if kind == "reset":
        return plan_reset(reset_pose(setup.workspace), setup).joint_path
    return plan_trajectory(ACTION, setup).joint_path


def followed(controller: Controller, text: str) -> np.ndarray:
    """Return the set points of a program from the start of its motion [rad], shape [tick, 6]."""
    controller.load(text)
    beat = f"input_int_register_{controller.robot.input_register + BEAT}"
    q = []
    while controller.is_running_program:
        controller.inputs[beat] += 1
        controller.tick()
        q.append(controller.target_q)
    return np.array(q[round(HOLD_TIME / controller.dt) - 1 :])


def main() -> None:
    """Print one line a kind of motion and control rate."""
    print("| motion | rate [Hz] | time [s] | pieces | size [kB] | deviation [mrad] |")
    print("|---|---|---|---|---|---|")
    for kind in ("cast", "rehearsal", "reset"):
        for dt in (0.008, 0.002):
            setup = load_setup(ROOT / "examples" / "twin.yaml").with_motion(control_dt=dt)
            path = plan(kind, setup)
            slowness = REHEARSAL_SLOWNESS if kind == "rehearsal" else 1
            curve = JointCurve.fit(path).slowed(slowness)
            check_path(curve, setup, kind)
            text = motion_program(f"cablecast_{kind}", curve, setup.robot, 1)
            controller = Controller(setup, curve.q[0], "e-series" if dt == 0.002 else "cb3")
            q = followed(controller, text)[::slowness][: len(path.q)]
            off = float(np.abs(q - path.q[: len(q)]).max())
            stops = [event for event in controller.events if event["what"] == "protective stop"]
            if stops or len(q) < len(path.q):
                raise SystemExit(f"the {kind} was not carried out: {stops}")
            print(
                f"| {kind} | {1 / dt:.0f} | {curve.duration:.2f} | {len(curve.times) - 1} | "
                f"{len(text) / 1000:.1f} | {1000 * off:.3f} |"
            )


if __name__ == "__main__":
    main()
