"""Options that several verbs share, and the format of values."""

import contextlib
import dataclasses
import math
import pathlib
import typing
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cablecast.engines import EngineName
from cablecast.errors import InputError, TargetError, check_number
from cablecast.runs.places import find_input

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cablecast.learning.policy import ForwardSearchPolicy
    from cablecast.rigs.checked import CheckedRig
    from cablecast.setup import Setup

EXIT_FALLS_SHORT = 3
"""Exit status of a verb whose result falls short."""

Device = typing.Literal["cpu", "cuda"]
SimulatorDevice = Annotated[
    Device,
    tyro.conf.arg(help="Simulate on the processor or on an NVIDIA graphics card."),
]
Engine = Annotated[
    EngineName,
    tyro.conf.arg(
        help="Simulator: warp (the fast one), mujoco or pybullet (the paper's; a cast takes a "
        "second of a core)."
    ),
]

Method = Annotated[
    typing.Literal["refined", "paper"],
    tyro.conf.arg(
        help="How a motion is chosen with the model: refined, or the paper's equation 1 alone, the "
        "candidate whose predicted landing is nearest."
    ),
]


def argument(
    metavar: str, default: str | None = None, text: str | None = None, hint: str | None = None
) -> Any:
    """Return the entry of an argument in `--help`.

    `default` describes a default of None; a hint stands in the place of any default.
    """
    hint = hint if default is None else f"(default: {default})"
    return tyro.conf.arg(metavar=metavar, help_behavior_hint=hint, help=text)


def picked(verb: Any, *names: str) -> dict[str, Any]:
    """Return options of a verb that a function takes by the same names."""
    return {name: getattr(verb, name) for name in names}


Places = tuple[tuple[float, float], ...]
"""Targets of a command line, in either form."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class TargetOptions:
    """Options of a verb that takes targets."""

    target: Annotated[Places, tyro.conf.UseAppendAction, argument("R THETA")] = ()
    """Target: distance from the robot's base [m], and angle from straight ahead [deg], positive to
    the robot's right. Give it again for more."""
    target_xy: Annotated[Places, tyro.conf.UseAppendAction, argument("X Y")] = ()
    """Target in the base frame [m], x to the robot's right and y ahead, in place of --target."""

    def targets(self, setup: "Setup", most: int | None = None) -> "NDArray[np.float64]":
        """Return the targets [m], shape [target, 2], those of --target first.

        Raises:
            InputError: There are too many.
            TargetError: One is not finite, out of reach, or off the table.
        """
        import numpy as np

        from cablecast.task import LANDING, SAME_GOAL

        try:
            found = [LANDING.values(setup, r=r, theta_deg=theta) for r, theta in self.target]
        except TargetError as error:
            raise TargetError(
                f"{error} (--target takes r first, in m, then theta in deg)"
            ) from None
        found += [LANDING.values(setup, xy) for xy in self.target_xy]
        places = np.concatenate([np.zeros((0, 2)), *found])
        # A target that is given twice, in either form, counts once.
        _, first = np.unique(np.round(places / SAME_GOAL), axis=0, return_index=True)
        if most is not None and len(first) > most:
            raise InputError(f"{len(first)} targets are given: it takes {most}")
        return places[np.sort(first)]


@dataclasses.dataclass(frozen=True, kw_only=True)
class AnyTargetOptions(TargetOptions):
    """Options of a verb that takes targets on the table or, of strikes, in the air."""

    target: Annotated[Places, tyro.conf.UseAppendAction, argument("R THETA")] = ()
    """Target: distance from the robot's base [m], and angle from straight ahead [deg], positive to
    the robot's right. That of a strike: distance ahead of the base, and height [m]. Give it again
    for more."""


def paper_targets(setup: "Setup") -> "NDArray[np.float64]":
    """Return the paper's 32 targets [m], shape [target, 2].

    Raises:
        TargetError: One is out of reach or off the table; says what to give instead.
    """
    from cablecast.task import LANDING
    from cablecast.workspace import load_targets

    try:
        return LANDING.values(setup, load_targets())
    except TargetError as error:
        raise TargetError(
            f"the paper's targets do not fit this laboratory, give your own with --target R THETA: "
            f"{error}"
        ) from None


LabFile = Annotated[
    pathlib.Path | None,
    argument("FILE", "the paper's set-up", "Lab file that describes cable, table, arm and motion."),
]
CableName = Annotated[
    str | None,
    argument(
        "CABLE",
        "that of --setup, or cable_1",
        "Cable: cable_1, cable_2, cable_3, or a YAML file that describes your own.",
    ),
]
TunedParams = Annotated[
    pathlib.Path | None,
    argument(
        "FILE",
        "those of the cable's file",
        "Cable parameters and servo lag that `cablecast tune` found (params.json, or its folder).",
    ),
]
RigName = Annotated[
    str,
    argument(
        "RIG",
        text="Rig that makes the casts: virtual (a laboratory in software; virtual:2 is "
        "another), engine or engine:NAME (a simulator), ur (an arm) or the name of another driver, "
        "or your own robot as package.module:factory.",
    ),
]
GripSpeed = Annotated[
    float | None,
    argument(
        "M/S",
        "that of --setup, or 1.5",
        "Largest speed of the gripper [m/s]. Faster casts reach farther and scatter more.",
    ),
]
ArcRadius = Annotated[
    float | None,
    argument(
        "M",
        "that of --setup, or reset_y",
        "Radius of the arcs that the gripper sweeps, at their start [m]; larger is flatter.",
    ),
]
WithPsi = Annotated[
    bool,
    argument("", "it turns (action set A2)", "Keep the wrist still (action set A1 of the paper)."),
]
WithPolar = Annotated[
    bool,
    argument(
        "",
        "make them where they are calmer than sweeps",
        "Make no polar casts: these lift the cable, swing it out, and pull it slowly along the "
        "table, which takes 20 s. --fast makes none, either.",
    ),
]
TimeLimit = Annotated[float, argument("S", text="Time limit of a reset or a cast [s].")]
Workers = Annotated[
    str,
    argument(
        "WHO",
        text="Who simulates: local, ray for a Ray cluster on this machine, or ray:ADDRESS for "
        "another.",
    ),
]


