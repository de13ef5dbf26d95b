"""The page of one daemon: what it shows, and what can be done on it.

Stop and halt are always possible; everything else needs the lease.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from orientd import first_stop
from orientd.client import Robot
from orientd.errors import LeaseError, OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.viewer import words
from orientd.viewer.charts import charts_of
from orientd.viewer.lesson import Lesson
from orientd.viewer.proposal import Proposal, path_of
from orientd.viewer.server import PageServer
from orientd.viewer.strips import SPAN
from orientd.viewer.watcher import Sight, Watcher

LONELY = 10.0
"""How long after the last page is closed the view gives the lease back, s."""

_LOOK = 0.1
_FREE = ("stop", "halt", "choose", "lease", "file", "discard", "take", "remove", "download")
"""What needs no lease, or takes it."""


class View:
    """The page of one daemon, as every browser shows it."""

    def __init__(
        self,
        connect: Callable[[], Robot],
        *,
        host: str,
        port: int,
        may_command: bool,
        is_dark: bool,
        is_beside: bool = False,
    ) -> None:
        """Connect to the daemon and serve the page.

        Args:
            connect: makes a connection to the daemon.
            host: where to serve.
            port: where to serve; 0 for any.
            may_command: whether the page can do more than stop and halt.
            is_dark: whether pages are dark at first.
            is_beside: whether to command beside other programs of the same user.

        Raises:
            OrientdError: no daemon answers, or the page cannot be served there.
        """
        self._may_command, self._is_dark, self._is_beside = may_command, is_dark, is_beside
        self._proposal, self._lesson = Proposal(), Lesson()
        self._paths: dict[str, dict[str, Any] | None] = {}
        self._watcher = watcher = Watcher(connect)
        try:
            self._server = PageServer(host, port, self)
        except BaseException:
            watcher.close()
            raise
        self.port = self._server.port

    def run(self, closing: threading.Event) -> None:
        """Serve until *closing* is set.  Give the lease back soon after the last page is closed."""
        closed_at: float | None = None
        try:
            while not closing.wait(_LOOK):
                has_pages = self._server.pages > 0
                self._watcher.watch(has_pages)
                self._proposal.look()
                if has_pages:
                    closed_at = None
                elif closed_at is None:
                    closed_at = time.monotonic()
                elif time.monotonic() - closed_at > LONELY:
                    self._give_up()
        finally:
            self._server.close()
            self._watcher.close()

    # What the page shows

    def picture(self, seen: dict[str, Any]) -> dict[str, Any]:
        """See :class:`~orientd.viewer.server.Source`."""
        now, sight = time.monotonic(), self._watcher.sight
        cell, report = sight.cell, sight.report
        picture: dict[str, Any] = {
            "said": now,
            "age": sight.age(now),
            "dark": self._is_dark,
            "control": self._control(sight) if self._may_command else None,
            "proposal": {
                "lines": self._proposal.lines,
                "path": self._path(self._proposal.plan),
            },
            "path": self._path(sight.plan),
            "outline": [line.tolist() for line in sight.outline],
        }
        if sight.pose is not None:
            picture["pose"] = sight.pose
        if cell is None or report is None:
            return picture | {"status": [("alert", "✕ Not connected", sight.trouble(now))]}
        certificate = None if sight.plan is None else sight.plan.certificate
        rows = seen.get("spans") or [[now // SPAN - 1e9]]
        return picture | {
            "devices": list(cell.devices),
            "device": {"name": report.name, "charts": charts_of(report, certificate)},
            "spans": self._watcher.strips.since(rows[-1][0]),
            "status": words.status(
                report,
                cell.daemon,
                is_ours=self._is_ours(sight),
                problem=sight.trouble(now),
                is_connected=not sight.problem,
            ),
        }

    def _path(self, plan: pb.Plan | None) -> dict[str, Any] | None:
        """Return the path of a plan; the same object for the same plan."""
        if plan is None:
            return None
        if plan.motion_id not in self._paths:
            self._paths = {**dict(list(self._paths.items())[-1:]), plan.motion_id: path_of(plan)}
        return self._paths[plan.motion_id]

    def _control(self, sight: Sight) -> dict[str, Any]:
        """Return what the buttons say, and which of them can do something."""
        report, lesson, is_ours = sight.report, self._lesson, self._is_ours(sight)
        is_connected = report is not None and not sight.problem
        can_command = is_ours and is_connected
        state = None if report is None else report.state
        is_paused = report is not None and report.is_paused
        has_plan = self._proposal.plan is not None
        enabled = {
            "lease": is_connected,
            "pause": can_command and state == pb.STATE_STREAMING,
            "speed": can_command,
            "reset": can_command and state == pb.STATE_FAULT,
            "file": is_connected,
            "send": can_command and has_plan,
            "hand": can_command and state in (pb.STATE_IDLE, pb.STATE_HOLDING),
            "take": lesson.is_on,
            "remove": bool(lesson.taken),
        }
        shown = {
            "reset": state == pb.STATE_FAULT,
            "send": has_plan,
            "discard": bool(self._proposal.lines),
            "download": bool(lesson.taken),
        }
        return {
            "labels": {
                "lease": "Give the lease back" if is_ours else "Take the lease",
                "pause": "▶ Resume" if is_paused else "Ⅱ Pause",
                "hand": "● Hold it again" if lesson.is_on else "✋ Let go: move it by hand",
                "taken": f"Taken: {lesson.taken or 'nothing yet'}",
            },
            "enabled": [name for name, can in enabled.items() if can],
            "shown": [name for name, is_shown in shown.items() if is_shown],
            "speed": 100 if report is None else round(100.0 * report.speed),
        }

    # What can be done

    def do(self, request: Mapping[str, Any]) -> dict[str, Any] | None:
        """See :class:`~orientd.viewer.server.Source`."""
        what, sight = request["do"], self._watcher.sight
        if what in ("stop", "halt"):
            self._stop(what)
            return None
        if not self._may_command and what != "choose":
            raise LeaseError("this page may stop and halt only; see `orientd view --control`")
        if what not in _FREE and not self._is_ours(sight):
            raise LeaseError("take the lease first")
        if what == "choose":
            self._watcher.choose(str(request["device"]))
        elif what == "discard":
            self._proposal.discard()
        elif what == "take":
            self._lesson.take(str(request["name"]))
        elif what == "remove":
            self._lesson.remove()
        elif what == "download":
            name = str(request["name"]) or "taught"
            return {"download": [f"{name}.yaml", self._lesson.content(name)]}
        else:
            self._command(what, request, self._watcher.robot(), sight)
        return None

    def _command(self, what: str, request: Mapping[str, Any], robot: Robot, sight: Sight) -> None:
        report, device = sight.report, sight.device
        if what == "lease":
            is_given_back = self._is_ours(sight)
            self._give_up()
            if not is_given_back:
                robot.acquire_lease(device, beside=self._is_beside)
        elif what == "pause":
            is_paused = report is not None and report.is_paused
            robot.resume(device) if is_paused else robot.pause(device)
        elif what == "speed":
            robot.set_speed(float(request["percent"]) / 100.0, device)
        elif what == "reset":
            robot.reset(device)
        elif what == "hand":
            self._lesson.end() if self._lesson.is_on else self._lesson.begin(robot, device)
        elif what == "send":
            self._proposal.send(robot, device)
        elif what == "file" and report is not None:
            content = str(request["content"]).encode()
            self._proposal.read(str(request["name"]), content, robot, device, report.rate_hz)

    def _stop(self, kind: str) -> None:
        """Stop every device, by the shortest way there is."""
        robot = self._watcher.robot(even_lost=True)
        daemon = robot.local_socket
        with contextlib.suppress(OSError):
            if daemon is not None and first_stop.send(str(daemon), kind):
                return
        robot.stop() if kind == "stop" else robot.halt()

    def _is_ours(self, sight: Sight) -> bool:
        """Whether this view holds the lease of the device."""
        robot = self._watcher.connection
        return robot is not None and sight.cell is not None and robot.holds_lease(sight.device)

    def _give_up(self) -> None:
        """Give the lease back; what was started with it stops, and what was let go holds."""
        robot = self._watcher.connection
        if robot is not None and self._may_command:
            with contextlib.suppress(OrientdError):
                self._lesson.end()
            robot.release_lease()
