"""One motion after another: cut corners, within the tolerance and the limits."""

import numpy as np
import pytest
from planned import LIMITS, PERIOD, differences, rotations, vector
from reference.aims import end_state, retarget

from orientd.planner import Keyframe, Limits, MotionRequest, State, blend, plan
from orientd.rotation import angle, exp, multiply

ARM = LIMITS["arm"]
HERE = np.array([1.0, 0.0, 0.0, 0.0])


def keyframe(q, **fields):
    return Keyframe(tuple(np.asarray(q).tolist()), **fields)


def first_motion(random, **fields):
    start = State.at_rest(rotations(random, 2, 1.0)[0])
    target = multiply(start.q, exp(vector(random, 1.2)))
    return retarget(target, start=start, limits=ARM, period=PERIOD, **fields)


def blended(first, request, tolerance, **fields):
    return blend(
        first.recorded(), request, tolerance=tolerance, limits=ARM, period=PERIOD, **fields
    )


def records(first, record, second):
    assert second.records(0, 1) == pytest.approx(
        first.records(record, 1), rel=1e-9, abs=1e-9, nan_ok=True
    )
    return np.concatenate([first.records(0, record), second.records(0, second.record_count)])


def assert_limits_are_kept(q):
    rates = differences(q, PERIOD)
    limits = ARM.velocity, ARM.acceleration, ARM.jerk
    for rate, limit in zip(rates, limits, strict=True):
        assert rate.max() <= 1.001 * limit


def test_a_blend_passes_the_corner_within_the_tolerance_without_resting():
    random = np.random.default_rng(2)
    for tolerance in (0.01, 0.05, 0.2):
        for _ in range(4):
            first = first_motion(random)
            corner = first.path.last
            target = multiply(corner, exp(vector(random, 1.0)))
            record, second = blended(first, MotionRequest([keyframe(target)]), tolerance)
            sent = records(first, record, second)
            assert record < first.record_count - 1
            assert angle(sent[:, :4], corner).min() <= tolerance
            near = np.flatnonzero(angle(sent[:, :4], corner) < 0.1 + tolerance)
            assert np.linalg.norm(sent[near, 4:7], axis=1).min() > 0.02
            assert angle(second.path.last, target) < 1e-9
            assert_limits_are_kept(sent[:, :4])


def test_a_motion_at_its_highest_velocity_is_blended_too():
    slow = Limits.partial(velocity=0.2)
    request = MotionRequest([keyframe(exp([0.0, 0.0, 1.0]))], limits=slow)
    first = plan(request, start=State.at_rest(HERE), limits=ARM, period=PERIOD)
    target = multiply(first.path.last, exp([0.8, 0.0, 0.0]))
    record, second = blended(first, MotionRequest([keyframe(target)], limits=slow), 0.05)
    assert record < first.record_count - 1
    assert second.corner[1] <= 0.05


@pytest.mark.parametrize("fields", [{"pace": "even"}, {"pace": 0.6}, {"duration": 2.5}, {}])
def test_a_blend_keeps_to_the_times_or_the_pace_that_was_asked_for(fields):
    random = np.random.default_rng(12)
    first = first_motion(random)
    q = [first.path.last]
    for turn in ([0.3, 0.6, 0.0], [0.0, 0.5, 0.4]):
        q.append(multiply(q[-1], exp(turn)))
    times = (0.0, 1.5, 2.5) if not fields else (None,) * 3
    keys = [keyframe(key, time=time) for key, time in zip(q, times, strict=True)]
    request = MotionRequest(keys, **fields)
    alone = blended(first, request, 0.0)[1]
    record, second = blended(first, request, 0.1)
    assert record < first.record_count - 1
    assert np.diff(second.keyframe_times[1:]) == pytest.approx(np.diff(alone.keyframe_times[1:]))


def test_a_wider_tolerance_is_never_slower():
    random = np.random.default_rng(3)
    first = first_motion(random)
    request = MotionRequest([keyframe(multiply(first.path.last, exp(vector(random, 1.0))))])
    lengths = []
    for tolerance in (0.0, 0.01, 0.03, 0.1, 0.3):
        record, second = blended(first, request, tolerance)
        lengths.append(record + second.record_count)
    assert lengths == sorted(lengths, reverse=True)
    assert lengths[-1] < lengths[0]


