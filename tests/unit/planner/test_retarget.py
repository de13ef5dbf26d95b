"""A new aim for a device on its way: whatever it does, the limits hold across the seam."""

import random

import numpy as np
import pytest
from planned import LIMITS, PERIOD, differences, rotations, vector
from reference.aims import end_state, retarget
from scipy.spatial.transform import Rotation

from orientd.errors import LimitError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import angle, exp, multiply
from orientd.tolerances import GUARD_TOLERANCE

ARM = LIMITS["arm"]
SLOW = [pytest.mark.slow, pytest.mark.timeout(1200)]
HERE = np.array([1.0, 0.0, 0.0, 0.0])


def aimed(target, start, limits=ARM, **fields):
    return retarget(target, start=start, limits=limits, period=PERIOD, **fields)


def moving(seed=0, limits=ARM, record=100, turn=2.0, **fields):
    """Return a motion on its way, and a record in the middle of it."""
    random = np.random.default_rng(seed)
    start = State.at_rest(rotations(random, 2, 1.0)[0], random.uniform(-1, 1, 3))
    target = multiply(start.q, exp(vector(random, turn)))
    return aimed(target, start, limits, **fields), record


def assert_limits_are_kept(q, limits, period=PERIOD):
    rates = differences(q, period)
    for rate, limit in zip(rates, (limits.velocity, limits.acceleration, limits.jerk), strict=True):
        assert rate.max() <= GUARD_TOLERANCE * limit


def orientations(motion, first=0, last=None):
    count = (motion.record_count if last is None else last) - first
    return motion.records(first, count)[:, :4]


def spliced(first, record, second):
    assert second.records(0, 1) == pytest.approx(
        first.records(record, 1), rel=1e-9, abs=1e-12, nan_ok=True
    )
    return np.concatenate([orientations(first, 0, record), orientations(second)])


@pytest.mark.parametrize("name", sorted(LIMITS))
@pytest.mark.parametrize("turn", [0.0, 1e-6, 0.01, 0.5, 2.0, np.radians(179.99), np.pi])
def test_a_retarget_arrives_and_keeps_the_limits_across_the_seam(name, turn):
    limits = LIMITS[name]
    random = np.random.default_rng(int(1e6 * turn))
    for _ in range(4):
        first, _ = moving(int(random.integers(1000)), limits)
        record = int(random.integers(first.record_count))
        start = first.state_at(record)
        target = multiply(start.q, exp(vector(random, turn) if turn else np.zeros(3)))
        second = aimed(target, start, limits)
        assert angle(end_state(second).q, target) < 1e-9
        assert np.linalg.norm(end_state(second).omega_body) < 1e-9
        assert_limits_are_kept(spliced(first, record, second), limits)


def test_the_first_record_is_the_state_that_is_taken_over():
    first, record = moving()
    start = first.state_at(record)
    second = aimed(HERE, start)
    assert second.records(0, 1) == pytest.approx(
        first.records(record, 1), rel=1e-9, abs=1e-12, nan_ok=True
    )
    assert second.sample([0.0]).alpha_body[0] == pytest.approx(start.alpha_body, abs=1e-9)


def test_a_state_at_a_record_brings_the_setpoints_before_it():
    first, record = moving()
    q, position = first.state_at(record).before
    assert np.array_equal(q, first.records(record - 3, 3)[:, :4])
    assert np.array_equal(position, first.records(record - 3, 3)[:, 10:13])


def test_the_setpoints_before_reach_back_into_the_motion_before():
    first, record = moving()
    second = aimed(HERE, first.state_at(record))
    q, _ = second.state_at(1).before
    assert np.array_equal(q[:2], first.records(record - 2, 2)[:, :4])
    assert np.array_equal(q[2:], second.records(0, 1)[:, :4])


def test_at_its_last_record_a_motion_holds():
    first, _ = moving()
    assert first.state_at(first.record_count - 1).is_at_rest
    with pytest.raises(ValueError, match="record must be within 0 to"):
        first.state_at(first.record_count)


def test_the_certificate_covers_the_seam():
    first, record = moving()
    start = first.state_at(record)
    q, position = start.before
    stepped = multiply(q, exp([0.0, 0.0, 1e-4]))
    with pytest.raises(LimitError, match="jerk"):
        aimed(
            HERE,
            State(
                start.q,
                start.omega_body,
                start.alpha_body,
                start.position,
                before=(stepped, position),
            ),
        )


@pytest.mark.parametrize("count", [150, pytest.param(10_000, marks=SLOW)])
def test_retargets_from_retargets_keep_the_limits(count):
    random = np.random.default_rng(5)
    motion, record = moving(1)
    sent = [orientations(motion, 0, record)]
    for _ in range(count):
        start = motion.state_at(min(record, motion.record_count - 1))
        turn = random.choice([0.0, 1e-3, random.uniform(0, np.pi), np.pi])
        along = start.omega_body * random.choice([-1, 1]) if random.random() < 0.5 else 0.0
        axis = along if np.any(along) else random.normal(size=3)
        motion = aimed(multiply(start.q, exp(turn * axis / np.linalg.norm(axis))), start)
        record = int(random.integers(2, 7))
        sent.append(orientations(motion, 0, min(record, motion.record_count - 1)))
    sent.append(orientations(motion, min(record, motion.record_count - 1)))
    assert_limits_are_kept(np.concatenate(sent), ARM)


