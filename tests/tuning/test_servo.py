import dataclasses

import numpy as np
import pytest

from cablecast.errors import DatasetError
from cablecast.motion.servo import ServoModel
from cablecast.tuning.servo import identify_servo

TICK = 1 / 125
# Interval at which the true motion is computed: its error is far below the noise.
FINE = 1e-3
NOISE = 1e-4
# An arm reports this long after its last set point.
AFTER = 0.32
SERVO = ServoModel(
    delay=np.full(6, 0.006),
    frequency=np.array([45.0, 55.0, 65.0, 80.0, 60.0, 75.0]),
    damping=np.array([0.7, 0.8, 0.9, 1.0, 0.8, 0.75]),
)
# A dead time of several control cycles before a servo that is fast compared with them.
LATE_AND_FAST = ServoModel(
    delay=np.full(6, 0.085),
    frequency=np.array([370.0, 190.0, 290.0, 230.0, 200.0, 470.0]),
    damping=np.array([0.67, 1.3, 1.5, 1.8, 1.0, 0.95]),
)
SLOW_WITHOUT_DELAY = ServoModel(
    delay=np.zeros(6),
    frequency=np.array([13.0, 20.0, 16.0, 38.0, 15.0, 12.0]),
    damping=np.array([1.7, 0.36, 1.5, 0.62, 1.0, 0.6]),
)
# The fifth joint never moves in a cast.
MOVING = [0, 1, 2, 3, 5]
# The noise of ten trials hides a lag of less than a tenth of a tick.
LAG = 0.1 * TICK
# The fit may be off by a part of the noise only: it averages over many samples.
SAME_RESPONSE = NOISE / 2
# Offset of an encoder [rad]: a hundred times its noise.
OFFSET = 1e-2


def report(dataset, servo, rate=125.0, offset=0.0, noise=NOISE, rows=None):
    """Return the dataset as if its arm had followed a known servo and reported at some rate."""
    from scipy.interpolate import CubicSpline

    rng = np.random.default_rng(0)
    times, q = [], []
    for row in range(len(dataset)):
        commanded = dataset.commanded_joints(row)
        end = commanded.times[-1]
        fine = np.arange(int((end + AFTER) / FINE) + 1) * FINE
        set_points = CubicSpline(commanded.times, commanded.q, bc_type="clamped")
        moved = servo.respond(set_points(np.minimum(fine, end)), FINE)
        reported = np.arange(int((end + AFTER) * rate)) / rate
        read = CubicSpline(fine, moved)(reported) + offset
        times.append(reported)
        q.append((read + noise * rng.normal(size=read.shape)).ravel())
    return dataclasses.replace(
        dataset, extra=dataset.extra | {"actual_times": times, "actual_q": q}
    )


def assert_same_response(model, truth, dataset):
    """Delay and frequency can stand in for each other; the motion of the joints is what counts."""
    for row in range(len(dataset)):
        q = dataset.commanded_joints(row).q
        apart = (model.respond(q, TICK) - truth.respond(q, TICK))[:, MOVING]
        assert np.sqrt(np.mean(apart**2, axis=0)).max() < SAME_RESPONSE


@pytest.fixture(scope="module")
def reported(dataset):
    return report(dataset, SERVO)


@pytest.fixture(scope="module")
def fit(reported):
    return identify_servo(reported)


def test_a_known_servo_is_found_again(fit, reported):
    np.testing.assert_allclose(fit.model.lag[MOVING], SERVO.lag[MOVING], atol=LAG)
    assert_same_response(fit.model, SERVO, reported)
    np.testing.assert_allclose(fit.model.residual, NOISE, rtol=0.1)
    assert fit.trial_count == len(reported)


@pytest.mark.parametrize("rate", [40.0, 125.0, 130.0, 500.0])
def test_a_servo_is_found_at_any_rate_of_report(dataset, rate):
    reported = report(dataset, SERVO, rate=rate)
    assert_same_response(identify_servo(reported).model, SERVO, reported)


def test_reports_at_uneven_times_tell_the_servo(dataset):
    reported = report(dataset, SERVO, rate=500.0)
    rng = np.random.default_rng(1)
    times, q = [], []
    for row in range(len(reported)):
        joints = reported.measured_joints(row)
        # Steps of 10 to 34 ms.
        kept = np.cumsum(rng.integers(5, 18, 1000))
        kept = kept[kept < len(joints.times)]
        times.append(joints.times[kept])
        q.append(joints.q[kept].ravel())
    extra = reported.extra | {"actual_times": times, "actual_q": q}
    found = identify_servo(dataclasses.replace(reported, extra=extra)).model
    np.testing.assert_allclose(found.lag[MOVING], SERVO.lag[MOVING], atol=LAG)


@pytest.mark.parametrize(
    "servo", [LATE_AND_FAST, SLOW_WITHOUT_DELAY], ids=["late and fast", "slow without delay"]
)
def test_a_servo_far_from_the_usual_is_found(dataset, servo):
    reported = report(dataset, servo)
    found = identify_servo(reported).model
    np.testing.assert_allclose(found.lag[MOVING], servo.lag[MOVING], atol=LAG)
    assert_same_response(found, servo, reported)


@pytest.mark.parametrize(
    ("limits", "noise"),
    [((12.0, 3.8), NOISE), ((20.0, 3.0), NOISE), ((200.0, 2.2), NOISE), ((12.0, 2.5), 20 * NOISE)],
)
def test_limits_of_the_motor_at_the_base_are_found(dataset, limits, noise):
    values = np.full((2, 6), np.inf)
    values[:, 0] = limits
    weak = dataclasses.replace(SERVO, acceleration_max=values[0], speed_max=values[1])
    q = dataset.commanded_joints(0).q
    assert np.abs(weak.respond(q, TICK) - SERVO.respond(q, TICK)).max() > 100 * NOISE
    found = identify_servo(report(dataset, weak, noise=noise)).model
    np.testing.assert_allclose(found.speed_max[0], limits[1], rtol=0.02)
    np.testing.assert_array_equal(found.speed_max[1:], np.inf)
    # The truth is computed with finer steps.
    np.testing.assert_allclose(found.residual, noise, rtol=1.0)


def test_noise_is_no_limit(dataset):
    found = identify_servo(report(dataset, SERVO, noise=20 * NOISE)).model
    np.testing.assert_array_equal(found.acceleration_max, np.inf)
    np.testing.assert_array_equal(found.speed_max, np.inf)


def test_an_offset_of_the_encoders_is_no_lag(fit, dataset):
    shifted = identify_servo(report(dataset, SERVO, offset=OFFSET))
    for name in ("delay", "frequency", "damping"):
        np.testing.assert_allclose(
            getattr(shifted.model, name), getattr(fit.model, name), rtol=1e-3, atol=1e-5
        )
    # What the arm reported is still off by the offset.
    np.testing.assert_allclose(shifted.model.residual, OFFSET, rtol=1e-2)


def test_the_model_takes_the_gripper_to_where_it_went(fit):
    assert fit.commanded_rms > 5e-3
    # What is left is the encoders' noise at the arm's length.
    assert fit.model_rms < 3 * NOISE


def test_a_joint_that_never_moves_takes_what_is_usual(fit):
    others = fit.model.lag[MOVING]
    assert others.min() <= fit.model.lag[4] <= others.max()


def test_only_the_trials_asked_for_are_used(reported):
    assert identify_servo(reported, 3).trial_count == 3


def test_trials_without_reported_joints_are_refused(dataset):
    with pytest.raises(DatasetError, match="measured joints"):
        identify_servo(dataset)
