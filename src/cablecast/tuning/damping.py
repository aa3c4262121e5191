"""Damping of the material, which a fit takes up where the casts ask for it.

Of the ten parameters, `angular_damping` stands for all bending losses: a rate at which segments
stop turning. A material loses energy where it bends instead (`Material.damping_time`). Which of
both a cable needs is a matter of evidence: the fit goes on with some damping times, and takes one
up if the tracks are then more likely by a factor that chance does not explain.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from cablecast.cable import Cable
from cablecast.engines.base import Engine
from cablecast.material import Material
from cablecast.tuning.least_squares import TRACK_WEIGHT, FitState, TrackFit, run_fit
from cablecast.tuning.objective import TrackObjective
from cablecast.tuning.prior import ParamPrior
from cablecast.tuning.search_space import SearchSpace
from cablecast.tuning.tracks import MeasuredTracks

DAMPING_TIMES = (0.003, 0.01, 0.03)
"""Damping times that are tried [s]. Casts tell factors of three apart, and hardly less."""

EVIDENCE_MIN = 3.0
"""Logarithm of the factor by which the tracks must be more likely with a damping time."""

TRACKS_MIN = 10
"""Casts from which on damping times are tried. With five casts of the virtual rig the evidence was
between 0.1 and 2.4, and ten parameters followed them as well."""

_STARTS, _ITERATIONS = 4, 4


@dataclasses.dataclass(frozen=True, kw_only=True)
class Damping:
    """Outcome of a search for the damping time of a material.

    Attributes:
        material: Material to simulate with; None for that of the cable.
        state: Points of the fit with it.
        evidence: Logarithm of the factor by which the tracks are more likely with each of
            `DAMPING_TIMES` than without; empty where none was tried.
    """

    material: Material | None
    state: FitState
    evidence: tuple[float, ...] = ()


def choose_damping(
    cable: Cable,
    tracks: MeasuredTracks,
    engine: Engine,
    space: SearchSpace,
    prior: ParamPrior,
    state: FitState,
    on_step: Callable[[TrackFit], Callable[[FitState], None]],
) -> Damping:
    """Try damping times, and return the one that the casts ask for.

    None is tried for a cable whose file gives one, and with fewer than `TRACKS_MIN` casts.

    Args:
        cable: Cable that was cast.
        tracks: Tracks to fit.
        engine: Simulator, at the resolution of the first steps.
        space: Ranges of the ten parameters.
        prior: What is believed of them.
        state: Points of the fit without a damping time.
        on_step: Given the fit of a damping time, returns what is called after each of its steps.
    """
    if np.any(cable.material.damping_time) or len(tracks) < TRACKS_MIN:
        return Damping(material=None, state=state)
    starts = state.best(_STARTS)
    found = []
    # Without a damping time, too: more steps alone make tracks more likely.
    for time in (0.0, *DAMPING_TIMES):
        material = dataclasses.replace(cable.material, damping_time=time)
        objective = TrackObjective(engine, cable.with_material(material), tracks)
        fit = TrackFit(objective, space, prior)
        tried = fit.start(starts.points, starts.misfit)
        found.append((material, fit.rescaled(run_fit(fit, tried, _ITERATIONS, on_step(fit)))))
    scores = np.array([_score(tried, len(tracks)) for _, tried in found])
    evidence = tuple(float(gain) for gain in scores[0] - scores[1:])
    best = 1 + int(np.argmax(evidence))
    if max(evidence) < EVIDENCE_MIN:
        return Damping(material=None, state=found[0][1], evidence=evidence)
    return Damping(material=found[best][0], state=found[best][1], evidence=evidence)


def _score(state: FitState, track_count: int) -> float:
    """Return minus the logarithm of the likelihood of the tracks and of what is believed.

    Each track is worth `TRACK_WEIGHT` draws of exp(-|r| / b) / b^2, see `least_squares`; F holds
    the exponents and what is believed.
    """
    scale = 2.0 * TRACK_WEIGHT * track_count * np.log(state.misfit)
    return float(state.best().costs[0] + scale)
