"""A field is declared once, and whatever must have it too has it.

Each test here compares whole sets of names, so that it fails when a field is added in one place and
forgotten in another, and says which.
"""

import re
from dataclasses import fields
from pathlib import Path

import pytest
from motions import read

from orientd import config, motion_file
from orientd.client import motion_text
from orientd.daemon.device import EventKind
from orientd.errors import Fault, RequestError
from orientd.keep_out import KeepOut
from orientd.model.limits import ANGULAR, UNITS, Limits
from orientd.model.orientation import FORMS
from orientd.model.request import Frame, Keyframe, MotionRequest, Pose
from orientd.model.schema import attribute_lines
from orientd.protocol import control_pb2 as pb
from orientd.protocol.columns import keyframe_columns, keyframe_rows
from orientd.stream.records import Cycle, ServoState
from orientd.sun import Sun

ROOT = Path(__file__).parents[2] / "orientd"

REQUEST = {field.name for field in fields(MotionRequest)}
OF_KEYFRAMES = {field.name for field in fields(Keyframe)} - {"q"} | {"quaternion"}
COLUMNS = {"times", "positions"}
"""What the Python client takes in one piece for all keyframes."""

SAMPLES = {
    "method": "squad",
    "start_velocity": (0.1, 0.2, 0.3),
    "end_velocity": (0.1, 0.2, 0.3),
    "velocity_frame": "world",
    "approach": True,
    "limits": Limits.partial(velocity=(1.0, 2.0, 3.0), linear_velocity=0.5),
    "options": {"align": False, "orders": [1, 2.5]},
    "device_options": {"gain": 300},
    "duration": 7.5,
    "pace": 0.75,
    "name": "pick and place",
    "pointing_axis": "z",
    "frame": "camera",
    "frames": {"camera": Frame(Pose((0.8, 0.0, 0.6, 0.0), (1.0, 2.0, 3.0)), Pose())},
    "rate": (0.1, 0.2, 0.3),
    "keep_out": (
        KeepOut("laser", (0.8, 0.0, 0.6), 0.3, 0.1, axis=(0.0, 1.0, 0.0)),
        KeepOut("sun", Sun(48.1, -11.6, 0.0), 0.2),
    ),
    "notes": ("one", "two"),
}
TURNED = (0.8, 0.0, 0.0, 0.6)


def names(message):
    return set(message.DESCRIPTOR.fields_by_name)


def keys(table):
    return set(motion_file.motion_schema()["$defs"][table]["properties"])


# Requests


def test_columns_hold_every_field_of_a_keyframe():
    once = {
        "quaternions",
        "times",
        "positions",
        "turns",
        "free_roll",
        "relative",
        "frames",
        "names",
    }
    assert names(pb.KeyframeColumns) == once | {"rotation_vectors"}
    assert len(once) == len(OF_KEYFRAMES - set(FORMS)) + 1


def test_every_field_of_a_request_is_in_the_file_and_the_client():
    assert set(motion_file.motion_schema()["properties"]) == REQUEST
    arguments = motion_text.RequestFields
    assert arguments.__optional_keys__ == REQUEST - {"keyframes"} | COLUMNS
    assert set(attribute_lines(arguments)) == COLUMNS


def test_every_field_of_a_keyframe_is_in_the_file():
    assert keys("Keyframe") == OF_KEYFRAMES


def test_every_limit_is_in_the_file_the_configuration_and_the_message():
    assert keys("Limits") == UNITS.keys()
    assert config.LimitSettings.model_fields.keys() - {"preset"} == UNITS.keys()
    axes = {f"axis_{name}" for name in ANGULAR}
    assert names(pb.Limits) == UNITS.keys() | axes == {entry.name for entry in fields(Limits)}


@pytest.mark.parametrize("kind", [MotionRequest, Keyframe, Frame, Pose])
def test_every_field_says_what_it_is(kind):
    assert attribute_lines(kind).keys() == {field.name for field in fields(kind)}


@pytest.mark.parametrize("name", sorted(REQUEST - {"keyframes"}))
def test_every_field_survives_the_file_the_wire_and_the_client(name):
    value = SAMPLES[name]
    keyframes = [Keyframe((1.0, 0.0, 0.0, 0.0)), Keyframe(TURNED)]
    request = MotionRequest(keyframes, **{name: value})
    mapping = motion_file.written(request)
    others = {key: entry for key, entry in mapping.items() if key != "keyframes"}
    for again in (
        motion_file.parse(mapping),
        read(request),
        read(mapping["keyframes"], **others),
    ):
        assert getattr(again, name) == value


def test_every_field_of_a_keyframe_survives_the_file_and_the_wire():
    others = {"turns": -2, "free_roll": True, "frame": "camera", "relative": True, "name": "grasp"}
    whole = Keyframe(TURNED, time=1.5, position=(1.0, 2.0, 3.0), **others)
    given = {field.name for field in fields(Keyframe)} - set(FORMS)
    assert all(getattr(whole, name) not in (None, 0, "", False) for name in given)
    request = MotionRequest([Keyframe((1.0, 0.0, 0.0, 0.0), time=0.0), whole])
    assert motion_file.parse(motion_file.written(request)).keyframes[1] == whole
    assert read(request).keyframes[1] == whole
    rows = keyframe_rows(keyframe_columns(motion_file.written(request)["keyframes"]), 2)
    assert motion_file.loads(b"{}", rows=rows).keyframes[1] == whole


@pytest.mark.parametrize("name", ["x" * 81, "two\nlines", "\x1b[31mred", "turned\u202eround"])
def test_a_name_is_short_and_can_be_printed(name):
    keyframe = {"rotation_vector": [0, 0, 1]}
    with pytest.raises(RequestError, match=r"^name: expected at most 80 printable characters"):
        motion_file.parse({"keyframes": [keyframe], "name": name})


# Reports


def test_every_field_of_a_cycle_is_in_its_message():
    called = {
        "motion": "motion_number",
        "feedback_time_ns": "feedback_age_ns",
        "flags": "is_written",
    }
    of_report = {called.get(entry.name, entry.name) for entry in fields(Cycle)}
    assert of_report - {"joints", "sent_joints", "planned_q"} == names(pb.Cycle) - {
        "tracking_error"
    }


@pytest.mark.parametrize(
    ("ours", "theirs", "prefix"),
    [
        (ServoState, pb.State, "STATE_"),
        (Fault, pb.Fault, "FAULT_"),
        (EventKind, pb.EventKind, "EVENT_KIND_"),
    ],
    ids=["State", "Fault", "EventKind"],
)
def test_every_choice_is_on_the_wire(ours, theirs, prefix):
    sent = {name.removeprefix(prefix) for name in theirs.keys()} - {"UNSPECIFIED"}  # noqa: SIM118
    assert {one.name for one in ours} == sent


# The configuration


ADAPTERS = ROOT.parent / "adapters"
TABLES = list(dict.fromkeys([config.Settings, *config.Table.__subclasses__()]))


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.__name__)
def test_every_setting_says_what_it_is_and_is_read(table):
    assert set(attribute_lines(table)) == set(table.model_fields)
    files = (path for folder in (ROOT, ADAPTERS) for path in folder.rglob("*.py"))
    code = "\n".join(path.read_text() for path in files)
    # Limits go to the planner whole.
    unread = table.model_fields if table is config.LimitSettings else set()
    for name in table.model_fields.keys() - unread:
        assert re.search(rf"\.{name}\b", code), name
