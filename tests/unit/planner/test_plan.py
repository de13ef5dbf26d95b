import math
import re

import numpy as np
import pytest
from planned import LIMITS, PERIOD, differences, times_of
from reference.aims import end_state

from orientd.curves import Trajectory
from orientd.errors import LimitError, PlanError, RequestError, StartError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import angle, exp, multiply, rotate

ARM = LIMITS["arm"]
HERE = np.array([1.0, 0.0, 0.0, 0.0])


def at(*vectors, times=None, positions=None):
    """Return keyframes at rotation vectors."""
    return [
        Keyframe(
            tuple(exp(v).tolist()),
            None if times is None else times[k],
            None if positions is None else positions[k],
        )
        for k, v in enumerate(vectors)
    ]


X, Y, Z = np.eye(3)
ZERO = np.zeros(3)
WAY = (ZERO, 0.4 * X, 0.4 * X + 0.3 * Y, 0.5 * Z)


def made(keyframes, start=None, limits=ARM, period=PERIOD, **fields):
    request = MotionRequest(keyframes, **fields)
    start = start or State.at_rest(request.keys[0])
    return plan(request, start=start, limits=limits, period=period)


# Beginning


def test_a_motion_begins_in_the_state_the_device_is_commanded_to_be_in():
    motion = made(at(*WAY))
    assert motion.start_time == 0.0
    assert motion.certificate.lead_in == 0.0
    state = motion.start_state
    assert angle(state.q, HERE) < 1e-12
    assert np.linalg.norm(state.omega_body) < 1e-12
    assert np.linalg.norm(state.alpha_body) < 1e-9


@pytest.mark.parametrize("times", [None, [0.0, 1.0, 2.0, 3.0]])
def test_another_orientation_is_refused_with_how_far_it_is(times):
    with pytest.raises(StartError) as caught:
        made(at(*WAY, times=times), State.at_rest(exp(0.1 * X)))
    assert str(caught.value) == (
        "the first keyframe differs from the commanded state of the device: orientation "
        "by 0.1 rad (5.73 deg); set `approach: true` to plan a lead-in"
    )


def test_another_position_is_refused_with_how_far_it_is():
    keyframes = at(*WAY, positions=[(0.1 * k, 0, 0) for k in range(4)])
    with pytest.raises(StartError, match=r"position by 0\.5 m; set `approach"):
        made(keyframes, State.at_rest(HERE, (0.0, 0.5, 0.0)))


def test_a_velocity_from_rest_is_refused_without_an_approach():
    with pytest.raises(StartError, match=r"angular velocity by 0\.5 rad/s"):
        made(at(*WAY), start_velocity=(0, 0, 0.5))


def test_the_sign_of_the_commanded_quaternion_makes_no_difference():
    assert made(at(*WAY), State.at_rest(-HERE)).start_time == 0.0


def test_a_difference_of_rounding_is_let_pass_and_counted():
    start = State.at_rest(exp(5e-7 * X))
    motion = made(at(*WAY), start)
    assert motion.certificate.lead_in == 0.0
    q = motion.records(0, motion.record_count)[:, :4]
    _, _, jerk = differences(q, PERIOD, start=start.q)
    assert motion.certificate.peak_jerk.on_records == pytest.approx(jerk.max(), rel=1e-6)


def test_an_approach_leads_in_from_wherever_the_device_is():
    start = State.at_rest(exp(1.0 * Y), (0.2, 0.1, 0.0))
    keyframes = at(*WAY, positions=[(0.1 * k, 0, 0) for k in range(4)])
    motion = made(keyframes, start, start_velocity=(0.3, 0, 0), approach=True)
    first = motion.sample([0.0])
    assert angle(first.q[0], start.q) < 1e-12
    assert first.position[0] == pytest.approx(start.position)
    assert not first.omega_body.any()
    arrival = motion.sample([motion.start_time])
    assert angle(arrival.q[0], HERE) < 1e-12
    assert arrival.omega_body[0] == pytest.approx([0.3, 0, 0], abs=1e-12)
    assert arrival.position[0] == pytest.approx([0, 0, 0], abs=1e-12)
    assert motion.certificate.lead_in > 0.0 == motion.sample([motion.duration]).omega_body.max()