def test_a_half_turn_goes_on_the_way_the_device_is_turning():
    for side in (-1.0, 1.0):
        motion = aimed([0.0, 0.0, 0.0, 1.0], State.at_rest(HERE))
        start = aimed(exp([0, 0, side * 3.0]), State.at_rest(HERE)).state_at(200)
        motion = aimed(multiply(start.q, [0.0, 0.0, 0.0, 1.0]), start)
        assert np.all(motion.records(0, motion.record_count)[:-1, 6] * side > -1e-9)


@pytest.mark.parametrize("name", sorted(LIMITS))
def test_a_state_at_the_limits_of_velocity_and_acceleration_has_a_way_out(name):
    limits = LIMITS[name]
    random = np.random.default_rng(8)
    for turn in (0.0, 0.01, 1.0, np.pi):
        for kind in range(6):
            omega, alpha = np.array(vector(random, 1.0)), np.array(vector(random, 1.0))
            along = float(omega @ alpha)
            # Outwards no path within the limits could be going there.
            alpha -= omega * (along if kind % 2 else 2.0 * max(along, 0.0))
            alpha /= np.linalg.norm(alpha)
            start = State(HERE, limits.velocity * omega, limits.acceleration * alpha, np.zeros(3))
            target = exp(vector(random, turn)) if turn else HERE
            motion = aimed(target, start, limits)
            assert angle(end_state(motion).q, target) < 1e-9


def test_from_rest_it_is_quicker_than_the_quintic_from_rest_to_rest():
    for turn in (0.01, 0.3, 1.0, 3.0):
        q = exp([0.0, turn, 0.0])
        keyframes = [Keyframe(tuple(q.tolist())), Keyframe(tuple(exp([0, turn, 0.5]).tolist()))]
        request = MotionRequest(keyframes, approach=True)
        led_in = plan(request, start=State.at_rest(HERE), limits=ARM, period=PERIOD)
        assert aimed(q, State.at_rest(HERE)).duration <= led_in.start_time + 1e-9


def straight(distance, speed, limits):
    """Return the shortest time from a speed to rest over a distance, with no limit of the jerk."""
    v, a = limits.velocity, limits.acceleration
    stop = speed * abs(speed) / (2 * a)
    if distance < stop:
        return speed / a + straight(stop - distance, 0.0, limits)
    top = np.sqrt(a * distance + speed * speed / 2)
    if top <= v:
        return (top - speed) / a + top / a
    return (v - speed) / a + v / a + (distance - (2 * v * v - speed * speed) / (2 * a)) / v


@pytest.mark.parametrize("speed", [-2.0, -0.5, 0.0, 1.0, 2.4])
@pytest.mark.parametrize("distance", [0.2, 1.0, 2.5])
def test_it_takes_at_most_1_6_times_the_shortest_time_there_is(speed, distance):
    start = State(HERE, np.array([0.0, 0.0, speed]), np.zeros(3), np.zeros(3))
    motion = aimed(exp([0.0, 0.0, distance]), start)
    shortest = (
        straight(distance, speed, ARM)
        if speed >= 0.0
        else -speed / ARM.acceleration
        + straight(distance + speed**2 / (2 * ARM.acceleration), 0.0, ARM)
    )
    assert shortest <= motion.duration <= 1.6 * shortest


def test_a_target_can_be_passed_with_a_velocity():
    first, record = moving()
    start = first.state_at(record)
    motion = aimed(HERE, start, end_velocity=(0.0, 0.5, 0.0))
    assert angle(end_state(motion).q, HERE) < 1e-9
    assert end_state(motion).omega_body == pytest.approx([0.0, 0.5, 0.0])
    assert motion.certificate.lead_out > 0.0
    assert_limits_are_kept(spliced(first, record, motion), ARM)


def test_the_position_rides_along_with_continuous_acceleration():
    first, record = moving(position=(0.1, -0.2, 0.3))
    start = first.state_at(record)
    assert start.is_position_moving
    for aim in (None, (0.5, 0.5, 0.5)):
        second = aimed(HERE, start, position=aim)
        p = np.concatenate(
            [first.records(0, record)[:, 10:13], second.records(0, second.record_count)[:, 10:13]]
        )
        p = np.concatenate([[p[0]] * 3, p, [p[-1]] * 3])
        velocity = np.diff(p, axis=0) / PERIOD
        acceleration = np.diff(velocity, axis=0) / PERIOD
        assert np.linalg.norm(velocity, axis=1).max() <= GUARD_TOLERANCE * ARM.linear_velocity
        assert (
            np.linalg.norm(acceleration, axis=1).max() <= GUARD_TOLERANCE * ARM.linear_acceleration
        )
        # No step between any two of them that a device could notice.
        assert np.linalg.norm(np.diff(acceleration, axis=0), axis=1).max() < 1.0
        if aim:
            assert p[-1] == pytest.approx(aim)


