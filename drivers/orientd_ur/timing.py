"""The controller's clock and cycle in terms of ours: when its packages come, when to send."""

from __future__ import annotations

import contextlib
import socket
import struct
import time

from orientd.errors import LinkError
from orientd_ur.wire import RtdeClient

AIM = 0.25
"""Share of a cycle from the arrival of the controller's data to the deadline."""

_FREQUENCY = 25.0
"""Packages a second that are listened to; a divisor of every controller's rate."""

_SHARE = 16
_HALF_WINDOW_NS = 500_000_000
_LATE_NS = 20_000_000
_MANY = 25
_RECENT_NS = 100_000_000
_NEARLY = 0.95

# Not named by Python's socket module; the same on every architecture that robots are driven from.
_SO_TIMESTAMPNS = 35
_TIME = struct.Struct("@qq")
_SPACE = socket.CMSG_SPACE(_TIME.size)


class ControllerClock:
    """Translate the controller's timestamps into monotonic nanoseconds.

    A package that took the least time on its way tells the offset between the two clocks best, so
    the offset is the smallest seen in the last half to whole second.  What a package was late
    beyond that is the age of its contents.  Late ones in a row, and many of them, mean that the
    controller's clock has stood still for a while: then the offset is theirs.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything; the controller may have been frozen or started again."""
        self._current = self._previous = 0
        self._window_ends_ns = -1
        self._late = 0
        self._least_late = 0
        self._last_ns = 0

    def measured_ns(self, timestamp: float, now_ns: int) -> int:
        """Return when *timestamp* (s, the controller's) was, given that it was just read.

        Never later than *now_ns*, never earlier than the last answer.
        """
        stamp_ns = round(timestamp * 1e9)
        offset = now_ns - stamp_ns
        if self._window_ends_ns < 0:
            self._current = self._previous = offset
            self._window_ends_ns = now_ns + _HALF_WINDOW_NS
        elif now_ns >= self._window_ends_ns:
            self._previous, self._current = self._current, offset
            self._window_ends_ns = now_ns + _HALF_WINDOW_NS
        else:
            self._current = min(self._current, offset)
        least = min(self._current, self._previous)
        if offset - least > _LATE_NS:
            self._least_late = min(self._least_late, offset) if self._late else offset
            self._late += 1
            if self._late == _MANY:
                self._current = self._previous = least = self._least_late
                self._late = 0
        else:
            self._late = 0
        measured = stamp_ns + least
        self._last_ns = max(self._last_ns, min(measured, now_ns))
        return self._last_ns


class TickPhase:
    """The phase of the controller's cycle, and how to keep to it.

    A controller takes, once a cycle, the setpoint that came last.  One that is sent close to that
    moment comes now before it, now after: then two meet in one cycle and the first is lost, and the
    next cycle has none.  Clocks drift, so that sooner or later this happens to whoever keeps to its
    own clock.  So the deadlines are moved, slowly, until they are a quarter of a cycle behind the
    arrival of the controller's data, which it sends as it takes setpoints: feedback is fresh then,
    setpoints may be late by almost three quarters of a cycle, and early by most of a quarter.

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


class TickListener:
    """A connection that is told the controller's time, alive until :meth:`close`.

    The client library says what came, not when.  So a connection of our own asks for nothing but
    the timestamp, and the kernel writes down when each package came in, whatever the scheduling.

    Args:
        host: the robot's address.
        timeout: s that connecting and each answer may take.

    Raises:
        LinkError: the robot does not answer.
    """

    def __init__(self, host: str, *, timeout: float = 2.0) -> None:
        self._client = RtdeClient(host, timeout)
        try:
            self._client.sock.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
            self._client.subscribe(_FREQUENCY, ["timestamp"])
            self._client.sock.setblocking(False)
        except (LinkError, OSError) as error:
            self.close()
            raise LinkError(f"{host} does not tell its time: {error}") from error
        self._is_deaf = False
        self._arrived_ns: int | None = None

    def heard(self) -> tuple[float, int] | None:
        """Return a new timestamp (s) and when it arrived (ns, monotonic clock), if there is one.

        Never waits, never raises: once the connection is gone there is nothing new.
        """
        if self._is_deaf:
            return None
        try:
            chunk, notes, _, _ = self._client.sock.recvmsg(4096, _SPACE)
            samples = self._client.samples_in(chunk)
        except BlockingIOError:
            return None
        except (OSError, ValueError):
            self._is_deaf = True
            return None
        arrived = [_TIME.unpack(note) for _, kind, note in notes if kind == _SO_TIMESTAMPNS]
        self._is_deaf = not chunk
        if not samples or not arrived:
            return None
        seconds, nanoseconds = arrived[0]
        age_ns = time.time_ns() - (seconds * 1_000_000_000 + nanoseconds)
        self._arrived_ns = time.monotonic_ns() - age_ns
        return samples[-1]["timestamp"][0], self._arrived_ns

    def silence_ns(self) -> int | None:
        """Return how long ago the newest package arrived, by the kernel; ``None`` before any."""
        while self.heard() is not None:
            continue
        return None if self._arrived_ns is None else time.monotonic_ns() - self._arrived_ns

    def close(self) -> None:
        """Close the connection."""
        with contextlib.suppress(OSError):
            self._client.sock.close()


class WriteSilence:
    """The last long pause between two setpoints.

    Args:
        watchdog_hz: how often the robot is to hear.
    """

    def __init__(self, watchdog_hz: float) -> None:
        self._allowed_ns = round(1e9 / watchdog_hz)
        self._written_ns = self._pause_ns = self._ended_ns = 0

    def begin(self, now_ns: int) -> None:
        """Count from now."""
        self._written_ns, self._pause_ns = now_ns, 0

    def note(self, now_ns: int) -> None:
        """Note that a setpoint is written now."""
        self._look(now_ns)
        self._written_ns = now_ns

    def reason(self, now_ns: int) -> str:
        """Return that the robot's watchdog has ended the program, where it has reason to."""
        self._look(now_ns)
        if not self._pause_ns or now_ns - self._ended_ns > _RECENT_NS:
            return ""
        return (
            f"the robot's watchdog ended the control program: nothing was written for "
            f"{self._pause_ns * 1e-6:.0f} ms, {self._allowed_ns * 1e-6:.0f} ms are allowed "
            "(`watchdog_hz`); this machine was too busy, or the process stood still; reset to "
            "start the program again"
        )

    def _look(self, now_ns: int) -> None:
        pause_ns = now_ns - self._written_ns
        if pause_ns > _NEARLY * self._allowed_ns:
            self._pause_ns, self._ended_ns = pause_ns, now_ns
