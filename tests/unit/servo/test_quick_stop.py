"""Stops of the real servo on planned motions, against the shortest that are possible."""

from math import sqrt

import numpy as np
import pytest
from rides import KINDS, SOME_METHODS, Ride, Track, motions, servo_limits_of
from rig import PERIOD

from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import exp
from orientd.stream.records import UNKNOWN, Command, ServoState

MOST = 1.2
"""Times the least, a stop on the path may take."""


def drawn_directions():
    random = np.random.default_rng(0).normal(size=(300, 3))
    return np.vstack([np.eye(3), -np.eye(3), random / np.linalg.norm(random, axis=1)[:, None]])


DIRECTIONS = drawn_directions()


def bound(omega, alpha, velocity, limits):
    """Return a time that no stop is shorter than, whatever path it took.

    Along any direction the component of the angular velocity has to go to zero from its own first
    acceleration, within what the limits allow along that direction at most: a double integrator
    with bounded jerk.  The largest of these times, over many directions, is the bound.
    """
    best = float(np.linalg.norm(velocity)) / limits.linear_acceleration
    directions = DIRECTIONS
    if np.linalg.norm(omega) > 0.0:
        directions = np.vstack([omega / np.linalg.norm(omega), directions])
    for d in directions:
        speed, push = float(omega @ d), float(alpha @ d)
        most, jerk = (
            min(limit, sum(abs(x) * a for x, a in zip(d, axes, strict=True) if x != 0.0))
            for limit, axes in (
                (limits.acceleration, limits.axis_acceleration),
                (limits.jerk, limits.axis_jerk),
            )
        )
        if speed <= 0.0 or (push < 0.0 and push * push / (2.0 * jerk) >= speed):
            continue
        peak = sqrt(jerk * speed + 0.5 * push * push)
        if peak <= most:
            best = max(best, (push + 2.0 * peak) / jerk)
        else:
            held = speed + (push * push - 2.0 * most * most) / (2.0 * jerk)
            best = max(best, (push + 2.0 * most) / jerk + held / most)
    return best


def deviation_allowed(motion):
    """Return the largest angle between a setpoint and the motion's own curve, rad.

    Half way between two records a cubic is off by the change of the jerk there times the period
    cubed over 192 (Hermite interpolation of a cubic spline), and no jerk changes by more than twice
    its limit.
    """
    return max(1e-6, motion.limits.jerk * PERIOD**3 / 96.0)


def check_stops(seed, kind, count, stops, methods=SOME_METHODS):
    """Stop at random; return the times over a bound."""
    random = np.random.default_rng(seed)
    ratios = []
    for motion in motions([seed, KINDS.index(kind)], count, kind, methods):
        track = Track(motion)
        for _ in range(stops):
            ride = Ride(track, int(random.integers(4, motion.record_count - 4)))
            cycles = ride.stop()
            assert ride.rig.servo.state is ServoState.HOLDING, ride.rig.servo.setpoints.fault_text
            assert ride.deviation < deviation_allowed(ride.motion)
            assert ride.excess() <= 1.001
            least = bound(ride.omega, ride.alpha, ride.velocity, motion.limits)
            # A stop begins and ends with a cycle: the time of one falls between them.
            ratios.append(max(cycles - 1, 0) * PERIOD / min(least, ride.remaining))
    return np.array(ratios)


@pytest.mark.parametrize("kind", KINDS)
def test_a_stop_takes_hardly_longer_than_any_stop_could(kind):
    ratios = check_stops(0, kind, 6, 6)
    # Against a bound that knows nothing of the path, which a few stops cannot come near.
    assert np.median(ratios) < 1.03
    assert np.percentile(ratios, 95) < 1.2


@pytest.mark.parametrize(
    ("drawn", "record", "fewest", "times"),
    [
        (([7003, 0], 2, "reserve"), 262, 78, MOST),
        (([7003, 0], 2, "reserve"), 254, 71, 1.5),
        (([9000, 1], 7, "reserve"), 4975, 26, MOST),
    ],
)
def test_a_stop_comes_to_rest_before_the_path_turns_back_or_soon_behind(
    drawn, record, fewest, times
):
    # A turn about one axis and back; a search by linear programs on the path found the numbers.
    *_, motion = motions(*drawn, ["kks_hermite"])
    ride = Ride(Track(motion), record)
    assert ride.stop() <= times * fewest
    assert ride.excess() <= 1.001
    assert ride.rig.servo.state is ServoState.HOLDING


def test_a_stop_that_just_fails_with_all_of_the_jerk_is_made_with_less_of_it():
    # Into a sharp bend, behind which a stop would take 10 cycles.
    *_, motion = motions([157, 0], 4, "reserve")
    ride = Ride(Track(motion), 150)
    assert ride.stop() <= 5
    assert ride.excess() <= 1.001
    assert ride.rig.servo.state is ServoState.HOLDING


