"""When motions count as done: at the last setpoint, or once measured to be on target."""

from __future__ import annotations

from collections.abc import Callable

from orientd.daemon.devices import EventKind, ServoLink
from orientd.daemon.motions.options import ArrivalCondition
from orientd.driver import Quaternion
from orientd.floats import difference, norm
from orientd.stream import Cycle, ServoState, unpack_cycle

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
        self._number = 0
        self._next = 0
        self._settled: dict[int, float] = {}

    def expect(self, number: int, gate: ArrivalCondition) -> None:
        """Let motion *number* count as done by *gate*."""
        self._gates[number] = gate
        while len(self._gates) > _KEPT:
            del self._gates[min(self._gates)]

    def arrive(self, number: int, cycle: Cycle) -> None:
        """Take motion *number* as run to its end, at rest by *cycle*."""
        self.end("another motion has ended")
        gate = self._gates.pop(number, None)
        if gate is None:
            self._tell(EventKind.MOTION_DONE, number, "")
            return
        self._settling = _Settling(gate, cycle.q, cycle.deadline_ns)
        self._number, self._next = number, cycle.index

    def look(self, fault_text: str) -> None:
        """Look at the cycles since the last look."""
        settling = self._settling
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

    def _conclude(self, settling: _Settling) -> None:
        self._settling = None
        if settling.settled_after is None:
            self._tell(EventKind.MOTION_UNSETTLED, self._number, str(settling))
            return
        self._settled = {self._number: settling.settled_after}
        self._tell(EventKind.ON_TARGET, self._number, str(settling))
        self._tell(EventKind.MOTION_DONE, self._number, str(settling))

    def end(self, text: str) -> None:
        """Wait no longer; *text* says why."""
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
