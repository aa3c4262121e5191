"""Try every fault of the robot in every phase of a trial, and yield what came of it.

    python -m benchmarks faults
    python -m benchmarks faults --generations e-series --faults protective_stop --phases cast

What was tried is kept in a file, so that the command goes on where it was stopped.

Each session runs the real arm's code (`RigArm`) against a twin through its sockets. Its reset only
lifts the cable and sets it down: with the paper's reset, which takes 17 s, the table would take
hours. For the same reason the arm holds a stick, except where the cable fails. Where the camera
fails, its stream is filmed and tracked as in any session; otherwise the twin reports the truth.

A session in which this computer was too busy to read the controller's reports, though no network
failed, tells nothing of the fault: it is made again, up to some times.
"""

import contextlib
import dataclasses
import pathlib
import re
import sys
import tempfile
import time
from collections.abc import Iterator

import numpy as np

from benchmarks.result import ROOT, Table, code_key
from benchmarks.truth import TruthCamera
from cablecast.cast import EndpointTrack, TrialStatus
from cablecast.data.dataset import read_dataset
from cablecast.data.record import collect_dataset
from cablecast.errors import CablecastError
from cablecast.files import read_json, write_json
from cablecast.motion.polar import reset_pose
from cablecast.motion.trajectory import Trajectory
from cablecast.rigs.arm import APPROACH_SPEED, TURN_SPEED, RigArm
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.driver import RigPhase
from cablecast.rigs.path import check_path, straight_move
from cablecast.rigs.ur.twin.laboratory import FAULTS, TwinConfig, faults_of
from cablecast.rigs.ur.twin.process import TwinProcess
from cablecast.setup import Setup, load_setup
from cablecast.vision.trials import CameraOfTrials, TrialCamera

