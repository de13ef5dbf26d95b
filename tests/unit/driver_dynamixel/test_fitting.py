"""Motions planned for a gimbal's axes as the daemon does it, and streamed through the driver."""

import math
import re

import numpy as np
import pytest
from pole_passes import AXES, LIMITS, PERIOD, driver_with, over_the_top

from orientd import motion_file
from orientd.errors import LimitError
from orientd.planner import fitting, planning
from orientd.planner.fitting import Fitting
from orientd.planner.path import RecordedPath
from orientd.planner.state import State
from orientd.rotation import angle, conjugate, exp, multiply


def fitting_of(driver, start, joints, before=()):
    return Fitting(driver.mechanism(may_ask=False), start, joints, LIMITS, PERIOD, before)


def fit(mapping, *, joints=(0.0, 0.0, 0.0), driver=None, **options):
    driver = driver or driver_with(**options)
    start = State.at_rest(driver._gimbal.orientation(joints))
    return fitting_of(driver, start, joints).plan(motion_file.parse(mapping))


def figure(motion, name):
    return next(one for one in motion.certificate.figures if one.name == name)


@pytest.mark.parametrize("miss", [0.5, 2.0])
def test_path_near_the_keyhole_is_missed_by_a_bounded_angle_and_says_so(miss):
    motion = fit(over_the_top(miss, seconds=8), max_deviation_deg=3.0)
    error = figure(motion, "pointing error")
    assert 0.0 < np.rad2deg(error.value) <= 1.05 * miss
    assert error.limit == pytest.approx(np.deg2rad(3.0))
    assert any("pass near the pole" in note for note in motion.certificate.notes)
    for axis in ("yaw", "pitch", "roll"):
        speed = figure(motion, f"velocity of {axis}")
        assert speed.value <= speed.limit * 1.001
    assert motion.certificate.brake_rate > 0.25


def test_timed_path_too_near_the_keyhole_is_refused_with_axis_time_and_value():
    with pytest.raises(LimitError) as caught:
        fit(over_the_top(0.5, seconds=8))
    assert caught.value.quantity == "velocity of yaw"
    assert caught.value.value > caught.value.limit == pytest.approx(np.deg2rad(220))
    assert 4.0 < caught.value.time < 5.5
    assert "velocity of yaw reaches" in str(caught.value)


def test_path_without_times_is_slowed_down_for_the_axes_and_says_so():
    motion = fit(over_the_top(5.0))
    assert figure(motion, "pointing error").value < 1e-9
    assert figure(motion, "velocity of yaw").value <= np.deg2rad(220) * 1.001
    assert figure(motion, "velocity of yaw").value >= np.deg2rad(220) * 0.99
    assert any("(limit 220.0)" in note for note in motion.certificate.notes)
    assert motion.certificate.peak_velocity.limit == LIMITS.velocity


@pytest.mark.parametrize("miss", [4.0, 6.0, 8.0])
def test_path_without_times_is_nearly_as_fast_as_the_axes_allow(miss):
    motion = fit(over_the_top(miss))
    used = max(
        max(
            figure(motion, f"velocity of {axis}").value / np.deg2rad(220),
            np.sqrt(figure(motion, f"acceleration of {axis}").value / 40.0),
        )
        for axis in ("yaw", "pitch", "roll")
    )
    # As a share of the speed: one way or another an axis is at its limit.
    assert 0.96 < used <= 1.001


def test_planning_for_the_axes_is_bounded_in_attempts(monkeypatch):
    made = []
    plan = planning.plan
    monkeypatch.setattr(fitting, "plan", lambda *a, **k: made.append(1) or plan(*a, **k))
    for miss in (4.0, 0.02):
        made.clear()
        fit(over_the_top(miss))
        assert len(made) == 1


def turning(degrees, seconds=None):
    turns = np.linspace(0, degrees, 7)
    return {"approach": True, "keyframes": [
        {"rotation_vector": [0, 0, np.deg2rad(turn)]}
        | ({} if seconds is None else {"time": seconds * turn / degrees})
        for turn in turns
    ]}  # fmt: skip


@pytest.mark.parametrize("seconds", [None, 12.0])
def test_slew_keeps_the_limits_of_the_tool(seconds):
    motion = fit(turning(300, seconds), allow_slews=True)
    assert motion.certificate.losses
    assert motion.certificate.peak_velocity.value <= LIMITS.velocity
    assert motion.certificate.peak_acceleration.value <= LIMITS.acceleration
    if seconds is not None:
        return
    # A turn back at no more than that takes this long, and not much longer.
    axes = motion.path.joints[:, 0]
    first, last = np.argmax(axes), np.argmin(axes)
    needed = (axes[first] - axes[last]) / LIMITS.velocity
    assert needed <= PERIOD * abs(last - first) < 1.2 * needed


