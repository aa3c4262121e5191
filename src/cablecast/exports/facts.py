"""What an exported file says of a cable: numbers, intervals, laws, and what is left out."""

import dataclasses
import functools
import re
from collections.abc import Iterable, Sequence
from statistics import NormalDist

import numpy as np

from cablecast.cable import PARAMS, Cable, CableParams
from cablecast.tuning.space import ParamPosterior

INTERVAL_PCT = 90.0
"""Probability of the stated intervals [%]."""
DRAW_COUNT = 4000
"""Draws of the posterior that the intervals are taken from."""

LAWS: dict[str, str] = {
    "twist_stiffness": "GJ: torque = GJ x twist per length",
    "bend_stiffness": "EI: moment = EI x curvature",
    "mass": "of the whole cable, without the attachment; spread evenly",
    "endpoint_mass": "of the attachment at the free end",
    "lateral_friction": "factor of the cable; only the product with that of the table acts",
    "worksurface_friction": "factor of the table",
    "spinning_friction": "lever arm: torque against turning about the vertical <= arm x load",
    "rolling_friction": "lever arm: torque against rolling <= arm x load",
    "linear_damping": "deceleration = rate x velocity",
    "angular_damping": "slows the rotation, in space, of pieces of 1/18 of the cable at this rate",
    "damping_time": "moments lead the bend: EI (curvature + time x its rate), same for twist",
    "rest_curvature": "curvature without load, to the left of the gripper at the start",
    "drag_coefficient": "force per length = 1/2 x 1.2 kg/m3 x this x diameter x speed across^2",
    "friction_ratio": "Coulomb coefficient along the cable over that across it",
    "yield_curvature": "elastic curvature beyond this goes over into the cable's shape",
    "attachment_arm": "2/3 of the attachment's length: a uniform rod, clamped by the cable's end",
    "grip_compliance": "angle by which the gripper's pads give, over the bending moment there",
    "yield_time": "within this time, all but 1/e of it",
    "attachment_friction_ratio": "Coulomb coefficient of the attachment over that of the cable",
    "drag_ratio": "drag along the cable over that across it at the same speed",
}
"""Law of each parameter, in the order of `PARAMS`."""

DERIVED = {
    "friction": ("", "Coulomb coefficient across the cable: the product of both factors"),
    "bend_stiffness_per_mass": ("N·m²/kg", "no motion tells EI and mass apart, only this ratio"),
}


def comment(lines: Iterable[str]) -> str:
    """Return lines as a comment of XML, which must not hold two hyphens in a row."""
    text = re.sub("-(?=-)", "- ", "\n".join(lines))
    return f"<!--\n{text}\n-->"


