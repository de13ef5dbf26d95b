"""The page of one daemon: what it shows, and what can be done on it.

Stop and halt are always possible; everything else needs the lease.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from orientd import motion_file
from orientd.client import MoveHandle, Robot, ask_to_stop
from orientd.errors import LeaseError, OrientdError, StateError
from orientd.protocol import control_pb2 as pb
from orientd.protocol import samples
from orientd.structured_text import structured
from orientd.viewer import words
from orientd.viewer.charts import charts_of
from orientd.viewer.cones import edges
from orientd.viewer.server import PageServer
from orientd.viewer.strips import SPAN
from orientd.viewer.watcher import Sight, Watcher, sample_rate

if TYPE_CHECKING:
    from orientd.client import Teaching

LONELY = 10.0
"""How long after the last page is closed the view gives the lease back, s."""

_LOOK = 0.1
_NEEDS_LEASE = ("pause", "speed", "reset", "send", "hand")

_OUTCOMES = {
    pb.OUTCOME_DONE: "was run to its end",
    pb.OUTCOME_STOPPED: "was stopped on its path",
    pb.OUTCOME_FAULT: "was ended by a fault",
    pb.OUTCOME_REPLACED: "was replaced by another one",
    pb.OUTCOME_PASSED: "was blended into the next one",
    pb.OUTCOME_UNSETTLED: "was sent to its end, but the device is not where it should be",
}


@dataclass(frozen=True, slots=True)
class Proposal:
    """A motion file that was put on the page, or how the last motion ended.

    Attributes:
        lines: the certificate, the refusal or the outcome.
        plan: of the motion, with samples; ``None`` if there is nothing to send.
    """

    lines: tuple[words.Line, ...] = ()
    plan: pb.Plan | None = None


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
        self._proposal = Proposal()
        self._handle: MoveHandle | None = None
        self._teaching: Teaching | None = None
        self._is_free = False
        self._one_at_a_time = threading.Lock()
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
        last_page = time.monotonic()
        try:
            while not closing.wait(_LOOK):
                self._watcher.is_watched = self._server.pages > 0
                if self._watcher.is_watched:
                    last_page = time.monotonic()
                elif time.monotonic() - last_page > LONELY:
                    self._give_up()
                handle = self._handle
                if handle is not None and handle.is_done:
                    self._handle = None
                    if self._proposal.plan is None:
                        self._proposal = Proposal((("note", _ending(handle), ""),))
        finally:
            self._server.close()
            self._watcher.close()

    # What the page shows

    def picture(self, seen: dict[str, Any]) -> dict[str, Any]:
        """See :class:`~orientd.viewer.server.Source`."""
        now, sight, proposal = time.monotonic(), self._watcher.sight, self._proposal
        cell, report = sight.cell, sight.report
        picture: dict[str, Any] = {
            "said": now,
            "age": sight.age(now),
            "dark": self._is_dark,
            "control": self._control(sight) if self._may_command else None,
            "proposal": {"lines": proposal.lines, "path": self._path(proposal.plan)},
            "path": self._path(sight.plan),
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
            *(() if proposal.plan is None else proposal.plan.keep_out),
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

    def _path(self, plan: pb.Plan | None) -> dict[str, Any] | None:
        """Return the path of a plan; the same object for the same plan."""
        if plan is None:
            return None
        if plan.motion_id not in self._paths:
            self._paths = {**dict(list(self._paths.items())[-1:]), plan.motion_id: _path_of(plan)}
        return self._paths[plan.motion_id]

    def _control(self, sight: Sight) -> dict[str, Any]:
        """Return what the buttons say, and which of them can do something."""
        report, is_ours = sight.report, self._is_ours(sight)
        is_connected = report is not None and not sight.problem
        can_command = is_ours and is_connected
        state = None if report is None else report.state
        is_paused = report is not None and report.is_paused
        keyframes = () if self._teaching is None else self._teaching.keyframes
        has_plan, has_taken = self._proposal.plan is not None, bool(keyframes)
        enabled = {
            "lease": is_connected,
            "pause": can_command and state == pb.STATE_STREAMING,
            "speed": can_command,
            "reset": can_command and state == pb.STATE_FAULT,
            "file": is_connected,
            "send": can_command and has_plan,
            "hand": can_command and state in (pb.STATE_IDLE, pb.STATE_HOLDING),
            "take": self._is_free,
            "remove": has_taken,
        }
        shown = {
            "reset": state == pb.STATE_FAULT,
            "send": has_plan,
            "discard": bool(self._proposal.lines),
            "download": has_taken,
        }
        taken = "; ".join(
            f"{number}. {one.time or 0.0:.2f} s {one.name}".rstrip()
            for number, one in enumerate(keyframes, 1)
        )
        return {
            "labels": {
                "lease": "Give the lease back" if is_ours else "Take the lease",
                "pause": "▶ Resume" if is_paused else "Ⅱ Pause",
                "hand": "● Hold it again" if self._is_free else "✋ Let go: move it by hand",
                "taken": f"Taken: {taken or 'nothing yet'}",
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
        if what == "choose":
            self._watcher.chosen = str(request["device"])
            return None
        if not self._may_command:
            raise LeaseError("this page may stop and halt only; see `orientd view --control`")
        if what in _NEEDS_LEASE and not self._is_ours(sight):
            raise LeaseError("take the lease first")
        if what in ("pause", "speed", "reset"):
            self._adjust(what, request, sight)
        elif what == "file":
            self._propose(str(request["name"]), str(request["content"]), sight)
        elif what == "discard":
            self._proposal = Proposal()
        elif what in ("lease", "send"):
            with self._one_at_a_time:
                self._take_lease(sight) if what == "lease" else self._send(sight)
        elif what in ("hand", "take", "remove", "download"):
            with self._one_at_a_time:
                return self._teach(what, str(request.get("name", "")), sight)
        return None

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

    def _send(self, sight: Sight) -> None:
        """Start the motion on the page; one that the daemon refuses stays there."""
        if self._proposal.plan is not None:
            robot = self._watcher.robot()
            self._handle = handle = robot.move(self._proposal.plan, device=sight.device)
            self._proposal = Proposal((("note", f"Motion {handle.motion_number} was sent.", ""),))

    def _teach(self, what: str, name: str, sight: Sight) -> dict[str, Any] | None:
        """Free or hold the device, add or remove a pose, or download the motion file."""
        teaching = self._teaching
        if what == "hand" and self._is_free:
            self._hold()
        elif what == "hand":
            self._teaching = self._watcher.robot().teach(device=sight.device)
            self._is_free = True
        elif teaching is None or (what == "take" and not self._is_free):
            raise StateError("let the device go first")
        elif what == "take":
            teaching.take(name)
        elif what == "remove":
            teaching.remove()
        else:
            content = structured(motion_file.written(teaching.request(name or "taught")))
            return {"download": [f"{name or 'taught'}.yaml", content]}
        return None

    def _propose(self, name: str, content: str, sight: Sight) -> None:
        """Plan the motion file *content* called *name*, or say in its place what is wrong."""
        robot, device = self._watcher.robot(), sight.device
        try:
            request = motion_file.loads(content.encode(), name)
            planned = robot.plan(request, device=device)
            rate_hz = sample_rate(planned.duration, planned.certificate.rate_hz)
            plan = robot.planned(planned.motion_id, device=device, sample_rate_hz=rate_hz)
        except OrientdError as error:
            self._proposal = Proposal((("alert", "✕ Refused", str(error)),))
            return
        count = len(request.keyframes)
        title = f"{name}: {count} keyframes, shown as +1, +2 and so on. Not sent yet."
        lines = (("note", title, ""), *words.certificate(planned.certificate))
        self._proposal = Proposal(lines, plan)

    def _stop(self, kind: str) -> None:
        """Stop every device, by the shortest way there is.

        Raises:
            OrientdError: a servo does not answer, or no daemon does.
        """
        robot = self._watcher.robot(even_lost=True)
        daemon = robot.local_socket
        if daemon is None or ask_to_stop(daemon, kind) is None:
            robot.stop() if kind == "stop" else robot.halt()

    def _hold(self) -> None:
        """End hand guiding: the device holds, and the recorded keyframes stay."""
        if self._is_free and self._teaching is not None:
            self._is_free = False
            self._teaching.close()

    def _is_ours(self, sight: Sight) -> bool:
        """Whether this view holds the lease of the device."""
        robot = self._watcher.connection
        return robot is not None and sight.cell is not None and robot.holds_lease(sight.device)

    def _give_up(self) -> None:
        """Release the lease; its motions stop, and a device in hand guiding holds again."""
        robot = self._watcher.connection
        if robot is not None and self._may_command:
            with contextlib.suppress(OrientdError):
                self._hold()
            robot.release_lease()


def _path_of(plan: pb.Plan) -> dict[str, Any] | None:
    """Return what the page draws of a plan: orientations along it and at its keyframes."""
    if not plan.HasField("samples"):
        return None
    path = samples(plan)
    q, times = path.q.round(5).tolist(), path.times
    nearest = [int(abs(times - time).argmin()) for time in plan.keyframe_times]
    return {"q": q, "keyframes": [q[k] for k in nearest]}


def _ending(handle: MoveHandle) -> str:
    motion = f"Motion {handle.motion_number}"
    try:
        summary = handle.wait()
    except OrientdError as error:
        return f"{motion}: {error}"
    reason = "" if summary.outcome == pb.OUTCOME_DONE else f": {summary.text or 'no reason given'}"
    return f"{motion} {_OUTCOMES[summary.outcome]}{reason}."