def test_a_certificate_says_how_far_a_slew_is_off_the_path_and_how_long():
    motion = fit(turning(300), allow_slews=True)
    (loss,) = motion.certificate.losses
    # The way back of 360 degrees passes everything: half a turn away at the most.
    assert 3.0 < loss.error <= np.pi
    (note,) = [one for one in motion.certificate.notes if "stops and the axes slew" in one]
    begin, end, lasts, off = map(
        float,
        re.search(
            r"([\d.]+) to ([\d.]+) s \(([\d.]+) s\).*off it by up to ([\d.]+) deg", note
        ).groups(),
    )
    assert off == pytest.approx(np.rad2deg(loss.error), abs=0.1)
    assert end - begin == pytest.approx(lasts, abs=0.01)
    assert begin < loss.start < loss.end <= end + PERIOD
    assert not any("is missed by" in one for one in motion.certificate.notes)


def test_a_certificate_tells_when_a_path_at_times_is_lost(monkeypatch):
    shaped, of = [], RecordedPath.of

    def watched(q, path_times, *others):
        shaped.append((q, path_times))
        return of(q, path_times, *others)

    monkeypatch.setattr(RecordedPath, "of", watched)
    motion = fit(turning(300, 12.0), allow_slews=True)
    plain = planning.plan(
        motion_file.parse(turning(300, 12.0)), start=State.at_rest([1, 0, 0, 0]),
        limits=LIMITS, period=PERIOD,
    )  # fmt: skip
    q, path_times = shaped[-1]
    missed = angle(q, plain.sample(path_times).q)[: round(motion.end_time / PERIOD) + 1]
    is_lost = missed > np.deg2rad(0.5)
    (loss,) = motion.certificate.losses
    assert loss.error == pytest.approx(np.max(missed), 1e-6)
    assert loss.start == pytest.approx(PERIOD * np.argmax(is_lost), abs=1e-9)
    assert loss.end - loss.start == pytest.approx(PERIOD * np.sum(is_lost), abs=1e-9)


def test_a_path_at_times_of_the_user_keeps_them_while_the_axes_slew():
    motion = fit(turning(300, 12.0), allow_slews=True)
    assert motion.end_time - motion.start_time == pytest.approx(12.0, abs=1e-9)
    np.testing.assert_allclose(
        motion.keyframe_times - motion.start_time, np.linspace(0.0, 12.0, 7), atol=PERIOD
    )


def test_angle_outside_the_limits_is_refused_with_axis_and_time():
    axes = [dict(AXES[0], limits_deg=[-60, 60]), *AXES[1:]]
    turn = {"keyframes": [{"rotation_vector": [0, 0, 0]}, {"rotation_vector": [0, 0, 2.0]}],
            "approach": True}  # fmt: skip
    with pytest.raises(LimitError, match=r"(angle|velocity) of yaw reaches .* at "):
        fit(turn, axes=axes)


def test_plan_begins_on_the_branch_and_turn_that_the_gimbal_is_on():
    here = tuple(np.deg2rad([190.0, 10.0, -5.0]))
    driver = driver_with()
    q = driver._gimbal.orientation(here)
    back = multiply(q, exp(np.array([0.2, 0.1, -0.4])))
    keyframes = [{"quaternion": dict(zip("wxyz", one, strict=True))} for one in (q, back.tolist())]
    measured = tuple(angle + 0.002 for angle in here)
    motion = fit({"keyframes": keyframes, "approach": True}, joints=here, driver=driver)
    again = Fitting(
        driver.mechanism(may_ask=False), State.at_rest(q), measured, LIMITS, PERIOD
    ).plan(motion.request)
    for planned in (motion, again):
        assert planned.first_joints == pytest.approx(here, abs=1e-9)


def test_driver_follows_the_planned_branch_to_its_end(rig):
    it = rig("ZYX", rate_hz=100, axes=AXES, max_deviation_deg=3.0)
    feedback = it.start()
    motion = fit(over_the_top(2.0, seconds=8), joints=feedback.joints, driver=it.driver)
    for joints in motion.records(0, motion.record_count)[:, 16:19].tolist():
        it.cycle(joints)
    last = [2048 + angle * 4096 / math.tau for angle in motion.last_joints]
    assert it.goals() == pytest.approx(last, abs=0.5 + 1e-6)


def test_two_axes_that_leave_too_much_roll_are_refused_before_they_move():
    turn = {"keyframes": [{"rotation_vector": [0, 0, 0]}, {"rotation_vector": [0.4, 0.2, 0.5]}],
            "approach": True}  # fmt: skip
    options = {"order": "ZY", "axes": AXES[:2]}
    with pytest.raises(LimitError, match="orientation error of the two axes"):
        fit(turn, joints=(0.0, 0.0), driver=driver_with(**options, pointing=False))
    motion = fit(turn, joints=(0.0, 0.0), driver=driver_with(**options, pointing=True))
    asked = exp(np.array([0.4, 0.2, 0.5]))
    off = multiply(conjugate(motion.sample([motion.duration]).q[0]), asked)
    # What is left is a turn about the pointing axis.
    assert abs(off[1]) > 0.05
    assert off[2:] == pytest.approx([0, 0], abs=1e-9)
    assert angle(asked, motion.sample([motion.duration]).q[0]) > 0.1


