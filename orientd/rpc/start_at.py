"""When a motion is to begin, on the clock of the daemon that runs it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class StartAt:
    """A start time that no clock on the wall can move.

    Attributes:
        monotonic_ns: on the daemon's monotonic clock.
        metadata: of the call, for whoever carries it.
    """

    monotonic_ns: int
    metadata: tuple[tuple[str, str], ...] = ()
