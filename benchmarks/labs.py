"""Random laboratories: which run, and which are refused rightly.

Each laboratory has a table, an arm and its mounting, a cable of 0.3 to 3 m, 1 to 30 mm and 1 g to
1 kg, with and without attachment, described by no more than a new user would write: size of the
table, model and base of the arm, length, diameter, mass and kind of the cable. The truth is drawn
from what is believed of such a cable.

Two targets are asked for: a place of the table that is drawn, and one where a cast of the true
cable lands. 5,000 random casts of the true cable that the arm can follow judge each refusal: it is
right if none of them stays on the table and lands within 3 % of the target. Each laboratory is kept
in --out: the same command resumes where it was stopped.
"""

import collections
import dataclasses
import functools
import pathlib
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast as cc
from benchmarks.result import Table, code_key, plain
from cablecast.arm.ur import ARM_MODELS
from cablecast.cable import KIND_NAMES
from cablecast.conventions import mirror_xy
from cablecast.engines.dynamics import Dynamics
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.feasibility import check_actions, uniform_actions, widest_ranges
from cablecast.runs.folder import Parts
from cablecast.tuning.fit import FitConfig
from cablecast.tuning.space import ParamPrior, SearchSpace

BRUTE_COUNT, BRUTE_CHUNK = 5000, 1000
WITHIN_PCT = 3.0
SEGMENT_COUNT, DT = 20, 1e-3
# Densities of what cables are made of, with the air between strands and links [kg/m³].
DENSITIES = {"rope": (500, 1200), "hose": (500, 1400), "wire": (1500, 6000), "chain": (1500, 4000)}


@dataclasses.dataclass(frozen=True, kw_only=True)
class LabsArgs:
    """Random laboratories."""

    count: int = 200
    """Number of laboratories."""
    minutes: float = 1e6
    """Time after which no other laboratory is begun [min]."""
    out: pathlib.Path = pathlib.Path("runs/benchmarks/labs")
    """Folder of the results, in which the same command resumes."""


def describe(seed: int) -> dict[str, Any]:
    """Return the lab file of a random laboratory."""
    rng = np.random.default_rng([seed, 52])
    kind = str(rng.choice(KIND_NAMES))
    while True:
        length, diameter = np.exp(rng.uniform(np.log([0.3, 1e-3]), np.log([3.0, 0.03])))
        mass = length * np.pi / 4 * diameter**2 * rng.uniform(*DENSITIES[kind])
        if 1e-3 <= mass <= 1.0:
            break
    cable = {"name": f"cable_{seed}", "kind": kind}
    cable |= {"length": round(length, 3), "diameter": round(diameter, 4), "mass": round(mass, 5)}
    if rng.random() < 0.5:
        cable |= {"attachment": "hook", "attachment_length": 0.03}
    table = {
        "table_width": round(rng.uniform(0.8, 2.75), 2),
        "table_depth": round(rng.uniform(0.8, 2.2), 2),
        "table_yaw_deg": float(rng.choice([0, 90])),
        "table_near_y": round(rng.uniform(-0.4, 0.2), 2),
    }
    model = str(rng.choice(list(ARM_MODELS)))
    arm = {"model": model, "base_height": round(rng.uniform(0.05, 0.25), 3)}
    return {"cable": cable, "workspace": table, "arm": arm}


def truth_of(setup: cc.Setup, seed: int) -> cc.CableParams:
    """Return true physics as far from what is believed of a cable as its deviations say."""
    space = SearchSpace.for_cable(setup.cable, FitConfig().materials)
    return space.to_params(ParamPrior.for_cable(setup.cable, space).draw(2, seed)[1])


