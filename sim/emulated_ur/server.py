"""The emulated controller on its sockets: one thread, one loop, a tick every 2 ms.

The loop sleeps in ``select`` until a client writes or the next tick is due.  Ticks have absolute
deadlines on the monotonic clock, so they do not drift.  Late ones are caught up, up to a quarter of
a second. Beyond that, the controller's time has stood still for a while.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import select
import signal
import socket
import time
from collections.abc import Callable
from functools import partial

from emulated_ur import dashboard, faults
from emulated_ur.arm import Behaviour
from emulated_ur.connection import ClientConnection, Delays, LineTalk, ScriptTalk, Talk
from emulated_ur.controller import Controller
from emulated_ur.process import FAULTS_PORT
from emulated_ur.recording import Recording
from emulated_ur.rtde import RtdeSession, WireError
from emulated_ur.variables import Value

PORTS = {
    "faults": FAULTS_PORT,
    "dashboard": 29999,
    "primary": 30001,
    "secondary": 30002,
    "script": 30003,
    "rtde": 30004,
    "primary read-only": 30011,
    "secondary read-only": 30012,
    "interpreter": 30020,
}

TICK_NS = 2_000_000
_PRIORITY = 10
_MOST_CLIENTS = 64
"""More would not fit into a ``select``."""
_LONGEST_CATCH_UP_NS = 250_000_000


class Server:
    """One robot on one address.

    Args:
        host: an address of this machine; every robot has its own.
        behaviour: differences between robots.

    Attributes:
        robot: the controller.
        recording: record of commands and motion.
        is_silent: whether RTDE clients get no data packages.
        delays: delays of bytes, by kind of connection.
        stalls: number of times that ticks were too late to be caught up.

    Raises:
        OSError: a port of *host* is taken, or *host* is no address of this machine.
    """

    def __init__(self, host: str, behaviour: Behaviour | None = None) -> None:
        self.robot: Controller = Controller(behaviour)
        self.recording = Recording()
        self.is_silent = False
        self.stalls = 0
        self.delays = {kind: Delays() for kind in PORTS}
        self._frozen_until_ns = 0.0
        self._is_ending = False
        self._owners: dict[str, RtdeSession] = {}
        self._connections: list[ClientConnection] = []
        self._listeners: dict[str, socket.socket] = {}
        try:
            if not host:  # would be every address of the machine
                raise OSError(errno.EADDRNOTAVAIL, "it must be an address of this machine")
            behaviour = self.robot.behaviour
            lacking = {"dashboard": not behaviour.has_dashboard,
                       "interpreter": not behaviour.has_interpreter}  # fmt: skip
            for kind, port in PORTS.items():
                if not lacking.get(kind):
                    self._listeners[kind] = socket.create_server((host, port), backlog=16)
                    self._listeners[kind].setblocking(False)
        except OSError:
            self.close()
            raise

    @property
    def ports(self) -> str:
        """The open ports, by their protocol."""
        return ", ".join(f"{kind} {PORTS[kind]}" for kind in self._listeners)

    @property
    def sessions(self) -> list[RtdeSession]:
        """The protocols of the RTDE clients."""
        return [one.talk for one in self._connections if isinstance(one.talk, RtdeSession)]

    # The loop.

    def run(self, lifeline: int | None = None) -> None:
        """Serve until :meth:`end` is called, or until the descriptor *lifeline* is closed."""
        deadline_ns = time.monotonic_ns() + TICK_NS
        while not self._is_ending:
            now_ns = time.monotonic_ns()
            self._poll(max(0, deadline_ns - now_ns) / 1e9, lifeline)
            now_ns = time.monotonic_ns()
            if now_ns < self._frozen_until_ns:
                deadline_ns = now_ns + TICK_NS
                continue
            if now_ns < deadline_ns:
                continue
            # Bytes that have arrived by the deadline belong to this tick.
            self._poll(0.0, lifeline)
            self._tick()
            deadline_ns += TICK_NS
            if now_ns - deadline_ns > _LONGEST_CATCH_UP_NS:
                self.stalls += 1
                deadline_ns = now_ns + TICK_NS

    def end(self) -> None:
        """Make :meth:`run` return; safe to call from a signal handler."""
        self._is_ending = True

    def close(self) -> None:
        """Close every socket."""
        for connection in self._connections:
            connection.close()
        for listener in self._listeners.values():
            listener.close()
        self._connections.clear()
        self._listeners.clear()

    def _poll(self, timeout: float, lifeline: int | None) -> None:
        is_frozen = time.monotonic_ns() < self._frozen_until_ns
        listeners = [kind for kind in self._listeners if kind == "faults" or not is_frozen]
        clients = [one for one in self._connections if one.kind == "faults" or not is_frozen]
        readable: list[socket.socket | int] = [self._listeners[kind] for kind in listeners]
        readable += [one.sock for one in clients]
        if lifeline is not None:
            readable.append(lifeline)
        ready, _, _ = select.select(readable, [], [], timeout)
        if lifeline is not None and lifeline in ready and not os.read(lifeline, 4096):
            self.end()
        for kind in listeners:
            if self._listeners[kind] in ready:
                self._accept(kind)
        for one in clients:
            if one.sock in ready:
                one.receive()
            self._serve(one)
        self._forget(lambda one: one.is_closed)

    def _tick(self) -> None:
        robot = self.robot
        robot.tick()
        events = [robot.events.popleft() for _ in range(len(robot.events))]
        for one in self._connections:
            for event in events:
                one.send(one.talk.tell(event))
            if not (self.is_silent and one.kind == "rtde"):
                one.send(one.talk.tick())
            one.flush()
        self.recording.add_tick(robot)

    # Clients.

    def _accept(self, kind: str) -> None:
        try:
            sock, _ = self._listeners[kind].accept()
        except OSError:
            return
        if len(self._connections) >= _MOST_CLIENTS:
            sock.close()
            return
        connection = ClientConnection(sock, kind, self._talk(kind), self.delays[kind])
        self._connections.append(connection)
        connection.send(connection.talk.greeting)

    def _talk(self, kind: str) -> Talk:
        if kind == "rtde":
            return RtdeSession(self.robot, self._owners, self._write)
        if kind == "faults":
            return LineTalk(partial(faults.carry_out, self))
        if kind == "dashboard":
            return LineTalk(partial(dashboard.reply, self.robot), dashboard.WELCOME)
        if kind == "interpreter":
            return LineTalk(self.robot.interpret)
        return ScriptTalk(self.robot, kind)

    def _serve(self, connection: ClientConnection) -> None:
        chunk = connection.take()
        if connection.is_closed or not chunk:
            connection.flush()
            return
        try:
            answer = connection.talk.feed(chunk)
        except WireError:
            connection.is_closed = True
            return
        connection.send(answer)
        if connection.kind == "dashboard" and answer.endswith(f"{dashboard.GOODBYE}\n".encode()):
            connection.is_closed = True

    def _forget(self, applies: Callable[[ClientConnection], bool]) -> int:
        """Close the connections that *applies* selects, and return how many."""
        gone = [one for one in self._connections if applies(one)]
        for one in gone:
            self._connections.remove(one)
            one.close()
        return len(gone)

    def _write(self, names: tuple[str, ...], values: list[Value]) -> None:
        self.robot.write_package(names, values)
        self.recording.add_package(self.robot.ticks, names, values)

    # Faults.

    def freeze(self, seconds: float = math.inf) -> None:
        """Freeze, like a crashed controller whose machine still runs."""
        self._frozen_until_ns = time.monotonic_ns() + seconds * 1e9

    def thaw(self) -> None:
        """Resume a frozen controller."""
        self._frozen_until_ns = 0.0

    def drop(self, what: str) -> int:
        """Close connections and return how many.

        Raises:
            ValueError: *what* is not a known kind.
        """
        known = ("all", "rtde", "control", "receive", "dashboard", "script", "primary")
        if what not in known:
            raise ValueError(f"drop must be one of {', '.join(known)}, got {what}")
        holders = list(self._owners.values())

        def is_meant(one: ClientConnection) -> bool:
            role = "" if one.kind != "rtde" else "control" if one.talk in holders else "receive"
            return one.kind != "faults" and what in ("all", one.kind, role)

        return self._forget(is_meant)

    def send_garbage(self, count: int, byte: int = 0) -> None:
        """Send invalid bytes to every RTDE client."""
        for one in self._connections:
            if one.kind == "rtde":
                one.send(bytes([byte]) * count)


def _keep_time() -> str:
    """Request real-time scheduling, as a controller has; return the result."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    except OSError:
        return "at normal priority: on a busy machine it may be late"
    return f"SCHED_FIFO {_PRIORITY}"


def serve(host: str, behaviour: Behaviour | None = None, *, lifeline: int | None = None) -> None:
    """Run an emulated robot until SIGINT or SIGTERM; print a line when it is ready.

    Args:
        host: an address of this machine.
        behaviour: differences between robots.
        lifeline: a descriptor; the robot ends when it closes, such as a pipe from the parent.

    Raises:
        OSError: its ports are not available.
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
