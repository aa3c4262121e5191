"""A rig of one's own: four methods between cablecast and any robot.

Put a class like this into a module and give it to any verb that casts, for example
`cablecast collect --rig my_lab:make_rig`; docs/your-own-rig.md explains each method. This one only
pretends: its joints lag behind their set points, it plays what they do in the engine with an
endpoint that is heavier than believed, and its camera sees to 2 mm. The policy is the one of
04_train_and_plan.py.
"""

import pathlib

import numpy as np

from cablecast.cable import Cable, CableParams
from cablecast.datasets.collect import collect_dataset
from cablecast.datasets.trials import measured_joints, trial_track
from cablecast.engines.warp_ import EngineWarp
from cablecast.evaluation.evaluate import evaluate_policy
from cablecast.motion.joint_path import JointPath
from cablecast.motion.measured import grip_path_from_joints
from cablecast.motion.trajectory import Trajectory
from cablecast.policies.forward_search import ForwardSearchPolicy
from cablecast.rigs.base import RigLifecycle
from cablecast.track import EndpointTrack, TrialStatus
from cablecast.workspace import Workspace, load_targets

LAG = 0.03  # Time constant of the pretended servo [s].


class PretendRig(RigLifecycle):
    """RigLifecycle refuses a motion without a reset, and any after close()."""

    def __init__(self, cable: Cable, workspace: Workspace, seed: int):
        super().__init__()
        self.cable, self.workspace, self.seed = cable, workspace, seed
        self.trial = 0
        self.engine = EngineWarp()
        believed = cable.params.to_dict()
        self.params = CableParams(**(believed | {"endpoint_mass": 1.3 * believed["endpoint_mass"]}))
        # What the rig is, for the record; plain values, equal whenever the rig is made again.
        self.description = {"rig": "pretend", "seed": seed, "lag": LAG}

    def seek(self, index: int) -> None:
        """Optional: the next trial is the index-th. Only a rig that draws by chance needs it."""
        self.trial = index

    def reset(self) -> None:
        """A real rig lifts the cable, lets it hang, casts it forward and pulls it straight."""
        super().reset()

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        """A real rig sends trajectory.joint_path to the arm and watches with a camera."""
        self._use_reset()
        joints = self.move(trajectory.joint_path)
        grip_path = grip_path_from_joints(joints) if joints else trajectory.grip_path
        rollout = self.engine.rollout(self.cable, self.params, grip_path)
        random = np.random.default_rng([self.seed, self.trial])
        self.trial += 1
        seen = rollout.endpoint_xy[0] + random.normal(scale=0.002, size=(len(rollout.times), 2))
        stayed = np.all(self.workspace.on_table(seen))
        return EndpointTrack(
            times=rollout.times,
            endpoint_xy=seen,
            status=TrialStatus.OK if stayed else TrialStatus.OFF_TABLE,
            joint_path=joints,
        )

    def move(self, command: JointPath | None) -> JointPath | None:
        """What the arm reports: joints that follow their set points with a lag."""
        if command is None:
            return None
        tail = round(10 * LAG / command.times[1])
        q = np.concatenate([command.q, np.tile(command.q[-1], (tail, 1))])
        times = command.times[1] * np.arange(len(q))
        share = 1.0 - np.exp(-command.times[1] / LAG)
        for tick in range(1, len(q)):
            q[tick] = q[tick - 1] + share * (q[tick] - q[tick - 1])
        return JointPath(times=times, q=q, qd=np.gradient(q, times, axis=0))

    def close(self) -> None:
        """A real rig stops the arm and closes its connections."""
        super().close()


def make_rig(cable: Cable, workspace: Workspace, seed: int) -> PretendRig:
    """What `--rig` names: called with the cable, the workspace and the seed."""
    return PretendRig(cable, workspace, seed)


def main(out: pathlib.Path = pathlib.Path("runs/examples")) -> None:
    policy = ForwardSearchPolicy.load(out / "model")
    cable, config, workspace = policy.cable, policy.config, policy.workspace
    rig = make_rig(cable, workspace, seed=0)
    try:
        # Stopped at any moment, even by a power cut, this goes on where it was.
        data = collect_dataset(
            out / "tune-data", rig, cable, config, workspace, purpose="tune", count=4
        )
        for row, action in enumerate(data.actions):
            track, joints = trial_track(data, row), measured_joints(data, row)
            moved = np.degrees(np.ptp(joints.q[:, 0])) if joints else float("nan")
            print(f"action {action.round(2)}: {track.status.code}, base turned {moved:.0f} deg")
        evaluation = evaluate_policy(policy, rig, load_targets()[:6], cable, config, workspace)
    finally:
        rig.close()
    for trial, error in zip(evaluation.trials, evaluation.errors_pct, strict=True):
        print(f"target {trial.target_index}: {trial.status.code}, error {error:.1f} % of length")
    print(f"median {evaluation.summary.median_pct:.1f} % over {evaluation.summary.count} casts")


if __name__ == "__main__":
    main()