def test_the_position_waits_while_the_orientation_takes_its_run_up():
    keyframes = at(*WAY, positions=[(0.1 * k, 0, 0) for k in range(4)])
    start = State.at_rest(HERE, (0.2, 0.1, 0.0))
    motion = made(keyframes, start, start_velocity=(0.3, 0, 0), approach=True)
    lead_in = motion.sample(np.linspace(0.0, motion.start_time, 4000))
    speeds = np.linalg.norm(lead_in.omega_body, axis=1)
    run_up = int(np.flatnonzero(speeds <= 1e-3 * speeds.max())[-1])
    assert 0 < run_up < 3900
    assert lead_in.position[run_up:] == pytest.approx(np.zeros((4000 - run_up, 3)), abs=1e-15)


def test_an_approach_that_is_not_needed_is_left_out():
    motion = made(at(*WAY), approach=True)
    assert motion.start_time == motion.certificate.lead_in == 0.0


def test_a_run_up_from_where_it_begins_needs_no_approach():
    asked = {"start_velocity": (0, 0, 0.4), "approach": True, "pace": "even"}
    planned = made(at(*WAY), State.at_rest(exp(0.3 * Y)), **asked)
    times = np.linspace(0.0, planned.start_time, 20_000)
    speeds = np.linalg.norm(planned.sample(times).omega_body, axis=1)
    begin = float(times[np.flatnonzero(speeds <= 1e-6)[-1]])
    rest = planned.sample([begin]).q[0]
    motion = made(at(*WAY), State.at_rest(rest), **asked)
    assert motion.start_time < planned.start_time
    assert motion.start_time == pytest.approx(planned.start_time - begin, abs=2 * PERIOD)


def test_a_motion_takes_over_from_one_that_is_still_moving():
    first = made(at(ZERO, 0.3 * X, 0.5 * X, times=[0, 0.5, 1.0]), end_velocity=(0.6, 0.1, 0))
    end = end_state(first)
    further = multiply(end.q, exp([0.4, 0.2, 0.1]))
    keyframes = [Keyframe(tuple(end.q), 0.0), Keyframe(tuple(further), 1.0)]
    second = made(keyframes, end, start_velocity=tuple(end.omega_body))
    begin = second.start_state
    assert angle(begin.q, end.q) < 1e-12
    assert begin.omega_body == pytest.approx(end.omega_body, abs=1e-11)
    assert begin.alpha_body == pytest.approx(end.alpha_body, abs=1e-8)
    # The velocity need not be said again.
    assert made(keyframes, end).start_state.omega_body == pytest.approx(end.omega_body)
    # The two together, as the device sees them, keep the limits where they meet.
    before = first.sample(first.end_time - PERIOD * np.arange(5, 0, -1.0)).q
    after = second.sample(PERIOD * np.arange(60.0)).q
    joint = np.concatenate([before, after])
    _, acceleration, jerk = (rates[5:-5] for rates in differences(joint, PERIOD))
    assert acceleration.max() < ARM.acceleration
    assert jerk.max() < ARM.jerk


def test_a_device_that_moves_otherwise_is_led_in_if_asked_for():
    moving = State(HERE, np.array([0, 0, 0.2]), ZERO, ZERO)
    with pytest.raises(StartError, match=r"angular velocity by 0\.3 rad/s; set `approach: true`"):
        made(at(*WAY), moving, start_velocity=(0, 0, 0.5))
    motion = made(at(*WAY), moving, start_velocity=(0, 0, 0.5), approach=True)
    assert motion.start_state.omega_body == pytest.approx([0, 0, 0.2])


