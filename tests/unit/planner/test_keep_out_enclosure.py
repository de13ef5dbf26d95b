"""Rates between two records never exceed their bounds, with a step of the acceleration too."""

import numpy as np
import pytest

from orientd.planner.keep_out.clearance import rates_between
from orientd.rotation import exp, multiply
from orientd.servo.path.segment import Segment, point_of
from orientd.stream.records import JOINTS

PERIOD = 0.002
SHARES = np.linspace(0.0, 0.9999, 100)


def records(random):
    """Return two records of a motion with a jerk, and with a step of the acceleration between."""
    q = random.normal(size=4)
    q /= np.linalg.norm(q)
    omega = random.normal(size=3) * random.choice([0.1, 2.0, 10.0])
    alpha, jerk, step = (
        random.normal(size=3) * random.choice(sizes)
        for sizes in ([0.0, 20.0, 200.0], [0.0, 1e3, 1e5], [0.0, 0.0, 30.0])
    )
    h, rest = PERIOD, PERIOD * random.uniform()
    turn = h * omega + h**2 / 2 * alpha + h**3 / 6 * jerk + rest**2 / 2 * step
    after = omega + h * alpha + h**2 / 2 * jerk + rest * step
    there = multiply(q, exp(turn))
    return np.array([[*q, *omega, *alpha], [*there, *after, *(alpha + h * jerk + step)]])


def point(row):
    return point_of((0.0, *row.tolist(), *[0.0] * 6, *[np.nan] * 2 * JOINTS))


@pytest.mark.parametrize("seed", range(4))
def test_no_rate_between_two_records_exceeds_its_bound(seed):
    random = np.random.default_rng(seed)
    for _ in range(50):
        rows = records(random)
        ((speed,), (bend,)) = rates_between(rows, PERIOD)
        segment = Segment(point(rows[0]), point(rows[1]), PERIOD)
        omega = np.array([segment.at(u).omega_body for u in SHARES.tolist()])
        alpha = np.diff(omega, axis=0) / (PERIOD * np.diff(SHARES)[:, None])
        assert np.linalg.norm(omega, axis=1).max() <= speed * (1.0 + 1e-9)
        assert np.linalg.norm(alpha, axis=1).max() <= bend * (1.0 + 1e-6) + 1e-6
