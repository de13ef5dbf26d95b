"""A motion request says the same on the wire, in a file and in Python."""

import math
from dataclasses import fields

import numpy as np
import pytest

from orientd import motion_file
from orientd.errors import RequestError
from orientd.planner import DEFAULT_LIMITS, MotionRequest
from orientd.protocol import control_pb2 as pb
from orientd.protocol.limits import limits_from_message, limits_to_message
from orientd.protocol.motion import from_request, to_request

FILE = {
    "method": "kks_hermite_spline",
    "keyframes": [
        {"time": 0.0, "quaternion": {"w": 1, "x": 0, "y": 0, "z": 0}},
        {"time": 1.5, "rotation_vector": [0.1, 0.2, 0.3], "position": [1, 2, 3]},
        {"time": 2.5, "euler": {"axes": "xyz", "degrees": [10, 20, 30]}},
        {"time": 3.5, "matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},
    ],
    "velocity_frame": "world",
    "start_velocity": [0.1, 0, 0.2],
    "end_velocity": [0, 0, 0.1],
    "approach": True,
    "limits": {"velocity": 2.0, "jerk": 100},
    "options": {"align": False},
    "device_options": {"gain": 300, "lookahead": 0.1},
}


def same(one, other):
    np.testing.assert_array_equal(one.keys, other.keys)
    np.testing.assert_array_equal(one.times, other.times)
    np.testing.assert_array_equal(one.positions, other.positions)
    np.testing.assert_array_equal(one.turns, other.turns)
    for name in (
        "method",
        "start_velocity",
        "end_velocity",
        "velocity_frame",
        "approach",
        "limits",
        "options",
        "device_options",
    ):
        assert getattr(one, name) == getattr(other, name), name


def test_limits_of_axes_survive_the_wire_in_requests_and_in_reports():
    table = {"velocity": [2, 1, 2.2], "jerk": 100, "acceleration": [4, 5, 6]}
    request = motion_file.parse({**FILE, "limits": table})
    message = from_request(request)
    assert not message.limits.HasField("velocity")
    same(to_request(message), request)
    limits = DEFAULT_LIMITS.narrowed(request.limits)
    assert limits_from_message(limits_to_message(limits)) == limits
    assert limits_from_message(limits_to_message(DEFAULT_LIMITS)) == DEFAULT_LIMITS


def test_a_quantity_limited_twice_is_refused():
    message = pb.MotionRequest(limits=pb.Limits(jerk=1, axis_jerk=pb.Vector3(x=1, y=1, z=1)))
    with pytest.raises(RequestError, match="expected one of jerk and axis_jerk, got both"):
        to_request(message)


def test_what_is_not_set_has_the_default_of_a_file():
    one = {"quaternion": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}}
    message = pb.MotionRequest(keyframes=[pb.Keyframe(quaternion=pb.Quaternion(w=1.0))] * 2)
    request, expected = to_request(message), motion_file.parse({"keyframes": [one] * 2})
    for field in fields(MotionRequest):
        if field.init:
            assert getattr(request, field.name) == getattr(expected, field.name), field.name


def test_every_form_of_an_orientation_is_that_of_a_file():
    vector = pb.Vector3(x=1, y=2, z=3)
    quarter = [0, -1, 0, 1, 0, 0, 0, 0, 1]
    message = pb.MotionRequest(
        keyframes=[
            pb.Keyframe(rotation_vector=vector, time=0.5, position=vector),
            pb.Keyframe(euler=pb.EulerAngles(axes="ZYX", degrees=[1, 2, 3]), time=1, turns=2),
            pb.Keyframe(matrix=pb.Matrix(elements=quarter), time=2),
        ]
    )
    mapping = {
        "keyframes": [
            {"rotation_vector": [1, 2, 3], "time": 0.5, "position": [1, 2, 3]},
            {"euler": {"axes": "ZYX", "degrees": [1, 2, 3]}, "time": 1, "turns": 2},
            {"matrix": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "time": 2},
        ]
    }
    same(to_request(message), motion_file.parse(mapping))


def test_a_velocity_without_its_frame_is_refused():
    message = pb.MotionRequest(end_velocity=pb.Vector3(z=1.0))
    with pytest.raises(RequestError, match=r"^velocity_frame: expected body or world"):
        to_request(message)


@pytest.mark.parametrize(
    ("keyframe", "field"),
    [
        (pb.Keyframe(), "keyframes[1]"),
        (pb.Keyframe(quaternion=pb.Quaternion(w=math.nan)), "keyframes[1].quaternion.w"),
        (pb.Keyframe(matrix=pb.Matrix(elements=[1.0] * 8)), "keyframes[1].matrix"),
        (pb.Keyframe(euler=pb.EulerAngles(axes="xyz")), "keyframes[1].euler.degrees"),
        (pb.Keyframe(euler=pb.EulerAngles(axes="xyq")), "keyframes[1].euler.axes"),
    ],
    ids=["nothing", "nan", "matrix", "angles", "axes"],
)
def test_a_bad_keyframe_is_named_as_in_a_file(keyframe, field):
    good = pb.Keyframe(quaternion=pb.Quaternion(w=1.0))
    with pytest.raises(RequestError) as caught:
        to_request(pb.MotionRequest(keyframes=[good, keyframe]))
    assert caught.value.field.startswith(field)


def test_options_keep_whole_numbers_and_lists():
    options = {"order": 4, "ratio": 0.5, "name": "a", "on": True, "no": None, "list": [1, [2.5]]}
    message = pb.MotionRequest(keyframes=[pb.Keyframe(quaternion=pb.Quaternion(w=1.0))])
    message.device_options.update(options)
    read = to_request(message).device_options
    assert read == options
    assert isinstance(read["order"], int)


@pytest.mark.parametrize(
    ("columns", "error"),
    [
        ({"times": [0.0, 1.0, 2.0]}, "columns.times: expected 2 entries for 2 keyframes, got 3"),
        ({"positions": [0.0] * 5}, "columns.positions: expected 6 entries for 2 keyframes, got 5"),
        ({"quaternions": [1.0] * 7}, "columns.quaternions: expected 4 entries for 1 keyframes"),
        (
            {"quaternions": [1.0, 0.0, 0.0, math.nan]},
            r"keyframes\[0\].quaternion.z: expected a finite",
        ),
        ({"times": [0.0, math.nan]}, r"keyframes\[1\].time: expected a finite number, got nan"),
        ({"turns": [1, 0]}, r"keyframes\[0\].turns: there is no keyframe before the first"),
    ],
)
def test_columns_that_are_wrong_are_refused_by_name(columns, error):
    whole = {"quaternions": [1.0, 0.0, 0.0, 0.0, 0.8, 0.6, 0.0, 0.0], **columns}
    with pytest.raises(RequestError, match=f"^{error}"):
        to_request(pb.MotionRequest(columns=pb.KeyframeColumns(**whole)))


def test_columns_and_keyframes_together_are_refused():
    columns = pb.KeyframeColumns(quaternions=[1.0, 0.0, 0.0, 0.0])
    keyframe = pb.Keyframe(quaternion=pb.Quaternion(w=1.0))
    with pytest.raises(RequestError, match="columns: expected without keyframes only"):
        to_request(pb.MotionRequest(keyframes=[keyframe], columns=columns))


def test_an_option_without_a_value_is_refused():
    message = pb.MotionRequest(keyframes=[pb.Keyframe(quaternion=pb.Quaternion(w=1.0))])
    message.options.fields["order"].SetInParent()
    with pytest.raises(RequestError, match="options: expected a value for every key, got none"):
        to_request(message)
