"""What each effect of version 5 of the laboratory costs.

The same casts are played without chance in a laboratory as it is, and with one effect switched off
at a time. The shift of the landing is what a study has to reckon with, and what a simulator without
the effect misses. The table goes to a file, and from there into docs/virtual-rig.md.
"""

import dataclasses
import pathlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import Table
from cablecast.cli.progress import console_progress
from cablecast.files import read_json, write_json, write_text
from cablecast.motion.action import Action
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.rigs.virtual import RigVirtual, TrialNoise, VirtualConfig
from cablecast.rigs.virtual._hidden import EFFECTS
from cablecast.runs.progress import Progress
from cablecast.setup import Setup

RESULT = pathlib.Path(__file__).parent / "data" / "laboratory_effects.json"
PAGE = pathlib.Path(__file__).parent.parent / "docs" / "virtual-rig.md"
START, END = "<!-- effects -->", "<!-- end of effects -->"

SIZES = {
    "strands": (
        "45 % of the stiffness is lost in slip, at bends above 0.03 / diameter; Dahl's law",
        "stick to slip 1.8; 2 to 10 published: Papailiou 1997 (conductors), Cadavid Gil 2026 (a "
        "power cable, 97 to 9.7 kN·m²); loops of electric cables: Dörlich 2018, Manfredo 2024; "
        "law: Dahl 1968",
    ),
    "tension": (
        "1.5 N doubles the friction between strands",
        "that it grows with tension: Papailiou 1997; the force: assumed",
    ),
    "uneven cable": (
        "stiffness 15 %, mass 6 % standard deviation in four half waves",
        "assumed: hand-made ends, wear",
    ),
    "kink": ("11 deg at one place", "assumed: storage on a hook"),
    "loop": ("hook swings freely by 29 deg either way", "assumed: eye knotted about a hook"),
    "pads": ("0.25 N·m/rad", "assumed: rubber pads of a two-finger gripper"),
    "stribeck": (
        "static 20 % above kinetic, falling within 0.08 m/s; then 6 % for each m/s",
        "form: Armstrong-Hélouvry 1994; rise with speed of rubber-like faces: Grosch 1963; sizes "
        "assumed",
    ),
    "tilt": ("4 mrad", "assumed: a table that was not levelled"),
    "edges": (
        "0.3 mm standard deviation of the boards' heights",
        "assumed: tolerance of cut foam; speed lost at a step: geometry of a round cable",
    ),
    "drift": (
        "± 6 % within 160 casts",
        "that friction wanders over a series: Yu 2016 (arXiv 1604.04038); size assumed",
    ),
    "arm": (
        "rigid bodies of 17 kg, position and velocity loop with integral, 8 to 12 Hz",
        "masses and centres: the maker; cylinders: Universal_Robots_ROS2_Description; rotors: "
        "MuJoCo Menagerie; bandwidth assumed",
    ),
    "torque limits": ("90 % of 150, 150, 150, 28, 28, 28 N·m", "the maker's Max. joint torques"),
    "gears": (
        "Coulomb 8, 9, 6, 1.6 N·m, viscous 12, 12, 8, 1.8 N·m·s/rad; ± 8 % from cast to cast",
        "that it matters, and follows the temperature: Raviola 2021 (UR5), Kovincic 2019 (UR5); "
        "sizes assumed",
    ),
    "stand": ("25 kN·m/rad about each axis, 4 % damping", "assumed: a stand of aluminium profiles"),
    "light": (
        "lamps flicker by 10 %, 1 % of frames lost, a colour cast of 5 %; rendered frames only",
        "docs/camera.md",
    ),
}
"""Usual size of each effect, and its source."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Shift of landings by each effect.

    Attributes:
        cable: Name of a preset.
        lab: Seed of the laboratory.
        count: Casts, at random actions.
        seed: Seed of the actions.
        out: File of the result; None to print only.
    """

    cable: str = "cable_1"
    lab: int = 0
    count: int = 20
    seed: int = 7
    out: pathlib.Path | None = RESULT


def landings(
    motions: list[Trajectory], setup: Setup, lab: int, without: tuple[str, ...]
) -> NDArray[np.float64]:
    """Return where casts without chance end [m], shape [cast, 2]."""
    config = VirtualConfig(
        version=5, lab_seed=lab, without=without, noise=TrialNoise.none(), sensing="exact"
    )
    with RigVirtual(setup, 0, config) as rig:
        return np.array([track.endpoint_xy[-1] for track in rig.execute_many(motions)])


def effects(args: Args) -> int:
    """Measure, print and store the table."""
    setup = Setup(cable=args.cable)
    actions = feasible_uniform(args.count, setup, seed=args.seed)
    motions = [plan_trajectory(Action.from_array(action), setup) for action in actions]
    # A landing without chance does not show what changes from cast to cast, nor what is seen.
    names = [name for name in EFFECTS if name != "light"]
    shifts: dict[str, dict[str, float]] = {}
    with console_progress() as progress:
        usual = landings(motions, setup, args.lab, ())
        for done, name in enumerate((*names, "all")):
            without = tuple(names) if name == "all" else (name,)
            moved = landings(motions, setup, args.lab, without) - usual
            pct = 100.0 * np.linalg.norm(moved, axis=1) / setup.cable.length
            q1, median, q3 = np.nanquantile(pct, (0.25, 0.5, 0.75))
            shifts[name] = {
                "q1_pct": round(float(q1), 2),
                "median_pct": round(float(median), 2),
                "q3_pct": round(float(q3), 2),
            }
            progress(Progress(task="effects", done=done + 1, total=len(names) + 1, unit="effects"))
    settings = {"cable": args.cable, "lab": args.lab, "casts": args.count, "seed": args.seed}
    result = {"settings": settings, "shifts": shifts}
    rows = [(name, *values.values()) for name, values in shifts.items()]
    print(Table("Shift by each effect [% of length]", ("effect", "q1", "median", "q3"), rows))
    if args.out is not None:
        write_json(args.out, result)
        quote(result)
    return 0


def table(result: dict[str, Any]) -> str:
    """Return the table of a page."""
    lines = [
        "| effect | size | source | landings shift [%]: median (quartiles) |",
        "|---|---|---|---|",
    ]
    for name in EFFECTS:
        size, source = SIZES[name]
        lines.append(f"| {name} | {size} | {source} | {_cell(result['shifts'].get(name))} |")
    lines.append(f"| all of them | | | {_cell(result['shifts']['all'])} |")
    return "\n".join(lines)


def _cell(shift: dict[str, float] | None) -> str:
    if shift is None:
        return "-"
    q1, median, q3 = (f"{shift[key]:.1f}" for key in ("q1_pct", "median_pct", "q3_pct"))
    return f"{median} ({q1} to {q3})"


def quote(result: dict[str, Any] | None = None) -> None:
    """Write the stored table into the page."""
    before, rest = PAGE.read_text().split(START)
    after = rest.split(END)[1]
    text = table(read_json(RESULT) if result is None else result)
    write_text(PAGE, f"{before}{START}\n{text}\n{END}{after}")
