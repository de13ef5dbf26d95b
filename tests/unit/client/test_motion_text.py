"""Motions as people write them in Python, as the client sends them and the planner reads them."""

from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from motions import read
from scipy.spatial.transform import Rotation

from orientd.client.motion_text import MotionText, motion_text
from orientd.errors import RequestError
from orientd.motion_file import parse
from orientd.rotation import Quaternion

HALF = np.sqrt(0.5)


def test_every_way_to_say_an_orientation_is_understood():
    request = read(
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
    request = read(many, times=np.array([0.0, 1.0, 2.0]), positions=np.eye(3))
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
        read([Quaternion(w=1, x=0, y=0, z=0), bare])


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
        read(keyframes)


def test_times_are_one_for_each_keyframe():
    with pytest.raises(RequestError, match=r"^times: expected 2, one for each keyframe, got 3"):
        read([Quaternion(w=1, x=0, y=0, z=0)] * 2, times=[0, 1, 2])
    with pytest.raises(RequestError, match=r"^keyframes\[0\].time: given twice"):
        read([{"time": 0, "rotation_vector": [0, 0, 0]}] * 2, times=[0, 1])


def test_fields_are_those_of_a_motion_file():
    request = read(
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
    read(keyframes, times=[0, 1])
    assert keyframes[0] == {"rotation_vector": vector}


MANY = 1200
VECTORS = np.random.default_rng(1).normal(0.0, 0.6, (MANY, 3))
LISTS = {
    "quaternion": lambda v: Rotation.from_rotvec(v).as_quat(scalar_first=True).tolist(),
    "rotation_vector": lambda v: v.tolist(),
    "euler": lambda v: {"axes": "xyz", "degrees": np.degrees(v).tolist()},
    "matrix": lambda v: Rotation.from_rotvec(v).as_matrix().tolist(),
    "direction": lambda v: v.tolist(),
    "azimuth_elevation": lambda v: {"azimuth": 90.0 * v[0], "elevation": 20.0 * v[1]},
    "look_at": lambda v: {"point": v.tolist(), "place": [5.0, 5.0, 5.0]},
}


def mapping(form, vector, k):
    given = LISTS[form](vector)
    if form == "quaternion":
        given = dict(zip("wxyz", given, strict=True))
    return {form: given, "time": 0.1 * k, "position": vector.tolist()}


@pytest.mark.parametrize("bound", ["", "MOST_BYTES", "MOST_VALUES"])
@pytest.mark.parametrize("form", LISTS)
def test_many_keyframes_of_every_form_say_what_few_say(monkeypatch, form, bound):
    if bound:
        monkeypatch.setattr(f"orientd.client.motion_text.{bound}", 10_000)
    keyframes = [mapping(form, vector, k) for k, vector in enumerate(VECTORS)]
    request, expected = read(keyframes), parse({"keyframes": keyframes})
    assert request.keyframes == expected.keyframes
    has_columns = bool(motion_text(keyframes).columns)
    assert has_columns == (form in ("quaternion", "rotation_vector") or bool(bound))


def test_a_large_rotation_is_sent_as_columns_of_the_same_numbers():
    many = Rotation.from_rotvec(VECTORS)
    times, positions = 0.1 * np.arange(MANY), VECTORS[::-1].copy()
    sent = motion_text(many, times=times, positions=positions)
    assert len(sent.columns) == pytest.approx(8 * 8 * MANY, rel=1e-3)
    few = [read(many[k : k + 400]).keyframes for k in range(0, MANY, 400)]
    request = read(many, times=times, positions=positions)
    assert [one.q for one in request.keyframes] == [one.q for part in few for one in part]
    np.testing.assert_array_equal(request.times, times)
    np.testing.assert_array_equal(request.positions, positions)


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        ({"times": np.arange(MANY - 1)}, f"times: expected {MANY}, one for each keyframe, got"),
        ({"times": ["soon"] * MANY}, r"keyframes\[0\].time: expected a number, got the text"),
        ({"times": [True] * MANY}, r"keyframes\[0\].time: expected a number, got true"),
        ({"times": np.full(MANY, np.nan)}, r"keyframes\[0\].time: expected a finite number"),
        (
            {"positions": np.full((MANY, 3), np.nan)},
            r"keyframes\[0\].position\[0\]: expected a",
        ),
        ({"positions": np.zeros((MANY, 2))}, r"keyframes\[0\].position: expected 3 entries"),
        (
            {"times": np.ma.array(np.arange(MANY), mask=np.arange(MANY) == 2)},
            r"keyframes\[2\].time: missing",
        ),
        (
            {"positions": np.ma.array(np.zeros((MANY, 3)), mask=np.arange(3 * MANY) == 7)},
            r"keyframes\[2\].position\[1\]: expected a number, got nothing",
        ),
    ],
)
def test_a_column_of_many_that_is_wrong_is_named(fields, complaint):
    many = Rotation.from_rotvec(VECTORS)
    with pytest.raises(RequestError, match=f"^{complaint}"):
        read(many, **fields)
    listed = [{"rotation_vector": vector} for vector in VECTORS.tolist()]
    with pytest.raises(RequestError, match=f"^{complaint}"):
        read(listed, **fields)


