"""Make a data set of casts for others: cables, laboratories, calm and wild, targets and tries.

    python tools/make_casts.py casts
    python tools/make_casts.py examples/casts --simulated 2000 --targets 1 --tries 2 --others 2

The folder has the layout of LeRobot (version 3) with one task for each cable and laboratory, a
card, a licence, and `meta/casts.csv`: of each episode the cable, the laboratory, its purpose, the
target and the try, the motion, and where the cable came to rest. The casts are made in virtual
laboratories, whose number is their seed. The same command goes on where it was stopped.
"""

import argparse
import csv
import dataclasses
import io
import pathlib
import shutil
from typing import Any

import numpy as np

import cablecast as cc
from cablecast.cable import CABLE_NAMES
from cablecast.cli.progress import console_progress
from cablecast.data.dataset import Dataset
from cablecast.data.lerobot import Episode, episodes_of, write_tables
from cablecast.files import read_text, write_text
from cablecast.motion.casting import Action
from cablecast.motion.polar import PolarCast
from cablecast.runs.progress import ProgressCallback

ROOT = pathlib.Path(__file__).parents[1]
FPS = 10
CALM, WILD = (0.2, 0.6), (1.0, 1.0)
"""Ranges of the pace of other casts [-]."""
MOTION_NAMES = (*Action.parameters, *PolarCast.parameters)
COLUMNS = (
    *("episode", "cable", "length_m", "diameter_m", "laboratory", "purpose", "target_x_m"),
    *("target_y_m", "try", *MOTION_NAMES, "status", "landing_x_m", "landing_y_m"),
)
CARD = pathlib.Path(__file__).with_name("casts_card.md")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Part:
    """Casts of one cable in one laboratory, and their rows of meta/casts.csv but the episode."""

    casts: Dataset
    task: str
    rows: list[tuple]


def parts_of(
    name: str, lab: int, args: argparse.Namespace, folder: pathlib.Path, progress: ProgressCallback
) -> list[Part]:
    """Make the casts of one cable in one laboratory."""
    setup = cc.Setup(cable=name)
    cable, task = setup.cable, f"Cast the free end of {name} onto the table of laboratory {lab}."
    facts = (name, cable.length, cable.diameter, lab)
    config = cc.AimConfig(
        calibration_count=args.calibrations, tries=args.tries, simulated_count=args.simulated
    )
    found: list[tuple[Dataset, str]] = []
    goals: list[Any] = []
    with cc.make_rig(f"virtual:{lab}", setup) as rig:
        if args.targets:
            session = cc.prepare_aim(rig, config, out=folder / "aim", progress=progress)
            rng = np.random.default_rng(lab)
            reached = session.model.policy.predicted_xy
            targets = reached[rng.choice(len(reached), args.targets, replace=False)]
            cc.aim(session, rig, targets, progress=progress)
            found.append((session.store.dataset(), "aim"))
            goals = [cast.proposal and cast.proposal.goal.value for cast in session.store.casts]
        else:
            options = {"count": args.calibrations, "out": folder / "calibration"}
            found.append((cc.collect(rig, progress=progress, **options), "calibration"))
        for purpose, pace in (("calm", CALM), ("wild", WILD)):
            made = cc.collect(
                rig,
                purpose="real",
                sampling="uniform",
                count=args.others,
                pace=pace,
                out=folder / purpose,
                progress=progress,
            )
            found.append((made, purpose))
    return [
        Part(casts=casts, task=task, rows=rows(casts, kind, facts, goals)) for casts, kind in found
    ]