@dataclasses.dataclass(frozen=True, kw_only=True)
class CableModel:
    """A cable to export, with what is known of it.

    Attributes:
        cable: Geometry and physics, one value each.
        posterior: Uncertainty of the ten parameters; None where nothing is known of it.
        segment_count: Number of segments of the exported model.
    """

    cable: Cable
    posterior: ParamPosterior | None = None
    segment_count: int = 50

    @property
    def segment_length(self) -> float:
        """Length of a segment [m]."""
        return self.cable.length / self.segment_count

    @property
    def segment_mass(self) -> float:
        """Mass of a segment, without the attachment [kg]."""
        return self.value("mass") / self.segment_count

    def value(self, name: str) -> float:
        """Return a parameter, or the Coulomb coefficient across the cable, `friction`."""
        return float(np.asarray(getattr(self.cable.params, name)))

    @functools.cached_property
    def cells(self) -> list[float]:
        """Length of cable that bends at each joint [m]: half a segment's at clamped ends."""
        cells = [0.5 * self.segment_length, *[self.segment_length] * (self.segment_count - 1)]
        return cells + ([0.5 * self.segment_length] if self.attachment_length else [])

    @functools.cached_property
    def springs(self) -> list[float]:
        """Bending stiffness of each joint [N·m/rad]; at the first, the gripper's pads turn, too."""
        first, *others = [self.value("bend_stiffness") / cell for cell in self.cells]
        return [first / (1.0 + self.value("grip_compliance") * first), *others]

    @property
    def attachment_length(self) -> float:
        """Length of an attachment that is a rod [m]; 0 for a point mass."""
        return 1.5 * self.value("attachment_arm") if self.value("endpoint_mass") else 0.0

    def intervals(self) -> dict[str, tuple[float, float]]:
        """Return the interval of each parameter that a fit states one of, by name."""
        posterior = self.posterior
        if posterior is None:
            return {}
        space, best, draws = posterior.space, posterior.params, posterior.draw(DRAW_COUNT)
        columns = {name: getattr(draws, name) for name in space.names} | _derived(draws)
        outside = 100.0 - INTERVAL_PCT
        # Of a parameter at the end of its range all that is left out is on the other side.
        means = dict(zip(space.names, posterior.mean, strict=True))
        below = {name: outside * round(means[name]) for name in posterior.at_bound}
        found = {}
        for name, values in columns.items():
            tail = below.get(name, 0.5 * outside)
            low, high = np.percentile(values, (tail, tail + INTERVAL_PCT))
            found[name] = (float(low), float(high))
        # Draws follow the product of the two factors along a straight line, far from which it is
        # another one: near the best point it is linear.
        rows = [space.names.index(n) for n in ("lateral_friction", "worksurface_friction")]
        ranges = (space.high - space.low)[rows]
        slopes = ranges * [float(best.worksurface_friction), float(best.lateral_friction)]
        deviation = float(np.sqrt(slopes @ posterior.covariance[np.ix_(rows, rows)] @ slopes))
        half = NormalDist().inv_cdf(0.5 + INTERVAL_PCT / 200.0) * deviation
        middle = float(np.asarray(best.friction))
        return found | {"friction": (max(middle - half, 0.0), middle + half)}

    def lines(self, target: str, dropped: Sequence[str]) -> list[str]:
        """Return the comment at the head of a file, line by line.

        Args:
            target: Name of the simulator.
            dropped: What it does not play, a sentence each.
        """
        cable, posterior = self.cable, self.posterior
        origin = "not fitted: the values of the cable's file"
        if posterior is not None:
            origin = f"fitted to {posterior.track_count} casts"
            if not posterior.track_count:
                origin = "not fitted: what is believed of it before any cast"
        lines = [
            f"{cable.name} for {target}, written by `cablecast export cable`; {origin}.",
            f"{cable.length:g} m long, {1e3 * cable.diameter:g} mm thick, {self.segment_count} "
            f"segments of {1e3 * self.segment_length:.4g} mm. SI units: m, kg, s, N, rad.",
            "",
            f"Parameters, [{INTERVAL_PCT:g} % interval], unit, law:",
        ]
        intervals = self.intervals()
        values = {name: self.value(name) for name in PARAMS}
        values = {n: v for n, v in values.items() if v != PARAMS[n].default}
        if not values.get("yield_curvature"):
            values.pop("yield_time", None)
        derived = {name: float(value) for name, value in _derived(cable.params).items()}
        for name, value in (values | derived).items():
            unit, law = DERIVED[name] if name in DERIVED else (PARAMS[name].unit, LAWS[name])
            known = ""
            if name in intervals:
                low, high = intervals[name]
                known = f" [{low:.3g} to {high:.3g}]"
            lines.append(f"  {name} = {value:.4g}{known}{f' {unit}' if unit else ''}: {law}")
        if posterior is not None:
            lines += [
                "Of a value without an interval the uncertainty is not known.",
                *posterior.sentences(),
            ]
        if dropped:
            lines += ["", f"What this model for {target} leaves out or changes:"]
            lines += [f"  - {sentence}" for sentence in dropped]
        return lines


def _derived(params: CableParams) -> dict[str, np.ndarray]:
    """Return what motions determine better than the ten parameters themselves, by name."""
    return {
        "friction": np.asarray(params.friction),
        "bend_stiffness_per_mass": np.asarray(params.bend_stiffness) / np.asarray(params.mass),
    }
