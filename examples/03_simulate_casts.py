"""Many casts at once in the fast engine.

A batch has one row per world. Here one cable is cast with several actions, and then one action is
cast with several cables that differ in their friction with the table.
"""

import pathlib

import numpy as np

import cablecast as cc
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import feasible_grid

HERE = pathlib.Path(__file__).parent


def main(count: int = 200) -> None:
    setup = cc.Setup(cable=HERE / "my_cable.yaml")
    cable, engine = setup.cable, cc.EngineWarp()

    # Actions that the arm can carry out, spread over a grid.
    actions = feasible_grid(count, setup)
    rollout = engine.rollout(cable, cast_grip_paths(actions, setup))
    landings = rollout.endpoint_xy[:, -1]
    on_table = setup.workspace.on_table(landings)
    print(f"{count} casts of {cable.name}: {on_table.sum()} landed on the table")
    print(f"the farthest landed {np.hypot(*landings[on_table].T).max():.2f} m from the robot")

    # Every parameter is a number for all worlds, or one number per world.
    frictions = np.linspace(0.3, 1.2, 4)
    params = cc.CableParams(**{**cable.params.to_dict(), "worksurface_friction": frictions})
    rollout = engine.rollout(cable.with_params(params), cast_grip_paths(actions[:1], setup))
    for friction, (x, y) in zip(params.friction, rollout.endpoint_xy[:, -1], strict=True):
        print(f"  Coulomb coefficient {friction:.2f}: lands at x = {x:+.3f} m, y = {y:.3f} m")


if __name__ == "__main__":
    main()
