"""Teach a model what its simulator does not know, with a few dozen casts on a robot.

A model of simulated casts alone misses where the simulator differs from the robot. A Gaussian
process learns the difference from casts on the robot, and how far it scatters; the policy then
prefers casts that it can trust. To be quick, the robot is the simulator with another cable in it:
take `cc.make_rig("virtual", setup)` or a rig of your own instead.
"""

import pathlib

import cablecast as cc
from cablecast.rigs.engine import RigEngine


def other_cable(setup: cc.Setup) -> RigEngine:
    """Return a robot whose cable is stiffer, and slides more easily, than believed."""
    params = setup.cable.params.to_dict()
    params["bend_stiffness"] *= 2.0
    params["lateral_friction"] *= 0.8
    return RigEngine(cc.EngineWarp(), setup, cc.CableParams(**params))


def main(
    out: pathlib.Path = pathlib.Path("runs/examples"),
    simulated_count: int = 8000,
    real_count: int = 60,
    candidate_count: int = 10_000,
) -> None:
    setup = cc.Setup()
    # With a folder, each step goes on where it was stopped.
    simulated = cc.simulate(setup, count=simulated_count, out=out / "dataset")
    before = cc.train(simulated, candidate_count=candidate_count, epochs=30, out=out / "model")
    with cc.make_rig(other_cable(setup), setup) as rig:
        real = cc.collect(rig, purpose="real", count=real_count, out=out / "real-data")
        after = cc.train(
            simulated,
            real,
            start=before.model,
            candidate_count=candidate_count,
            out=out / "model-fine-tuning",
        )
        metrics = after.model.metrics
        print(
            f"{metrics['real_used_count']} casts landed; the model missed them by a median of "
            f"{metrics['real_before_median_pct']:.1f} % of length,"
        )
        print(f"and by {metrics['real_median_pct']:.1f} % when it had learned from the others")
        targets = cc.load_targets()[::4]
        for name, policy in (("simulated casts alone", before), ("with real casts", after)):
            summary = cc.evaluate(policy, rig, targets).summary
            landed = f"{summary.count} of {len(targets)} casts landed on the table"
            print(f"{name}: {landed}, median {summary.median_pct:.1f} % of length off")


if __name__ == "__main__":
    main()
