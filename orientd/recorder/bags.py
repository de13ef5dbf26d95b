"""Read ROS 2 bags: a folder with ``metadata.yaml``, or one ``.db3`` file of it.

Needs the extra ``bags``: ``rosbags``, which reads both storages, sqlite3 and MCAP, compressed or
not, without ROS.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from orientd.bounded_file import MEBIBYTE, check_regular
from orientd.errors import OrientdError
from orientd.recorder.writer import RecordingError


def is_bag(path: Path) -> bool:
    """Return whether *path* has the form of a bag."""
    return path.is_dir() or path.suffix == ".db3"


def messages(path: Path) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, recording time (ns) and content of every message of a known type.

    A bag of Humble or older holds no definitions.  For these the definitions of Humble count, and
    topics of other types are left out.

    Raises:
        OrientdError: the library is not there.
        RecordingError: there is no bag at *path*, or it is damaged.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise OrientdError(
            "ROS 2 bags need the extra `bags`: pip install 'orientd-motion[bags]'"
        ) from error
    try:
        for file in path.iterdir() if path.is_dir() else (path,):
            if not file.is_dir():
                check_regular(file, most_bytes=MEBIBYTE if file.suffix == ".yaml" else 0)
        known = get_typestore(Stores.ROS2_HUMBLE)
        with AnyReader([path], default_typestore=known) as reader:
            types = reader.typestore.fielddefs
            readable = [one for one in reader.connections if one.msgtype in types]
            # An empty list would mean all of them.
            for connection, time, content in reader.messages(readable) if readable else ():
                yield connection.topic, time, reader.deserialize(content, connection.msgtype)
    # Four libraries raise their own exceptions for damage.
    except Exception as error:
        text = " ".join(str(error).split())[:200] or type(error).__name__
        raise RecordingError(f"{path}: not a ROS 2 bag that can be read: {text}") from error
