"""Forward models: from an action to where the cable's free end comes to rest."""

from cablecast.models.forward import ForwardModel
from cablecast.models.training import TrainingConfig, train_forward_model

__all__ = ["ForwardModel", "TrainingConfig", "train_forward_model"]
