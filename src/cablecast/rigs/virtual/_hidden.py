"""What is true of the cables in the virtual laboratory. Nothing outside rigs/virtual may read it.

The learning side has to find these values, or live with its error, as with a real cable. They
differ from the starting values in cable.py by what a careful person gets wrong who weighs the cable
with a kitchen scale and looks up the rest.
"""

import dataclasses
import zlib

import numpy as np

from cablecast.cable import CABLE_NAMES, Cable, load_cable


@dataclasses.dataclass(frozen=True, kw_only=True)
class HiddenCable:
    """The true cable and the true arm.

    Attributes:
        mass: Of the cable without its attachment [kg].
        bend_stiffness: EI [N·m²].
        twist_stiffness: GJ [N·m²].
        bend_damping: Internal damping as a multiple of the elastic stiffness [s].
        friction: Coulomb coefficient between cable and table [-].
        endpoint_mass: Of the attachment [kg].
        endpoint_share: Part of the attachment's mass that sits at its far end [-].
        drag: Drag coefficient of the cable in air for its normal velocity [-].
        linear_damping: Decay rate of velocities beside the drag [1/s].
        sleeve: Length of cable that the gripper's jaws hold straight [m].
        arm_lag: Time constant with which the arm follows its command [s].
    """

    mass: float
    bend_stiffness: float
    twist_stiffness: float
    bend_damping: float
    friction: float
    endpoint_mass: float
    endpoint_share: float
    drag: float
    linear_damping: float
    sleeve: float = 0.006
    arm_lag: float = 0.010


_PRESETS = {
    "cable_1": HiddenCable(
        mass=0.056,
        bend_stiffness=5.2e-4,
        twist_stiffness=4.5e-4,
        bend_damping=0.006,
        friction=0.34,
        endpoint_mass=0.0155,
        endpoint_share=0.6,
        drag=1.1,
        linear_damping=0.04,
    ),
    "cable_2": HiddenCable(
        mass=0.0058,
        bend_stiffness=2.8e-5,
        twist_stiffness=2.6e-5,
        bend_damping=0.008,
        friction=0.29,
        endpoint_mass=0.0033,
        endpoint_share=0.6,
        drag=1.15,
        linear_damping=0.05,
    ),
    "cable_3": HiddenCable(
        mass=0.081,
        bend_stiffness=1.5e-3,
        twist_stiffness=1.3e-3,
        bend_damping=0.003,
        friction=0.40,
        endpoint_mass=0.0215,
        endpoint_share=0.5,
        drag=1.1,
        linear_damping=0.03,
    ),
}

# Copies of one product differ by a few per cent; the values that a user believes of a cable of
# their own by more, least for those that a scale tells and most for stiffness.
_COPY_SPREAD = 0.03
_BELIEF_SPREAD = {
    "mass": 0.08,
    "bend_stiffness": 0.45,
    "twist_stiffness": 0.45,
    "friction": 0.20,
    "endpoint_mass": 0.20,
}
_FRICTION_MAX = 1.5


def hidden_cable(cable: Cable, lab_seed: int) -> HiddenCable:
    """The true cable behind what is believed of it.

    Args:
        cable: A preset, or a user's own, for which the truth is drawn about its parameters.
        lab_seed: Which laboratory.
    """
    rng = np.random.default_rng([lab_seed, zlib.crc32(cable.name.encode())])
    if _is_preset(cable):
        truth = _PRESETS[cable.name]
        if lab_seed == 0:
            return truth
        names = [*_BELIEF_SPREAD, "bend_damping"]
        factors = dict(zip(names, np.exp(_COPY_SPREAD * rng.normal(size=len(names))), strict=True))
        return dataclasses.replace(
            truth, **{name: getattr(truth, name) * float(f) for name, f in factors.items()}
        )
    params = cable.params
    believed = {name: float(getattr(params, name)) for name in _BELIEF_SPREAD}
    drawn = {
        name: believed[name] * float(np.exp(spread * rng.normal()))
        for name, spread in _BELIEF_SPREAD.items()
    }
    return HiddenCable(
        mass=drawn["mass"],
        bend_stiffness=drawn["bend_stiffness"],
        twist_stiffness=drawn["twist_stiffness"],
        bend_damping=float(rng.uniform(0.003, 0.008)),
        friction=min(drawn["friction"], _FRICTION_MAX),
        endpoint_mass=drawn["endpoint_mass"],
        endpoint_share=float(rng.uniform(0.4, 0.7)) if cable.attachment_length else 0.0,
        drag=float(rng.uniform(1.0, 1.2)),
        linear_damping=float(rng.uniform(0.02, 0.06)),
    )


def _is_preset(cable: Cable) -> bool:
    """Whether a cable is a preset by name and by geometry; its params may have been tuned."""
    if cable.name not in CABLE_NAMES:
        return False
    preset = load_cable(cable.name)
    return all(
        getattr(cable, name) == getattr(preset, name)
        for name in ("length", "diameter", "attachment", "attachment_length")
    )
