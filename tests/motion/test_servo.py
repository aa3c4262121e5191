import dataclasses
import json

import numpy as np
import pytest

from cablecast.errors import InputError
from cablecast.motion.casting import cast_grip_paths
from cablecast.motion.servo import ServoModel, joint_response
from cablecast.setup import Setup

SETUP = Setup()
SERVO = ServoModel(
    delay=np.array([0.004, 0.006, 0.008, 0.01, 0.012, 0.005]),
    frequency=np.array([45.0, 55.0, 65.0, 80.0, 90.0, 75.0]),
    damping=np.array([0.7, 0.8, 0.9, 1.0, 1.2, 0.75]),
)
ACTIONS = np.array([[-0.6, 0.8, 0.5, 1.2], [-0.2, 0.3, 0.7, 0.3], [-1.0, 0.2, 0.4, 1.0]])
# Steps of 16 ms and knots of 32 ms against steps of 1 ms: small against the 0.2 mm that the model
# itself leaves of a real arm's motion.
FINE_POSITION, FINE_ANGLE = 1e-4, 3e-4
# Closed form against closed form: nothing but rounding.
ROUNDING = 1e-9
# Sampled by the millisecond, linear between samples, against an ODE solver at 1e-9.
SOLVER = 2e-5


# A motor that is too weak at its base, as far as steps of 2 ms tell, against an ODE solver [rad].
LIMIT_STEPS = 2e-3


@pytest.fixture(scope="module")
def commanded():
    return cast_grip_paths(ACTIONS, SETUP)


def response(q, dt, joint):
    """Return the solution of the servo's differential equation, step by step, for one joint."""
    from scipy.integrate import solve_ivp

    times = np.arange(len(q)) * dt
    w, zeta = SERVO.frequency[joint], SERVO.damping[joint]

    def rate(t, state):
        target = np.interp(t - SERVO.delay[joint], times, q)
        return [state[1], w * w * (target - state[0]) - 2 * zeta * w * state[1]]

    solved = solve_ivp(rate, (0, times[-1]), [q[0], 0], t_eval=times, rtol=1e-9, atol=1e-10)
    return solved.y[0]


def test_each_joint_follows_the_equation_of_a_delayed_oscillator():
    dt = 1e-3
    t = np.arange(400) * dt
    q = 0.3 + 0.5 * np.sin(np.pi * np.clip(t / 0.3, 0, 1)) ** 2
    moved = SERVO.respond(np.repeat(q[:, None], 6, axis=1), dt)
    for joint in range(6):
        np.testing.assert_allclose(moved[:, joint], response(q, dt, joint), atol=SOLVER)


@pytest.mark.parametrize("dt", [1e-3, 0.016])
@pytest.mark.parametrize("damping", [0.2, 1.0, 1.0 + 1e-9, 5.0])
@pytest.mark.parametrize("frequency", [5.0, 60.0, 5000.0])
def test_a_ramp_is_followed_exactly_at_all_bounds_of_the_model(frequency, damping, dt):
    from scipy.linalg import expm

    rate, count = 1.5, 50
    # Position, speed and target of the joint; the target runs away at the rate.
    system = np.zeros((4, 4))
    system[0, 1] = 1.0
    system[1, :3] = -(frequency**2), -2.0 * damping * frequency, frequency**2
    system[2, 3] = 1.0
    exact = [(expm(system * dt * tick) @ [0.0, 0.0, 0.0, rate])[0] for tick in range(count)]
    ramp = rate * dt * np.arange(count)
    moved = joint_response(ramp, dt, delay=0.0, frequency=frequency, damping=damping)
    np.testing.assert_allclose(moved, exact, atol=ROUNDING)


def test_a_steady_motion_is_trailed_by_the_lag():
    dt, rate = 0.008, 1.5
    q = np.repeat((np.arange(200) * dt * rate)[:, None], 6, axis=1)
    moved = SERVO.respond(q, dt)
    # Not at the very end, where nobody says how the set points go on.
    np.testing.assert_allclose((q - moved)[-5], rate * SERVO.lag, rtol=1e-3)


def weak(acceleration_max, speed_max):
    """Return the servo with limits of the motor at its base."""
    limits = np.full((2, 6), np.inf)
    limits[:, 0] = acceleration_max, speed_max
    return dataclasses.replace(SERVO, acceleration_max=limits[0], speed_max=limits[1])


def test_a_motor_at_full_power_nears_its_speed_exponentially():
    # A set point far away asks for all that the motor can give: dv/dt = a (1 - v / v_max).
    dt, acceleration, speed = 0.008, 20.0, 2.0
    times = np.arange(50) * dt
    ahead = np.where(times > 0, 1e3, 0.0)
    moved = joint_response(
        ahead,
        dt,
        delay=0.0,
        frequency=60.0,
        damping=0.8,
        acceleration_max=acceleration,
        speed_max=speed,
    )
    reach = speed / acceleration
    exact = speed * (times - reach * (1.0 - np.exp(-times / reach)))
    np.testing.assert_allclose(moved, exact, atol=LIMIT_STEPS)


