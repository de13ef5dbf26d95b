"""When and how motions end.

A motion is done once its axes have arrived, or are measured to be on target.  The servo knows
whether they have arrived, see :mod:`orientd.servo.device_reports`; those of a device that does not
tell have arrived with the last setpoint.

A motion that is blended with the next one is left before its end.  It has passed its end where the
next one is nearest to that.  Until then a stop, a fault or a motion that replaces the next one
keeps the device from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

from orientd.daemon.device.event import EventKind
from orientd.daemon.device.queued_motion import ArrivalCondition, QueuedMotion
from orientd.daemon.device.servo_process import ServoProcess
from orientd.driver import Quaternion
from orientd.floats import difference, norm
from orientd.stream.records import Cycle, CycleFlag, ServoState, unpack_cycle

_BLOCK = 256

NANOSECONDS = 1e9

Tell = Callable[[EventKind, QueuedMotion, str], None]


class Endings:
    """The motions of a device that have been left or run to their ends, and have not ended yet."""

    def __init__(self, servo: ServoProcess, tell: Tell) -> None:
        """Watch the cycles of *servo*, and *tell* how motions end."""
        self._servo = servo
        self._tell = tell
        self._corners: list[tuple[QueuedMotion, QueuedMotion]] = []
        self._arriving: QueuedMotion | None = None
        self._settling: _Settling | None = None
        self._next = 0

    # Motions that the device has gone over from

    def leave(self, left: list[QueuedMotion], first: QueuedMotion, cycle: Cycle) -> None:
        """Report motions that the device has left, and whether it passed their ends.

        Args:
            left: those that the device has gone over from since the last call, in order.
            first: the motion that it has gone over to.
            cycle: where it is.
        """
        for queued, following in pairwise([*left, first]):
            if queued.is_replaced:
                self._tell(EventKind.MOTION_REPLACED, queued, "")
            elif following.motion.facts.corner is None:
                self._tell(EventKind.MOTION_DONE, queued, "")
            else:
                self._corners.append((queued, following))
        corners, self._corners = self._corners, []
        for queued, following in corners:
            self._look_at_corner(queued, following, cycle)

    def _look_at_corner(self, queued: QueuedMotion, following: QueuedMotion, cycle: Cycle) -> None:
        facts = following.motion.facts
        time, distance = facts.corner or (0.0, 0.0)
        is_left = cycle.motion != following.number
        record = cycle.path_index - (following.first_index or 0)
        if is_left:
            record = following.last_record
        if record * facts.period >= time:
            text = f"{math.degrees(distance):.3g} deg from its end"
            self._tell(EventKind.MOTION_PASSED, queued, text)
        elif is_left:
            text = f"after it was left for motion {following.number}, before its end"
            self._tell(EventKind.MOTION_REPLACED, queued, text)
        else:
            self._corners.append((queued, following))

    def come_to_rest(self, text: str, kind: EventKind = EventKind.MOTION_STOPPED) -> None:
        """Report motions whose ends the device will not pass, since it has come to rest.

        Args:
            text: why, if that is known here.
            kind: how they have ended.
        """
        corners, self._corners = self._corners, []
        for queued, following in corners:
            left = f"stopped after it was left for motion {following.number}, before its end"
            self._tell(kind, queued, f"{left}: {text}" if text else left)

    # Motions whose last setpoint was sent

    def arrive(self, queued: QueuedMotion, cycle: Cycle, *, is_followed: bool = False) -> None:
        """Take a motion as run to its end, at rest by *cycle*.

        Args:
            queued: the motion.
            cycle: at rest.
            is_followed: whether a queued motion begins there, for which the axes do not wait.
        """
        self.end("another motion has ended", EventKind.MOTION_PASSED)
        self._next = cycle.index
        if queued.options.gate is not None:
            self._settling = _Settling(queued, queued.options.gate, cycle.q, cycle.deadline_ns)
        elif cycle.flags & CycleFlag.ARRIVING and not is_followed:
            self._arriving = queued
        else:
            self._tell(EventKind.MOTION_DONE, queued, "")

    def look(self, fault_text: str) -> None:
        """Read the cycles since the last call.

        Args:
            fault_text: why the device is in a fault, if it is.
        """
        if self._arriving is not None:
            self._look_at_axes(self._arriving, fault_text)
        settling = self._settling
        if settling is None:
            return
        for record in self._servo.cycle_records(self._next, _BLOCK):
            cycle = unpack_cycle(record)
            self._next = cycle.index + 1
            if settling.look(cycle):
                self._settle(settling)
                return
            if cycle.state is ServoState.FAULT:
                self.end(fault_text)
                return

    def _look_at_axes(self, queued: QueuedMotion, fault_text: str) -> None:
        """Check whether the axes have arrived by the newest cycle."""
        cycle = self._servo.newest()
        is_fault = cycle is not None and cycle.state is ServoState.FAULT
        if cycle is None or cycle.flags & CycleFlag.ARRIVING or (is_fault and not fault_text):
            return  # the reason for a fault of this very moment comes before the next look
        if cycle.state is ServoState.HOLDING:
            self._arriving = None
            self._tell(EventKind.MOTION_DONE, queued, "")
        elif is_fault:
            self._arriving = None
            self._tell(EventKind.MOTION_STOPPED, queued, fault_text)
        else:
            self.end("the device was disabled")

    def _settle(self, settling: _Settling) -> None:
        self._settling = None
        queued, queued.settled_after = settling.queued, settling.settled_after
        if queued.settled_after is None:
            self._tell(EventKind.MOTION_UNSETTLED, queued, str(settling))
            return
        self._tell(EventKind.ON_TARGET, queued, str(settling))
        self._tell(EventKind.MOTION_DONE, queued, str(settling))

    def end(self, text: str, kind: EventKind = EventKind.MOTION_STOPPED) -> None:
        """Wait no longer for a motion to arrive.

        Args:
            text: why.
            kind: how a motion has ended whose axes had not arrived yet.
        """
        arriving, self._arriving = self._arriving, None
        settling, self._settling = self._settling, None
        if arriving is not None:
            self._tell(kind, arriving, f"{text} before its axes had arrived")
        if settling is not None:
            self._tell(EventKind.MOTION_UNSETTLED, settling.queued, text)


class _Settling:
    """Watch the cycles after a motion's last setpoint.

    Attributes:
        queued: the motion.
        gate: when it has arrived.
        error: angle between the target and what was reported last, rad; ``None`` without feedback.
        settled_after: s from the last setpoint to the moment when it had been on target for long
            enough; ``None`` before that.
    """

    def __init__(
        self, queued: QueuedMotion, gate: ArrivalCondition, target: Quaternion, since_ns: int
    ) -> None:
        """Wait to be at *target* according to *gate*; the last setpoint was sent at *since_ns*."""
        self.queued, self.gate = queued, gate
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
        """Report the outcome."""
        if self.settled_after is not None:
            return f"on target {self.settled_after:.3f} s after the last setpoint"
        where = "nothing was measured" if self.error is None else f"{self.error:.3g} rad off"
        gate = self.gate
        return (
            f"not on target within {gate.timeout:g} s: {where}, asked for {gate.tolerance:g} rad "
            f"at {gate.rate:g} rad/s for {gate.settle_time:g} s"
        )
