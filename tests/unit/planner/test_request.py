import math

import numpy as np
import pytest

from orientd.errors import RequestError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.state import State
from orientd.rotation import exp, rotate

ONE = (1.0, 0.0, 0.0, 0.0)
TWO = tuple(exp([0.0, 0.0, 1.0]).tolist())


def refusal(*keyframes, **fields):
    with pytest.raises(RequestError) as caught:
        MotionRequest(keyframes, **fields)
    return caught.value.field, caught.value.problem


def refused(*values, **fields):
    with pytest.raises(RequestError) as caught:
        Keyframe(*values, **fields)
    return caught.value.field, caught.value.problem


def test_a_request_has_its_keyframes_in_arrays():
    request = MotionRequest([Keyframe(ONE, 1.0, (1, 2, 3)), Keyframe(TWO, 2.5, turns=2)])
    assert request.keys == pytest.approx(np.array([ONE, TWO]))
    assert request.times.tolist() == [1.0, 2.5]
    assert request.positions[0].tolist() == [1, 2, 3]
    assert np.isnan(request.positions[1]).all()
    assert request.turns.tolist() == [0, 2]
    assert request.method == "c2_cumulative"


def test_times_and_positions_are_absent_where_no_keyframe_has_them():
    request = MotionRequest([Keyframe(ONE), Keyframe(TWO)])
    assert request.times is None
    assert request.positions is None


def test_a_request_cannot_be_changed():
    request = MotionRequest([Keyframe(ONE), Keyframe(TWO)], options={"align": True})
    with pytest.raises(AttributeError):
        request.approach = True
    with pytest.raises(TypeError):
        request.options["align"] = False


def test_a_single_keyframe_is_approached():
    assert MotionRequest([Keyframe(ONE)]).approach


def test_a_single_keyframe_has_neither_time_nor_start_velocity():
    assert refusal(Keyframe(ONE, 1.0))[0] == "keyframes[0].time"
    assert refusal(Keyframe(ONE), start_velocity=(0, 0, 1))[0] == "start_velocity"


def test_a_norm_within_tolerance_is_accepted_and_made_exact():
    off = tuple(1.0000009 * c for c in TWO)
    request = MotionRequest([Keyframe(ONE), Keyframe(off)])
    assert np.linalg.norm(request.keys[1]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(
    ("q", "problem"),
    [
        ((1.002, 0, 0, 0), "norm must be 1 within 0.001, got 1.002; divide it by its norm"),
        ((1, 0, 0), "expected four numbers w, x, y, z, got (1, 0, 0); give 4"),
        (
            "north",
            "expected {w: ..., x: ..., y: ..., z: ...}, got the text 'north'; name the components",
        ),
    ],
)
def test_an_orientation_that_is_none_is_named(q, problem):
    assert refused(q) == ("quaternion", problem)


@pytest.mark.parametrize("part", [math.nan, math.inf])
def test_a_component_that_is_not_finite_is_named(part):
    assert refused((ONE[0], part, 0.0, 0.0)) == (
        "quaternion.x",
        f"expected a finite number, got {part}; give a number such as 1.5",
    )


@pytest.mark.parametrize(
    ("times", "index", "words"),
    [
        ((0, None, 1), 1, "every keyframe needs one"),
        ((None, None, 1), 0, r"keyframes\[2\] has one"),
    ],
)
def test_a_time_that_does_not_fit_is_named(times, index, words):
    import re

    field, problem = refusal(*(Keyframe(ONE, t) for t in times))
    assert field == f"keyframes[{index}].time"
    assert re.search(words, problem)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("time", value) for value in (math.nan, math.inf, "soon", True)),
        *(("position", value) for value in ((1, 2), "here", 3, (1, 2, 1e13))),
        *(("turns", value) for value in (0.5, True, "once", 1001, -1001)),
        *(("name", value) for value in (3, "x" * 81)),
    ],
)
def test_a_field_of_a_keyframe_that_does_not_fit_is_named(name, value):
    assert refused(TWO, **{name: value})[0] == name
    field, _ = refusal({"q": ONE}, {"q": TWO, name: value})
    assert field == f"keyframes[1].{name}"


def test_an_argument_without_its_name_is_named_too():
    with pytest.raises(RequestError, match=r"^time: expected a number, got the text 'soon'"):
        Keyframe(ONE, "soon")
    with pytest.raises(RequestError, match=r"^position\[2\]: expected a finite number, got nan"):
        Keyframe(ONE, 1.0, (1.0, 2.0, math.nan))


def test_there_is_nothing_to_turn_before_the_first_keyframe():
    field, problem = refusal(Keyframe(ONE, turns=1), Keyframe(TWO))
    assert field == "keyframes[0].turns"
    assert "no keyframe before the first" in problem


@pytest.mark.parametrize("name", ["start_velocity", "end_velocity"])
@pytest.mark.parametrize("velocity", [(1, 2), (1, 2, math.inf), "fast", 3.0])
def test_a_velocity_that_is_none_is_named(name, velocity):
    field, _ = refusal(Keyframe(ONE), Keyframe(TWO), **{name: velocity})
    assert field.partition("[")[0] == name


def test_the_velocity_frame_is_body_or_world():
    field, problem = refusal(Keyframe(ONE), Keyframe(TWO), velocity_frame="tool")
    assert field == "velocity_frame"
    assert problem == "expected 'body' or 'world', got the text 'tool'; give one of them"


def test_world_velocities_are_turned_into_the_frame_of_their_keyframe():
    end = tuple(exp([0.3, -0.8, 0.4]).tolist())
    request = MotionRequest(
        [Keyframe(ONE), Keyframe(end)],
        end_velocity=(0.1, 0.2, 0.3),
        velocity_frame="world",
        limits=Limits.partial(velocity=1.0),
    )
    assert rotate(np.array(end), request.omega_end) == pytest.approx([0.1, 0.2, 0.3])
    assert request.omega_start is None


def test_a_state_at_rest_says_so():
    state = State.at_rest(TWO, (1, 2, 3))
    assert state.is_at_rest
    moving = State(state.q, np.array([0, 0, 1e-3]), state.alpha_body, state.position)
    assert not moving.is_at_rest
