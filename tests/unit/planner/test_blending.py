"""One motion after another: cut corners, within the tolerance and the limits."""

from itertools import pairwise

import numpy as np
import pytest
from planned import LIMITS, PERIOD, differences, rotations, vector
from reference.aims import end_state, retarget

from orientd.errors import StartError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.blending import NOT_BLENDED, blend
from orientd.planner.planning import plan
from orientd.planner.state import State
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
    assert record == first.recorded().last_record + 3
    assert second.start_state.is_at_rest


def test_a_blend_leaves_no_earlier_than_it_may():
    first = first_motion(np.random.default_rng(6))
    request = MotionRequest([keyframe(HERE)])
    early, _ = blended(first, request, 0.2)
    late, _ = blended(first, request, 0.2, earliest=early + 20)
    assert late >= early + 20


def beyond_the_corner(seed):
    """Return a motion, the record where a blend leaves it, the next motion and its keyframes."""
    random = np.random.default_rng(seed)
    first = first_motion(random)
    keys = [first.path.last]
    for _ in range(4):
        keys.append(multiply(keys[-1], exp(vector(random, 0.5))))
    record, second = blended(first, MotionRequest([keyframe(q) for q in keys]), 0.05)
    assert record < first.record_count - 1
    return first, record, second, keys


@pytest.mark.parametrize("seed", range(8))
def test_the_time_of_the_first_keyframe_is_that_of_the_corner(seed):
    *_, second, keys = beyond_the_corner(seed)
    passed, gap = second.corner
    assert second.keyframe_times[0] == pytest.approx(passed)
    assert angle(second.sample(np.array([passed])).q[0], keys[0]) == pytest.approx(gap, abs=1e-3)


def test_keyframes_beyond_the_corner_are_met():
    first, record, second, keys = beyond_the_corner(7)
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


X, Y, Z = np.eye(3)
LEGS = [HERE, exp(Z), multiply(exp(Z), exp(0.8 * X))]
PLACES = [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.1, 0.1, 0.0)]
SLOW = {
    "a pace": {"pace": 0.12},
    "a velocity": {"limits": Limits.partial(velocity=0.3)},
    "a duration": {"duration": 3.5},
    "times": {"times": (0.0, 3.5)},
}


def legs(*, has_positions=False, times=(None, None)):
    """Return the keyframes of two motions that meet at a right angle."""
    places = PLACES if has_positions else [None] * 3
    first = [
        keyframe(*pose[:1], position=pose[1], time=time)
        for *pose, time in zip(LEGS[:2], places[:2], times, strict=True)
    ]
    second = [keyframe(q, position=place) for q, place in zip(LEGS[1:], places[1:], strict=True)]
    return first, second


def slow_and_quick(tolerance, slow, timing=None, **options):
    fields = dict(slow)
    keys, following = legs(times=fields.pop("times", (None, None)), **options)
    start = State.at_rest(HERE, PLACES[0])
    first = plan(MotionRequest(keys, **fields), start=start, limits=ARM, period=PERIOD)
    request = MotionRequest(following, approach=True, **(timing or {}))
    return first, *blended(first, request, tolerance, earliest=50)


def off_the_legs(sent):
    """Return the farthest distances of setpoints from two straight legs, rad and m."""
    shares = np.linspace(0.0, 1.0, 2000)[:, None]
    turns = np.concatenate([exp(shares * Z), multiply(LEGS[1], exp(0.8 * shares * X))])
    corners = np.array(PLACES)
    moves = np.concatenate([a + shares * (b - a) for a, b in pairwise(corners)])
    some = sent[::5]
    away = 2.0 * np.arccos(np.minimum(np.abs(some[:, :4] @ turns.T), 1.0)).min(axis=1)
    moved = np.linalg.norm(some[:, None, 10:13] - moves, axis=2).min(axis=1)
    return away.max(), moved.max()


