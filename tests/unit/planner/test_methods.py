import inspect

import numpy as np
import pytest
from planned import LIMITS, PERIOD, differences, rotations

from orientd.curves import METHODS, is_pair, options_of
from orientd.errors import LimitError, PlanError, RequestError
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.methods import can_turn
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import angle, exp

ARM = LIMITS["arm"]
ABLE = [name for name in METHODS if METHODS[name].meets_end_velocities]
TURNING = [name for name in METHODS if can_turn(METHODS[name])]
START = State.at_rest(exp([0.1, 0.2, 0.3]))


def request(name, count=None, *, step=0.5, times=None, turns=0, **fields):
    count = count or (2 if is_pair(METHODS[name]) else 5)
    q = rotations(np.random.default_rng(21), count, step)
    return MotionRequest(
        [
            Keyframe(key, None if times is None else times[k], turns=turns if k == 1 else 0)
            for k, key in enumerate(q)
        ],
        method=name,
        approach=True,
        **fields,
    )


def made(name, *args, **fields):
    return plan(request(name, *args, **fields), start=START, limits=ARM, period=PERIOD)


def refusal(name, *args, **fields):
    with pytest.raises(RequestError) as caught:
        made(name, *args, **fields)
    return caught.value.field, caught.value.problem


@pytest.mark.parametrize("name", METHODS)
def test_options_are_parameters_that_do_not_follow_from_the_keyframes(name):
    options = set(options_of(METHODS[name]))
    assert options <= set(inspect.signature(METHODS[name]).parameters)
    assert not options & {"keys", "times", "control", "omega_start", "start", "turns"}


@pytest.mark.parametrize("name", sorted(set(METHODS) - {"piecewise_slerp"}))
def test_every_method_makes_motions_that_keep_the_limits(name):
    motion = made(name, step=0.3)
    found = differences(motion.records(0, motion.record_count)[:, :4], PERIOD)
    for rates, limit in zip(found, (ARM.velocity, ARM.acceleration, ARM.jerk), strict=True):
        assert rates.max() <= limit * (1 + 1e-6)
    if METHODS[name].interpolates:
        assert motion.certificate.keyframe_error < 1e-9
    ends = motion.sample([motion.start_time, motion.end_time]).q
    assert angle(ends, motion.request.keys[[0, -1]]).max() < 1e-9


@pytest.mark.parametrize("name", ABLE)
def test_every_method_that_can_meets_velocities_at_both_ends(name):
    motion = made(name, start_velocity=(0.1, 0.2, 0.3), end_velocity=(-0.3, 0.2, 0.1))
    omega = motion.sample([motion.start_time, motion.end_time]).omega_body
    assert omega == pytest.approx(np.array([[0.1, 0.2, 0.3], [-0.3, 0.2, 0.1]]), abs=1e-9)


def test_an_inertia_makes_a_motion_of_less_torque():
    moments = np.array([1.0, 3.0, 3.5])
    fields = {"step": 1.5, "times": [0.0, 8.0, 16.0, 24.0, 32.0], "options": {"spans": 3}}
    heavy = {**fields, "options": {"spans": 3, "inertia": moments.tolist()}}
    efforts = []
    for given in (heavy, fields):
        found = made("minimum_effort", **given).sample(np.linspace(0.0, 32.0, 3201))
        torque = moments * found.alpha_body + np.cross(found.omega_body, moments * found.omega_body)
        efforts.append(np.sum(torque * torque))
    assert efforts[0] < 0.999 * efforts[1]


def test_an_option_of_the_least_effort_that_is_none_is_named():
    assert refusal("minimum_effort", options={"spans": 1})[0] == "options.spans"
    assert refusal("minimum_effort", options={"inertia": [1, 2]})[0] == "options.inertia"


def test_a_defect_of_a_method_is_not_taken_for_keyframes_that_cannot_be_joined(monkeypatch):
    def fails(*args, **given):
        raise TypeError("a defect")

    monkeypatch.setattr(METHODS["squad"], "__init__", fails)
    with pytest.raises(TypeError, match="a defect"):
        made("squad")


