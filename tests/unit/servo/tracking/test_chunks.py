"""Chunks of poses are followed without lag, seam or extra turn; the guard judges every setpoint."""

import os
import random
from itertools import pairwise
from math import cos, pi, sin

import pytest
from chunk_world import ChunkWorld
from tracking_world import NS, angle, servo_limits

from orientd.driver import ZERO
from orientd.floats import difference, dot, exp, multiply, norm, plus
from orientd.servo.tracking.reference import Target

LIMITS = servo_limits(3.75, 25.0, 8500.0)
GENTLE = servo_limits(2.0, 10.0, 100.0)
AXIS = (0.36, -0.48, 0.8)
CASES = int(os.environ.get("ORIENTD_CASES", "40"))

TWINS = [
    (1.4108558893203735, -0.14490126073360443, 2.2968666553497314),
    (-1.9869475665660719, -0.20934335242279448, -2.127417674763405),
    (2.2370280192904906, 0.27921068309845154, 2.151151922104493),
]
"""Rotation vectors of a policy, neighbours in time; component by component they are far apart."""


def about(radians, axis=AXIS):
    return exp(plus(ZERO, axis, radians))


def play_sine(hertz, amplitude, *, hz=30, count=16, inference=0.15, rate_hz=500, limits=LIMITS):
    """Return largest error (rad), lag (s), peak acceleration (rad/s^2) of a policy's sine.

    It infers all the time: a chunk arrives *inference* seconds after its first stamp.
    """
    world, spin = ChunkWorld(limits, rate_hz), 2.0 * pi * hertz
    begin_ns, observed_ns = world.now_ns, world.now_ns
    errors, lags, weights, peak = [], 0.0, 0.0, 0.0
    while world.now_ns < begin_ns + 4 * NS:
        if world.now_ns >= observed_ns + inference * NS:
            poses = world.poses(observed_ns, count, hz, lambda t: about(amplitude * sin(spin * t)))
            assert world.chunk(poses) == ""
            observed_ns = world.now_ns
        point = world.step()
        t = world.now - 1.0
        if t > 2.0:
            gap = difference(point.q, about(amplitude * sin(spin * t)))
            speed = amplitude * spin * cos(spin * t)
            errors.append(norm(gap))
            lags += speed * dot(gap, AXIS)
            weights += speed * speed
            peak = max(peak, norm(point.alpha_body))
    return max(errors), lags / weights, peak


@pytest.mark.parametrize("rate_hz", [125, 500])
@pytest.mark.parametrize("hertz", [0.2, 0.5, 1.0, 1.5, 2.0])
def test_a_sine_in_chunks_is_followed_without_lag(hertz, rate_hz):
    spin = 2.0 * pi * hertz
    amplitude = min(1.0, 12.0 / spin**2)
    error, lag, peak = play_sine(hertz, amplitude, rate_hz=rate_hz)
    assert error < 5e-4
    assert abs(lag) < 2e-4
    assert peak < 1.02 * amplitude * spin**2


@pytest.mark.parametrize(("hertz", "amplitude"), [(0.25, 1.0), (0.5, 1.0), (1.0, 0.3)])
@pytest.mark.parametrize("share", [1.05, 1.1, 1.5])
@pytest.mark.parametrize("jerk", [3.0, 10.0])
def test_limits_just_above_the_motion_of_the_poses_suffice_to_catch_up(
    hertz, amplitude, share, jerk
):
    spin = 2.0 * pi * hertz
    peak = amplitude * spin
    world = ChunkWorld(servo_limits(share * peak, share * peak * spin, jerk * peak * spin**2), 250)
    worst = 0.0
    for _ in range(50):
        # From rest; the poses move at their largest speed.
        begin_ns = world.now_ns - round(0.15 * NS)
        world.chunk(world.poses(begin_ns, 16, 30, lambda t: about(amplitude * sin(spin * t))))
        for _ in range(38):
            q = world.step().q
            if world.now - 1.0 > 5.0:
                worst = max(worst, angle(q, about(amplitude * sin(spin * (world.now - 1.0)))))
    assert worst < 1e-3


