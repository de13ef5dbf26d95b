"""Promises of a tracker about its targets; the guard checks every setpoint."""

import random
from dataclasses import replace
from math import cos, inf, pi, sin

import pytest
import ruckig
from tracking_world import NS, World, angle, quickest_stop, servo_limits

from orientd.driver import ZERO
from orientd.floats import exp, multiply, norm, normalize
from orientd.servo.tracking.reference import Target
from orientd.servo.tracking.tracker import Tracker

LIMITS = [
    servo_limits(2.5, 17.0, 8500.0),
    servo_limits(2.0, 10.0, 100.0),
    servo_limits(1.0, 4.0, 40.0),
]
AXIS = (0.36, -0.48, 0.8)


def turned(radians, axis=AXIS):
    return exp((radians * axis[0], radians * axis[1], radians * axis[2]))


def least_time(limits, *, distance=0.0, velocity=0.0):
    """Return what ruckig takes about one axis: to a distance, or from a velocity to rest."""
    given, found = ruckig.InputParameter(1), ruckig.Trajectory(1)
    if velocity:
        given.control_interface = ruckig.ControlInterface.Velocity
        given.current_velocity = [velocity]
    given.target_position = [distance]
    given.max_velocity = [limits.velocity]
    given.max_acceleration, given.max_jerk = [limits.acceleration], [limits.jerk]
    ruckig.Ruckig(1).calculate(given, found)
    return found.duration


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("hz", [20, 100, 500])
def test_a_steady_target_with_velocity_is_followed_without_lag(hz, limits):
    world = World(limits)
    start, due = world.now, world.now
    for _ in range(1500):
        if world.now >= due - 1e-9:
            assert world.take(turned(0.9 * (world.now - start)), tuple(0.9 * x for x in AXIS)) == ""
            due += 1.0 / hz
        point = world.step()
    assert angle(point.q, turned(0.9 * (world.now - start))) < 1e-9


@pytest.mark.parametrize("rate_hz", [125, 500, 1000])
@pytest.mark.parametrize("limits", LIMITS)
def test_a_quarter_turn_takes_no_more_than_five_percent_over_the_least_time(limits, rate_hz):
    world = World(limits, rate_hz)
    goal = turned(pi / 2)
    world.take(goal, live=10.0)
    least = least_time(limits, distance=pi / 2)
    world.run(1.05 * least)
    assert angle(world.guard.q, goal) < (1e-3 if rate_hz == 125 else 1e-4)
    world.run(1.0)
    assert angle(world.guard.q, goal) < 1e-9
    assert world.tracker.step(world.now_ns + world.period_ns).omega_body == pytest.approx(
        ZERO, abs=1e-9
    )


@pytest.mark.parametrize("limits", LIMITS)
def test_a_quarter_turn_overshoots_by_less_than_a_milliradian(limits):
    world = World(limits)
    world.take(turned(pi / 2), live=10.0)
    assert max(angle(point.q, turned(0.0)) for point in world.run(3.0)) < pi / 2 + 1e-3


@pytest.mark.parametrize("limits", LIMITS)
def test_it_comes_to_rest_in_the_least_time_when_targets_cease(limits):
    world = World(limits)
    speed = 0.8 * limits.velocity
    start = world.now
    while world.now < start + 1.5:
        world.take(turned(speed * (world.now - start)), tuple(speed * x for x in AXIS), live=0.05)
        world.step()
    world.run(0.05)
    began = world.now
    backwards = 0.0
    while not world.tracker.is_at_rest:
        point = world.step()
        backwards = min(backwards, sum(a * b for a, b in zip(AXIS, point.omega_body, strict=True)))
    assert world.now - began <= least_time(limits, velocity=speed) + 4 * world.period
    assert backwards > -1e-9


