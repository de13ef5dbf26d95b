"""Where the device ends once targets end, and which of two chunks counts."""

import os
import random
from math import pi

import pytest
from tracking_world import NS, World, angle, servo_limits

from orientd.floats import difference, exp, multiply, norm
from orientd.kernels import stop_along
from orientd.servo.tracking.reference import Target

LIMITS = servo_limits(2.5, 17.0, 8500.0)
IDENTITY = (1.0, 0.0, 0.0, 0.0)
CASES = int(os.environ.get("ORIENTD_CASES", "40"))


def about_z(radians):
    return exp((0.0, 0.0, radians))


def around(q):
    """Return the angle about z, rad."""
    return difference(IDENTITY, q)[2]


def aim(world, q, time_ns=None, live=0.5, position=None):
    stamp = world.now_ns if time_ns is None else time_ns
    return world.tracker.take(
        Target(q, None, stamp, stamp + round(live * NS), position), world.now_ns
    )


def stream(world, rate, hz, seconds, *, live=0.5, ahead=0.0, axis=(0.0, 0.0, 1.0), after=1.5):
    """Follow a target of constant rate, then none; return the last target and what was sent."""
    start, points, count = world.now_ns, [], 0
    last = IDENTITY
    while world.now_ns < start + (seconds + after) * NS:
        while count < round(seconds * hz) and world.now_ns >= start + count * NS // hz:
            turn = rate * count / hz
            last = exp((turn * axis[0], turn * axis[1], turn * axis[2]))
            stamp = start + count * NS // hz + round(ahead * NS)
            assert aim(world, last, stamp, live) == "" or live < 2.0 / hz
            count += 1
        points.append(world.step().q)
    return last, points


def beyond(points, last, axis):
    """Return how far past *last* along *axis* the farthest of *points* is, rad."""
    return max(sum(a * b for a, b in zip(difference(last, q), axis, strict=True)) for q in points)


def braking(rate, limits):
    """Return what a stop from *rate* turns at least, rad."""
    return rate * rate / (2.0 * limits.acceleration) + rate * limits.acceleration / limits.jerk


@pytest.mark.parametrize(
    ("rate", "hz", "ahead", "live"),
    [
        (0.5, 30, 0.0, 0.5),
        (1.0, 30, 0.0, 0.5),
        (1.0, 30, 0.2, 0.5),
        (1.0, 30, 0.0, 0.2),
        (1.0, 10, 0.0, 0.5),
        (2.0, 30, 0.0, 0.5),
        (2.0, 30, 0.1, 0.15),
        (1.0, 30, 0.0, 0.04),
    ],
)
def test_it_ends_at_the_last_target_and_brakes_as_soon_as_the_next_one_is_overdue(
    rate, hz, ahead, live
):
    world = World(LIMITS)
    last, points = stream(world, rate, hz, 0.8, ahead=ahead, live=live)
    overdue = 0.0 if ahead else min(1.25 / hz + 3 * world.period, live)
    most = braking(rate, LIMITS) + rate * (overdue + world.period) + 2e-3
    assert beyond(points, last, (0.0, 0.0, 1.0)) <= most
    assert angle(points[-1], last) < 1e-6


