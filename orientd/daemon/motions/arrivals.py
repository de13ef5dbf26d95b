"""When motions count as done: at the last setpoint, or once measured to be on target."""

from __future__ import annotations

from collections.abc import Callable

from orientd.daemon.devices import EventKind, ServoLink
from orientd.daemon.motions.options import ArrivalCondition
from orientd.daemon.motions.settling import Settling
from orientd.stream import Cycle, ServoState, unpack_cycle

_BLOCK = 256
_KEPT = 16


class Arrivals:
    """The ends of a device's motions."""

    def __init__(self, link: ServoLink, tell: Callable[[EventKind, int, str], None]) -> None:
        """Watch the cycles of *link*, and *tell* what becomes of motions."""
        self._link = link
        self._tell = tell
        self._gates: dict[int, ArrivalCondition] = {}
        self._settling: Settling | None = None
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
        self._settling = Settling(gate, cycle.q, cycle.deadline_ns)
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

    def _conclude(self, settling: Settling) -> None:
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
