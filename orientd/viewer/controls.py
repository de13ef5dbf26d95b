"""What can be done on the page: stop and halt always; the rest with the lease.

What is pressed on one page happens once, and every page shows it.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import viser

from orientd.errors import LeaseError, OrientdError
from orientd.rpc import Robot
from orientd.stream import ServoState
from orientd.viewer import drop
from orientd.viewer.proposal import Proposal
from orientd.viewer.teach_panel import TeachPanel
from orientd.viewer.watcher import Sight, Watcher
from orientd.viewer.web import complain, set_changed

Act = Callable[[Robot, str], object]

STOP, HALT = "■ Stop", "▼ Halt: quickest, off the path"
KINDS: Mapping[str, str] = MappingProxyType({STOP: "stop", HALT: "halt"})
"""Of stops, by what is written on their buttons."""

TAKE, GIVE_BACK = "Take the lease", "Give the lease back"

_RED = (176, 42, 22)


def add_stop_buttons(server: viser.ViserServer, watcher: Watcher) -> None:
    """Put stop and halt of every device on the page.

    Anybody may, whether or not the daemon is known to answer.
    """
    stop = server.gui.add_button(STOP, color=_RED, hint="Come to rest on the path.")
    halt = server.gui.add_button(HALT, color="gray", hint="Leave the path where that helps.")
    stop.on_click(lambda event: _attempt(event, lambda: watcher.stopping().stop()))
    halt.on_click(lambda event: _attempt(event, lambda: watcher.stopping().halt()))


class Controls:
    """What needs the lease."""

    def __init__(self, server: viser.ViserServer, watcher: Watcher, *, is_beside: bool) -> None:
        """Put it on the page.

        Args:
            server: of the page.
            watcher: has the connection.
            is_beside: whether to command beside what the same user runs elsewhere.
        """
        self.proposal = Proposal()
        self._watcher = watcher
        self._is_beside = is_beside
        gui = server.gui
        self._lease = gui.add_button(TAKE, hint="Commands need it; each device has one.")
        self._lease.on_click(lambda event: attempt(watcher, event, self._take_or_give))
        self._pause = gui.add_button("Ⅱ Pause", hint="Come to rest on the path, to be resumed.")
        self._pause.on_click(lambda event: self._command(event, self._pause_or_resume))
        self._speed = gui.add_slider(
            "Speed, %", min=5, max=100, step=5, initial_value=100,
            hint="Of the motions as they are planned.",
        )  # fmt: skip
        self._speed.on_update(self._set_speed)
        self._reset = gui.add_button("Reset", hint="Leave a fault.")
        self._reset.on_click(lambda event: self._command(event, Robot.reset))
        with gui.add_folder("Motion file"):
            self._file = gui.add_upload_button(
                "Choose a motion file", mime_type=".yaml,.yml,.json",
                hint="It is planned and shown; nothing moves before it is sent.",
            )  # fmt: skip
            self._file.on_upload(self._read)
            gui.add_html(drop.HTML)
            self._about = gui.add_html("", visible=False)
            self._send = gui.add_button("▶ Send: the device moves", visible=False)
            self._send.on_click(lambda event: self._command(event, self.proposal.send))
            self._discard = gui.add_button("Discard", color="gray", visible=False)
            self._discard.on_click(lambda _: self.proposal.discard())
        self._teach = TeachPanel(
            server, self._command, lambda event, act: attempt(watcher, event, act)
        )

    def is_ours(self, sight: Sight) -> bool:
        """Whether this view may command."""
        robot = self._watcher.connection
        return robot is not None and sight.cell is not None and robot.holds_lease(sight.device)

    def show(self, sight: Sight) -> None:
        """Make the buttons say what they do now, and lock those that can do nothing."""
        self.proposal.look()
        is_ours, report = self.is_ours(sight), sight.report
        is_connected = report is not None and not sight.problem
        set_changed(self._lease, label=GIVE_BACK if is_ours else TAKE, disabled=not is_connected)
        can_command = is_ours and is_connected
        is_moving = report is not None and report.state is ServoState.STREAMING
        is_paused = report is not None and report.is_paused
        set_changed(
            self._pause,
            label="▶ Resume" if is_paused else "Ⅱ Pause",
            disabled=not (can_command and is_moving),
        )
        set_changed(self._speed, disabled=not can_command)
        if report is not None and not can_command:
            set_changed(self._speed, value=round(100.0 * report.speed))
        is_fault = report is not None and report.state is ServoState.FAULT
        set_changed(self._reset, disabled=not (can_command and is_fault), visible=is_fault)
        proposal = self.proposal
        set_changed(self._file, disabled=not is_connected)
        set_changed(self._about, content=proposal.html, visible=bool(proposal.html))
        has_plan = proposal.plan is not None
        set_changed(self._send, visible=has_plan, disabled=not can_command)
        set_changed(self._discard, visible=bool(proposal.html))
        self._teach.show(sight, can_command=can_command)

    def give_up(self) -> None:
        """Give the lease back, for nobody is left to command; what it started stops."""
        robot = self._watcher.connection
        if robot is not None:
            # What can be moved by hand must not be left so.
            with contextlib.suppress(OrientdError):
                self._teach.lesson.end()
            robot.release_lease()

    def _take_or_give(self, robot: Robot, device: str) -> None:
        is_given_back = self.is_ours(self._watcher.sight)
        self.give_up()
        if not is_given_back:
            robot.acquire_lease(device, beside=self._is_beside)

    def _pause_or_resume(self, robot: Robot, device: str) -> None:
        report = self._watcher.sight.report
        if report is not None and report.is_paused:
            robot.resume(device)
        else:
            robot.pause(device)

    def _set_speed(self, event: Any) -> None:  # noqa: ANN401 - the library's own
        # Without a client it is the page that follows the device.
        if event.client is None or self._speed.disabled:
            return
        speed = self._speed.value / 100.0
        self._command(event, lambda robot, device: robot.set_speed(speed, device))

    def _command(self, event: Any, act: Act) -> None:  # noqa: ANN401 - the library's own
        """Do *act* if the lease is held: a connection takes it unasked with the first command."""

        def with_lease(robot: Robot, device: str) -> None:
            if not self.is_ours(self._watcher.sight):
                raise LeaseError("take the lease first")
            act(robot, device)

        attempt(self._watcher, event, with_lease)

    def _read(self, event: Any) -> None:  # noqa: ANN401 - the library's own
        file, report = self._file.value, self._watcher.sight.report
        if report is None:
            return
        attempt(
            self._watcher,
            event,
            lambda robot, device: self.proposal.read(
                file.name, file.content, robot, device, report.rate_hz
            ),
        )


def attempt(watcher: Watcher, event: Any, act: Act) -> None:  # noqa: ANN401 - the library's own
    """Do *act* for whoever pressed, and tell them why not."""
    _attempt(event, lambda: act(watcher.robot(), watcher.sight.device))


def _attempt(event: Any, act: Callable[[], object]) -> None:  # noqa: ANN401 - the library's own
    try:
        act()
    except OrientdError as error:
        complain(event, "Refused", str(error))
