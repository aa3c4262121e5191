"""A rig of one's own: four methods between cablecast and any robot.

Put a class like this into a module and give it to the command line:
`cablecast evaluate --rig my_lab:make_rig`. This one only pretends: it plays the motion in the
engine with an endpoint that is heavier than believed, and its camera sees to 2 mm. The policy is
the one of 04_train_and_plan.py.
"""

import pathlib

import numpy as np

from cablecast.cable import Cable, CableParams
from cablecast.engines.warp_ import EngineWarp
from cablecast.evaluation.evaluate import evaluate_policy
from cablecast.motion.trajectory import Trajectory
from cablecast.policies.forward_search import ForwardSearchPolicy
from cablecast.track import EndpointTrack, TrialStatus
from cablecast.workspace import Workspace, load_targets


class PretendRig:
    def __init__(self, cable: Cable, workspace: Workspace, seed: int):
        self.cable, self.workspace = cable, workspace
        self.random = np.random.default_rng(seed)
        self.engine = EngineWarp()
        believed = cable.params.to_dict()
        self.params = CableParams(**(believed | {"endpoint_mass": 1.3 * believed["endpoint_mass"]}))
        # What the rig is, for the record; plain values.
        self.description = {"rig": "pretend", "endpoint_mass": self.params.endpoint_mass}

    def reset(self) -> None:
        """A real rig lifts the cable, lets it hang, casts it forward and pulls it straight."""

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """A real rig sends trajectory.joint_path to the arm and watches with a camera."""
        rollout = self.engine.rollout(
            self.cable, self.params, trajectory.grip_path, record_nodes=True
        )
        seen = rollout.endpoint_xy[0] + self.random.normal(
            scale=0.002, size=(len(rollout.times), 2)
        )
        stayed = np.all(self.workspace.on_table(seen))
        return EndpointTrack(
            times=rollout.times,
            endpoint_xy=seen,
            status=TrialStatus.OK if stayed else TrialStatus.OFF_TABLE,
            nodes=rollout.nodes[0],
        )

    def close(self) -> None:
        """A real rig stops the arm and closes its connections."""


def make_rig(cable: Cable, workspace: Workspace, seed: int) -> PretendRig:
    """What `--rig` names: called with the cable, the workspace and the seed."""
    return PretendRig(cable, workspace, seed)


def main(out: pathlib.Path = pathlib.Path("runs/examples")) -> None:
    policy = ForwardSearchPolicy.load(out / "model")
    rig = make_rig(policy.cable, policy.workspace, seed=0)
    targets = load_targets()[:6]
    try:
        evaluation = evaluate_policy(
            policy, rig, targets, policy.cable, policy.config, policy.workspace
        )
    finally:
        rig.close()
    for trial, error in zip(evaluation.trials, evaluation.errors_pct, strict=True):
        print(f"target {trial.target_index}: {trial.status.code}, error {error:.1f} % of length")
    print(f"median {evaluation.summary.median_pct:.1f} % over {evaluation.summary.count} casts")


if __name__ == "__main__":
    main()
