"""Reports of the device besides its feedback: notices, health, durations of calls, arrival.

A motion ends with its last setpoint, and the axes lag behind it.  They have arrived once each was
measured within its tolerance.  An axis that has not arrived in the time that the driver allows it
is blocked or overloaded.  That is a fault; it names the axis and says how far it is behind.
"""

from __future__ import annotations

import math

from orientd.driver import Arriving, AxisGap, Driver, Healthy
from orientd.stream import (
    LONGEST_READ_WORD,
    LONGEST_WRITE_WORD,
    NoteKind,
    SharedMemory,
    pack_note,
    publish_health,
)

_INTERVAL_NS = 1_000_000_000

_CALLS = (LONGEST_READ_WORD, LONGEST_WRITE_WORD)

_TOLERATED = 10.0
"""How often in a second a call may take longer than its driver declares; a call that takes n times
as long counts n times.  A busy machine interrupts a few calls of any driver."""


class CallTimes:
    """How long a driver's reads and writes take, against what it declares."""

    def __init__(self, driver: Driver, memory: SharedMemory) -> None:
        self._words = memory.pulse
        self._declared_ns = driver.longest_call * 1e9
        self._excess = 0.0
        self._notices: tuple[str, ...] = ()

    def note(self, word: int, taken_ns: int) -> None:
        """Take note of a read or write, by its *word*, that took so long."""
        if taken_ns > self._words[word]:
            self._words[word] = taken_ns
        if taken_ns > self._declared_ns:
            self._excess += taken_ns / self._declared_ns

    def notices(self) -> tuple[str, ...]:
        """Return a warning once too many calls of one second took too long; call once a second."""
        if self._excess >= _TOLERATED and not self._notices:
            read, write = (self._words[word] * 1e-6 for word in _CALLS)
            self._notices = (
                f"the driver keeps the servo waiting: reads took up to {read:.1f} ms and writes up "
                f"to {write:.1f} ms, at most {self._declared_ns * 1e-6:.1f} ms are declared",
            )
        self._excess = 0.0
        return self._notices

    def forget(self) -> None:
        """Warn anew; the device was opened or reset, which may have taken long."""
        self._excess, self._notices = 0.0, ()


class DeviceReports:
    """Notices and health, handed on to the daemon.

    Attributes:
        note_call: takes note of how long a read or write took, see :meth:`CallTimes.note`.
    """

    def __init__(self, driver: Driver, memory: SharedMemory, period_ns: int) -> None:
        self._healthy = driver if isinstance(driver, Healthy) else None
        self._memory = memory
        self._every = max(1, _INTERVAL_NS // period_ns)
        self._calls = CallTimes(driver, memory)
        self.note_call = self._calls.note
        self._told: tuple[str, ...] = ()
        self._hindered = -self._every - 1

    def _publish(self, text: str) -> None:
        self._memory.notes.publish(*pack_note(0, NoteKind.NOTICE, 0, text))

    def publish_notices(self) -> None:
        """Publish all there is to say of a device that was opened, or reset."""
        self._told = ()
        self._calls.forget()
        self._publish_new()

    def _publish_new(self) -> None:
        notices = () if self._healthy is None else tuple(self._healthy.notices())
        notices += self._calls.notices()
        for text in notices:
            if text not in self._told:
                self._publish(text)
        self._told = notices

    def publish_health(self, cycle: int) -> None:
        """Publish once a second what is new and how the parts are; call in every *cycle*."""
        if cycle % self._every == 0:
            self._publish_new()
            parts = () if self._healthy is None else self._healthy.health()
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

    def __init__(self, device: Arriving | None) -> None:
        self.is_awaited = False
        self._device = device
        self._sent_ns = 0

    def begin(self, sent_ns: int) -> None:
        """Wait for the axes to be where the setpoint of the cycle at *sent_ns* sends them."""
        self.is_awaited, self._sent_ns = self._device is not None, sent_ns

    def look(self, measured_ns: int) -> str:
        """Look at the axes as they were measured at *measured_ns*.

        Returns:
            Which of them will not arrive; empty while they may, and once they have.
        """
        gaps = () if self._device is None else self._device.gaps()
        # A measurement from before the last setpoint says nothing; nor does no measurement at all.
        if gaps and measured_ns <= self._sent_ns:
            return ""
        waited = (measured_ns - self._sent_ns) * 1e-9
        behind = [axis for axis in gaps if not abs(axis.gap) <= axis.tolerance]
        late = [axis for axis in behind if waited >= axis.patience]
        self.is_awaited = bool(behind) and not late
        return "; ".join(map(_explain, late))


def _explain(axis: AxisGap) -> str:
    load = f", with {axis.load}" if axis.load else ""
    return (
        f"{axis.name} has not arrived: it is {math.degrees(abs(axis.gap)):.1f} deg behind the end "
        f"of the motion {axis.patience:.2g} s after the last setpoint, at most "
        f"{math.degrees(axis.tolerance):.3g} deg are allowed{load}; is it blocked or overloaded?"
    )
