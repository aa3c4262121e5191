"""Material that a fit takes up where the casts ask for it: damping, curl, yield, the attachment.

Of the ten parameters, `angular_damping` stands for all bending losses: a rate at which segments
stop turning. A material loses energy where it bends instead (`Material.damping_time`), and a cable
that was wound on a reel keeps a curl (`rest_curvature`), which makes casts to the left and to the
right differ. A sharp bend that lasts stays in it (`yield_curvature`). An attachment is a body that
the cable's end clamps (`attachment_arm`), of the length that its file gives unless the casts tell
another one. The fit begins with usual values and changes one at a time, fits the parameters anew,
and keeps the change that makes the tracks and what is believed of materials most likely, as long as
there is one.
"""

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np

from cablecast.cable import Attachment, Cable
from cablecast.material import MATERIAL_BOUNDS, ROD_ARM, Material
from cablecast.tuning.least_squares import FitConfig, FitState, TrackFit

GAIN_MIN = 0.5
"""Logarithm of the factor by which a change must make tracks and material more likely."""

CURL_DEVIATION = 0.3
"""Deviation of the believed curl about none: how far it turns the whole cable [rad]."""

DAMPING_USUAL, DAMPING_FACTOR = 0.01, 2.0
"""Damping time beyond which a longer one is the less believed [s], and the factor of a standard
deviation. Ropes lose their energy within some hundredths of a second."""

ARM_FACTOR, POINT_DOUBT = 1.5, 2.0
"""Factor of a standard deviation by which an attachment acts as if it were longer or shorter than
it is, and minus the logarithm of how likely it acts as a point mass."""

YIELD_USUAL, YIELD_FACTOR, YIELD_DOUBT = 20.0, 2.5, 0.5
"""Usual curvature beyond which bends stay in a cable [1/m], the factor of a standard deviation, and
minus the logarithm of how likely any bend stays. A rope that was bent about a finger keeps it."""

YIELD_TIME = 0.4
"""Time in which such a bend stays in the cable [s]."""

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
        gain: Logarithm of the factor by which tracks and material are more likely with it than with
            the first one.
    """

    material: Material | None
    state: FitState
    gain: float = 0.0


def first_material(cable: Cable, config: FitConfig) -> Material:
    """Return the material that a fit begins with: what the cable's file gives, and usual values."""
    own = cable.material
    usual: dict[str, float] = {}
    if config.drag_coefficient and not np.any(own.drag_coefficient):
        usual["drag_coefficient"] = config.drag_coefficient
    if config.damping_times and not np.any(own.damping_time):
        usual["damping_time"] = config.damping_times[0]
    if config.arms and not np.any(own.attachment_arm):
        usual["attachment_arm"] = config.arms[0] * _usual_arm(cable)
    return dataclasses.replace(own, **usual)


def _usual_arm(cable: Cable) -> float:
    """Return the arm of an attachment that is a uniform rod [m]; 0 without one."""
    return 0.0 if cable.attachment is Attachment.NONE else ROD_ARM * cable.attachment_length


def choose_material(
    fit: TrackFit,
    state: FitState,
    own: Material,
    config: FitConfig,
    on_step: Callable[[TrackFit], Callable[[FitState], None]],
) -> MaterialChoice:
    """Change the material as long as the casts ask for it.

    What a cable's file says of damping or curl is kept.

    Args:
        fit: Fit with the first material, at the resolution of the first steps.
        state: Points of it.
        own: Material in the cable's file.
        config: Changes that are tried.
        on_step: Given the fit with a change, returns what is called after each of its steps.
    """
    cable = fit.objective.cable
    found = MaterialChoice(material=cable.material, state=state)
    for _ in range(ROUNDS):
        material = found.material or own
        # Without a change, too: more steps alone make tracks more likely.
        tried = [material, *_changes(material, own, cable, config)]
        if len(tried) == 1:
            break
        states = [_fitted(fit, found.state, other, on_step) for other in tried]
        costs = [
            float(points.best().costs[0]) + _doubt(other, own, cable)
            for other, points in zip(tried, states, strict=True)
        ]
        best = int(np.argmin(costs))
        gain = costs[0] - costs[best]
        if gain < GAIN_MIN:
            break
        found = MaterialChoice(material=tried[best], state=states[best], gain=found.gain + gain)
    return dataclasses.replace(found, material=None) if found.material == own else found


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
    material: Material, own: Material, cable: Cable, config: FitConfig
) -> Iterator[Material]:
    """Return materials that differ in one value from one, unless the cable's file gives it."""
    if not np.any(own.damping_time):
        for time in config.damping_times:
            if time != material.damping_time:
                yield dataclasses.replace(material, damping_time=time)
    if not np.any(own.rest_curvature):
        bound = MATERIAL_BOUNDS["rest_curvature"][1]
        for turn in config.curls:
            curvature = float(np.asarray(material.rest_curvature)) + turn / cable.length
            if abs(curvature) <= bound:
                yield dataclasses.replace(material, rest_curvature=curvature)
    if not np.any(own.yield_curvature):
        for curvature in config.yield_curvatures:
            if curvature != material.yield_curvature:
                time = YIELD_TIME if curvature else 0.0
                yield dataclasses.replace(material, yield_curvature=curvature, yield_time=time)
    if not np.any(own.attachment_arm):
        usual = _usual_arm(cable)
        for factor in config.arms:
            if factor * usual != material.attachment_arm:
                yield dataclasses.replace(material, attachment_arm=factor * usual)


def _doubt(material: Material, own: Material, cable: Cable) -> float:
    """Return minus the logarithm of how likely a material is; that of the file is certain."""
    doubt = 0.0
    if not np.any(own.damping_time):
        longer = np.log(max(float(np.asarray(material.damping_time)) / DAMPING_USUAL, 1.0))
        doubt += 0.5 * float(longer / np.log(DAMPING_FACTOR)) ** 2
    if not np.any(own.rest_curvature):
        turn = float(np.asarray(material.rest_curvature)) * cable.length
        doubt += 0.5 * (turn / CURL_DEVIATION) ** 2
    yields = float(np.asarray(material.yield_curvature))
    if yields and not np.any(own.yield_curvature):
        farther = float(np.log(yields / YIELD_USUAL) / np.log(YIELD_FACTOR))
        doubt += YIELD_DOUBT + 0.5 * farther**2
    if not np.any(own.attachment_arm) and (usual := _usual_arm(cable)):
        arm = float(np.asarray(material.attachment_arm))
        longer = np.log(arm / usual) / np.log(ARM_FACTOR) if arm else 0.0
        doubt += 0.5 * float(longer) ** 2 if arm else POINT_DOUBT
    return doubt
