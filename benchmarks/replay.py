"""Exported cables, played in the simulators that they were written for, against measured casts.

Casts of each cable in a virtual laboratory are fitted, and the fit is exported. Each exported file
is loaded by its own simulator, whose grip then moves as the arm was measured to move. The distance
of the free end from the measured one stands beside that of the package's engine.

What a simulator leaves out is left out of the package's engine, too: the growth of its distance is
what the effect is worth. `laws` compares the exported chain with ours on a cable with the same
physics in both, with one effect after the other: what MuJoCo plays otherwise grows apart.
"""

import abc
import dataclasses
import pathlib
import runpy
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import cablecast as cc
from benchmarks.common import has
from benchmarks.result import Table
from cablecast.cable import Cable, CableParams
from cablecast.cli.progress import console_progress
from cablecast.conventions import Array
from cablecast.data.dataset import Dataset
from cablecast.engines import make_engine
from cablecast.engines.base import CableState, Rollout
from cablecast.engines.mujoco_ import SERVO_OMEGA
from cablecast.engines.pybullet_ import BulletClient
from cablecast.exports import mujoco_
from cablecast.exports.facts import CableModel
from cablecast.motion.grip_path import GripPath
from cablecast.pipeline.export import export_cable
from cablecast.tuning.tracks import MeasuredTracks, TrackDistances, TrackObjective
from cablecast.tuning.tuned import Tuned
from cablecast.workspace import Workspace

BROKEN_DISTANCE = 10.0
"""Distance of the free end from the base [m] beyond which a cast has broken."""

NEWTON_DT, NEWTON_ITERATIONS = 1e-3, 10
"""Step [s], and iterations of a step, of Newton's solver VBD."""


def frames(nodes: Array, first: Array) -> Array:
    """Return frames of segments that do not twist, y along each, shape [segment, 3, 3].

    Args:
        nodes: Ends of the segments [m], shape [segment + 1, 3].
        first: Frame that the first one is turned from by its yaw and pitch, shape [3, 3].
    """
    found, steps = [], np.diff(nodes, axis=0)
    for direction in steps / np.linalg.norm(steps, axis=1, keepdims=True):
        x, y, z = first.T @ direction
        turn = Rotation.from_euler("ZX", [np.arctan2(-x, y), np.arcsin(np.clip(z, -1.0, 1.0))])
        first = first @ turn.as_matrix()
        found.append(first)
    return np.array(found)


def grip_frames(yaw: Array, pitch: Array) -> Array:
    """Return frames of a grip whose y is along the cable, shape [pose, 3, 3]."""
    return Rotation.from_euler("ZX", np.stack([-yaw, pitch], axis=-1)).as_matrix()


class Replay(abc.ABC):
    """A simulator that plays an exported cable, one cast after the other.

    It answers `Engine.rollout`, but the cable is that of its file.

    Attributes:
        segment_count: Number of segments of the file.
        dt: Step [s].
    """

    segment_count: int
    dt: float

    @abc.abstractmethod
    def start(self, nodes: Array, grip: Array) -> None:
        """Put the cable down at rest.

        Args:
            nodes: Ends of the segments [m], shape [segment + 1, 3].
            grip: Frame of the grip, y along the cable, shape [3, 3].
        """

    @abc.abstractmethod
    def advance(self, positions: Array, rotations: Array) -> None:
        """Take steps.

        Args:
            positions: Grip at the start of each step and after the last [m], shape [step + 1, 3].
            rotations: Frames of the grip there, shape [step + 1, 3, 3].
        """

    @abc.abstractmethod
    def tip(self) -> Array:
        """Return the cable's free end [m], shape [3]."""

    def rollout(
        self,
        cable: Cable,
        grip_path: GripPath,
        initial_state: CableState,
        duration: float,
        sample_dt: float,
        edges: Workspace | None = None,
    ) -> Rollout:
        """Play casts on an endless table; see `Engine.rollout`."""
        steps = max(1, round(sample_dt / self.dt))
        count = 1 + int(np.ceil(duration / (steps * self.dt) - 1e-9))
        track = np.full((len(grip_path), count, 3), np.nan)
        for world in range(len(grip_path)):
            path = grip_path[world]
            nodes = initial_state.positions[world]
            pose = path.evaluate(np.zeros(1))[0]
            self.start(nodes, grip_frames(pose[:, 3], pose[:, 4])[0])
            track[world, 0] = self.tip()
            for sample in range(1, count):
                times = ((sample - 1) * steps + np.arange(steps + 1)) * self.dt
                poses = path.evaluate(times)[0]
                self.advance(poses[:, :3], grip_frames(poses[:, 3], poses[:, 4]))
                track[world, sample] = self.tip()
                if not np.abs(track[world, sample]).max() < BROKEN_DISTANCE:
                    track[world, sample:] = np.nan
                    break
        return Rollout(
            times=np.arange(count) * (steps * self.dt),
            endpoint_xyz=track,
            final_state=initial_state,
            finite=np.isfinite(track).all(axis=(1, 2)),
        )