# Ending


def test_a_motion_that_ends_with_velocity_gets_a_lead_out_to_rest():
    motion = made(at(*WAY), end_velocity=(0, 0.5, 0))
    assert motion.certificate.lead_out > 0.0
    assert motion.end_time + motion.certificate.lead_out == pytest.approx(motion.duration)
    end = motion.sample([motion.end_time, motion.duration])
    assert end.omega_body[0] == pytest.approx([0, 0.5, 0], abs=1e-12)
    assert not end.omega_body[1].any()


def test_a_motion_that_ends_at_rest_needs_no_lead_out():
    assert made(at(*WAY)).certificate.lead_out == 0.0


def test_the_last_record_holds_where_the_time_is_no_whole_number_of_periods():
    motion = made(at(ZERO, 0.2 * X, times=[0.0, 1.0013]))
    assert motion.end_time == pytest.approx(1.0013)
    assert motion.record_count == 502
    last = motion.records(motion.record_count - 1, 1)[0]
    assert angle(last[:4], exp(0.2 * X)) < 1e-15
    assert not last[4:10].any()


# Times


def test_times_of_the_request_are_kept_from_wherever_they_count():
    late = [1.7e9, 1.7e9 + 1.0, 1.7e9 + 2.5, 1.7e9 + 4.0]
    motion = made(at(*WAY, times=late), State.at_rest(exp(0.2 * Z)), approach=True)
    assert motion.keyframe_times - motion.start_time == pytest.approx([0.0, 1.0, 2.5, 4.0])
    assert motion.certificate.keyframe_error < 1e-9


def test_planned_times_end_on_a_record():
    motion = made(at(*WAY), end_velocity=(0, 0.5, 0))
    assert motion.end_time / PERIOD == pytest.approx(round(motion.end_time / PERIOD), abs=1e-9)


def test_repeated_keyframes_without_times_share_their_time():
    motion = made(at(ZERO, 0.4 * X, 0.4 * X, 0.8 * X))
    assert motion.keyframe_times[1] == motion.keyframe_times[2]
    assert motion.certificate.keyframe_error < 1e-9


def test_the_position_of_a_repeated_keyframe_is_not_lost():
    place = (0.3, 0.2, 0.1)
    keyframes = at(ZERO, 0.4 * X, 0.4 * X, 0.8 * X)
    q = keyframes[2].q
    keyframes[2] = Keyframe(tuple(-c for c in q), position=place)
    keyframes[0] = Keyframe(keyframes[0].q, position=(0, 0, 0))
    motion = made(keyframes, State.at_rest(HERE))
    assert motion.sample(motion.keyframe_times).position[2] == pytest.approx(place)


def test_a_pause_can_be_given_by_times():
    motion = made(at(ZERO, 0.4 * X, 0.4 * X, 0.8 * X, times=[0, 1, 2, 3]))
    assert motion.certificate.keyframe_error < 1e-9


def test_a_pure_move_of_the_position_keeps_the_linear_limits():
    keyframes = at(ZERO, ZERO, ZERO, positions=[(0, 0, 0), (0.5, 0, 0), (0.5, 0.5, 0)])
    motion = made(keyframes)
    c = motion.certificate
    ratios = c.peak_linear_velocity.ratio, c.peak_linear_acceleration.ratio
    assert 0.94 < max(ratios) <= 1.0
    assert c.peak_velocity.value == 0.0


@pytest.mark.parametrize("rate_hz", [50.0, 125.0, 300.0, 1000.0])
def test_any_rate_will_do(rate_hz):
    motion = made(at(*WAY), period=1.0 / rate_hz)
    assert motion.certificate.rate_hz == pytest.approx(rate_hz)
    assert motion.certificate.peak_velocity.ratio <= 1.0 + 1e-6


