"""Grippers that let the cable turn about them."""

import numpy as np
import pytest
from benchmarks.validation.scenes import LENGTH, hold, make_cable, straight, turning

from cablecast.conventions import GRAVITY
from cablecast.engines.warp_ import EngineWarp
from cablecast.errors import InputError

START = np.array([0.0, 0.0, 2.0])
STIFF = make_cable(bend_stiffness=5e-2)


def engine(**options):
    return EngineWarp(segment_count=20, table=False, hinged=True, precision="double", **options)


def test_a_stiff_cable_on_a_hinge_swings_as_a_rigid_pendulum():
    # A rod about its end, w² = 3 g / (2 L), whose heavy end nodes 20 segments take as points:
    # their moment of inertia is L² m (1 / 3 + 1 / (6 N²)).
    amplitude, count = 0.02, 20
    frequency = np.sqrt(0.5 * GRAVITY / (LENGTH * (1.0 / 3.0 + 1.0 / (6.0 * count**2))))
    state = straight(count, START, [np.sin(amplitude), 0.0, -np.cos(amplitude)])
    period = 2.0 * np.pi / frequency
    rollout = engine().rollout(STIFF, hold(START), state, 2.0 * period, 0.01)
    expected = LENGTH * amplitude * np.cos(frequency * rollout.times)
    # It bends a little under its own inertia, the square of its slowness beside the first mode.
    np.testing.assert_allclose(
        rollout.endpoint_xyz[0, :, 0], expected, rtol=0, atol=0.05 * LENGTH * amplitude
    )


def test_a_hinge_turns_freely_whichever_way_the_gripper_points():
    state = turning(straight(20, START, [0.0, 1.0, 0.0]), 2.0, [0.0, 0.0, 1.0], START)
    rollout = engine(gravity=0.0).rollout(STIFF, hold(START, yaw=1.0), state, 1.0)
    angle = 2.0 * rollout.times[-1]
    end = START + LENGTH * np.array([-np.sin(angle), np.cos(angle), 0.0])
    np.testing.assert_allclose(rollout.endpoint_xyz[0, -1], end, atol=2e-3 * LENGTH)


def test_a_hinge_holds_no_cable_with_a_memory():
    with pytest.raises(InputError, match="hinges hold no cable"):
        engine().rollout(STIFF.with_params(damping_time=0.1), hold(START), None, 0.1)
