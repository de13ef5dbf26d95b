"""The control program on the robot: play it, end it in a fault, recover from stops.

Commands that the program cannot take go to the dashboard server.  PolyScope X has none: there an
empty program ends a paused one, and for everything else messages tell the user what to do.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from math import radians
from typing import Any

from orientd.errors import DeviceFaultError, LinkError
from orientd_ur import controller
from orientd_ur.controller import PROTECTIVE_STOP, RUNNING, RuntimeState, interruption, obstacle
from orientd_ur.link import Link
from orientd_ur.options import UrOptions
from orientd_ur.wire import SCRIPT_PORT, Connection, Dashboard

_POLL = 0.005
_POWER_UP = 15.0
_STOPPING = 1.0
_JOIN = 2.0
_ASK_AGAIN_NS = 500_000_000
_NOTHING = b"def orientd_end():\nend\n"
_LONGEST_RETURN_NS = 5_000_000_000
_RETURN_STEP = 0.002
"""Largest change in a cycle of a command that comes back to a blocked joint, rad."""
_REDUCED = 2
"""The last of the safety modes in which an arm may be powered up."""

_PLAYING_NEEDS = (
    "PolyScope X plays it in remote control only (switch at the top of the pendant), with RTDE and "
    "the primary and secondary clients allowed in its security settings, and while no other "
    "program runs, that of a URCapX included"
)


class ControlProgram:
    """The control program of one robot.

    Args:
        link: to the robot.
        options: of the driver.

    Attributes:
        version: of the robot's software.
        is_free: whether the arm can be moved by hand.
        notices: actions of users on the program during a fault, in words.
    """

    def __init__(self, link: Link, options: UrOptions) -> None:
        # The version is known once the robot was probed.
        self.version: tuple[int, ...] = (5, 4)
        self.is_free = False
        self.notices: tuple[str, ...] = ()
        self._link, self._options = link, options
        self._has_ended = self._was_held = self._is_cleared = self._is_standing = False
        self._goal: list[float] = []
        self._stands_by_ns = 0
        self._asked_ns = 0
        self._asking: threading.Thread | None = None

    @property
    def has_dashboard(self) -> bool:
        """Whether this software has a dashboard server."""
        return controller.has("a dashboard server", self.version)

    def reason(self) -> str:
        """Return why the robot does not carry out commands, or an empty string."""
        robot_mode, safety_mode, runtime_state = self._link.modes()
        return obstacle(robot_mode, safety_mode) or interruption(runtime_state)

    def play(self) -> None:
        """Play it, with the tool, payload and watchdog set; the arm holds.

        Raises:
            DeviceFaultError: the robot may not move, or is not in remote control.
            LinkError: the link is lost, or another client holds the robot.
        """
        link, chosen = self._link, self._options
        link.require()
        link.require_same()
        self._require_readiness()
        if self._needs_remote:
            with Dashboard(link.address) as dashboard:
                self._require_remote(dashboard)
        if not link.has_control:
            try:
                link.take_control()
            except DeviceFaultError as error:
                if self.has_dashboard:
                    raise
                raise DeviceFaultError(f"{error}: {_PLAYING_NEEDS}") from error
            self._await(lambda: link.modes()[2] == RuntimeState.PLAYING, _STOPPING)
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
        """Switch freedrive off, if it is on."""
        if self.is_free:
            self._order("endTeachMode")
            self.is_free = False

    def clear(self) -> None:
        """Unlock, power up if so configured, and play again.

        Raises:
            DeviceFaultError: a person must act: a button, a safeguard, the pendant.
            LinkError: the link is lost, or the dashboard server does not answer.
        """
        link = self._link
        if self._asking is not None:
            self._asking.join(_JOIN)
        if self.has_dashboard:
            with Dashboard(link.address) as dashboard:
                if self._needs_remote:
                    self._require_remote(dashboard)
                if link.modes()[1] == PROTECTIVE_STOP:
                    self._unlock(dashboard)
                robot_mode, safety_mode, _ = link.modes()
                is_down = robot_mode != RUNNING and safety_mode <= _REDUCED
                if is_down and self._options.release_brakes:
                    dashboard.ask("power on")
                    dashboard.ask("brake release")
                    self._await(lambda: link.modes()[0] == RUNNING, _POWER_UP)
                # Start it again rather than resume: a paused program would continue to the setpoint
                # at which it stopped.
                dashboard.ask("stop")
                self._await(lambda: link.modes()[2] == RuntimeState.STOPPED, _STOPPING)
        self._require_readiness()
        if link.has_control:
            link.play()
        self.notices = ()

    def give_up(self) -> None:
        """Start to end the running program; *play* would continue to its last setpoint."""
        self._has_ended = self._was_held = self._is_cleared = self._is_standing = False
        self._goal = []
        self._asked_ns = 0

    def stands(self, measured: Sequence[float], tuned: UrOptions, now_ns: int) -> bool:
        """Command the arm to be where it is, a step each cycle; return whether that is done.

        A blocked arm would otherwise move to its last command as soon as it comes free.

        Args:
            measured: joints, rad.
            tuned: options with which the arm is servoed.
            now_ns: time of the cycle.

        Raises:
            LinkError: the link is lost.
        """
        if self._is_standing:
            return True
        commanded, _ = self._link.commanded()
        if not self._goal:
            self._goal, self._stands_by_ns = list(commanded), now_ns + _LONGEST_RETURN_NS
        off = max(abs(wanted - at) for wanted, at in zip(commanded, measured, strict=True))
        is_near = off <= radians(self._options.arrival_tolerance_deg)
        if is_near or now_ns > self._stands_by_ns or self.reason():
            self._is_standing = True
        else:
            self._goal = [
                goal + max(-_RETURN_STEP, min(_RETURN_STEP, at - goal))
                for goal, at in zip(self._goal, measured, strict=True)
            ]
            how = 0.0, 0.0, tuned.servo_time, tuned.lookahead, tuned.gain
            self._is_standing = not self._link.tell("servoJ", self._goal, *how)
        return self._is_standing

    def end(self, now_ns: int) -> None:
        """Take the next step in this cycle to end it.

        A playing program receives the command to end in its registers.  A paused program, or one
        held by a safety stop, receives nothing: the dashboard server ends it, in a thread of its
        own, because it may be slow to answer.  Without a dashboard server an empty program takes
        its place, as soon as the robot accepts one.  Once no program plays, the last setpoint
        leaves the registers: it would move an arm that is moved by hand meanwhile.

        Raises:
            LinkError: the link is lost.
        """
        robot_mode, safety_mode, runtime_state = self._link.modes()
        if runtime_state != RuntimeState.PLAYING and not self._is_cleared:
            self._is_cleared = True
            self._link.clear_command()
        if runtime_state == RuntimeState.STOPPED:
            self._has_ended = self._was_held = True
        elif runtime_state != RuntimeState.PLAYING or obstacle(robot_mode, safety_mode):
            self._was_held = True
            self._ask_to_stop(now_ns)
        elif self._has_ended:
            if not self.has_dashboard and now_ns - self._asked_ns < _ASK_AGAIN_NS:
                return  # it may be the empty one
            self._notice("another program was played on the robot during the fault")
        else:
            if self._was_held:
                self._notice(
                    "the control program was played on the robot during the fault; it was ended"
                )
            self._link.order("servoStop", self._options.stop_deceleration)
            self._link.order("stopScript")

    def _notice(self, text: str) -> None:
        if text not in self.notices:
            self.notices = (*self.notices, text)

    def _ask_to_stop(self, now_ns: int) -> None:
        is_asking = self._asking is not None and self._asking.is_alive()
        is_due = now_ns - self._asked_ns >= _ASK_AGAIN_NS
        if is_due and not is_asking and not self._has_ended:
            self._asked_ns = now_ns
            end = self._stop_by_dashboard if self.has_dashboard else self._replace
            self._asking = threading.Thread(target=end, daemon=True)
            self._asking.start()

    def _stop_by_dashboard(self) -> None:
        with contextlib.suppress(LinkError), Dashboard(self._link.address) as dashboard:
            if dashboard.ask("stop").startswith("Stopped"):
                # Anything that plays from now on is another program.
                self._has_ended = self._was_held = True

    def _replace(self) -> None:
        """Send an empty program; the robot does not answer, its runtime state shows the end."""
        address = self._link.address
        with (
            contextlib.suppress(LinkError),
            Connection(address, SCRIPT_PORT, "script server", _STOPPING) as link,
        ):
            link.send(_NOTHING)

    @property
    def _needs_remote(self) -> bool:
        is_known = controller.has("is in remote control", self.version)
        return self._options.check_remote_control and is_known

    def _require_readiness(self) -> None:
        robot_mode, safety_mode, _ = self._link.modes()
        if reason := obstacle(robot_mode, safety_mode):
            raise DeviceFaultError(reason)

    def _require_remote(self, dashboard: Dashboard) -> None:
        if dashboard.is_remote is False:
            raise DeviceFaultError(
                f"{self._options.host} is in local control; switch it to remote control on the "
                "pendant"
            )

    def _unlock(self, dashboard: Dashboard) -> None:
        ends = time.monotonic() + self._options.unlock_timeout
        answer = ""
        while self._link.modes()[1] == PROTECTIVE_STOP:
            self._link.require()
            if time.monotonic() > ends:
                raise DeviceFaultError(f"the protective stop stays locked: {answer}")
            answer = dashboard.ask("unlock protective stop")
            time.sleep(_POLL)
        dashboard.ask("close safety popup")

    def _await(self, is_so: Callable[[], bool], seconds: float) -> None:
        """Wait for a limited time until a condition holds, while the link lives."""
        ends = time.monotonic() + seconds
        while not is_so() and time.monotonic() < ends:
            self._link.require()
            time.sleep(_POLL)

    def _order(self, name: str, *arguments: Any) -> None:  # noqa: ANN401 - the library's own
        if not self._link.order(name, *arguments):
            raise DeviceFaultError(
                self.reason() or f"{self._options.host} did not carry out {name}"
            )
