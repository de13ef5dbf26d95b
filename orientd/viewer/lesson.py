"""Teaching on the page: let a device go, take poses of it, download the motion file."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

from orientd import motion_file
from orientd.client import Robot
from orientd.errors import StateError
from orientd.structured_text import structured

if TYPE_CHECKING:
    from orientd.client import Teaching


class Lesson:
    """At most one, as every page shows it.

    Attributes:
        is_on: whether the device was let go.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._teaching: Teaching | None = None
        self.is_on = False

    @property
    def taken(self) -> str:
        """The keyframes that were taken, in words; empty before the first."""
        keyframes = [] if self._teaching is None else self._teaching.keyframes
        return "; ".join(
            f"{number}. {one.time or 0.0:.2f} s {one.name}".rstrip()
            for number, one in enumerate(keyframes, 1)
        )

    def begin(self, robot: Robot, device: str) -> None:
        """Let the device go, with no keyframe yet.

        Raises:
            OrientdError: it cannot be moved by hand.
        """
        with self._lock:
            if not self.is_on:
                self._teaching, self.is_on = robot.teach(device=device), True

    def end(self) -> None:
        """Have the device hold; what was taken stays.

        Raises:
            OrientdError: it does not hold.
        """
        with self._lock:
            if self.is_on and self._teaching is not None:
                self.is_on = False
                self._teaching.close()

    def take(self, name: str) -> None:
        """Take the pose of now, and call it *name*.

        Raises:
            FeedbackError: the device does not say where it is.
            StateError: the device was not let go.
        """
        with self._lock:
            if not self.is_on or self._teaching is None:
                raise StateError("let the device go first")
            self._teaching.take(name)

    def remove(self) -> None:
        """Remove the keyframe that was taken last."""
        with self._lock:
            if self._teaching is not None:
                self._teaching.remove()

    def content(self, name: str) -> str:
        """Return a motion file, YAML.

        Raises:
            OrientdError: nothing was taken.
        """
        with self._lock:
            if self._teaching is None:
                raise StateError("nothing was taken yet")
            return structured(motion_file.written(self._teaching.request(name)))
