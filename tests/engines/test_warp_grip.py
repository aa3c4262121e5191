"""Pads of a gripper that give, against the statics and the modes of a beam on a hinge spring."""

import numpy as np
import pytest
from scipy.optimize import brentq

from cablecast.cable import Cable, CableParams
from cablecast.engines.base import CableState
from cablecast.engines.warp_ import EngineWarp
from cablecast.motion.grip_path import GripPath

LENGTH, HEIGHT, SEGMENT_COUNT = 0.5, 1.0, 40
CABLE = Cable(
    name="rod",
    length=LENGTH,
    diameter=0.006,
    params=CableParams(mass=0.05, bend_stiffness=0.02, twist_stiffness=0.02),
)
LIMIT = LENGTH / float(CABLE.params.bend_stiffness)
"""Turn of the end of the cable over a moment on it: pads of this compliance turn as far."""


def play(cable, state, duration, gravity):
    engine = EngineWarp(segment_count=SEGMENT_COUNT, rest_speed=0.0, gravity=gravity)
    path = GripPath.hold([0.0, 0.0, HEIGHT, 0.0, 0.0], 0.1)
    return engine.rollout(cable, path, state, duration, duration / 200)


def straight():
    nodes = np.zeros((1, SEGMENT_COUNT + 1, 3))
    nodes[0, :, 1] = np.linspace(0.0, LENGTH, SEGMENT_COUNT + 1)
    nodes[0, :, 2] = HEIGHT
    return nodes


@pytest.mark.parametrize("material", [{}, {"damping_time": 0.05}])
def test_pads_turn_by_their_compliance_times_the_moment(material):
    shares, gravity = np.array([0.0, 0.1, 1.0, 2.0]), 0.1
    cable = CABLE.with_params(linear_damping=4.0, grip_compliance=shares * LIMIT, **material)
    rollout = play(cable, CableState.at_rest(straight()), 8.0, gravity)
    sag = HEIGHT - rollout.endpoint_xyz[:, -1, 2]
    weight = float(CABLE.params.mass) * gravity
    bent = weight * LENGTH**3 / (8.0 * float(CABLE.params.bend_stiffness))
    turned = 0.5 * weight * LENGTH**2 * shares * LIMIT
    np.testing.assert_allclose(sag, bent + turned, rtol=0.01)


def mode(share):
    """Return lambda of the first mode of a cantilever on a hinge of `share` times L / EI.

    From w = 0 and EI w'' = w' / compliance at the hinge: the closed form ends at that of a clamp
    (1.875) on one side, and of a hinge (0, a pendulum without gravity) on the other.
    """

    def frequency(x):
        clamp = 1.0 + np.cos(x) * np.cosh(x)
        return clamp - share * x * (np.cosh(x) * np.sin(x) - np.sinh(x) * np.cos(x))

    return brentq(frequency, 0.1, 1.9)


@pytest.mark.parametrize("share", [0.0, 0.3, 2.0])
def test_a_cable_in_soft_pads_swings_as_a_beam_on_a_hinge_spring(share):
    amplitude = 1e-3
    x = np.linspace(0.0, 1.0, SEGMENT_COUNT + 1)
    w = mode(share)
    # The shape from the hinge on, A (sin - sinh) + B (cos - cosh) + C sinh, with w''(1) = 0.
    b = 1.0
    c = -2.0 * b * share * w
    known = b * (np.cos(w) + np.cosh(w)) - c * np.sinh(w)
    a = -known / (np.sin(w) + np.sinh(w))
    shape = a * (np.sin(w * x) - np.sinh(w * x)) + b * (np.cos(w * x) - np.cosh(w * x))
    shape = shape + c * np.sinh(w * x)
    nodes = straight()
    nodes[0, :, 0] = amplitude * shape / shape[-1]
    cable = CABLE.with_params(grip_compliance=share * LIMIT)
    density = float(CABLE.params.mass) / LENGTH
    rate = w**2 * np.sqrt(float(CABLE.params.bend_stiffness) / density / LENGTH**4)
    rollout = play(cable, CableState.at_rest(nodes), 2.0 * np.pi / rate, 0.0)
    exact = amplitude * np.cos(rate * rollout.times)
    np.testing.assert_allclose(rollout.endpoint_xyz[0, :, 0], exact, atol=0.03 * amplitude)
