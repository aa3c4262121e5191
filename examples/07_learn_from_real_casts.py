"""Teach a model what its simulator does not know, with a few dozen casts on a robot.

The model of 04_train_and_plan.py has seen simulated casts alone. A robot now makes some, and a
Gaussian process learns from them where it lands otherwise, and how surely. The search then prefers
casts that it can trust. To be quick, the robot is the simulator with another cable in it; take
`make_rig` and `virtual` or a rig of your own instead.
"""

import pathlib

from cablecast.cable import Cable, CableParams
from cablecast.datasets.collect import collect_dataset
from cablecast.engines.warp_ import EngineWarp
from cablecast.evaluation.evaluate import evaluate_policy
from cablecast.models.adaptation import correct_model
from cablecast.models.forward import ForwardModel
from cablecast.policies.forward_search import ForwardSearchPolicy
from cablecast.rigs.engine import RigEngine
from cablecast.workspace import Workspace, load_targets


def other_cable(cable: Cable, workspace: Workspace) -> RigEngine:
    """A robot whose cable is stiffer, and slides more easily, than believed."""
    params = cable.params.to_dict()
    params["bend_stiffness"] *= 2.0
    params["lateral_friction"] *= 0.8
    return RigEngine(EngineWarp(), cable, workspace, CableParams(**params))


def main(
    out: pathlib.Path = pathlib.Path("runs/examples"),
    count: int = 60,
    candidate_count: int = 10_000,
) -> None:
    model = ForwardModel.load(out / "model")
    before = ForwardSearchPolicy.load(out / "model", model)
    cable, config, workspace = before.cable, before.config, before.workspace
    rig = other_cable(cable, workspace)
    try:
        real = collect_dataset(
            out / "real-data", rig, cable, config, workspace, purpose="real", count=count
        )
        corrected = correct_model(model, real, seed=0)
        metrics = corrected.metrics
        print(
            f"{metrics['real_used_count']} casts landed; the model missed them by a median of "
            f"{metrics['real_before_median_pct']:.1f} % of length,"
        )
        print(f"and by {metrics['real_median_pct']:.1f} % when it had learned from the others")
        after = ForwardSearchPolicy.build(corrected, config, workspace, candidate_count, seed=0)
        corrected.save(out / "model-correction")
        after.save(out / "model-correction")

        targets = load_targets()[::4]
        for name, policy in (("simulated casts alone", before), ("with real casts", after)):
            evaluation = evaluate_policy(policy, rig, targets, cable, config, workspace)
            summary = evaluation.summary
            landed = f"{summary.count} of {len(targets)} casts landed on the table"
            print(f"{name}: {landed}, median {summary.median_pct:.1f} % of length off")
    finally:
        rig.close()


if __name__ == "__main__":
    main()
