"""A ROS 2 bag of a turn to and fro, fitted by a certified motion (extras `record` and `bags`)."""

import math
import subprocess
from pathlib import Path

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

KIND = "geometry_msgs/msg/PoseStamped"
store = get_typestore(Stores.ROS2_HUMBLE)
types = store.types


def pose(seconds: float) -> object:
    """Return the pose at an instant, turning about z."""
    stamp = types["builtin_interfaces/msg/Time"](int(seconds), int(seconds % 1 * 1e9))
    half = 0.4 * math.sin(seconds)
    turned = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(half), math.cos(half))
    place = types["geometry_msgs/msg/Point"](0.0, 0.0, 0.0)
    header = types["std_msgs/msg/Header"](stamp, "world")
    return types[KIND](header, types["geometry_msgs/msg/Pose"](place, turned))


with Writer(Path("bag"), version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
    topic = writer.add_connection("/tool", KIND, typestore=store)
    for k in range(300):
        writer.write(topic, k * 10_000_000, store.serialize_cdr(pose(k / 100), KIND))

# Without --dry-run the device of the daemon moves; -o keeps the motion for `orientd move`.
command = ["orientd", "replay", "bag", "--error", "0.5", "--dry-run", "-o", "replayed.json"]
subprocess.run(command, check=True)
