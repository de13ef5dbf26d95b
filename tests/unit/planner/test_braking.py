"""Moving ends with more time than a curve can use: the device brakes, rests, and runs up again."""

from dataclasses import replace

import numpy as np
import pytest
from asked import asked, made
from bench.single_requests import PERIOD, Case, _angles, faults, further, plans
from bench.single_requests import planned as planned_case

from orientd.errors import PlanError
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State

SOFT, QUICK = Limits(1.0, 1.0, 1.0, 1.0, 10.0), Limits(3.0, 30.0, 30.0, 1.0, 10.0)
HALF = Keyframe(rotation_vector=(0.0, 0.0, 0.5))
ORIGIN = Keyframe((1.0, 0.0, 0.0, 0.0))
RATE = (0.0, 0.0, 1.0)


def planned(keyframes, start=None, end=None, limits=DEFAULT_LIMITS, **fields):
    request = MotionRequest(
        keyframes, start_velocity=start, end_velocity=end, approach=start is not None, **fields
    )
    place = keyframes[0].position or (0.0, 0.0, 0.0)
    return plan(request, start=State.at_rest(keyframes[0].q, place), limits=limits, period=PERIOD)


def check(motion, limits=DEFAULT_LIMITS):
    """Hold the setpoints against limits, keyframes, velocities and the short way."""
    case = Case("", 0, "", motion.request, motion.start_state, limits)
    assert faults(motion, case) == []


def length(motion):
    """Return the path between the first and the last keyframe, rad."""
    rows = motion.rows(0, motion.record_count)[:, :4]
    first, last = round(motion.start_time / PERIOD), round(motion.end_time / PERIOD)
    return float(_angles(rows[first:last], rows[first + 1 : last + 1]).sum())


@pytest.mark.parametrize(
    "fields",
    [
        {"duration": 10.0},
        {"duration": 11.0},
        {"duration": 100.0},
        {"duration": 11.0, "pace": "even"},
        {"duration": 11.0, "method": "kks_hermite"},
        {"duration": 30.0, "method": "kks_hermite_spline"},
    ],
)
def test_a_long_duration_between_two_velocities_adds_no_turn(fields):
    motion = planned([ORIGIN, HALF], RATE, RATE, **fields)
    assert motion.end_time - motion.start_time == pytest.approx(fields["duration"], rel=1e-9)
    assert length(motion) < 0.6
    check(motion)


@pytest.mark.parametrize(("start", "end"), [(RATE, None), (None, RATE)])
def test_a_long_duration_next_to_one_velocity_adds_no_turn(start, end):
    motion = planned([ORIGIN, HALF], start, end, duration=50.0)
    assert length(motion) < 0.7
    check(motion)


def test_times_far_apart_add_no_turn():
    rate = (0.0, 0.0, np.radians(15.0))
    keyframes = [
        Keyframe(time=0.0, euler={"axes": "z", "degrees": [-30.0]}),
        Keyframe(time=60.0, euler={"axes": "z", "degrees": [30.0]}),
    ]
    motion = planned(keyframes, rate, rate)
    assert motion.keyframe_times - motion.start_time == pytest.approx([0.0, 60.0])
    assert length(motion) < 1.1
    check(motion)


def test_inner_keyframes_keep_their_times():
    vectors, times = [0.0, 0.1, 0.3, 0.2, 0.5], [0.0, 30.0, 32.0, 34.0, 64.0]
    keyframes = [
        Keyframe(rotation_vector=(0.0, 0.3 * z, z), time=time)
        for z, time in zip(vectors, times, strict=True)
    ]
    motion = planned(keyframes, RATE, RATE)
    assert motion.keyframe_times - motion.start_time == pytest.approx(times)
    assert any("brakes next to its moving ends" in one for one in motion.certificate.notes)
    assert length(motion) < 2.0
    check(motion)


def test_requested_whole_turns_are_still_made():
    turned = replace(HALF, turns=1)
    motion = planned([ORIGIN, turned], RATE, RATE, duration=40.0)
    assert length(motion) == pytest.approx(2.0 * np.pi + 0.5, abs=0.2)


@pytest.mark.parametrize("duration", [None, 5.0, 30.0])
@pytest.mark.parametrize(
    ("limits", "turn", "place", "rate"),
    [(QUICK, 0.3, (0.0, 0.0, 0.0), 2.1), (SOFT, 0.3, (0.05, 0.0, 0.0), 0.7)],
)
def test_keyframes_with_positions_may_end_in_motion(limits, turn, place, rate, duration):
    keyframes = [
        Keyframe((1.0, 0.0, 0.0, 0.0), position=(0.0, 0.0, 0.0)),
        Keyframe(rotation_vector=(0.0, 0.0, turn), position=place),
    ]
    motion = planned(keyframes, None, (0.0, 0.0, rate), limits, duration=duration)
    check(motion, limits)
    at = motion.sample(motion.keyframe_times).position
    assert at == pytest.approx(np.array([(0.0, 0.0, 0.0), place]), abs=1e-12)


@pytest.mark.parametrize("turns", [1, 2, 3, -2, 8])
def test_each_of_many_whole_turns_is_made(turns):
    keys = [ORIGIN, Keyframe(rotation_vector=(0.3, 0.1, 0.0))]
    keys.append(Keyframe(rotation_vector=(0.5, -0.2, 0.1), turns=turns))
    motion = planned(keys, limits=QUICK)
    _, before, after = motion.path.trajectory.turned(motion.keyframe_times)
    assert np.pi * (2 * abs(turns) - 1) < after - before < np.pi * (2 * abs(turns) + 1)


