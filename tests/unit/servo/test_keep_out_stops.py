"""Stops off the path that nobody asked for, anywhere on certified motions, end outside of cones."""

from math import degrees, radians

import numpy as np
import pytest

from orientd.floats import difference, plus, rotate
from orientd.keep_out import KeepOut
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import from_axis_angle, multiply, normalize
from orientd.servo.keep_out_cones import MOST_DRIFT, KeepOutCones
from orientd.servo.tracking.tracker import Tracker
from orientd.stream.records import ServoLimits

PERIOD = 0.002
STOPS = 170
NEAR = radians(25.0)
LIMITS = [{}, {"jerk": 800.0}, {"velocity": 8.0, "acceleration": 60.0, "jerk": 3000.0}]


def unit(vector):
    return vector / np.linalg.norm(vector)


def motion_around(number):
    """Return a motion past one to three cones on its way, and its limits."""
    random = np.random.default_rng(number)
    axis = unit(random.normal(size=3))
    first = normalize(random.normal(size=4))
    last = multiply(from_axis_angle(axis, random.uniform(1.0, 2.5)), first)
    cones = []
    for k in range(random.integers(1, 4)):
        middle = multiply(from_axis_angle(axis, random.uniform(0.3, 1.0)), first)
        points = np.array(rotate(tuple(middle.tolist()), (1.0, 0.0, 0.0)))
        direction = unit(points + random.normal(scale=0.2, size=3))
        ends = [np.array(rotate(tuple(q.tolist()), (1.0, 0.0, 0.0))) for q in (first, last)]
        room = min(float(np.arccos(np.clip(end @ direction, -1.0, 1.0))) for end in ends)
        half_angle = min(random.uniform(0.1, 0.5), room - 0.02)
        if half_angle > 0.02:
            cones.append(KeepOut(f"c{k}", tuple(direction.tolist()), half_angle))
    limits = DEFAULT_LIMITS.with_rates(LIMITS[number % len(LIMITS)])
    request = MotionRequest([Keyframe(tuple(last.tolist()))], keep_out=cones)
    return plan(request, start=State.at_rest(first), limits=limits, period=PERIOD), limits, cones


def deepest(cones, tracker, drift):
    """Return how far inside a stop comes; the cones turn towards the tool meanwhile."""
    least = np.inf
    while not tracker.is_at_rest:
        q = tracker.step(0).q
        least = min(least, *cones.clearances(q))
        pointing = rotate(q, (1.0, 0.0, 0.0))
        for k, one in enumerate(cones.directions):
            moved = plus(one, pointing, drift * PERIOD)
            cones.directions[k] = tuple(unit(np.array(moved)).tolist())
    return -least


@pytest.mark.parametrize("drift", [0.0, MOST_DRIFT], ids=["fixed", "moving"])
@pytest.mark.parametrize(
    "number", [*range(3), *(pytest.param(k, marks=pytest.mark.slow) for k in range(3, 6))]
)
def test_a_stop_off_a_certified_path_ends_outside(number, drift):
    motion, limits, keep_out = motion_around(number)
    random = np.random.default_rng(number)
    numbers = limits.velocity, limits.acceleration, limits.jerk
    servo_limits = ServoLimits(*numbers, 1.0, 10.0, motion.certificate.brake_rate)
    rows = motion.rows(0, motion.record_count)[:, :4].tolist()
    states = random.integers(2, len(rows), 3 * STOPS).tolist()
    inside, tried = [], 0
    for k in states:
        cones = KeepOutCones(keep_out, PERIOD)
        q = tuple(rows[k])
        if tried == STOPS or min(cones.clearances(q)) > NEAR:
            continue
        tried += 1
        before, omega = (
            plus((0.0, 0.0, 0.0), difference(tuple(a), tuple(b)), 1.0 / PERIOD)
            for a, b in ((rows[k - 2], rows[k - 1]), (rows[k - 1], q))
        )
        alpha = plus(plus((0.0, 0.0, 0.0), omega, 1.0 / PERIOD), before, -1.0 / PERIOD)
        tracker = Tracker(PERIOD, cones)
        tracker.begin(q, omega, alpha, servo_limits)
        inside.append(deepest(cones, tracker, drift))
    print(f"{len(inside)} stops, deepest {degrees(max(inside)):.4f} deg")
    assert len(inside) >= STOPS // 2
    assert degrees(max(inside)) <= 0.01
