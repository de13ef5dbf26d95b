"""Recordings: what was planned, sent and measured, in MCAP files that viewers open.

Needs the extra ``record``: ``mcap`` and Foxglove's schemas, imported where a file
is read or written.  Packages that read recordings of other programs also use ``mcap_records``,
``reader`` and ``writer``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.recorder.columns import COLUMNS, CYCLES, FLAGS, Table, from_records
    from orientd.recorder.planned import marks, planned_orientations
    from orientd.recorder.reader import NotOursError, load_recording
    from orientd.recorder.session import DaemonRecorder, LiveRecording, RecordingSession
    from orientd.recorder.tables import export
    from orientd.recorder.writer import RecordingError, RecordingWriter

__getattr__ = lazily(
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
