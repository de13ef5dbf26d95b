import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from rig import PERIOD, TERMS, peaks
from scipy.spatial.transform import Rotation

from orientd.driver import ZERO
from orientd.floats import exp, multiply
from orientd.servo.guard import Guard
from orientd.stream import Terms
from orientd.stream.records import TERMS_FLOATS

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


ABOUT_Z = replace(TERMS, axis_velocity=(2.0, 1.0, 0.5), axis_acceleration=(9.0, 9.0, 4.0))


def test_a_component_beyond_its_own_limit_is_named_with_its_axis():
    guard = Guard(PERIOD)
    q = exp((0.0, 0.0, 4.1 * PERIOD**2))
    assert Guard(PERIOD).admit(q, ZERO, TERMS) == ""
    problem = guard.admit(q, ZERO, ABOUT_Z)
    assert problem == "angular acceleration 4.1 rad/s^2 about z, the limit is 4 rad/s^2"
    assert guard.q == Q
    assert guard.admit(exp((0.0, 0.0, 3.9 * PERIOD**2)), ZERO, ABOUT_Z) == ""


def test_a_component_that_is_not_a_number_is_not_admitted():
    guard = Guard(PERIOD)
    terms = replace(TERMS, axis_jerk=(math.nan, 1e9, 1e9))
    assert terms.has_axes
    assert "about x" in guard.admit(exp((1e-6, 0.0, 0.0)), ZERO, terms)


@pytest.mark.parametrize("alpha", [(1.0, -2.0, 3.9), (8.0, 3.0, 0.0), (-0.3, 0.0, -3.9)])
def test_a_soft_stop_keeps_the_limits_of_every_axis(alpha):
    terms = replace(ABOUT_Z, axis_jerk=(8000.0, 8000.0, 120.0))
    guard = Guard(PERIOD)
    sent = turning(guard, alpha, 40)
    sent += [q for q, _ in guard.soft_stop(terms)]
    quaternions = Rotation.from_quat(np.array(sent)[:, [1, 2, 3, 0]])
    omega = (quaternions[:-1].inv() * quaternions[1:]).as_rotvec() / PERIOD
    omega = np.concatenate([omega, np.zeros((3, 3))])
    stop = omega[40:]
    alphas = np.diff(stop, axis=0) / PERIOD
    jerk = np.diff(alphas, axis=0) / PERIOD
    assert np.all(np.abs(stop).max(axis=0) <= np.array(terms.axis_velocity) * 1.001)
    assert np.all(np.abs(alphas).max(axis=0) <= np.array(terms.axis_acceleration) * 1.001)
    assert np.all(np.abs(jerk).max(axis=0) <= np.array(terms.axis_jerk) * 1.001)


def test_terms_cross_the_mailbox_unchanged():
    terms = replace(ABOUT_Z, brake_rate=3.25)
    record = struct.pack(f"{TERMS_FLOATS}d", *terms.floats())
    assert Terms.from_floats(struct.unpack(f"{TERMS_FLOATS}d", record)) == terms
    assert not Terms.from_floats(TERMS.floats()).has_axes
