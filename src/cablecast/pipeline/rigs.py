"""The simulator of a model as a rig, so that the model's own error can be told from the world's."""

from cablecast.cable import CableParams
from cablecast.datasets.reader import settings_object
from cablecast.errors import InputError
from cablecast.models.landing import LandingModel
from cablecast.motion.servo import ServoModel
from cablecast.pipeline.simulate import make_engine
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
    info = model.info["dataset"]
    settings = info["settings"]
    if "params" not in settings:
        raise InputError("the model has seen no simulated cast: its simulator is unknown")
    engine = make_engine(settings["engine"]["segment_count"], settings["engine"]["dt"], device)
    servo = None
    if settings.get("servo") is not None:
        servo = settings_object(ServoModel.from_dict, info, "servo", "the model")
    params = settings_object(lambda values: CableParams(**values), info, "params", "the model")
    return make_rig(RigEngine(engine, model.setup, params, servo=servo), model.setup)