def rows(casts: Dataset, kind: str, facts: tuple, goals: list[Any]) -> list[tuple]:
    """Return the rows of meta/casts.csv, without the number of the episode.

    Args:
        casts: Casts of one purpose, or those of a session.
        kind: The purpose; aim for a session, which begins with calibrations.
        facts: First columns.
        goals: Target of each cast of a session [m]; None for a calibration.
    """
    found, tries = [], {}
    for row in range(len(casts)):
        purpose, target, number = kind, ("", ""), ""
        if kind == "aim" and goals[row] is None:
            purpose = "calibration"
        elif kind == "aim":
            target = tuple(round(float(v), 4) for v in goals[row])
            number = tries[target] = tries.get(target, 0) + 1
        track = casts.track(row)
        landing = [f"{v:.4f}" if np.isfinite(v) else "" for v in track.final_xy]
        motion = casts.motion(row)
        known = (
            {} if motion is None else dict(zip(motion.parameters, motion.to_array(), strict=True))
        )
        action = [f"{known[name]:.4f}" if name in known else "" for name in MOTION_NAMES]
        found.append((*facts, purpose, *target, number, *action, casts.status[row], *landing))
    return found


def joined(parts: list[Part]) -> tuple[list[Episode], list[str]]:
    """Return the episodes of all parts, numbered through, and their tasks."""
    tasks = list(dict.fromkeys(part.task for part in parts))
    episodes: list[Episode] = []
    frames = 0
    for part in parts:
        for episode in episodes_of(part.casts, FPS):
            length = len(episode["index"])
            changes = {
                "episode_index": np.full(length, len(episodes)),
                "index": frames + np.arange(length),
                "task_index": np.full(length, tasks.index(part.task)),
            }
            episodes.append(episode | changes)
            frames += length
    return episodes, tasks


def main() -> None:
    """Make the casts that are not made yet, and write the data set."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("out", type=pathlib.Path, help="new folder of the data set")
    parser.add_argument("--cables", nargs="+", default=list(CABLE_NAMES))
    parser.add_argument("--labs", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--calibrations", type=int, default=5, help="casts for each first fit")
    parser.add_argument("--targets", type=int, default=4, help="targets in each laboratory")
    parser.add_argument("--tries", type=int, default=3, help="casts at a target at most")
    parser.add_argument("--others", type=int, default=6, help="calm casts, and wild ones")
    parser.add_argument("--simulated", type=int, default=8000, help="casts that aiming learns from")
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("runs/make-casts"))
    args = parser.parse_args()
    if args.out.exists():
        parser.error(f"{args.out} is there: give a new folder")
    parts: list[Part] = []
    with console_progress() as progress:
        for name in args.cables:
            for lab in args.labs:
                parts += parts_of(name, lab, args, args.work / f"{name}-{lab}", progress)
    episodes, tasks = joined(parts)
    part = args.out.with_name(f"{args.out.name}.tmp")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    write_tables(part, parts[0].casts, episodes, FPS, None, tasks)
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    every = [row for one in parts for row in one.rows]
    writer.writerows((number, *row) for number, row in enumerate(every))
    write_text(part / "meta/casts.csv", table.getvalue())
    counts = {kind: sum(row[4] == kind for row in every) for kind in sorted({r[4] for r in every})}
    options = ("calibrations", "targets", "tries", "others", "simulated")
    stated = " ".join(f"--{name} {getattr(args, name)}" for name in options)
    card = read_text(CARD).format(
        count=len(every),
        cables=", ".join(args.cables),
        labs=len(args.labs),
        fps=FPS,
        command=f"python tools/make_casts.py casts --cables {' '.join(args.cables)} --labs "
        f"{' '.join(map(str, args.labs))} {stated}",
        purposes=", ".join(f"{count} {kind}" for kind, count in counts.items()),
        calm=f"{CALM[0]:g} to {CALM[1]:g}",
    )
    write_text(part / "README.md", card)
    write_text(part / "LICENSE", read_text(ROOT / "LICENSE"))
    part.rename(args.out)
    size = sum(file.stat().st_size for file in args.out.rglob("*") if file.is_file())
    print(f"{len(every)} casts, {size / 1e6:.2f} MB, are in {args.out}")


if __name__ == "__main__":
    main()