TaskName = Annotated[
    typing.Literal["landing", "strike"] | None,
    argument(
        "TASK",
        "strike if the lab file has a strike section, else landing",
        "What a cast is for: landing on the table, or a strike, in which the free end passes a "
        "point in the air.",
    ),
]


def load_lab(
    lab_file: pathlib.Path | None,
    cable: str | None,
    task: str | None = "landing",
    **motion: float | None,
) -> "Setup":
    """Return the set-up of --setup (the paper's if None), --cable and given motion options.

    It has a strike section where the task is one, and none where it is a landing; that of the lab
    file if None.
    """
    from cablecast.cable import load_cable
    from cablecast.setup import Setup, StrikeConfig, load_setup

    chosen = None if cable is None else load_cable(cable)
    if lab_file is not None:
        setup = load_setup(lab_file, chosen)
    else:
        setup = Setup() if chosen is None else Setup(cable=chosen)
    if task == "strike" and setup.strike is None:
        setup = dataclasses.replace(setup, strike=StrikeConfig())
    elif task == "landing" and setup.strike is not None:
        setup = dataclasses.replace(setup, strike=None)
    given = {name: value for name, value in motion.items() if value is not None}
    return setup.with_motion(**given) if given else setup


def check_same_setup(
    lab_file: pathlib.Path | None, cable: str | None, stored: "Setup", where: pathlib.Path
) -> None:
    """Refuse a --setup or --cable that differs from the set-up stored in a folder.

    Neither is checked where it is None. The error names the values.
    """
    from cablecast.cable import load_cable
    from cablecast.runs.folder import settings_differences

    there, here = stored.to_settings(), stored.to_settings()
    if lab_file is not None:
        here = load_lab(lab_file, cable).to_settings()
        # r0 and v_max are options of the verbs; a lab file's are only their defaults.
        here["motion"] = there["motion"]
    elif cable is not None:
        here["cable"] = load_cable(cable).to_dict()
    if differences := settings_differences(there, here):
        raise InputError(f"{where} was made for another set-up: {'; '.join(differences)}")


def with_instruments(setup: "Setup", lab_file: pathlib.Path | None) -> "Setup":
    """Return the set-up of a model with the robot and the camera of a lab file, if there is one."""
    from cablecast.setup import load_setup

    if lab_file is None:
        return setup
    lab = load_setup(lab_file, setup.cable)
    arm = dataclasses.replace(setup.arm, measured=lab.arm.measured)
    return dataclasses.replace(setup, arm=arm, robot=lab.robot, camera=lab.camera)


def load_policy(
    model: pathlib.Path | None, lab_file: pathlib.Path | None, cable: str | None
) -> "ForwardSearchPolicy":
    """Return the policy of --model, for the robot and the camera of --setup."""
    from cablecast.learning.policy import ForwardSearchPolicy

    folder = find_input("model", model, load_lab(lab_file, cable).cable.name)
    policy = ForwardSearchPolicy.load(folder)
    check_same_setup(lab_file, cable, policy.setup, folder)
    return policy.in_lab(with_instruments(policy.setup, lab_file))


@contextlib.contextmanager
def open_rig(
    spec: str, setup: "Setup", seed: int, out: pathlib.Path, time_limit: float = 120.0
) -> "Iterator[CheckedRig]":
    """Lock the folder of results, connect a rig, and yield it.

    The lock comes first: two processes must not drive one robot for the same results.
    """
    from cablecast.arm.robot import DRIVERS
    from cablecast.rigs.make import make_rig
    from cablecast.runs.folder import hold_folder

    check_number("time_limit", time_limit, 0.01, 1e6, "s")
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file: --out needs a folder")
    with (
        hold_folder(out, InputError),
        make_rig(spec, setup, seed, time_limit=time_limit) as rig,
    ):
        if spec in DRIVERS and setup.robot is not None and not setup.robot.seen_safe:
            from cablecast.rigs.arm import REHEARSAL_COUNT, REHEARSAL_SLOWNESS

            print(
                f"The first reset and {REHEARSAL_COUNT} casts are rehearsed, {REHEARSAL_SLOWNESS} "
                "times as slowly, as long as the lab file says seen_safe: false"
            )
        yield rig


def casts_text(count: int, cable: str) -> str:
    """Return how many casts of a cable there are, up to the verb."""
    return f"1 cast of {cable} is" if count == 1 else f"{count} casts of {cable} are"


def polar_text(xy: Any) -> str:
    """Return a point on the table in polar and Cartesian coordinates."""
    from cablecast.conventions import xy_to_polar

    (x, y), (r, theta) = xy, xy_to_polar(xy)
    theta_deg = math.degrees(theta)
    return f"r = {r:.3f} m, theta = {theta_deg:z.1f} deg (x = {x:z.3f} m, y = {y:z.3f} m)"