@pytest.mark.parametrize("name", sorted(set(METHODS) - set(ABLE)))
def test_every_method_that_cannot_refuses_velocities_and_says_who_can(name):
    field, problem = refusal(name, end_velocity=(0, 0, 0.1))
    assert field == "end_velocity"
    assert "c2_cumulative" in problem
    made_with_zero = request(name, start_velocity=(0, 0, 0))
    assert made_with_zero.start_velocity == (0, 0, 0)


@pytest.mark.parametrize("name", TURNING)
@pytest.mark.parametrize("turns", [1, -1, 2])
def test_whole_turns_are_made(name, turns):
    motion = made(name, 2, turns=turns)
    times = np.linspace(motion.start_time, motion.end_time, 4001)
    q = motion.sample(times).q
    way = angle(q[1:], q[:-1]).sum()
    short = angle(*motion.request.keys)
    assert way == pytest.approx(abs(short + 2 * np.pi * turns), rel=0.02)
    assert motion.certificate.keyframe_error < 1e-9


@pytest.mark.parametrize("name", sorted(set(METHODS) - set(TURNING)))
def test_methods_that_cannot_turn_say_who_can(name):
    field, problem = refusal(name, turns=1)
    assert field == "keyframes[1].turns"
    assert "c2_cumulative" in problem


@pytest.mark.parametrize("name", [n for n in METHODS if is_pair(METHODS[n])])
def test_methods_of_two_keyframes_refuse_more(name):
    assert refusal(name, 3) == (
        "keyframes",
        f"{name} takes exactly 2, got 3; c2_cumulative takes more",
    )


def test_an_unknown_method_is_named_with_the_nearest_known_one():
    with pytest.raises(RequestError, match="did you mean 'c2_cumulative'") as caught:
        made("c2_cumulativ", 2)
    assert caught.value.field == "method"


def test_an_unknown_option_is_named_with_those_there_are():
    field, problem = refusal("kks_hermite_spline", options={"rul": "mean"})
    assert field == "options.rul"
    assert problem == (
        "unknown option of kks_hermite_spline; did you mean 'rule'?; it takes rule, align"
    )


def test_options_reach_the_curve():
    times = [0.0, 1.0, 3.0, 4.0, 6.0]
    one = made("kks_hermite_spline", times=times)
    other = made("kks_hermite_spline", times=times, options={"rule": "mean"})
    middle = one.start_time + 2.0
    assert angle(one.sample([middle]).q, other.sample([middle]).q)[0] > 1e-3
    assert made("kks_bspline", options={"order": 3}).certificate.keyframe_error != (
        made("kks_bspline").certificate.keyframe_error
    )


@pytest.mark.parametrize(
    ("name", "options", "field"),
    [
        ("kks_hermite_spline", {"rule": "wild"}, "options.rule"),
        ("kks_bspline", {"order": 1}, "options.order"),
        ("kks_bspline", {"order": "high"}, "options.order"),
        ("kks_hermite", {"product": 3}, "options.product"),
        ("c2_cumulative", {"align": "maybe"}, "options.align"),
    ],
)
def test_an_option_with_a_wrong_value_is_named(name, options, field):
    assert refusal(name, options=options)[0] == field


def test_a_method_whose_velocity_jumps_is_refused_and_a_smooth_one_named():
    with pytest.raises(LimitError, match=r"only C0.*c2_cumulative is C2") as caught:
        made("piecewise_slerp", times=[0, 1, 2, 3, 4])
    assert caught.value.quantity in ("angular acceleration", "angular jerk")
    with pytest.raises(PlanError, match=r"only C0.*c2_cumulative is C2"):
        made("piecewise_slerp", pace="even")