def go_on(driver, motion, record, vector, *, seconds=None):
    """Return the motion that leaves *motion* at *record*, in motion, for where *vector* turns."""
    state = motion.path.state(record * PERIOD)
    goal = multiply(state.q, exp(np.array(vector)))
    keyframes = [
        {"quaternion": dict(zip("wxyz", one.tolist(), strict=True))} for one in (state.q, goal)
    ]
    if seconds is not None:
        keyframes = [
            one | {"time": when} for one, when in zip(keyframes, (0, seconds), strict=True)
        ]
    joints, before = motion.recorded().joints_at(record), motion.path.joints_before(record)
    request = motion_file.parse({"keyframes": keyframes})
    return fitting_of(driver, state, joints, before).plan(request)


def turned_once():
    """A motion of yaw from 170 to 250 degrees, so on a turn of its own, and its driver."""
    here = tuple(np.deg2rad([170.0, 10.0, -5.0]))
    driver = driver_with()
    q = np.array(driver._gimbal.orientation(here))
    there = np.array(driver._gimbal.orientation(tuple(np.deg2rad([250.0, -20.0, 15.0]))))
    keyframes = [{"quaternion": dict(zip("wxyz", one.tolist(), strict=True))} for one in (q, there)]
    # At an even pace what goes on from it in motion does not swing beyond the end of the travel.
    return driver, fit({"keyframes": keyframes, "pace": "even"}, joints=here, driver=driver)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_path_that_begins_in_motion_goes_on_from_the_axes_as_they_move(share):
    driver, motion = turned_once()
    record = round(share * motion.record_count)
    onward = go_on(driver, motion, record, [0.2, -0.3, -0.5])
    ours, theirs = onward.records(0, 1)[0], motion.records(record, 1)[0]
    # q, omega and alpha, up to the sign of q.
    assert abs(float(ours[:4] @ theirs[:4])) == pytest.approx(1.0, abs=1e-15)
    assert ours[4:7] == pytest.approx(theirs[4:7], abs=1e-9)
    assert ours[7:10] == pytest.approx(theirs[7:10], abs=1e-6)
    assert np.linalg.norm(ours[4:7]) > 0.3
    axes = np.array([*motion.path.joints_before(record), *onward.path.joints])
    assert axes[3] == pytest.approx(motion.recorded().joints_at(record), abs=1e-9)
    # Whoever replaces it at once is told of the axes as they moved before it.
    assert np.array_equal(onward.path.joints_before(1), axes[1:4])
    velocity, acceleration = np.diff(axes, axis=0) / PERIOD, np.diff(axes, 2, axis=0) / PERIOD**2
    assert np.max(np.abs(velocity)) <= np.deg2rad(220) * 1.001
    assert np.max(np.abs(acceleration)) <= 40.0 * 1.001
    # Steady through the seam: no step larger than the path's own jerk makes.
    jerk = np.diff(acceleration, axis=0) / PERIOD
    assert np.max(np.abs(jerk[:4])) <= 1.1 * LIMITS.jerk


def test_path_may_begin_in_the_midst_of_a_passage_by_the_pole():
    driver = driver_with(max_deviation_deg=3.0)
    motion = fit(over_the_top(2.0, seconds=8), driver=driver)
    record = int(np.argmin(np.abs(motion.path.joints[:, 1] + np.pi / 2)))
    state = motion.path.state(record * PERIOD)
    # Straight on, over the pole.
    way = state.omega_body / np.linalg.norm(state.omega_body)
    onward = go_on(driver, motion, record, 1.2 * way, seconds=4.0)
    axes = np.array([*motion.path.joints_before(record), *onward.path.joints])
    acceleration = np.diff(axes, 2, axis=0) / PERIOD**2
    assert np.max(np.abs(acceleration)) <= 40.0 * 1.001
    assert figure(onward, "pointing error").value <= np.deg2rad(3.0) * 1.001
    # It has not gone back to the branch that it came on.
    assert onward.last_joints[1] < -np.pi / 2


def test_axes_of_a_motion_are_those_that_make_it():
    driver, motion = turned_once()
    q = motion.records(0, motion.record_count)[:, :4]
    made = [
        driver._gimbal.orientation(motion.recorded().joints_at(k))
        for k in range(motion.record_count)
    ]
    assert np.max(angle(np.array(made), q)) < 1e-7
    assert motion.recorded().joints_at(-3) == motion.first_joints
    assert motion.recorded().joints_at(motion.record_count - 1) == motion.last_joints
    assert motion.path.joints_before(2) == tuple(motion.recorded().joints_at(k) for k in (0, 0, 1))
    assert np.rad2deg(motion.last_joints) == pytest.approx([250, -20, 15], abs=1e-3)
