"""Loading of a checkpoint of any kind of model."""

import pathlib

from cablecast.errors import CheckpointError
from cablecast.learning.checkpoint import read_checkpoint
from cablecast.learning.gaussian_process import GaussianProcessModel
from cablecast.learning.landing import LandingModel
from cablecast.learning.network import ForwardModel

_KINDS: dict[str, type[LandingModel]] = {
    kind.FORMAT: kind for kind in (ForwardModel, GaussianProcessModel)
}


def load_model(folder: str | pathlib.Path) -> LandingModel:
    """Read a checkpoint of any kind of model.

    Args:
        folder: Folder that the model was saved to.

    Raises:
        CheckpointError: The file is missing, truncated, damaged, or not a model.
    """
    checkpoint = read_checkpoint(folder)
    if checkpoint.kind not in _KINDS:
        raise CheckpointError(
            f"{checkpoint.file} holds {checkpoint.kind or 'something'}: "
            f"it must be {' or '.join(_KINDS)}"
        )
    return _KINDS[checkpoint.kind].from_checkpoint(checkpoint)