@pytest.mark.parametrize("limits", [(15.0, 2.5), (30.0, 1.5), (40.0, np.inf), (np.inf, 1.5)])
def test_a_weak_motor_follows_its_equation(limits):
    from scipy.integrate import solve_ivp

    acceleration, speed = limits
    dt = 0.008
    times = np.arange(150) * dt
    q = 0.9 * np.sin(np.pi * np.clip(times / 0.6, 0, 1)) ** 2
    w, zeta, delay = SERVO.frequency[0], SERVO.damping[0], SERVO.delay[0]
    finite = min(acceleration, 1e5)

    def rate(t, state):
        target = 0.9 * np.sin(np.pi * np.clip((t - delay) / 0.6, 0, 1)) ** 2
        wanted = w * w * (target - state[0]) - 2 * zeta * w * state[1]
        left = finite * max(1.0 - abs(state[1]) / speed, 0.0)
        ahead, back = (left, finite) if state[1] > 0 else (finite, left)
        return [state[1], np.clip(wanted, -back, ahead)]

    solved = solve_ivp(rate, (0, times[-1]), [0, 0], t_eval=times, rtol=1e-8, max_step=1e-3)
    moved = weak(*limits).respond(np.repeat(q[:, None], 6, axis=1), dt)
    np.testing.assert_allclose(moved[:, 0], solved.y[0], atol=LIMIT_STEPS)
    strong = SERVO.respond(np.repeat(q[:, None], 6, axis=1), dt)
    assert np.abs(strong - moved)[:, 0].max() > 10 * LIMIT_STEPS
    np.testing.assert_array_equal(strong[:, 1:], moved[:, 1:])


def test_limits_that_are_never_reached_change_nothing(commanded):
    times = np.arange(200) * 0.008
    q = SETUP.arm.inverse(commanded.evaluate(times))
    moved = weak(1e4, 1e3).respond(q, 0.008)
    np.testing.assert_allclose(moved, SERVO.respond(q, 0.008), atol=FINE_ANGLE)


def test_an_arm_with_a_weak_base_arrives_later_where_it_was_sent(commanded):
    servo = weak(15.0, 1.2)
    followed = servo.apply(commanded, SETUP.arm)
    assert np.all(followed.duration >= SERVO.apply(commanded, SETUP.arm).duration)
    assert np.any(followed.duration > SERVO.apply(commanded, SETUP.arm).duration)
    end = np.full((len(commanded), 1), 10.0)
    np.testing.assert_allclose(followed.evaluate(end), commanded.evaluate(end), atol=FINE_ANGLE)


def test_the_resulting_path_is_that_of_finely_sampled_joints(commanded):
    arm, dt = SETUP.arm, 1e-3
    followed = SERVO.apply(commanded, SETUP.arm)
    times = np.arange(int(2.2 / dt)) * dt
    fine = arm.grip_pose(SERVO.respond(arm.inverse(commanded.evaluate(times)), dt))
    apart = np.abs(followed.evaluate(times) - fine)
    assert apart[..., :3].max() < FINE_POSITION
    assert apart[..., 3:].max() < FINE_ANGLE
    assert np.abs(commanded.evaluate(times) - fine)[..., :2].max() > 100 * FINE_POSITION


def test_the_arm_ends_where_it_was_sent_and_later(commanded):
    followed = SERVO.apply(commanded, SETUP.arm)
    assert np.all(followed.duration > commanded.duration + SERVO.lag.min())
    end = np.full((len(commanded), 1), 10.0)
    np.testing.assert_allclose(followed.evaluate(end), commanded.evaluate(end), atol=FINE_POSITION)


def test_a_path_does_not_depend_on_those_beside_it(commanded):
    followed = SERVO.apply(commanded, SETUP.arm)
    times = np.linspace(0, 3, 200)
    for row in range(len(commanded)):
        alone = SERVO.apply(commanded[row], SETUP.arm)
        np.testing.assert_allclose(
            alone.evaluate(times)[0], followed.evaluate(times)[row], atol=1e-6
        )
        assert alone.duration[0] == pytest.approx(followed.duration[row])


def test_values_in_a_file_give_back_the_model():
    servo = weak(15.0, 2.5)
    stored = ServoModel.from_dict(json.loads(json.dumps(servo.to_dict())))
    for field in dataclasses.fields(ServoModel):
        np.testing.assert_array_equal(getattr(stored, field.name), getattr(servo, field.name))


@pytest.mark.parametrize(
    "values",
    [{}, {"delay": [0.0] * 6}, SERVO.to_dict() | {"damping": [1.0] * 5}, {"delay": "late"}, 3],
    ids=repr,
)
def test_values_that_are_no_model_are_refused(values):
    with pytest.raises(InputError):
        ServoModel.from_dict(values)


def test_a_response_out_of_bounds_is_refused():
    with pytest.raises(InputError, match="servo frequency = 1 rad/s"):
        dataclasses.replace(SERVO, frequency=np.full(6, 1.0))
