"""Notes of a certificate about the request: scaled quaternions, angles beyond a turn."""

import json
import math
import os

import numpy as np
import pytest
from motions import read

import orientd
from orientd.cli import texts
from orientd.errors import RequestError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.motion_file import loads, parse, written
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.protocol import control_pb2 as pb
from orientd.protocol.columns import keyframe_rows
from orientd.protocol.targets import target_from_message
from orientd.rotation import angle, from_euler, normalize

CASES = int(os.environ.get("ORIENTD_CASES", "30"))
FIRST = {"quaternion": {"w": 1, "x": 0, "y": 0, "z": 0}}
TYPED = (0.7071, 0.0, 0.0, 0.7071)
SCALED = "keyframes[1].quaternion of norm 0.999990 was scaled to norm 1"


def by_file(q):
    return loads(json.dumps({"keyframes": [FIRST, quaternion(q)]}).encode(), "m.json")


def by_python(q):
    return read([orientd.Quaternion(w=1, x=0, y=0, z=0), named(q)])


def by_columns(q):
    columns = pb.KeyframeColumns(quaternions=[1, 0, 0, 0, *q]).SerializeToString()
    return loads(b"{}", rows=keyframe_rows(columns, 2))


def by_keyframes(q):
    return MotionRequest([Keyframe((1.0, 0.0, 0.0, 0.0)), Keyframe(q)])


WAYS_IN = [by_file, by_python, by_columns, by_keyframes]


def quaternion(q):
    return {"quaternion": dict(zip("wxyz", q, strict=True))}


def named(q):
    return orientd.Quaternion(**dict(zip("wxyz", q, strict=True)))


@pytest.mark.parametrize("way_in", WAYS_IN)
def test_a_quaternion_of_four_digits_is_scaled_with_a_note_in_every_way_in(way_in):
    request = way_in(TYPED)
    assert tuple(request.notes) == (SCALED,)
    assert np.allclose(request.keys[1], normalize(TYPED), atol=1e-16)
    motion = orientd.plan(request)
    assert SCALED in motion.certificate.notes
    assert motion.certificate.keyframe_error < 1e-12
    # The planner says the same of what a client has read, once.
    assert read(request).notes == (SCALED,)
    assert parse(written(request)).notes == (SCALED,)


