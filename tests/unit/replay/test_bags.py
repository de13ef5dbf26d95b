"""Orientations out of ROS 2 bags: as rosbag2 of our days writes them, and as that of Humble did."""

import os
import sqlite3
import struct
import sys

import numpy as np
import pytest

from orientd import rotation
from orientd.errors import OrientdError
from orientd.recorder.writer import RecordingError
from orientd_replay.orientations import read_orientations

rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")

TIMES = 1000.0 + 0.05 * np.arange(20)
Q = rotation.exp(np.outer(0.05 * np.arange(20), [0.0, 0.6, 0.8]))
COMPRESSED = rosbag2.CompressionMode.FILE, rosbag2.CompressionMode.MESSAGE

# What a message definition of somebody's own looks like.
HEAD = """\
std_msgs/Header header
geometry_msgs/Quaternion orientation
float32 confidence
"""


def check(found):
    np.testing.assert_allclose(found.times, TIMES - TIMES[0], atol=1e-6)
    np.testing.assert_allclose(found.q, Q, atol=1e-9)


def split(time):
    return int(time), round((time - int(time)) * 1e9)


def write_bag(path, storage, compression=None):
    """Write a bag with poses, messages of somebody's own, transforms and text."""
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    store.register(typesys.get_types_from_msg(HEAD, "lab_msgs/msg/Head"))
    kinds = store.types
    names = {
        "/pose": "geometry_msgs/msg/PoseStamped",
        "/head": "lab_msgs/msg/Head",
        "/tf": "tf2_msgs/msg/TFMessage",
        "/text": "std_msgs/msg/String",
    }
    writer = rosbag2.Writer(path, version=9, storage_plugin=storage)
    if compression is not None:
        writer.set_compression(compression, rosbag2.CompressionFormat.ZSTD)
    with writer:
        ways = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in names.items()
        }
        for time, (w, x, y, z) in zip(TIMES, Q, strict=True):
            sec, nanosec = split(time)
            stamp = kinds["builtin_interfaces/msg/Time"](sec, nanosec)
            header = kinds["std_msgs/msg/Header"](stamp, "map")
            turn = kinds["geometry_msgs/msg/Quaternion"](x, y, z, w)
            pose = kinds["geometry_msgs/msg/Pose"](
                kinds["geometry_msgs/msg/Point"](0.0, 0.0, 0.0), turn
            )
            moved = kinds["geometry_msgs/msg/Transform"](
                kinds["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0), turn
            )
            transform = kinds["geometry_msgs/msg/TransformStamped"](header, "tool", moved)
            for topic, message in {
                "/pose": kinds[names["/pose"]](header, pose),
                "/head": kinds[names["/head"]](header, turn, 0.5),
                "/tf": kinds[names["/tf"]]([transform]),
                "/text": kinds[names["/text"]]("nothing of the kind"),
            }.items():
                content = store.serialize_cdr(message, names[topic])
                writer.write(ways[topic], 5, content)
    return path


@pytest.mark.parametrize("topic", ["/pose", "/head", "/tf#tool"])
@pytest.mark.parametrize("storage", list(rosbag2.StoragePlugin))
def test_a_bag_is_read_whatever_stores_it(tmp_path, storage, topic):
    path = write_bag(tmp_path / "bag", storage)
    found = read_orientations(path, topic)
    assert found.topic == topic
    check(found)
    with pytest.raises(RecordingError, match="name one topic of '/pose'"):
        read_orientations(path)


@pytest.mark.parametrize("compression", COMPRESSED)
def test_a_compressed_bag_is_read(tmp_path, compression):
    storage = rosbag2.StoragePlugin.SQLITE3
    check(read_orientations(write_bag(tmp_path / "bag", storage, compression), "/pose"))


def humble(path):
    """Write a database as Humble leaves it, by hand: it holds no definitions of its messages."""
    database = sqlite3.connect(path)
    database.executescript(
        """
        CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
        CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL,
                              metadata TEXT NOT NULL);
        CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
                            serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
        CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
                              timestamp INTEGER NOT NULL, data BLOB NOT NULL);
        INSERT INTO schema VALUES (3, 'humble');
        INSERT INTO topics VALUES (1, '/q', 'geometry_msgs/msg/QuaternionStamped', 'cdr', '');
        INSERT INTO topics VALUES (2, '/own', 'lab_msgs/msg/Head', 'cdr', '');
        """
    )
    for time, (w, x, y, z) in zip(TIMES, Q, strict=True):
        # CDR: four bytes of encoding, then each number at a multiple of its own size from there.
        header = struct.pack("<iII4s", *split(time), 4, b"map\0")
        content = b"\0\1\0\0" + header + struct.pack("<4d", x, y, z, w)
        for topic, one in ((1, content), (2, b"\0\1\0\0nobody knows")):
            database.execute(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", (topic, 5, one)
            )
    database.commit()
    database.close()
    return path


def test_a_database_without_definitions_is_read_alone(tmp_path):
    found = read_orientations(humble(tmp_path / "bag_0.db3"))
    assert found.topic == "/q"
    check(found)


@pytest.mark.parametrize("content", [b"", b"SQLite format 3\0 and no more", b"some text"])
def test_what_is_no_bag_is_refused_in_one_line(tmp_path, content):
    (tmp_path / "a.db3").write_bytes(content)
    with pytest.raises(RecordingError, match="not a ROS 2 bag that can be read") as refused:
        read_orientations(tmp_path / "a.db3")
    assert "\n" not in str(refused.value)


def test_a_folder_or_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"no metadata\.yaml in this folder; give the folder"):
        read_orientations(tmp_path)
    with pytest.raises(RecordingError, match=r"cannot read .*none\.db3: No such file"):
        read_orientations(tmp_path / "none.db3")


