"""When setpoints should be sent, against the controller's own cycle.

A controller takes, once a cycle, the setpoint that came last.  One that is sent close to that
moment comes now before it, now after: then two meet in one cycle and the first is lost, and the
next cycle has none.  Clocks drift, so that sooner or later this happens to whoever keeps to its
own clock.  So the deadlines are moved, slowly, until they are a quarter of a cycle behind the
arrival of the controller's data, which it sends as it takes setpoints: feedback is fresh then,
setpoints may be late by almost three quarters of a cycle, and early by most of a quarter.
"""

from __future__ import annotations

from collections.abc import Sequence

from orientd_ur.ticks.controller_clock import ControllerClock

AIM = 0.25
"""Share of a cycle from the arrival of the controller's data to the deadline."""

_SHARE = 16


def tick_ns(version: Sequence[int]) -> int:
    """Return the cycle of a controller with the software *version*, ns: CB3 robots have 8 ms."""
    return 8_000_000 if version[0] < 5 else 2_000_000


class TickPhase:
    """The phase of the controller's cycle, and how to keep to it.

    Args:
        tick_ns: the controller's cycle.
        period_ns: ours; where it is no multiple of the controller's there is no phase to keep.
    """

    def __init__(self, tick_ns: int, period_ns: int) -> None:
        self._tick_ns = tick_ns
        self._has_phase = period_ns % tick_ns == 0
        self._clock = ControllerClock()
        self._arrived_ns: int | None = None

    def hear(self, timestamp: float, arrived_ns: int) -> None:
        """Take note of a package.

        Args:
            timestamp: the controller's, s.
            arrived_ns: when it arrived, our clock.  Those that took the least time count.
        """
        self._arrived_ns = self._clock.measured_ns(timestamp, arrived_ns)

    def shift_ns(self, deadline_ns: int) -> int:
        """Return by how much deadlines should move, seeing the one at *deadline_ns*.

        A sixteenth of what is missing, by the shorter way round; 0 before anything was heard.
        """
        if self._arrived_ns is None or not self._has_phase:
            return 0
        tick_ns = self._tick_ns
        early_ns = round(self._arrived_ns + AIM * tick_ns) - deadline_ns
        early_ns = (early_ns + tick_ns // 2) % tick_ns - tick_ns // 2
        return round(early_ns / _SHARE)