def test_a_twin_of_a_rotation_vector_costs_no_turn():
    world, way = ChunkWorld(GENTLE), 0.0
    world.tracker.begin(exp(TWINS[0]), ZERO, ZERO, GENTLE)
    world.guard.anchor(exp(TWINS[0]), ZERO)
    begin = world.now_ns
    assert world.chunk([(begin + k * NS, exp(turn)) for k, turn in enumerate(TWINS)]) == ""
    last = world.guard.q
    for point in world.run(4.0):
        way += angle(last, point.q)
        last = point.q
    assert angle(last, exp(TWINS[2])) < 1e-5
    assert angle(exp(TWINS[0]), exp(TWINS[1])) * 180 / pi == pytest.approx(46.66, abs=0.01)
    assert angle(exp(TWINS[1]), exp(TWINS[2])) * 180 / pi == pytest.approx(15.64, abs=0.01)
    assert way * 180 / pi < (46.66 + 15.64) * 1.1


def test_a_chunk_of_which_all_poses_have_passed_is_refused():
    world = ChunkWorld(LIMITS)
    world.run(1.0)
    poses = world.poses(world.now_ns - NS // 5, 16, 30, lambda t: about(0.2 * t))
    assert world.chunk(poses) == ""
    assert "has passed" in world.chunk(poses[:4])


def test_a_chunk_that_has_passed_altogether_changes_nothing():
    paths = []
    for is_late in (False, True):
        world = ChunkWorld(LIMITS)
        world.chunk(world.poses(world.now_ns, 30, 30, lambda t: about(0.5 * t)))
        world.run(0.5)
        if is_late:
            world.chunk(world.poses(world.now_ns - NS // 3, 5, 30, lambda t: about(2.0)))
        paths.append([point.q for point in world.run(1.0)])
    assert paths[0] == paths[1]


@pytest.mark.parametrize("speed", [0.2, 1.0, 1.8])
@pytest.mark.parametrize("limits", [LIMITS, GENTLE])
def test_it_ends_at_the_last_pose_and_does_not_pass_it(speed, limits):
    world = ChunkWorld(limits)
    assert world.chunk(world.poses(world.now_ns, 40, 30, lambda t: about(speed * t))) == ""
    end = speed * 39 / 30
    angles = [difference((1.0, 0.0, 0.0, 0.0), point.q) for point in world.run(3.0)]
    along = [dot(turn, AXIS) for turn in angles]
    assert max(along) < end + 1e-3
    assert along[-1] == pytest.approx(end, abs=1e-6)
    # At rest as soon as a stop from that speed takes, and some more for the last stretch.
    stop = speed / limits.acceleration + limits.acceleration / limits.jerk
    arrived = next(k for k, x in enumerate(along) if x > end - 1e-3) * world.period
    assert arrived < 39 / 30 + stop + 0.1


def test_the_next_chunk_in_time_leaves_no_trace_of_an_end():
    world, speeds = ChunkWorld(LIMITS), []
    for k in range(10):
        # 8 poses of which less than a stop is left when the next ones come.
        world.chunk(world.poses(world.now_ns, 8, 30, lambda t: about(1.5 * t)))
        for _ in range(100):
            speed = norm(world.step().omega_body)
            speeds += [speed] * (k > 4)
    assert speeds == pytest.approx([1.5] * len(speeds), abs=1e-3)


@pytest.mark.parametrize(
    "ahead_ns", [-2_000_001, -1, 0, 1, 4_409, 1_999_999, 2_000_001, 33_000_000]
)
def test_chunks_that_agree_leave_no_trace_wherever_their_first_pose_is(ahead_ns):
    world, apart, peak = ChunkWorld(LIMITS), 0.0, 0.0
    for _ in range(10):
        poses = world.poses(world.now_ns + ahead_ns, 16, 30, lambda t: about(0.3 * sin(2.0 * t)))
        world.chunk(poses)
        for point in world.run(0.3):
            if world.now > 2.5:
                peak = max(peak, norm(point.alpha_body))
        apart = max(apart, angle(world.guard.q, about(0.3 * sin(2.0 * (world.now - 1.0)))))
    assert apart < 1e-4
    assert peak < 1.02 * 0.3 * 2.0**2


def test_chunks_that_are_anchored_anew_cost_no_more_than_a_part_of_the_limits():
    world, rng, peak = ChunkWorld(LIMITS), random.Random(2), 0.0
    for _ in range(20):
        offset = about(rng.uniform(-0.03, 0.03))
        world.chunk(
            world.poses(world.now_ns, 16, 30, lambda t, o=offset: multiply(about(0.5 * t), o))
        )
        for point in world.run(0.27):
            peak = max(peak, norm(point.alpha_body))
    assert peak < 0.98 * LIMITS.acceleration
    assert 0.02 < world.report.largest_seam < 0.1


def test_a_lone_outlier_moves_the_device_no_farther_than_the_limits_allow():
    world = ChunkWorld(GENTLE)
    poses = world.poses(world.now_ns, 30, 30, lambda t: about(0.3 * t))
    poses[15] = (poses[15][0], about(2.5, (0.0, 1.0, 0.0)))
    world.chunk(poses)
    away = max(angle(point.q, about(0.3 * (world.now - 1.0))) for point in world.run(1.5))
    assert away < 0.5
    assert angle(world.guard.q, about(0.3 * 29 / 30)) < 1e-5


def test_velocities_that_are_given_are_followed():
    world, worst = ChunkWorld(LIMITS), 0.0
    for _ in range(12):
        stamps = [world.now_ns + k * NS // 10 for k in range(8)]
        seconds = [(stamp - NS) / NS for stamp in stamps]
        samples = [
            (stamp, about(0.8 * sin(4.0 * t)), plus(ZERO, AXIS, 3.2 * cos(4.0 * t)))
            for stamp, t in zip(stamps, seconds, strict=True)
        ]
        world.chunk(samples)
        for _ in range(round(0.25 / world.period)):
            point, t = world.step(), world.now - 1.0
            if t > 1.0:
                worst = max(worst, angle(point.q, about(0.8 * sin(4.0 * t))))
    assert worst < 1e-3


def test_a_chunk_ahead_leaves_what_is_before_it():
    world = ChunkWorld(LIMITS)
    world.chunk(world.poses(world.now_ns, 40, 30, lambda t: about(0.5 * t)))
    world.run(0.3)
    world.chunk(world.poses(world.now_ns + NS * 4 // 10, 20, 30, lambda t: about(0.9 * t - 0.28)))
    world.run(0.29)
    assert angle(world.guard.q, about(0.5 * (world.now - 1.0))) < 1e-3
    world.run(0.3)
    assert angle(world.guard.q, about(0.9 * (world.now - 1.0) - 0.28)) < 2e-3


def test_a_target_after_chunks_and_chunks_after_a_target_replace_each_other():
    world = ChunkWorld(LIMITS)
    world.chunk(world.poses(world.now_ns, 40, 30, lambda t: about(0.5 * t)))
    world.run(0.5)
    assert (
        world.tracker.take(Target(about(0.1), ZERO, world.now_ns, world.now_ns + NS), world.now_ns)
        == ""
    )
    world.run(0.9)
    assert angle(world.guard.q, about(0.1)) < 1e-4
    world.chunk(world.poses(world.now_ns, 10, 30, lambda t: about(0.1 + 0.2 * (t - 1.4))))
    world.run(1.5)
    assert angle(world.guard.q, about(0.1 + 0.2 * 0.3)) < 1e-4


@pytest.mark.parametrize("seed", range(CASES))
def test_whatever_a_policy_does_limits_are_kept_and_the_last_pose_is_come_to(seed):
    rng = random.Random(seed)
    acceleration = 10.0 ** rng.uniform(0.3, 1.6)
    limits = servo_limits(
        10.0 ** rng.uniform(-0.3, 0.7), acceleration, acceleration * 10.0 ** rng.uniform(1.0, 2.7)
    )
    world = ChunkWorld(limits, rng.choice([125, 250, 500]))
    hz, count = rng.choice([5, 8, 10, 15, 20, 30, 50, 60]), rng.randint(4, 64)
    inference = rng.uniform(0.0, min(0.8 * (count - 1) / hz, 0.6))
    every = rng.choice([inference + 0.01, max(inference, 0.5 * count / hz), count / hz + inference])
    axes = [tuple(rng.gauss(0.0, 1.0) for _ in range(3)) for _ in range(2)]
    swing, spin = rng.uniform(0.05, 1.5), 2.0 * pi * rng.uniform(0.05, 1.0)
    habits = {
        name
        for name in ("anchors", "outliers", "signs", "gaps", "noise", "repeats")
        if rng.random() < 0.3
    }

    def motion(t):
        one = about(swing * sin(spin * t), axes[0])
        return multiply(one, about(0.5 * swing * cos(0.7 * spin * t), axes[1]))

    def habit(q, anchor, before):
        q = multiply(q, anchor)
        if "outliers" in habits and rng.random() < 0.05:
            q = multiply(q, exp(tuple(rng.gauss(0.0, 1.5) for _ in range(3))))
        if "signs" in habits and rng.random() < 0.5:
            q = tuple(-x for x in q)
        if "noise" in habits:
            q = multiply(q, exp(tuple(rng.gauss(0.0, 5e-3) for _ in range(3))))
        return before if "repeats" in habits and before and rng.random() < 0.1 else q

    arriving, last, way, least = [], None, 0.0, 0.0
    stop_ns, next_ns = world.now_ns + round(rng.uniform(2.0, 4.0) * NS), world.now_ns
    before = world.guard.q
    while world.now_ns < stop_ns or last is None or world.now_ns < last[0]:
        if next_ns <= world.now_ns < stop_ns or (last is None and not arriving):
            anchor = exp(tuple(rng.gauss(0.0, 0.05) for _ in range(3)))
            anchor = anchor if "anchors" in habits else (1.0, 0.0, 0.0, 0.0)
            samples, poses = [], world.poses(world.now_ns, count, hz, motion)
            for stamp, q in poses:
                if "gaps" not in habits or stamp == poses[-1][0] or rng.random() > 0.2:
                    samples.append((stamp, habit(q, anchor, samples[-1][1] if samples else None)))
            arriving.append((world.now_ns + round(inference * NS), samples))
            next_ns = world.now_ns + round(every * NS)
        while arriving and arriving[0][0] <= world.now_ns:
            samples = arriving.pop(0)[1]
            if world.chunk(samples) == "":
                last = samples[-1]
                path = [before, *(q for _, q in samples)]
                least += sum(angle(a, b) for a, b in pairwise(path))
        q = world.step().q
        way += angle(before, q)
        before = q
    left, speed = angle(world.guard.q, last[1]), norm(world.guard.omega)
    # At most: stop, go there and stop again.
    pause = acceleration / limits.jerk
    stop = speed / acceleration + pause
    left += speed * stop
    most = stop + 2.0 * (left / acceleration) ** 0.5 + left / limits.velocity + 4.0 * pause + 0.3
    for point in world.run(most):
        way += angle(before, point.q)
        before = point.q
    assert angle(world.guard.q, last[1]) < 1e-3
    assert norm(world.guard.omega) < 1e-2
    # No turn that the poses do not have.
    assert way < 1.2 * least + 2.0 * pi


def test_a_chunk_that_begins_after_the_end_is_compared_with_the_last_pose():
    world = ChunkWorld(LIMITS)
    world.chunk(world.poses(world.now_ns, 8, 30, lambda t: about(0.2 * t)))
    world.run(0.1)
    world.chunk(world.poses(world.now_ns + NS * 3 // 10, 8, 30, lambda t: about(0.05)))
    assert world.report.largest_seam == pytest.approx(0.05 - 0.2 * 7 / 30, abs=1e-6)
    world.run(1.0)
    assert angle(world.guard.q, about(0.05)) < 1e-5
