"""Motions outside of keep-out cones: what is refused, led around, and certified."""

import math

import numpy as np
import pytest

from orientd import load_motion, plots
from orientd.clock import MonotonicClock
from orientd.errors import PlanError
from orientd.keep_out import KeepOut
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.blending import NOT_BLENDED
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.offline import plan_many, plan_offline
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import rotate
from orientd.sun import Sun
from orientd_loopback import LoopbackDriver

PERIOD = 0.002
START = State.at_rest((1.0, 0.0, 0.0, 0.0))
LASER = KeepOut("laser", (math.cos(0.7), math.sin(0.7), 0.0), math.radians(12.0))


def toward(azimuth, elevation=0.0, **others):
    return Keyframe(azimuth_elevation={"azimuth": azimuth, "elevation": elevation}, **others)


def planned(*keyframes, start=START, cones=(LASER,), **fields):
    request = MotionRequest(keyframes, keep_out=cones, **fields)
    return plan(request, start=start, limits=DEFAULT_LIMITS, period=PERIOD, unix_ns=0)


def least(motion, cone=LASER, phases=5):
    """Return the least clearance at phases between the records, degrees."""
    times = np.arange(0.0, motion.duration, motion.period / phases)
    points = rotate(motion.sample(times).q, np.array(cone.axis))
    cosine = points @ np.array(cone.direction_at(0))
    return math.degrees(np.min(np.arccos(np.clip(cosine, -1.0, 1.0))) - cone.half_angle)


def clearance(motion, name="laser"):
    (figure,) = [one for one in motion.certificate.figures if one.name == f"keep-out {name}"]
    assert figure.unit == "rad"
    return math.degrees(figure.value)


def test_a_path_that_crosses_is_led_around_and_still_meets_its_keyframes():
    motion = planned(toward(80.0))
    assert least(motion) >= 0.0
    assert "led around keep-out laser" in motion.certificate.notes
    assert motion.certificate.keyframe_error < 1e-9
    assert len(motion.keyframe_times) == len(motion.request.keyframes) == 1
    direct = planned(toward(80.0), cones=())
    assert direct.duration < motion.duration < 1.3 * direct.duration


def test_a_motion_led_around_to_its_first_keyframe_rests_there_as_any_other():
    motion = planned(toward(80.0), toward(80.0, 30.0), toward(60.0, 40.0), approach=True)
    assert any(one.startswith("led around keep-out laser") for one in motion.certificate.notes)
    assert least(motion) >= 0.0
    at = motion.sample(motion.keyframe_times[:1])
    assert np.max(np.abs(at.omega_body)) < 1e-9


def test_notes_on_a_motion_led_around_name_the_keyframes_of_the_user():
    here, there = Keyframe((1.0, 0.0, 0.0, 0.0)), toward(80.0)
    w, x, y, z = there.q
    half_turn_about_the_axis = Keyframe((-x, w, z, -y))
    motion = planned(here, there, half_turn_about_the_axis)
    assert "led around keep-out laser" in motion.certificate.notes
    assert len(motion.request.keyframes) == 3
    (note,) = [one for one in motion.certificate.notes if "half a turn" in one]
    assert note.startswith("keyframes[2] is half a turn away")


def test_the_certificate_has_a_lower_bound_of_the_clearance():
    motion = planned(toward(80.0))
    assert 0.0 <= clearance(motion) <= least(motion) <= clearance(motion) + 0.05


def test_a_path_that_keeps_clear_stays_as_it_is():
    alone, clear = planned(toward(-80.0), cones=()), planned(toward(-80.0))
    assert np.array_equal(alone.rows(0, alone.record_count), clear.rows(0, clear.record_count))
    assert clearance(clear) == pytest.approx(least(clear), abs=0.01)


def test_a_keyframe_inside_is_refused_with_the_name_and_the_angle():
    with pytest.raises(PlanError, match=r"keyframes\[0\] is 11.9 deg inside keep-out laser"):
        planned(toward(40.0))


def test_times_are_kept_around_a_cone():
    keyframes = toward(0.0, time=0.0), toward(80.0, time=3.0), toward(0.0, 60.0, time=6.0)
    motion = planned(*keyframes)
    assert (motion.keyframe_times - motion.start_time).tolist() == pytest.approx([0.0, 3.0, 6.0])
    assert least(motion) >= 0.0


def test_times_too_short_for_the_way_around_are_refused_with_the_limit():
    cone = KeepOut("wall", (math.cos(0.7), math.sin(0.7), 0.0), math.radians(38.0))
    with pytest.raises(PlanError, match=r"no motion around was found: .* the limit is"):
        planned(toward(0.0, time=0.0), toward(80.0, time=1.3), cones=(cone,))


