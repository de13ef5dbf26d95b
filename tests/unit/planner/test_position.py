from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from orientd import rotation
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.connect.position_stop import position_lead
from orientd.planner.path.position import PositionPath, position_path
from orientd.planner.planning import plan
from orientd.planner.state import State

RANDOM = np.random.default_rng(11)
TIMES = np.cumsum(RANDOM.uniform(0.3, 1.2, 8))
POINTS = RANDOM.normal(size=(8, 3))
PATH = position_path(TIMES, POINTS, np.zeros(3))


def derivative(path, times, order, h=1e-3):
    """Return a central difference of the position, of *order* 1 to 4."""
    steps = np.arange(-2, 3)
    weights = {
        1: [1, -8, 0, 8, -1],
        2: [-1, 16, -30, 16, -1],
        3: [-1, 2, 0, -2, 1],
        4: [1, -4, 6, -4, 1],
    }
    scale = {1: 12 * h, 2: 12 * h**2, 3: 2 * h**3, 4: h**4}[order]
    return sum(w * path.sample(times + s * h)[0] for s, w in zip(steps, weights[order])) / scale  # noqa: B905


def test_every_point_is_passed_at_its_time():
    assert PATH.sample(TIMES)[0] == pytest.approx(POINTS, abs=1e-12)


def test_points_without_position_are_left_out():
    some = POINTS.copy()
    some[[0, 3, 7]] = np.nan
    path = position_path(TIMES, some, np.zeros(3))
    is_given = np.isfinite(some[:, 0])
    assert path.sample(TIMES[is_given])[0] == pytest.approx(some[is_given], abs=1e-12)
    held = path.sample(TIMES[[0, 7]])[0]
    assert held == pytest.approx(some[[1, 6]], abs=0)


def test_the_velocity_is_the_derivative_of_the_position():
    times = RANDOM.uniform(TIMES[0], TIMES[-1], 100)
    assert PATH.sample(times)[1] == pytest.approx(derivative(PATH, times, 1), abs=1e-8)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_derivatives_up_to_the_fourth_are_continuous_at_inner_points(order):
    h, gap = 1e-3, 2.5e-3
    before, after = (derivative(PATH, TIMES[1:-1] + s * gap, order, h) for s in (-1, 1))
    # Over the gap a derivative changes with the next one, which is bounded.
    rate = (
        np.abs(PATH.coefficients[:, 5]).max() * 120 + np.abs(derivative(PATH, TIMES[1:-1], 4)).max()
    )
    assert np.abs(after - before).max() < 8 * gap * rate


@pytest.mark.parametrize("count", [3, 4, 9, 400])
@pytest.mark.parametrize("uneven", [1.0, 1e3])
def test_the_spline_is_that_of_scipy(count, uneven):
    source = np.random.default_rng(count)
    times = np.cumsum(np.exp(source.uniform(0.0, np.log(4.0 * uneven), count)) / uneven)
    points = source.normal(size=(count, 3))
    velocity, push = source.normal(size=(2, 3))
    for first in (None, (points[0], velocity, push)):
        path = position_path(times, points, np.zeros(3), first)
        begin = np.zeros((2, 3)) if first is None else np.stack(first[1:])
        ends = ([(1, begin[0]), (2, begin[1])], [(1, np.zeros(3)), (2, np.zeros(3))])
        spline = make_interp_spline(times, points, k=5, bc_type=ends)
        inside = np.linspace(times[0], times[-1], 2001)[:-1]
        for ours, order in (
            (path.sample(inside)[0], 0),
            *zip(path.sample(inside)[1:], (1, 2), strict=True),
        ):
            exact = spline(inside, nu=order)
            assert np.abs(ours - exact).max() < 1e-9 * np.abs(exact).max()


def test_the_path_begins_and_ends_at_rest_without_acceleration():
    for index, sign in ((0, 1), (-1, -1)):
        near = PATH.sample(TIMES[[index]] + sign * 1e-4)
        assert np.abs(near[1]).max() < 1e-4
        assert np.abs(near[0] - POINTS[index]).max() < 1e-8
    assert not PATH.sample(TIMES[[0, -1]])[1].any()


def test_the_position_is_held_outside():
    position, velocity, _ = PATH.sample(np.array([TIMES[0] - 5, TIMES[-1] + 5]))
    assert position == pytest.approx(POINTS[[0, -1]], abs=0)
    assert not velocity.any()


