"""What each effect of the laboratory costs.

The same casts are played without chance in a laboratory as it is, and with one effect switched off
at a time. The shift of the landing is what a study has to reckon with, and what a simulator without
the effect misses.
"""

import dataclasses
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from benchmarks.result import Table
from cablecast.cli.progress import console_progress
from cablecast.motion.casting import Action
from cablecast.motion.feasibility import feasible_uniform
from cablecast.motion.trajectory import Trajectory, plan_trajectory
from cablecast.rigs.virtual import RigVirtual, TrialNoise, VirtualConfig
from cablecast.rigs.virtual._hidden import EFFECTS
from cablecast.runs.progress import Progress
from cablecast.setup import Setup

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
    """

    cable: str = "cable_1"
    lab: int = 0
    count: int = 20
    seed: int = 7


def landings(
    motions: list[Trajectory], setup: Setup, lab: int, without: tuple[str, ...]
) -> NDArray[np.float64]:
    """Return where casts without chance end [m], shape [cast, 2]."""
    config = VirtualConfig(lab_seed=lab, without=without, noise=TrialNoise.none(), sensing="exact")
    with RigVirtual(setup, 0, config) as rig:
        return np.array([track.endpoint_xy[-1] for track in rig.execute_many(motions)])


def effects(args: Args) -> Iterator[Table]:
    """Yield the shift by each effect, and by all of them."""
    setup = Setup(cable=args.cable)
    actions = feasible_uniform(args.count, setup, seed=args.seed)
    motions = [plan_trajectory(Action.from_array(action), setup) for action in actions]
    # A landing without chance does not show what changes from cast to cast, nor what is seen.
    names = [name for name in EFFECTS if name != "light"]
    shifts: dict[str, list[float]] = {}
    with console_progress() as progress:
        usual = landings(motions, setup, args.lab, ())
        for done, name in enumerate((*names, "all")):
            without = tuple(names) if name == "all" else (name,)
            moved = landings(motions, setup, args.lab, without) - usual
            pct = 100.0 * np.linalg.norm(moved, axis=1) / setup.cable.length
            shifts[name] = np.nanquantile(pct, (0.25, 0.5, 0.75)).round(2).tolist()
            progress(Progress(task="effects", done=done + 1, total=len(names) + 1, unit="effects"))
    rows = [(name, *values) for name, values in shifts.items()]
    yield Table("Shift by each effect [% of length]", ("effect", "q1", "median", "q3"), rows)
