import math

import numpy as np
import pytest
from planned import LIMITS, anywhere, random_request

from orientd.errors import RequestError
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.planner.timing.knots import chord_knots
from orientd.rotation import exp

ARM = LIMITS["arm"]


def turned(*angles, **fields):
    """Return keyframes at angles about one axis."""
    return [Keyframe(tuple(exp([0.0, 0.0, a]).tolist()), **fields) for a in angles]


def knots(keyframes, **fields):
    return chord_knots(MotionRequest(keyframes), ARM, is_uniform=False, **fields)


def test_intervals_are_proportional_to_the_angles():
    found = knots(turned(0.0, 0.1, 0.4, 0.5))
    assert found.times == pytest.approx([0.0, 0.2, 0.8, 1.0])
    assert found.length == pytest.approx(0.5)
    assert found.kept.tolist() == [0, 1, 2, 3]


def test_whole_turns_lengthen_their_interval():
    keyframes = turned(0.0, 1.0, 2.0)
    keyframes[2] = Keyframe(keyframes[2].q, turns=-1)
    assert knots(keyframes).times[1] == pytest.approx(1.0 / (2.0 + 2 * math.pi))


def test_repeated_keyframes_are_one_and_share_their_time():
    found = knots(turned(0.0, 1.0, 1.0, 2.0))
    assert found.kept.tolist() == [0, 1, 3]
    assert found.times == pytest.approx([0.0, 0.5, 0.5, 1.0])


def test_the_sign_of_a_quaternion_makes_it_no_other_keyframe():
    first, second = turned(0.0, 1.0)
    opposite = Keyframe(tuple(-c for c in second.q))
    assert knots([first, second, opposite]).kept.tolist() == [0, 1]


def test_keyframes_that_are_all_the_same_are_refused():
    with pytest.raises(RequestError, match="are all the same") as caught:
        knots(turned(1.0, 1.0, 1.0))
    assert caught.value.field == "keyframes"


def test_a_move_without_a_turn_takes_time_too():
    q = turned(0.0)[0].q
    found = knots([Keyframe(q, position=(0, 0, 0)), Keyframe(q, position=(0, 0, 0.4))])
    assert found.length == pytest.approx(0.4 * ARM.velocity / ARM.linear_velocity)


def test_a_move_is_spread_over_the_keyframes_without_position():
    q = turned(0.0, 0.0, 0.0)
    keyframes = [
        Keyframe(q[0].q, position=(0, 0, 0)),
        Keyframe(q[1].q),
        Keyframe(q[2].q, position=(0, 0, 0.4)),
    ]
    assert knots(keyframes).times == pytest.approx([0.0, 0.5, 1.0])


def test_curves_that_do_not_interpolate_get_equal_intervals():
    request = MotionRequest(turned(0.0, 0.1, 1.0))
    found = chord_knots(request, ARM, is_uniform=True)
    assert found.times == pytest.approx([0.0, 0.5, 1.0])


def test_one_cycle_less_would_break_a_limit():
    # Of a single turn about an axis the peaks are known: the shortest duration is, too.
    request = MotionRequest(turned(0.0, 1.0), method="kks_quintic_hermite", pace="even")
    motion = plan(request, start=State.at_rest(request.keys[0]), limits=ARM, period=0.001)
    exact = max(1.875 / 2.5, math.sqrt(5.7735 / (0.95 * 17.0)), math.cbrt(60 / (0.95 * 8500)))
    assert exact <= motion.duration <= exact * 1.002


def test_higher_limits_never_make_a_motion_longer():
    random = np.random.default_rng(7)
    for _ in range(4):
        start, request = anywhere(random), random_request(random, ARM)
        slow = plan(request, start=start, limits=ARM, period=0.002)
        fast = plan(request, start=start, limits=ARM.scaled(2.0), period=0.002)
        assert fast.duration < slow.duration