@pytest.mark.parametrize(
    ("omega", "alpha"),
    [((1.5, 0.0, 0.0), ZERO), ((0.5, 1.0, 0.0), (0.0, 5.0, -3.0)), (ZERO, (0.0, 0.0, 9.0))],
)
def test_the_quickest_stop_ends_at_rest_inside_the_limits(omega, alpha):
    limits, period = LIMITS[1], 0.002
    world = World(limits)
    world.guard.omega, world.guard.alpha = omega, alpha
    last = world.guard.q
    for q in quickest_stop(last, omega, alpha, limits, period):
        assert world.guard.admit(q, ZERO, limits) == ""
    assert norm(world.guard.omega) < 1e-9
    assert norm(world.guard.alpha) < 1e-6


def test_it_begins_in_full_motion_where_the_last_command_left_off():
    world = World(LIMITS[1])
    world.take(turned(3.0), live=5.0)
    world.run(0.5)
    guard = world.guard
    world.tracker = Tracker(world.period)
    world.tracker.begin(guard.q, guard.omega, guard.alpha, LIMITS[1])
    world.take(turned(-1.0), live=5.0)
    world.run(3.0)
    assert angle(guard.q, turned(-1.0)) < 1e-6


def test_it_begins_faster_than_it_may_be_and_slows_down_with_the_jerk_allowed():
    fast, slow = servo_limits(2.0, 10.0, 100.0), servo_limits(0.5, 3.0, 100.0)
    world = World(fast)
    world.take(turned(3.0), live=5.0)
    world.run(0.15)
    world.tracker.begin(world.guard.q, world.guard.omega, world.guard.alpha, slow)
    world.take(turned(3.0), live=9.0)
    world.run(1.0)
    world.limits = slow
    world.run(6.0)
    assert angle(world.guard.q, turned(3.0)) < 1e-6


def test_a_sign_of_the_quaternion_changes_nothing():
    one, other = World(LIMITS[0]), World(LIMITS[0])
    for k in range(300):
        q = turned(0.004 * k)
        one.take(q, None)
        other.take(q if k % 2 else tuple(-x for x in q), None)
        assert one.step() == other.step()


def test_a_target_half_a_turn_away_that_trembles_is_reached():
    world = World(LIMITS[0])
    for k in range(1500):
        q = multiply(turned(pi), turned(1e-3 * (-1) ** k, (0.8, 0.6, 0.0)))
        world.take(multiply(q, turned(1e-3 * (-1) ** k)), None)
        world.step()
    assert angle(world.guard.q, turned(pi)) < 0.01