def test_the_certificate_notes_the_blend():
    first = first_motion(np.random.default_rng(4))
    request = MotionRequest([keyframe(HERE)])
    _, second = blended(first, request, 0.1)
    assert "passes the corner at" in second.certificate.notes[-1]
    assert not blended(first, request, 0.0)[1].certificate.notes


def test_without_tolerance_the_motions_meet_at_rest():
    first = first_motion(np.random.default_rng(5))
    record, second = blended(first, MotionRequest([keyframe(HERE)]), 0.0)
    assert record == first.record_count - 1
    assert second.start_state.is_at_rest


def test_a_blend_leaves_no_earlier_than_it_may():
    first = first_motion(np.random.default_rng(6))
    request = MotionRequest([keyframe(HERE)])
    early, _ = blended(first, request, 0.2)
    late, _ = blended(first, request, 0.2, earliest=early + 20)
    assert late >= early + 20


def test_keyframes_beyond_the_corner_are_met():
    random = np.random.default_rng(7)
    first = first_motion(random)
    keys = [first.path.last]
    for _ in range(4):
        keys.append(multiply(keys[-1], exp(vector(random, 0.5))))
    record, second = blended(first, MotionRequest([keyframe(q) for q in keys]), 0.05)
    assert record < first.record_count - 1
    met = second.sample(second.keyframe_times).q
    assert angle(met, np.array(keys))[1:].max() < 1e-9
    assert angle(met, np.array(keys))[0] <= 0.05
    assert_limits_are_kept(records(first, record, second)[:, :4])


def test_an_equal_velocity_at_the_corner_goes_on_without_a_lead():
    turn = exp([0.0, 0.0, 0.4])
    keys = [HERE]
    for _ in range(4):
        keys.append(multiply(keys[-1], turn))
    ahead = MotionRequest([keyframe(q) for q in keys[:3]], end_velocity=(0.0, 0.0, 0.8))
    first = plan(ahead, start=State.at_rest(HERE), limits=ARM, period=PERIOD)
    request = MotionRequest([keyframe(q) for q in keys[2:]], start_velocity=(0.0, 0.0, 0.8))
    record, second = blended(first, request, 0.0)
    assert record * PERIOD == pytest.approx(first.end_time)
    sent = records(first, record, second)
    assert second.sample([0.0]).alpha_body[0] == pytest.approx(
        end_state(first).alpha_body, abs=1e-6
    )
    assert_limits_are_kept(sent[:, :4])


def test_the_position_rides_along():
    random = np.random.default_rng(8)
    first = first_motion(random, position=(0.2, 0.1, 0.0))
    request = MotionRequest([keyframe(HERE, position=(0.2, 0.4, 0.1))])
    record, second = blended(first, request, 0.2)
    assert record < first.record_count - 1
    p = records(first, record, second)[:, 10:13]
    velocity = np.diff(p, axis=0) / PERIOD
    acceleration = np.diff(velocity, axis=0) / PERIOD
    assert np.linalg.norm(velocity, axis=1).max() <= 1.001 * ARM.linear_velocity
    assert np.linalg.norm(acceleration, axis=1).max() <= 1.001 * ARM.linear_acceleration
    # There is no limit of its jerk, but no step either, where the motion is taken over or later.
    assert np.linalg.norm(np.diff(acceleration, axis=0), axis=1).max() < 1.5
    fine = PERIOD / 8.0
    p_fine = second.sample(np.arange(0.0, second.duration, fine)).position
    steps = np.diff(p_fine, n=3, axis=0) / fine**2
    assert np.linalg.norm(steps, axis=1).max() < 0.5
    assert p[-1] == pytest.approx([0.2, 0.4, 0.1])


def test_nonsense_is_refused():
    first = first_motion(np.random.default_rng(9))
    request = MotionRequest([keyframe(HERE)])
    with pytest.raises(ValueError, match="tolerance must be"):
        blended(first, request, -1.0)
    with pytest.raises(ValueError, match="period must be that of the first motion"):
        blend(first.recorded(), request, tolerance=0.1, limits=ARM, period=0.004)
