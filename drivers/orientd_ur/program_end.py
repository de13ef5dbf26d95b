"""End the control program in a fault: it holds the last setpoint, and *play* would go on to it."""

from __future__ import annotations

import contextlib
import threading

from orientd.errors import LinkError
from orientd_ur.dashboard import Dashboard
from orientd_ur.link import Link
from orientd_ur.recovery import Recovery
from orientd_ur.states import RuntimeState, obstacle

_ASK_AGAIN_NS = 500_000_000
_JOIN = 2.0


class ProgramEnd:
    """The end of the control program after a fault, cycle by cycle.

    A program that plays takes the order to end from its registers.  One that is paused, or that a
    safety stop holds, takes none: the dashboard server ends it, asked on a thread of its own,
    since it may be slow to answer.  PolyScope X has no dashboard server: there the program ends
    as soon as somebody plays it.

    Args:
        link: to the robot.
        recovery: knows whether there is a dashboard server.
        stop_deceleration: with which the arm comes to rest where it still follows; rad/s^2.

    Attributes:
        notices: what somebody did to the program meanwhile, in words.
    """

    def __init__(self, link: Link, recovery: Recovery, stop_deceleration: float) -> None:
        self.notices: tuple[str, ...] = ()
        self._link, self._recovery = link, recovery
        self._stop_deceleration = stop_deceleration
        self._has_ended = self._was_held = False
        self._asked_ns = 0
        self._asking: threading.Thread | None = None

    def forget(self) -> None:
        """Forget what was done meanwhile: the fault is over."""
        self.notices = ()

    def begin(self) -> None:
        """Begin: a fault has come, and whatever plays is to end."""
        self._has_ended = self._was_held = False
        self._asked_ns = 0

    def advance(self, now_ns: int) -> None:
        """Do what can be done in this cycle.

        Raises:
            LinkError: the link is lost.
        """
        robot_mode, safety_mode, runtime_state = self._link.modes()
        if runtime_state == RuntimeState.STOPPED:
            self._has_ended = self._was_held = True
        elif runtime_state == RuntimeState.PLAYING and not obstacle(robot_mode, safety_mode):
            self._meet_playing()
        else:
            self._was_held = True
            if not self._has_ended:
                self._ask(now_ns)

    def wait(self) -> None:
        """Wait until the dashboard server is not being asked any more."""
        if self._asking is not None:
            self._asking.join(_JOIN)

    def _meet_playing(self) -> None:
        if self._has_ended:
            self._notice("another program was played on the robot during the fault")
            return
        if self._was_held:
            self._notice(
                "the control program was played on the robot during the fault; it was ended"
            )
        self._link.order("servoStop", self._stop_deceleration)
        self._link.order("stopScript")

    def _notice(self, text: str) -> None:
        if text not in self.notices:
            self.notices = (*self.notices, text)

    def _ask(self, now_ns: int) -> None:
        if not self._recovery.has_dashboard or now_ns - self._asked_ns < _ASK_AGAIN_NS:
            return
        if self._asking is not None and self._asking.is_alive():
            return
        self._asked_ns = now_ns
        self._asking = threading.Thread(target=self._stop_program, daemon=True)
        self._asking.start()

    def _stop_program(self) -> None:
        with contextlib.suppress(LinkError), Dashboard(self._link.address) as dashboard:
            if dashboard.ask("stop").startswith("Stopped"):
                # Whatever plays from now on is another program.
                self._has_ended = self._was_held = True