@pytest.mark.parametrize("tolerance", [0.0873, 0.02])
@pytest.mark.parametrize("has_positions", [False, True])
@pytest.mark.parametrize("slow", SLOW)
def test_a_blend_into_a_quicker_motion_stays_near_both(slow, has_positions, tolerance):
    first, record, second = slow_and_quick(tolerance, SLOW[slow], has_positions=has_positions)
    sent = records(first, record, second)
    away, moved = off_the_legs(sent)
    assert record < first.record_count - 1
    assert away <= 1.01 * tolerance + 1e-3
    if has_positions:
        assert moved <= 1.01 * tolerance * 0.1 / 0.8 + 1e-4


def test_a_blend_into_a_motion_with_an_even_pace_stays_near_both():
    first, record, second = slow_and_quick(0.02, SLOW["times"], {"pace": "even"})
    away, _ = off_the_legs(records(first, record, second))
    assert record < first.record_count - 1
    assert away <= 1.01 * 0.02 + 1e-3


@pytest.mark.parametrize("slow", SLOW)
def test_up_to_the_corner_a_blend_is_no_faster_than_the_motion_before(slow):
    first, record, second = slow_and_quick(0.0873, SLOW[slow])
    q = records(first, record, second)[:, :4]
    corner = record + int(second.corner[0] / PERIOD)
    speeds = differences(q, PERIOD)[0][3:]
    usual = np.linalg.norm(first.rows(0, first.record_count)[:, 4:7], axis=1).max()
    assert speeds[:corner].max() <= 1.011 * usual
    assert speeds.max() > 2.0 * usual


def test_up_to_the_corner_a_blend_keeps_the_acceleration_of_the_motion_before():
    slow = {"limits": Limits.partial(velocity=0.3, acceleration=2.0)}
    first, record, second = slow_and_quick(0.0873, slow)
    assert record < first.record_count - 1
    corner = record + int(second.corner[0] / PERIOD)
    change = np.linalg.norm(
        np.diff(records(first, record, second)[: corner + 1, 4:7], axis=0), axis=1
    )
    assert change.max() <= 1.001 * 2.0 * PERIOD


def test_a_motion_of_narrower_limits_begins_from_rest():
    keys, following = legs()
    start = State.at_rest(HERE)
    first = plan(MotionRequest(keys), start=start, limits=ARM, period=PERIOD)
    for narrow in ({"acceleration": 1.0}, {"jerk": 30.0}, {"acceleration": 5.0, "jerk": 4000.0}):
        request = MotionRequest(following, approach=True, limits=Limits.partial(**narrow))
        corner = State.at_rest(LEGS[1])
        alone = plan(request, start=corner, limits=ARM, period=PERIOD)
        record, second = blended(first, request, 0.0)
        assert record == first.recorded().last_record + 3
        assert second.duration == alone.duration


@pytest.mark.parametrize("has_positions", [False, True])
@pytest.mark.parametrize("fraction", [0.0, 0.0007, 1e-7, 0.00199])
def test_an_end_velocity_is_joined_wherever_the_motion_ends(fraction, has_positions):
    end = 1.2 + fraction
    keys = [exp(angle * Z) for angle in (0.0, 0.5, 1.0)]
    places = PLACES if has_positions else [None] * 3
    ahead, behind = (
        [
            keyframe(keys[k], position=places[k], time=time)
            for k, time in zip(some, times, strict=True)
        ]
        for some, times in (((0, 1), (0.0, end)), ((1, 2), (0.0, 1.1)))
    )
    ahead = MotionRequest(ahead, end_velocity=(0.0, 0.0, 0.5))
    start = State.at_rest(HERE, PLACES[0])
    first = plan(ahead, start=start, limits=ARM, period=PERIOD)
    request = MotionRequest(behind, start_velocity=(0.0, 0.0, 0.5))
    record, second = blended(first, request, 0.0)
    assert record * PERIOD <= end
    sent = records(first, record, second)
    assert_limits_are_kept(sent[:, :4])
    # The corner is passed at its time, with its velocity, and the second motion has its times.
    assert record * PERIOD + second.start_time == pytest.approx(end, abs=1e-9)
    assert second.end_time - second.start_time == pytest.approx(1.1, abs=1e-9)
    passed = second.sample([second.start_time])
    assert angle(passed.q[0], keys[1]) < 1e-9
    assert passed.omega_body[0] == pytest.approx((0.0, 0.0, 0.5), abs=1e-9)
    if has_positions:
        assert passed.position[0] == pytest.approx(PLACES[1], abs=1e-9)