PHASES = ("reset", "approach", "cast", "settle", "readout")
AFTER = {"reset": 1.0, "approach": 0.1, "cast": 0.4, "settle": 0.5, "readout": 0.0}
"""Time from the start of a phase to the fault [s]: in the middle of its motion, if it has one."""
REST_SPEED = 0.01
STOPPING = {
    "protective_stop",
    "emergency_stop",
    "speed_slider",
    "network_lost",
    "controller_dies",
    "controller_restarts",
    "program_stopped",
}
"""Faults after which the arm must come to rest."""
ARMS = {"cb3": "ur5", "e-series": "ur5e", "polyscope-x": "ur5e"}
"""Arm of each generation of controllers."""
ACTIONS = np.array([[-0.4, 0.3, 0.62, 0.5], [-0.3, 0.35, 0.62, 0.4]])
CAMERA = {"width": 960, "height": 540, "rate": 15.0, "exposure": 0.002}
"""Settings of the camera, with few and small pictures: what takes time is drawing them."""
SEGMENT_COUNT = 12
REST_TIME = 1.5
"""Time after a fault for which the arm is watched [s]."""
BUSY = (
    "computer is busy",
    "heard nothing of this computer",
    "has been silent",
    "does not say its version",
)
"""Words of what a busy computer does to a session, as a lost network does."""
LOSING = {"lost_packets", "late_packets", "network_lost", "controller_dies", "controller_restarts"}
"""Faults with which some reports are lost."""
SESSIONS_MAX = 4
"""Largest number of sessions of a cell."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """End of one trial with a fault.

    Attributes:
        message: Error, or what was done without one.
        rest_time: Time from the fault until the arm stood [s]; None where it need not stop.
        resumed: True where the same command then finished the rest.
        failures: Why attempts failed, in order.
        is_spoilt: True where this computer was too busy, or the fault did not come.
    """

    message: str
    rest_time: float | None
    resumed: bool
    failures: tuple[str, ...]
    is_spoilt: bool


class RigQuick(RigArm):
    """The arm with a short reset: aside and up, and back.

    Args:
        setup: Lab file of a twin.
        camera: Camera over its table.
        failures: List that grows by why an attempt failed.
        speed: Largest speed of a joint in the reset [rad/s].
    """

    def __init__(self, setup: Setup, camera: TrialCamera, failures: list[str], speed: float):
        super().__init__(setup, camera)
        self._failures, self._speed = failures, speed

    def reset(self) -> None:
        try:
            super().reset()
        except CablecastError as error:
            self._failures.append(str(error))
            raise

    def execute(self, trajectory: Trajectory) -> EndpointTrack:
        try:
            track = super().execute(trajectory)
        except CablecastError as error:
            self._failures.append(str(error))
            raise
        if track.status is TrialStatus.ABORTED:
            self._failures.append(track.note)
        return track

    def _reset_once(self) -> None:
        self.driver.ready()
        self.camera.check(self.driver.latest().time)
        home = np.asarray(reset_pose(self.setup.workspace), dtype=float)
        aside = self.setup.arm.inverse(home + [0.15, 0.0, 0.2, 0.2, 0.0])
        for place in (aside, self.setup.arm.inverse(home)):
            way = straight_move(self._at_rest(), place, self._speed)
            check_path(way, self.setup, "the way back")
            self._play("cablecast_approach", way, RigPhase.RESET)
        self._wait(0.2)
        self.driver.set_phase(RigPhase.IDLE)


def part_of(fault: str) -> str:
    """Return what fails: robot, camera or cable."""
    if fault.startswith("camera_"):
        return "camera"
    return "cable" if fault in ("cable_slips", "cable_drops", "crooked_reset") else "robot"


@contextlib.contextmanager
def running_twin(
    setup: Setup, generation: str, rate: float, address: str, part: str
) -> Iterator[tuple[TwinProcess, Setup]]:
    """Run a twin at an address of its own, and yield it with the set-up to reach it."""
    silence_max = 30.0 if part == "camera" else 3.0
    robot = dataclasses.replace(
        setup.robot, address=address, silence_max=silence_max, settle_time=1.0
    )
    config = TwinConfig(
        address=robot.address,
        rate=rate,
        generation=generation,
        has_cable=part == "cable",
        segment_count=SEGMENT_COUNT,
        camera_port=0,
        # A computer that is busy must not look like a fault of the network. It waits once in each
        # silence, and shorter than the rig.
        patience=1.0 if part == "robot" else 5.0,
    )
    camera = dataclasses.replace(setup.camera, **CAMERA)
    arm = dataclasses.replace(setup.arm, model=ARMS[generation])
    setup = dataclasses.replace(setup, arm=arm, robot=robot, camera=camera)
    seen = setup if part == "camera" else dataclasses.replace(setup, camera=None)
    with TwinProcess(seen, config) as twin:
        if twin.camera_url is not None:
            camera = dataclasses.replace(camera, source=twin.camera_url)
        yield twin, dataclasses.replace(setup, camera=camera)


def try_fault(twin: TwinProcess, setup: Setup, fault: str, phase: str) -> Outcome:
    """Let one fault come in a session, and say what came of it."""
    # What is wrong with camera or cable may be noticed only before the next cast.
    part = part_of(fault)
    actions = ACTIONS[:1] if part == "robot" else ACTIONS
    speed = APPROACH_SPEED if part == "robot" else TURN_SPEED
    failures: list[str] = []
    twin.admin.clear()
    session_start = twin.admin.state()["time"]
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "data"

        def collect() -> str:
            """Collect, and return the error; nothing where there was none."""
            try:
                camera = CameraOfTrials(setup) if part == "camera" else TruthCamera(setup)
                rig = RigQuick(setup, camera, failures, speed)
                with CheckedRig(rig, setup, time_limit=600.0) as rig:
                    collect_dataset(path, rig, setup, purpose="tune", actions=actions, attempts=2)
            except CablecastError as error:
                return str(error)
            return ""

        twin.admin.fault(fault, phase, AFTER[phase])
        error = collect()
        events = twin.admin.events()
        faults = [e["time"] for e in events if e["what"] == "fault" and e["time"] >= session_start]
        rest = rest_time(twin, faults[-1]) if faults and fault in STOPPING else None
        twin.admin.clear()
        # Where the first command finished, the second finds that nothing is missing.
        again = collect()
        casts = None if again else read_dataset(path)
    was_repeated = casts is not None and max(casts.extra["attempt"]) > 0
    return Outcome(
        message=error or ("aborted, and made again" if was_repeated else "no harm"),
        rest_time=rest,
        resumed=casts is not None and len(casts) == len(actions),
        failures=tuple(failures),
        # The last attempt comes when the network is there again.
        is_spoilt=not faults or _is_busy(failures if fault not in LOSING else [error, again]),
    )


def _is_busy(messages: list[str]) -> bool:
    return any(words in message for words in BUSY for message in messages)


def rest_time(twin: TwinProcess, start: float) -> float:
    """Return how long the arm moved on after a fault [s]."""
    while twin.admin.state()["time"] < start + REST_TIME:
        time.sleep(0.05)
    truth = twin.admin.truth(start, start + REST_TIME)
    moving = [
        at - start
        for at, speed in zip(truth["times"], truth["joint_speed"], strict=True)
        if speed > REST_SPEED
    ]
    if not moving:
        return 0.0
    # A motion that starts after the arm has rested is the next attempt.
    gaps = np.flatnonzero(np.diff(moving) > 0.05)
    return moving[gaps[0]] if len(gaps) else moving[-1]


def cell(outcome: Outcome) -> str:
    """Return an outcome as a cell of the table."""
    words = outcome.message
    if "because: " in words:
        words = words.split("because: ", 1)[1].split(". cablecast never", 1)[0]
        words = words.split(" trials are kept")[0].rsplit(". ", 1)[0]
    words = re.sub(r"camera source \S+", "the camera", words)
    words = re.sub(r" at 127\.\d+\.\d+\.\d+(:\d+)?", "", words)
    words = words.split(":", 1)[0] if len(words) > 90 else words
    rest = "" if outcome.rest_time is None else f"; at rest after {outcome.rest_time:.2f} s"
    return f"{words}{rest}; {'resumed' if outcome.resumed else '**not resumed**'}"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Faults of the robot, the camera and the cable, in every phase.

    Attributes:
        generations: Generations of controllers.
        faults: Faults; all of a generation where none is given.
        phases: Phases of a trial.
        rate: Largest speed of the clock.
        address: Loopback address of the twin.
        only_kept: Try nothing more; a dash for what is missing.
        out: Folder that keeps what was tried, so that a stopped run goes on.
    """

    generations: tuple[str, ...] = tuple(ARMS)
    faults: tuple[str, ...] = ()
    phases: tuple[str, ...] = PHASES
    rate: float = 1.0
    address: str = "127.9.0.1"
    only_kept: bool = False
    out: pathlib.Path = pathlib.Path("runs/benchmarks/faults")


