"""True values of the strike laboratory besides those of its cables and its arm (`_hidden.py`).

Nothing outside rigs/virtual may read them. How far equal swings differ, and what the camera does,
was set before any aim was run, by what stands next to each value; docs/strike.md names the sources.
"""

import dataclasses
from typing import Any

import numpy as np


@dataclasses.dataclass(frozen=True, kw_only=True)
class HiddenSwing:
    """What a strike laboratory has besides cable and arm.

    Attributes:
        stick_frequency: Frequency at which the loaded stick sways on the flange [Hz]: a beech rod
            of 20 mm and half a metre in a clamp of printed plastic.
        stick_damping: Damping ratio of that sway [-].
        drag_blunt: Coefficient of MuJoCo's blunt drag across a piece of cable [-].
        drag_slender: Coefficient of its slender drag along it [-].
        knot_stiffness: Turning stiffness of the knot at the stick over that of the cable [-].
        hook_friction: Friction of the loop in which an attachment hangs, over its weight times its
            length [-].
    """

    stick_frequency: float = 14.0
    stick_damping: float = 0.03
    drag_blunt: float = 1.0
    drag_slender: float = 0.4
    knot_stiffness: float = 2.0
    hook_friction: float = 0.02


@dataclasses.dataclass(frozen=True, kw_only=True)
class HiddenPlaneCamera:
    """The camera beside the swing: a global shutter that looks along the axis of its plane.

    Attributes:
        distance: Distance from the plane [m].
        focal: Focal length [px].
        rate: Frames per second [1/s].
        exposure: Time over which a frame averages the marker's place [s].
        noise: Standard deviation of a coordinate of the marker's middle [px]. A blurred, lit marker
            of some ten pixels is found to a third of a pixel.
        stamp: Quantum of the time stamps [s].
        clock: Standard deviation of the offset between the clocks of camera and arm [s], as it
            stays after `camera sync`, which leaves 2.8 ms at half the rate.
        scale: Standard deviation of the error of the calibrated scale [-]: a millimetre on a board
            of half a metre.
        offset: Standard deviation of the error of the calibrated origin [m].
        lost: Share of the frames without a marker [-].
    """

    distance: float = 3.5
    focal: float = 900.0
    rate: float = 120.0
    exposure: float = 0.002
    noise: float = 0.35
    stamp: float = 0.001
    clock: float = 0.0015
    scale: float = 0.002
    offset: float = 0.002
    lost: float = 0.01


@dataclasses.dataclass(frozen=True, kw_only=True)
class SwingNoise:
    """Standard deviations of what changes from swing to swing.

    Attributes:
        sway: Amplitude of the tip that still sways when a swing starts, in each direction [m]: a
            person, or the camera, waits until it is below some millimetres.
        air: Speed of the air in the room, one draw a swing [m/s]: a tenth of a metre a second is
            what standards of comfort allow at desks.
        curl: Curvature that earlier swings have left in the cable [1/m].
        slip: Change of the free length as the knot settles [m].
    """

    sway: float = 0.002
    air: float = 0.05
    curl: float = 0.1
    slip: float = 0.0005


def hidden_swing(lab_seed: int) -> HiddenSwing:
    """Return the hidden values of a laboratory: others than the first are off by a fifth."""
    return _drawn(HiddenSwing(), lab_seed, 21, 0.2)


def hidden_plane_camera(lab_seed: int) -> HiddenPlaneCamera:
    """Return the camera of a laboratory, the same in all but its distance."""
    camera = HiddenPlaneCamera()
    factor = float(np.exp(0.1 * np.random.default_rng([lab_seed, 22]).normal()))
    return dataclasses.replace(camera, distance=camera.distance * factor)


def _drawn(values: Any, lab_seed: int, stream: int, deviation: float) -> Any:
    if lab_seed == 0:
        return values
    rng = np.random.default_rng([lab_seed, stream])
    return dataclasses.replace(
        values,
        **{
            field.name: getattr(values, field.name) * float(np.exp(deviation * rng.normal()))
            for field in dataclasses.fields(values)
        },
    )
