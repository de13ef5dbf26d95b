"""A motion that somebody has put on the page: read, planned and shown before it is sent."""

from __future__ import annotations

import threading
from typing import Any

from orientd import motion_file
from orientd.client import MoveHandle, Robot
from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.protocol import samples
from orientd.viewer import words
from orientd.viewer.watcher import sample_rate

_OUTCOMES = {
    pb.OUTCOME_STOPPED: "was stopped on its path",
    pb.OUTCOME_FAULT: "was ended by a fault",
    pb.OUTCOME_REPLACED: "was replaced by another one",
    pb.OUTCOME_PASSED: "was blended into the next one",
    pb.OUTCOME_UNSETTLED: "was sent to its end, but the device is not where it should be",
}


class Proposal:
    """At most one motion, and how the last one that was sent went.

    Attributes:
        lines: what there is to say of it.
        plan: of the motion, with samples; ``None`` if there is nothing to send.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._handle: MoveHandle | None = None
        self.lines: list[words.Line] = []
        self.plan: pb.Plan | None = None

    def read(self, name: str, content: bytes, robot: Robot, device: str, device_hz: float) -> None:
        """Plan the motion file *content* called *name*, or say in its place what is wrong."""
        with self._lock:
            self.plan = None
            try:
                request = motion_file.loads(content, name)
                planned = robot.plan(request, device=device)
                rate_hz = sample_rate(planned.duration, device_hz)
                self.plan = robot.planned(planned.motion_id, device=device, sample_rate_hz=rate_hz)
            except OrientdError as error:
                self.lines = [("alert", "✕ Refused", str(error))]
                return
            count = len(request.keyframes)
            title = f"{name}: {count} keyframes, shown as +1, +2 and so on. Not sent yet."
            self.lines = [("note", title, ""), *words.certificate(planned.certificate)]

    def send(self, robot: Robot, device: str) -> None:
        """Start the motion.

        Raises:
            OrientdError: it was refused; it stays there to be looked at.
        """
        with self._lock:
            if self.plan is None:
                return
            self._handle = handle = robot.move(self.plan, device=device)
            self.plan = None
            self.lines = [("note", f"Motion {handle.motion_number} has been sent.", "")]

    def discard(self) -> None:
        """Forget the motion."""
        with self._lock:
            self.plan, self.lines = None, []

    def look(self) -> None:
        """Say how the motion that was sent ended, once it has."""
        with self._lock:
            if self._handle is None or not self._handle.is_done:
                return
            handle, self._handle = self._handle, None
            if self.plan is None:
                self.lines = [("note", _ending(handle), "")]


def path_of(plan: pb.Plan | None) -> dict[str, Any] | None:
    """Return what the page draws of a plan: orientations along it and at its keyframes."""
    if plan is None or not plan.samples:
        return None
    path = samples(plan)
    q, times = path.q.round(5).tolist(), path.times
    nearest = [int(abs(times - time).argmin()) for time in plan.keyframe_times]
    return {"q": q, "keyframes": [q[k] for k in nearest]}


def _ending(handle: MoveHandle) -> str:
    motion = f"Motion {handle.motion_number}"
    try:
        summary = handle.wait()
    except OrientdError as error:
        return f"{motion}: {error}"
    if summary.outcome == pb.OUTCOME_DONE:
        return f"{motion} was run to its end."
    return f"{motion} {_OUTCOMES[summary.outcome]}: {summary.text or 'no reason given'}"
