"""No motion makes an unrequested whole turn, however fast the device moves before it."""

import os

import numpy as np
import pytest

from orientd.errors import PlanError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.connect.connector import turn_to_stop
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import angle, between, exp, log

PERIOD = 0.002
CASES = int(os.environ.get("ORIENTD_CASES", "40"))
SLACK = 1.06  # times the way that stopping takes: connectors keep a reserve of their limits


def about_z(rad):
    return Keyframe((np.cos(rad / 2.0), 0.0, 0.0, np.sin(rad / 2.0)))


def moving(omega, alpha=(0.0, 0.0, 0.0)):
    still = np.zeros(3)
    return State(np.array([1.0, 0.0, 0.0, 0.0]), np.array(omega), np.array(alpha), still)


def turn_of(motion):
    """Return the integral of the angular velocity, rad, and how long the path is, rad."""
    q = motion.rows(0, motion.record_count)[:, :4]
    steps = between(q[:-1], q[1:])
    steps[steps[:, 0] < 0.0] *= -1.0
    vectors = log(steps)
    return float(np.linalg.norm(vectors.sum(0))), float(np.linalg.norm(vectors, axis=1).sum())


@pytest.mark.parametrize(
    ("speed", "acceleration", "ahead"),
    [
        (1.0, 0.5, 0.3),
        (1.5, 0.5, 2.0),
        (2.0, 1.0, 2.0),
        (2.0, 2.0, 0.1),
        (2.4, 1.0, 3.0),
        (2.0, 1.0, 0.0),
    ],
)
def test_a_device_goes_back_to_what_it_cannot_stop_at(speed, acceleration, ahead):
    limits = DEFAULT_LIMITS.with_rates({"acceleration": acceleration})
    start = moving([0.0, 0.0, speed])
    motion = plan(MotionRequest([about_z(ahead)]), start=start, limits=limits, period=PERIOD)
    turn, length = turn_of(motion)
    stop = turn_to_stop(start, limits)
    beyond = max(SLACK * stop - ahead, 0.0)
    assert turn == pytest.approx(ahead, abs=1e-6)
    assert length <= ahead + 2.0 * beyond + 1e-6


def test_a_target_where_the_device_can_just_stop_is_reached_straight_on():
    limits = DEFAULT_LIMITS.with_rates({"acceleration": 1.0})
    start = moving([0.0, 0.0, 2.0])
    motion = plan(MotionRequest([about_z(2.0)]), start=start, limits=limits, period=PERIOD)
    assert turn_of(motion)[1] <= 2.05
    assert motion.duration <= 2.4


def unit(rng):
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def drawn(rng):
    """Return a random request, the state that it takes over from, and limits."""
    limits = DEFAULT_LIMITS.with_rates(
        {
            "velocity": 10.0 ** rng.uniform(-0.3, 0.7),
            "acceleration": 10.0 ** rng.uniform(-0.3, 1.2),
            "jerk": 10.0 ** rng.uniform(0.7, 3.9),
        }
    )
    direction = unit(rng)
    speed = rng.uniform(0.2, 0.96) * limits.velocity
    # What it rises or falls to keeps the limit of the velocity.
    rise = min(limits.acceleration, np.sqrt(limits.jerk * (limits.velocity - speed)))
    alpha = rng.choice([0.0, 0.7]) * rise * direction * rng.choice([-1.0, 1.0])
    axis = direction if rng.random() < 0.5 else unit(rng)
    key = exp(rng.uniform(-np.pi, np.pi) * axis)
    omega_end = None
    if rng.random() < 0.3:
        omega_end = rng.uniform(0.1, 0.9) * limits.velocity * unit(rng)
    request = MotionRequest([Keyframe(tuple(key))], end_velocity=omega_end, velocity_frame="body")
    return request, moving(speed * direction, alpha), limits


def test_no_random_retarget_turns_more_than_the_way_and_its_stops():
    rng = np.random.default_rng(37)
    planned, worst = 0, 0.0
    for _ in range(CASES):
        request, start, limits = drawn(rng)
        try:
            motion = plan(request, start=start, limits=limits, period=PERIOD)
        except PlanError:
            continue
        planned += 1
        way = float(angle(start.q, request.keys[0]))
        stops = turn_to_stop(start, limits)
        if request.omega_end is not None:
            # It goes on until it is at rest.
            stops += 2.0 * turn_to_stop(moving(request.omega_end), limits)
        worst = max(worst, turn_of(motion)[0] - way - SLACK * stops)
    print(f"\n{planned} of {CASES} planned; turned by at most {worst:.4g} rad more")
    assert planned >= 0.9 * CASES
    assert worst <= 1e-6
