"""The interval of rates is the one that a scan of all rates finds."""

from math import inf

import numpy as np
import pytest

from orientd.servo.path.feasible_rates import Ahead, Past, allowed, released
from orientd.stream import JointShares, ServoLimits

H = 0.002
ZERO = (0.0, 0.0, 0.0)


def triple(vector):
    return tuple(vector.tolist())


def keeps(past, ahead, servo_limits, rate):
    omega = np.array(ahead.omega) * rate + ahead.bend
    alpha = (omega - past.omega) / H
    jerk = (alpha - past.alpha) / H
    push = (np.array(ahead.velocity) * rate + ahead.shift - past.velocity) / H
    return (
        np.linalg.norm(alpha) <= servo_limits.acceleration
        and np.linalg.norm(jerk) <= servo_limits.jerk
        and np.linalg.norm(push) <= servo_limits.linear_acceleration
        and (np.abs(alpha) <= servo_limits.axis_acceleration).all()
        and (np.abs(jerk) <= servo_limits.axis_jerk).all()
        and keeps_joints(past.rate, servo_limits.joint_shares, rate)
    )


def keeps_joints(before, shares, rate):
    """Say whether a joint that turns as fast and is bent as much as can be keeps its limit."""
    if not shares.speed:
        return True
    squares = before**2 if rate < before else 0.5 * (rate**2 + before**2)
    return shares.speed * abs(rate - before) / H + shares.acceleration * squares <= 1.0


@pytest.mark.parametrize("seed", range(40))
def test_a_rate_is_allowed_exactly_if_it_keeps_every_limit(seed):
    random = np.random.default_rng(seed)
    omega, velocity = random.normal(size=(2, 3))
    past = Past(
        triple(0.8 * omega + 0.01 * random.normal(size=3)),
        triple(3.0 * random.normal(size=3)),
        triple(0.8 * velocity),
        0.8 + 0.01 * random.normal(),
    )
    ahead = Ahead(
        triple(omega),
        triple(0.005 * random.normal(size=3)),
        triple(velocity) if seed % 3 else ZERO,
        triple(0.002 * random.normal(size=3)) if seed % 3 else ZERO,
    )
    if not seed % 3:
        past = past._replace(velocity=ZERO)
    axes = (30.0, inf, 15.0) if seed % 2 else (inf, inf, inf)
    servo_limits = ServoLimits(
        9.0, 25.0, 9000.0, 9.0, 20.0, 1.0, (9.0,) * 3, axes, (inf, 6000.0, inf),
        JointShares(0.9, random.uniform(0.05, 0.5), random.random()) if seed % 5 else JointShares(),
    )  # fmt: skip
    low, high = allowed(past, ahead, servo_limits, H, 1.0)
    for rate in np.linspace(0.5, 1.1, 601):
        if min(abs(rate - low), abs(rate - high)) > 1e-9:
            assert keeps(past, ahead, servo_limits, rate) == (low < rate < high)


def test_a_still_path_allows_every_rate_or_none():
    servo_limits = ServoLimits(1.0, 5.0, 1000.0, 1.0, 1.0, 1.0)
    still = Ahead(ZERO, ZERO, ZERO, ZERO)
    assert allowed(Past(ZERO, ZERO, ZERO, 0.0), still, servo_limits, H, 1.0) == (-inf, inf)
    low, high = allowed(Past((0.1, 0.0, 0.0), ZERO, ZERO, 1.0), still, servo_limits, H, 1.0)
    assert low > high


@pytest.mark.parametrize("speed", [1e-4, 0.01, 0.3, 2.0])
def test_a_release_ends_at_rest_within_the_jerk(speed):
    servo_limits = ServoLimits(9.0, inf, 40.0, 1.0, 1.0, 1.0)
    rates, past = [], Past((speed, 0.0, 0.0), ZERO, ZERO, speed / 2.0)
    ahead = Ahead((2.0, 0.0, 0.0), ZERO, ZERO, ZERO)
    while not rates or rates[-1] > 1e-9:
        rate = released(past, ahead, servo_limits, H, 1.0)
        omega = (2.0 * rate, 0.0, 0.0)
        past = Past(omega, ((omega[0] - past.omega[0]) / H, 0.0, 0.0), ZERO, rate)
        rates.append(rate)
    omega = np.array([speed, *(2.0 * np.array(rates)), 0.0, 0.0])
    jerk = np.diff(omega, 2) / H**2
    assert jerk.max() <= 40.0 * (1 + 1e-6)
    assert omega.min() > -1e-9


@pytest.mark.parametrize("bend", [0.0, 0.3, 0.95])
def test_a_stop_for_the_joints_sake_takes_what_they_allow(bend):
    shares, still, rates = JointShares(1.0, 0.1, bend), Ahead(ZERO, ZERO, ZERO, ZERO), [1.0]
    servo_limits = ServoLimits(9.0, inf, inf, 1.0, 1.0, 1.0, joint_shares=shares)
    while rates[-1] > 0.0:
        low, _ = allowed(Past(ZERO, ZERO, ZERO, rates[-1]), still, servo_limits, H, 1.0)
        assert low < rates[-1]
        rates.append(max(low, 0.0))
    # The rate falls by (1 - bend r^2) / speed a second.
    least = 0.1 * (np.arctanh(np.sqrt(bend)) / np.sqrt(bend) if bend else 1.0)
    assert H * (len(rates) - 1) == pytest.approx(least, abs=3 * H)
