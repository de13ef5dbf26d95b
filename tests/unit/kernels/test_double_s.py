"""Motion along a line at its limits: what the closed forms promise."""

import math

import numpy as np
import pytest

from orientd import kernels

CASES = 2000
SEED = 5


def rates(rng):
    """Return a velocity, an acceleration and a jerk of any proportions; two may be infinite."""
    velocity, acceleration, jerk = 10.0 ** rng.uniform([-3, -3, -2], [2, 4, 7])
    return (
        velocity if rng.random() < 0.9 else math.inf,
        acceleration,
        jerk if rng.random() < 0.9 else math.inf,
    )


def test_a_double_s_covers_its_way_and_keeps_its_limits():
    rng = np.random.default_rng(SEED)
    for _ in range(CASES):
        way, (velocity, acceleration, jerk) = 10.0 ** rng.uniform(-6, 2), rates(rng)
        rise, hold, cruise = kernels.double_s(way, velocity, acceleration, jerk)
        assert min(rise, hold, cruise) >= 0.0
        highest = way / (2.0 * rise + hold + cruise)
        pull = highest / (rise + hold)
        assert highest <= velocity * (1.0 + 1e-12)
        assert pull <= acceleration * (1.0 + 1e-12)
        assert pull <= jerk * rise * (1.0 + 1e-12) or jerk == math.inf
        # Where it is not limited by one rate, it is by the next one.
        assert cruise == 0.0 or highest == pytest.approx(velocity)
        assert hold == 0.0 or pull == pytest.approx(acceleration)
        assert rise == 0.0 or pull == pytest.approx(jerk * rise)


def test_what_is_left_of_a_stop_is_the_stop_from_there():
    rng = np.random.default_rng(SEED)
    for _ in range(CASES):
        _, acceleration, jerk = rates(rng)
        if jerk == math.inf:
            continue
        rate = rng.uniform(-1.0, 1.0) * acceleration
        speed = max(0.0, -0.5 * rate * abs(rate) / jerk) + 10.0 ** rng.uniform(-4, 2)
        time, way = kernels.stop_along(speed, rate, acceleration, jerk)
        backwards = kernels.stop_along(-speed, -rate, acceleration, jerk)
        assert backwards == pytest.approx((time, -way))
        peak = min(acceleration, math.sqrt(jerk * speed + 0.5 * rate * rate))
        # In a part of the first phase the acceleration falls with the jerk.
        step = rng.uniform(0.0, 1.0) * (rate + peak) / jerk
        gone = step * (speed + step * (0.5 * rate - jerk * step / 6.0))
        later = speed + step * (rate - 0.5 * jerk * step), rate - jerk * step
        left = kernels.stop_along(*later, acceleration, jerk)
        scale = abs(way) + speed * time
        assert left[0] + step == pytest.approx(time, rel=1e-6)
        assert left[1] + gone == pytest.approx(way, abs=1e-9 * scale)


def test_a_stop_from_rest_takes_nothing_and_one_without_a_limit_of_the_jerk_is_a_ramp():
    assert kernels.stop_along(0.0, 0.0, 2.0, 30.0) == (0.0, 0.0)
    assert kernels.stop_along(3.0, 0.0, 2.0, math.inf) == (1.5, 2.25)


def test_changes_of_a_velocity_add_up():
    rng = np.random.default_rng(SEED)
    for _ in range(CASES):
        total, step = 10.0 ** rng.uniform(-4, 1, 2)
        first = kernels.first_change(total, step)
        changes = np.arange(first, 0.0, -step)
        assert changes.sum() == pytest.approx(total, rel=1e-9)
