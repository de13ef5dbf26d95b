"""Record events: the journal, the flight recorder, their lines in the log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.daemon.observe.event_log import EventLog
    from orientd.daemon.observe.flight_recorder import FlightRecorder
    from orientd.daemon.observe.journal import Journal

__getattr__ = lazily(
    __name__,
    {
        "orientd.daemon.observe.event_log": ("EventLog",),
        "orientd.daemon.observe.flight_recorder": ("FlightRecorder",),
        "orientd.daemon.observe.journal": ("Journal",),
    },
)
