"""The controller's clock and cycle in our time: arrival of its packages, time to send."""

from __future__ import annotations

import contextlib
import socket
import struct
import time

from orientd.errors import LinkError
from orientd_ur.wire import RtdeClient

AIM = 0.25
"""Share of a cycle between the arrival of the controller's data and the deadline."""

_FREQUENCY = 25.0
"""Received packages per second; a divisor of every controller's rate."""

_SHARE = 16
_HALF_WINDOW_NS = 500_000_000
_LATE_NS = 20_000_000
_MANY = 25
_RECENT_NS = 100_000_000
_NEARLY = 0.95

# Python's socket module lacks this constant; it is the same on every relevant architecture.
_SO_TIMESTAMPNS = 35
_TIME = struct.Struct("@qq")
_SPACE = socket.CMSG_SPACE(_TIME.size)


class ControllerClock:
    """Convert the controller's timestamps to monotonic nanoseconds.

    The package with the shortest delay gives the best offset between the two clocks.  So the offset
    is the smallest one of the last half to whole second, and the extra delay of a package is the
    age of its contents.  Many late packages in a row mean that the controller's clock has stood
    still for a while. Their offset then becomes the new one.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Reset: the controller may have been frozen or restarted."""
        self._current = self._previous = 0
        self._window_ends_ns = -1
        self._late = 0
        self._least_late = 0
        self._last_ns = 0

    def measured_ns(self, timestamp: float, now_ns: int) -> int:
        """Return our time of *timestamp* (s, the controller's), which was just read.

        Never later than *now_ns*, never earlier than the last result.
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

    Once a cycle, a controller takes the last setpoint that came.  A setpoint sent close to that
    moment arrives sometimes before it and sometimes after.  Then two meet in one cycle, so that the
    first is lost, and the next cycle has none.  Clocks drift, so this happens sooner or later to
    every sender with its own clock.  So the deadlines shift slowly until they are a quarter of a
    cycle after the arrival of the controller's data, which it sends when it takes setpoints.
    Feedback is then fresh.  Setpoints may be late by almost three quarters of a cycle, and early by
    almost a quarter.

    Args:
        tick_ns: the controller's cycle.
        period_ns: ours; if it is no multiple of the controller's, there is no phase to keep.
    """

    def __init__(self, tick_ns: int, period_ns: int) -> None:
        self._tick_ns = tick_ns
        self._has_phase = period_ns % tick_ns == 0
        self._clock = ControllerClock()
        self._arrived_ns: int | None = None

    def hear(self, timestamp: float, arrived_ns: int) -> None:
        """Record a package.

        Args:
            timestamp: the controller's, s.
            arrived_ns: its arrival by our clock.  The packages with the shortest delay count.
        """
        self._arrived_ns = self._clock.measured_ns(timestamp, arrived_ns)

    def shift_ns(self, deadline_ns: int) -> int:
        """Return the shift for deadlines, given the one at *deadline_ns*.

        It is a sixteenth of the difference, in the shorter direction; 0 before the first package.
        """
        if self._arrived_ns is None or not self._has_phase:
            return 0
        tick_ns = self._tick_ns
        early_ns = round(self._arrived_ns + AIM * tick_ns) - deadline_ns
        early_ns = (early_ns + tick_ns // 2) % tick_ns - tick_ns // 2
        return round(early_ns / _SHARE)


class TickListener:
    """A connection that receives the controller's time, alive until :meth:`close`.

    The client library does not report arrival times.  So a separate connection receives only the
    timestamp, and the kernel records when each package arrived, independent of scheduling.

    Args:
        host: the robot's address.
        timeout: s for connecting and for each answer.

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
        """Return a new timestamp (s) and its arrival (ns, monotonic clock), if there is one.

        Never waits, never raises; without a connection there is nothing new.
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
        """Return the age of the newest package's arrival, by the kernel; ``None`` before any."""
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
        watchdog_hz: rate of messages that the robot requires.
    """

    def __init__(self, watchdog_hz: float) -> None:
        self._allowed_ns = round(1e9 / watchdog_hz)
        self._written_ns = self._pause_ns = self._ended_ns = 0

    def begin(self, now_ns: int) -> None:
        """Restart the measurement."""
        self._written_ns, self._pause_ns = now_ns, 0

    def note(self, now_ns: int) -> None:
        """Record that a setpoint is written now."""
        self._look(now_ns)
        self._written_ns = now_ns

    def reason(self, now_ns: int) -> str:
        """Return that the robot's watchdog has ended the program, if the pause was too long."""
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