def test_keyframes_are_led_into_from_a_motion():
    first, record = moving()
    start = first.state_at(record)
    random = np.random.default_rng(3)
    keyframes = [Keyframe(q) for q in rotations(random, 5, 0.4)]
    for velocity in (None, (0.3, 0.2, 0.1)):
        request = MotionRequest(keyframes, approach=True, start_velocity=velocity)
        second = plan(request, start=start, limits=ARM, period=PERIOD)
        assert angle(second.sample([second.start_time]).q[0], keyframes[0].q) < 1e-9
        assert second.certificate.start_velocity_error < 1e-9
        assert_limits_are_kept(spliced(first, record, second), ARM)


@pytest.mark.parametrize("method", ["c2_cumulative", "kks_hermite_spline", "kks_hermite"])
def test_a_curve_that_begins_in_the_present_state_goes_on_from_it(method):
    first, record = moving()
    start = first.state_at(record)
    turns = [start.q]
    for share in (0.3,) if method == "kks_hermite" else (0.4, 0.3, 0.1):
        turns.append(multiply(turns[-1], exp(share * start.omega_body)))
    keyframes = [Keyframe(tuple(q.tolist()), 0.5 * k) for k, q in enumerate(turns)]
    request = MotionRequest(keyframes, method, tuple(start.omega_body.tolist()))
    second = plan(request, start=start, limits=ARM, period=PERIOD)
    assert second.start_time == 0.0
    assert second.certificate.keyframe_error < 1e-9
    sample = second.sample([0.0])
    assert sample.alpha_body[0] == pytest.approx(start.alpha_body, abs=1e-9)
    assert_limits_are_kept(spliced(first, record, second), ARM)


def test_a_device_that_is_there_stays_there():
    motion = aimed(HERE, State.at_rest(HERE))
    assert motion.record_count == 2
    assert orientations(motion) == pytest.approx(np.array([HERE, HERE]), abs=1e-15)


def test_the_sign_of_the_quaternion_goes_on():
    start = State.at_rest(-HERE)
    motion = aimed(exp([0.0, 0.0, 1.0]), start)
    assert orientations(motion, 0, 1)[0] == pytest.approx(-HERE, abs=1e-15)
    assert np.all(
        np.einsum("ij,ij->i", *(orientations(motion)[s] for s in (slice(1, None), slice(-1)))) > 0.9
    )


def test_scipy_agrees_where_it_ends():
    target = Rotation.from_rotvec([0.3, 0.2, -1.0])
    motion = aimed(target.as_quat(scalar_first=True), moving()[0].state_at(50))
    end = Rotation.from_quat(orientations(motion)[-1], scalar_first=True)
    assert (end.inv() * target).magnitude() < 1e-9


@pytest.mark.parametrize(
    "narrow", [{"velocity": 0.5}, {"velocity": [2.0, 2.0, 0.01]}, {"velocity": 1e-3}]
)
def test_limits_below_the_present_motion_are_refused_with_what_to_do(narrow):
    first, record = moving(limits=LIMITS["arm"])
    start = first.state_at(record)
    assert np.abs(start.omega_body).min() > 0.01
    request = MotionRequest([Keyframe((1.0, 0.0, 0.0, 0.0))], limits=Limits.partial(**narrow))
    with pytest.raises(LimitError, match="already moves that fast: stop it first"):
        plan(request, start=start, limits=ARM, period=PERIOD)


def test_limits_that_the_present_motion_is_just_at_are_none_to_refuse():
    first, record = moving(limits=LIMITS["arm"])
    start = first.state_at(record)
    speed = float(np.linalg.norm(start.omega_body))
    most = min(1.001 * speed, ARM.velocity)
    request = MotionRequest([Keyframe((1.0, 0.0, 0.0, 0.0))], limits=Limits.partial(velocity=most))
    motion = plan(request, start=start, limits=ARM, period=PERIOD)
    assert motion.limits.velocity == most
    assert np.abs(motion.state_at(0).omega_body - start.omega_body).max() < 1e-13


def test_what_the_way_to_the_first_keyframe_needs_slows_none_of_the_keyframes():
    limits, chance = Limits(2.0, 8.0, 80.0, 0.5, 2.0), random.Random(39)
    start = State.at_rest(HERE)
    for _ in range(7):
        steps = [[chance.uniform(-1.0, 1.0) for _ in range(3)]]
        steps += [[chance.uniform(-0.15, 0.15) for _ in range(3)] for _ in range(20)]
        keys = Rotation.from_rotvec(np.cumsum(steps[:20], axis=0)).as_quat(scalar_first=True)
        request = MotionRequest([Keyframe(tuple(q)) for q in keys.tolist()], approach=True)
        second = plan(request, start=start, limits=limits, period=PERIOD)
        at_rest = State.at_rest(start.q)
        from_rest = plan(request, start=at_rest, limits=limits, period=PERIOD)
        took = second.end_time - second.start_time
        assert took < 1.01 * (from_rest.end_time - from_rest.start_time), second.certificate.notes
        start = second.state_at(int(chance.uniform(40, 80)))
