"""Cost of a cycle of the tracker, compared with a bare update of ruckig."""

import random
import time

import pytest
import ruckig
from tracking_world import NS, World, servo_limits

from orientd.floats import normalize
from orientd.servo.tracking import Target

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
