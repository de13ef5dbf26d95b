"""Teach-in on the page: let a device go, take poses of it, download the motion file."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import viser

from orientd import motion_file
from orientd.errors import StateError
from orientd.rpc import Robot
from orientd.stream import ServoState
from orientd.structured_text import structured
from orientd.viewer import words
from orientd.viewer.watcher import Sight
from orientd.viewer.web import set_changed

if TYPE_CHECKING:
    from orientd.teaching import Teaching

Attempt = Callable[[Any, Callable[[Robot, str], object]], None]
"""Does something for whoever pressed a button, and tells them why not."""

LET_GO, HOLD = "✋ Let go: move it by hand", "● Hold it again"


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


class TeachPanel:
    """Teach-in; letting go needs the lease."""

    def __init__(self, server: viser.ViserServer, command: Attempt, attempt: Attempt) -> None:
        """Put it on the page.

        Args:
            server: of the page.
            command: what needs the lease is done by it.
            attempt: everything else.
        """
        self.lesson = Lesson()
        gui = server.gui
        with gui.add_folder("Teach by hand", expand_by_default=False):
            self._hand = gui.add_button(
                LET_GO, hint="An arm is in freedrive then, a gimbal without torque: hold it."
            )
            self._hand.on_click(lambda event: command(event, self._let_go_or_hold))
            self._name = gui.add_text("Name", "", hint="Of the next pose, or of the file.")
            self._take = gui.add_button("Take this pose")
            self._take.on_click(lambda event: attempt(event, lambda *_: self._take_pose()))
            self._remove = gui.add_button("Remove the last", color="gray")
            self._remove.on_click(lambda event: attempt(event, lambda *_: self.lesson.remove()))
            self._about = gui.add_html("", visible=False)
            self._download = gui.add_button("Download the motion file", visible=False)
            self._download.on_click(
                lambda event: attempt(event, lambda *_: self._send_file(event.client))
            )

    def show(self, sight: Sight, *, can_command: bool) -> None:
        """Make the buttons say what they do now, and lock those that can do nothing."""
        lesson, report = self.lesson, sight.report
        is_at_rest = report is not None and report.state in (ServoState.IDLE, ServoState.HOLDING)
        has_taken = bool(lesson.count)
        set_changed(
            self._hand,
            label=HOLD if lesson.is_on else LET_GO,
            disabled=not (can_command and is_at_rest),
        )
        set_changed(self._take, disabled=not lesson.is_on)
        set_changed(self._remove, disabled=not has_taken)
        set_changed(self._about, content=lesson.html, visible=bool(lesson.html))
        set_changed(self._download, visible=has_taken)

    def _let_go_or_hold(self, robot: Robot, device: str) -> None:
        if self.lesson.is_on:
            self.lesson.end()
        else:
            self.lesson.begin(robot, device)

    def _take_pose(self) -> None:
        self.lesson.take(self._name.value)
        set_changed(self._name, value="")

    def _send_file(self, client: viser.ClientHandle | None) -> None:
        if client is not None:
            name = self._name.value or "taught"
            # Whoever has pressed it has said that the file is wanted.
            content = self.lesson.content(name)
            client.send_file_download(f"{name}.yaml", content, save_immediately=True)