def test_turns_between_keyframes_that_are_the_same_have_no_axis():
    q = rotations(np.random.default_rng(3), 2, 0.5)
    opposite = tuple(-c for c in q[0])
    keyframes = [Keyframe(q[0]), Keyframe(opposite, turns=1), Keyframe(q[1])]
    with pytest.raises(RequestError, match="so the axis of the turn is undefined") as caught:
        plan(MotionRequest(keyframes), start=State.at_rest(q[0]), limits=ARM, period=PERIOD)
    assert caught.value.field == "keyframes[1].turns"


def test_too_few_keyframes_for_a_method_are_named():
    field, problem = refusal("circular_blending", 2)
    assert field == "keyframes"
    assert "at least 3" in problem


def test_a_uniform_curve_refuses_unequal_intervals():
    field, problem = refusal("kks_uniform", times=[0, 1, 2, 3.5, 4])
    assert field == "keyframes[3].time"
    assert "equal intervals" in problem
    assert made("kks_uniform", times=[1, 2, 3, 4, 5]).end_time


def test_control_quaternions_are_near_their_times():
    # With averaged knots the largest distance is that of the polygon's corners, not of the timing.
    motion = made("kks_bspline", step=0.2, times=[0.0, 0.5, 2.0, 2.5, 4.0])
    assert motion.certificate.keyframe_error < 0.2


ABLE_TO_REST = ("c2_cumulative", "kks_interpolating", "kks_quintic_hermite", "minimum_effort")
SMOOTH = sorted(set(METHODS) - {"piecewise_slerp"})


def begun_at_rest(name, times, **fields):
    asked = request(name, step=0.25, times=times)
    still = MotionRequest(asked.keyframes, method=name, **fields)
    return plan(still, start=State.at_rest(asked.keys[0]), limits=ARM, period=PERIOD)


@pytest.mark.parametrize("name", SMOOTH)
def test_every_method_begins_at_rest_with_times(name):
    count = 2 if is_pair(METHODS[name]) else 5
    step = 10.0 if name == "circular_blending" else 2.0
    options = {"param": "quadratic"} if name == "circular_blending" else {}
    motion = begun_at_rest(name, (step * np.arange(count)).tolist(), options=options)
    assert motion.certificate.lead_in == 0.0
    found = differences(motion.records(0, motion.record_count)[:, :4], PERIOD)
    for rates, limit in zip(found, (ARM.velocity, ARM.acceleration, ARM.jerk), strict=True):
        assert rates.max() <= limit * (1 + 1e-6)
    if METHODS[name].interpolates:
        assert motion.certificate.keyframe_error < 1e-9
    state = motion.start_state
    assert np.linalg.norm(state.omega_body) < 1e-12
    joins = any("joins the curve" in one for one in motion.certificate.notes)
    assert joins == (name not in ABLE_TO_REST)


@pytest.mark.parametrize("name", ABLE)
def test_a_method_with_an_end_velocity_begins_at_rest(name):
    motion = begun_at_rest(name, None, end_velocity=(0.1, 0.05, -0.1))
    assert motion.certificate.lead_in == 0.0
    assert np.linalg.norm(motion.start_state.omega_body) < 1e-12
    assert motion.certificate.end_velocity_error < 1e-9


@pytest.mark.parametrize("name", ["kks_interpolating", "rotation_vector_spline"])
def test_the_quickest_motion_leaves_rest_along_the_natural_curve(name):
    # At rest at its ends the curve would be another one.
    motion = begun_at_rest(name, None)
    natural = METHODS[name](keys=motion.request.keys, times=motion.keyframe_times)
    assert motion.certificate.notes == ()
    assert np.linalg.norm(natural.evaluate(natural.domain[0])[1]) > 0.1


def test_a_method_at_rest_with_acceleration_may_have_a_lead():
    asked = request("kks_hermite", times=[0.0, 2.0])
    motion = plan(asked, start=State.at_rest(asked.keys[0]), limits=ARM, period=PERIOD)
    assert motion.certificate.lead_in > 0.0
    assert motion.certificate.lead_out > 0.0
