"""Read ROS 2 bags: a folder with ``metadata.yaml``, or one ``.db3`` file of it.

Needs the extra ``bags``: ``rosbags``, which reads both storages, sqlite3 and MCAP, compressed or
not, without ROS.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from orientd.errors import OrientdError
from orientd.files import MEBIBYTE, check_regular
from orientd.one_line import one_line
from orientd.recorder.mcap_file import Damages
from orientd.recorder.reader import decoding
from orientd.recorder.writer import RecordingError

LEAVE_OUT = "`--partial` (in Python `partial=True`) leaves out such messages"
"""The cure for damaged messages."""


def messages(
    path: Path, kinds: dict[str, str], damages: Damages, *, partial: bool = False
) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, recording time (ns) and content of every message of a known type.

    A bag of Humble or older holds no definitions.  For these the definitions of Humble count, and
    topics of other types are left out.

    Args:
        path: of the bag.
        kinds: receives the type of each topic.
        damages: receives the number of damaged messages.
        partial: whether to leave out damaged messages.

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
    if path.is_dir():
        _check_description(path)
    try:
        for file in path.iterdir() if path.is_dir() else (path,):
            if not file.is_dir():
                check_regular(file, most_bytes=MEBIBYTE if file.suffix == ".yaml" else 0)
        known = get_typestore(Stores.ROS2_HUMBLE)
        with AnyReader([path], default_typestore=known) as reader:
            types = reader.typestore.fielddefs
            kinds |= {one.topic: one.msgtype for one in reader.connections}
            readable = [one for one in reader.connections if one.msgtype in types]
            # An empty list would mean all of them.
            for connection, time, content in reader.messages(readable) if readable else ():
                try:
                    with decoding(path, f"a message of {connection.topic} at {1e-9 * time:.3f} s"):
                        message = reader.deserialize(content, connection.msgtype)
                except RecordingError as error:
                    if not partial:
                        raise RecordingError(f"{error}; {LEAVE_OUT}") from error
                    damages.lost += 1
                else:
                    yield connection.topic, time, message
    except (RecordingError, OSError):
        raise
    # Four libraries raise their own exceptions for damage.
    except Exception as error:
        problem = one_line(str(error), 200) or type(error).__name__
        raise RecordingError(
            f"{path}: not a ROS 2 bag that can be read: {problem}; copy the whole bag again, or "
            "repair it with `ros2 bag reindex`"
        ) from error


def _check_description(path: Path) -> None:
    """Check that a folder has the description of a bag, as text.

    Raises:
        RecordingError: it has none.
        OSError: it cannot be read.
    """
    file = path / "metadata.yaml"
    if not file.exists():
        has_storage = any(one.suffix in (".db3", ".mcap") for one in path.iterdir())
        cure = f"`ros2 bag reindex {path}` makes it" if has_storage else "give the folder of a bag"
        raise RecordingError(f"{path}: not a ROS 2 bag: no metadata.yaml in this folder; {cure}")
    check_regular(file, most_bytes=MEBIBYTE)
    try:
        file.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise RecordingError(f"{file}: not UTF-8: {error.reason}; save it as UTF-8") from error
