"""Recognise files of other programs by how they begin, and say how to make one that can be read."""

from __future__ import annotations

from pathlib import Path

EXPECTED = "a .mcap, .csv, .tum or .txt file, or a ROS 2 bag (its folder or a .db3 file)"
_BEGINNINGS = {
    b"ULog": "a ULog file of PX4; export its attitude with `ulog2csv` of pyulog",
    b"#ROSBAG": "a bag of ROS 1; convert it with `rosbags-convert`",
    b"\x1f\x8b": "a file packed with gzip; unpack it with `gunzip`",
    b"\x28\xb5\x2f\xfd": "a file packed with zstd; unpack it with `unzstd`",
    b"PK\x03\x04": "a ZIP archive or spreadsheet; unpack it, or export the sheet as .csv",
    b"SQLite format 3": "an SQLite database; name it .db3 if it is a ROS 2 bag",
    b"\x89MCAP": "an MCAP file; name it .mcap",
    b"PAR1": "a Parquet file; export its quaternions as .csv",
    b"\x89HDF": "an HDF5 file; export its quaternions as .csv",
}


def describe_kind(path: Path) -> str:
    """Return what a file is instead of a recording, and the next step; empty if it is unknown.

    Raises:
        OSError: it cannot be read.
    """
    if path.suffix in (".yaml", ".yml", ".json"):
        return f"its name is that of a motion file; run it with `orientd move {path}`"
    with path.open("rb") as stream:
        head = stream.read(16)
    return next(
        (f"it is {kind}" for mark, kind in _BEGINNINGS.items() if head.startswith(mark)), ""
    )
