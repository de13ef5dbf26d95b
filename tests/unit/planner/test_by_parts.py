"""Quick motions on curves with corners, and on curves with velocities at free ends."""

import inspect
import math

import numpy as np
import pytest
from planned import LIMITS, PERIOD, differences, rotations, times_of

from orientd.curves import METHODS
from orientd.errors import PlanError
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.path import PositionPath
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.profiles import corners, profiles, retimed
from orientd.rotation import angle

CORNERED = ("piecewise_slerp", "squad", "circular_blending", "shoemake_bezier", "nielson_shieh")
MOVING_ENDS = ("normalized_cubic", "kks_interpolating", "rotation_vector_spline")
KEYS = rotations(np.random.default_rng(0), 5, 0.5)
FAR = rotations(np.random.default_rng(0), 5, 1.5)


def made(method, keys=KEYS, *, limits=LIMITS["arm"], period=PERIOD, approach=True, **fields):
    request = MotionRequest([Keyframe(q) for q in keys], method=method, approach=approach, **fields)
    return plan(request, start=State.at_rest(request.keys[0]), limits=limits, period=period)


def curve(method, keys=KEYS):
    return METHODS[method](keys=np.array(keys), times=np.arange(len(keys), dtype=float))


def part_of(method, number):
    """Return a curve as a path, and a part of it from rest to rest with its profile."""
    whole = curve(method)
    path = KeyframePath(whole.trajectory, PositionPath.held(np.zeros(3)), whole.knots)
    profile = profiles(path, LIMITS["arm"], PERIOD, rests=whole.knots)[number]
    return path, retimed(path, profile), profile


@pytest.mark.parametrize("method", ["squad", "shoemake_bezier", "circular_blending"])
@pytest.mark.parametrize("number", [0, 1])
def test_a_part_is_the_curve_from_rest_to_rest(method, number):
    path, resting, profile = part_of(method, number)
    _, omega, alpha = resting.trajectory.ends()
    assert np.abs(np.concatenate([omega, alpha])).max() < 1e-8
    times = np.linspace(*resting.trajectory.domain, 4001)
    path_times, rate, change = profile.clock()(times)
    last = np.nextafter(number + 1.0, 0.0)
    q, turning, bending = path.trajectory.sample(np.minimum(number + path_times, last))
    expected = q, turning * rate[:, None], bending * rate[:, None] ** 2 + turning * change[:, None]
    for found, wanted in zip(resting.trajectory.sample(times), expected, strict=True):
        assert np.abs(found - wanted).max() < 5e-7 * np.abs(wanted).max()


def test_a_part_knows_when_it_passes_a_path_time():
    path, resting, profile = part_of("squad", 1)
    path_times = np.linspace(1.0, 2.0, 81)
    found = resting.trajectory.orientations(profile.clock().times_of(path_times - 1.0))
    assert angle(found, path.trajectory.orientations(path_times)).max() < 1e-7
    assert resting.times.tolist()[:2] == [0.0, 0.0]
    assert resting.times.tolist()[2:] == [resting.duration] * 3


@pytest.mark.parametrize("method", ["squad", "piecewise_slerp"])
def test_parts_of_many_are_hardly_slower_than_those_of_few(method):
    keys = np.array(rotations(np.random.default_rng(5), 80, 0.5))
    keys = [tuple(q) for q in keys.tolist()]
    many = made(method, keys)
    half = made(method, keys[:40]), made(method, keys[39:])
    assert many.duration < 1.003 * sum(one.duration for one in half)


def test_corners_are_where_a_derivative_has_a_step():
    assert corners(curve("squad").trajectory).tolist() == [1.0, 2.0, 3.0]
    assert corners(curve("piecewise_slerp").trajectory).tolist() == [1.0, 2.0, 3.0]
    assert not len(corners(curve("c2_cumulative").trajectory))
    straight = [(math.cos(0.1 * k), 0.0, 0.0, math.sin(0.1 * k)) for k in range(5)]
    assert not len(corners(curve("piecewise_slerp", straight).trajectory))


@pytest.mark.parametrize("limits", ["arm", "slow", "soft"])
@pytest.mark.parametrize("method", [*CORNERED, *MOVING_ENDS])
def test_a_curve_is_never_slower_than_with_an_even_pace(method, limits):
    quick = made(method, FAR, limits=LIMITS[limits])
    largest = [max(rates) for rates in differences(quick.sample(times_of(quick)).q, PERIOD)]
    allowed = (LIMITS[limits].velocity, LIMITS[limits].acceleration, LIMITS[limits].jerk)
    assert all(rate <= 1.000001 * most for rate, most in zip(largest, allowed, strict=True))
    if method != "piecewise_slerp":
        even = made(method, FAR, limits=LIMITS[limits], pace="even")
        assert quick.duration <= even.duration


