"""Tracked targets and chunks never lead into a keep-out cone; the guard checks every setpoint."""

import random
from dataclasses import replace
from math import cos, degrees, inf, pi, radians, sin

import numpy as np
import pytest
from chunk_world import ChunkWorld
from tracking_world import NS, angle, servo_limits

from orientd import rotation
from orientd.driver import ZERO
from orientd.floats import exp, multiply, normalize, rotate, rotate_back
from orientd.keep_out import KeepOut
from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.tracking.detour import Detour

LIMITS = [
    servo_limits(2.5, 17.0, 8500.0),
    servo_limits(2.0, 10.0, 100.0),
    servo_limits(1.0, 4.0, 40.0),
    servo_limits(2.5, 3.0, 30.0),
    servo_limits(10.0, 200.0, 3e4),
]
X = (1.0, 0.0, 0.0)


def unit(rng, count=3):
    v = np.array([rng.gauss(0.0, 1.0) for _ in range(count)])
    return tuple((v / np.linalg.norm(v)).tolist())


def clearances(cones, q):
    """Return the angles to the edges at every phase between setpoints, shape (n, cones)."""
    q = np.asarray(q)
    steps = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:]))
    q = np.vstack([rotation.multiply(q[:-1], rotation.exp(u * steps)) for u in (0.0, 0.3, 0.7)])
    pointing = rotation.to_matrix(q)[:, :, 0]
    cosines = np.clip(pointing @ np.array([one.direction for one in cones]).T, -1.0, 1.0)
    return np.arccos(cosines) - [one.half_angle for one in cones]


def scene(seed):
    """Return a world of 1 to 4 random cones in which the tool is outside of all."""
    rng = random.Random(seed)
    count = rng.randint(1, 4)
    cones = [KeepOut(f"{k}", unit(rng), radians(rng.uniform(3.0, 40.0))) for k in range(count)]
    q = unit(rng, 4)
    while min(one.clearance(q, 0) for one in cones) < 0.02:
        q = unit(rng, 4)
    limits = LIMITS[seed % len(LIMITS)]
    return ChunkWorld(limits, rng.choice([125, 500]), q, tuple(cones)), rng


def into(cone, q, rng):
    """Return *q* turned so that the tool points into a cone."""
    inside = np.array(cone.direction) + 0.5 * sin(cone.half_angle) * np.array(unit(rng))
    pointing = np.array(rotate(q, X))
    axis = np.cross(pointing, inside)
    turn = np.arctan2(np.linalg.norm(axis), pointing @ inside) * axis / np.linalg.norm(axis)
    return normalize(multiply(exp(tuple(turn.tolist())), q))


def orders(world, rng):
    """Targets at rest anywhere, a third of them in a cone."""
    target = unit(rng, 4)

    def send(t):
        nonlocal target
        if rng.random() < 0.05:
            target = unit(rng, 4)
            if rng.random() < 0.35:
                target = into(rng.choice(world.cones.cones), target, rng)
        world.take(target, rng.choice([ZERO, None]), live=0.3)

    return send


def turning(world, rng):
    """A target that turns at a constant rate, through cones or not."""
    begin = into(rng.choice(world.cones.cones), world.guard.q, rng)
    omega = tuple(rng.uniform(0.2, 0.6) * world.limits.velocity * x for x in unit(rng))

    def send(t):
        q = normalize(multiply(exp(tuple(t * x for x in omega)), begin))
        world.take(q, rotate_back(q, omega), live=0.3)

    return send


def hand(world, rng):
    """A hand that wanders across cones, without velocities."""
    begin = into(rng.choice(world.cones.cones), world.guard.q, rng)

    def send(t):
        away = tuple(0.9 * sin(2.0 * t + k) * (1.0 + 0.5 * sin(t)) for k in range(3))
        world.take(normalize(multiply(exp(away), begin)), None, live=0.3)

    return send