def test_a_motion_that_comes_too_late_for_an_end_velocity_is_refused_for_that():
    keys = [exp(angle * Z) for angle in (0.0, 0.5, 1.0)]
    ahead = MotionRequest([keyframe(q) for q in keys[:2]], end_velocity=(0.0, 0.0, 0.5))
    first = plan(ahead, start=State.at_rest(HERE), limits=ARM, period=PERIOD)
    request = MotionRequest([keyframe(q) for q in keys[1:]], start_velocity=(0.0, 0.0, 0.5))
    with pytest.raises(StartError, match="too late to begin with the end velocity"):
        blended(first, request, 0.0, earliest=int(first.end_time / PERIOD) + 1)


def test_a_second_blend_begins_behind_the_first_one():
    """Before that, the device is off the motion that it leaves."""
    keys = [HERE]
    for turn in (0.8 * Z, 1.0 * X, 0.8 * Y):
        keys.append(multiply(keys[-1], exp(turn)))
    requests = [MotionRequest([keyframe(q)]) for q in keys[1:]]
    first = plan(requests[0], start=State.at_rest(HERE), limits=ARM, period=PERIOD)
    _, second = blended(first, requests[1], 0.05)
    record, third = blended(second, requests[2], 0.05)
    assert third.corner is not None
    assert second.joined > second.corner[0]
    assert record * PERIOD >= second.joined - 1e-9


@pytest.mark.parametrize(
    ("keys", "fields", "tolerance", "earliest", "why"),
    [
        ([LEGS[1], LEGS[2]], {}, 0.1, 10_000, "too late"),
        ([LEGS[1], LEGS[2]], {}, 1e-6, 276, "in the 0.002 s that were left of it"),
        ([LEGS[1], LEGS[1]], {}, 0.1, 0, "the orientation changes on one side of the corner only"),
        ([LEGS[1], LEGS[2]], {"acceleration": 0.3}, 0.1, 0, "keeps the limits of both"),
        ([LEGS[1], LEGS[2]], {"acceleration": 0.01}, 0.1, 0, "is further than 0.1 rad"),
    ],
)
def test_a_stop_for_want_of_a_blend_is_noted_with_its_reason(
    keys, fields, tolerance, earliest, why
):
    first, _ = legs(has_positions=True)
    start = State.at_rest(HERE, PLACES[0])
    first = plan(MotionRequest(first), start=start, limits=ARM, period=PERIOD)
    poses = zip(keys, PLACES[1:], strict=True)
    request = MotionRequest(
        [keyframe(q, position=place) for q, place in poses],
        approach=True,
        limits=Limits.partial(**fields) if fields else None,
    )
    record, second = blended(first, request, tolerance, earliest=earliest)
    assert record == first.recorded().last_record + 3
    (note,) = (one for one in second.certificate.notes if one.startswith(NOT_BLENDED))
    assert why in note


def test_a_tolerance_too_small_for_any_blend_is_named():
    first, record, second = slow_and_quick(1e-7, SLOW["a pace"], has_positions=True)
    assert record == first.recorded().last_record + 3
    assert "is further than 1e-07 rad or" in second.certificate.notes[-1]


def test_nonsense_is_refused():
    first = first_motion(np.random.default_rng(9))
    request = MotionRequest([keyframe(HERE)])
    with pytest.raises(ValueError, match="tolerance must be"):
        blended(first, request, -1.0)
    with pytest.raises(ValueError, match="period must be that of the first motion"):
        blend(first.recorded(), request, tolerance=0.1, limits=ARM, period=0.004)
