"""Kill every verb with SIGKILL at seeded moments, and compare what it finishes with.

    python tools/kill.py --count 200
    python tools/kill.py --count 200 --interrupt

Each verb first runs undisturbed. Then it runs again in a copy of the same folder, is killed (`kill
-9`) at a moment drawn evenly from the time that it took, is started anew, and so on up to four
times; then it may finish. Its results must be those of the undisturbed run, file by file, and
nothing else may lie in the folder. Each verb is killed at least once and gets about as much time as
any other. Takes about half an hour on two cores. With `--interrupt` it is stopped as by Ctrl-C, and
must also end with the sentence that says what the same command does.
"""

import argparse
import collections
import contextlib
import dataclasses
import importlib
import os
import pathlib
import pkgutil
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from tools.small_results import SMALL, digests, prepare

from cablecast.cli.main import EXIT_INTERRUPTED

KILLS_MAX = 4
"""Largest number of kills before a verb may finish."""
CALM = 600.0
"""Time in which a verb that is not killed must end [s]."""
BEGIN_TIME = 0.3
"""Time in which a verb has read its words [s]."""
BASE = "prepared"

LAB = """
arm: {model: ur5, measured: true}
"""


@dataclasses.dataclass(frozen=True)
class Job:
    """A verb that is killed.

    Attributes:
        name: Name for people.
        arguments: Words after `cablecast`; empty for the reproduction on a tiny budget.
        results: Files and folders that it writes.
    """

    name: str
    arguments: tuple[str, ...]
    results: tuple[str, ...]


def jobs() -> list[Job]:
    """Return each verb on a budget of seconds."""
    found = [
        Job(name, (name.split()[0], *words), (words[words.index("--out") + 1],))
        for name, words in SMALL.items()
        if name not in ("plan", "track", "reproduce")
    ]
    virtual = ("--rig", "virtual", "--count", "6", "--out", "runs/virtual")
    motion = ("--setup", "lab.yaml", "--miss-max", "1000", "--save", "motion.csv", "--force")
    film = ("film.mp4", "--tags", "tags.yaml", "--out", "runs/track")
    return [
        *found,
        Job("collect virtual", ("collect", *virtual), ("runs/virtual",)),
        Job("plan", ("plan", *SMALL["plan"], *motion), ("motion.csv",)),
        Job("track", ("track", *film), ("runs/track",)),
        Job("reproduce", (), ("runs/reproduce",)),
    ]


def make_film(folder: pathlib.Path) -> None:
    """Write a video of a short made-up motion, film.mp4, and the places of its tags, tags.yaml.

    Args:
        folder: Folder of the two files.
    """
    import numpy as np

    from cablecast.rigs.virtual.camera import VirtualCamera
    from cablecast.rigs.virtual.drawing import FilmedTrial
    from cablecast.setup import Setup
    from cablecast.vision.video import write_video

    times = np.arange(36) * 0.01
    grip = np.array([0.0, 0.6])
    end = np.array([0.0, 1.22]) + np.clip(times / 0.3, 0, 1)[:, None] * [0.3, -0.1]
    xy = grip + np.linspace(0, 1, 10)[:, None] * (end[:, None] - grip)
    nodes = np.concatenate([xy, np.full((*xy.shape[:2], 1), 0.0055)], axis=-1)
    trial = FilmedTrial(cable=Setup().cable, times=times, nodes=nodes, joint_path=None)
    film = VirtualCamera().film(trial, seed=6)
    write_video(folder / "film.mp4", (film.frame(i) for i in range(film.frame_count)), 60.0)
    film.camera.layout.save(folder / "tags.yaml")


def run_job(job: Job) -> int:
    """Run a verb in the working folder, and return its exit status."""
    from cablecast.cli import main

    if job.arguments:
        return main(list(job.arguments))
    from cablecast.pipeline.reproduce import Budget, reproduce

    budget = Budget(
        cables=("cable_1", "cable_2"),
        tune_casts=4,
        more_casts=1,
        validation_casts=1,
        real_trials=24,
        grid=3,
        grid_psi=2,
        generations=2,
        repeat_actions=2,
        repeat_casts=2,
        casts=120,
        epochs=2,
        candidates=200,
        repeats=1,
    )
    reproduce("runs/reproduce", budget=budget, rig="stick_of_the_attack:make")
    return 0


