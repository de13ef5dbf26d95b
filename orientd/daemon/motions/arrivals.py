"""When motions count as done: once the axes have arrived, or are measured to be on target.

The servo knows whether the axes have arrived, see :mod:`orientd.servo.device_reports`; a device
that does not tell has arrived with the last setpoint.
"""

from __future__ import annotations

from collections.abc import Callable

from orientd.daemon.devices import EventKind, ServoLink
from orientd.daemon.motions.options import ArrivalCondition
from orientd.driver import Quaternion
from orientd.floats import difference, norm
from orientd.stream import Cycle, CycleFlag, ServoState, unpack_cycle

_BLOCK = 256
_KEPT = 16

NANOSECONDS = 1e9


class Arrivals:
    """The ends of a device's motions."""

    def __init__(self, link: ServoLink, tell: Callable[[EventKind, int, str], None]) -> None:
        """Watch the cycles of *link*, and *tell* what becomes of motions."""
        self._link = link
        self._tell = tell
        self._gates: dict[int, ArrivalCondition] = {}
        self._settling: _Settling | None = None
        self._is_arriving = False
        self._number = 0
        self._next = 0
        self._settled: dict[int, float] = {}

    def expect(self, number: int, gate: ArrivalCondition) -> None:
        """Let motion *number* count as done by *gate*."""
        self._gates[number] = gate
        while len(self._gates) > _KEPT:
            del self._gates[min(self._gates)]

    def arrive(self, number: int, cycle: Cycle, *, is_followed: bool = False) -> None:
        """Take motion *number* as run to its end, at rest by *cycle*.

        Args:
            number: of the motion.
            cycle: at rest.
            is_followed: whether a queued motion begins there, for which the axes do not wait.
        """
        self.end("another motion has ended", EventKind.MOTION_PASSED)
        gate = self._gates.pop(number, None)
        self._number, self._next = number, cycle.index
        if gate is not None:
            self._settling = _Settling(gate, cycle.q, cycle.deadline_ns)
        elif cycle.flags & CycleFlag.ARRIVING and not is_followed:
            self._is_arriving = True
        else:
            self._tell(EventKind.MOTION_DONE, number, "")

    def look(self, fault_text: str) -> None:
        """Look at the cycles since the last look."""
        settling = self._settling
        if self._is_arriving:
            self._look_at_axes(fault_text)
        if settling is None:
            return
        for record in self._link.cycle_records(self._next, _BLOCK):
            cycle = unpack_cycle(record)
            self._next = cycle.index + 1
            if settling.look(cycle):
                self._conclude(settling)
                return
            if cycle.state is ServoState.FAULT:
                self.end(fault_text)
                return

    def _look_at_axes(self, fault_text: str) -> None:
        """Look whether the axes have arrived by the newest cycle."""
        cycle = self._link.newest()
        is_fault = cycle is not None and cycle.state is ServoState.FAULT
        if cycle is None or cycle.flags & CycleFlag.ARRIVING or (is_fault and not fault_text):
            return  # the reason for a fault of this very moment comes before the next look
        if cycle.state is ServoState.HOLDING:
            self._is_arriving = False
            self._tell(EventKind.MOTION_DONE, self._number, "")
        elif is_fault:
            self._is_arriving = False
            self._tell(EventKind.MOTION_STOPPED, self._number, fault_text)
        else:
            self.end("the device was disabled")

    def _conclude(self, settling: _Settling) -> None:
        self._settling = None
        if settling.settled_after is None:
            self._tell(EventKind.MOTION_UNSETTLED, self._number, str(settling))
            return
        self._settled = {self._number: settling.settled_after}
        self._tell(EventKind.ON_TARGET, self._number, str(settling))
        self._tell(EventKind.MOTION_DONE, self._number, str(settling))

    def end(self, text: str, kind: EventKind = EventKind.MOTION_STOPPED) -> None:
        """Wait no longer.

        Args:
            text: why.
            kind: how a motion has ended whose axes had not arrived yet.
        """
        if self._is_arriving:
            self._is_arriving = False
            self._tell(kind, self._number, f"{text} before its axes had arrived")
        if self._settling is not None:
            self._settling = None
            self._tell(EventKind.MOTION_UNSETTLED, self._number, text)

    def settled_after(self, number: int) -> float | None:
        """Return how long after its last setpoint motion *number* was on target, s, if it was."""
        return self._settled.get(number)


class _Settling:
    """Watch the cycles after a motion's last setpoint.

    Attributes:
        gate: what is waited for.
        error: angle between the target and what was reported last, rad; ``None`` without feedback.
        settled_after: s from the last setpoint to the moment when it had been on target for long
            enough; ``None`` before that.
    """

    def __init__(self, gate: ArrivalCondition, target: Quaternion, since_ns: int) -> None:
        """Wait to be at *target* according to *gate*; the last setpoint was sent at *since_ns*."""
        self.gate = gate
        self.error: float | None = None
        self.settled_after: float | None = None
        self._target = target
        self._since_ns = since_ns
        self._inside_ns: int | None = None
        self._measured_ns = 0

    def look(self, cycle: Cycle) -> bool:
        """Take the next cycle; return whether the wait is over, one way or the other."""
        gate = self.gate
        if cycle.has_feedback and cycle.feedback_time_ns > self._measured_ns:
            self._measured_ns = cycle.feedback_time_ns
            self.error = norm(difference(cycle.feedback_q, self._target))
            rate = norm(cycle.feedback_omega_body)
            if not (self.error <= gate.tolerance and rate <= gate.rate):
                self._inside_ns = None
            elif self._inside_ns is None:
                self._inside_ns = max(cycle.feedback_time_ns, self._since_ns)
        if self._inside_ns is not None:
            # The age of the newest feedback counts for nothing: only what was measured does.
            inside = (self._measured_ns - self._inside_ns) / NANOSECONDS
            if inside >= gate.settle_time:
                self.settled_after = (self._measured_ns - self._since_ns) / NANOSECONDS
                return True
        return (cycle.deadline_ns - self._since_ns) / NANOSECONDS > gate.timeout

    def __str__(self) -> str:
        """Say how it went."""
        if self.settled_after is not None:
            return f"on target {self.settled_after:.3f} s after the last setpoint"
        where = "nothing was measured" if self.error is None else f"{self.error:.3g} rad off"
        gate = self.gate
        return (
            f"not on target within {gate.timeout:g} s: {where}, asked for {gate.tolerance:g} rad "
            f"at {gate.rate:g} rad/s for {gate.settle_time:g} s"
        )
