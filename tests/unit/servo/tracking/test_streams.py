"""Streams as a network delivers them: lossy, late, out of order and noisy."""

import functools
import heapq
import random
from math import cos, sin, sqrt

import pytest
from tracking_world import NS, World, angle, servo_limits

from orientd.floats import difference, exp, multiply, norm
from orientd.servo.tracking.reference import Target

LIMITS = servo_limits(4.0, 20.0, 400.0)
SECONDS, SETTLED = 6.0, 1.5
SEEDS = [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (2, 3))]


def hand_orientation(t):
    swing = exp((0.8 * sin(2.0 * t), 0.0, 0.0))
    return multiply(swing, exp((0.0, 0.56 * cos(2.6 * t), 0.3 * sin(1.4 * t))))


def hand(t):
    """Return orientation and angular velocity of something like a hand, up to 2.2 rad/s."""
    d = 1e-5
    x, y, z = difference(hand_orientation(t - d), hand_orientation(t + d))
    return hand_orientation(t), (x / (2 * d), y / (2 * d), z / (2 * d))


def steady(t):
    """Return orientation and angular velocity of a target that turns at 1 rad/s."""
    return exp((0.6 * t, 0.0, -0.8 * t)), (0.6, 0.0, -0.8)


def sent(hz, motion, *, loss, jitter, lookahead, noise, seed):
    """Return (arrival, number, time, orientation, velocity), by arrival."""
    rng, packets = random.Random(seed), []
    for k in range(round(SECONDS * hz)):
        t = k / hz
        q, omega = motion(t)
        q = multiply(q, exp(tuple(rng.gauss(0.0, noise) for _ in range(3))))
        omega = tuple(x + rng.gauss(0.0, 10.0 * noise) for x in omega)
        arrival = t - lookahead + rng.uniform(0.0, jitter)
        if rng.random() >= loss:
            packets.append((arrival, k, t, q, omega))
    heapq.heapify(packets)
    return packets


@functools.cache
def follow(hz, motion=hand, *, loss=0.0, jitter=0.0, lookahead=0.0, noise=0.0, seed=1):
    """Return peak acceleration, peak jerk and root mean square of the lag, once settled."""
    packets = sent(
        hz, motion, loss=loss, jitter=jitter, lookahead=lookahead, noise=noise, seed=seed
    )
    world = World(LIMITS)
    start_ns, last = world.now_ns, (0.0, 0.0, 0.0)
    acceleration = jerk = 0.0
    lags = []
    while world.now_ns < start_ns + SECONDS * NS:
        while packets and packets[0][0] * NS <= world.now_ns - start_ns:
            _, _, t, q, omega = heapq.heappop(packets)
            time_ns = start_ns + round(t * NS)
            world.tracker.take(Target(q, omega, time_ns, time_ns + NS // 3), world.now_ns)
        alpha = world.step().alpha_body
        t = (world.now_ns - start_ns) / NS
        if t > SETTLED:
            acceleration = max(acceleration, norm(alpha))
            change = tuple((a - b) / world.period for a, b in zip(alpha, last, strict=True))
            jerk = max(jerk, norm(change))
            lags.append(angle(world.guard.q, motion(t)[0]))
        last = alpha
    return acceleration, jerk, sqrt(sum(x * x for x in lags) / len(lags))


@pytest.mark.parametrize("hz", [30, 100])
def test_loss_and_jitter_do_not_show_while_the_target_is_steady(hz):
    acceleration, _, lag = follow(hz, steady, loss=0.2, jitter=0.05)
    assert acceleration < 1e-5
    assert lag < 1e-8


@pytest.mark.parametrize("hz", [60, 100])
@pytest.mark.parametrize("seed", SEEDS)
def test_loss_and_jitter_cost_no_acceleration_when_targets_are_stamped_ahead(hz, seed):
    clean, _, _ = follow(hz, lookahead=0.1)
    lossy, _, lag = follow(hz, lookahead=0.1, loss=0.2, jitter=0.05, seed=seed)
    assert lossy <= 1.01 * clean
    assert lag < 1e-3


@pytest.mark.parametrize("hz", [30, 60, 100, 200])
@pytest.mark.parametrize("seed", SEEDS)
def test_loss_and_jitter_cost_no_acceleration_when_they_are_not(hz, seed):
    clean, _, _ = follow(hz)
    lossy, _, lag = follow(hz, loss=0.2, jitter=0.05, seed=seed)
    assert lossy <= 1.001 * clean
    assert lag < (0.1 if hz == 30 else 0.009)


@pytest.mark.parametrize("hz", [60, 100])
def test_loss_and_jitter_do_not_make_the_device_jerk(hz):
    _, clean, _ = follow(hz)
    _, lossy, _ = follow(hz, loss=0.2, jitter=0.05)
    assert lossy <= 5.0 * clean


def test_a_hand_is_followed_within_a_milliradian():
    _, jerk, lag = follow(60)
    assert lag < 1e-3
    assert jerk < 100.0


def test_a_trembling_hand_does_not_make_the_device_tremble():
    clean, _, _ = follow(60)
    acceleration, _, lag = follow(60, noise=1e-3)
    assert acceleration < 2.0 * clean
    assert lag < 2e-3
