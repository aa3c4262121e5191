"""EngineWarp among the solvers of `cosseratbench`, another author's tests of rod simulators.

The package (Apache-2.0, on the package index) builds scenes, runs solvers and judges their
trajectories by its own code: relative errors against a catenary, a cantilever and a pendulum in
closed form or solved to rounding. It brings adapters of MuJoCo's cable plugin, which MuJoCo 4 no
longer has, and of PyElastica. Install it beside them, with "mujoco<4" and "pyelastica", into a
folder and name that in PYTHONPATH.

What EngineWarp does not have is declared: contact with cylinders, floors and rods, stretch as a
motion, and a clamp that slides under a load. A cable that hangs at rest takes the length that it
has under its tension, which is found in two runs.
"""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cablecast
from benchmarks.result import Table
from cablecast.cable import PARAMS, Cable, CableParams
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError
from cablecast.motion.grip_path import GripPath

EXPERIMENTS = ("catenary", "cantilever", "pendulum", "twist", "capstan", "crossing", "pile")
SOLVERS = ("cablecast", "pyelastica", "mujoco")

STEP = 2e-3
"""Longest step of a motion [s]; worlds with stiff bending take shorter ones."""

STRETCH_RUNS = 2
"""Runs of a scene at rest: the tension of one gives the length of the next."""


class CablecastSolver:
    """EngineWarp as a solver of `cosseratbench`."""

    name = "cablecast"
    backend_version = cablecast.__version__
    capabilities: frozenset[Any] = frozenset()

    def __init__(self, bending: float = 1.0):
        self.bending = bending

    def settings(self, scenario: Any, *, n_elements: int, n_frames: int) -> dict[str, Any]:
        """Return the numerical choices of a run, as values for a file."""
        return {
            "integrator": "leapfrog with exact lengths (SHAKE)",
            "time_step": self._step(scenario, n_frames),
            "damping_rate": _damping(scenario),
            "precision": "double",
        }

    def _step(self, scenario: Any, n_frames: int) -> float:
        """Return the longest step that divides the time between two frames [s]."""
        frame = scenario.duration / (n_frames - 1)
        return frame / np.ceil(frame / STEP)

    def run(self, scenario: Any, *, n_elements: int, n_frames: int) -> Any:
        """Simulate a scene of one rod; see `cosseratbench.solver.Solver`."""
        from cosseratbench.scenario import EndCondition, parallel_transport
        from cosseratbench.trajectory import Trajectory

        if len(scenario.rods) != 1:
            raise NotImplementedError("several rods with contact, or with ends that slide")
        rod = scenario.rods[0]
        if rod.start_motion is not None or rod.end_motion is not None:
            raise NotImplementedError("an end that slides under a load")
        if rod.start is EndCondition.FREE or (rod.end is EndCondition.CLAMPED):
            raise NotImplementedError("a free start, or two clamps")
        held = rod.end is EndCondition.PINNED
        gravity = np.asarray(scenario.gravity)
        force = sum((np.asarray(load.force) for load in rod.loads), np.zeros(3))
        if np.any(gravity) and np.any(force):
            raise NotImplementedError("gravity and a load")
        pull = force if np.any(force) else gravity
        if np.linalg.norm(pull[:2]) > 1e-12 * abs(pull[2]) or pull[2] > 0.0:
            raise NotImplementedError("a pull that does not point down")
        nodes = _even(rod.nodes(10 * n_elements), n_elements + 1)
        start = nodes
        for _ in range(STRETCH_RUNS if scenario.quasi_static and held else 1):
            cable, scale, fall = _cable(scenario, start, self.bending)
            engine = EngineWarp(
                segment_count=n_elements,
                dt=self._step(scenario, n_frames),
                precision="double",
                gravity=fall,
                table=False,
                hinged=rod.start is EndCondition.PINNED,
            )
            far = GripPath.hold(_pose(start[-1], start[-1] - start[-2]), 1.0) if held else None
            rollout = engine.rollout(
                cable,
                GripPath.hold(_pose(start[0], start[1] - start[0]), 1.0),
                CableState.at_rest(start[None]),
                scenario.duration,
                scenario.duration / (n_frames - 1),
                far_path=far,
                record_nodes=True,
                record_forces=held,
            )
            if not rollout.finite.all():
                from cosseratbench.solver import Diverged

                raise Diverged("EngineWarp gained energy or is not finite")
            if rollout.forces is not None:
                stiffness = rod.material.youngs_modulus * rod.area
                strain = rollout.forces.tension[0, -1].mean() / (scale * stiffness)
                start = _stretched(nodes, rod.length * (1.0 + strain))
        shapes = rollout.nodes[0][:n_frames]
        normal = np.asarray(rod.normal, dtype=float)
        directors = np.stack([parallel_transport(shape, normal) for shape in shapes])
        times = np.linspace(0.0, scenario.duration, n_frames)
        return Trajectory(times, (shapes,), (directors,))