class ReplayMujoco(Replay):
    """MuJoCo and an exported file.

    Args:
        xml: Text of the file.
        part: Start of the names of the cable's bodies.
        dt: Step [s]; that of the file where None.
    """

    def __init__(self, xml: str, part: str, dt: float | None = None):
        import mujoco

        self.mujoco: Any = mujoco
        self.model = mujoco.MjModel.from_xml_string(xml)
        if dt is not None:
            self.model.opt.timestep = dt
        self.dt = float(self.model.opt.timestep)
        names = [self.model.body(i).name for i in range(self.model.nbody)]
        self.segment_count = sum(name.startswith(part) for name in names)


class ReplayChain(ReplayMujoco):
    """The exported chain of capsules.

    Args:
        xml: Text of the file.
        dt: Step [s]; that of the file where None.
    """

    def __init__(self, xml: str, dt: float | None = None):
        super().__init__(xml, "segment_", dt)
        weld = self.model.equality(0)
        # A mocap body has no velocity, so that the weld lags behind it by two time constants.
        self.lag = 2.0 * float(self.model.eq_solref[weld.id, 0])

    def start(self, nodes: Array, grip: Array) -> None:
        self.data = self.mujoco.MjData(self.model)
        qpos, before = self.data.qpos, grip
        for index, frame in enumerate(frames(nodes, grip)):
            yaw, pitch = Rotation.from_matrix(before.T @ frame).as_euler("ZXY")[:2]
            qpos[self.model.joint(f"side_{index}").qposadr] = yaw
            qpos[self.model.joint(f"lift_{index}").qposadr] = pitch
            before = frame
        qpos[:3] = nodes[0]
        qpos[3:7] = Rotation.from_matrix(grip).as_quat(scalar_first=True)
        self.data.mocap_pos[0], self.data.mocap_quat[0] = qpos[:3], qpos[3:7]
        self.mujoco.mj_forward(self.model, self.data)

    def advance(self, positions: Array, rotations: Array) -> None:
        speed = np.diff(positions, axis=0) / self.dt
        turns = Rotation.from_matrix(rotations)
        rate = (turns[1:] * turns[:-1].inv()).as_rotvec() / self.dt
        ahead = (Rotation.from_rotvec(self.lag * rate) * turns[1:]).as_quat(scalar_first=True)
        places = positions[1:] + self.lag * speed
        for place, quat in zip(places, ahead, strict=True):
            self.data.mocap_pos[0], self.data.mocap_quat[0] = place, quat
            self.mujoco.mj_step(self.model, self.data)

    def tip(self) -> Array:
        self.mujoco.mj_kinematics(self.model, self.data)
        return self.data.site("tip").xpos.copy()