def run(
    job: Job,
    folder: pathlib.Path,
    killed_after: float | None = None,
    number: signal.Signals = signal.SIGKILL,
) -> int:
    """Run a verb in a process of its own.

    Args:
        job: The verb.
        folder: Working folder.
        killed_after: Time after which it is killed, if it still runs [s].
        number: Signal that kills it.

    Returns:
        Exit status; negative the number of the signal that ended it.
    """
    child = os.fork()
    if child == 0:
        status = 70
        with contextlib.suppress(BaseException):
            os.setsid()
            os.chdir(folder)
            new = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
            output = os.open(folder.parent / "output.txt", new)
            for stream in (1, 2):
                os.dup2(output, stream)
            signal.signal(signal.SIGINT, signal.default_int_handler)
            try:
                status = run_job(job)
            except BaseException:
                traceback.print_exc()
        os._exit(status)
    end = time.monotonic() + (CALM if killed_after is None else killed_after)
    while True:
        done, raw = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(raw)
        if time.monotonic() >= end:
            os.kill(child, number)
            return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        time.sleep(0.002)


def contents(folder: pathlib.Path, job: Job) -> tuple[dict[str, str], set[str]]:
    """Return a digest of each result that decides something, and the names of all files."""
    found = {}
    for result in job.results:
        for pattern in (result, f"{result}/**/*"):
            found |= digests(folder, pattern)
    names = {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}
    return found, {name for name in names if "__pycache__" not in name}


def kill_again_and_again(
    job: Job,
    base: pathlib.Path,
    good: tuple[dict[str, str], set[str]],
    took: float,
    rng: random.Random,
    number: signal.Signals,
) -> tuple[int, str]:
    """Kill a verb up to some times, let it finish, and compare.

    Args:
        job: The verb.
        base: Folder in which it has not run yet.
        good: Contents of the folder after an undisturbed run.
        took: Time of the undisturbed run [s].
        rng: Source of the moments.
        number: Signal that kills it.

    Returns:
        Number of kills, and what differs from the undisturbed results; empty text for nothing.
    """
    with copied(base) as folder:
        kills = 0
        for _ in range(rng.randint(1, KILLS_MAX)):
            # Before it has begun, nothing says more than Python does.
            soonest = 0.0 if number == signal.SIGKILL else BEGIN_TIME
            status = run(job, folder, rng.uniform(soonest, max(took, 2 * soonest)), number)
            if status == -signal.SIGKILL:
                kills += 1
            elif status == EXIT_INTERRUPTED and number == signal.SIGINT:
                kills += 1
                if "cablecast: interrupted. " not in last_line(folder):
                    return kills, f"it ends with {last_line(folder)!r}"
            elif status:
                return kills, f"status {status}: {last_line(folder)}"
            if contents(folder, job) == good:
                # The work was done before the kill; not every verb may be asked twice.
                return kills, ""
        if status := run(job, folder):
            return kills, f"status {status}: {last_line(folder)}"
        digest, names = contents(folder, job)
        differing = sorted(
            {name for name in {*digest, *good[0]} if digest.get(name) != good[0].get(name)}
            | (names ^ good[1])
        )
        return kills, ", ".join(differing)


@contextlib.contextmanager
def copied(base: pathlib.Path) -> Iterator[pathlib.Path]:
    """Yield a copy of a folder, which is deleted afterwards."""
    with tempfile.TemporaryDirectory(prefix="kill-") as temporary:
        folder = pathlib.Path(temporary) / "copy"
        shutil.copytree(base, folder)
        yield folder


def last_line(folder: pathlib.Path) -> str:
    """Return the last line that a verb printed."""
    lines = (folder.parent / "output.txt").read_text(errors="replace").splitlines()
    return lines[-1] if lines else ""


def undisturbed(job: Job, base: pathlib.Path) -> tuple[tuple[dict[str, str], set[str]], float]:
    """Return what a verb leaves when nobody kills it, and the time that it takes [s]."""
    with copied(base) as folder:
        begun = time.monotonic()
        if status := run(job, folder):
            raise SystemExit(f"{job.name} failed with status {status}: {last_line(folder)}")
        return contents(folder, job), time.monotonic() - begun


