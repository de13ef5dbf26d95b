"""Notes on effects that a request does not lead one to expect."""

import numpy as np
import pytest
from asked import made
from planned import LIMITS, PERIOD, rotations

from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State

ARM = LIMITS["arm"]


def planned(turn, distance, limits=ARM, **fields):
    keyframes = [
        Keyframe((1.0, 0.0, 0.0, 0.0), position=(0.0, 0.0, 0.0)),
        Keyframe(rotation_vector=(0.0, 0.0, turn), position=(distance, 0.0, 0.0)),
    ]
    request = MotionRequest(keyframes, **fields)
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    return plan(request, start=start, limits=limits, period=PERIOD)


def ruling(motion):
    return [one for one in motion.certificate.notes if "sets the speed" in one]


def test_a_rotation_that_halves_the_speed_of_the_position_is_named_with_that_speed():
    motion = planned(3.0, 0.3)
    (note,) = ruling(motion)
    speed = motion.certificate.peak_linear_velocity.value
    assert speed < 0.5 * ARM.linear_velocity
    assert "the limit of the angular " in note
    assert f"the position moves at {speed:.3g} m/s at most, its limit is 1 m/s" in note


def test_a_position_that_halves_the_speed_of_the_rotation_is_named_with_that_speed():
    motion = planned(0.3, 3.0)
    (note,) = ruling(motion)
    speed = motion.certificate.peak_velocity.value
    assert "the limit of the velocity of the position sets the speed" in note
    assert f"the device turns at {speed:.3g} rad/s at most, its limit is 2.5 rad/s" in note


@pytest.mark.parametrize("fields", [{"duration": 20.0}, {"pace": "even"}])
def test_no_limit_sets_a_requested_speed(fields):
    assert ruling(planned(3.0, 0.3, **fields)) == []


@pytest.mark.parametrize(("turn", "distance"), [(0.0, 3.0), (1e-14, 3.0), (3.0, 0.0)])
def test_what_does_not_move_is_not_slowed(turn, distance):
    assert ruling(planned(turn, distance)) == []


def test_motions_where_both_are_about_as_fast_have_no_note():
    assert ruling(planned(2.5, 1.0)) == []


def test_a_method_that_takes_longer_than_single_moves_says_so():
    motion = made("long_lead_out")
    (note,) = [one for one in motion.certificate.notes if "single moves" in one]
    assert note.startswith(f"takes {motion.duration:.4g} s: single moves with a stop at every")
    # 0.658 s by motions of the planner's own.
    assert float(note.split(" would take ")[1].split(" s;")[0]) == pytest.approx(0.61, rel=0.02)


def test_near_keyframes_with_a_velocity_take_hardly_longer_than_single_moves():
    # The curve of minimum effort takes 13.2 s, and single moves 7.4 s.
    assert made("near_keyframes").duration < 1.05 * 13.2288 / 1.78


def test_the_usual_methods_are_quicker_than_single_moves_and_have_no_note():
    keys = rotations(np.random.default_rng(5), 6, 0.4)
    for method in ("c2_cumulative", "minimum_effort", "rotation_vector_spline"):
        request = MotionRequest([Keyframe(q) for q in keys], method=method)
        motion = plan(request, start=State.at_rest(keys[0]), limits=ARM, period=PERIOD)
        assert motion.certificate.notes == ()


def test_a_motion_at_low_limits_with_a_fast_end_is_compared_with_single_moves():
    limits = Limits(10.0, 0.5, 5.0, 1.0, 10.0)
    keys = rotations(np.random.default_rng(6), 3, 0.4)
    request = MotionRequest([Keyframe(q) for q in keys], end_velocity=(0.0, 6.0, 0.0))
    motion = plan(request, start=State.at_rest(keys[0]), limits=limits, period=PERIOD)
    moves, start = 0.0, State.at_rest(keys[0])
    for q, omega in zip(keys[1:], (None, (0.0, 6.0, 0.0)), strict=True):
        goal = MotionRequest([Keyframe(q)], end_velocity=omega)
        moves += plan(goal, start=start, limits=limits, period=PERIOD).duration
        start = State.at_rest(q)
    noted = any("single moves" in one for one in motion.certificate.notes)
    assert noted == (motion.duration >= 1.2 * moves)