class ReplayFlex(ReplayMujoco):
    """The exported 1-D flex.

    Args:
        xml: Text of the file.
        linear_damping: Rate that the file leaves to be set [1/s].
    """

    def __init__(self, xml: str, linear_damping: float):
        super().__init__(xml, "node_")
        for node in range(1, self.segment_count + 1):
            mass = self.model.body(f"node_{node}").mass[0]
            for axis in range(3):
                dof = self.model.joint(f"node_{node}_{axis}").dofadr
                self.model.dof_damping[dof] = linear_damping * mass

    def start(self, nodes: Array, grip: Array) -> None:
        self.data = self.mujoco.MjData(self.model)
        for node in range(1, self.segment_count + 1):
            place = nodes[node] - self.model.body(f"node_{node}").pos
            for axis in range(3):
                self.data.qpos[self.model.joint(f"node_{node}_{axis}").qposadr] = place[axis]
        self.data.qpos[:5] = self._pose(nodes[0], grip)
        self.mujoco.mj_forward(self.model, self.data)

    def _pose(self, position: Array, frame: Array) -> Array:
        return np.array(grip_pose(position - self.model.body("hand").pos, frame))

    def advance(self, positions: Array, rotations: Array) -> None:
        poses = np.array([self._pose(*one) for one in zip(positions, rotations, strict=True)])
        speed = np.diff(poses, axis=0) / self.dt
        acceleration = np.diff(speed, axis=0, prepend=speed[:1]) / self.dt
        ahead = poses[1:] + 2.0 * speed / SERVO_OMEGA + acceleration / SERVO_OMEGA**2
        for control in ahead:
            self.data.ctrl[:] = control
            self.mujoco.mj_step(self.model, self.data)

    def tip(self) -> Array:
        self.mujoco.mj_kinematics(self.model, self.data)
        return self.data.body(f"node_{self.segment_count}").xpos.copy()


class ReplayScript(Replay):
    """A simulator and an exported script.

    Args:
        script: File of the script.
    """

    def __init__(self, script: pathlib.Path):
        self.module = runpy.run_path(str(script))
        self.values = self.module["VALUES"]
        # Newton's leaves its step open.
        self.dt = self.values.get("dt", NEWTON_DT)
        self.segment_count = self.values["segment_count"]


class ReplayBullet(ReplayScript):
    """PyBullet and the exported URDF, which lies next to its script."""

    def start(self, nodes: Array, grip: Array) -> None:
        client = BulletClient()
        self.cable = self.module["Cable"](client)
        self.cable.add_table()
        found = frames(nodes, grip)
        before = np.concatenate([grip[None], found[:-1]])
        turns = Rotation.from_matrix(np.swapaxes(before, 1, 2) @ found).as_quat()
        # An attachment goes on as the cable ends.
        more = len(self.cable.joints) - len(turns)
        turns = np.concatenate([turns, np.tile([0.0, 0.0, 0.0, 1.0], (more, 1))])
        self.cable.place(grip_pose(nodes[0], grip), turns)

    def advance(self, positions: Array, rotations: Array) -> None:
        for place, frame in zip(positions[1:], rotations[1:], strict=True):
            self.cable.step(grip_pose(place, frame))

    def tip(self) -> Array:
        return self.cable.end()


class ReplayElastica(ReplayScript):
    """PyElastica and the exported rod."""

    def start(self, nodes: Array, grip: Array) -> None:
        import elastica as ea

        pose: dict[str, Array] = {}

        class System(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Contact, ea.Damping):
            pass

        class Held(ea.ConstraintBase):
            """The first element, its two nodes and its frame, moved with the grip."""

            def constrain_values(self, system: Any, time: Any) -> None:
                system.position_collection[:, :2] = pose["nodes"]
                system.director_collection[..., 0] = pose["frame"]

            def constrain_rates(self, system: Any, time: Any) -> None:
                system.velocity_collection[:, :2] = pose["velocity"]
                system.omega_collection[:, 0] = 0.0

        self.pose = pose
        behind = nodes[0] - self.values["segment_length"] * grip[:, 1]
        every = np.vstack([behind, nodes])
        self.rod = self.module["make_rod"](
            behind,
            grip[:, 1] * [1.0, 1.0, 0.0] / np.hypot(*grip[:2, 1]),
            position=every.T,
            directors=np.stack([self._directors(one) for one in frames(every, grip)], axis=-1),
        )
        self._hold(nodes[0], nodes[0], grip)
        self.system = System()
        self.system.append(self.rod)
        self.system.constrain(self.rod).using(Held)
        self.module["add_forces"](self.system, self.rod)
        self.system.finalize()
        self.stepper, self.time = ea.PositionVerlet(), 0.0

    @staticmethod
    def _directors(frame: Array) -> Array:
        """Return PyElastica's rows normal, binormal and tangent of a frame whose y is along."""
        x, y, _ = frame.T
        return np.stack([x, np.cross(y, x), y])

    def _hold(self, before: Array, place: Array, frame: Array) -> None:
        behind = place - self.values["segment_length"] * frame[:, 1]
        self.pose["nodes"] = np.stack([behind, place], axis=1)
        self.pose["frame"] = self._directors(frame)
        self.pose["velocity"] = ((place - before) / self.dt)[:, None]

    def advance(self, positions: Array, rotations: Array) -> None:
        for before, place, frame in zip(positions, positions[1:], rotations[1:], strict=False):
            self._hold(before, place, frame)
            self.time = self.stepper.step(self.system, self.time, self.dt)

    def tip(self) -> Array:
        return self.rod.position_collection[:, -1].copy()


