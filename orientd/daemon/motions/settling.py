"""Whether a device has arrived: by what it reports, for as long as was asked."""

from __future__ import annotations

from orientd.daemon.motions.options import ArrivalCondition
from orientd.driver import Quaternion
from orientd.floats import difference, norm
from orientd.stream import Cycle

NANOSECONDS = 1e9


class Settling:
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
