"""The simulator of a model as a rig, so that the model's own error can be told from the world's."""

from cablecast.engines import make_engine
from cablecast.errors import InputError
from cablecast.learning.landing import LandingModel
from cablecast.rigs.checked import CheckedRig
from cablecast.rigs.engine import RigEngine
from cablecast.rigs.make import make_rig


def engine_rig(model: LandingModel, device: str = "cpu") -> CheckedRig:
    """Return the simulator that a model learned from, as a rig.

    Args:
        model: Model; says which parameters, servo and resolution its dataset was simulated with.
        device: "cpu" or "cuda".

    Raises:
        InputError: The model has seen no simulated cast.
    """
    settings = model.settings
    if not settings.is_simulated:
        raise InputError("the model has seen no simulated cast: its simulator is unknown")
    engine = settings.values["engine"]
    engine = make_engine("warp", engine["segment_count"], engine["dt"], device)
    return make_rig(RigEngine(engine, model.setup, settings.dynamics), model.setup)
