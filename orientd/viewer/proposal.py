"""A motion that somebody has put on the page: read, planned and looked at before it is sent."""

from __future__ import annotations

import threading

from orientd import motion_file
from orientd.errors import OrientdError
from orientd.rpc import MoveHandle, Outcome, Plan, Robot
from orientd.viewer import words
from orientd.viewer.watcher import sample_rate


class Proposal:
    """At most one motion, and how the last one that was sent went.

    Attributes:
        html: what there is to say of it.
        plan: of the motion, with samples; ``None`` where there is none that could be sent.
    """

    def __init__(self) -> None:
        """Begin without one."""
        self._lock = threading.Lock()
        self._handle: MoveHandle | None = None
        self.html = ""
        self.plan: Plan | None = None

    def read(self, name: str, content: bytes, robot: Robot, device: str, device_hz: float) -> None:
        """Plan what a file says; what is wrong with it is said in its place.

        Args:
            name: of the file.
            content: of the file.
            robot: the connection to plan by.
            device: for which device.
            device_hz: its rate.
        """
        with self._lock:
            self.plan = None
            try:
                request = motion_file.loads(content, name)
                planned = robot.plan(request, device=device)
                self.plan = robot.planned(
                    planned.motion_id,
                    device=device,
                    sample_rate_hz=sample_rate(planned.duration, device_hz),
                )
            except OrientdError as error:
                self.html = words.refusal(str(error))
                return
            title = (
                f"{name}: {len(request.keyframes)} keyframes, shown as +1, +2 and so on. "
                "Not sent yet."
            )
            self.html = words.note(title) + words.certificate(planned.certificate)

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
            self.html = words.note(f"Motion {handle.motion_number} has been sent.")

    def discard(self) -> None:
        """Forget the motion."""
        with self._lock:
            self.plan, self.html = None, ""

    def look(self) -> None:
        """Say how the motion that was sent ended, once it has."""
        with self._lock:
            if self._handle is None or not self._handle.is_done:
                return
            handle, self._handle = self._handle, None
            if self.plan is None:
                self.html = words.note(_ending(handle))


def _ending(handle: MoveHandle) -> str:
    motion = f"Motion {handle.motion_number}"
    try:
        summary = handle.wait()
    except OrientdError as error:
        return f"{motion}: {error}"
    if summary.outcome is Outcome.DONE:
        return f"{motion} was run to its end."
    if summary.outcome is Outcome.PASSED:
        return f"{motion} went over into the next: {summary.text}"
    return f"{motion} was {_OUTCOMES[summary.outcome]}: {summary.text or 'no reason given'}"


_OUTCOMES = {
    Outcome.STOPPED: "stopped on its path",
    Outcome.FAULT: "ended by a fault",
    Outcome.REPLACED: "replaced by another one",
    Outcome.UNSETTLED: "sent to its end, but the device is not where it should be",
}
