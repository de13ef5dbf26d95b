"""Orientations out of what others have recorded: other schemas, other encodings, tables."""

import json

import numpy as np
import pytest
from mcap.writer import Writer
from mcap_ros2.writer import Writer as Ros2Writer
from recorded import OFFSET_NS, RATE_HZ, moving

from orientd import rotation
from orientd.recorder import reader
from orientd.recorder.orientations import read_orientations
from orientd.recorder.tables import export
from orientd.recorder.writer import RecordingError, RecordingWriter

TIMES = 1000.0 + 0.05 * np.arange(20)
Q = rotation.exp(np.outer(0.05 * np.arange(20), [0.0, 0.6, 0.8]))

POSE_STAMPED = """\
std_msgs/Header header
geometry_msgs/Pose pose
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""


@pytest.fixture
def ours(tmp_path):
    table = moving(600)
    with RecordingWriter(tmp_path / "ours.mcap", offset_ns=OFFSET_NS) as writer:
        writer.add_device("arm", RATE_HZ)
        writer.add_configuration("{}", {})
        writer.add_cycles("arm", table)
    return tmp_path / "ours.mcap", table


def named(q):
    return dict(zip("wxyz", map(float, q), strict=True))


def check(found):
    np.testing.assert_allclose(found.times, TIMES - TIMES[0], atol=1e-6)
    np.testing.assert_allclose(found.q, Q, atol=1e-9)


def test_of_ours_what_was_measured_is_taken_at_the_time_it_was_measured(ours):
    path, table = ours
    found = read_orientations(path)
    assert found.topic == "/arm/measured"
    np.testing.assert_allclose(found.q, table["measured_q"], atol=1e-8)
    stamps = table["feedback_time_ns"]
    np.testing.assert_allclose(found.times, (stamps - stamps[0]) * 1e-9, atol=1e-9)


def test_of_ours_what_was_sent_is_taken_by_name(ours):
    path, table = ours
    np.testing.assert_allclose(read_orientations(path, "/arm/sent").q, table["sent_q"], atol=1e-9)
    with pytest.raises(RecordingError, match="there is '/arm/measured', '/arm/sent'"):
        read_orientations(path, "/leg/sent")


def test_an_exported_table_gives_the_same(ours, tmp_path):
    path, table = ours
    export(reader.load_recording(path), "arm", tmp_path / "a.csv")
    found = read_orientations(tmp_path / "a.csv")
    assert found.topic == "measured"
    np.testing.assert_allclose(found.q, table["measured_q"], atol=1e-8)
    stamps = table["feedback_time_ns"]
    np.testing.assert_allclose(found.times, (stamps - stamps[0]) * 1e-9, atol=1e-6)


def test_foxglove_poses_of_somebody_else(tmp_path):
    from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
    from mcap_protobuf.writer import Writer as ProtobufWriter

    path = tmp_path / "a.mcap"
    with path.open("wb") as stream, ProtobufWriter(stream) as writer:
        for time, q in zip(TIMES, Q, strict=True):
            pose = PoseInFrame(frame_id="map")
            pose.timestamp.FromNanoseconds(round(time * 1e9))
            for name, part in named(q).items():
                setattr(pose.pose.orientation, name, part)
            writer.write_message("/head", pose, log_time=7, publish_time=7)
    found = read_orientations(path)
    assert found.topic == "/head"
    check(found)


def test_json_in_transforms_with_several_children(tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("foxglove.FrameTransforms", "jsonschema", b"{}")
        channel = writer.register_channel("/tf", "json", schema)
        for time, q in zip(TIMES, Q, strict=True):
            stamp = {"sec": int(time), "nsec": round((time - int(time)) * 1e9)}
            children = [("tool", q), ("base", [1.0, 0.0, 0.0, 0.0])]
            transforms = [
                {"timestamp": stamp, "child_frame_id": child, "rotation": named(turn)}
                for child, turn in children
            ]
            content = json.dumps({"transforms": transforms}).encode()
            writer.add_message(channel, log_time=3, data=content, publish_time=3)
        writer.finish()
    check(read_orientations(path, "/tf#tool"))
    with pytest.raises(RecordingError, match="name one topic of '/tf#tool', '/tf#base'"):
        read_orientations(path)


def test_a_ros_2_bag(tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream, Ros2Writer(stream) as writer:
        schema = writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE_STAMPED)
        for time, q in zip(TIMES, Q, strict=True):
            nanosec = round((time - int(time)) * 1e9)
            message = {
                "header": {"stamp": {"sec": int(time), "nanosec": nanosec}, "frame_id": "map"},
                "pose": {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": named(q)},
            }
            writer.write_message("/pose", schema, message, log_time=5, publish_time=5)
    check(read_orientations(path, "/pose"))


def test_a_table_of_somebody_else(tmp_path):
    rows = [f"{t},{x},{y},{z},{w}" for t, (w, x, y, z) in zip(TIMES, Q, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["time,qx,qy,qz,qw", *rows]))
    check(read_orientations(tmp_path / "a.csv"))


def test_a_table_has_no_topics(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,qw,qx,qy,qz\n0,1,0,0,0\n")
    with pytest.raises(RecordingError, match=r"a csv file has no topics.*leave out 'head'"):
        read_orientations(path, "head")
    path.write_text("time,head_w,head_x,head_y,head_z\n0,1,0,0,0\n")
    assert read_orientations(path, "head").topic == "head"
    with pytest.raises(RecordingError, match="no orientations in 'arm', there is 'head'"):
        read_orientations(path, "arm")


def test_without_a_topic_the_columns_without_a_name_are_meant(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,head_w,head_x,head_y,head_z,w,x,y,z\n0,1,0,0,0,0,1,0,0\n")
    assert read_orientations(path).q.tolist() == [[0.0, 1.0, 0.0, 0.0]]
    assert read_orientations(path, "head").q.tolist() == [[1.0, 0.0, 0.0, 0.0]]
    with pytest.raises(RecordingError, match="there is 'head', one without a name"):
        read_orientations(path, "arm")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("qw,qx,qy,qz\n1,0,0,0\n", "no column of times"),
        ("time,roll\n0,1\n", "no orientations in it"),
        ("", "no column of times"),
    ],
)
def test_tables_of_something_else_are_refused(tmp_path, text, problem):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(RecordingError, match=problem):
        read_orientations(tmp_path / "a.csv")


def test_a_topic_of_one_frame_needs_no_name_of_the_frame(tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/tf", "json", 0)
        for time, q in zip(TIMES, Q, strict=True):
            stamp = {"sec": int(time), "nsec": round((time - int(time)) * 1e9)}
            one = {"timestamp": stamp, "child_frame_id": "tool", "rotation": named(q)}
            content = json.dumps({"transforms": [one]}).encode()
            writer.add_message(channel, log_time=3, data=content, publish_time=3)
        writer.finish()
    check(read_orientations(path, "/tf"))


@pytest.mark.parametrize("unit", ["ns", "us"])
def test_times_that_cannot_be_seconds_are_refused(tmp_path, unit):
    per_second = {"ns": 1e9, "us": 1e6}[unit]
    rows = [
        f"{t * per_second:.0f},{w},{x},{y},{z}" for t, (w, x, y, z) in zip(TIMES, Q, strict=True)
    ]
    (tmp_path / "a.csv").write_text("\n".join(["t,qw,qx,qy,qz", *rows]))
    with pytest.raises(
        RecordingError, match=r"'t' is in seconds, and rows are .* s apart; call it"
    ):
        read_orientations(tmp_path / "a.csv")
