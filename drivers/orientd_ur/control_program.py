"""The control program on the robot: have it play with what was chosen, and give way by hand."""

from __future__ import annotations

from typing import Any

from orientd.errors import DeviceFaultError
from orientd_ur.link import Link
from orientd_ur.options import UrOptions
from orientd_ur.recovery import PLAYING_NEEDS, Recovery
from orientd_ur.states import RuntimeState, interruption, obstacle


class ControlProgram:
    """What the driver asks of it where it may wait for the answer.

    Attributes:
        is_free: whether the arm can be moved by hand.
    """

    def __init__(self, link: Link, recovery: Recovery, options: UrOptions) -> None:
        self.is_free = False
        self._link, self._recovery, self._options = link, recovery, options

    def play(self) -> None:
        """Have it play, with the tool, payload and watchdog set; the arm holds.

        Raises:
            DeviceFaultError: the robot may not move, or is not in remote control.
            LinkError: the link is lost, or another client holds the robot.
        """
        link, chosen = self._link, self._options
        link.require()
        link.require_same()
        self._recovery.require_readiness()
        if not link.has_control:
            try:
                link.take_control()
            except DeviceFaultError as error:
                if self._recovery.has_dashboard:
                    raise
                raise DeviceFaultError(f"{error}: {PLAYING_NEEDS}") from error
            self._recovery.await_runtime(RuntimeState.PLAYING)
        elif link.modes()[2] != RuntimeState.PLAYING:
            link.play()
        self.hold()
        if chosen.tcp_offset is not None:
            self._order("setTcp", list(chosen.tcp_offset))
        if chosen.payload_mass is not None:
            self._order("setPayload", chosen.payload_mass, list(chosen.payload_cog))
        self._order("setWatchdog", chosen.watchdog_hz)

    def free(self) -> None:
        """Switch freedrive on; errors are those of :meth:`play`."""
        self.play()
        self._order("teachMode")
        self.is_free = True

    def hold(self) -> None:
        """Switch freedrive off, where it is on."""
        if self.is_free:
            self._order("endTeachMode")
            self.is_free = False

    def reason(self) -> str:
        """Return why the robot does not carry out orders; nothing where it should."""
        robot_mode, safety_mode, runtime_state = self._link.modes()
        return obstacle(robot_mode, safety_mode) or interruption(runtime_state)

    def _order(self, name: str, *arguments: Any) -> None:  # noqa: ANN401 - the library's own
        if not self._link.order(name, *arguments):
            raise DeviceFaultError(
                self.reason() or f"{self._options.host} did not carry out {name}"
            )