def test_a_bag_without_its_description_is_told_how_to_get_one(tmp_path):
    path = write_bag(tmp_path / "bag", rosbag2.StoragePlugin.SQLITE3)
    (path / "metadata.yaml").unlink()
    cure = rf"no metadata\.yaml in this folder; `ros2 bag reindex {path}` makes it"
    with pytest.raises(RecordingError, match=cure):
        read_orientations(path)


def test_a_description_in_another_encoding_is_named(tmp_path):
    path = write_bag(tmp_path / "bag", rosbag2.StoragePlugin.SQLITE3)
    file = path / "metadata.yaml"
    file.write_bytes(file.read_text().encode("utf-16"))
    with pytest.raises(RecordingError, match=r"metadata\.yaml: not UTF-8: .*; save it as UTF-8"):
        read_orientations(path)


def test_a_bag_may_hold_folders_but_no_pipe(tmp_path):
    path = write_bag(tmp_path / "bag", rosbag2.StoragePlugin.MCAP)
    (path / "notes").mkdir()
    check(read_orientations(path, "/pose"))
    os.mkfifo(path / "pipe")
    with pytest.raises(RecordingError, match="not a regular file"):
        read_orientations(path, "/pose")


def test_a_description_beyond_all_measure_is_refused(tmp_path):
    path = write_bag(tmp_path / "bag", rosbag2.StoragePlugin.MCAP)
    with (path / "metadata.yaml").open("a") as stream:
        stream.write("#" * 2**20)
    with pytest.raises(RecordingError, match="expected at most 1 MiB"):
        read_orientations(path, "/pose")


def test_damaged_messages_are_refused_with_their_place_and_left_out_on_request(tmp_path):
    path = humble(tmp_path / "bag_0.db3")
    database = sqlite3.connect(path)
    database.execute("UPDATE messages SET data = substr(data, 1, 30) WHERE id IN (11, 25)")
    database.commit()
    database.close()
    place = r"a message of /q at 0\.000 s is damaged: .*; `--partial` \(in Python `partial=True`\)"
    with pytest.raises(RecordingError, match=place) as refused:
        read_orientations(path)
    assert "\n" not in str(refused.value)
    found = read_orientations(path, partial=True)
    np.testing.assert_allclose(found.q, np.delete(Q, [5, 12], axis=0), atol=1e-9)
    assert found.notes == ("2 messages cannot be read",)


def test_a_bag_of_other_topics_is_named_with_their_types(tmp_path):
    path = humble(tmp_path / "bag_0.db3")
    database = sqlite3.connect(path)
    database.execute("DELETE FROM topics WHERE id = 1")
    database.commit()
    database.close()
    with pytest.raises(
        RecordingError, match=r"in its topics, /own \(lab_msgs/msg/Head\); expected"
    ):
        read_orientations(path)


def test_without_the_library_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(OrientdError, match=r"pip install 'orientd-motion\[bags\]'"):
        read_orientations(tmp_path)
