"""No target, however wild, breaks a limit or raises."""

import random
from dataclasses import replace
from math import inf, nan, pi

import pytest
from tracking_world import World, servo_limits

from orientd.floats import exp, multiply, normalize
from orientd.servo.tracking.reference import Target

BROKEN = [
    (0.0, 0.0, 0.0, 0.0),
    (nan, 0.0, 0.0, 1.0),
    (inf, 0.0, 0.0, 0.0),
    (1e200, 1e200, 0.0, 0.0),
    (1e-200, 0.0, 0.0, 0.0),
    (0.5, 0.5, 0.5, 0.6),
]
VELOCITIES = [
    (0.0, 0.0, 0.0),
    (nan, 0.0, 0.0),
    (inf, 0.0, -inf),
    (1e300, 1e300, 1e300),
    (900.0, -900.0, 3.0),
    (0.0, -30.0, 0.0),
    (1e-310, 0.0, 0.0),
]


def wild(rng, world):
    """Return any target: near, far, half a turn away, sign turned, broken; at any time."""
    here = world.guard.q
    q = rng.choice(
        [
            normalize(tuple(rng.gauss(0.0, 1.0) for _ in range(4))),
            normalize(tuple(rng.gauss(0.0, 1.0) for _ in range(4))),
            multiply(here, exp((pi, 0.0, 0.0))),
            tuple(-x for x in here),
            multiply(here, exp(tuple(rng.gauss(0.0, 1e-3) for _ in range(3)))),
            (0.0, 1.0, 0.0, 0.0),
            rng.choice(BROKEN),
        ]
    )
    omega = rng.choice(
        [
            None,
            tuple(rng.gauss(0.0, 1.5) for _ in range(3)),
            tuple(rng.gauss(0.0, 1.5) for _ in range(3)),
            rng.choice(VELOCITIES),
        ]
    )
    time_ns = world.now_ns + rng.choice(
        [
            *[0] * 6,
            -world.period_ns,
            rng.randrange(-(10**8), 10**8),
            rng.randrange(-(10**10), 10**10),
            2**62,
            -(2**62),
        ]
    )
    live_ns = rng.choice([10**6, 10**8, 10**8, 10**9, -5, 2**62])
    position = rng.choice([None, (0.1, 0.0, -0.2), rng.choice(VELOCITIES)])
    return Target(q, omega, time_ns, world.now_ns + live_ns, position)


def some_axes(rng, limit):
    return tuple(rng.choice([inf, limit * 10.0 ** rng.uniform(-1.0, 0.2)]) for _ in range(3))


def storm(events, seed):
    rng = random.Random(seed)
    while events > 0:
        acceleration = 10.0 ** rng.uniform(-0.5, 2.0)
        limits = servo_limits(
            10.0 ** rng.uniform(-1.0, 1.0), acceleration, acceleration * 10.0 ** rng.uniform(0.3, 4)
        )
        if rng.random() < 0.3:
            limits = replace(
                limits,
                axis_velocity=some_axes(rng, limits.velocity),
                axis_acceleration=some_axes(rng, limits.acceleration),
                axis_jerk=some_axes(rng, limits.jerk),
            )
        world = World(limits, rng.choice([100, 125, 500, 1000]))
        for _ in range(400):
            for _ in range(rng.choice([0, 0, 0, 0, 1, 1, 1, 2, 5])):
                world.tracker.take(wild(rng, world), world.now_ns)
                events -= 1
            world.step()
            events -= 1


def test_no_limit_breaks_in_thirty_thousand_events():
    storm(30_000, seed=1)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_no_limit_breaks_in_ten_million_events():
    storm(10_000_000, seed=2)