SETTLED = 9.0
"""Time of a scene with a load, over that in which its slowest motion falls to 1 / e: what is left
of the motion at the end is some ten thousandths."""


def _damping(scenario: Any) -> float:
    """Return a rate that brings a scene to rest, and none where its motion counts [1/s]."""
    if not scenario.quasi_static:
        return 0.0
    rate = SETTLED / scenario.duration if scenario.rods[0].loads else scenario.slowest_frequency()
    return min(2.0 * rate, PARAMS["linear_damping"].bounds[1])


def _cable(scenario: Any, nodes: NDArray[np.float64], share: float) -> tuple[Cable, float, float]:
    """Return the cable of a scene, the factor of its masses and forces, and its gravity [m/s²].

    Its stiffness in bending and twist is a share of the scene's.

    Only ratios of stiffness, mass and force matter: they are scaled into the bounds of a cable. A
    load is the weight of an attachment so heavy that the cable beside it weighs next to nothing,
    and as light as lets the scene come to rest in its time.
    """
    rod = scenario.rods[0]
    bending = share * rod.material.youngs_modulus * rod.second_moment_of_area
    twisting = share * rod.material.shear_modulus * 2.0 * rod.second_moment_of_area
    mass = rod.material.density * rod.area * rod.length
    load = float(sum(np.linalg.norm(load.force) for load in rod.loads))
    scale = min(PARAMS["bend_stiffness"].bounds[1] / bending, PARAMS["mass"].bounds[1] / mass)
    fall = float(np.linalg.norm(scenario.gravity))
    end_mass = 0.0
    if load:
        rate = SETTLED / scenario.duration
        end_mass = 3.0 * scale * bending / (rod.length**3 * rate**2)
        end_mass = min(end_mass, PARAMS["endpoint_mass"].bounds[1])
        fall, mass = scale * load / end_mass, PARAMS["mass"].bounds[0] / scale
    params = CableParams(
        bend_stiffness=scale * bending,
        twist_stiffness=scale * twisting,
        mass=scale * mass,
        endpoint_mass=end_mass,
        linear_damping=_damping(scenario),
    )
    length = float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum())
    cable = Cable(name="rod", length=length, diameter=2.0 * rod.radius, params=params)
    return cable, scale, fall


def _pose(position: NDArray[np.float64], edge: NDArray[np.float64]) -> list[float]:
    """Return a grip pose at a place, along an edge."""
    level = float(np.hypot(edge[0], edge[1]))
    yaw = float(np.arctan2(edge[0], edge[1])) if level > 0.0 else 0.0
    return [*position, yaw, float(np.arctan2(edge[2], level))]


