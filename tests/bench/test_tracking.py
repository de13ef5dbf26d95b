"""Cost of a cycle of the tracker, compared with a bare update of ruckig, and near cones."""

import math
import random
import time

import pytest
import ruckig
from tracking_world import NS, World, servo_limits

from orientd.floats import exp, multiply, normalize
from orientd.keep_out import KeepOut
from orientd.servo.tracking.reference import Target

pytestmark = pytest.mark.bench

CYCLES = 3000


def p99(costs):
    return sorted(costs)[len(costs) * 99 // 100]


def tracker_costs(rng, gap):
    world = World(servo_limits(2.0, 10.0, 100.0))
    costs = []
    for k in range(CYCLES):
        if k % gap == 0:
            q = normalize(tuple(rng.gauss(0.0, 1.0) for _ in range(4)))
            omega = tuple(rng.gauss(0.0, 0.5) for _ in range(3))
            world.tracker.take(Target(q, omega, world.now_ns, world.now_ns + NS), world.now_ns)
        world.now_ns += world.period_ns
        began = time.perf_counter_ns()
        world.tracker.step(world.now_ns)
        costs.append(time.perf_counter_ns() - began)
    return costs


def ruckig_costs(rng, gap):
    generator, given = ruckig.Ruckig(3, 0.002), ruckig.InputParameter(3)
    found = ruckig.OutputParameter(3)
    given.max_velocity, given.max_acceleration, given.max_jerk = [1.2] * 3, [5.8] * 3, [58.0] * 3
    costs = []
    for k in range(CYCLES):
        moved = [x + 1e-5 for x in given.target_position]  # a target moves in every cycle
        given.target_position = [rng.gauss(0.0, 1.0) for _ in range(3)] if k % gap == 0 else moved
        began = time.perf_counter_ns()
        generator.update(given, found)
        found.pass_to_input(given)
        costs.append(time.perf_counter_ns() - began)
    return costs


@pytest.mark.parametrize("gap", [5, 100])
def test_a_cycle_costs_a_few_updates_of_ruckig(gap):
    rng = random.Random(1)
    slots = [(p99(tracker_costs(rng, gap)), p99(ruckig_costs(rng, gap))) for _ in range(6)]
    ours, peer = (sorted(costs)[len(slots) // 2] / 1e3 for costs in zip(*slots, strict=True))
    print(f"\ntracker p99 {ours:.1f} us, ruckig p99 {peer:.1f} us, ratio {ours / peer:.1f}")
    assert ours <= 12.0 * peer


def cone(name, azimuth, elevation, half_angle):
    a, e = math.radians(azimuth), math.radians(elevation)
    direction = (math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e))
    return KeepOut(name, direction, math.radians(half_angle))


FOUR = (cone("a", 25, 5, 10), cone("b", -30, -8, 12), cone("c", 40, -15, 8), cone("d", -10, 20, 9))


def costs_near(cones):
    """The processor's time for every cycle towards a target that runs to and fro among cones."""
    world, costs = World(servo_limits(2.5, 17.0, 8500.0), cones=cones), []
    for k in range(CYCLES):
        if k % 20 == 0:
            azimuth = math.radians(60.0) * math.sin(4e-3 * k)
            elevation = math.radians(20.0) * math.sin(6.2e-3 * k)
            q = multiply(exp((0.0, 0.0, azimuth)), exp((0.0, -elevation, 0.0)))
            world.tracker.take(Target(q, None, world.now_ns, world.now_ns + NS), world.now_ns)
        world.now_ns += world.period_ns
        began = time.thread_time_ns()
        world.tracker.step(world.now_ns)
        costs.append(time.thread_time_ns() - began)
    return costs


def test_four_cones_nearby_cost_less_than_three_times_a_cycle_without_any():
    runs = [(sum(costs_near(FOUR)), sum(costs_near(()))) for _ in range(5)]
    near, free = (sorted(costs)[2] / CYCLES / 1e3 for costs in zip(*runs, strict=True))
    print(f"\nnear four cones {near:.1f} us, without {free:.1f} us, ratio {near / free:.2f}")
    assert near <= 3.0 * free
