"""Record events: the journal, the flight recorder, their lines in the log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.daemon.observe.flight_recorder import FlightRecorder
    from orientd.daemon.observe.journal import EventLog, Journal

__getattr__ = lazily(
    __name__,
    {
        "orientd.daemon.observe.flight_recorder": ("FlightRecorder",),
        "orientd.daemon.observe.journal": ("EventLog", "Journal"),
    },
)
