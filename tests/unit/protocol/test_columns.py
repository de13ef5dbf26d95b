"""Keyframes in columns say what those of a file say."""

import math

import pytest

from orientd import motion_file
from orientd.errors import RequestError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.protocol import control_pb2 as pb
from orientd.protocol.columns import keyframe_columns, keyframe_rows
from orientd.protocol.limits import limits_from_message, limits_to_message, limits_to_wish

ONE = {"quaternion": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}}


def loads(columns, text=b"{}"):
    rows = keyframe_rows(pb.KeyframeColumns(**columns).SerializeToString(), 1000)
    return motion_file.loads(text, rows=rows)


def test_limits_of_axes_survive_the_wire_in_reports():
    table = {"velocity": [2, 1, 2.2], "jerk": 100, "acceleration": [4, 5, 6]}
    request = motion_file.parse({"keyframes": [ONE, ONE], "limits": table})
    limits = DEFAULT_LIMITS.narrowed(request.limits)
    assert limits_from_message(limits_to_message(limits)) == limits
    assert limits_from_message(limits_to_message(DEFAULT_LIMITS)) == DEFAULT_LIMITS


def test_a_quantity_limited_twice_is_refused():
    message = pb.Limits(jerk=1, axis_jerk=pb.Vector3(x=1, y=1, z=1))
    with pytest.raises(RequestError, match="expected one of jerk and axis_jerk, got both"):
        limits_to_wish(message)


def test_keyframes_survive_their_columns():
    keyframes = [
        {**ONE, "time": 0, "name": "grasp"},
        {"quaternion": {"w": 0, "x": 0, "y": 0, "z": 1}, "time": 1.5, "position": [1, 2, 3]},
        {**ONE, "time": 2, "turns": -2, "relative": True, "free_roll": True, "frame": "camera"},
    ]
    rows = keyframe_rows(keyframe_columns(keyframes), 3)
    assert motion_file.parse({"keyframes": rows}) == motion_file.parse({"keyframes": keyframes})


@pytest.mark.parametrize(
    "keyframes",
    [
        [ONE, {"rotation_vector": [0, 0, 1]}],
        [{"euler": {"axes": "x", "degrees": [1]}}],
        [{**ONE, "time": 1.0}, ONE],
        [{**ONE, "time": "1"}],
        [{**ONE, "position": [math.nan, 0, 0]}],
        [{**ONE, "turns": 1 << 40}],
        [{**ONE, "relative": 1}],
        [{**ONE, "name": None}],
        [{"quaternion": {"w": 10**400, "x": 0, "y": 0, "z": 0}}],
        [{"quaternion": [1, 0, 0, 0]}],
        [{"position": [1, 2, 3]}],
    ],
)
def test_keyframes_that_have_no_columns_are_left_to_the_text(keyframes):
    assert keyframe_columns(keyframes) is None


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
        ({"rotation_vectors": [0.0] * 6}, r"keyframes\[0\]: expected one of quaternion"),
    ],
)
def test_columns_that_are_wrong_are_refused_by_name(columns, error):
    with pytest.raises(RequestError, match=f"^{error}"):
        loads({"quaternions": [1.0, 0.0, 0.0, 0.0, 0.8, 0.6, 0.0, 0.0], **columns})


@pytest.mark.parametrize("keyframes", ["[{rotation_vector: [0, 0, 1]}]", "0", "{}", "''"])
def test_columns_and_keyframes_together_are_refused(keyframes):
    text = f"keyframes: {keyframes}".encode()
    with pytest.raises(RequestError, match="columns: expected without keyframes only"):
        loads({"quaternions": [1.0, 0.0, 0.0, 0.0]}, text)


def test_columns_that_are_no_message_are_refused():
    with pytest.raises(RequestError, match="columns: cannot be read"):
        keyframe_rows(b"nonsense", 1000)


def test_more_keyframes_than_there_may_be_are_refused():
    columns = pb.KeyframeColumns(rotation_vectors=[0.0] * 9).SerializeToString()
    with pytest.raises(RequestError, match="keyframes: expected at most 2, got 3"):
        keyframe_rows(columns, 2)
