"""Targets without velocity: what those before tell of it, and what they do not."""

import random
from math import cos, pi, sin

import pytest
from test_streams import LIMITS as HAND_LIMITS
from test_streams import follow
from tracking_world import NS, World, angle, servo_limits

from orientd.floats import exp, norm
from orientd.servo.tracking.reference import Target

LIMITS = servo_limits(2.5, 17.0, 8500.0)
AXIS = (0.36, -0.48, 0.8)


def turned(radians):
    return exp(tuple(radians * x for x in AXIS))


def play(world, hz, seconds, motion, *, loss=0.0, jitter=0.0, ahead=0.0, seed=1):
    """Stream *motion*, orientation and velocity over time, and yield time and setpoint."""
    rng, start = random.Random(seed), world.now_ns
    packets = [
        (k / hz - ahead + rng.uniform(0.0, jitter), k / hz) for k in range(int(hz * seconds))
    ]
    packets = sorted(packet for packet in packets if rng.random() >= loss)
    while world.now_ns < start + seconds * NS:
        while packets and start + packets[0][0] * NS <= world.now_ns:
            t = packets.pop(0)[1]
            stamp = start + round(t * NS)
            world.tracker.take(Target(*motion(t), stamp, stamp + NS // 2), world.now_ns)
        point = world.step()
        yield (world.now_ns - start) / NS, point


def steady(t):
    return turned(t), None


@pytest.mark.parametrize("network", [{}, {"loss": 0.2, "jitter": 0.05}])
@pytest.mark.parametrize("hz", [30, 60, 200])
def test_a_steady_target_without_velocity_is_followed_without_lag(hz, network):
    world = World(LIMITS)
    for t, point in play(world, hz, 2.0, steady, **network):
        if t > 0.5:
            assert angle(point.q, turned(t)) < 3e-3
            assert norm(point.omega_body) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("hz", [60, 200])
@pytest.mark.parametrize("frequency", [0.2, 1.0, 2.0])
def test_a_sine_with_velocity_is_not_overshot(hz, frequency):
    w = 2.0 * pi * frequency
    amplitude = min(2.0 / w, 8.0 / w / w)

    def motion(t):
        speed = amplitude * w * cos(w * t)
        return turned(amplitude * sin(w * t)), tuple(speed * x for x in AXIS)

    world = World(LIMITS)
    reached = [angle(point.q, turned(0.0)) for t, point in play(world, hz, 4.0, motion) if t > 1.0]
    assert amplitude * 0.97 < max(reached) < amplitude * 1.03


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_loss_among_few_targets_stamped_ahead_costs_no_acceleration(seed):
    clean, _, _ = follow(30, lookahead=0.06)
    lossy, _, _ = follow(30, lookahead=0.06, loss=0.2, jitter=0.05, seed=seed)
    assert lossy <= 1.05 * clean
    assert clean < HAND_LIMITS.acceleration / 2.0


def test_a_step_without_velocity_is_not_overshot():
    world = World(LIMITS)
    points = [p for _, p in play(world, 50, 2.0, lambda t: (turned(0.3 if t > 0.5 else 0.0), None))]
    assert max(angle(point.q, turned(0.0)) for point in points) < 0.301
    assert angle(points[-1].q, turned(0.3)) < 1e-6
