"""Orientations from recordings of other programs: other schemas, other encodings, tables."""

import json
from itertools import zip_longest

import numpy as np
import pytest
from command_line import assert_refused, inside
from mcap.writer import Writer
from mcap_ros2.writer import Writer as Ros2Writer
from recorded import OFFSET_NS, RATE_HZ, moving

from orientd import rotation
from orientd.recorder import reader
from orientd.recorder.tables import export
from orientd.recorder.writer import RecordingError, RecordingWriter
from orientd_replay.orientations import read_orientations

TIMES = 1000.0 + 0.05 * np.arange(20)
Q = rotation.exp(np.outer(0.05 * np.arange(20), [0.0, 0.6, 0.8]))
UPRIGHT = {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}

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


def json_file(path, messages, *, kinds=(), log_times=None):
    """Write JSON messages of a topic or of several, recorded 10 ms after each other.

    A message of bytes is written as it is.
    """
    topics = messages if isinstance(messages, dict) else {"/head": messages}
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for topic, kind in zip_longest(topics, kinds, fillvalue=""):
            schema = writer.register_schema(kind, "jsonschema", b"{}") if kind else 0
            channel = writer.register_channel(topic, "json", schema)
            for k, message in enumerate(topics[topic]):
                content = message if isinstance(message, bytes) else json.dumps(message).encode()
                at = 10_000_000 * k if log_times is None else log_times[k]
                writer.add_message(channel, log_time=at, data=content, publish_time=0)
        writer.finish()
    return path


@pytest.fixture
def read(tmp_path):
    """Return what reads the orientations of JSON messages."""

    def read(messages, topic="", **how):
        return read_orientations(json_file(tmp_path / "a.mcap", messages, **how), topic)

    return read


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


def stamp_of(time):
    return {"sec": int(time), "nsec": round((time - int(time)) * 1e9)}


def test_json_in_transforms_with_several_children(read):
    messages = [
        {
            "transforms": [
                {"timestamp": stamp_of(time), "child_frame_id": "tool", "rotation": named(q)},
                {"timestamp": stamp_of(time), "child_frame_id": "base", "rotation": UPRIGHT},
            ]
        }
        for time, q in zip(TIMES, Q, strict=True)
    ]
    recorded = {"/tf": messages}, ["foxglove.FrameTransforms"]
    check(read(recorded[0], "/tf#tool", kinds=recorded[1]))
    with pytest.raises(RecordingError, match="name one topic of '/tf#tool', '/tf#base'"):
        read(recorded[0], kinds=recorded[1])


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
        (
            "qw,qx,qy,qz\n1,0,0,0\n",
            "no column of times in the columns qw, qx, qy, qz; expected time_s,qw,qx,qy,qz, or "
            "time_s, time, t, timestamp, stamp, time_ms, time_us, time_ns for the times",
        ),
        (
            "time;roll;pitch;yaw\n0;1;2;3\n",
            "no quaternion in the columns time, roll, pitch, yaw; expected time_s,qw,qx,qy,qz",
        ),
        ("time,q0,q1,q2,q3\n0,1,0,0,0\n", "no quaternion in the columns time, q0, q1, q2, q3;"),
        ("", r"a\.csv: empty; expected columns such as time_s,qw,qx,qy,qz"),
        ("# nothing else\n\n", r"a\.csv: empty; expected columns such as"),
        ("time,qw,qx,qy,qz\n", r"a\.csv: no rows below the names of the columns"),
        ("# no names\n0,1,0,0,0\n", "line 2 has numbers, expected the names of the columns; put a"),
        ("0;1,0;0,0;0,0;0,0\n", "line 1 has numbers, expected the names of the columns"),
        ("time,qw,qx,qy,qz,qw\n0,1,0,0,0,1\n", "two columns are called 'qw'; rename one"),
    ],
)
def test_tables_of_something_else_are_refused(tmp_path, text, problem):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(RecordingError, match=problem):
        read_orientations(tmp_path / "a.csv")


