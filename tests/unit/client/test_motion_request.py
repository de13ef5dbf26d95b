"""Keyframes as people write them in Python."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from orientd.client.motion_request import motion_request
from orientd.errors import RequestError
from orientd.rotation import Quaternion

HALF = np.sqrt(0.5)


def test_every_way_to_say_an_orientation_is_understood():
    request = motion_request(
        [
            Rotation.from_rotvec([0.0, 0.0, np.pi / 2]),
            Quaternion(w=HALF, x=0, y=0, z=HALF),
            {"rotation_vector": np.array([0.0, 0.0, np.pi / 2])},
            {"quaternion": Quaternion(w=HALF, x=0.0, y=0.0, z=HALF)},
            {"euler": {"axes": "xyz", "degrees": (0, 0, 90)}},
            {"matrix": np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=float)},
        ]
    )
    np.testing.assert_allclose(request.keys, [[HALF, 0, 0, HALF]] * 6, atol=1e-15)


def test_a_rotation_of_many_is_as_many_keyframes():
    many = Rotation.from_rotvec([[0, 0, 0], [0, 0, 0.1], [0, 0, 0.2]])
    request = motion_request(many, times=np.array([0.0, 1.0, 2.0]), positions=np.eye(3))
    np.testing.assert_allclose(request.keys, many.as_quat(scalar_first=True), atol=1e-15)
    assert request.times.tolist() == [0.0, 1.0, 2.0]
    np.testing.assert_array_equal(request.positions, np.eye(3))


@pytest.mark.parametrize(
    "bare",
    [[1.0, 0.0, 0.0, 0.0], (1, 0, 0, 0), np.array([1.0, 0.0, 0.0, 0.0])],
    ids=["list", "tuple", "array"],
)
def test_four_bare_numbers_are_refused(bare):
    with pytest.raises(RequestError, match=r"^keyframes\[1\]: .*does not say its order"):
        motion_request([Quaternion(w=1, x=0, y=0, z=0), bare])


@pytest.mark.parametrize(
    ("keyframes", "complaint"),
    [
        ([5, 6], r"keyframes\[0\]: expected a scipy Rotation.*; got int"),
        ({"quaternion": {}}, "keyframes: expected a sequence, got dict"),
        (Quaternion(w=1, x=0, y=0, z=0), "keyframes: expected a sequence, got Quaternion"),
        ([Rotation.identity(2), Rotation.identity()], r"keyframes\[0\]: expected one rotation"),
        ([Quaternion(w=1.1, x=0, y=0, z=0)] * 2, r"keyframes\[0\].quaternion: norm must be 1"),
        ([Quaternion(w="1", x=0, y=0, z=0)] * 2, r"keyframes\[0\].quaternion.w: expected"),
        ([{"quaternoin": {}}] * 2, r"keyframes\[0\].quaternoin: unknown key"),
    ],
)
def test_what_is_no_orientation_is_refused_by_its_place(keyframes, complaint):
    with pytest.raises(RequestError, match=f"^{complaint}"):
        motion_request(keyframes)


def test_times_are_one_for_each_keyframe():
    with pytest.raises(RequestError, match=r"^times: expected 2, one for each keyframe, got 3"):
        motion_request([Quaternion(w=1, x=0, y=0, z=0)] * 2, times=[0, 1, 2])
    with pytest.raises(RequestError, match=r"^keyframes\[0\].time: given twice"):
        motion_request([{"time": 0, "rotation_vector": [0, 0, 0]}] * 2, times=[0, 1])


def test_fields_are_those_of_a_motion_file():
    request = motion_request(
        Rotation.from_rotvec([[0, 0, 0], [0, 0, 0.1]]),
        method="kks_hermite",
        start_velocity=np.array([0.0, 0.0, 0.1]),
        end_velocity=(0, 0, 0.2),
        velocity_frame="world",
        approach=True,
        limits={"velocity": np.float64(1.0)},
        options={"align": False},
        device_options={"gain": np.float64(300.0)},
    )
    assert request.method == "kks_hermite"
    assert request.start_velocity == (0.0, 0.0, 0.1)
    assert request.velocity_frame == "world"
    assert request.approach
    assert request.limits.velocity == 1.0
    assert dict(request.options) == {"align": False}
    assert dict(request.device_options) == {"gain": 300.0}


def test_arrays_of_the_caller_are_left_alone():
    vector = np.array([0.0, 0.0, 0.1])
    keyframes = [{"rotation_vector": vector}, {"rotation_vector": [0, 0, 0]}]
    motion_request(keyframes, times=[0, 1])
    assert keyframes[0] == {"rotation_vector": vector}