def test_a_stop_in_a_fast_bend_is_what_the_guard_sees():
    # At 10 rad/s and more in a bend, the turns of two cycles do not commute: the jerk is more.
    random = np.random.default_rng(4)
    limits = Limits(25.0, *random.uniform((60.0, 2000.0), (200.0, 8000.0)).tolist(), 1.0, 10.0)
    keys = [np.array([1.0, 0.0, 0.0, 0.0]), *random.normal(size=(4, 4))]
    request = MotionRequest([Keyframe(tuple(q / np.linalg.norm(q))) for q in keys])
    motion = plan(request, start=State.at_rest(keys[0]), limits=limits, period=PERIOD)
    track = Track(motion)
    for record in range(10, motion.record_count - 10, 7):
        ride = Ride(track, record)
        ride.stop()
        assert ride.rig.servo.state is ServoState.HOLDING, ride.rig.servo.setpoints.fault_text
        assert ride.excess() <= 1.001


@pytest.mark.parametrize("cycles", [1, 2, 3])
def test_a_stop_keeps_the_limits_where_the_path_comes_to_a_motion_that_brakes_harder(cycles):
    for motion in motions([7, 1], 3, "reserve"):
        ride = Ride(Track(motion), motion.record_count // 3)
        scaling = ride.rig.servo.setpoints.time_scaling
        whole = scaling.brake_rate
        scaling.brake_rate = 0.7 * whole
        ride.command_stop()
        for _ in range(cycles):
            ride.run()
        # While the stop is rolled out, from where the weaker brake would have led.
        if not scaling.plan:
            scaling.brake_rate = whole
        ride.come_to_rest()
        assert ride.rig.servo.state is ServoState.HOLDING, ride.rig.servo.setpoints.fault_text
        assert ride.excess() <= 1.001


def test_a_stop_from_hardly_any_speed_is_made_at_once():
    # At 0.03 rad/s, which the jerk takes away in a cycle.
    *_, motion = motions([39, 1], 4, "reserve")
    ride = Ride(Track(motion), 54)
    assert ride.stop() <= 1
    assert ride.excess() <= 1.001
    assert ride.rig.servo.state is ServoState.HOLDING


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_every_one_of_many_stops_keeps_the_limits_and_the_path(kind, seed):
    assert np.percentile(check_stops(seed, kind, 40, 10), 95) < 1.2


def wander(ride, random, changes):
    """Pause, resume and change speed at random; return whether the motion still goes on."""
    for _ in range(changes):
        speed = float(random.choice([0.0, 0.0, 1.0, 1.0, random.random()]))
        ride.rig.memory.commands.publish(
            Command.SPEED, 1, 0, UNKNOWN, UNKNOWN, 0, speed, *servo_limits_of(ride.motion).floats()
        )
        for _ in range(int(random.choice([1, 3, 10, 40, 150]))):
            ride.run()
            if not ride.rig.servo.is_moving:
                return False
    return True


def check_sequences(seed, kind, count, sequences):
    random = np.random.default_rng(seed)
    for motion in motions([seed, KINDS.index(kind)], count, kind):
        track = Track(motion)
        for _ in range(sequences):
            ride = Ride(track, int(random.integers(4, max(5, motion.record_count // 2))))
            if wander(ride, random, 8):
                ride.stop()
            assert ride.rig.servo.state is ServoState.HOLDING, ride.rig.servo.setpoints.fault_text
            assert ride.deviation < deviation_allowed(ride.motion)
            assert ride.excess() <= 1.001


@pytest.mark.parametrize("kind", KINDS)
def test_pauses_resumptions_and_stops_in_any_order_keep_the_limits_and_the_path(kind):
    check_sequences(10, kind, 3, 5)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("kind", KINDS)
def test_many_more_pauses_resumptions_and_stops_do(kind, seed):
    check_sequences(seed, kind, 40, 10)


@pytest.mark.parametrize("cycles", [-1, 0, 1, 2])
def test_a_resumption_right_after_a_quick_stop_adds_no_jerk_to_that_of_its_end(cycles):
    """A slow turn leaves all of the jerk to its stop and to its resumption."""
    request = MotionRequest(
        [Keyframe((1.0, 0.0, 0.0, 0.0), time=0.0), Keyframe(tuple(exp([0.0, 0.0, 1.0])), time=3.0)]
    )
    start, limits = State.at_rest((1.0, 0.0, 0.0, 0.0)), Limits(2.0, 100.0, 20.0, 1.0, 10.0)
    track = Track(plan(request, start=start, limits=limits, period=PERIOD))
    for record in range(171, 1200, 150):
        ride = Ride(track, record)
        ride.command_speed(0.0)
        ride.run()
        while ride.rig.servo.setpoints.time_scaling.rate > 0.0:
            if cycles < 0 and ride.rates[-1] < 0.01:
                break
            ride.run()
        for _ in range(cycles):
            ride.run()
        ride.command_speed(1.0)
        for _ in range(20):
            ride.run()
        setpoints = ride.rig.servo.setpoints
        assert setpoints.state is ServoState.STREAMING, setpoints.fault_text
        assert ride.excess() <= 1.001
        ride.command_stop()
        ride.come_to_rest()