@pytest.mark.parametrize("period", [0.0, -0.1, math.nan, math.inf])
def test_a_period_is_positive(period):
    with pytest.raises(ValueError, match="period must be within 1e-05 and 1 s"):
        made(at(*WAY), period=period)


def test_motions_of_days_are_refused():
    with pytest.raises(PlanError, match="at most 86400 s"):
        made(at(ZERO, X, times=[0, 1e9]))


# Velocities


def test_world_velocities_are_met_in_the_world():
    keyframes = at(0.5 * X + 0.2 * Y, 0.9 * X, Z)
    motion = made(
        keyframes,
        start_velocity=(0.1, 0.2, 0.3),
        end_velocity=(0, 0.4, -0.2),
        velocity_frame="world",
        approach=True,
    )
    ends = motion.sample([motion.start_time, motion.end_time])
    assert rotate(ends.q, ends.omega_body) == pytest.approx(
        np.array([[0.1, 0.2, 0.3], [0, 0.4, -0.2]]), abs=1e-10
    )


# Limits


def test_a_broken_limit_names_quantity_value_limit_and_time():
    with pytest.raises(LimitError) as caught:
        made(at(ZERO, 0.3 * X, 1.5 * X, 1.8 * X, times=[10, 11, 11.5, 12.5]))
    error = caught.value
    assert error.quantity in ("angular velocity", "angular acceleration")
    assert error.value > error.limit
    assert 0.0 <= error.time <= 2.5
    assert re.search(
        r"between keyframes\[\d\] and keyframes\[\d\], at 1\d\.\d+ s of their time; "
        r"tried before: a rest at every keyframe$",
        str(error),
    )
    begin, end = map(int, re.findall(r"keyframes\[(\d)\]", str(error)))
    times = [0.0, 1.0, 1.5, 2.5]
    assert times[begin] <= error.time <= times[end]


@pytest.mark.parametrize("name", ["start_velocity", "end_velocity"])
def test_an_end_velocity_above_the_limit_is_named(name):
    with pytest.raises(LimitError, match=f"reaches 3 rad/s.*limit is 2.5 rad/s; {name} asks"):
        made(at(*WAY), approach=True, **{name: (0, 0, 3.0)})


def test_a_request_may_lower_the_limits():
    request = MotionRequest(at(*WAY), limits=Limits.partial(velocity=0.5))
    motion = plan(request, start=State.at_rest(HERE), limits=ARM, period=PERIOD)
    assert motion.limits.velocity == 0.5
    assert motion.limits.jerk == ARM.jerk
    assert motion.certificate.peak_velocity.value <= 0.5
    assert motion.certificate.peak_velocity.limit == 0.5


def test_a_request_may_not_raise_the_limits():
    request = MotionRequest(at(*WAY), limits=Limits.partial(velocity=3.0))
    with pytest.raises(RequestError, match=r"limits\.velocity: must be at most the device's 2.5"):
        plan(request, start=State.at_rest(HERE), limits=ARM, period=PERIOD)


def test_linear_limits_are_kept_or_the_motion_is_refused():
    positions = [(0, 0, 0), (0.5, 0, 0), (0, 0, 0.5), (0, 0, 0)]
    with pytest.raises(LimitError, match=r"of the position reaches .* m/s"):
        made(at(*WAY, times=[0, 0.6, 1.2, 1.8], positions=positions))
    motion = made(at(*WAY, positions=positions))
    position = motion.sample(times_of(motion)).position
    v = np.linalg.norm(np.diff(position, axis=0), axis=1) / PERIOD
    a = np.linalg.norm(np.diff(position, n=2, axis=0), axis=1) / PERIOD**2
    assert v.max() <= ARM.linear_velocity * (1 + 1e-6)
    assert a.max() <= ARM.linear_acceleration * (1 + 1e-6)
    assert motion.certificate.peak_linear_velocity.on_records == pytest.approx(v.max(), rel=1e-6)


