import numpy as np
import pytest
from rig import PERIOD, TERMS, peaks

from orientd.driver import ZERO
from orientd.driver.floats import exp, multiply
from orientd.servo.guard import Guard

Q = (1.0, 0.0, 0.0, 0.0)


def turning(guard, alpha, cycles):
    """Accelerate about a fixed axis; return what was admitted."""
    sent, omega = [guard.q], np.zeros(3)
    push = np.zeros(3)
    for _ in range(cycles):
        push = push + np.clip(np.asarray(alpha) - push, -8.0, 8.0)
        omega = omega + push * PERIOD
        q = multiply(sent[-1], exp(tuple(omega * PERIOD)))
        assert guard.admit(q, ZERO, TERMS) == ""
        sent.append(q)
    return sent


@pytest.mark.parametrize(
    ("alpha", "cycles"), [((4.0, 0, 0), 100), ((9.0, -9.0, 3.0), 60), ((0, 0, 16.9), 30)]
)
def test_a_soft_stop_keeps_every_limit_and_ends_at_rest(alpha, cycles):
    guard = Guard(PERIOD)
    sent = turning(guard, alpha, cycles)
    sent += [q for q, _ in guard.soft_stop(TERMS)]
    velocity, acceleration, jerk = peaks(np.array(sent))
    assert velocity <= TERMS.velocity * 1.001
    assert acceleration <= TERMS.acceleration * 1.001
    assert jerk <= TERMS.jerk * 1.001
    np.testing.assert_allclose(sent[-1], guard.q)


@pytest.mark.parametrize(
    ("step", "quantity"),
    [
        (0.0051, "angular velocity"),
        (0.0000681, "angular acceleration"),
    ],
)
def test_a_violation_names_the_quantity_and_changes_nothing(step, quantity):
    guard = Guard(PERIOD)
    before = (guard.q, guard.omega, guard.alpha)
    problem = guard.admit(exp((step, 0.0, 0.0)), ZERO, TERMS)
    assert problem.startswith(quantity)
    assert "the limit is" in problem
    assert (guard.q, guard.omega, guard.alpha) == before


def test_a_step_within_velocity_and_acceleration_can_still_break_the_jerk():
    guard = Guard(PERIOD)
    assert guard.admit(exp((6.79e-5, 0.0, 0.0)), ZERO, TERMS) == ""  # 16.98 rad/s^2, 8488 rad/s^3
    problem = guard.admit(guard.q, ZERO, TERMS)  # back to rest: twice the step
    assert problem.startswith("angular jerk")


def test_a_sign_flip_is_the_same_orientation():
    guard = Guard(PERIOD)
    guard.anchor(exp((0.3, 0.2, 0.1)), ZERO)
    flipped = tuple(-part for part in guard.q)
    assert guard.admit(flipped, ZERO, TERMS) == ""
    assert np.linalg.norm(guard.omega) < 1e-12
