"""Strike points in the air with a rope that nobody measured, in simulation.

The rope hangs from a stick in a UR5's hand. The aim believes its numbers within factors of 1.5 to
2.5; a finer simulated rope plays the world.
"""

import dataclasses

import numpy as np

import cablecast as cc
from cablecast.aiming.strike import StrikeAim, StrikePrior
from cablecast.engines.swing import SwingModel
from cablecast.motion.joint_move import JointMoves, Stick
from cablecast.tuning.tips import TipBelief, air_cable

GOALS = ([-0.11, 1.3, 0.9], [-0.11, 1.7, 0.4])


def main(move_count: int = 256, cable_count: int = 8, tries: int = 3) -> None:
    start = tuple(np.radians([0, -70, 150, -170, -90, 0]))
    # The elbow moves by -60 to -180 degrees, the first wrist joint by 60 to -120.
    low, high = (1.0, *np.radians([-60, 60])), (3.0, *np.radians([-180, -120]))
    moves = JointMoves(
        arm=cc.ArmUR(), stick=Stick(length=0.5), start=start, joints=(2, 3), low=low, high=high,
        ramp_time=0.2,
    )  # fmt: skip
    engine = cc.EngineWarp(segment_count=20, dt=1e-3, table=False)
    model = SwingModel(moves=moves, engine=engine, duration=2.0)
    belief = TipBelief(
        cable=air_cable(0.9, 0.06, 0.03, 0.1, 0.015), deviations=(1.5, 2.0, 2.0, 2.5, 2.0)
    )
    prior = StrikePrior.simulate(model, belief, move_count=move_count, cable_count=cable_count)

    finer = cc.EngineWarp(segment_count=30, dt=5e-4, table=False)
    world = dataclasses.replace(model, engine=finer)
    rope = air_cable(1.1, 0.04, 0.02, 0.06, 0.015)
    for goal in GOALS:
        aim = StrikeAim(prior, goal)
        for _ in range(tries):
            unit = aim.propose()
            swings = world.play(world.motion(unit), rope, nodes=True)
            tip = swings.tip[0][: swings.contacts(np.array([0]))[0]]
            miss = aim.observe(unit, tip)
            speed, elbow, wrist = moves.values(unit)
            print(
                f"goal {goal}: {speed:.2f} rad/s, elbow {np.degrees(elbow):.0f} deg, "
                f"wrist {np.degrees(wrist):.0f} deg: {100 * miss:.1f} cm off"
            )
    assert aim.posterior is not None
    print(f"the rope is {100 * aim.posterior.cable.length:.0f} cm long: {rope.length:.2f} m it was")


if __name__ == "__main__":
    main()