def brute_force(setup: cc.Setup, truth: cc.CableParams) -> NDArray[np.float64]:
    """Return where random casts of the true cable that stay on the table land, [cast, 2]."""
    rng, engine = np.random.default_rng(0), cc.EngineWarp(segment_count=SEGMENT_COUNT, dt=DT)
    landed, count = [np.empty((0, 2))], 0
    for _ in range(20 * BRUTE_COUNT // BRUTE_CHUNK):
        actions = uniform_actions(widest_ranges(setup), BRUTE_CHUNK, rng)
        actions = actions[check_actions(actions, setup).mask]
        if not len(actions):
            continue
        paths = cast_grip_paths(actions, setup)
        xy = Dynamics(params=truth).rollout(engine, setup, paths).endpoint_xy
        stays = np.all(setup.workspace.edge_distance(xy) >= 0.0, axis=1)
        landed += [xy[stays, -1], mirror_xy(xy[stays, -1])]
        count += len(actions)
        if count >= BRUTE_COUNT:
            break
    return np.concatenate(landed)


def play(seed: int) -> dict[str, Any]:
    """Return what becomes of a laboratory: a refusal with its reason, or of its targets."""
    lab, start = describe(seed), time.monotonic()
    found: dict[str, Any] = {"lab": lab, "refused": "", "targets": []}
    try:
        setup = cc.Setup.from_dict(lab)
    except cc.CablecastError as error:
        # The cable lies beyond the table wherever the arm may hold it.
        return found | {"refused": "description", "reason": str(error)}
    truth = truth_of(setup, seed)
    landed = brute_force(setup, truth)
    found["landed"] = len(landed)
    try:
        checked = cc.check(setup, changes=False)
    except cc.CablecastError as error:
        return found | {"refused": "check", "reason": str(error), "right": not len(landed)}
    found["share"] = float(checked.shares[0])
    if not checked.reaches_anything:
        limits = "; ".join(checked.limits)
        return found | {"refused": "check", "reason": limits, "right": not len(landed)}
    rng = np.random.default_rng([seed, 7])
    places = [drawn_place(setup, rng)]
    places += [landed[rng.integers(len(landed))]] if len(landed) else []
    within = WITHIN_PCT / 100.0 * setup.cable.length
    for place in places:
        near = float(np.linalg.norm(landed - place, axis=1).min(initial=np.inf))
        refused = checked.is_out_of_reach(place)
        found["targets"].append({"reachable": near <= within, "refused": refused})
    return found | {"seconds": time.monotonic() - start}


def drawn_place(setup: cc.Setup, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a place of the table within the reach of arm and cable [m]."""
    workspace = setup.workspace
    low, high = (-workspace.half_width, workspace.y_min), (workspace.half_width, workspace.y_max)
    while True:
        place = rng.uniform(low, high)
        if np.linalg.norm(place) < workspace.reach(setup.cable.length):
            return place


def kept(
    parts: Parts, seed: int, end: float, make: Callable[[], dict[str, Any]]
) -> dict[str, Any] | None:
    """Return what became of a laboratory, made where it is not known; None once time is up [s]."""
    lab = parts.get(f"lab-{seed:03d}")
    if lab is None and time.monotonic() <= end:
        lab = plain(make())
        parts.put(f"lab-{seed:03d}", lab)
    return lab


def labs(args: LabsArgs) -> Iterator[Table]:
    """Yield what becomes of the laboratories and of their targets."""
    end = time.monotonic() + 60.0 * args.minutes
    found = []
    parts = Parts(args.out / code_key(__name__))
    for seed in range(args.count):
        lab = kept(parts, seed, end, functools.partial(play, seed))
        if lab is None:
            print(f"{len(found)} of {args.count} laboratories are done: the same command goes on")
            break
        found.append(lab)
    yield outcomes(found)
    yield refusals(found)


def outcomes(found: list[dict[str, Any]]) -> Table:
    """Return how many laboratories run, and how many refusals are right."""
    rows = []
    for name in ("", "description", "check"):
        own = [lab for lab in found if lab["refused"] == name]
        right = sum(lab.get("right", False) for lab in own)
        # A description is refused for what it says, whatever casts do.
        rows.append((name or "runs", len(own), right if name == "check" else None))
    return Table("Laboratories, and refusals that are right", ("outcome", "labs", "right"), rows)


def refusals(found: list[dict[str, Any]]) -> Table:
    """Return how many targets are refused before any cast, and how rightly."""
    counts = collections.Counter(
        (row["reachable"], row["refused"]) for lab in found for row in lab["targets"]
    )
    rows = [
        (words, counts[reachable, True], counts[reachable, False])
        for reachable, words in ((True, "a random cast lands there"), (False, "none does"))
    ]
    return Table("Targets", ("target", "refused", "allowed"), rows)
