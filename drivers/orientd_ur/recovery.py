"""What a controller is asked for at its dashboard server: remote control, and the way out of stops.

PolyScope X has no dashboard server: there the pendant is the only way, and what would be asked for
is said instead.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator

from orientd.errors import DeviceFaultError
from orientd_ur import versions
from orientd_ur.dashboard import Dashboard
from orientd_ur.link import Link
from orientd_ur.options import UrOptions
from orientd_ur.states import PROTECTIVE_STOP, RUNNING, RuntimeState, obstacle

_POLL = 0.005
_POWER_UP = 15.0
_STOPPING = 1.0

NO_DASHBOARD = (
    "PolyScope X has no dashboard server: unlock protective stops, power the arm and release its "
    "brakes on the pendant; whether it is in remote control, as it must be, is not known"
)

PLAYING_NEEDS = (
    "PolyScope X plays it in remote control only (switch at the top of the pendant), with RTDE and "
    "the primary and secondary clients allowed in its security settings, and while no other "
    "program runs, that of a URCapX included"
)


class Recovery:
    """The dashboard server of one robot, as far as enabling and resetting go.

    Args:
        link: to the robot.
        options: of the driver.
    """

    def __init__(self, link: Link, options: UrOptions) -> None:
        self._link = link
        self._options = options
        # Unknown before the robot was looked at, which tells it.
        self.version: tuple[int, ...] = (5, 4)

    @property
    def has_dashboard(self) -> bool:
        """Whether this software has a dashboard server."""
        return versions.has("a dashboard server", self.version)

    def require_readiness(self) -> None:
        """Do nothing where the arm may be moved from here.

        Raises:
            DeviceFaultError: it may not, or is in local control.
            LinkError: the dashboard server does not answer.
        """
        robot_mode, safety_mode, _ = self._link.modes()
        reason = obstacle(robot_mode, safety_mode)
        if reason:
            raise DeviceFaultError(reason)
        if self._needs_remote:
            with Dashboard(self._link.address) as dashboard:
                self._require_remote(dashboard)

    def clear(self) -> None:
        """Unlock, power up if so configured, and end whatever program is there.

        Raises:
            DeviceFaultError: what is wrong needs a person: a button, a safeguard, the pendant.
            LinkError: the link is lost, or the dashboard server does not answer.
        """
        with self._dashboard() as dashboard:
            if dashboard is not None:
                if self._needs_remote:
                    self._require_remote(dashboard)
                if self._link.modes()[1] == PROTECTIVE_STOP:
                    self._unlock(dashboard)
                robot_mode, safety_mode, _ = self._link.modes()
                if robot_mode != RUNNING and safety_mode <= 2 and self._options.release_brakes:
                    self._power_up(dashboard)
            robot_mode, safety_mode, _ = self._link.modes()
            reason = obstacle(robot_mode, safety_mode)
            if reason:
                raise DeviceFaultError(reason)
            if dashboard is not None:
                # Anew, not resumed: a program that was paused would go on to the setpoint it was
                # stopped at.
                dashboard.ask("stop")
                self.await_runtime(RuntimeState.STOPPED)

    def await_runtime(self, state: RuntimeState) -> None:
        """Wait for a while until the program is in *state*."""
        ends = time.monotonic() + _STOPPING
        while self._link.modes()[2] != state and time.monotonic() < ends:
            self._link.require()
            time.sleep(_POLL)

    @property
    def _needs_remote(self) -> bool:
        is_known = versions.has("is in remote control", self.version)
        return self._options.check_remote_control and is_known

    @contextlib.contextmanager
    def _dashboard(self) -> Iterator[Dashboard | None]:
        if not self.has_dashboard:
            yield None
            return
        with Dashboard(self._link.address) as dashboard:
            yield dashboard

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

    def _power_up(self, dashboard: Dashboard) -> None:
        dashboard.ask("power on")
        dashboard.ask("brake release")
        ends = time.monotonic() + _POWER_UP
        while self._link.modes()[0] != RUNNING and time.monotonic() < ends:
            self._link.require()
            time.sleep(_POLL)