@pytest.mark.parametrize("method", [*CORNERED, *MOVING_ENDS])
def test_the_way_is_the_curves_own(method):
    motion = made(method, FAR)
    whole = motion.request
    times = np.linspace(motion.start_time, motion.end_time, 2001)
    found = motion.sample(times).q
    fine = METHODS[method](keys=whole.keys, times=_chord(whole.keys))
    points = fine.evaluate(np.linspace(*fine.domain, 20_001))[0]
    nearest = [2.0 * math.acos(min(1.0, float(np.abs(points @ q).max()))) for q in found]
    assert max(nearest) < 2e-3
    passed = motion.sample(motion.keyframe_times).q
    assert angle(passed, whole.keys).max() < 1e-6


def test_what_rests_on_its_way_says_so():
    (note,) = made("squad", FAR).certificate.notes
    assert note.startswith(
        "comes to rest 3 times on its way, where squad is only C1; c2_cumulative"
    )


def test_keyframes_along_a_smooth_way_are_passed_at_an_even_pace():
    near = curve("c2_cumulative", FAR).evaluate(np.linspace(0.0, 4.0, 40))[0]
    (note,) = made("squad", near).certificate.notes
    assert note.startswith("at an even pace: ")


@pytest.mark.parametrize("method", ["squad", "nielson_heiland", "spherical_quadratic"])
@pytest.mark.parametrize("step", [0.1, 0.5])
def test_a_curve_with_corners_needs_no_lead_from_rest(method, step):
    motion = made(method, rotations(np.random.default_rng(1), 3, step), approach=False)
    assert motion.certificate.lead_in == 0.0
    assert motion.certificate.keyframe_error < 1e-9


@pytest.mark.parametrize("is_led", [True, False])
@pytest.mark.parametrize("method", METHODS)
def test_every_family_takes_a_duration_or_says_what_it_needs(method, is_led):
    keys = FAR[:2] if "q0" in inspect.signature(METHODS[method]).parameters else FAR
    motion = made(method, keys, duration=12.0, approach=is_led)
    assert motion.end_time - motion.start_time == pytest.approx(12.0)
    found = differences(motion.sample(times_of(motion)).q, PERIOD)
    allowed = (LIMITS["arm"].velocity, LIMITS["arm"].acceleration, LIMITS["arm"].jerk)
    assert all(max(rate) <= 1.000001 * most for rate, most in zip(found, allowed, strict=True))
    with pytest.raises(PlanError, match=r"the keyframes take at least .* got a duration of 0.1 s"):
        made(method, keys, duration=0.1, approach=is_led)


def test_keyframes_that_are_passed_within_a_cycle_are_planned():
    keys = rotations(np.random.default_rng(1), 5, 1e-5)
    motion = made("spherical_quadratic", keys, period=0.01)
    assert motion.certificate.keyframe_error < 1e-9


def test_a_keyframe_beside_another_does_not_take_longer_than_a_stop_there():
    here = np.array(KEYS)
    beside = here[2] + 1e-7 * np.array([0.0, 1.0, 0.0, 0.0])
    keys = np.insert(here, 3, beside / np.linalg.norm(beside), axis=0)
    assert made("bezier_catmull_rom", keys).duration < 1.5 * made("bezier_catmull_rom").duration


def _chord(keys):
    """Return times in proportion to what there is to turn."""
    return np.concatenate([[0.0], np.cumsum(angle(keys[:-1], keys[1:]))])


@pytest.mark.parametrize("method", ["squad", "shoemake_bezier", "normalized_cubic", "slerp"])
def test_positions_go_along_to_rest_with_it(method):
    keys = FAR[:2] if method == "slerp" else FAR
    random = np.random.default_rng(3)
    places = random.uniform(-0.2, 0.2, (len(keys), 3))
    keyframes = [Keyframe(q, position=tuple(p)) for q, p in zip(keys, places, strict=True)]
    request = MotionRequest(keyframes, method=method, approach=True)
    start = State.at_rest(request.keys[0], tuple(places[0]))
    motion = plan(request, start=start, limits=LIMITS["arm"], period=PERIOD)
    even = MotionRequest(**{**request.given(), "pace": "even"})
    assert motion.duration <= plan(even, start=start, limits=LIMITS["arm"], period=PERIOD).duration
    found = motion.sample(motion.keyframe_times)
    assert np.abs(found.position - places).max() < 1e-6
    sent = motion.sample(times_of(motion)).position
    velocity = np.diff(sent, axis=0, prepend=places[:1], append=places[-1:]) / PERIOD
    push = np.diff(velocity, axis=0) / PERIOD
    assert np.linalg.norm(velocity, axis=1).max() <= 1.000001 * LIMITS["arm"].linear_velocity
    assert np.linalg.norm(push, axis=1).max() <= 1.000001 * LIMITS["arm"].linear_acceleration