def make_base(base: pathlib.Path) -> None:
    """Make the small results that the verbs read, in a new folder."""
    base.mkdir()
    child = os.fork()
    if child == 0:
        # In a process of its own: the threads that it starts would not survive a fork.
        status = 1
        try:
            prepare(base)
            (base / "lab.yaml").write_text(LAB)
            make_film(base)
            status = 0
        except BaseException:
            traceback.print_exc()
        os._exit(status)
    if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]):
        raise SystemExit("the small results cannot be made")


def import_all() -> None:
    """Import what any verb imports, so that a run that is forked off takes its own time only."""
    import cablecast

    for module in pkgutil.walk_packages(cablecast.__path__, "cablecast."):
        # The command line as a script, and what needs an extra that is missing.
        if not module.name.endswith("__main__"):
            with contextlib.suppress(ImportError):
                importlib.import_module(module.name)
    for name in (
        *("pyarrow.parquet", "scipy.optimize", "scipy.spatial", "torch", "safetensors.torch"),
        *("matplotlib.figure", "shapely", "jinja2", "warp", "mujoco", "cv2", "rich.progress"),
    ):
        importlib.import_module(name)


def without_results(base: pathlib.Path, job: Job) -> pathlib.Path:
    """Return a copy of the small results without those of a verb."""
    folder = base.parent / f"before-{job.name.replace(' ', '-')}"
    shutil.copytree(base, folder)
    for result in job.results:
        shutil.rmtree(folder / result, ignore_errors=True)
    return folder


def main(arguments: Sequence[str] | None = None) -> int:
    """Kill, print the figures, and return 1 if a result differed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="number of kills")
    parser.add_argument("--seed", type=int, default=0, help="seed of the moments")
    parser.add_argument("--interrupt", action="store_true", help="stop as by Ctrl-C")
    parser.add_argument("--only", default="", help="kill only the verbs whose name holds this text")
    parser.add_argument("--base", type=pathlib.Path, help="folder that keeps the small results")
    options = parser.parse_args(arguments)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import_all()
    rng = random.Random(options.seed)
    number = signal.SIGINT if options.interrupt else signal.SIGKILL
    chosen = [job for job in jobs() if options.only in job.name]
    if options.interrupt:
        # The reproduction is not called by its verb here.
        chosen = [job for job in chosen if job.arguments]
    kills, runs = collections.Counter[str](), collections.Counter[str]()
    spent = {job.name: 0.0 for job in chosen}
    faults = 0
    with tempfile.TemporaryDirectory(prefix="kills-") as temporary:
        base = pathlib.Path(temporary) / BASE
        if options.base is None or not options.base.is_dir():
            make_base(base)
            if options.base is not None:
                shutil.copytree(base, options.base)
        else:
            shutil.copytree(options.base, base)
        before = {job.name: without_results(base, job) for job in chosen}
        good = {job.name: undisturbed(job, before[job.name]) for job in chosen}
        chosen.sort(key=lambda job: good[job.name][1])
        while sum(kills.values()) < options.count or not all(spent.values()):
            # The quick ones come first, and each gets about as much time as any other.
            job = min(chosen, key=lambda job: spent[job.name])
            begun, (wanted, took) = time.monotonic(), good[job.name]
            count, differing = kill_again_and_again(
                job, before[job.name], wanted, took, rng, number
            )
            spent[job.name] += time.monotonic() - begun
            kills[job.name] += count
            runs[job.name] += 1
            if differing:
                faults += 1
                print(f"{job.name} differs after {count} kills: {differing[:500]}")
            print(f"{sum(kills.values())} kills, the last in {job.name}", flush=True)
    for name in kills:
        print(f"{name}: {kills[name]} kills in {runs[name]} runs of {good[name][1]:.1f} s")
    print(
        f"{sum(kills.values())} kills in {sum(runs.values())} runs of {len(kills)} verbs: "
        f"{faults or 'no'} run{'s' * (faults != 1)} finished with other results"
    )
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
