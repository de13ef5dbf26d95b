"""Reports of the device besides its feedback: notices, health, and whether its axes have arrived.

A motion ends with its last setpoint, and the axes lag behind it.  They have arrived once each was
measured within its tolerance.  An axis that has not arrived in the time that the driver allows,
half a second for most, is blocked or overloaded.  That is a fault; it names the axis and says how
far it is behind.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from orientd.driver import AxisGap, Driver
from orientd.stream import NoteKind, SharedMemory, pack_note, publish_health

ARRIVAL_NS = 500_000_000
"""How long after a motion's last setpoint the axes of most devices may take to arrive."""

_INTERVAL_NS = 1_000_000_000


class DeviceReports:
    """Notices and health, handed on to the daemon."""

    def __init__(self, driver: Driver, memory: SharedMemory, period_ns: int) -> None:
        self._driver = driver
        self._memory = memory
        self._every = max(1, _INTERVAL_NS // period_ns)
        self._told: tuple[str, ...] = ()
        self._hindered = -self._every - 1

    def _publish(self, text: str) -> None:
        self._memory.notes.publish(*pack_note(0, NoteKind.NOTICE, 0, text))

    def publish_notices(self) -> None:
        """Publish all there is to say of a device that was opened, or reset."""
        self._told = ()
        self._publish_new()

    def _publish_new(self) -> None:
        notices = tuple(self._driver.notices())
        for text in notices:
            if text not in self._told:
                self._publish(text)
        self._told = notices

    def publish_health(self, cycle: int) -> None:
        """Publish once a second what is new and how the parts are; call in every *cycle*."""
        if cycle % self._every == 0:
            self._publish_new()
            parts = self._driver.health()
            if parts:
                publish_health(self._memory.health, parts)

    def publish_hindrance(self, text: str, cycle: int) -> None:
        """Publish why targets are not followed; once until they have been for a second."""
        if cycle - self._hindered > self._every:
            self._publish(f"targets are followed more slowly, or not to their end: {text}")
        self._hindered = cycle


class Arrival:
    """The wait for the axes after the last setpoint of a motion.

    Attributes:
        is_awaited: whether they have not arrived yet.
    """

    def __init__(self) -> None:
        self.is_awaited = False
        self._sent_ns = 0

    def begin(self, sent_ns: int) -> None:
        """Wait for the axes to be where the setpoint of the cycle at *sent_ns* sends them."""
        self.is_awaited, self._sent_ns = True, sent_ns

    def look(self, gaps: Sequence[AxisGap], measured_ns: int, allowed_ns: int = ARRIVAL_NS) -> str:
        """Look at the axes as they were measured at *measured_ns*.

        Args:
            gaps: of the axes.
            measured_ns: when.
            allowed_ns: how long after the last setpoint they may take.

        Returns:
            Which of them will not arrive; empty while they may, and once they have.
        """
        # A measurement from before the last setpoint says nothing; nor does no measurement at all.
        if gaps and measured_ns <= self._sent_ns:
            return ""
        behind = [axis for axis in gaps if not abs(axis.gap) <= axis.tolerance]
        is_late = measured_ns - self._sent_ns >= allowed_ns
        self.is_awaited = bool(behind) and not is_late
        return "; ".join(_explain(axis, allowed_ns) for axis in behind) if is_late else ""


def _explain(axis: AxisGap, allowed_ns: int) -> str:
    load = f", with {axis.load}" if axis.load else ""
    return (
        f"{axis.name} has not arrived: it is {math.degrees(abs(axis.gap)):.1f} deg behind the end "
        f"of the motion {allowed_ns * 1e-9:.2g} s after the last setpoint, at most "
        f"{math.degrees(axis.tolerance):.3g} deg are allowed{load}; is it blocked or overloaded?"
    )