def test_enclosed_keyframes_are_refused_and_no_others():
    ring = [
        KeepOut(f"r{k}", (math.cos(a) * 0.7071, math.sin(a) * 0.7071, 0.7071), math.radians(30.0))
        for k, a in enumerate(np.arange(6) * math.pi / 3)
    ]
    upright = MotionRequest([toward(0.0, 90.0)], keep_out=ring)
    with pytest.raises(PlanError, match="there is no route from the start to"):
        plan(upright, start=START, limits=DEFAULT_LIMITS, period=PERIOD)
    # One of them less leaves a gap.
    gap = MotionRequest([toward(0.0, 90.0)], keep_out=[*ring[1:]])
    motion = plan(gap, start=START, limits=DEFAULT_LIMITS, period=PERIOD)
    assert all(least(motion, cone) >= 0.0 for cone in gap.keep_out)


def test_from_inside_a_motion_may_only_move_out():
    inside = State.at_rest(toward(45.0).q)
    motion = planned(toward(-20.0), start=inside)
    times = motion.period * np.arange(motion.record_count)
    points = rotate(motion.sample(times).q, np.array(LASER.axis))
    angles = np.degrees(np.arccos(points @ np.array(LASER.direction_at(0)))) - 12.0
    outside = int(np.argmax(angles >= 0.0))
    assert angles[0] < -5.0
    assert np.all(np.diff(angles[: outside + 1]) >= -1e-6)
    assert np.all(angles[outside:] >= 0.0)
    # The certificate says how far inside it begins.
    assert clearance(motion) == pytest.approx(angles[0], abs=0.05)


def test_a_first_keyframe_inside_has_a_negative_clearance():
    person = KeepOut("person", (1.0, 0.0, 0.0), math.radians(20.0))
    motion = planned(toward(5.0), toward(60.0, 10.0), start=State.at_rest(toward(5.0).q),
                     cones=(person,))  # fmt: skip
    assert clearance(motion, "person") == pytest.approx(-15.0, abs=0.05)
    assert clearance(motion, "person") <= least(motion, person) + 1e-9


def test_a_device_that_is_there_already_has_a_clearance():
    motion = planned(Keyframe(tuple(START.q.tolist())))
    assert clearance(motion) == pytest.approx(math.degrees(0.7) - 12.0)


def test_a_running_motion_is_replaced_around_a_cone():
    running = planned(toward(80.0, -30.0), cones=())
    state = running.state_at(100)
    assert np.linalg.norm(state.omega_body) > 1.0
    motion = planned(toward(90.0, 20.0), start=state)
    assert least(motion) >= 0.0
    assert np.allclose(motion.start_state.omega_body, state.omega_body, atol=1e-6)


def test_the_lead_in_to_a_timed_pass_is_led_around():
    times = 0.0, 1.0, 2.0
    keyframes = [toward(80.0 + 4.0 * t, 20.0 * t, time=t) for t in times]
    for fields in ({}, {"start_velocity": (0.0, -0.3, 0.1)}):
        motion = planned(*keyframes, approach=True, **fields)
        assert least(motion) >= 0.0
        assert motion.start_time > 0.3
        assert (motion.keyframe_times - motion.start_time).tolist() == pytest.approx(times)
        assert motion.certificate.keyframe_error < 1e-9
        assert any("to its first keyframe" in one for one in motion.certificate.notes)


def test_a_turn_at_a_rate_that_crosses_is_refused():
    with pytest.raises(PlanError, match="the turn crosses keep-out laser"):
        planned(rate=(0.0, 0.0, 0.5), duration=3.0)
    assert least(planned(rate=(0.5, 0.0, 0.0), duration=3.0)) > 0.0


def test_whole_turns_that_cross_are_refused():
    with pytest.raises(PlanError, match="the turn crosses keep-out laser"):
        planned(toward(80.0, turns=1))


def test_a_margin_is_kept_where_it_can_be():
    soft = KeepOut("laser", LASER.direction, LASER.half_angle, margin=math.radians(8.0))
    assert least(planned(toward(80.0), cones=(soft,))) >= 8.0
    motion = planned(toward(40.0, 15.0), cones=(soft,))
    assert 0.0 <= least(motion) < 8.0
    assert any("in the margin of keep-out laser" in one for one in motion.certificate.notes)


