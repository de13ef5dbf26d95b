"""The emulated controller on its sockets: one thread, one loop, a tick every 2 ms.

The loop sleeps in ``select`` until a client writes or the next tick is due.  Ticks have absolute
deadlines on the monotonic clock, so that they do not drift; late ones are made up for, up to a
quarter of a second, beyond which the controller's time has stood still for a while.
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import select
import signal
import socket
import time
from collections.abc import Sequence
from pathlib import Path

from emulated_ur import dashboard, faults, primary
from emulated_ur.arm import Behaviour
from emulated_ur.connection import ClientConnection
from emulated_ur.controller import Controller
from emulated_ur.process import FAULTS_PORT
from emulated_ur.recording import SetpointRecording, servo_target
from emulated_ur.session import ClientSession
from emulated_ur.urscript import Splitter
from emulated_ur.wire import Value, WireError

RTDE_PORT = 30004
DASHBOARD_PORT = 29999
SCRIPT_PORT = 30003
PRIMARY_PORT = 30001
SECONDARY_PORT = 30002
_SCRIPT_KINDS = ("script", "primary", "secondary")

TICK_NS = 2_000_000
_PRIORITY = 10
_LONGEST_CATCH_UP_NS = 250_000_000


class Server:
    """One robot on one address.

    Args:
        host: an address of this machine; every robot has its own.
        behaviour: what differs between robots.

    Raises:
        OSError: a port of *host* is taken, or *host* is no address of this machine.
    """

    def __init__(self, host: str, behaviour: Behaviour | None = None) -> None:
        self.robot: Controller = Controller(behaviour)
        self.robot.on_message = self._broadcast
        self.recording = SetpointRecording()
        self.is_silent = False
        self.delay_out_ns = 0
        self.delay_in_ns = 0
        self.setpoints = 0
        self.overwritten = 0
        self.stalls = 0
        # How long the dashboard server takes for each byte of an answer.
        self.dashboard_pace_ns = 0
        self._setpoints_this_tick = 0
        self._frozen_until: float | None = None
        self._is_ending = False
        self._lifeline: int | None = None
        self._owners: dict[str, ClientSession] = {}
        self._sessions: dict[ClientConnection, ClientSession] = {}
        self._texts: dict[ClientConnection, bytearray] = {}
        self._splitters: dict[ClientConnection, Splitter] = {}
        self._informed: set[ClientConnection] = set()
        self._connections: dict[int, ClientConnection] = {}
        self._listeners: dict[int, tuple[socket.socket, str]] = {}
        ports = {
            RTDE_PORT: "rtde", PRIMARY_PORT: "primary", SECONDARY_PORT: "secondary",
            SCRIPT_PORT: "script", FAULTS_PORT: "faults",
        }  # fmt: skip
        if self.robot.behaviour.has_dashboard:
            ports[DASHBOARD_PORT] = "dashboard"
        try:
            if not host:  # would be every address of the machine
                raise OSError(errno.EADDRNOTAVAIL, "it must be an address of this machine")
            for port, kind in ports.items():
                listener = socket.create_server((host, port), backlog=16)
                listener.setblocking(False)
                self._listeners[listener.fileno()] = (listener, kind)
        except OSError:
            self.close()
            raise

    @property
    def ports(self) -> str:
        """The ports that are open, by what speaks there."""
        return ", ".join(f"{kind} {one.getsockname()[1]}" for one, kind in self._listeners.values())

    # The loop.

    def run(self, lifeline: int | None = None) -> None:
        """Serve until :meth:`end` is called, or until the descriptor *lifeline* is at its end."""
        self._lifeline = lifeline
        deadline_ns = time.monotonic_ns() + TICK_NS
        while not self._is_ending:
            now_ns = time.monotonic_ns()
            self._poll(max(0, deadline_ns - now_ns) / 1e9)
            now_ns = time.monotonic_ns()
            if self._is_frozen(now_ns):
                deadline_ns = now_ns + TICK_NS
                continue
            if now_ns < deadline_ns:
                continue
            # What has arrived by the deadline belongs to this tick.
            self._poll(0.0)
            self._tick(now_ns)
            deadline_ns += TICK_NS
            if now_ns - deadline_ns > _LONGEST_CATCH_UP_NS:
                self.stalls += 1
                deadline_ns = now_ns + TICK_NS

    def end(self) -> None:
        """Make :meth:`run` return; safe to call from a signal handler."""
        self._is_ending = True

    def close(self) -> None:
        """Close every socket."""
        for connection in list(self._connections.values()):
            connection.close()
        for listener, _ in self._listeners.values():
            listener.close()
        self._connections.clear()
        self._listeners.clear()

    def _poll(self, timeout: float) -> None:
        is_frozen = self._frozen_until is not None
        readable = [
            fd for fd, (_, kind) in self._listeners.items() if kind == "faults" or not is_frozen
        ]
        readable += [
            fd for fd, link in self._connections.items() if link.kind == "faults" or not is_frozen
        ]
        if self._lifeline is not None:
            readable.append(self._lifeline)
        ready, _, _ = select.select(readable, [], [], timeout)
        now_ns = time.monotonic_ns()
        if self._lifeline in ready and not os.read(self._lifeline, 4096):
            self.end()
        for fd in ready:
            if fd in self._listeners:
                self._accept(fd)
            elif fd in self._connections:
                connection = self._connections[fd]
                connection.receive(now_ns, 0 if connection.kind == "faults" else self.delay_in_ns)
        for connection in list(self._connections.values()):
            if connection.kind == "faults" or not is_frozen:
                self._serve(connection, now_ns)

    def _tick(self, now_ns: int) -> None:
        robot = self.robot
        robot.tick()
        self.overwritten += max(0, self._setpoints_this_tick - 1)
        self._setpoints_this_tick = 0
        for connection, session in self._sessions.items():
            if not self.is_silent:
                connection.send(session.outputs(), now_ns, self.delay_out_ns)
            connection.flush(now_ns)
        while robot.events:
            event = primary.event_message(robot, robot.events.popleft())
            for connection in self._connections.values():
                if connection.kind == "primary":
                    connection.send(event, now_ns)
        if robot.ticks % primary.EVERY_TICKS == 0:
            self._tell_state(now_ns)
        if self.recording.is_on:
            self.recording.add_arm(
                now_ns, robot.ticks, robot.tool.pose("target_TCP_pose"),
                robot.tool.pose("actual_TCP_pose"), robot.arm.actual_q,
            )  # fmt: skip

    def _tell_state(self, now_ns: int) -> None:
        for connection in self._connections.values():
            if connection.kind in _SCRIPT_KINDS[1:]:
                is_first = connection not in self._informed
                self._informed.add(connection)
                connection.send(primary.state_message(self.robot, is_first=is_first), now_ns)

    # Clients.

    def _accept(self, fd: int) -> None:
        listener, kind = self._listeners[fd]
        try:
            sock, _ = listener.accept()
        except OSError:
            return
        connection = ClientConnection(sock, kind)
        self._connections[sock.fileno()] = connection
        if kind == "rtde":
            self._sessions[connection] = ClientSession(self.robot, self._owners, self._write)
        else:
            self._texts[connection] = bytearray()
        if kind in _SCRIPT_KINDS:
            self._splitters[connection] = Splitter()
        if kind == "dashboard":
            self._answer(connection, dashboard.WELCOME, time.monotonic_ns())
        elif kind in _SCRIPT_KINDS[1:]:
            connection.send(primary.version_message(self.robot), time.monotonic_ns())

    def _serve(self, connection: ClientConnection, now_ns: int) -> None:
        if connection.sock.fileno() < 0:
            return  # dropped a moment ago, by a fault that another connection asked for
        chunk = connection.take(now_ns)
        if chunk:
            if connection.kind == "rtde":
                try:
                    answer = self._sessions[connection].feed(chunk)
                    connection.send(answer, now_ns, self.delay_out_ns)
                except WireError:
                    connection.is_closed = True
            else:
                self._texts[connection] += chunk
                self._read_text(connection, now_ns)
        connection.flush(now_ns)
        if connection.is_closed:
            self._forget(connection)

    def _read_text(self, connection: ClientConnection, now_ns: int) -> None:
        text = self._texts[connection]
        if connection.kind in _SCRIPT_KINDS:
            for program in self._splitters[connection].feed(bytes(text)):
                self.robot.upload(program)
            text.clear()
            return
        while (at := text.find(b"\n")) >= 0:
            line = bytes(text[:at]).decode("utf-8", "replace")
            del text[: at + 1]
            if connection.kind == "faults":
                answer = faults.carry_out(self, line)
            else:
                answer = dashboard.reply(self.robot, line)
            self._answer(connection, answer, now_ns)
            if answer == dashboard.GOODBYE:
                connection.is_closed = True

    def _answer(self, connection: ClientConnection, line: str, now_ns: int) -> None:
        """Send a line, byte by byte where the dashboard server is to be slow."""
        pace_ns = self.dashboard_pace_ns if connection.kind == "dashboard" else 0
        encoded = line.encode() + b"\n"
        if not pace_ns:
            connection.send(encoded, now_ns)
            return
        for number, byte in enumerate(encoded):
            connection.send(bytes([byte]), now_ns, (number + 1) * pace_ns)

    def _forget(self, connection: ClientConnection) -> None:
        fd = connection.sock.fileno()
        self._connections.pop(fd, None)
        self._texts.pop(connection, None)
        splitter = self._splitters.pop(connection, None)
        if splitter is not None and splitter.unfinished:
            self.robot.say(f"program refused: it has no end: {splitter.unfinished[:80]!r}")
        self._informed.discard(connection)
        session = self._sessions.pop(connection, None)
        if session is not None:
            session.close()
        connection.close()

    def _write(self, names: tuple[str, ...], values: list[Value]) -> None:
        self.robot.write_package(names, values)
        target = servo_target(names, values)
        if target is not None:
            self.setpoints += 1
            self._setpoints_this_tick += 1
            if self.recording.is_on:
                self.recording.add_setpoint(time.monotonic_ns(), self.robot.ticks, target)

    def _broadcast(self, text: str) -> None:
        now_ns = time.monotonic_ns()
        for connection, session in self._sessions.items():
            connection.send(session.message(text), now_ns, self.delay_out_ns)

    # Faults.

    def _is_frozen(self, now_ns: int) -> bool:
        if self._frozen_until is not None and now_ns >= self._frozen_until:
            self._frozen_until = None
        return self._frozen_until is not None

    def freeze(self, seconds: float | None) -> None:
        """Stand still, as a controller that has crashed but whose machine still runs."""
        self._frozen_until = math.inf if seconds is None else time.monotonic_ns() + seconds * 1e9

    def thaw(self) -> None:
        """Go on where the controller stood still."""
        self._frozen_until = None

    def drop(self, what: str) -> int:
        """Close connections and return how many.

        Raises:
            ValueError: *what* names none.
        """
        known = ("all", "rtde", "control", "receive", "dashboard", "script", "primary")
        if what not in known:
            raise ValueError(f"drop must be one of {', '.join(known)}, got {what}")
        holders = set(self._owners.values())
        dropped = 0
        for connection in list(self._connections.values()):
            session = self._sessions.get(connection)
            role = "" if session is None else "control" if session in holders else "receive"
            if connection.kind != "faults" and what in ("all", connection.kind, role):
                self._forget(connection)
                dropped += 1
        return dropped

    def send_garbage(self, count: int, byte: int = 0) -> None:
        """Send bytes that are no package to every RTDE client."""
        for connection in self._sessions:
            connection.send(bytes([byte]) * count, time.monotonic_ns())

    def die(self) -> None:
        """End as a process that was killed."""
        os.kill(os.getpid(), signal.SIGKILL)

    def record(self, words: Sequence[str]) -> None:
        """Switch the recording, or write it.

        Raises:
            ValueError: the words are none of those allowed.
        """
        if words[:1] == ["write"] and len(words) == 2:
            self.recording.write(Path(words[1]))
        elif words in (["on"], ["off"]):
            self.recording.is_on = words == ["on"]
        elif words == ["clear"]:
            self.recording.clear()
        else:
            raise ValueError(f"record must be on, off, clear or write STEM, got {words}")

    def describe(self) -> str:
        """Return everything worth knowing as one line of JSON."""
        robot = self.robot
        return json.dumps(
            {
                "ticks": robot.ticks, "timestamp": robot.timestamp,
                "robot_mode": robot.robot_mode.name, "safety_mode": robot.safety_mode.name,
                "safety_status": robot.safety_status.name, "popup": robot.popup,
                "digital_outputs": robot.digital_outputs,
                "runtime_state": robot.runtime_state.name, "is_remote": robot.is_remote,
                "speed_slider": robot.speed_slider, "speed_scaling": robot.speed_scaling,
                "actual_q": robot.arm.actual_q, "target_q": robot.arm.target_q,
                "actual_pose": robot.tool.pose("actual_TCP_pose"), "tcp_offset": robot.tool.offset,
                "payload": robot.payload, "payload_cog": robot.payload_cog,
                "servoing": robot.arm.servoing,
                "is_still": robot.arm.is_still, "setpoints": self.setpoints,
                "overwritten": self.overwritten, "stalls": self.stalls,
                "malformed": sum(session.malformed for session in self._sessions.values()),
                "rtde_clients": len(self._sessions), "log": robot.log[-20:],
                "told": list(robot.told)[-20:],
            }
        )  # fmt: skip


def _keep_time() -> str:
    """Ask for real time, as a controller has; return what came of it."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except OSError:
        return "at normal priority: on a busy machine it may be late"
    return f"SCHED_FIFO {_PRIORITY}"


def serve(host: str, behaviour: Behaviour | None = None, *, lifeline: int | None = None) -> None:
    """Run an emulated robot until SIGINT or SIGTERM; print a line when it can be used.

    Args:
        host: an address of this machine.
        behaviour: what differs between robots.
        lifeline: a descriptor whose end is the robot's too: a pipe from whoever started it.

    Raises:
        OSError: its ports cannot be had.
    """
    server = Server(host, behaviour)
    scheduling = _keep_time()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: server.end())
    os.write(
        1,
        f"ready: {server.robot.behaviour.model.name} at {host} ({server.ports}; "
        f"{scheduling})\n".encode(),
    )
    with contextlib.closing(server):
        server.run(lifeline)
