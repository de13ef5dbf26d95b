"""An axis of rotation for bluesky, in degrees: it moves, scans, and flies at a constant rate.

The device implements bluesky's protocols ``Readable``, ``Locatable``, ``Stoppable``,
``Preparable``, ``Flyable`` and ``EventCollectable`` without importing bluesky.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Self

import numpy as np

from orientd.client.move_handle import MoveHandle
from orientd.client.robot import Robot
from orientd.errors import OrientdError, RequestError, StateError
from orientd.protocol import control_pb2 as pb
from orientd.rotation import Floats, Quaternion
from orientd_bluesky.values import FlyScan, MotionStatus
from orientd_bluesky.watched_angle import WatchedAngle
from orientd_serving.served import Served

_THERE_DEG = 1e-5
"""Distance at which the device is at an angle already, degrees."""

_SAMPLES_HZ = 10.0
"""Rate of the samples of a plan, of which only the last one is read."""

_ARM = 0.25
"""Time between the plan of a fly scan and its start, s."""


class RotationAxis:
    """A device that turns about one axis, for bluesky's plans.

    The angle counts whole turns.  It begins between -180 and 180 degrees, and is 0 at *zero*.

    Attributes:
        name: name of the axis; its angle and setpoint in documents are ``NAME`` and
            ``NAME_setpoint``.
        parent: always ``None``.
        velocity_deg: largest rate of moves, degrees/s; ``None`` for the limit of the device.
        trigger_times: when the present fly scan passes each of its points, Unix time in s.
    """

    parent = None

    def __init__(
        self,
        robot: Robot,
        *,
        name: str,
        device: str = "",
        axis: str = "z",
        zero: Quaternion | None = None,
        velocity_deg: float | None = None,
    ) -> None:
        """Start to watch the device.

        Args:
            robot: a connection to the daemon.
            name: name of the axis in documents.
            device: name of the device; optional if there is only one.
            axis: axis of the tool to turn about: ``x``, ``y`` or ``z``.
            zero: orientation at angle 0; the identity by default.
            velocity_deg: largest rate of moves, degrees/s.

        Raises:
            RequestError: *axis* is not a letter of an axis.
            OrientdError: the daemon has no such device.
        """
        self.name, self.velocity_deg = name, velocity_deg
        self.trigger_times: list[float] = []
        self._served = Served(robot, device)
        self._angle = WatchedAngle(self._served, axis=axis, zero=zero)
        self._source = f"orientd:{self._served.name}/{axis}"
        self._running: tuple[MoveHandle, MotionStatus] | None = None
        self._scan: FlyScan | None = None
        self._flight: MotionStatus | None = None
        self._flown: Floats = np.empty((0, 4))
        self._offset = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop watching the device; the connection stays open."""
        self._angle.close()

    # Readable, Locatable

    @property
    def hints(self) -> dict[str, Any]:
        """The field that plots show."""
        return {"fields": [self.name]}

    @property
    def position(self) -> float:
        """The measured angle, degrees."""
        return self._angle.newest().angle

    def read(self) -> dict[str, dict[str, Any]]:
        """Return the measured angle and the setpoint, degrees."""
        setpoint, angle, measured_at = self._angle.newest()
        return {
            self.name: {"value": angle, "timestamp": measured_at},
            f"{self.name}_setpoint": {"value": setpoint, "timestamp": time.time()},
        }

    def describe(self) -> dict[str, dict[str, Any]]:
        """Describe what :meth:`read` returns."""
        key = {"dtype": "number", "shape": [], "units": "deg", "precision": 4}
        return {
            self.name: {"source": self._source, **key},
            f"{self.name}_setpoint": {"source": f"{self._source}/setpoint", **key},
        }

    def read_configuration(self) -> dict[str, dict[str, Any]]:
        """Return the largest rate of moves, degrees/s; the device's own without another one."""
        velocity = self.velocity_deg or math.degrees(self._served.report().limits.velocity)
        return {f"{self.name}_velocity": {"value": velocity, "timestamp": time.time()}}

    def describe_configuration(self) -> dict[str, dict[str, Any]]:
        """Describe what :meth:`read_configuration` returns."""
        key = {"dtype": "number", "shape": [], "units": "deg/s"}
        return {f"{self.name}_velocity": {"source": f"{self._source}/velocity", **key}}

    def locate(self) -> dict[str, float]:
        """Return the setpoint and the measured angle, degrees."""
        newest = self._angle.newest()
        return {"setpoint": newest.setpoint, "readback": newest.angle}

    # Movable, Stoppable

    def set(self, value: float) -> MotionStatus:
        """Start to turn to an angle, and return its status.

        Args:
            value: degrees; whole turns count.

        Raises:
            RequestError: it is not a number.
            OrientdError: the motion is refused, for example since a limit is in the way.
        """
        try:
            target = float(value)
        except (TypeError, ValueError):
            target = math.nan
        if not math.isfinite(target):
            raise RequestError("value", f"expected an angle in degrees, got {value!r}")
        limits = {} if self.velocity_deg is None else {"velocity": math.radians(self.velocity_deg)}
        start = self._angle.newest().setpoint
        keyframes = self._angle.keyframes(start, target)
        is_at_rest = self._served.report().state == pb.STATE_HOLDING
        if abs(target - start) < (_THERE_DEG if is_at_rest else 180.0):
            # It is there, or moves: a path from where it was would turn back first.
            keyframes = keyframes[-1:]
        handle = self._served.move(keyframes, approach=True, limits=limits, name=f"{self.name} set")

        def end(is_done: bool) -> OrientdError | None:
            reached = self._angle.newest().setpoint
            if not is_done or abs(reached - target) < 180.0:
                return None
            return StateError(
                f"{self.name} turned to {reached:.4g} deg instead of {target:.4g} deg, since an "
                "axis of the device ends in between"
            )

        return self._follow(handle, end)

    def stop(self, *, success: bool = False) -> None:
        """Stop on the path; returns at once.

        Args:
            success: whether the interrupted action then counts as successful.
        """
        if self._running is not None:
            handle, status = self._running
            status.is_stop_success = success
            handle.cancel()

    # Preparable, Flyable, EventCollectable

    def prepare(self, value: FlyScan) -> MotionStatus:
        """Move to where the run-up of a fly scan begins, and return the status of that move.

        The run-up is as long as the run-out, which the planner knows.

        Raises:
            RequestError: *value* is not a :class:`FlyScan`.
            OrientdError: the scan is refused, for example since it would break a limit.
        """
        if not isinstance(value, FlyScan):
            raise RequestError("prepare", f"expected a FlyScan, got {value!r}")
        plan = self._plan(value)
        last = self._angle.of(plan.samples.q[-4:], near=value.stop_deg)
        status = self.set(value.start_deg - (last - value.stop_deg))
        self._scan = value
        return status

    def kickoff(self) -> MotionStatus:
        """Start the prepared fly scan: the run-up, the turn at a constant rate, the run-out.

        Raises:
            StateError: no scan is prepared, or the device does not run at full speed.
            OrientdError: the motion is refused.
        """
        scan, speed = self._scan, self._served.report().speed
        if scan is None:
            raise StateError(f"{self.name} has no fly scan; prepare one before kickoff")
        if speed != 1.0:
            raise StateError(f"the speed of the device is {speed:g}; a fly scan needs speed 1")
        plan = self._plan(scan)
        self._offset = self._angle.clock_offset()
        self._angle.record()
        start = time.time() + _ARM
        handle = self._served.move(plan, start_time=start)
        first = start + plan.start_time
        self.trigger_times = [first + k * scan.time_per_point for k in range(scan.points)]
        self._scan = None
        self._flight = self._follow(handle, self._keep)
        return MotionStatus().finish()

    def complete(self) -> MotionStatus:
        """Return the status of the fly scan.

        Raises:
            StateError: no fly scan was started.
        """
        if self._flight is None:
            raise StateError(f"{self.name} has no fly scan; kickoff starts one")
        return self._flight

    def describe_collect(self) -> dict[str, dict[str, dict[str, Any]]]:
        """Describe what :meth:`collect` yields, for the stream ``primary``."""
        return {"primary": self.describe()}

    def collect(self) -> Iterator[dict[str, Any]]:
        """Yield an event for each point that was passed, with the angles at its trigger time."""
        due, setpoints, measured_at, angles = self._flown.T
        end = min(due[-1], measured_at[-1]) if len(due) else -math.inf
        for at in self.trigger_times:
            when = at - self._offset
            if when > end:
                return
            angle, setpoint = np.interp(when, measured_at, angles), np.interp(when, due, setpoints)
            data = {self.name: float(angle), f"{self.name}_setpoint": float(setpoint)}
            yield {"time": at, "data": data, "timestamps": dict.fromkeys(data, at)}

    def _plan(self, scan: FlyScan) -> pb.Plan:
        """Return the plan of a fly scan from the current state of the device."""
        keyframes = self._angle.keyframes(scan.start_deg, scan.stop_deg)
        share = scan.duration / (len(keyframes) - 1)
        velocity = self._angle.vector(scan.rate)
        return self._served.robot.plan(
            keyframes,
            device=self._served.name,
            times=[share * k for k in range(len(keyframes))],
            start_velocity=velocity,
            end_velocity=velocity,
            approach=True,
            sample_rate_hz=_SAMPLES_HZ,
            name=f"{self.name} fly",
        )

    def _follow(
        self, handle: MoveHandle, end: Callable[[bool], OrientdError | None]
    ) -> MotionStatus:
        """Return the status of a motion; *end* is called at its end, and may find a problem.

        Its argument is whether the motion has run to its end.
        """
        status = MotionStatus()
        self._running = handle, status

        def wait() -> None:
            try:
                summary = handle.wait(check=False)
                self._angle.await_measurement()  # plans read the angle at once
                is_done = summary.outcome == pb.OUTCOME_DONE
                problem = end(is_done)
                is_excused = summary.outcome == pb.OUTCOME_STOPPED and status.is_stop_success
                if not is_done and not is_excused:
                    outcome = pb.Outcome.Name(summary.outcome).removeprefix("OUTCOME_").lower()
                    problem = StateError(f"the motion of {self.name} was {outcome}: {summary.text}")
            except OrientdError as error:
                problem = error
            status.finish(problem)

        threading.Thread(target=wait, name="orientd bluesky", daemon=True).start()
        return status

    def _keep(self, is_done: bool) -> None:
        """Keep the angles of a fly scan, up to its end or to where it was stopped."""
        last = self.trigger_times[-1] if is_done else self._offset
        flown = self._angle.recorded(until=last - self._offset)
        if not is_done:  # at rest it passes no further point
            turning = np.flatnonzero(np.diff(flown[:, 1]))
            flown = flown[: turning[-1] + 2] if len(turning) else flown[:0]
        self._flown = flown