def test_two_points_are_joined_by_the_quintic():
    path = position_path(np.array([1.0, 3.0]), np.array([[0, 0, 0], [1, 0, 0.0]]), np.zeros(3))
    u = np.linspace(0, 1, 11)
    expected = 10 * u**3 - 15 * u**4 + 6 * u**5
    assert path.sample(1.0 + 2.0 * u)[0][:, 0] == pytest.approx(expected, abs=1e-13)


def test_without_positions_the_commanded_one_is_held():
    path = position_path(TIMES, None, np.array([1.0, 2.0, 3.0]))
    assert path.is_held
    assert path.sample(TIMES)[0].tolist() == [[1.0, 2.0, 3.0]] * 8


def test_a_single_position_is_held():
    one = np.full((8, 3), np.nan)
    one[4] = 7.0
    assert position_path(TIMES, one, np.zeros(3)).sample(TIMES)[0].tolist() == [[7.0] * 3] * 8


def test_a_slowed_path_is_the_same_path_later():
    slow = PATH.slowed(2.5).delayed(1.0)
    position, velocity, _ = slow.sample(2.5 * TIMES[1:-1] + 1.0)
    assert position == pytest.approx(POINTS[1:-1], abs=1e-12)
    assert velocity == pytest.approx(PATH.sample(TIMES[1:-1])[1] / 2.5, abs=1e-12)


@pytest.mark.parametrize("path", [PATH.delayed(5.0), PositionPath.held(np.ones(3))])
def test_a_move_before_the_path_brings_it_to_its_beginning(path):
    moved = path.after_move_from(np.full(3, 9.0), 2.0)
    position, velocity, _ = moved.sample(np.array([-0.5, 0.0, 2.0, 3.0]))
    assert position[:2].tolist() == [[9.0] * 3] * 2
    assert position[2:] == pytest.approx(np.stack([path.first] * 2), abs=1e-12)
    assert np.abs(velocity).max() < 1e-12
    later = TIMES + 5.0
    assert moved.sample(later)[0] == pytest.approx(path.sample(later)[0], abs=1e-12)


def test_no_move_is_put_before_a_path_that_is_there_already():
    assert PATH.after_move_from(PATH.first, 0.0) is PATH


@pytest.mark.parametrize("target", [None, (0.4, 0.0, 0.0), (-0.1, 0.0, 0.0)])
def test_a_position_at_its_limit_that_gains_speed_hardly_goes_beyond_it(target):
    limits, period = Limits(1.0, 3.0, 60.0, 0.5, 2.0), 0.002
    x, start = np.eye(3)[0], State.at_rest((1.0, 0.0, 0.0, 0.0))
    start = replace(start, velocity=0.4995 * x, acceleration=1.5 * x)
    goal = None if target is None else np.array(target)
    path = position_lead(start, goal, limits=limits, period=period)
    times = period * np.arange(int(path.breaks[-1] / period) + 2)
    position, velocity, _ = path.sample(times)
    assert np.abs(np.diff(position[:, 0])).max() / period <= 0.5 * 1.001
    assert not velocity[-1].any()
    assert goal is None or position[-1] == pytest.approx(goal)


def test_a_position_may_begin_in_motion_where_the_orientation_begins_at_rest():
    keyframe = Keyframe(tuple(rotation.exp([0.1, 0.5, 0.1])), position=(0.1, -0.2, 0.1))
    moving = State(
        np.array([1.0, 0.0, 0.0, 0.0]), *np.zeros((3, 3)), velocity=np.array([0.05, 0.0, -0.02])
    )
    motion = plan(
        MotionRequest([keyframe], approach=True), start=moving, limits=DEFAULT_LIMITS, period=0.002
    )
    assert motion.records(0, 1)[0, 13:16] == pytest.approx(moving.velocity, abs=1e-12)


@pytest.mark.parametrize("seed", [8, 165, 203, 220])
def test_near_and_far_keyframes_take_no_longer_than_moves_with_a_rest_at_each(seed):
    rng, keyframes = np.random.default_rng(seed), []
    q, place = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)
    for _ in range(6):
        keyframes.append(Keyframe(tuple(q.tolist()), position=tuple(place.tolist())))
        q = rotation.multiply(q, rotation.exp(0.01 * rng.choice([0.01, 1.0]) * rng.normal(size=3)))
        place = place + 0.5 * rng.choice([0.001, 1.0]) * rng.normal(size=3)
    moves = [planned_through(list(pair)) for pair in pairwise(keyframes)]
    assert planned_through(keyframes) <= 1.001 * sum(moves)


def planned_through(keyframes):
    first = keyframes[0]
    start = State.at_rest(first.q, first.position)
    request = MotionRequest(keyframes)
    return plan(request, start=start, limits=DEFAULT_LIMITS, period=0.01).duration