class ReplayNewton(ReplayScript):
    """Newton and the exported rod, by its solver VBD."""

    def start(self, nodes: Array, grip: Array) -> None:
        import newton

        builder: Any = newton.ModelBuilder()
        points = np.vstack([nodes[0] - self.values["segment_length"] * grip[:, 1], nodes])
        bodies, _ = self.module["add_cable"](builder, points)
        builder.add_ground_plane(cfg=self.module["surface"](newton))
        builder.color()
        self.model: Any = builder.finalize(device="cpu")
        self.grip, self.end = bodies[0], bodies[-1]
        self.states = [self.model.state(), self.model.state()]
        self.control = self.model.control()
        self.pipeline = newton.CollisionPipeline(self.model)
        self.contacts = self.pipeline.contacts()
        self.solver = newton.solvers.SolverVBD(self.model, iterations=NEWTON_ITERATIONS)

    def _hold(self, place: Array, frame: Array) -> None:
        """Write the pose of the grip's segment, whose middle lies behind the grip."""
        middle = place - 0.5 * self.values["segment_length"] * frame[:, 1]
        # The axis z of a segment is along it.
        turned = Rotation.from_matrix(np.stack([frame[:, 0], -frame[:, 2], frame[:, 1]], axis=1))
        for state in self.states:
            state.body_q.numpy()[self.grip] = [*middle, *turned.as_quat()]

    def advance(self, positions: Array, rotations: Array) -> None:
        for place, frame in zip(positions[1:], rotations[1:], strict=True):
            self._hold(place, frame)
            self.pipeline.collide(self.states[0], self.contacts)
            self.solver.step(*self.states, self.control, self.contacts, self.dt)
            self.states.reverse()

    def tip(self) -> Array:
        x, y, z, *quat = self.states[0].body_q.numpy()[self.end]
        half = 0.5 * self.values["segment_length"]
        return np.array([x, y, z]) + Rotation.from_quat(quat).apply([0.0, 0.0, half])


