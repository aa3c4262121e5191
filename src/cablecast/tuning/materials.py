"""Material that a fit takes up where the casts ask for it: damping and curl.

Of the ten parameters, `angular_damping` stands for all bending losses: a rate at which segments
stop turning. A material loses energy where it bends instead (`Material.damping_time`), and a cable
that was wound on a reel keeps a curl (`rest_curvature`), which makes casts to the left and to the
right differ. The fit changes one of them at a time, fits the parameters anew, and keeps the change
that makes the tracks and what is believed of materials most likely, as long as there is one.
"""

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np

from cablecast.material import MATERIAL_BOUNDS, Material
from cablecast.tuning.least_squares import FitConfig, FitState, TrackFit

GAIN_MIN = 0.5
"""Logarithm of the factor by which a change must make tracks and material more likely."""

CURL_DEVIATION = 0.3
"""Deviation of the believed curl about none: how far it turns the whole cable [rad]."""

DAMPING_USUAL, DAMPING_FACTOR = 0.01, 2.0
"""Damping time beyond which a longer one is the less believed [s], and the factor of a standard
deviation. Ropes lose their energy within some hundredths of a second."""

ITERATIONS = 3
"""Steps of the parameters with each change, and without one."""

ROUNDS = 5
"""Changes at most."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class MaterialChoice:
    """Outcome of a search for the material.

    Attributes:
        material: Material to simulate with; None for that of the cable.
        state: Points of the fit with it.
        gain: Logarithm of the factor by which tracks and material are more likely with it.
    """

    material: Material | None
    state: FitState
    gain: float = 0.0


def choose_material(
    fit: TrackFit,
    state: FitState,
    config: FitConfig,
    on_step: Callable[[TrackFit], Callable[[FitState], None]],
) -> MaterialChoice:
    """Change the material as long as the casts ask for it.

    What a cable's file says of damping or curl is kept.

    Args:
        fit: Fit with the material of the cable, at the resolution of the first steps.
        state: Points of it.
        config: Changes that are tried.
        on_step: Given the fit with a change, returns what is called after each of its steps.
    """
    own, length = fit.objective.cable.material, fit.objective.cable.length
    found = MaterialChoice(material=None, state=state)
    for _ in range(ROUNDS):
        material = found.material or own
        # Without a change, too: more steps alone make tracks more likely.
        tried = [material, *_changes(material, own, length, config)]
        if len(tried) == 1:
            break
        states = [_fitted(fit, found.state, other, on_step) for other in tried]
        costs = [
            float(points.best().costs[0]) + _doubt(other, own, length)
            for other, points in zip(tried, states, strict=True)
        ]
        best = int(np.argmin(costs))
        gain = costs[0] - costs[best]
        if gain < GAIN_MIN:
            break
        found = MaterialChoice(material=tried[best], state=states[best], gain=found.gain + gain)
    return found


def _fitted(
    fit: TrackFit,
    state: FitState,
    material: Material,
    on_step: Callable[[TrackFit], Callable[[FitState], None]],
) -> FitState:
    """Return the best point after some steps with a material, at the misfit that was found."""
    other = fit.with_material(material)
    after = on_step(other)
    points = other.first_step(state.best().points, state.misfit)
    after(points)
    for _ in range(ITERATIONS - 1):
        points = other.step(points)
        after(points)
    return points


def _changes(
    material: Material, own: Material, length: float, config: FitConfig
) -> Iterator[Material]:
    """Return materials that differ in one value from one, unless the cable's file gives it."""
    if not np.any(own.damping_time):
        for time in (0.0, *config.damping_times):
            if time != material.damping_time:
                yield dataclasses.replace(material, damping_time=time)
    if not np.any(own.rest_curvature):
        bound = MATERIAL_BOUNDS["rest_curvature"][1]
        for turn in config.curls:
            curvature = float(np.asarray(material.rest_curvature)) + turn / length
            if abs(curvature) <= bound:
                yield dataclasses.replace(material, rest_curvature=curvature)


def _doubt(material: Material, own: Material, length: float) -> float:
    """Return minus the logarithm of how likely a material is; that of the file is certain."""
    doubt = 0.0
    if not np.any(own.damping_time):
        longer = np.log(max(float(np.asarray(material.damping_time)) / DAMPING_USUAL, 1.0))
        doubt += 0.5 * float(longer / np.log(DAMPING_FACTOR)) ** 2
    if not np.any(own.rest_curvature):
        turn = float(np.asarray(material.rest_curvature)) * length
        doubt += 0.5 * (turn / CURL_DEVIATION) ** 2
    return doubt
