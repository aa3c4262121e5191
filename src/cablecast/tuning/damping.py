"""Damping of the material, which a fit takes up where the casts ask for it.

Of the ten parameters, `angular_damping` stands for all bending losses: a rate at which segments
stop turning. A material loses energy where it bends instead (`Material.damping_time`). Which of
both a cable needs is a matter of evidence: the fit goes on with some damping times, and takes one
up if the tracks are then more likely by a factor that chance does not explain.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from cablecast.material import Material
from cablecast.tuning.least_squares import TRACK_WEIGHT, FitState, TrackFit, run_fit
from cablecast.tuning.objective import TrackObjective

EVIDENCE_MIN = 3.0
"""Logarithm of the factor by which the tracks must be more likely with a damping time."""

TRACKS_MIN = 10
"""Casts from which on damping times are tried. With five casts of the virtual rig the evidence was
between 0.1 and 2.4, and ten parameters followed them as well."""

ITERATIONS = 4
"""Steps with each damping time, and without one."""

_STARTS = 4


@dataclasses.dataclass(frozen=True, kw_only=True)
class Damping:
    """Outcome of a search for the damping time of a material.

    Attributes:
        material: Material to simulate with; None for that of the cable.
        state: Points of the fit with it.
        evidence: Logarithm of the factor by which the tracks are more likely with each damping time
            [s] than without; empty where none was tried.
    """

    material: Material | None
    state: FitState
    evidence: Mapping[float, float] = dataclasses.field(default_factory=dict)


def choose_damping(
    fit: TrackFit,
    state: FitState,
    times: Sequence[float],
    on_step: Callable[[TrackFit], Callable[[FitState], None]],
) -> Damping:
    """Try damping times, and return the one that the casts ask for.

    None is tried for a cable whose file gives one, and with fewer than `TRACKS_MIN` casts.

    Args:
        fit: Fit without a damping time, at the resolution of the first steps.
        state: Points of it.
        times: Damping times to try [s].
        on_step: Given the fit with a damping time, returns what is called after each of its steps.
    """
    cable, tracks = fit.objective.cable, fit.objective.tracks
    if np.any(cable.material.damping_time) or len(tracks) < TRACKS_MIN or not times:
        return Damping(material=None, state=state)
    starts = state.best(_STARTS)
    found = []
    # Without a damping time, too: more steps alone make tracks more likely.
    for time in (0.0, *times):
        material = dataclasses.replace(cable.material, damping_time=time)
        damped = TrackObjective(fit.objective.engine, cable.with_material(material), tracks)
        other = TrackFit(damped, fit.space, fit.prior)
        tried = other.start(starts.points, starts.misfit)
        tried = run_fit(other, tried, ITERATIONS, on_step(other))
        found.append((material, other.rescaled(tried)))
    scores = np.array([_score(tried, len(tracks)) for _, tried in found])
    evidence = {
        time: float(scores[0] - score) for time, score in zip(times, scores[1:], strict=True)
    }
    best = int(np.argmin(scores))
    if scores[0] - scores[best] < EVIDENCE_MIN:
        return Damping(material=None, state=found[0][1], evidence=evidence)
    return Damping(material=found[best][0], state=found[best][1], evidence=evidence)


def _score(state: FitState, track_count: int) -> float:
    """Return minus the logarithm of the likelihood of the tracks and of what is believed.

    Each track is worth `TRACK_WEIGHT` draws of exp(-|r| / b) / b^2, see `least_squares`; F holds
    the exponents and what is believed.
    """
    scale = 2.0 * TRACK_WEIGHT * track_count * np.log(state.misfit)
    return float(state.best().costs[0] + scale)
