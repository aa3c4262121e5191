"""Models that predict where the free end of the cable comes to rest after an action."""

from cablecast.models.forward import ForwardModel
from cablecast.models.forward_training import train_forward_model
from cablecast.models.training import TrainingConfig

__all__ = ["ForwardModel", "TrainingConfig", "train_forward_model"]