def _even(curve: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Return points at equal distances along a curve [m], shape [point, 3]."""
    arc = np.concatenate([[0.0], np.linalg.norm(np.diff(curve, axis=0), axis=1).cumsum()])
    return np.stack([np.interp(np.linspace(0.0, arc[-1], count), arc, x) for x in curve.T], axis=1)


def _stretched(nodes: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Return a hanging shape between the same ends with equal segments of a total length [m]."""
    from scipy.optimize import brentq

    chord = np.linspace(0.0, 1.0, len(nodes))[:, None] * (nodes[-1] - nodes[0]) + nodes[0]

    def deeper(factor: float) -> NDArray[np.float64]:
        return _even(chord + factor * (nodes - chord), len(nodes))

    def excess(factor: float) -> float:
        return float(np.linalg.norm(np.diff(deeper(factor), axis=0), axis=1).sum()) - length

    return deeper(brentq(excess, 0.2, 5.0))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Args:
    """Tests of rod solvers by another author: errors and wall times of all solvers in one run.

    Attributes:
        experiments: Names of experiments.
        solvers: Names of solvers; those after EngineWarp play what it plays.
        elements: Number of elements; that of each experiment where None.
    """

    experiments: tuple[str, ...] = EXPERIMENTS
    solvers: tuple[str, ...] = SOLVERS
    elements: int | None = None


CAUSES = (
    ("pendulum", 25, 1.0),
    ("pendulum", 50, 1.0),
    ("pendulum", 100, 1.0),
    ("catenary", 50, 1.0),
    ("catenary", 50, 0.25),
    ("catenary", 50, 0.05),
)
"""Experiment, elements, and share of the bending stiffness, with which EngineWarp shows what its
errors are made of."""


def causes() -> Iterator[tuple]:
    """Yield rows of what the errors of EngineWarp are made of."""
    from cosseratbench.experiment import run
    from cosseratbench.registry import load_experiment

    for name, elements, share in CAUSES:
        result = run(load_experiment(name), CablecastSolver(bending=share), n_elements=elements)
        error, value = next(iter(result.metrics.items()))
        lumped = 1.0 / (4.0 * elements**2) if name == "pendulum" else None
        yield (name, elements, share, f"{error} {value:.2e}", lumped)


def cosserat(args: Args) -> Iterator[Table]:
    """Yield what each solver's trajectories err by, how long they take, and what ours err by."""
    try:
        from cosseratbench.experiment import run
        from cosseratbench.registry import load_experiment, load_solver
    except ImportError as error:
        raise InputError(
            "this benchmark needs cosseratbench: pip install cosseratbench pyelastica 'mujoco<4'"
        ) from error
    table = Table(
        "Experiments of cosseratbench",
        ("experiment", "solver", "elements", "step [ms]", "outcome", "errors", "wall time [s]"),
        [],
    )
    for name in args.experiments:
        experiment = load_experiment(name)
        count = args.elements or experiment.n_elements
        runs = [(solver, count) for solver in args.solvers]
        # It is of second order in their number, and fast enough for twice as many.
        runs += [(solver, 2 * count) for solver in args.solvers if solver == CablecastSolver.name]
        for solver_name, elements in runs:
            own = solver_name == CablecastSolver.name
            solver = CablecastSolver() if own else load_solver(solver_name)
            result = run(experiment, solver, n_elements=elements)
            errors = "; ".join(f"{key} {value:.2e}" for key, value in result.metrics.items())
            step = result.settings.get("time_step")
            row = (
                name,
                solver_name,
                elements,
                "" if step is None else f"{1e3 * float(step):.3g}",
                result.outcome,
                errors or "; ".join(result.missing) or result.failure or "",
                "" if result.wall_time is None else round(result.wall_time, 2),
            )
            table.rows.append(row)
            print(*row, flush=True)
            if own and result.missing:
                # What EngineWarp does not play is declared, and nobody is compared with it.
                break
    yield table
    if args == Args():
        columns = ("experiment", "elements", "bending stiffness, of its own", "error", "1 / (4 N²)")
        yield Table("What is left of the errors of EngineWarp", columns, list(causes()))