@pytest.mark.parametrize("count", [8, 16, 32, 40, 50, 100, 300])
def test_a_chunk_ends_where_it_says(count):
    world = World(LIMITS)
    start, end = world.now_ns, 0.5
    for k in range(count):
        goal = about_z(end * k / (count - 1))
        assert aim(world, goal, start + round(k / 30 * NS), live=1.0) == ""
    points = [point.q for point in world.run(count / 30 + 1.5)]
    assert max(map(around, points)) < end + 0.01
    assert angle(points[-1], about_z(end)) < 1e-6
    # It is on its way at the times that were said, too.
    if count >= 50:
        middle = points[round((count // 2) / 30 / world.period)]
        assert around(middle) == pytest.approx(end * (count // 2) / (count - 1), abs=5e-3)


def test_a_chunk_with_positions_ends_where_it_says():
    from rig import TERMS, Rig

    from orientd.stream.records import NOT_GIVEN, Answer, Command

    rig = Rig()
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    assert rig.ask(Command.TRACK, servo_limits=TERMS)[0] is Answer.DONE
    start = rig.clock.now_ns()
    for k in range(20):
        stamp = start + round(k / 30 * NS)
        where = (0.3 * k / 19, 0.0, 0.0)
        rig.memory.targets.publish(stamp, stamp + NS, *IDENTITY, *NOT_GIVEN, *where)
    rig.run(1000)
    along = [setpoint.position[0] for setpoint in rig.driver.setpoints]
    assert max(along) < 0.3 + 0.01
    assert along[-1] == pytest.approx(0.3, abs=1e-4)


def chunk(world, start_ns, count, begin, end, hz=30, live=1.0):
    """Hand over *count* targets at once; return what became of each."""
    return [
        aim(
            world,
            about_z(begin + (end - begin) * k / (count - 1)),
            start_ns + round(k / hz * NS),
            live,
        )
        for k in range(count)
    ]


def reversals(angles):
    """Return how often a motion turns back by more than two milliradians."""
    count, way, extreme = 0, 0, angles[0]
    for here in angles:
        if way * (here - extreme) > 0.0 or not way:
            way = way or (here > extreme) - (here < extreme)
            extreme = here
        elif abs(here - extreme) > 2e-3:
            count, way, extreme = count + 1, -way, here
    return count


@pytest.mark.parametrize("shift", [0.0, 0.007, 0.02])
@pytest.mark.parametrize(("count", "after"), [(50, 0.3), (16, 8 / 30), (16, 12 / 30)])
def test_a_newer_chunk_replaces_what_is_left_of_the_older(count, after, shift):
    world = World(LIMITS)
    start = world.now_ns
    assert not any(chunk(world, start, count, 0.0, 0.5))
    first = [point.q for point in world.run(after)]
    here = 0.5 * after * 30 / (count - 1)
    taken = chunk(world, start + round((after + shift) * NS), count, here, here - 0.5)
    assert not any(taken[1:])
    then = [point.q for point in world.run(count / 30 + 1.5)]
    angles = list(map(around, first + then))
    speed = 0.5 * 30 / (count - 1)
    assert max(angles) < here + braking(speed, LIMITS) + speed * (shift + 0.034)
    # It turns back once, and may brake past the end.
    assert reversals(angles) <= 2
    assert angles[-1] == pytest.approx(here - 0.5, abs=1e-6)


def test_a_newer_chunk_that_is_shorter_ends_where_it_says():
    world = World(LIMITS)
    start = world.now_ns
    chunk(world, start, 60, 0.0, 0.6)
    world.run(0.5)
    chunk(world, start + NS // 2, 10, 0.6 * 15 / 59, 0.6 * 24 / 59)
    world.run(2.5)
    assert around(world.guard.q) == pytest.approx(0.6 * 24 / 59, abs=1e-6)


def test_chunks_that_overlap_are_followed_as_one_motion():
    # 16 poses, eight of them new each time, three stale.
    world, truth = World(LIMITS), lambda t: 0.8 * t
    start, errors = world.now_ns, []
    for k in range(12):
        begin = start + round((8 * k - 3) / 30 * NS)
        for n in range(16):
            stamp = begin + round(n / 30 * NS)
            aim(world, about_z(truth((stamp - start) / NS)), stamp, live=1.0)
        while world.now_ns < start + (k + 1) * 8 * NS // 30:
            point = world.step()
            t = (world.now_ns - start) / NS
            if t > 0.6:
                errors.append(abs(around(multiply(about_z(-truth(t)), point.q))))
    assert max(errors) < 2e-3


def test_a_target_that_was_never_come_to_is_given_up_when_it_expires():
    world = World(LIMITS)
    aim(world, about_z(2.5), live=0.2)
    world.run(2.0)
    assert around(world.guard.q) < 1.5
    assert world.tracker.is_at_rest


@pytest.mark.parametrize(("ahead", "is_taken"), [(9.9, True), (10.1, False)])
def test_stamps_are_kept_up_to_ten_seconds_ahead(ahead, is_taken):
    world = World(LIMITS)
    answer = aim(world, about_z(0.2), world.now_ns + round(ahead * NS))
    assert (answer == "") is is_taken
    assert is_taken or "ahead" in answer


def test_ten_seconds_of_targets_at_five_hundred_a_second_all_find_room():
    world = World(LIMITS)
    start = world.now_ns
    taken = [aim(world, about_z(1e-4 * k), start + k * NS // 500) for k in range(5000)]
    assert not any(taken)
    world.run(11.0)
    assert around(world.guard.q) == pytest.approx(0.4999, abs=1e-6)


@pytest.mark.parametrize("seed", range(CASES))
def test_wherever_targets_end_the_device_ends_there(seed):
    rng = random.Random(seed)
    acceleration = 10.0 ** rng.uniform(0.3, 1.5)
    limits = servo_limits(
        10.0 ** rng.uniform(-0.3, 0.7), acceleration, acceleration * 10.0 ** rng.uniform(1.0, 2.7)
    )
    hz = rng.choice([8, 10, 15, 30, 50, 60, 100, 200])
    rate = rng.uniform(0.1, 0.7) * min(limits.velocity, 2.5)
    live = rng.choice([rng.uniform(0.02, 0.3), rng.uniform(0.3, 2.0)])
    ahead = rng.choice([0.0, 0.0, rng.uniform(1.5 / hz, 0.4)])
    x, y, z = (rng.gauss(0.0, 1.0) for _ in range(3))
    size = norm((x, y, z))
    axis = (x / size, y / size, z / size)
    # Long enough to have caught up with it, and not so far that the way back is the other one.
    seconds = 3.0 * rate / acceleration + 8.0 / hz + 1.0
    rate *= min(1.0, 2.5 / (rate * seconds))
    world = World(limits, rng.choice([125, 250, 500]))
    last, points = stream(world, rate, hz, seconds, live=live, ahead=ahead, axis=axis, after=4.0)
    bound = world.limits
    overdue = 0.0 if ahead else 1.25 / hz + 2 * world.period
    most = stop_along(rate, 0.0, bound.acceleration, bound.jerk)[1] + rate * (
        overdue + 2 * world.period
    )
    assert beyond(points, last, axis) <= 1.1 * most + 5e-3
    if live > 2.5 / hz or ahead:
        assert angle(points[-1], last) < 1e-5
    assert pi > angle(points[-1], IDENTITY)