def test_a_topic_of_one_frame_needs_no_name_of_the_frame(read):
    messages = [
        {
            "transforms": [
                {"timestamp": stamp_of(time), "child_frame_id": "tool", "rotation": named(q)}
            ]
        }
        for time, q in zip(TIMES, Q, strict=True)
    ]
    check(read({"/tf": messages}, "/tf"))


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


@pytest.mark.parametrize(
    "stamped",
    [
        lambda sec, nsec: {"header": {"stamp": {"sec": sec, "nanosec": nsec}}},
        lambda sec, nsec: {
            "header": {"stamp": {"secs": 1}},
            "timestamp": {"sec": sec, "nsec": nsec},
        },
        lambda sec, nsec: {"timestamp": {"seconds": sec, "nanos": nsec}},
        lambda sec, nsec: {"stamp": {"sec": float(sec), "nanosec": nsec}},
        lambda sec, nsec: {"stamp": sec + 1e-9 * nsec},
    ],
)
def test_a_message_has_the_time_of_its_stamp_in_every_form(read, stamped):
    messages = [{**stamped(5 + k, 250_000_000 * k), "q": UPRIGHT} for k in range(3)]
    found = read(messages)
    np.testing.assert_allclose(found.times, [0.0, 1.25, 2.5], atol=1e-9)


@pytest.mark.parametrize("stamp", [{"sec": 0, "nanosec": 0}, {"sec": 7}, {}, None])
def test_a_topic_whose_stamps_were_never_set_has_the_times_of_its_recording(read, stamp):
    messages = [{"stamp": stamp, "q": UPRIGHT}] * 3
    found = read(messages)
    np.testing.assert_allclose(found.times, [0.0, 0.01, 0.02], atol=1e-12)
    assert found.clock == "the times of recording"


def test_a_stamp_of_exactly_zero_is_a_stamp(read):
    stamps = [{"sec": k, "nanosec": 0} for k in range(20)]
    messages = [{"stamp": stamp, "q": UPRIGHT} for stamp in stamps]
    found = read(messages)
    np.testing.assert_allclose(found.times, np.arange(20.0), atol=1e-12)
    assert found.clock == "the stamps of its messages"


def test_a_message_without_a_stamp_among_others_gets_no_time_of_another_clock(read):
    messages = [{"stamp": 5.0 + k, "q": UPRIGHT} for k in range(20)]
    del messages[3]["stamp"]
    found = read(messages)
    assert np.flatnonzero(np.isnan(found.times)).tolist() == [3]
    np.testing.assert_allclose(np.delete(found.times, 3), np.delete(np.arange(20.0), 3))


def test_each_topic_has_a_clock_of_its_own(read):
    messages = {
        "/a": [{"stamp": 100.0 + k, "q": UPRIGHT} for k in range(20)],
        "/b": [{"stamp": 0.0, "q": UPRIGHT}] * 20,
    }
    assert read(messages, "/a").times[-1] == 19.0
    assert read(messages, "/b").times[-1] == pytest.approx(0.19)


@pytest.mark.parametrize(
    "in_the_other", [slice(1, None, 2), slice(50, None), slice(7, 8), slice(0, 1), slice(40, 60)]
)
def test_a_mixture_of_two_clocks_is_refused_with_both_ranges(read, in_the_other):
    stamps = 132.69 + 0.05 * np.arange(100)
    stamps[in_the_other] += 1.778e9
    messages = [{"stamp": stamp, "q": UPRIGHT} for stamp in stamps.tolist()]
    with pytest.raises(RecordingError, match="stamps of its messages are of two clocks") as refused:
        read(messages)
    late = stamps > 1e6
    for part in (stamps[~late], stamps[late]):
        assert f"{len(part)} from {part[0]:.3f} s to {part[-1]:.3f} s" in str(refused.value)
    change = int(np.flatnonzero(np.diff(late))[0]) + 1
    assert f"the first change in sample {change};" in str(refused.value)


def test_a_pause_of_an_hour_is_no_second_clock(read):
    stamps = [*np.arange(0.0, 1.0, 0.1), *np.arange(3600.0, 3601.0, 0.1)]
    messages = [{"stamp": stamp, "q": UPRIGHT} for stamp in stamps]
    found = read(messages)
    np.testing.assert_allclose(found.times, stamps, atol=1e-6)


