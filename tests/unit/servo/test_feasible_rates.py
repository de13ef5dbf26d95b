"""The interval of rates is the one that a scan of all rates finds."""

from math import inf

import numpy as np
import pytest

from orientd.driver import AxisLimits
from orientd.servo.path.feasible_rates import Ahead, Past, allowed, released
from orientd.stream.records import ServoLimits

H = 0.002
ZERO = (0.0, 0.0, 0.0)


def triple(vector):
    return tuple(vector.tolist())


def keeps(past, ahead, servo_limits, axes, rate):
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
        and keeps_joints(past, ahead, axes, rate)
    )


def keeps_joints(past, ahead, axes, rate):
    """Say whether every axis keeps its limits."""
    turns = [rest + slope * rate for rest, slope in ahead.joints]
    changes = (np.array(turns) - past.joint_rates) / H
    twists = (changes - past.joint_changes) / H
    return all(abs(c) <= axis.acceleration for c, axis in zip(changes, axes, strict=True)) and all(
        abs(c) <= axis.jerk for c, axis in zip(twists, axes, strict=True)
    )


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
    components = (30.0, inf, 15.0) if seed % 2 else (inf, inf, inf)
    servo_limits = ServoLimits(
        9.0, 25.0, 9000.0, 9.0, 20.0, 1.0, (9.0,) * 3, components, (inf, 6000.0, inf)
    )  # fmt: skip
    axes = ()
    if seed % 5:
        slopes = 3.0 * random.normal(size=2)
        ahead = ahead._replace(joints=[(0.01 * random.normal(), slope) for slope in slopes])
        past = past._replace(
            joint_rates=tuple(0.8 * slopes), joint_changes=tuple(3.0 * random.normal(size=2))
        )
        axes = [
            AxisLimits("a", -1, 1, 9.0, random.uniform(10.0, 60.0)),
            AxisLimits("b", -1, 1, 9.0, inf, 1e4),
        ]
    low, high = allowed(past, ahead, servo_limits, axes, H, 1.0)
    for rate in np.linspace(0.5, 1.1, 601):
        if min(abs(rate - low), abs(rate - high)) > 1e-9:
            assert keeps(past, ahead, servo_limits, axes, rate) == (low < rate < high)


def test_a_still_path_allows_every_rate_or_none():
    servo_limits = ServoLimits(1.0, 5.0, 1000.0, 1.0, 1.0, 1.0)
    still = Ahead(ZERO, ZERO, ZERO, ZERO)
    assert allowed(Past(ZERO, ZERO, ZERO, 0.0), still, servo_limits, (), H, 1.0) == (-inf, inf)
    low, high = allowed(Past((0.1, 0.0, 0.0), ZERO, ZERO, 1.0), still, servo_limits, (), H, 1.0)
    assert low > high


@pytest.mark.parametrize("speed", [1e-4, 0.01, 0.3, 2.0])
def test_a_release_ends_at_rest_within_the_jerk(speed):
    servo_limits = ServoLimits(9.0, inf, 40.0, 1.0, 1.0, 1.0)
    rates, past = [], Past((speed, 0.0, 0.0), ZERO, ZERO, speed / 2.0)
    ahead = Ahead((2.0, 0.0, 0.0), ZERO, ZERO, ZERO)
    while not rates or rates[-1] > 1e-9:
        rate = released(past, ahead, servo_limits, (), H, 1.0)
        omega = (2.0 * rate, 0.0, 0.0)
        past = Past(omega, ((omega[0] - past.omega[0]) / H, 0.0, 0.0), ZERO, rate)
        rates.append(rate)
    omega = np.array([speed, *(2.0 * np.array(rates)), 0.0, 0.0])
    jerk = np.diff(omega, 2) / H**2
    assert jerk.max() <= 40.0 * (1 + 1e-6)
    assert omega.min() > -1e-9