def chunks(world, rng):
    """Chunks of poses, at 20 Hz."""
    begin = into(rng.choice(world.cones.cones), world.guard.q, rng)

    def where(t):
        away = tuple(0.9 * cos(1.5 * t + k) for k in range(3))
        return normalize(multiply(exp(away), begin))

    def send(t):
        if round(20.0 * t) % 8 == 0:
            world.chunk(world.poses(world.now_ns + NS // 20, 16, 20, where))

    return send


@pytest.mark.parametrize("first", range(0, 25, 5))
@pytest.mark.parametrize("stream", [orders, turning, hand, chunks])
def test_a_hundred_tracked_targets_never_lead_into_a_cone(stream, first):
    for seed in range(first, first + 5):
        world, rng = scene(seed)
        send, q = stream(world, rng), [world.guard.q]
        for step in range(40):
            send(step / 20.0)
            q += [point.q for point in world.run(0.05)]
        world.tracker.cease()
        while not world.tracker.is_at_rest:
            q.append(world.step().q)
        assert degrees(clearances(world.cones.cones, q).min()) > -0.01, seed


@pytest.mark.parametrize("seed", range(6))
def test_a_stop_at_any_time_ends_outside(seed):
    world, rng = scene(100 + seed)
    send = orders(world, rng)
    for step in range(40):
        send(step / 20.0)
        q = [point.q for point in world.run(0.05)]
        if rng.random() < 0.3:
            world.tracker.cease()
            while not world.tracker.is_at_rest:
                q.append(world.step().q)
        assert degrees(clearances(world.cones.cones, q).min()) > -0.01


def pointing_at(azimuth, elevation=0.0):
    """Return the orientation whose x axis is at these angles, in degrees."""
    return multiply(exp((0.0, 0.0, radians(azimuth))), exp((0.0, -radians(elevation), 0.0)))


def world_with(*cones, limits=LIMITS[0], q=(1.0, 0.0, 0.0, 0.0)):
    return ChunkWorld(limits, 500, q, cones)


def follow(world, target, seconds):
    q = []
    for _ in range(round(20 * seconds)):
        world.take(target, ZERO, live=0.3)
        q += [point.q for point in world.run(0.05)]
    return q


def test_a_target_inside_is_held_at_the_nearest_point_of_the_edge_and_the_cone_is_reported():
    laser = KeepOut("laser", rotate(pointing_at(60.0), X), radians(20.0))
    other = KeepOut("other", rotate(pointing_at(-90.0), X), radians(20.0))
    world = world_with(other, laser)
    follow(world, pointing_at(55.0, 6.0), 3.0)
    assert world.tracker.held == 1
    clearance = degrees(laser.clearance(world.guard.q, 0))
    assert 0.0 <= clearance < 0.15
    # The nearest point of the edge is 12 degrees away.
    assert degrees(angle(world.guard.q, pointing_at(55.0, 6.0))) == pytest.approx(12.2, abs=0.3)
    follow(world, pointing_at(30.0), 2.0)
    assert world.tracker.held == -1
    assert angle(world.guard.q, pointing_at(30.0)) < 1e-6


def test_a_target_behind_a_cone_is_reached_around_it():
    laser = KeepOut("laser", rotate(pointing_at(45.0, 3.0), X), radians(20.0))
    world = world_with(laser)
    q = follow(world, pointing_at(90.0), 1.6)
    assert angle(world.guard.q, pointing_at(90.0)) < 1e-6
    found = degrees(clearances([laser], q).min())
    assert -0.01 < found < 0.5


def test_a_target_behind_overlapping_cones_is_reached_around_both():
    cones = [
        KeepOut("low", rotate(pointing_at(45.0, -12.0), X), radians(20.0)),
        KeepOut("high", rotate(pointing_at(45.0, 12.0), X), radians(15.0)),
    ]
    world = world_with(*cones)
    q = follow(world, pointing_at(90.0), 3.0)
    assert angle(world.guard.q, pointing_at(90.0)) < 1e-6
    assert degrees(clearances(cones, q).min()) > -0.01


def test_a_target_that_cones_enclose_is_not_approached_through_them():
    cones = [
        KeepOut(f"{k}", rotate(pointing_at(90.0 + 40.0 * cos(a), 40.0 * sin(a)), X), radians(35.0))
        for k, a in enumerate((0.0, 2.0 * pi / 3.0, 4.0 * pi / 3.0))
    ]
    world = world_with(*cones, q=pointing_at(-90.0))
    q = follow(world, pointing_at(90.0), 4.0)
    assert world.tracker.held >= 0
    assert degrees(clearances(cones, q).min()) > -0.01


def test_a_tool_inside_only_moves_outwards():
    laser = KeepOut("laser", X, radians(20.0))
    world = world_with(laser, q=pointing_at(8.0, 3.0))
    q = follow(world, pointing_at(-60.0), 3.0)
    assert angle(world.guard.q, pointing_at(-60.0)) < 1e-6
    found = np.array([laser.clearance(one, 0) for one in q])
    inside = found[: int(np.argmax(found > 0.0)) + 1]
    assert np.diff(inside).min() > -1e-9


@pytest.mark.parametrize("seed", [28, 33, 36, 37, 56])
def test_a_tool_inside_never_comes_nearer_whatever_its_targets(seed):
    """With limits of components a stop is not straight; the guard refuses a step inwards."""
    rng = random.Random(seed)
    laser = KeepOut("laser", X, radians(60.0))
    limits = replace(
        servo_limits(10.0 ** rng.uniform(-0.5, 0.5), 24.0, 300.0),
        axis_velocity=(inf, 10.0 ** rng.uniform(-1.5, 0.0), 10.0 ** rng.uniform(-1.5, 0.0)),
        axis_acceleration=(inf, 30.0, 10.0 ** rng.uniform(0.3, 1.5)),
    )
    world = world_with(laser, limits=limits, q=pointing_at(20.0, 3.0))
    for _ in range(60):
        turn = tuple(rng.gauss(0.0, 10.0 ** rng.uniform(-3.0, 0.4)) for _ in range(3))
        rate = tuple(rng.gauss(0.0, 1.0) for _ in range(3)) if rng.random() < 0.5 else None
        world.take(multiply(world.guard.q, exp(turn)), rate)
        world.run(rng.choice([0.006, 0.02, 0.06]))


def test_a_cone_of_another_axis_of_the_tool_counts_too():
    mast = KeepOut("mast", (0.0, 0.0, 1.0), radians(15.0), axis=(0.0, 0.0, 1.0))
    world = world_with(mast, q=exp((0.5, 0.0, 0.0)))
    for point in follow(world, exp((-0.5, 0.0, 0.0)), 3.0):
        assert degrees(mast.clearance(point, 0)) > -0.01
    assert angle(world.guard.q, exp((-0.5, 0.0, 0.0))) < 1e-6


def test_far_from_cones_nothing_changes():
    far = KeepOut("far", rotate(pointing_at(180.0), X), radians(10.0))
    with_cone, without = world_with(far), ChunkWorld(LIMITS[0], 500)
    q = follow(with_cone, pointing_at(40.0, 10.0), 2.0)
    assert q == follow(without, pointing_at(40.0, 10.0), 2.0)


def test_each_axis_of_the_tool_keeps_to_its_own_side_of_its_cones():
    def detour():
        cones = [
            KeepOut("of x", (cos(0.7), sin(0.7), 0.0), 0.2),
            KeepOut("of z", (0.0, -sin(0.7), cos(0.7)), 0.2, axis=(0.0, 0.0, 1.0)),
        ]
        return Detour(KeepOutCones(cones, 0.02, lambda: 0), 0.02)

    def turn(detour, about, aside):
        target = multiply(exp(tuple(1.4 * x for x in about)), exp((0.0, aside, 0.0)))
        return detour.turn((1.0, 0.0, 0.0, 0.0), target, 1e-3)

    x, z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    both = detour()
    first = turn(both, z, 0.02)
    # The axis z passes its cone on its own shorter side, whichever side the axis x is on.
    assert turn(both, x, 0.05) == turn(detour(), x, 0.05)
    again = turn(both, z, -0.02)
    assert first[1] * again[1] > 0.0 > first[1] * turn(detour(), z, -0.02)[1]
