"""The motion file: what it says becomes a request, and whatever is wrong is named in one line."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from orientd.errors import RequestError
from orientd.model.limits import Limits
from orientd.motion_file import load, motion_schema, parse
from orientd.rotation import angle, exp, from_euler

ONE = {"w": 1, "x": 0, "y": 0, "z": 0}
SECOND = "  - {rotation_vector: [0, 0, 1]}\n"
KEYFRAMES = "keyframes:\n  - {quaternion: {w: 1, x: 0, y: 0, z: 0}}\n" + SECOND

EXAMPLE = """
method: c2_cumulative          # any name in METHODS; this is the default
keyframes:                     # orientation in exactly one of these forms; time optional as a whole
  - {time: 0.0, quaternion: {w: 1, x: 0, y: 0, z: 0}}
  - {time: 1.2, rotation_vector: [0, 0, 1.57]}
  - {time: 2.0, euler: {axes: xyz, degrees: [10, 20, 30]}, position: [0.4, 0.1, 0.3]}
  - {time: 3.0, matrix: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], turns: 1}
velocity_frame: body           # body | world
start_velocity: [0, 0, 0.5]    # rad/s
end_velocity: [0, 0, 0]
approach: true                 # plan the lead-in from wherever the device is commanded to be
limits: {velocity: 2.5, acceleration: 17, jerk: 8500}     # rad/s, rad/s^2, rad/s^3
options: {}                    # of the method
device_options: {gain: 300}    # of the device's driver, for this motion
"""

ROOT = Path(__file__).parents[2]
EVERY_FILE = [
    path
    for folder in ("config", "docs", "examples", "tests/data")
    for path in sorted((ROOT / folder).rglob("*.yaml"))
    if "keyframes:" in path.read_text(encoding="utf-8")
]


@pytest.fixture
def written(tmp_path):
    def write(text, name="motion.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def refusal(path):
    with pytest.raises(RequestError) as caught:
        load(path)
    assert "\n" not in str(caught.value)
    return caught.value.field, caught.value.problem


def test_every_key_of_a_file_reaches_the_request(written):
    request = load(written(EXAMPLE))
    assert request.method == "c2_cumulative"
    assert request.times.tolist() == [0.0, 1.2, 2.0, 3.0]
    expected = [
        exp([0, 0, 0.0]),
        exp([0, 0, 1.57]),
        from_euler("xyz", np.radians([10, 20, 30])),
        exp([0, 0, 0.0]),
    ]
    assert angle(request.keys, np.array(expected)).max() < 1e-12
    assert request.positions[2].tolist() == [0.4, 0.1, 0.3]
    assert np.isnan(request.positions[[0, 1, 3]]).all()
    assert request.turns.tolist() == [0, 0, 0, 1]
    assert request.velocity_frame == "body"
    assert request.start_velocity == (0, 0, 0.5)
    assert request.end_velocity == (0, 0, 0)
    assert request.approach is True
    assert request.limits == Limits.partial(velocity=2.5, acceleration=17, jerk=8500)


@pytest.mark.parametrize("path", EVERY_FILE, ids=lambda path: path.name)
def test_every_motion_file_here_loads(path):
    assert len(load(path).keys) == len(load(path).keyframes)


def test_only_keyframes_are_needed(written):
    request = load(written(KEYFRAMES))
    assert request.method == "c2_cumulative"
    assert request.times is None
    assert request.start_velocity is None
    assert request.approach is False
    assert request.limits is None


@pytest.mark.parametrize("name", ["motion.json", "motion.yaml", "motion"])
def test_json_says_the_same(written, name):
    keyframes = [{"quaternion": ONE}, {"rotation_vector": [0, 0, 1]}]
    path = written(json.dumps({"keyframes": keyframes, "approach": True}), name)
    assert load(path).approach
    assert load(path).keys == pytest.approx(load(written(KEYFRAMES, "other.yaml")).keys)


def test_yaml_in_braces_is_read_as_yaml(written):
    path = written("{keyframes: [{rotation_vector: [0, 0, 0]}, {rotation_vector: [0, 0, 1]}]}")
    assert len(load(path).keyframes) == 2


def test_euler_angles_take_any_order_fixed_or_turning():
    keyframes = [
        {"euler": {"axes": "zyx", "degrees": [10, 20, 30]}},
        {"euler": {"axes": "XYZ", "degrees": [30, 20, 10]}},
        {"euler": {"axes": "z", "degrees": [90]}},
    ]
    keys = parse({"keyframes": keyframes}).keys
    assert angle(keys[0], keys[1]) < 1e-12
    assert angle(keys[2], exp([0, 0, math.pi / 2])) < 1e-12


@pytest.mark.parametrize(
    ("text", "field", "problem"),
    [
        # Keys
        (KEYFRAMES + "limits: {velocty: 3}", "limits.velocty", "did you mean 'velocity'?"),
        ("keyfrmes: []", "keyfrmes", "unknown key; did you mean 'keyframes'?"),
        (
            "keyframes:\n  - {tme: 1, quaternion: {w: 1, x: 0, y: 0, z: 0}}\n" + SECOND,
            "keyframes[0].tme",
            "unknown key; did you mean 'time'?; known are quaternion, rotation_vector, euler, "
            "matrix, direction, azimuth_elevation, look_at, time, position, turns, free_roll",
        ),
        (
            "keyframes:\n  - {quaternion: {w: 1, x: 0, y: 0, q: 0}}\n" + SECOND,
            "keyframes[0].quaternion.q",
            "unknown key; known are w, x, y, z",
        ),
        (KEYFRAMES + "? [a]\n: 1", "", "line 4: a key must be a text"),
        # Types
        ("keyframes:", "keyframes", "expected a list, got nothing"),
        ("keyframes: [3, 4]", "keyframes[0]", "expected a mapping, got 3"),
        (KEYFRAMES + "method: 3", "method", "expected a text, got 3"),
        (
            KEYFRAMES + "start_velocity: 5",
            "start_velocity",
            "expected three numbers, got 5; write them as [x, y, z]",
        ),
        (
            KEYFRAMES + "start_velocity: [1, 2]",
            "start_velocity",
            "expected 3 entries, got 2: [1, 2]; give 3, with decimal points",
        ),
        (KEYFRAMES + "start_velocity: [1, 2, 3, 4]", "start_velocity", "expected 3 entries, got 4"),
        (KEYFRAMES + "end_velocity: [1, 2, x]", "end_velocity[2]", "a number, got the text 'x'"),
        (KEYFRAMES + "limits: 5", "limits", "expected a mapping, got 5"),
        (KEYFRAMES + "limits: {jerk: true}", "limits.jerk", "expected a number, got true"),
        (KEYFRAMES + "options: []", "options", "expected a mapping, got []"),
        # Numbers
        (
            KEYFRAMES + "limits: {jerk: 1e4}",
            "limits.jerk",
            "expected a number, got the text '1e4' (YAML takes it for a number when written with "
            "a point and a sign: 1.0e+3)",
        ),
        (
            KEYFRAMES + "limits: {jerk: '10'}",
            "limits.jerk",
            "expected a number, got the text '10' (without quotes it would be a number)",
        ),
        (KEYFRAMES + "limits: {jerk: 1:30}", "limits.jerk", "got the text '1:30'"),
        (KEYFRAMES + "limits: {jerk: 010}", "limits.jerk", "got the text '010'"),
        (KEYFRAMES + "limits: {jerk: 2020-01-01}", "limits.jerk", "got the text '2020-01-01'"),
        (KEYFRAMES + "limits: {jerk: -.inf}", "limits.jerk", "expected a finite number, got -inf"),
        # Orientations
        (KEYFRAMES + "  - {position: [0, 0, 1]}", "keyframes[2]", "got none of them"),
        (
            KEYFRAMES + "  - {matrix: [[2, 0, 0], [0, 1, 0], [0, 0, 1]]}",
            "keyframes[2].matrix",
            "must be orthogonal within 1e-06",
        ),
        (
            KEYFRAMES + "  - {euler: {axes: xyz, degrees: [1, 2]}}",
            "keyframes[2].euler.degrees",
            "expected 3 angles for the axes 'xyz', got 2",
        ),
        (
            KEYFRAMES + "  - {euler: {axes: xyz, radians: [1, 2, 3]}}",
            "keyframes[2].euler.radians",
            "unknown key; known are axes, degrees",
        ),
        # Times
        (
            "keyframes:\n  - {time: 1, rotation_vector: [0, 0, 0]}\n" + SECOND,
            "keyframes[1].time",
            "every keyframe needs one (or none)",
        ),
        (KEYFRAMES + "velocity_frame: tool", "velocity_frame", "expected 'body' or 'world'"),
        # The file itself
        ("- 1\n- 2", "", "a motion must be a mapping with the key 'keyframes', got [1, 2]"),
        ("a: &a [*a]", "a[0]", "contains itself"),
        ("a: !!python/object:os.system {}", "a", "is not allowed"),
        ("a: *nobody", "a", "line 1: nothing before is named &nobody"),
        ("a: !secret 5", "a", "the tag !secret is not allowed"),
        ('{"a": 1, "a": 2}', "a", "the key is given twice"),
    ],
)
def test_what_is_wrong_is_named_with_its_field(written, text, field, problem):
    found = refusal(written(text))
    assert found[0] == field
    assert problem in found[1]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "the file is empty"),
        ("\n\n  \n", "the file is empty"),
        ("# nothing but a comment\n", "the file is empty"),
        ("a: 1\nb: 2\n c: 3", "line 3: not YAML"),
        ("a: 1\n---\nb: 2", "line 2: not YAML"),
        ("a: \x00", "not YAML"),
        (f"a: {'[' * 64}{']' * 64}", "line 1: not YAML: nested too deeply"),
        ("[" * 100_000, "line 1: not YAML: "),
        ("{a: " * 20_000 + "1" + "}" * 20_000, "line 1: not YAML: "),
    ],
)
def test_a_file_that_is_no_yaml_is_named_with_the_line(written, text, problem):
    path = written(text)
    field, said = refusal(path)
    assert field == ""
    assert str(path) in said
    assert problem in said


def test_a_file_that_is_no_json_is_named_with_the_line(written):
    assert "line 2: not JSON" in refusal(written('{"a": 1,\n oops}', "motion.json"))[1]


def test_json_nested_too_deeply_is_refused(written):
    text = '{"a": ' + "[" * 100_000 + "]" * 100_000 + "}"
    assert "nested too deeply" in refusal(written(text, "motion.json"))[1]


def test_a_file_that_is_not_there_is_named(tmp_path):
    assert refusal(tmp_path / "no.yaml") == (
        "",
        f"cannot read {tmp_path / 'no.yaml'}: No such file or directory",
    )
    assert "Is a directory" in refusal(tmp_path)[1]


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "motion.yaml"
    path.write_bytes(b"\xff\xfe\x00keyframes")
    assert "not UTF-8 text" in refusal(path)[1]


def test_aliases_repeat_what_they_name(written):
    text = "keyframes:\n  - &first {rotation_vector: [0, 0, 0]}\n" + SECOND + "  - *first\n"
    keys = load(written(text)).keys
    assert keys[2] == pytest.approx(keys[0])


@pytest.mark.parametrize(
    ("levels", "told"), [(5, "expected a mapping"), (30, "more than 100000 values")]
)
def test_aliases_that_multiply_do_no_harm(written, levels, told):
    lists = [f"  a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, levels)]
    text = "\n".join(["options:", "  a0: &a0 [1]", *lists, f"keyframes: *a{levels - 1}", ""])
    _, problem = refusal(written(text))
    assert told in problem


def test_long_answers_are_cut(written):
    assert len(str(refusal(written(KEYFRAMES + f"limits: {list(range(1000))}")))) < 200
    assert len(str(refusal(written(KEYFRAMES + f"approach: {'x' * 5000}")))) < 200


def test_the_schema_needs_keyframes_or_a_rate_and_forbids_unknown_keys():
    schema = motion_schema()
    assert schema["anyOf"] == [{"required": ["keyframes"]}, {"required": ["rate"]}]
    assert schema["additionalProperties"] is False
    for model in schema["$defs"].values():
        assert model["additionalProperties"] is False
    json.dumps(schema)


def test_a_mapping_need_not_come_from_a_file():
    with pytest.raises(RequestError, match="a motion must be a mapping"):
        parse([1, 2])
    with pytest.raises(RequestError, match="a motion must be a mapping"):
        parse(None)


def test_many_keyframes_of_one_wrong_form_are_told_by_the_first(written):
    good, bad = "  - {rotation_vector: [0, 0, 1]}\n", "  - {matrix: [[1,0,0],[0,1,0],[0,0,3]]}\n"
    field, _ = refusal(written("keyframes:\n" + good * 50 + bad * 3))
    assert field == "keyframes[50].matrix"


def test_three_numbers_limit_the_components_in_the_body_frame(written):
    request = load(written(KEYFRAMES + "limits: {velocity: [2, 1, 2], jerk: 100}"))
    assert request.limits == Limits.partial(velocity=[2.0, 1.0, 2.0], jerk=100.0)


@pytest.mark.parametrize("limit", ["[1, 2]", "[1, 2, -3]", "[1, 2, .inf]", "[1, 2, true]"])
def test_three_limits_must_be_three_positive_numbers(written, limit):
    field, problem = refusal(written(KEYFRAMES + f"limits: {{velocity: {limit}}}"))
    assert field == "limits.velocity"
    assert problem.startswith("expected three finite numbers greater than 0")


def test_the_duration_is_a_minimum_or_left_to_the_method(written):
    assert load(written(KEYFRAMES + "duration: minimum")).duration == "minimum"
    assert load(written(KEYFRAMES)).duration is None
    field, problem = refusal(written(KEYFRAMES + "duration: shortest"))
    assert field == "duration"
    assert (
        problem == "expected 'minimum' or seconds, got the text 'shortest'; give a number above 0"
    )


def test_the_schema_admits_three_limits_where_the_reader_does():
    kinds = motion_schema()["$defs"]["Limits"]["properties"]
    for name in ("velocity", "acceleration", "jerk"):
        assert sum("array" in str(kind) for kind in kinds[name]["anyOf"]) == 1
    assert "array" not in str(kinds["linear_velocity"])


def test_a_rotation_vector_longer_than_a_turn_is_taken_with_a_word_about_degrees():
    keyframes = [{"rotation_vector": [0, 0, 1]}, {"rotation_vector": [0, 0, 90]}]
    (note,) = parse({"keyframes": keyframes}).notes
    assert note == (
        "keyframes[1].rotation_vector is 90 rad long, more than half a turn, read as 116.6 "
        "deg: its unit is rad, `euler` takes degrees, `turns` whole turns"
    )