@pytest.mark.parametrize(
    ("last", "complaint"),
    [
        ({"rotation_vector": [0, 0]}, "rotation_vector: expected 3 entries, got 2"),
        ({"rotation_vector": [0, 0, "1"]}, r"rotation_vector\[2\]: expected a number"),
        ({"quaternion": {"w": 1, "x": 0, "y": 0}}, "quaternion.z: missing"),
        ({"rotation_vector": [0, 0, 0], "turns": 1.5}, "turns: expected a whole number, got 1.5"),
        ({"rotation_vector": [0, 0, 0], "tme": 1}, "tme: unknown key"),
        ({"rotation_vector": [0, 0, 0], "name": None}, "name: expected a text, got nothing"),
        ({"rotation_vector": [0, 0, 0], "turns": None}, "turns: expected a whole number, got"),
        ({"rotation_vector": [0, 0, 0], "free_roll": None}, "free_roll: expected true or false"),
    ],
)
def test_the_last_of_many_keyframes_is_named(last, complaint):
    keyframes = [{"rotation_vector": vector} for vector in VECTORS.tolist()]
    with pytest.raises(RequestError, match=rf"^keyframes\[{MANY}\].{complaint}"):
        read([*keyframes, last])


def test_a_file_is_sent_as_it_is(tmp_path):
    path = tmp_path / "motion.yaml"
    path.write_bytes(b"# as it is\nkeyframes: 5")
    assert motion_text(path) == MotionText(path.read_bytes(), str(path))
    with pytest.raises(RequestError, match=f"^{path}: keyframes: expected a list, got 5"):
        read(path)


def test_a_file_and_a_whole_request_take_no_fields(tmp_path):
    request = parse({"keyframes": [{"rotation_vector": [0, 0, 0]}]})
    for whole in (tmp_path / "motion.yaml", request, MotionText(b"keyframes: 5")):
        with pytest.raises(TypeError, match="has its own limits, got another"):
            motion_text(whole, limits={"velocity": 0.1})


@pytest.mark.parametrize("count", [2, MANY])
@pytest.mark.parametrize("kind", [Decimal, Fraction, np.longdouble])
def test_numbers_of_every_kind_are_numbers(kind, count):
    many = Rotation.from_rotvec(VECTORS[:count])
    times = [kind(k) / kind(4) for k in range(count)]
    request = read(many, times=times, end_velocity=[0, 0, kind(1) / kind(2)])
    np.testing.assert_array_equal(request.times, 0.25 * np.arange(count))
    assert request.end_velocity == (0.0, 0.0, 0.5)


@pytest.mark.parametrize("count", [1, MANY])
def test_what_has_no_text_is_refused_by_its_name(count):
    many = Rotation.from_rotvec(VECTORS[:count])
    with pytest.raises(RequestError, match=r"^approach: expected true or false"):
        motion_text(many, approach=object())