def test_a_motion_of_the_users_that_could_hardly_be_stopped_is_refused():
    # A turn about one axis whose largest acceleration, with velocity, is right at the limit.
    shape = made(at(ZERO, X, times=[0.0, 2.0]), method="kks_quintic_hermite")
    tight = Limits(10.0, shape.certificate.peak_acceleration.value * 1.000001, 1e5, 1.0, 1.0)
    with pytest.raises(
        LimitError, match="the time that a stop on the path takes reaches"
    ) as caught:
        made(at(ZERO, X, times=[0.0, 2.0]), limits=tight, method="kks_quintic_hermite")
    assert caught.value.limit == 6.0
    roomy = Limits(10.0, shape.certificate.peak_acceleration.value * 1.02, 1e5, 1.0, 1.0)
    motion = made(at(ZERO, X, times=[0.0, 2.0]), limits=roomy, method="kks_quintic_hermite")
    assert motion.certificate.stop_time < 6.0
    slowest = 1.0 / motion.certificate.brake_rate
    assert motion.certificate.stop_time == pytest.approx(min(slowest, motion.duration))


def test_velocities_that_leave_no_room_for_a_run_up_are_refused_in_words():
    # Right at the limit and slowing down: before the first keyframe it would have been faster.
    with pytest.raises((PlanError, LimitError)) as caught:
        made(
            at(ZERO, 0.3 * X, 0.31 * X, times=[0.0, 0.1, 1.0]),
            start_velocity=(2.5, 0, 0),
            approach=True,
        )
    assert "\n" not in str(caught.value)


# Large and odd requests


def test_many_keyframes_are_planned_with_a_fixed_number_of_samples_at_a_time(monkeypatch):
    random = np.random.default_rng(5)
    q = [HERE]
    for turn in random.normal(size=(2000, 3)) * 0.05:
        q.append(multiply(q[-1], exp(turn)))
    request = MotionRequest([Keyframe(tuple(key)) for key in q], pace="even")
    largest = []
    rows = Trajectory.rows

    def watched(self, times, out):
        largest.append(len(times))
        return rows(self, times, out)

    monkeypatch.setattr(Trajectory, "rows", watched)
    motion = plan(request, start=State.at_rest(HERE), limits=ARM, period=PERIOD)
    assert motion.record_count > 4 * 8192
    assert max(largest) <= 8192
    assert motion.certificate.keyframe_error < 1e-9
    assert motion.certificate.peak_acceleration.ratio == pytest.approx(0.95, abs=0.01)


def test_steps_up_to_three_radians_are_planned():
    motion = made(at(ZERO, 3.0 * X, ZERO, 3.0 * Y, -2.9 * Z))
    assert motion.certificate.keyframe_error < 1e-9


def test_a_keyframe_that_is_repeated_is_passed_once():
    x, y = (0.8, 0.6, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)
    request = MotionRequest([Keyframe(q) for q in (tuple(HERE), x, x, y)])
    motion = plan(request, start=State.at_rest(HERE), limits=ARM, period=PERIOD)
    assert motion.keyframe_times[1] == motion.keyframe_times[2]


def test_a_tiny_motion_is_a_motion():
    motion = made(at(ZERO, 1e-7 * X))
    assert motion.record_count >= 2
    assert motion.certificate.keyframe_error < 1e-12


@pytest.mark.parametrize("method", ["c2_cumulative", "kks_hermite_spline"])
def test_a_tiny_motion_of_many_keyframes_can_be_stopped(method):
    way = [1e-5 * k * X + 1e-5 * (k % 2) * Y for k in range(8)]
    motion = made(at(*way), approach=True, method=method, period=0.008)
    assert motion.certificate.brake_rate > 0.1


def test_uneven_intervals_are_planned():
    motion = made(at(ZERO, 1e-3 * X, 0.5 * X, 0.501 * X, 1.0 * Y))
    assert motion.certificate.keyframe_error < 1e-9