@pytest.mark.parametrize("way_in", WAYS_IN)
def test_a_norm_that_is_off_by_more_is_refused_in_every_way_in(way_in):
    for norm in (0.998, 1.0011, 1.01, 0.0, 1e200):
        with pytest.raises(RequestError, match=r"norm must be 1 within 0\.001, got"):
            way_in((norm, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("way_in", WAYS_IN)
def test_a_norm_that_is_off_by_rounding_has_no_note(way_in):
    assert way_in((0.70710678, 0.0, 0.0, 0.70710678)).notes == ()


def test_a_plan_from_python_takes_a_quaternion_of_four_digits():
    motion = orientd.plan([named((1, 0, 0, 0)), named(TYPED)])
    assert motion.certificate.notes == (SCALED,)


def test_targets_of_a_stream_are_taken_as_before():
    target = pb.TrackTarget(orientation={"w": 0.7071, "z": 0.7071})
    with pytest.raises(RequestError, match=r"norm 1 within 1e-06"):
        target_from_message(target, 0)


def test_random_quaternions_of_four_digits_are_all_taken():
    random = np.random.default_rng(4)
    for _ in range(CASES):
        q = normalize(random.normal(size=(3, 4)))
        typed = np.round(q, 4)
        request = parse({"keyframes": [quaternion(one.tolist()) for one in typed]})
        assert np.max(angle(request.keys, q)) < 3e-4
        assert np.allclose(np.linalg.norm(request.keys, axis=1), 1.0, atol=4e-16)
        is_noted = bool(np.any(np.abs(np.linalg.norm(typed, axis=1) - 1.0) > 1e-6))
        assert bool(request.notes) is is_noted


def euler(axes, *degrees, **fields):
    return {"euler": {"axes": axes, "degrees": list(degrees)}, **fields}


def vector(*components):
    return {"rotation_vector": list(components)}


@pytest.mark.parametrize(
    ("keyframes", "note"),
    [
        (
            [euler("xyz", 0, 0, 0, time=0), euler("xyz", 0, -450, 0, time=40)],
            "keyframes[1].euler has an angle of -450 deg, more than a whole turn, read as "
            "-90 deg: `turns` takes whole turns",
        ),
        (
            [euler("xyz", 0, 0, 0, time=0), euler("xyz", 0, -720, 0, time=40)],
            "keyframes[1].euler has an angle of -720 deg, more than a whole turn, read as "
            "0 deg: `turns` takes whole turns",
        ),
        (
            [vector(0, 0, 0), vector(0, 0, 3.2)],
            "keyframes[1].rotation_vector is 3.2 rad long, more than half a turn, read as "
            "-176.7 deg: its unit is rad, `euler` takes degrees, `turns` whole turns",
        ),
        (
            [vector(0, 0, 0), vector(0, 0, 90), vector(0, 100, 0), vector(0, 0, 70)],
            "keyframes[1].rotation_vector is 90 rad long, more than half a turn, read as "
            "116.6 deg: its unit is rad, `euler` takes degrees, `turns` whole turns; so are 2 more",
        ),
    ],
)
def test_an_angle_beyond_a_turn_has_a_note(keyframes, note):
    request = parse({"keyframes": keyframes})
    assert request.notes == (note,)
    assert read(request).notes == (note,)
    certificate = orientd.plan(request).certificate
    assert note in certificate.notes
    assert f"note                 {note}" in texts.certificate(certificate)


def test_columns_with_an_angle_beyond_a_turn_have_the_same_note():
    columns = pb.KeyframeColumns(rotation_vectors=[0, 0, 0, 0, 0, 90]).SerializeToString()
    (note,) = loads(b"{}", rows=keyframe_rows(columns, 2)).notes
    assert note == parse({"keyframes": [vector(0, 0, 0), vector(0, 0, 90)]}).notes[0]


def test_random_angles_have_a_note_exactly_where_they_are_beyond_a_turn():
    random = np.random.default_rng(6)
    for _ in range(CASES):
        degrees = random.uniform(-1000, 1000, size=3)
        length = random.uniform(0.0, 12.0)
        axis = normalize([0.0, *random.normal(size=3)])[1:]
        request = parse({"keyframes": [euler("XYZ", *degrees), vector(*(length * axis))]})
        expected = int(np.abs(degrees).max() > 360.0) + int(length > math.pi)
        assert len(request.notes) == expected
        assert angle(request.keys[0], from_euler("XYZ", np.radians(degrees))) < 1e-12


def test_notes_survive_the_frames_and_the_lead_in_of_a_plan():
    mapping = {"frame": "table", "frames": {"table": {"base": {"position": [1, 0, 0]}}}}
    request = parse({"keyframes": [FIRST, quaternion(TYPED)], "approach": True, **mapping})
    start = State.at_rest((0.0, 0.6, 0.8, 0.0))
    motion = plan(request, start=start, limits=DEFAULT_LIMITS, period=0.002)
    assert motion.certificate.notes.count(SCALED) == 1


@pytest.mark.parametrize("notes", [["x"] * 21, ["x" * 301], ["\x1b[31mred"], "text"])
def test_notes_are_few_short_and_can_be_printed(notes):
    with pytest.raises(RequestError, match="notes"):
        read([named((1, 0, 0, 0))], notes=notes)


def test_control_points_are_not_called_keyframes():
    keyframes = [vector(0, 0, 0.5 * k) for k in range(5)]
    lines = texts.certificate(orientd.plan(parse({"keyframes": keyframes})).certificate)
    assert any(line.startswith("keyframes            met to") for line in lines)
    approximating = parse({"keyframes": keyframes, "method": "kks_bspline"})
    lines = texts.certificate(orientd.plan(approximating).certificate)
    assert "control points       not passed" in lines
    assert not any("met to" in line and "keyframes" in line for line in lines)
