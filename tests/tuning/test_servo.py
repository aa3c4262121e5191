import dataclasses

import numpy as np
import pytest

from cablecast.errors import DatasetError
from cablecast.motion.servo import ServoModel
from cablecast.tuning.servo import identify_servo

TICK = 1 / 125
NOISE = 1e-4
SERVO = ServoModel(
    delay=np.full(6, 0.006),
    frequency=np.array([45.0, 55.0, 65.0, 80.0, 60.0, 75.0]),
    damping=np.array([0.7, 0.8, 0.9, 1.0, 0.8, 0.75]),
)
# Joint 5 never moves in a cast; of the others a tick's tenth is all that the encoders' noise hides.
MOVING = [0, 1, 2, 3, 5]
LAG = 0.1 * TICK
SAME_RESPONSE = NOISE / 2


@pytest.fixture(scope="module")
def reported(dataset):
    """The dataset, had its arm reported joints of a known servo with noisy encoders."""
    rng = np.random.default_rng(0)
    times, q = [], []
    for row in range(len(dataset)):
        set_points = np.reshape(dataset.extra["joint_q"][row], (-1, 6))
        held = np.concatenate([set_points, np.repeat(set_points[-1:], 40, axis=0)])
        moved = SERVO.respond(held, TICK)
        times.append(np.arange(len(held)) * TICK)
        q.append((moved + NOISE * rng.normal(size=moved.shape)).ravel())
    return dataclasses.replace(
        dataset, extra=dataset.extra | {"actual_times": times, "actual_q": q}
    )


def test_a_known_servo_is_found_again(reported):
    fit = identify_servo(reported)
    np.testing.assert_allclose(fit.model.lag[MOVING], SERVO.lag[MOVING], atol=LAG)
    # Delay and frequency can stand in for each other; what the joints do is what counts.
    for row in range(len(reported)):
        q = np.reshape(reported.extra["joint_q"][row], (-1, 6))
        apart = fit.model.respond(q, TICK) - SERVO.respond(q, TICK)
        assert np.sqrt(np.mean(apart**2, axis=0)).max() < SAME_RESPONSE
    np.testing.assert_allclose(fit.model.residual, NOISE, rtol=0.1)
    assert fit.trial_count == len(reported)


def test_the_model_takes_the_gripper_to_where_it_went(reported):
    fit = identify_servo(reported)
    assert fit.commanded_rms > 5e-3
    # What is left is the encoders' noise at the arm's length.
    assert fit.model_rms < 3 * NOISE


def test_a_joint_that_never_moves_takes_what_is_usual(reported):
    fit = identify_servo(reported)
    others = fit.model.lag[MOVING]
    assert others.min() <= fit.model.lag[4] <= others.max()


def test_trials_without_reported_joints_are_refused(dataset):
    with pytest.raises(DatasetError, match="measured joints"):
        identify_servo(dataset)
