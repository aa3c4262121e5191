"""A rig of one's own: three methods and a description between cablecast and any robot.

Put a class like this into a module and give it to any verb that casts, for example
`cablecast collect --rig my_lab:make_rig`; docs/your-own-rig.md explains each method. This one only
pretends: its joints lag behind their set points, it plays what they do in the engine with an
endpoint that is heavier than believed, and its camera sees to 2 mm. `make_rig` of cablecast checks
every answer of it: units, times, places and joints.
"""

import pathlib

import numpy as np

import cablecast as cc
from cablecast.motion.measured import grip_path_from_joints
from cablecast.motion.trajectory import JointPath
from cablecast.rigs.base import purpose_seed

LAG = 0.03  # Time constant of the pretended servo [s].


class PretendRig(cc.RigLifecycle):
    """RigLifecycle refuses a motion without a reset, and any after close()."""

    def __init__(self, setup: cc.Setup, seed: int):
        super().__init__()
        self.setup, self.seed = setup, seed
        self.draw_seed, self.trial = seed, 0
        self.engine = cc.EngineWarp()
        believed = setup.cable.params.to_dict()
        heavier = {"endpoint_mass": 1.3 * believed["endpoint_mass"]}
        self.params = cc.CableParams(**(believed | heavier))
        # What the rig is, for the record; plain values, equal whenever the rig is made again.
        self.description = {"rig": "pretend", "seed": seed, "lag": LAG}

    def seek(self, index: int, purpose: str = "") -> None:
        """Let the next trial be the index-th of a purpose; only a rig that draws needs this."""
        self.draw_seed, self.trial = purpose_seed(self.seed, purpose), index

    def reset(self) -> None:
        """Lift the cable, let it hang, cast it forward and pull it straight, on a real rig."""
        super().reset()

    def execute(self, trajectory: cc.Trajectory) -> cc.EndpointTrack:
        """Send trajectory.joint_path to the arm and watch with a camera, on a real rig."""
        self._use_reset()
        joints = self.move(trajectory.joint_path)
        path = grip_path_from_joints(joints, self.setup.arm) if joints else trajectory.grip_path
        rollout = self.engine.rollout(self.setup.cable.with_params(self.params), path)
        random = np.random.default_rng([self.draw_seed, self.trial])
        self.trial += 1
        seen = rollout.endpoint_xy[0] + random.normal(scale=0.002, size=(len(rollout.times), 2))
        stayed = np.all(self.setup.workspace.on_table(seen))
        return cc.EndpointTrack(
            times=rollout.times,
            endpoint_xy=seen,
            status=cc.TrialStatus.OK if stayed else cc.TrialStatus.OFF_TABLE,
            joint_path=joints,
        )

    def move(self, command: JointPath | None) -> JointPath | None:
        """Return what the arm reports: joints that follow their set points with a lag."""
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
        """Stop the arm and close the connections, on a real rig."""
        super().close()


def make_rig(setup: cc.Setup, seed: int) -> PretendRig:
    """Make the rig that `--rig` names, for a set-up and a seed."""
    return PretendRig(setup, seed)


def main(out: pathlib.Path = pathlib.Path("runs/examples")) -> None:
    setup = cc.Setup()
    with cc.make_rig(make_rig, setup, seed=0) as rig:
        # Stopped at any moment, even by a power cut, this goes on where it was.
        data = cc.collect(rig, count=4, out=out / "pretend-tune-data")
        for row, action in enumerate(data.actions):
            track, joints = data.track(row), data.measured_joints(row)
            moved = np.degrees(np.ptp(joints.q[:, 0])) if joints else float("nan")
            print(f"action {action.round(2)}: {track.status.code}, base turned {moved:.0f} deg")
        # Polar casting needs no model; a policy that cc.train returns is given in the same way.
        policy = cc.PolarCastingPolicy(setup=setup)
        evaluation = cc.evaluate(policy, rig, cc.load_targets()[:4])
    for number, (cast, error) in enumerate(
        zip(evaluation.casts, evaluation.errors_pct, strict=True)
    ):
        print(f"target {number}: {cast.status.code}, error {error:.1f} % of length")
    summary = evaluation.summary
    print(f"median {summary.median_pct:.1f} % over {summary.count} casts")


if __name__ == "__main__":
    main()
