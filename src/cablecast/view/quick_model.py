"""A model on the spot: what a page needs before the first click can be planned."""

import pathlib

from cablecast.pipeline.simulate import simulate
from cablecast.pipeline.train import train
from cablecast.pipeline.tuned import Tuned
from cablecast.policies.forward_search import ForwardSearchPolicy
from cablecast.runs.places import DATASET_FOLDER, MODEL_FOLDER
from cablecast.runs.progress import ProgressCallback
from cablecast.setup import Setup

CAST_COUNT = 4000
EPOCHS = 30
CANDIDATE_COUNT = 30_000


def make_quick_model(
    setup: Setup,
    folder: pathlib.Path | None,
    tuned: Tuned | None = None,
    *,
    count: int = CAST_COUNT,
    epochs: int = EPOCHS,
    candidate_count: int = CANDIDATE_COUNT,
    progress: ProgressCallback | None = None,
) -> ForwardSearchPolicy:
    """Simulate some casts and train a small model on them; a stopped call goes on where it was.

    Args:
        setup: Set-up to plan for.
        folder: Folder that keeps the casts and the model; nothing is kept where None.
        tuned: Cable and servo to simulate; the cable as its file states it where None.
        count: Number of casts.
        epochs: Largest number of passes over them.
        candidate_count: Number of motions that planning chooses from.
        progress: Told the casts and the epochs.
    """
    casts = simulate(
        setup,
        tuned,
        count=count,
        out=None if folder is None else folder / DATASET_FOLDER,
        progress=progress,
    )
    return train(
        casts,
        epochs=epochs,
        candidate_count=candidate_count,
        out=None if folder is None else folder / MODEL_FOLDER,
        progress=progress,
    )
