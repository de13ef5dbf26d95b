"""Recordings: what was planned, sent and measured, in MCAP files that viewers open.

Needs the extra ``record``: ``mcap`` and Foxglove's schemas, imported where a file
is read or written.  Packages that read recordings of other programs also use ``mcap_file``,
``reader`` and ``writer``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.recorder.columns import COLUMNS, CYCLES, FLAGS, Table, from_records
    from orientd.recorder.planned import marks, planned_orientations
    from orientd.recorder.reader import NotOursError, load_recording
    from orientd.recorder.session import DaemonRecorder, LiveRecording, RecordingSession
    from orientd.recorder.tables import export
    from orientd.recorder.writer import RecordingError, RecordingWriter

_MOVED = {
    "Orientations": "orientd_replay.Orientations",
    "read_orientations": "orientd_replay.read_orientations",
}
"""Names of version 0.2 and where they are now."""

_find = lazily(
    __name__,
    {
        "orientd.recorder.columns": (
            "COLUMNS",
            "CYCLES",
            "FLAGS",
            "Table",
            "from_records",
        ),
        "orientd.recorder.planned": (
            "marks",
            "planned_orientations",
        ),
        "orientd.recorder.reader": (
            "NotOursError",
            "load_recording",
        ),
        "orientd.recorder.session": (
            "DaemonRecorder",
            "LiveRecording",
            "RecordingSession",
        ),
        "orientd.recorder.tables": ("export",),
        "orientd.recorder.writer": (
            "RecordingError",
            "RecordingWriter",
        ),
    },
)


def __getattr__(name: str) -> Any:  # noqa: ANN401 - the signature PEP 562 asks for
    if name in _MOVED:
        # `from orientd.recorder import` hides the message of an AttributeError.
        raise ImportError(f"orientd.recorder.{name} is now {_MOVED[name]}")
    return _find(name)