def in_bursts(count=500, each=10):
    """Return times of measurement, and of arrival: *each* ten that waited arrive in 2 ms."""
    times = 0.02 * np.arange(count)
    arrivals = times[each - 1 :: each].repeat(each) + np.tile(2e-4 * np.arange(each), count // each)
    return times, arrivals


def test_times_of_arrival_are_recognised(tmp_path):
    times, arrivals = in_bursts()
    q = rotation.exp(np.outer(np.sin(3.0 * times), [0.0, 0.6, 0.8]))
    messages = [{"stamp": t, "q": named(one)} for t, one in zip(arrivals.tolist(), q, strict=True)]
    path = json_file(tmp_path / "a.mcap", messages)
    expected = "of 499 steps 450 are below 2 ms and 49 above 39 ms; use times of measurement"
    (note,) = read_orientations(path).notes
    assert note.startswith("the times look like times of arrival")
    assert note.endswith(expected)
    assert_refused(inside("replay", path, "--dry-run"), "at most a tenth: ", expected)


def test_random_times_are_no_times_of_arrival(read):
    for seed in range(20):
        times = np.cumsum(np.random.default_rng(seed).exponential(0.02, 200))
        messages = [{"stamp": 1.0 + t, "q": UPRIGHT} for t in times.tolist()]
        assert read(messages).notes == ()


def test_replay_and_plot_name_the_clock(tmp_path):
    times = 0.02 * np.arange(100)
    q = rotation.exp(np.outer(np.sin(3.0 * times), [0.0, 0.6, 0.8]))
    messages = [{"stamp": t, "q": named(one)} for t, one in zip(times.tolist(), q, strict=True)]
    path = json_file(tmp_path / "a.mcap", messages)
    done = inside("replay", path, "--dry-run")
    assert "100 samples in 1.98 s by the stamps of its messages" in done.stdout
    drawn = inside("plot", path, "-o", tmp_path / "a.svg")
    assert "drawn by the stamps of its messages" in drawn.stdout


def test_a_stamp_without_nanoseconds_or_seconds_is_taken(read):
    messages = [
        {"stamp": {"sec": 0, "nanosec": 7}, "q": UPRIGHT},
        {"stamp": {"sec": 1}, "q": UPRIGHT},
    ]
    found = read(messages)
    np.testing.assert_allclose(found.times, [0.0, 1.0 - 7e-9], atol=1e-12)


def test_a_stamp_out_of_all_time_is_none(read):
    messages = [{"stamp": stamp, "q": UPRIGHT} for stamp in (1.0, 1e300, -1e300, *range(2, 20))]
    found = read(messages)
    np.testing.assert_allclose(found.times, [0.0, np.nan, np.nan, *range(1, 19)], atol=1e-9)
    assert found.notes == (
        "left out: 2 of 21 samples without a time or number (first in sample 1)",
    )


@pytest.mark.parametrize("name", ["orientation", "rotation", "quaternion", "q"])
@pytest.mark.parametrize("nest", ["pose", "transform", "odometry", ""])
def test_a_quaternion_is_found_by_the_names_of_its_fields(read, nest, name):
    turn = {name: named([0.6, 0.0, 0.8, 0.0])}
    message = {nest: {"pose": turn} if nest == "pose" else turn} if nest else turn
    found = read([message] * 2)
    assert found.q.tolist() == [[0.6, 0.0, 0.8, 0.0]] * 2


def test_a_quaternion_that_is_buried_or_lacks_a_number_is_none(read):
    turn = {"q": UPRIGHT}
    for message in (
        {"pose": {"pose": {"pose": {"pose": turn}}}},
        {"q": {"w": 1.0, "x": 0.0, "y": 0.0}},
        {"q": {"w": "1", "x": 0.0, "y": 0.0, "z": 0.0}},
    ):
        with pytest.raises(RecordingError, match="no orientations in its topics, /head"):
            read([message] * 2)


def test_a_measurement_that_was_read_twice_is_one(tmp_path):
    table = moving(60)
    table["feedback_time_ns"][1::2] = table["feedback_time_ns"][::2]
    table["flags"][40:50] &= ~np.uint32(1)
    table["flags"][50:] &= ~np.uint32(2)
    with RecordingWriter(tmp_path / "a.mcap", offset_ns=OFFSET_NS) as writer:
        writer.add_device("arm", RATE_HZ)
        writer.add_configuration("{}", {})
        writer.add_cycles("arm", table)
    assert len(read_orientations(tmp_path / "a.mcap", "/arm/measured").times) == 25
    assert len(read_orientations(tmp_path / "a.mcap", "/arm/sent").times) == 50


def test_norms_near_one_are_scaled_and_others_are_left_out(read):
    rows = [[1.0, 0.0, 0.0, 0.0], [0.51, 0.0, 0.0, 0.0], [1.99, 0.0, 0.0, 0.0]]
    rows += [[0.49, 0.0, 0.0, 0.0], [0.0, 2.01, 0.0, 0.0]]
    rows += [[1.0, 0.0, 0.0, 0.0]] * 20
    messages = [{"q": named(row)} for row in rows]
    found = read(messages)
    assert found.q[:3].tolist() == [[1.0, 0.0, 0.0, 0.0]] * 3
    assert np.isnan(found.q[3:5]).all()
    assert found.notes == (
        "left out: 2 of 25 quaternions with a norm outside 0.5 to 2 (first in sample 3: 0.49)",
        "scaled to 1: 2 of 25 quaternions with norms from 0.51 to 1.99",
    )


@pytest.mark.parametrize("norm", [0.45, 2.0, 2.1, 3.0, 100.0, 2.0**14, 2.0**30, 1e200])
def test_quaternions_of_any_scale_are_scaled_with_a_note(read, norm):
    messages = [{"stamp": t, "q": named(norm * q)} for t, q in zip(TIMES.tolist(), Q, strict=True)]
    messages[4]["q"] = named([0.0, 0.0, 0.0, 0.0])
    found = read(messages)
    np.testing.assert_allclose(np.delete(found.q, 4, axis=0), np.delete(Q, 4, axis=0), atol=1e-9)
    assert np.isnan(found.q[4]).all()
    left_out, scaled = found.notes
    assert left_out.endswith("(first in sample 4: 0)")
    assert scaled == f"scaled to 1: 19 of 20 quaternions with norm {norm:.6g}"


def test_two_scales_in_one_recording_are_refused(read):
    messages = [{"stamp": t, "q": named(q)} for t, q in zip(TIMES.tolist(), 100.0 * Q, strict=True)]
    for k in (3, 7, 11):
        messages[k]["q"] = named(Q[k])
    expected = (
        r"more than a tenth of the samples is unusable: 3 of 20 quaternions with a norm outside 50 "
        r"to 200 \(first in sample 3: 1\); cut or repair the recording"
    )
    with pytest.raises(RecordingError, match=expected):
        read(messages)


@pytest.mark.parametrize("junk", [2, 3])
def test_more_than_a_tenth_of_junk_is_refused(tmp_path, junk):
    messages = [{"stamp": t, "q": named(q)} for t, q in zip(TIMES.tolist(), Q, strict=True)]
    for k in range(5, 5 + junk):
        messages[k]["stamp"] = 1e300
    path = json_file(tmp_path / "a.mcap", messages)
    problem = f"{junk} of 20 samples without a time or number (first in sample 5)"
    if junk == 2:
        assert read_orientations(path).notes == (f"left out: {problem}",)
    else:
        for command in (("replay", path, "--dry-run"), ("plot", path, "-o", tmp_path / "a.svg")):
            assert_refused(inside(*command), "more than a tenth of the samples", problem)


def test_samples_at_one_time_are_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,qw,qx,qy,qz\n" + "1.5,1,0,0,0\n" * 20)
    with pytest.raises(RecordingError, match=r"all 20 samples have the same time, 1\.5 s, by the"):
        read_orientations(path)


def test_repeated_and_late_times_have_a_note(read):
    stamps = [1.0, 1.1, 1.1, 1.3, 1.25, 1.4]
    messages = [{"stamp": stamp, "q": UPRIGHT} for stamp in stamps]
    found = read(messages)
    assert "not used: 1 of 6 samples with the time of an earlier sample" in found.notes
    assert any("steps back once, first in sample 4, by at most 0.05 s" in n for n in found.notes)
    steady = [{"stamp": 1.0 + 0.1 * k, "q": UPRIGHT} for k in range(5)]
    assert read(steady).notes == ()


def test_a_path_may_be_text(ours):
    path, table = ours
    found = read_orientations(str(path), "/arm/sent")
    np.testing.assert_allclose(found.q, table["sent_q"], atol=1e-9)
    assert len(reader.load_recording(str(path)).cycles["arm"]) == len(table)


def test_a_mistake_of_the_caller_is_not_called_damage():
    for read in (read_orientations, reader.load_recording):
        with pytest.raises(TypeError):
            read(7)


@pytest.mark.parametrize(
    "message",
    [
        {"transforms": 5},
        {"transforms": {"a": 1}},
        {"transforms": [5, "x", None]},
        {"q": {"w": 10**400, "x": 0, "y": 0, "z": 0}},
        {"q": UPRIGHT, "stamp": {"sec": "5", "nanosec": 0}},
        {"q": UPRIGHT, "stamp": {"sec": 10**400}},
        {"q": UPRIGHT, "stamp": 10**400},
        {"q": UPRIGHT, "stamp": {"sec": 1, "nanosec": float("nan")}},
        [],
        "text",
        7,
    ],
)
def test_messages_of_any_content_do_no_harm(read, message):
    turn = {"q": UPRIGHT}
    good = [{**turn, "stamp": 1.0 + 0.1 * k} for k in range(19)]
    found = read([*good, message])
    assert len(found.times) - np.count_nonzero(np.isnan(found.times)) in (19, 20)


def test_a_time_of_recording_beyond_all_clocks_is_no_time(read):
    times = [2**64 - 1 if k == 7 else k for k in range(20)]
    found = read([{"q": named(q)} for q in Q], log_times=times)
    assert np.flatnonzero(np.isnan(found.times)).tolist() == [7]
    assert "1 of 20 samples without a time or number (first in sample 7)" in found.notes[0]


def test_a_message_that_cannot_be_decoded_is_damage(tmp_path):
    messages = [b"{" if k == 7 else {"q": named(q)} for k, q in enumerate(Q)]
    path = json_file(tmp_path / "a.mcap", messages)
    with pytest.raises(RecordingError, match=r"a\.mcap: /head is damaged: Expecting.*`--partial`"):
        read_orientations(path)
    found = read_orientations(path, partial=True)
    np.testing.assert_allclose(found.q, np.delete(Q, 7, axis=0), atol=1e-9)
    assert found.notes == ("1 message cannot be read",)


def test_topics_without_orientations_are_named_with_their_types(tmp_path):
    topics = {"/log": [{}], "/load": [{}]}
    path = json_file(tmp_path / "a.mcap", topics, kinds=["foxglove.Log", "lab.Load"])
    assert_refused(
        inside("replay", path, "--dry-run"),
        "no orientations in its topics, /log (foxglove.Log), /load (lab.Load); expected a field "
        "orientation, rotation, quaternion or q with w, x, y, z",
    )


def test_a_recording_of_others_cannot_be_exported(tmp_path):
    path = json_file(tmp_path / "a.mcap", [{"stamp": 1.0, "q": named(Q[0])}])
    done = inside("export", path, "-o", tmp_path / "a.csv")
    assert_refused(done, "not a recording of orientd; `orientd replay` and `orientd plot` read")


def test_a_recording_at_rest_is_refused_as_such(tmp_path):
    messages = [{"stamp": t, "q": named(Q[3])} for t in TIMES.tolist()]
    path = json_file(tmp_path / "a.mcap", messages)
    for pace in ("recorded", "minimum"):
        done = inside("replay", path, "--dry-run", "--pace", pace)
        assert_refused(done, "the recording is at rest: its 20 samples have one orientation; there")
