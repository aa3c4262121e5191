"""Split of target errors by source, measured by replaying the planned casts on the engine.

The error is a sum of vectors on the table:

    landing - target = (landing - mean landing of the same cast)         repeatability of the rig
                     + (mean landing - engine's landing)                 mismatch of the engine
                     + (engine's landing - network's prediction)         error of the network
                     + (network's prediction - model's prediction)       correction by real casts
                     + (model's prediction - target)                     plan, with coverage gaps

The correction counteracts the mismatch; their sum is the remaining mismatch.
"""

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cablecast.errors import InputError
from cablecast.evaluation.evaluate import Evaluation
from cablecast.models.forward import ForwardModel
from cablecast.models.landing import LandingModel
from cablecast.motion.mirrored import rightward, to_right
from cablecast.rigs.base import Rig, run_trials
from cablecast.track import TrialStatus

PART_NAMES = ("repeatability", "mismatch", "network", "correction", "plan")


@dataclasses.dataclass(frozen=True, kw_only=True)
class ErrorSplit:
    """Errors of the casts that landed, each as a sum of parts.

    Attributes:
        parts: Vectors by name, in % of cable length, each of shape [cast, 2]. "mismatch" and
            "correction" are also given together, as "mismatch left".
        total: Landing minus target [% of cable length], shape [cast, 2].
        inside_coverage: Whether the target of each cast lies inside the coverage, shape [cast].
        repeats: Number of casts at each target.
    """

    parts: dict[str, NDArray[np.float64]]
    total: NDArray[np.float64]
    inside_coverage: NDArray[np.bool_]
    repeats: int

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for metrics.json.

        `share_pct` of a part is its share of the mean squared error: the mean of its dot product
        with the whole error. The shares add up to 100; that of a part opposed to the others is
        negative.
        """
        square = float(np.mean(np.sum(self.total**2, axis=1)))
        outside = ~self.inside_coverage
        outside_square = float(np.sum(self.total[outside] ** 2)) / len(self.total)
        left = {"mismatch left": self.parts["mismatch"] + self.parts["correction"]}
        parts = {}
        for name, vectors in (self.parts | left).items():
            size = np.linalg.norm(vectors, axis=1)
            share = float(np.mean(np.sum(vectors * self.total, axis=1))) / max(square, 1e-12)
            parts[name.replace(" ", "_")] = {
                "median_pct": float(np.median(size)),
                "rms_pct": float(np.sqrt(np.mean(size**2))),
                "share_pct": 100.0 * share,
            }
        return {
            "cast_count": len(self.total),
            "repeats": self.repeats,
            "rms_pct": float(np.sqrt(square)),
            "parts": parts,
            "outside_coverage": {
                "cast_count": int(outside.sum()),
                "share_pct": 100.0 * outside_square / max(square, 1e-12),
            },
        }


def split_errors(evaluation: Evaluation, model: LandingModel, engine_rig: Rig) -> ErrorSplit | None:
    """Split the errors of an evaluation.

    With one cast per target, repeatability cannot be separated from mismatch and is zero.

    Args:
        evaluation: Casts of a policy that planned with the model.
        model: Model of landings.
        engine_rig: Engine that the model learned from, as a rig; it is not closed.

    Returns:
        The split; None if no cast came to rest on the table.

    Raises:
        InputError: A cast was not planned by a model.
    """
    trials = evaluation.trials
    targets = sorted({trial.target_index for trial in trials})
    first = {target: next(t for t in trials if t.target_index == target) for target in targets}
    played = run_trials(engine_rig, [first[target].trajectory for target in targets])
    # The engine's table has no edge: a cast that leaves the table still has a landing.
    engine_xy = dict(zip(targets, (track.endpoint_xy[-1] for track in played), strict=True))
    network_xy = _network_predictions(model, [first[target].action for target in targets])
    network = dict(zip(targets, network_xy, strict=True))

    landed = [
        trial
        for trial in trials
        if trial.status is TrialStatus.OK and np.all(np.isfinite(engine_xy[trial.target_index]))
    ]
    if not landed:
        return None
    index = np.array([trial.target_index for trial in landed])
    xy = np.array([trial.landed_xy for trial in landed])
    means = {target: xy[index == target].mean(axis=0) for target in set(index.tolist())}
    predicted = np.array([trial.predicted_xy for trial in landed])
    target_xy = np.array([trial.target_xy for trial in landed])

    def by_target(values: dict[int, NDArray[np.float64]]) -> NDArray[np.float64]:
        return np.array([values[target] for target in index.tolist()])

    scale = 100.0 / evaluation.cable.length
    parts = {
        "repeatability": xy - by_target(means),
        "mismatch": by_target(means) - by_target(engine_xy),
        "network": by_target(engine_xy) - by_target(network),
        "correction": by_target(network) - predicted,
        "plan": predicted - target_xy,
    }
    return ErrorSplit(
        parts={name: scale * vectors for name, vectors in parts.items()},
        total=scale * (xy - target_xy),
        inside_coverage=np.array([trial.inside_coverage for trial in landed]),
        repeats=1 + max(trial.repeat for trial in trials),
    )


def _network_predictions(model: LandingModel, actions) -> NDArray[np.float64]:
    """Return predictions without the correction, for actions of either side [m], [action, 2]."""
    if any(action is None for action in actions):
        raise InputError("only casts that a model planned can be split")
    folded, hands = rightward(np.array([action.to_array() for action in actions]))
    alone = model.uncorrected if isinstance(model, ForwardModel) else model
    return to_right(alone.predict(folded), hands)
