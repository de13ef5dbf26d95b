"""The angle of a device about one axis, followed over every cycle so that whole turns count."""

from __future__ import annotations

import bisect
import math
import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from orientd.errors import DaemonError, OrientdError, RequestError
from orientd.floats import conjugate, exp, multiply
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion
from orientd.rotation import Quaternion

if TYPE_CHECKING:
    from orientd.client import Robot
    from orientd.stream import Cycle

WATCH_HZ = 50.0
"""Batches of cycles a second from the daemon."""

_STEP_DEG = 120.0
"""Longest turn between two keyframes: half a turn would have no sense of rotation."""

_FIRST, _LAST = 5.0, 0.5
"""Longest wait for the first cycles, and for the last measurement of a recording, s."""


class Reading(NamedTuple):
    """The angle of a device, degrees.

    Attributes:
        setpoint: as sent.
        angle: as measured; the setpoint if nothing is measured.
        time: of the measurement, s since the epoch.
    """

    setpoint: float
    angle: float
    time: float


class Sample(NamedTuple):
    """An angle at a time: seconds on the daemon's monotonic clock, and degrees."""

    time: float
    angle: float


Pair = tuple[Sample, Sample]
"""A setpoint with the time that it is meant for, and the newest measurement in its cycle."""


class WatchedAngle:
    """The angle of a device about one axis of its tool, degrees.

    It begins between -180 and 180 degrees and is 0 at *zero*.  A thread follows every cycle.
    """

    def __init__(
        self, robot: Robot, *, device: str = "", axis: str = "z", zero: Quaternion | None = None
    ) -> None:
        """Start to follow.

        Args:
            robot: a connection to the daemon.
            device: name of the device; optional if there is only one.
            axis: axis of the tool: ``x``, ``y`` or ``z``.
            zero: orientation at angle 0; the identity by default.

        Raises:
            RequestError: *axis* is not the letter of an axis, or the device does not exist.
            DaemonError: the daemon reports no cycles.
        """
        if axis not in {"x", "y", "z"}:
            raise RequestError("axis", f"expected x, y or z, got {axis!r}")
        self._robot, self._device, self._place = robot, device, "xyz".index(axis)
        self._zero = (1.0, 0.0, 0.0, 0.0) if zero is None else (zero.w, zero.x, zero.y, zero.z)
        self._news = threading.Condition()
        self._newest: Pair | None = None
        self._recording: list[Pair] | None = None
        self._problem: OrientdError | None = None
        self._observer = robot.observe()
        report = self.report()
        self._device, self._period = report.name, 1.0 / report.rate_hz
        self._thread = threading.Thread(target=self._watch, name="orientd angle", daemon=True)
        self._thread.start()
        self.newest()

    def close(self) -> None:
        """Stop following the device; the connection stays open."""
        self._observer.close()
        self._thread.join()

    def report(self) -> pb.DeviceReport:
        """Return the present state of the device.

        Raises:
            RequestError: the daemon has no device of that name, or several and none was named.
        """
        devices = self._robot.state().devices
        name = self._device or (next(iter(devices)) if len(devices) == 1 else "")
        if name not in devices:
            expected = f"expected one of {', '.join(devices)}"
            raise RequestError("device", f"{expected}, got {self._device!r}")
        return devices[name]

    def newest(self) -> Reading:
        """Return the present angles.

        Raises:
            DaemonError: the daemon reports no cycles.
        """
        report = self.report()
        with self._news:
            self._news.wait_for(lambda: self._newest or self._problem, _FIRST)
            if self._newest is None or self._problem:
                why = f": {self._problem}" if self._problem else f" within {_FIRST:g} s"
                raise DaemonError(f"no cycles of the device {self._device} arrived{why}")
            near = self._newest[0].angle
        setpoint = angle = self.of(to_quaternion(report.cycle.q), near)
        age = report.cycle_age
        if report.cycle.HasField("feedback_q"):
            angle = self.of(to_quaternion(report.cycle.feedback_q), setpoint)
            age = report.feedback_age
        return Reading(setpoint, angle, time.time() - age)

    def clock_offset(self) -> float:
        """Return the offset from the daemon's monotonic clock to its time of day, s."""
        return 1e-9 * self._observer.configuration().offset_ns

    def record(self) -> None:
        """Keep every setpoint and measurement from now on, until :meth:`recorded`."""
        with self._news:
            self._recording = []

    def recorded(self, until: float) -> list[Pair]:
        """Return what was recorded, and end the recording.

        Args:
            until: monotonic time, s; wait for a later measurement, but not for long.
        """
        with self._news:
            self._news.wait_for(lambda: self._newest and self._newest[1].time > until, _LAST)
            recording, self._recording = self._recording or [], None
        return recording

    def keyframes(self, start: float, end: float) -> list[Quaternion]:
        """Return orientations from one angle to another, none a half turn from the next."""
        count = max(1, math.ceil(abs(end - start) / _STEP_DEG))
        angles = [start + (end - start) * k / count for k in range(count + 1)]
        return [self._orientation(math.radians(angle)) for angle in angles]

    def vector(self, rate: float) -> list[float]:
        """Return an angular velocity about the axis as a vector in the body frame."""
        return [rate if place == self._place else 0.0 for place in range(3)]

    def _orientation(self, angle: float) -> Quaternion:
        x, y, z = self.vector(angle)
        w, x, y, z = multiply(self._zero, exp((x, y, z)))
        return Quaternion(w=w, x=x, y=y, z=z)

    def of(self, q: Sequence[float], near: float) -> float:
        """Return the angle of an orientation ``(w, x, y, z)``, degrees, near another angle."""
        w, x, y, z = q
        w, *vector = multiply(conjugate(self._zero), (w, x, y, z))
        angle = math.degrees(2.0 * math.atan2(vector[self._place], w))
        return near + math.remainder(angle - near, 360.0)

    def _watch(self) -> None:
        try:
            sight = self._observer.sight(self._device, rate_hz=WATCH_HZ, with_outline=False)
            for cycles, _ in sight:
                with self._news:
                    for cycle in cycles:
                        self._take(cycle)
                    self._news.notify_all()
        except OrientdError as error:
            with self._news:
                self._problem = error
                self._news.notify_all()

    def _take(self, cycle: Cycle) -> None:
        near = 0.0 if self._newest is None else self._newest[0].angle
        angle = self.of(cycle.q, near)
        # The setpoint is meant for the end of its cycle.
        setpoint = measured = Sample(1e-9 * cycle.deadline_ns + self._period, angle)
        if cycle.feedback_time_ns:
            turned = self.of(cycle.feedback_q, angle)
            measured = Sample(1e-9 * cycle.feedback_time_ns, turned)
        self._newest = setpoint, measured
        if self._recording is not None:
            self._recording.append(self._newest)


def interpolated(samples: Sequence[Sample], at: float) -> float | None:
    """Return the angle at a time; ``None`` outside of the samples."""
    index = bisect.bisect_left(samples, at, key=lambda sample: sample.time)
    if index == 0 or index == len(samples):
        return None
    a, b = samples[index - 1], samples[index]
    return a.angle + (b.angle - a.angle) * (at - a.time) / (b.time - a.time)
