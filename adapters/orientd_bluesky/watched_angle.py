"""The angle of a device about one axis, followed over every cycle so that whole turns count."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orientd.errors import DaemonError, OrientdError, RequestError
from orientd.floats import conjugate, exp, multiply
from orientd.protocol.values import to_quaternion
from orientd.rotation import Floats, Quaternion
from orientd.stream.records import Cycle
from orientd_serving.served import Served, named

WATCH_HZ = 50.0
"""Batches of cycles a second from the daemon."""

_STEP_DEG = 120.0
"""Longest turn between two keyframes: half a turn would have no sense of rotation."""

_PATIENCE = 5.0
"""Longest wait for the first cycles, and for the last measurement of a recording, s."""

_RETRY = 0.5
"""Time until the next try to follow the device, if the daemon is lost, s."""


class Reading(NamedTuple):
    """The angle of a device, degrees.

    Attributes:
        setpoint: as sent.
        angle: as measured; the setpoint if nothing is measured.
        time: of the measurement, Unix time in s.
    """

    setpoint: float
    angle: float
    time: float


class WatchedAngle:
    """The angle of a device about one axis of its tool, degrees.

    It begins between -180 and 180 degrees and is 0 at *zero*.  A thread follows every cycle.
    """

    def __init__(self, served: Served, *, axis: str = "z", zero: Quaternion | None = None) -> None:
        """Start to follow.

        Args:
            served: the device.
            axis: axis of the tool: ``x``, ``y`` or ``z``.
            zero: orientation at angle 0; the identity by default.

        Raises:
            RequestError: *axis* is not the letter of an axis.
            DaemonError: the daemon reports no cycles.
        """
        if axis not in {"x", "y", "z"}:
            raise RequestError("axis", f"expected x, y or z, got {axis!r}")
        self._served, self._place = served, "xyz".index(axis)
        self._zero = (1.0, 0.0, 0.0, 0.0) if zero is None else (zero.w, zero.x, zero.y, zero.z)
        self._news, self._closed = threading.Condition(), threading.Event()
        self._angle, self._measured_at = 0.0, -math.inf
        self._recording: list[Sequence[float]] | None = None
        self._problem: OrientdError | None = DaemonError(f"none within {_PATIENCE:g} s")
        self._observer = served.robot.observe()
        self._period = 1.0 / served.report().rate_hz
        self._thread = threading.Thread(target=self._watch, name="orientd angle", daemon=True)
        self._thread.start()
        with self._news:
            self._news.wait_for(lambda: self._problem is None, _PATIENCE)
        self.newest()

    def close(self) -> None:
        """Stop following the device; the connection stays open."""
        self._closed.set()
        self._observer.close()
        self._thread.join()

    def newest(self) -> Reading:
        """Return the present angles.

        Raises:
            DaemonError: the daemon reports no cycles.
        """
        report = self._served.report()
        if self._problem is not None:
            raise DaemonError(f"no cycles of the device {report.name} arrive: {self._problem}")
        setpoint = angle = self.of(to_quaternion(report.cycle.q), self._angle)
        age = report.cycle_age
        if report.cycle.HasField("feedback_q"):
            angle = self.of(to_quaternion(report.cycle.feedback_q), setpoint)
            age = report.feedback_age
        return Reading(setpoint, angle, time.time() - age)

    def await_measurement(self) -> None:
        """Wait for a measurement of the place that the device has reached, but not for long.

        Raises:
            DaemonError: no daemon answers.
        """
        reached = 1e-9 * self._served.report().cycle.deadline_ns + self._period
        with self._news:
            self._news.wait_for(lambda: self._measured_at > reached, _PATIENCE)

    def clock_offset(self) -> float:
        """Return the offset from the daemon's monotonic clock to its time of day, s."""
        return 1e-9 * self._observer.configuration().offset_ns

    def record(self) -> None:
        """Keep every setpoint and measurement from now on, until :meth:`recorded`."""
        with self._news:
            self._recording = []

    def recorded(self, until: float) -> Floats:
        """Return the recording, and end it.

        Args:
            until: monotonic time, s; wait for a later measurement, but not for long.

        Returns:
            A row for each cycle, shape ``(n, 4)``: time and angle of the setpoint, time and angle
            of the newest measurement.  Times are s on the daemon's monotonic clock, angles degrees.
        """
        with self._news:
            self._news.wait_for(lambda: self._measured_at > until, _PATIENCE)
            recording, self._recording = self._recording or [], None
        return np.array(recording).reshape(-1, 4)

    def keyframes(self, start: float, end: float) -> list[Quaternion]:
        """Return orientations from one angle to another, none a half turn from the next."""
        count = max(1, math.ceil(abs(end - start) / _STEP_DEG))
        angles = [start + (end - start) * k / count for k in range(count + 1)]
        return [self._orientation(math.radians(angle)) for angle in angles]

    def vector(self, rate: float) -> list[float]:
        """Return an angular velocity about the axis as a vector in the body frame."""
        return [rate if place == self._place else 0.0 for place in range(3)]

    def of(self, q: Sequence[float], near: float) -> float:
        """Return the angle of an orientation ``(w, x, y, z)``, degrees, near another angle."""
        w, x, y, z = q
        w, *vector = multiply(conjugate(self._zero), (w, x, y, z))
        angle = math.degrees(2.0 * math.atan2(vector[self._place], w))
        return near + math.remainder(angle - near, 360.0)

    def _orientation(self, angle: float) -> Quaternion:
        x, y, z = self.vector(angle)
        return named(multiply(self._zero, exp((x, y, z))))

    def _watch(self) -> None:
        while not self._closed.is_set():
            try:
                sight = self._observer.sight(
                    self._served.name, rate_hz=WATCH_HZ, with_outline=False
                )
                for cycles, _ in sight:
                    with self._news:
                        for cycle in cycles:
                            self._take(cycle)
                        self._problem = None
                        self._news.notify_all()
            except OrientdError as error:
                self._problem = error
            self._closed.wait(_RETRY)

    def _take(self, cycle: Cycle) -> None:
        self._angle = turned = self.of(cycle.q, self._angle)
        # The setpoint is meant for the end of its cycle.
        due = self._measured_at = 1e-9 * cycle.deadline_ns + self._period
        if cycle.feedback_time_ns:
            self._measured_at = 1e-9 * cycle.feedback_time_ns
            turned = self.of(cycle.feedback_q, self._angle)
        if self._recording is not None:
            self._recording.append((due, self._angle, self._measured_at, turned))