def test_whole_turns_may_end_in_motion():
    request, limits, _ = asked("turns_and_end_velocity")
    with pytest.raises(PlanError, match=r"take at least (\d+\.\d+) s, got") as caught:
        made("turns_and_end_velocity")
    least = float(str(caught.value).split("at least ")[1].split(" s")[0])
    motion = made("turns_and_end_velocity", duration=least * 1.0001)
    assert motion.end_time - motion.start_time == pytest.approx(least * 1.0001)
    assert not any("limit" in one for one in faults(motion, Case("", 0, "", request, None, limits)))


def test_whole_turns_may_begin_in_motion():
    request, limits, period = asked("turns_and_end_velocity")
    turns = [one.turns for one in request.keyframes]
    keyframes = [
        replace(one, turns=count) for one, count in zip(request.keyframes[::-1], turns, strict=True)
    ]
    request = replace(
        request, keyframes=keyframes, start_velocity=request.end_velocity, end_velocity=None,
        approach=True, duration=28.7,
    )  # fmt: skip
    start = State.at_rest(request.keys[0])
    motion = plan(request, start=start, limits=limits, period=period)
    assert any(one.startswith("waits at the end") for one in motion.certificate.notes)
    assert motion.end_time - motion.start_time == pytest.approx(28.7)
    assert motion.keyframe_times[-1] == pytest.approx(motion.end_time)


@pytest.mark.parametrize("factor", [1.0, 1.02, 1.1, 1.2, 1.4, 3.0])
def test_every_duration_from_the_quickest_on_is_planned_next_to_one_velocity(factor):
    request, limits, _ = asked("between_two_durations")
    quickest = made("between_two_durations", duration=None)
    duration = factor * (quickest.end_time - quickest.start_time)
    motion = made("between_two_durations", duration=duration)
    assert motion.end_time - motion.start_time == pytest.approx(duration, rel=1e-9)
    check(motion, limits)
    assert motion.request.keyframes == request.keyframes


@pytest.mark.parametrize("factor", [1.0, 1.02, 1.1])
def test_a_duration_just_above_the_quickest_leaves_a_rest_after_the_connector(factor):
    velocity = (1.7, 0.0, 0.0)
    quickest = planned([ORIGIN, HALF], velocity, limits=QUICK)
    seconds = factor * (quickest.end_time - quickest.start_time)
    motion = planned([ORIGIN, HALF], velocity, limits=QUICK, duration=seconds)
    check(motion, QUICK)
    assert motion.end_time - motion.start_time == pytest.approx(seconds)


def test_a_duration_below_the_quickest_is_refused_with_the_quickest():
    request, limits, period = asked("two_fast_ends_of_a_pair")
    start = State.at_rest(request.keys[0])

    def of(duration):
        asked_for = replace(request, duration=duration)
        return plan(asked_for, start=start, limits=limits, period=period)

    quickest = of(None)
    took = quickest.end_time - quickest.start_time
    with pytest.raises(PlanError, match=rf"take at least {took:.6g} s, got a duration"):
        of(0.5 * took)
    check(of(1.3 * took), limits)


@pytest.mark.parametrize(
    ("name", "moves"),
    [
        ("two_fast_ends", 115.9),
        ("two_fast_ends_of_a_pair", 94.9),
        ("two_fast_ends_of_near_keyframes", 47.1),
    ],
)
def test_two_fast_ends_take_hardly_longer_than_single_moves(name, moves):
    # With a rest at every keyframe, and the same lead-in and lead-out.
    assert made(name).duration < 1.15 * moves


def test_a_stop_may_take_as_long_as_the_page_on_limits_says():
    for name in ("stop_in_lead_out", "slow_to_stop"):
        motion = made(name)
        assert 1.0 / motion.certificate.brake_rate <= 24.0
    assert 1.0 / made("slow_to_stop").certificate.brake_rate > 4.0
    request, limits, _ = asked("stop_in_lead_out")
    check(made("stop_in_lead_out"), limits)
    assert request.has_times


def test_a_turn_that_must_be_is_named():
    # From 9 rad/s with 0.5 rad/s^2 a device turns by 81 rad until it rests.
    limits = Limits(10.0, 0.5, 5.0, 1.0, 10.0)
    motion = planned([ORIGIN, HALF], (0.0, 0.0, 9.0), None, limits)
    (note,) = [one for one in motion.certificate.notes if "more than the short way" in one]
    assert "between keyframes[0] and keyframes[1]" in note
    named = float(note.split()[1])
    rows = motion.rows(0, motion.record_count)[:, :4]
    keys = np.array([one.q for one in motion.request.keyframes])
    ends = motion.start_time, motion.end_time
    far = further(rows, keys, *ends, (None, None), limits, PERIOD)
    assert named == pytest.approx(far, rel=0.01)
    assert named > 80.0


def test_the_short_way_has_no_note():
    for motion in (planned([ORIGIN, HALF]), planned([ORIGIN, HALF], RATE, RATE)):
        assert motion.certificate.notes == ()


def test_times_without_room_to_brake_are_refused_as_before():
    keyframes = [replace(ORIGIN, time=0.0), replace(HALF, time=0.3)]
    with pytest.raises(PlanError, match="tried before: a stop next to the moving ends"):
        planned(keyframes, (0.0, 0.9, 0.0), None, SOFT)


@pytest.mark.parametrize("seed", [52, 122, 127, 227])
def test_times_that_single_moves_meet_are_planned_on_a_device_that_is_slow_to_stop(seed):
    case = plans(seed, "times")
    limits, motion = case.limits, planned_case(case)
    assert faults(motion, case) == []
    ends = filter(None, (case.request.start_velocity, case.request.end_velocity))
    run_up = max(np.linalg.norm(omega) for omega in ends) / limits.acceleration
    rise = limits.acceleration / limits.jerk
    assert 24.0 < 1.0 / motion.certificate.brake_rate <= 5.0 * (run_up + rise)
