"""Reports of the device besides its feedback: notices, health, call durations, arrival.

A motion ends with its last setpoint, and the axes lag behind it.  They have arrived once each was
measured within its tolerance.  An axis that has not arrived within the time that the driver allows
is blocked or overloaded.  This is a fault, which names the axis and its distance.
"""

from __future__ import annotations

import math

from orientd.driver import Arriving, AxisGap, Driver, Healthy
from orientd.stream.memory import (
    LONGEST_READ_WORD,
    LONGEST_WRITE_WORD,
    SharedMemory,
    publish_health,
)
from orientd.stream.records import NoteKind, pack_note

_INTERVAL_NS = 1_000_000_000

_CALLS = (LONGEST_READ_WORD, LONGEST_WRITE_WORD)

_TOLERATED = 10.0
"""Allowed slow calls per second; a call that takes n times as long as declared counts n times.

A busy machine interrupts a few calls of any driver.
"""


class CallTimes:
    """Durations of a driver's reads and writes, compared with its declaration."""

    def __init__(self, driver: Driver, memory: SharedMemory) -> None:
        self._words = memory.pulse
        self._declared_ns = max(1.0, driver.longest_call * 1e9)
        self._excess = 0.0
        self._notices: tuple[str, ...] = ()

    def note(self, word: int, taken_ns: int) -> None:
        """Record the duration of a read or a write, as given by *word*."""
        if taken_ns > self._words[word]:
            self._words[word] = taken_ns
        if taken_ns > self._declared_ns:
            self._excess += taken_ns / self._declared_ns

    def notices(self) -> tuple[str, ...]:
        """Return a warning if too many calls within a second were slow; call once a second."""
        if self._excess >= _TOLERATED and not self._notices:
            read, write = (self._words[word] * 1e-6 for word in _CALLS)
            self._notices = (
                f"the driver keeps the servo waiting: reads took up to {read:.1f} ms and writes up "
                f"to {write:.1f} ms, at most {self._declared_ns * 1e-6:.1f} ms are declared",
            )
        self._excess = 0.0
        return self._notices

    def forget(self) -> None:
        """Allow another warning: the device was opened or reset, which may take long."""
        self._excess, self._notices = 0.0, ()


class DeviceReports:
    """Notices and health of the device, passed on to the daemon.

    Attributes:
        note_call: records the duration of a read or write, see :meth:`CallTimes.note`.
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
        """Publish everything about a device that was opened or reset."""
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
        """Once a second, publish new notices and the health of the parts; call in every *cycle*."""
        if cycle % self._every == 0:
            self._publish_new()
            parts = () if self._healthy is None else self._healthy.health()
            if parts:
                publish_health(self._memory.health, parts)

    def publish_hindrance(self, text: str, cycle: int) -> None:
        """Publish why targets are not followed; repeated only after a second without a problem."""
        if cycle - self._hindered > self._every:
            self._publish(f"targets are followed more slowly, or not to their end: {text}")
        self._hindered = cycle


_SPENT = 1.0 - 1e-9
"""Share of its patience that an axis may spend; sums of shares are rounded."""


class Arrival:
    """The wait for the axes after the last setpoint of a motion.

    Attributes:
        is_awaited: whether they have not arrived yet.
    """

    def __init__(self, device: Arriving | None) -> None:
        self.is_awaited = False
        self._device = device
        self._measured_ns = 0
        self._spent: dict[str, float] = {}

    def begin(self, sent_ns: int) -> None:
        """Wait for the axes to reach the setpoint of the cycle at *sent_ns*."""
        self.is_awaited, self._measured_ns = self._device is not None, sent_ns
        self._spent = {}

    def look(self, measured_ns: int) -> str:
        """Check the axes by the measurement at *measured_ns*.

        Returns:
            The axes that will not arrive; empty while they still may, and once they have.
        """
        gaps = () if self._device is None else self._device.gaps()
        # A measurement from before the last setpoint does not count; nor does a missing one.
        if gaps and measured_ns <= self._measured_ns:
            return ""
        waited, self._measured_ns = (measured_ns - self._measured_ns) * 1e-9, measured_ns
        behind = [axis for axis in gaps if not abs(axis.gap) <= axis.tolerance]
        # Patience may change with the speed of the device, so each wait spends its share of it.
        spent = self._spent
        self._spent = {one.name: spent.get(one.name, 0.0) + waited / one.patience for one in gaps}
        late = [axis for axis in behind if self._spent[axis.name] >= _SPENT]
        self.is_awaited = bool(behind) and not late
        return "; ".join(map(_explain, late))


def _explain(axis: AxisGap) -> str:
    load = f", with {axis.load}" if axis.load else ""
    return (
        f"{axis.name} has not arrived: it is {math.degrees(abs(axis.gap)):.1f} deg behind the end "
        f"of the motion {axis.patience:.2g} s after the last setpoint, at most "
        f"{math.degrees(axis.tolerance):.3g} deg are allowed{load}; is it blocked or overloaded?"
    )