def main(args: Args) -> Iterator[Table]:
    """Try faults in phases, and yield a table of each generation."""
    file = args.out / f"{code_key(__name__)}.json"
    cells = read_json(file) if file.is_file() else {}
    lab = load_setup(ROOT / "examples" / "twin.yaml")
    for generation in args.generations:
        faults = [fault for fault in args.faults or FAULTS if fault in faults_of(generation)]
        for part in ("robot", "camera", "cable"):
            due = [
                (fault, phase)
                for phase in args.phases
                for fault in faults
                if part_of(fault) == part and f"{generation} {fault} {phase}" not in cells
            ]
            if not due or args.only_kept:
                continue
            with running_twin(lab, generation, args.rate, args.address, part) as (twin, setup):
                for fault, phase in due:
                    for _ in range(SESSIONS_MAX):
                        outcome = try_fault(twin, setup, fault, phase)
                        print(f"{fault} in {phase}: {outcome}", file=sys.stderr, flush=True)
                        if not outcome.is_spoilt:
                            cells[f"{generation} {fault} {phase}"] = cell(outcome)
                            write_json(file, cells)
                            break
        rows = [
            (f"`{fault}`: {FAULTS[fault]}", *tried)
            for fault in faults
            if set(tried := [cells.get(f"{generation} {fault} {p}", "–") for p in args.phases])
            != {"–"}
        ]
        yield Table(generation, ("fault", *args.phases), rows)
