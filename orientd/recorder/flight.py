"""The process that writes a file of the flight recorder: ``python -m orientd.recorder.flight``.

It reads a line of JSON, events and slots of cycles from standard input, as they were in memory.  It
keeps whole records of the wanted time, and prints the path of the file.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

import numpy as np

from orientd.errors import OrientdError
from orientd.files import written
from orientd.protocol import control_pb2 as pb
from orientd.recorder.columns import CYCLES, Table, from_records
from orientd.recorder.writer import RecordingWriter
from orientd.stream.records import CYCLE_RECORD
from orientd.stream.ring import RecordRing

PREFIX = "flight-"
_NICENESS = 10
_STRIDE = RecordRing.stride(CYCLE_RECORD)


def main() -> None:
    """Write the file that standard input asks for, or one line on standard error."""
    with contextlib.suppress(OSError):
        os.nice(_NICENESS)
    try:
        path = write(sys.stdin.buffer)
    except (OrientdError, OSError, ValueError) as error:
        print(" ".join(str(error).split()), file=sys.stderr)  # noqa: T201
        sys.exit(1)
    print(path)  # noqa: T201


def write(stream: IO[bytes]) -> Path:
    """Write one file and remove the oldest ones that are too many; return its path.

    Raises:
        OrientdError: it cannot be written; nothing is left of it.
        OSError: its directory cannot be made.
        ValueError: the stream is not what the daemon writes.
    """
    header: dict[str, Any] = json.loads(stream.readline())
    if header["layout"] != CYCLE_RECORD.format:
        raise ValueError("the cycles are from another version of orientd")
    events = [pb.Event.FromString(stream.read(size)) for size in header["events"]]
    cycles = whole_cycles(stream.read(), since_ns=header["since_ns"])
    directory = Path(header["directory"])
    directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    when = datetime.fromtimestamp((header["fault_ns"] + header["offset_ns"]) * 1e-9, UTC)
    device = header["device"]
    path = directory / f"{PREFIX}{device}-{when:%Y%m%dT%H%M%S.%f}Z.mcap"
    make_room(directory, header["keep_files"] - 1, header["keep_bytes"])
    with written(path) as part, RecordingWriter(part, offset_ns=header["offset_ns"]) as writer:
        writer.add_device(device, header["rate_hz"])
        facts = {
            "reason": header["reason"],
            "fault_ns": str(header["fault_ns"]),
            "health": json.dumps(header.get("health", [])),
        }
        writer.add_configuration(header["configuration"], facts)
        for event in events:
            writer.add_event(event)
        writer.add_cycles(device, cycles)
    make_room(directory, header["keep_files"], header["keep_bytes"])
    return path


def whole_cycles(slots: bytes, *, since_ns: int) -> Table:
    """Return the cycles in *slots* that are whole and not older than *since_ns*, in order."""
    views = (slots[at : at + _STRIDE] for at in range(0, len(slots) - _STRIDE + 1, _STRIDE))
    records = [r for view in views if (r := RecordRing.checked(view, CYCLE_RECORD)) is not None]
    cycles = from_records(records) if records else np.zeros(0, dtype=CYCLES)
    recent = cycles[cycles["deadline_ns"] >= since_ns]
    return recent[np.argsort(recent["deadline_ns"], kind="stable")]


def make_room(directory: Path, files: int, size: int) -> None:
    """Remove the oldest files of the flight recorder until the rest is within both limits.

    Args:
        directory: in which only the flight recorder has files of that name.
        files: how many may stay.
        size: bytes that they may take together; the newest stays in any case.
    """
    found: Sequence[Path] = sorted(
        directory.glob(f"{PREFIX}*.mcap"), key=lambda path: path.stat().st_mtime_ns, reverse=True
    )
    total = 0
    for number, path in enumerate(found):
        total += path.stat().st_size
        if number >= files or (total > size and number > 0):
            path.unlink(missing_ok=True)


if __name__ == "__main__":
    main()