def test_two_axes_of_the_tool_keep_out_of_their_own_cones():
    mast = KeepOut("mast", (0.0, 0.0, 1.0), math.radians(20.0), axis=(0.0, 0.0, 1.0))
    start = State.at_rest(Keyframe(euler={"axes": "x", "degrees": [30.0]}).q)
    goal = Keyframe(euler={"axes": "x", "degrees": [-30.0]})
    motion = planned(goal, start=start, cones=(mast, LASER))
    assert least(motion, mast) >= 0.0
    assert least(motion) >= 0.0


def test_the_sun_is_kept_out_of_where_it_is_at_that_time():
    sun = KeepOut("sun", Sun(0.0, 0.0), math.radians(10.0))
    noon = 1_742_470_000_000_000_000  # near an equinox, about noon at Greenwich
    x, y, z = sun.direction_at(noon)
    azimuth, elevation = math.degrees(math.atan2(y, x)), math.degrees(math.asin(z))
    request = MotionRequest([toward(azimuth, elevation)], keep_out=(sun,))
    given = {"start": START, "limits": DEFAULT_LIMITS, "period": PERIOD}
    with pytest.raises(PlanError, match=r"inside keep-out sun"):
        plan(request, **given, unix_ns=noon)
    later = plan(request, **given, unix_ns=noon + 4 * 3_600_000_000_000)
    assert clearance(later, "sun") > 30.0


def test_a_plan_around_the_sun_depends_on_the_time_of_the_request_and_no_clock():
    sun = KeepOut("sun", Sun(48.0, 11.0), math.radians(10.0))
    request = MotionRequest([toward(80.0)], keep_out=(sun,))
    with pytest.raises(ValueError, match=r"expected unix_ns, the time of the motion"):
        plan(request, start=START, limits=DEFAULT_LIMITS, period=PERIOD)
    fixed = MotionRequest([toward(0.0), toward(80.0)], keep_out=(sun,))
    one, other = (plan_offline(fixed, unix_ns=10**18) for _ in range(2))
    assert one.certificate == other.certificate
    assert np.array_equal(one.records(0, 100), other.records(0, 100), equal_nan=True)
    several = list(plan_many([fixed, fixed], jobs=1, unix_ns=10**18))
    assert [motion.certificate for motion in several] == [one.certificate] * 2


def test_a_plan_around_is_the_same_to_the_last_bit():
    one, other = planned(toward(80.0)), planned(toward(80.0))
    assert one == other


def test_control_points_that_cross_are_refused_in_words():
    with pytest.raises(PlanError, match=r"kks_bspline .* take the default method"):
        planned(toward(0.0), toward(40.0, 5.0), toward(80.0), method="kks_bspline")


def test_a_saved_motion_keeps_its_cones(tmp_path):
    motion = planned(toward(80.0))
    motion.save(tmp_path / "around.npz")
    again = load_motion(tmp_path / "around.npz")
    assert again == motion
    assert again.keep_out == motion.keep_out == (LASER,)


def test_a_picture_of_a_motion_shows_its_cones(tmp_path):
    plots.draw(planned(toward(80.0)), tmp_path / "around.svg")
    text = (tmp_path / "around.svg").read_text(encoding="utf-8")
    assert 'id="keep-out-laser"' in text


def test_a_blend_that_would_cut_a_corner_through_a_margin_passes_the_corner_instead():
    """The cone lies inside the corner, its margin reaches nearly to both legs."""
    given = LoopbackDriver({}, period_ns=round(1e9 * PERIOD), clock=MonotonicClock())
    inside, half = toward(25.0, 15.0).q, math.radians(10.0)
    direction = tuple(rotate(np.array(inside), np.array([1.0, 0.0, 0.0])).tolist())
    legs = [MotionRequest([toward(*at)]) for at in ((40.0, 0.0), (40.0, 40.0))]
    found = []
    for margin in (0.0, math.radians(4.0)):
        cone = KeepOut("laser", direction, half, margin)
        device = DevicePlanner(given, limits=DEFAULT_LIMITS, period=PERIOD, keep_out=[cone])
        first = device.plan(legs[0], start=START, joints=())
        assert least(first, cone) > math.degrees(margin)
        record, second = device.blend(first.recorded(), legs[1], tolerance=0.17, earliest=0)
        is_blended = record < first.recorded().last_record
        notes = [one for one in second.certificate.notes if one.startswith(NOT_BLENDED)]
        assert notes == ([] if is_blended else [f"{NOT_BLENDED}: it would pass a keep-out cone"])
        found.append((is_blended, least(second, cone) > math.degrees(margin)))
    assert found == [(True, True), (False, True)]
