"""Teach-in on the page: a device that is moved by hand, and the poses that were taken of it."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from orientd import motion_file
from orientd.errors import StateError
from orientd.structured_text import structured
from orientd.viewer import words

if TYPE_CHECKING:
    from orientd.rpc import Robot
    from orientd.teaching import Teaching


class Lesson:
    """At most one, as every page shows it.

    Attributes:
        html: what was taken so far; empty before anything was.
        is_on: whether the device was let go.
    """

    def __init__(self) -> None:
        """Begin without one."""
        self._lock = threading.Lock()
        self._teaching: Teaching | None = None
        self.is_on = False
        self.html = ""

    @property
    def count(self) -> int:
        """How many keyframes were taken."""
        return 0 if self._teaching is None else len(self._teaching.keyframes)

    def begin(self, robot: Robot, device: str) -> None:
        """Let the device go, with no keyframe yet.

        Raises:
            OrientdError: it cannot be moved by hand.
        """
        with self._lock:
            if not self.is_on:
                self._teaching, self.is_on = robot.teach(device=device), True
                self._tell(self._teaching)

    def end(self) -> None:
        """Have the device hold; what was taken stays.

        Raises:
            OrientdError: it does not hold.
        """
        with self._lock:
            if self.is_on and self._teaching is not None:
                self.is_on = False
                self._teaching.close()

    def take(self, name: str = "") -> None:
        """Take the pose of now.

        Raises:
            FeedbackError: the device does not say where it is.
            StateError: the device was not let go.
        """
        with self._lock:
            if not self.is_on or self._teaching is None:
                raise StateError("let the device go first")
            self._teaching.take(name)
            self._tell(self._teaching)

    def remove(self) -> None:
        """Remove the keyframe that was taken last."""
        with self._lock:
            if self._teaching is not None:
                self._teaching.remove()
                self._tell(self._teaching)

    def content(self, name: str) -> bytes:
        """Return a motion file, YAML.

        Raises:
            RequestError: no keyframe was taken.
        """
        with self._lock:
            if self._teaching is None:
                raise StateError("nothing was taken yet")
            return structured(motion_file.written(self._teaching.request(name))).encode()

    def _tell(self, teaching: Teaching) -> None:
        lines = [
            f"{number}. {one.time or 0.0:.2f} s {one.name}"
            for number, one in enumerate(teaching.keyframes, 1)
        ]
        self.html = words.note("Taken: " + ("; ".join(lines) or "nothing yet"))
