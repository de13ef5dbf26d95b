"""Teach-in: poses of a device that is moved by hand become the keyframes of a motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from orientd import motion_file
from orientd.errors import FeedbackError, RequestError, StateError
from orientd.model.request import Keyframe, MotionRequest
from orientd.protocol import control_pb2 as pb
from orientd.protocol.values import to_quaternion, to_vector
from orientd.stream.records import UNKNOWN
from orientd.structured_text import write_structured

if TYPE_CHECKING:
    from typing import Self

    from orientd.client.robot import Robot
    from orientd.driver import Quaternion, Vector3

OLDEST_FEEDBACK = 0.5
"""Largest age of feedback for a pose of a moving device, s."""

_NANO = 1e-9


@dataclass(frozen=True, slots=True)
class MeasuredPose:
    """The pose of a device.

    Attributes:
        q: measured orientation ``(w, x, y, z)``, tool to world.
        position: of the tool in the world, m.
        time_ns: time of the measurement, monotonic clock of the daemon.
        age: its age, s.
    """

    q: Quaternion
    position: Vector3
    time_ns: int
    age: float


class Teaching:
    """A device that is moved by hand, and the keyframes recorded so far.

    Created by :meth:`orientd.client.robot.Robot.teach`.  At the end of a ``with`` block the device
    holds its pose, and follows setpoints again if it did before.

    Attributes:
        device: its name.
        keyframes: recorded keyframes, with times from the first one on, s.
    """

    def __init__(self, robot: Robot, device: str, *, by_hand: bool) -> None:
        """Let the device be moved by hand, unless another client moves it."""
        reports = robot.state().devices
        self.device = device or (next(iter(reports)) if len(reports) == 1 else "")
        if self.device not in reports:
            raise RequestError("device", f"expected one of {', '.join(reports)}, got {device!r}")
        self.keyframes: list[Keyframe] = []
        self._robot = robot
        self._first_ns = UNKNOWN
        self._is_freed = by_hand
        self._was_enabled = False
        if by_hand:
            self._was_enabled = reports[self.device].state == pb.STATE_HOLDING
            try:
                robot.disable(self.device, by_hand=True)
            except BaseException:
                self.close()
                raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def pose(self) -> MeasuredPose:
        """Return the current pose of the device.

        Raises:
            FeedbackError: it does not report its pose, or has not for half a second.
            DaemonError: the daemon is lost.
        """
        report = self._robot.state().devices[self.device]
        cycle = report.cycle
        if not cycle.HasField("feedback_q"):
            raise FeedbackError(f"{self.device} does not say where it is")
        age = cycle.feedback_age_ns * _NANO
        if age > OLDEST_FEEDBACK:
            raise FeedbackError(f"{self.device} has not said where it is for {age:.1f} s")
        return MeasuredPose(
            to_quaternion(cycle.feedback_q),
            to_vector(cycle.feedback_position),
            cycle.deadline_ns - cycle.feedback_age_ns,
            age,
        )

    def take(self, name: str = "") -> Keyframe:
        """Record the current pose as a keyframe, with the time since the first one, and return it.

        Args:
            name: label of the keyframe.

        Raises:
            FeedbackError: as for :meth:`pose`.
            StateError: there is no new measurement since the last keyframe.
        """
        here = self.pose()
        if not self.keyframes:
            self._first_ns = here.time_ns
        time = (here.time_ns - self._first_ns) * _NANO
        last = self.keyframes[-1].time if self.keyframes else -math.inf
        if last is not None and not time > last:
            raise StateError("nothing was measured since the last keyframe")
        keyframe = Keyframe(here.q, time, here.position, name=name)
        self.keyframes.append(keyframe)
        return keyframe

    def remove(self) -> Keyframe | None:
        """Remove the last keyframe and return it; ``None`` if there is none."""
        return self.keyframes.pop() if self.keyframes else None

    def name(self, name: str) -> None:
        """Name the last keyframe, if there is one."""
        if self.keyframes:
            self.keyframes[-1] = replace(self.keyframes[-1], name=name)

    def request(self, name: str = "") -> MotionRequest:
        """Return the motion through the recorded keyframes, with a lead-in.

        Positions are left out if the device has none.

        Args:
            name: label of the motion.

        Raises:
            RequestError: no keyframe was recorded, or a name is not valid.
        """
        has_position = any(any(one.position or ()) for one in self.keyframes)
        # A removed first keyframe leaves the times to begin later.
        first = self.keyframes[0].time or 0.0 if self.keyframes else 0.0
        is_single = len(self.keyframes) == 1
        keyframes = [
            replace(
                one,
                time=None if is_single else (one.time or 0.0) - first,
                position=one.position if has_position else None,
            )
            for one in self.keyframes
        ]
        return MotionRequest(keyframes, approach=True, name=name)

    def save(self, path: str | Path, name: str = "") -> MotionRequest:
        """Write a motion file, YAML or JSON by its suffix, and return its content.

        Raises:
            RequestError: no keyframe was recorded, or a name is not valid.
            OrientdError: the file cannot be written.
        """
        request = self.request(name)
        write_structured(Path(path), motion_file.written(request))
        return request

    def close(self) -> None:
        """Make the device hold its pose, and follow setpoints again if it did before."""
        if not self._is_freed:
            return
        self._is_freed = False
        if self._was_enabled:
            self._robot.enable(self.device)
        else:
            self._robot.disable(self.device)