def grip_pose(position: Array, frame: Array) -> list[float]:
    """Return x, y, z [m], yaw and pitch [rad] of a grip."""
    x, y, z = frame[:, 1]
    return [*position.tolist(), float(np.arctan2(x, y)), float(np.arcsin(np.clip(z, -1.0, 1.0)))]


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlayedArgs:
    """Casts that cables are fitted to, and that are played again."""

    lab: int = 0
    """Seed of the virtual laboratory."""
    fitted: int = 10
    """Casts that a cable is fitted to."""
    played: int = 3
    """The first of them, which are played again."""
    out: pathlib.Path = pathlib.Path("runs/benchmarks/replay")
    """Folder of casts, fits and exported files, in which the same command resumes."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args(PlayedArgs):
    """Export fitted cables, and play the casts again in other simulators."""

    cables: tuple[str, ...] = ("cable_1", "cable_2", "cable_3")
    """Names of the cables."""


COARSE = 20
"""Segments of EngineWarp in the table of effects: those of the exported chain."""

LEFT_OUT: dict[str, dict[str, float]] = {
    "rolling": {"rolling_friction": 0.1},
    "angular damping": {"angular_damping": 0.0},
    "damping time": {"damping_time": 0.0},
    "bends that stay": {"yield_curvature": 0.0},
    "grain of the friction": {"friction_ratio": 1.0},
    "length of the attachment": {"attachment_arm": 0.0},
    "drag of the air": {"drag_coefficient": 0.0},
    "curl": {"rest_curvature": 0.0},
}
"""Values with which an effect is left out, by its name."""

PURE = {
    **{name: value for values in LEFT_OUT.values() for name, value in values.items()},
    **dict.fromkeys(("rolling_friction", "spinning_friction"), 0.0),
}
LAW_DAMPING_TIME = 0.01
"""Damping time of the cable whose effects are compared [s]."""
LAW_TIME = 1.1
"""Time over which frictions are compared [s]; later small differences decide where a cable goes."""


def fitted_cable(name: str, args: Any) -> tuple[Dataset, Tuned]:
    """Return casts of a virtual laboratory, and the fit to them."""
    folder = args.out / f"{name}-{args.lab}-{args.fitted}"
    setup = cc.Setup(cable=name)
    with console_progress() as progress, cc.make_rig(f"virtual:{args.lab}", setup) as rig:
        casts = cc.collect(rig, count=args.fitted, out=folder / "casts", progress=progress)
        return casts, cc.tune(casts, out=folder / "tune", progress=progress)


def players(tuned: Tuned, folder: pathlib.Path) -> Iterator[tuple[str, Callable[[], Replay]]]:
    """Yield the name of each simulator that is installed, and what loads the exported file."""
    name = tuned.setup.cable.name
    damping = float(np.asarray(tuned.params.linear_damping))
    if has("mujoco"):
        chain, flex = folder / f"{name}_chain.xml", folder / f"{name}_flex.xml"
        yield "MuJoCo, chain of capsules", lambda: ReplayChain(chain.read_text())
        yield "MuJoCo, 1-D flex", lambda: ReplayFlex(flex.read_text(), damping)
    if has("pybullet"):
        yield "PyBullet", lambda: ReplayBullet(folder / f"{name}_pybullet.py")
    if has("elastica"):
        yield "PyElastica", lambda: ReplayElastica(folder / f"{name}_elastica.py")
    if has("newton"):
        yield "Newton, VBD", lambda: ReplayNewton(folder / f"{name}_newton.py")


COLUMNS = (
    "cable",
    "simulator",
    "segments",
    "step [ms]",
    "on the way, median [%]",
    "over ours",
    "on the way, mean [%]",
    "at rest, median [%]",
    "broken casts",
    "computing time of a cast [s]",
)


def median_pct(found: TrackDistances, cable: Cable) -> float:
    """Return the median distance on the way [% of cable length]."""
    return 100 * float(np.nanmedian(found.mean)) / cable.length


def row(
    cable: Cable, name: str, engine: Any, found: TrackDistances, own: float, seconds: float
) -> tuple:
    """Return a row of the table of replays; distances are those of one candidate."""
    median, share = median_pct(found, cable), 100 / cable.length
    return (
        cable.name,
        name,
        engine.segment_count,
        1e3 * engine.dt,
        median,
        median / own,
        share * np.nanmean(found.mean),
        share * np.nanmedian(found.final),
        int((~found.finite).sum()),
        seconds / found.mean.size,
    )


def main(args: Args) -> Iterator[Table]:
    """Yield the distances of each simulator, and what each effect is worth."""
    replays = Table("Distance from the measured casts, in % of cable length", COLUMNS, [])
    columns = ("cable", "left out of EngineWarp", "on the way, median [%]", "over all of them")
    effects = Table("What an effect is worth", columns, [])
    for name in args.cables:
        casts, tuned = fitted_cable(name, args)
        folder = args.out / "models"
        export_cable(tuned, folder)
        cable, tracks = casts.cable, MeasuredTracks.from_dataset(casts)[: args.played]
        engine = make_engine("warp")
        start = time.process_time()
        found = TrackObjective(engine, cable, tracks).distances(tuned.params)
        seconds = time.process_time() - start
        own = median_pct(found, cable)
        replays.rows.append(row(cable, "EngineWarp", engine, found, own, seconds))
        for simulator, load in players(tuned, folder):
            start, replay = time.process_time(), load()
            found = TrackObjective(replay, cable, tracks).distances(tuned.params)
            seconds = time.process_time() - start
            replays.rows.append(row(cable, simulator, replay, found, own, seconds))
            print(*replays.rows[-1], file=sys.stderr, flush=True)
        for effect, values in LEFT_OUT.items():
            without = dataclasses.replace(tuned.params, **values)
            if without == tuned.params:
                continue
            median = median_pct(TrackObjective(engine, cable, tracks).distances(without), cable)
            effects.rows.append((name, effect, median, median / own))
        coarse = make_engine("warp", COARSE)
        median = median_pct(TrackObjective(coarse, cable, tracks).distances(tuned.params), cable)
        effects.rows.append((name, f"segments, but for {COARSE}", median, median / own))
    yield from (replays, effects)


@dataclasses.dataclass(frozen=True, kw_only=True)
class LawArgs(PlayedArgs):
    """Compare the exported chain with EngineWarp, with one effect after the other."""

    cable: str = "cable_1"
    """Name of the cable."""


SLIDING = "sliding friction alone"
FINE_DT, HARD_TIME = 5e-4, 1e-3
"""Step and time constant of contacts [s] with which the chain slides once more."""


def hardened(xml: str) -> str:
    """Return a chain whose contacts push it out of the table within `HARD_TIME`."""
    return xml.replace(
        f'solref="{mujoco_.CONTACT_TIME} 1" solimp', f'solref="{HARD_TIME} 1" solimp'
    )


ADDED: dict[str, tuple[str, ...]] = {
    SLIDING: (),
    "grain of the friction": ("friction_ratio",),
    "bends that stay": ("yield_curvature",),
    "length of the attachment": ("attachment_arm",),
    "drag of the air": ("drag_coefficient",),
    "spinning friction": ("spinning_friction",),
}
"""Parameters of the fit that are added to sliding friction, by the effect's name."""