@pytest.mark.parametrize("hz", [60])
def test_targets_stamped_ahead_are_met_at_their_time(hz):
    world = World(LIMITS[0])
    start, due, worst = world.now, world.now, 0.0

    def where(t):
        return turned(0.8 * sin(2.0 * t)), tuple(1.6 * cos(2.0 * t) * x for x in AXIS)

    while world.now < start + 4.0:
        if world.now >= due - 1e-9:
            ahead = world.now + 0.1
            world.take(*where(ahead - start), world.now_ns + NS // 10, live=0.5)
            due += 1.0 / hz
        point = world.step()
        if world.now > start + 1.5:
            worst = max(worst, angle(point.q, where(world.now - start)[0]))
    assert worst < 1e-3


@pytest.mark.parametrize(
    ("target", "word"),
    [
        (Target((0.0, 0.0, 0.0, 0.0), None, NS, 2 * NS), "unit"),
        (Target((float("nan"), 0.0, 0.0, 1.0), None, NS, 2 * NS), "unit"),
        (Target((0.5, 0.5, 0.5, 0.51), None, NS, 2 * NS), "unit"),
        (Target((1.0, 0.0, 0.0, 0.0), (float("inf"), 0.0, 0.0), NS, 2 * NS), "angular velocity"),
        (Target((1.0, 0.0, 0.0, 0.0), None, 12 * NS, 13 * NS), "ahead"),
        (Target((1.0, 0.0, 0.0, 0.0), None, NS // 2, NS), "expired"),
    ],
)
def test_a_target_that_makes_no_sense_is_refused_and_says_why(target, word):
    world = World(LIMITS[0])
    assert word in world.tracker.take(target, world.now_ns)
    assert world.step().q == (1.0, 0.0, 0.0, 0.0)


def test_of_two_targets_of_one_instant_the_later_one_counts():
    world = World(LIMITS[0])
    assert world.take(turned(0.1), live=1.0) == ""
    assert world.take(turned(0.2), live=1.0) == ""
    world.run(1.0)
    assert angle(world.guard.q, turned(0.2)) < 1e-6


def test_a_target_older_than_what_was_followed_is_refused():
    world = World(LIMITS[0])
    assert world.take(turned(0.1)) == ""
    world.run(0.02)
    assert "not newer" in world.take(turned(0.2), time_ns=world.now_ns - NS // 50 - 1)


def late_world():
    """A world in which the motion is read some 0.1 s ago, and the number of the newest target."""
    world = World(LIMITS[0])
    for k in range(12):
        world.take(turned(0.05 * k), tuple(0.5 * x for x in AXIS), live=1.0)
        world.run(0.1)
    return world


def test_a_target_that_comes_behind_a_newer_one_is_put_in_its_place():
    # The same targets, the last but one of which comes in time in one world and late in the other.
    paths = []
    for is_late in (False, True):
        world = late_world()
        begin = world.now_ns
        times = [begin + NS * k // 50 for k in (1, 2, 3)]
        order = (0, 2, 1) if is_late else (0, 1, 2)
        spins = [tuple(s * x for x in AXIS) for s in (0.5, 1.5, 0.5)]
        angles = [0.61, 0.63, 0.65]
        world.run(0.06)
        for k in order:
            assert world.take(turned(angles[k]), spins[k], times[k], live=1.0) == ""
        paths.append([point.q for point in world.run(0.3)])
    assert paths[0] == paths[1]


@pytest.mark.parametrize("age", [0.5, 0.05])
def test_a_target_late_by_more_than_the_motion_is_read_is_refused(age):
    world = late_world()
    stamp = world.now_ns - round(age * NS)
    answer = world.take(turned(0.5), tuple(0.5 * x for x in AXIS), stamp, live=1.0)
    assert ("nor to be sorted in" in answer) is (age == 0.5)


@pytest.mark.parametrize(
    ("place", "radians", "left"),
    [(38.5, 0.6, 0.6), (24.5, 0.6, 0.6), (38.5, 0.7, 0.7), (20.5, 0.7, 0.7), (20.5, 0.6, 0.6)],
)
def test_a_late_target_that_says_otherwise_replaces_what_comes_after_it(place, radians, left):
    world = late_world()
    for k in range(1, 40):
        world.take(turned(0.6), ZERO, world.now_ns + k * NS // 100, live=1.0)
    stamp = world.now_ns + round(place * NS / 100)
    assert world.take(turned(radians), ZERO, stamp, live=1.0) == ""
    world.run(1.0)
    assert angle(world.guard.q, turned(left)) < 1e-6


def test_a_stream_without_disturbance_is_followed_at_once_when_it_turns_quickly():
    # It drifts, then accelerates by a third of what is allowed.
    world, start, gap = World(LIMITS[0]), 2.0, 0.0
    begin = world.now
    for k in range(1500):
        t = world.now - begin
        d = min(max(t - start, 0.0), 0.3)
        rest = max(t - start - 0.3, 0.0)
        goal, speed = 0.1 * t + 3.0 * d * d + 1.8 * rest, 0.1 + 6.0 * d
        if k % 5 == 0:
            world.take(turned(goal), tuple(speed * x for x in AXIS))
        if t > 1.5:
            gap = max(gap, angle(world.guard.q, turned(goal)))
        world.step()
    assert gap < 0.02


def one_axis_time(velocity, rate, limits):
    """Return the least time to rest about one axis, by ruckig."""
    given, found = ruckig.InputParameter(1), ruckig.Trajectory(1)
    given.control_interface = ruckig.ControlInterface.Velocity
    given.current_velocity, given.current_acceleration = [velocity], [rate]
    given.max_acceleration, given.max_jerk = [limits.acceleration], [limits.jerk]
    ruckig.Ruckig(1).calculate(given, found)
    return found.duration


def test_the_quickest_stop_takes_little_over_the_least_time_of_any_axis():
    # A stop is no quicker than that of its motion about any one axis; this bound needs no optimum.
    rng, limits, period, excess = random.Random(1), LIMITS[1], 0.002, []
    for _ in range(40):
        omega = tuple(rng.uniform(-1.0, 1.0) for _ in range(3))
        alpha = tuple(rng.uniform(-3.0, 3.0) for _ in range(3))
        # Between samples the velocity is that of half a cycle before.
        there = tuple(w - 0.5 * period * a for w, a in zip(omega, alpha, strict=True))
        least = 0.0
        for _ in range(200):
            axis = normalize((0.0, *(rng.gauss(0.0, 1.0) for _ in range(3))))[1:]
            v = sum(a * b for a, b in zip(axis, there, strict=True))
            a = sum(a * b for a, b in zip(axis, alpha, strict=True))
            least = max(least, one_axis_time(v, a, limits))
        cycles = sum(1 for _ in quickest_stop((1.0, 0.0, 0.0, 0.0), omega, alpha, limits, period))
        excess.append((cycles - 2) * period / least)
    assert sorted(excess)[len(excess) // 2] < 1.03
    assert max(excess) < 1.08


def test_limits_of_components_are_kept_and_the_free_axis_is_not_slowed():
    limits = replace(LIMITS[1], axis_velocity=(inf, inf, 0.5), axis_jerk=(inf, 50.0, 50.0))
    world = World(limits)
    world.take(turned(pi / 2), live=10.0)
    world.run(6.0)
    assert angle(world.guard.q, turned(pi / 2)) < 1e-6
    goal = multiply(world.guard.q, turned(pi / 2, (1.0, 0.0, 0.0)))
    world.take(goal, live=10.0)
    world.run(1.05 * least_time(limits, distance=pi / 2))
    assert angle(world.guard.q, goal) < 1e-3


def test_it_is_not_at_rest_while_a_target_waits_for_its_time():
    world = World(LIMITS[0])
    world.take(turned(0.5), None, world.now_ns + NS // 2, live=1.0)
    world.run(0.1)
    assert not world.tracker.is_at_rest
    world.run(2.0)
    assert world.tracker.is_at_rest
    assert angle(world.guard.q, turned(0.5)) < 1e-4


def test_a_target_faster_than_the_limits_is_chased_at_the_limit():
    world = World(LIMITS[1])
    start = world.now
    for _ in range(1000):
        t = world.now - start
        world.take(turned(3.0 * t), tuple(3.0 * x for x in AXIS))
        point = world.step()
    assert norm(point.omega_body) == pytest.approx(2.0, rel=0.02)


@pytest.mark.parametrize("ceases", [True, False])
def test_it_begins_anywhere_inside_the_limits_of_components(ceases):
    rng = random.Random(4)
    for _ in range(60):
        limits = replace(
            servo_limits(3.6, 18.0, 360.0),
            axis_velocity=tuple(rng.uniform(0.4, 2.0) for _ in range(3)),
            axis_acceleration=tuple(rng.uniform(2.0, 10.0) for _ in range(3)),
            axis_jerk=tuple(rng.uniform(40.0, 200.0) for _ in range(3)),
        )
        omega = tuple(rng.uniform(-0.8, 0.8) * v for v in limits.axis_velocity)
        alpha = tuple(rng.uniform(-0.2, 0.2) * v for v in limits.axis_acceleration)
        world = World(limits)
        world.guard.omega, world.guard.alpha = omega, alpha
        world.tracker.begin(world.guard.q, omega, alpha, limits)
        if not ceases:
            world.take(normalize(tuple(rng.gauss(0.0, 1.0) for _ in range(4))), live=5.0)
        world.run(1.0)
        assert world.tracker.is_at_rest or not ceases
