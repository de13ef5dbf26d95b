"""Bounds between two records: of rates, with a step of the acceleration too, and of clearances."""

import math

import numpy as np
import pytest

from orientd.keep_out import KeepOut, cone
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.keep_out.clearance import Cones, rates_between
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import exp, multiply
from orientd.servo.path.segment import Segment, point_of
from orientd.stream.records import JOINTS
from orientd.sun import Sun

PERIOD = 0.002
RATE = 0.5
"""Of a sun that is fast enough to be seen between two records, rad/s."""

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


class FastSun(Sun):
    """A sun that moves along the horizon."""

    def direction(self, unix_ns):
        angle = RATE * (unix_ns * 1e-9 - 1.003)
        return (math.cos(angle), math.sin(angle), 0.0)


@pytest.mark.parametrize("elevation", [10.0, 30.0])
def test_the_clearance_between_two_records_counts_the_motion_of_the_sun(monkeypatch, elevation):
    """The tool stands still; between two records the sun passes it."""
    # Its direction is interpolated along chords of a second, in whose middle it is quicker.
    monkeypatch.setattr(cone, "FASTEST_SUN", 2.0 * math.tan(0.5 * RATE))
    still = Keyframe(azimuth_elevation={"azimuth": 0.0, "elevation": elevation}).q
    request = MotionRequest([Keyframe(still, time=0.0), Keyframe(still, time=2.0)])
    motion = plan(request, start=State.at_rest(still), limits=DEFAULT_LIMITS, period=0.02)
    cones = Cones((KeepOut("sun", FastSun(0.0, 0.0), math.radians(5.0)),), 0)
    (bound,) = cones.bounds(motion)
    times = np.arange(0.0, 1.9999, motion.period / 50.0)
    q = np.broadcast_to(np.array(still), (len(times), 4))
    (clear,) = cones.clearances(q, times)
    least = np.array([clear[50 * k : 50 * k + 51].min() for k in range(99)])
    assert np.all(bound[:99] <= least)
    assert np.all(bound[:99] >= least - 2e-3)
    place = int(clear.argmin())
    assert place % 50  # between two records