def laws(args: LawArgs) -> Iterator[Table]:
    """Yield the distance of the chain from EngineWarp with the same physics, by the effect."""
    casts, tuned = fitted_cable(args.cable, args)
    tracks, cable = MeasuredTracks.from_dataset(casts)[: args.played], tuned.setup.cable
    samples = int((tracks.times[0] <= LAW_TIME).sum())
    short = dataclasses.replace(
        tracks, times=tracks.times[:, :samples], endpoint_xy=tracks.endpoint_xy[:, :samples]
    )
    sliding = {"damping_time": LAW_DAMPING_TIME, "rolling_friction": mujoco_.NO_ROLLING}
    bare = dataclasses.replace(tuned.params, **(PURE | sliding))
    cases = {"no friction": dataclasses.replace(bare, lateral_friction=0.0)}
    for name, added in ADDED.items():
        values = {parameter: getattr(tuned.params, parameter) for parameter in added}
        cases[name] = dataclasses.replace(bare, **values)
    cases["rolling"] = dataclasses.replace(bare, rolling_friction=0.0)
    rows: list[tuple] = []

    def tips(engine: Any, params: CableParams) -> Array:
        return TrackObjective(engine, cable, short).tracks_of(params)[0][0, :, :-1]

    def compare(name: str, *pair: Array) -> None:
        apart = 100 * np.linalg.norm(pair[0] - pair[1], axis=-1)[:, -1] / cable.length
        rows.append((name, float(np.median(apart)), float(apart.max())))
        print(*rows[-1], file=sys.stderr, flush=True)

    for name, params in cases.items():
        model = CableModel(cable=cable.with_params(params), segment_count=COARSE)
        xml = mujoco_.chain_xml(model, rolls=name == "rolling")
        own = tips(make_engine("warp", COARSE), params)
        compare(name, tips(ReplayChain(xml), params), own)
        if name != SLIDING:
            continue
        for words, changed in (
            (f"{name}, steps of {1e3 * FINE_DT:g} ms", xml),
            (f"{name}, these steps, contacts of {1e3 * HARD_TIME:g} ms", hardened(xml)),
        ):
            compare(words, tips(ReplayChain(changed, FINE_DT), params), own)
        fine = tips(make_engine("warp", 4 * COARSE), params)
        compare(f"{name}, EngineWarp with {4 * COARSE} segments in place of the chain", fine, own)
    title = f"The chain from EngineWarp after {LAW_TIME:g} s, {COARSE} segments in both"
    columns = ("effect", "chain from EngineWarp, median [%]", "largest [%]")
    yield Table(title, columns, rows)
