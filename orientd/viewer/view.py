"""The page of one daemon: what it shows, and what can be done on it.

Stop and halt are always possible; everything else needs the lease.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from orientd.client.robot import Robot
from orientd.client.stop_call import ask_to_stop
from orientd.errors import LeaseError, OrientdError
from orientd.floats import combine, cross, norm
from orientd.protocol import control_pb2 as pb
from orientd.protocol.cones import to_cones
from orientd.protocol.reports import samples
from orientd.viewer import words
from orientd.viewer.charts import SPAN, charts_of
from orientd.viewer.server import PageServer
from orientd.viewer.watcher import Sight, Watcher

LONELY = 10.0
"""How long after the last page is closed the view gives the lease back, s."""

_LOOK = 0.1
_POINTS = 48
"""Points of the edge of a cone."""


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
            is_beside: whether to share the lease with other programs of the same user.

        Raises:
            OrientdError: no daemon answers, or the page cannot be served there.
        """
        self._may_command, self._is_dark, self._is_beside = may_command, is_dark, is_beside
        self._one_at_a_time = threading.Lock()
        self._path: tuple[str, dict[str, Any] | None] = ("", None)
        self._watcher = watcher = Watcher(connect)
        try:
            self._server = PageServer(host, port, self)
        except BaseException:
            watcher.close()
            raise
        self.port = self._server.port

    def run(self, closing: threading.Event) -> None:
        """Serve until *closing* is set.  Give the lease back soon after the last page is closed."""
        last_page = time.monotonic()
        try:
            while not closing.wait(_LOOK):
                self._watcher.is_watched = self._server.pages > 0
                if self._watcher.is_watched:
                    last_page = time.monotonic()
                elif time.monotonic() - last_page > LONELY:
                    with contextlib.suppress(OrientdError):
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
            "path": self._path_of(sight.plan),
            "outline": [line.tolist() for line in sight.outline],
            "cones": [],
        }
        if sight.pose is not None:
            picture["pose"] = sight.pose
        if cell is None or report is None:
            return picture | {"status": [("alert", "✕ Not connected", sight.trouble(now))]}
        certificate = None if sight.plan is None else sight.plan.certificate
        rows = seen.get("spans") or [[now // SPAN - 1e9]]
        picture["cones"] = edges(
            *report.keep_out,
            *(() if sight.plan is None else sight.plan.keep_out),
        )
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

    def _path_of(self, plan: pb.Plan | None) -> dict[str, Any] | None:
        """Return the path of a plan; the same object for the same plan."""
        if plan is None:
            return None
        if plan.motion_id != self._path[0]:
            self._path = plan.motion_id, _path_of(plan)
        return self._path[1]

    def _control(self, sight: Sight) -> dict[str, Any]:
        """Return what the buttons say, and which of them can do something."""
        report, is_ours = sight.report, self._is_ours(sight)
        is_connected = report is not None and not sight.problem
        can_command = is_ours and is_connected
        state = None if report is None else report.state
        is_paused = report is not None and report.is_paused
        enabled = {
            "lease": is_connected,
            "pause": can_command and state == pb.STATE_STREAMING,
            "speed": can_command,
            "reset": can_command and state == pb.STATE_FAULT,
        }
        return {
            "labels": {
                "lease": "Give the lease back" if is_ours else "Take the lease",
                "pause": "▶ Resume" if is_paused else "Ⅱ Pause",
            },
            "enabled": [name for name, can in enabled.items() if can],
            "shown": ["reset"] if state == pb.STATE_FAULT else [],
            "speed": 100 if report is None else round(100.0 * report.speed),
        }

    # What can be done

    def do(self, request: Mapping[str, Any]) -> None:
        """See :class:`~orientd.viewer.server.Source`."""
        what, sight = request["do"], self._watcher.sight
        if what in ("stop", "halt"):
            self._stop(what)
        elif what == "choose":
            self._watcher.chosen = str(request["device"])
        elif not self._may_command:
            raise LeaseError("this page may stop and halt only; see `orientd view --control`")
        elif what == "lease":
            with self._one_at_a_time:
                self._take_lease(sight)
        elif not self._is_ours(sight):
            raise LeaseError("take the lease first")
        elif what in ("pause", "speed", "reset"):
            self._adjust(what, request, sight)

    def _adjust(self, what: str, request: Mapping[str, Any], sight: Sight) -> None:
        robot, device = self._watcher.robot(), sight.device
        if what == "speed":
            robot.set_speed(float(request["percent"]) / 100.0, device)
        elif what == "reset":
            robot.reset(device)
        elif sight.report is not None and sight.report.is_paused:
            robot.resume(device)
        else:
            robot.pause(device)

    def _take_lease(self, sight: Sight) -> None:
        """Take the lease, or give it back if this view holds it."""
        robot, is_given_back = self._watcher.robot(), self._is_ours(sight)
        self._give_up()
        if not is_given_back:
            robot.acquire_lease(sight.device, beside=self._is_beside)

    def _stop(self, kind: str) -> None:
        """Stop every device, by the shortest way there is.

        Raises:
            OrientdError: a servo does not answer, or no daemon does.
        """
        robot = self._watcher.robot(even_lost=True)
        daemon = robot.local_socket
        if daemon is None or ask_to_stop(daemon, kind) is None:
            robot.stop() if kind == "stop" else robot.halt()

    def _is_ours(self, sight: Sight) -> bool:
        """Whether this view holds the lease of the device."""
        robot = self._watcher.connection
        return robot is not None and sight.cell is not None and robot.holds_lease(sight.device)

    def _give_up(self) -> None:
        """Release the lease, if this view holds it."""
        robot = self._watcher.connection
        if robot is not None and self._may_command:
            robot.release_lease()


def _path_of(plan: pb.Plan) -> dict[str, Any] | None:
    """Return what the page draws of a plan: orientations along it and at its keyframes."""
    if not plan.HasField("samples"):
        return None
    path = samples(plan)
    q, times = path.q.round(5).tolist(), path.times
    nearest = [int(abs(times - time).argmin()) for time in plan.keyframe_times]
    return {"q": q, "keyframes": [q[k] for k in nearest]}


def edges(*messages: pb.KeepOut) -> list[dict[str, Any]]:
    """Return name and edge of each cone now, on a sphere of radius 1 around the tool.

    A later cone of the same name is left out: plans repeat those of the device.
    """
    named = {cone.name: cone for cone in reversed(to_cones(messages))}
    now, found = time.time_ns(), []
    for name, cone in named.items():
        direction = cone.direction_at(now)
        x, y, z = direction
        across = cross(direction, (0.0, 0.0, 1.0) if abs(z) < 0.9 else (1.0, 0.0, 0.0))
        across = combine(across, 1.0 / norm(across), across, 0.0)
        other = cross(direction, across)
        centre, radius = math.cos(cone.half_angle), math.sin(cone.half_angle)
        ring = []
        for k in range(_POINTS + 1):
            turn = 2.0 * math.pi * k / _POINTS
            side = combine(across, radius * math.cos(turn), other, radius * math.sin(turn))
            ring.append([round(one, 4) for one in combine(direction, centre, side, 1.0)])
        found.append({"name": name, "edge": ring, "middle": [x, y, z]})
    return found
