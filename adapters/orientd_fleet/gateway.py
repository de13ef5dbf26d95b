"""The gateway: it stands for one daemon in its cell.

It is a client of the daemon.  It declares the daemon's presence, publishes its state, tells its
clock, and stops its devices as ``orientd stop`` does: directly to the servos, even while the daemon
hangs.  A connection to the control socket shows whether the daemon is there.  It carries no call,
and the kernel closes it when the daemon ends.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import queue
import select
import signal
import socket as sockets
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from orientd.client.robot import connect
from orientd.client.stop_call import ask_to_stop
from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd_fleet.access import address_of, member_configuration, open_session
from orientd_fleet.keys import TIME_BYTES, key_of, name_of

if TYPE_CHECKING:
    import zenoh

    from orientd_fleet.settings import MemberSettings

_log = logging.getLogger(__name__)

ANSWER = 1.0
"""How long the daemon may take to report its state, s."""

_AGAIN = 1.0
"""Time after which something that has failed is tried again, s."""

_LOOK = 0.1
"""Least interval between two connections to the daemon, or two looks for a client, s."""

_FIRST_PAUSE, _LONGEST_PAUSE = 1.0, 30.0
"""Shortest and longest time before the cell is joined again with settings that failed, s."""


class Gateway:
    """One daemon's place in its cell; a context manager."""

    def __init__(
        self,
        settings: MemberSettings,
        socket: Path,
        *,
        on_start: Callable[[], object] = lambda: None,
    ) -> None:
        """Join the cell, for which a client of a router waits until there is the router.

        Args:
            settings: of the daemon.
            socket: its control socket.
            on_start: called in a thread when a daemon has started that was not there before.

        Raises:
            OrientdError: Zenoh is not installed, it cannot listen, or the settings do not suffice.
        """
        fleet = settings.fleet
        self._cell, self._name, self._period = fleet.cell, fleet.name, 1.0 / fleet.state_hz
        self._has_certificates = fleet.is_tls
        self._socket, self._address = socket, address_of(settings, socket)
        self._on_start = on_start
        self._session = _open(member_configuration(settings))
        import zenoh

        self._zenoh = zenoh
        self._state = self._session.declare_publisher(
            self._key("state"), congestion_control=zenoh.CongestionControl.DROP
        )
        self._present: list[Any] = []
        self._closing = threading.Event()
        self._closed, self._is_closing = sockets.socketpair()
        self._threads = [
            threading.Thread(
                target=self._keep, args=(name, work), name=f"orientd fleet {name}", daemon=True
            )
            for name, work in (("presence", self._keep_presence), ("state", self._publish))
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the cell."""
        self._closing.set()
        self._is_closing.close()
        for thread in self._threads:
            thread.join()
        self._session.close()  # type: ignore[no-untyped-call] # Zenoh's stub
        self._closed.close()

    def _key(self, what: str, name: str = "") -> str:
        return key_of(self._cell, self._name, what, name)

    def _keep(self, name: str, work: Callable[[], None]) -> None:
        """Do the work of a thread until the gateway closes, again after an unexpected error."""
        while not self._closing.is_set():
            try:
                work()
            except Exception:  # noqa: BLE001 - a defect must not end the presence for good
                _log.exception("fleet: the %s fails, and is tried again", name)
                self._closing.wait(_AGAIN)

    # Presence

    def _keep_presence(self) -> None:
        """Be present in the cell for as long as the daemon is there."""
        problem, has_restarted = "", False
        while not self._closing.is_set():
            looked = time.monotonic()
            try:
                with sockets.socket(sockets.AF_UNIX) as daemon:
                    daemon.setblocking(False)  # a daemon that hangs must not hold up this thread
                    daemon.connect(str(self._socket))
                    self._appear()
                    if has_restarted:
                        self._on_start()
                    problem, has_restarted = "", True
                    self._await_end(daemon)
            except BlockingIOError:  # a daemon that hangs: it accepts no more connections
                self._appear()
            except OSError as error:
                has_restarted = True
                self._disappear()
                if problem != (problem := error.strerror or str(error)):
                    _log.warning("fleet: waits for a daemon at %s: %s", self._socket, problem)
            self._closing.wait(max(0.0, looked + _LOOK - time.monotonic()))
        self._disappear()

    def _await_end(self, daemon: sockets.socket) -> None:
        """Wait until the daemon has closed a connection, or the gateway closes."""
        watched = select.poll()
        watched.register(daemon, select.POLLRDHUP)
        watched.register(self._closed, select.POLLRDHUP)
        watched.poll()

    def _appear(self) -> None:
        """Declare that the daemon is there, unless that is declared already."""
        if self._present:
            return
        zenoh, session = self._zenoh, self._session
        self._present = [
            session.declare_queryable(self._key("stop", "*"), self._stop),
            # In Zenoh's own thread: a thread of ours would add its delay to the clock's.
            session.declare_queryable(
                self._key("clock"), zenoh.handlers.Callback(self._tell_time, indirect=False)
            ),
            session.liveliness().declare_token(self._key("alive", self._address)),
        ]
        _log.info("fleet: %s is in cell %s", self._name, self._cell)

    def _disappear(self) -> None:
        """Withdraw what was declared of the daemon: the presence first."""
        present, self._present = self._present, []
        for declared in reversed(present):
            declared.undeclare()

    # State

    def _is_watched(self) -> bool:
        """Return whether the daemon is there and a client wants its state."""
        status: Any = self._state.matching_status  # no bool, as Zenoh's stub has it
        return bool(self._present) and bool(status.matching)

    def _publish(self) -> None:
        """Publish the daemon's state at its rate while a client wants it."""
        problem = ""
        while not self._closing.wait(_LOOK):
            if not self._is_watched():
                continue
            try:
                with connect(self._socket, timeout=ANSWER) as robot:
                    due = time.monotonic()
                    while self._is_watched() and not self._closing.is_set():
                        now = time.monotonic_ns()
                        report = robot.state()
                        state = pb.GetStateResponse(
                            daemon=report.daemon, devices=report.devices.values()
                        )
                        self._state.put(
                            state.SerializeToString(),
                            attachment=now.to_bytes(TIME_BYTES, "little"),
                        )
                        problem = ""
                        due = max(due + self._period, time.monotonic())
                        self._closing.wait(due - time.monotonic())
            except OrientdError as error:
                if problem != (problem := str(error)):
                    _log.warning("fleet: no state: %s", problem)
                self._closing.wait(_AGAIN)

    # Stop and clock

    def _stop(self, query: zenoh.Query) -> None:
        """Stop every device, or halt them; the answer says what each was doing."""
        caller = name_of(str(query.key_expr))
        kind = "halt" if query.parameters.get("kind") == "halt" else "stop"
        try:
            answer: dict[str, Any] = {"devices": ask_to_stop(self._socket, kind)}
            if answer["devices"] is None:
                answer = {"error": "no servo takes stops there"}
        except OrientdError as error:
            answer = {"error": str(error)}
        answer["time_ns"] = time.monotonic_ns()
        query.reply(self._key("stop", caller), json.dumps(answer).encode(), express=True)
        query.drop()  # type: ignore[no-untyped-call] # Zenoh's stub
        who = f"certificate:{caller}" if self._has_certificates else f"user:{os.geteuid()}"
        stopped = ", ".join(one["name"] for one in answer.get("devices", ()))
        _log.info("fleet: %s by %s: %s", kind, who, stopped or answer.get("error", "no device"))

    def _tell_time(self, query: zenoh.Query) -> None:
        now = time.monotonic_ns()
        query.reply(self._key("clock"), now.to_bytes(TIME_BYTES, "little"), express=True)
        query.drop()  # type: ignore[no-untyped-call] # Zenoh's stub


def serve(read: Callable[[], MemberSettings], socket: Path, on_ready: Callable[[], object]) -> None:
    """Stand for the daemon at *socket* in its cell until Ctrl-C or SIGTERM.

    SIGHUP, and every start of the daemon, has the settings and their files read again.

    Args:
        read: returns the daemon's settings as they are now.
        socket: the daemon's control socket.
        on_ready: called once the cell is joined.

    Raises:
        OrientdError: the settings do not suffice, or the cell cannot be joined.
    """
    asked: queue.SimpleQueue[None] = queue.SimpleQueue()
    signal.signal(signal.SIGHUP, lambda *_: asked.put(None))
    settings, has_joined, pause = read(), False, _FIRST_PAUSE
    while True:
        try:
            # Zenoh reads the files when it joins: they may have changed since.
            joined_with = _fingerprint(settings, socket)
            with Gateway(settings, socket, on_start=lambda: asked.put(None)):
                if not has_joined:
                    on_ready()
                has_joined, pause = True, _FIRST_PAUSE
                settings = _await_change(read, socket, joined_with, asked)
        except OrientdError as error:
            if not has_joined:
                raise
            _log.error("fleet: %s; tries again in %g s", error, pause)
            with contextlib.suppress(queue.Empty, OrientdError):
                asked.get(timeout=pause)
                settings = read()
            pause = min(2.0 * pause, _LONGEST_PAUSE)


def _await_change(
    read: Callable[[], MemberSettings],
    socket: Path,
    before: tuple[Any, ...],
    asked: queue.SimpleQueue[None],
) -> MemberSettings:
    """Wait until a reload finds other settings or files than *before*; return the settings."""
    while True:
        asked.get()
        try:
            found = read()
            if _fingerprint(found, socket) != before:
                _log.info("fleet: reload: joins the cell again")
                return found
            _log.info("fleet: reload: nothing has changed")
        except OrientdError as error:
            _log.error("fleet: reload: nothing changed: %s", error)


def _fingerprint(settings: MemberSettings, socket: Path) -> tuple[Any, ...]:
    """Return everything that a gateway goes by, with digests of its certificate, key and CA.

    Raises:
        OrientdError: the settings do not suffice.
    """
    zenoh = member_configuration(settings)
    tls = zenoh["transport"]["link"].get("tls", {})
    digests = []
    for name in ("root_ca_certificate", "listen_certificate", "listen_private_key"):
        with contextlib.suppress(KeyError, OSError):
            digests.append(hashlib.sha256(Path(tls[name]).read_bytes()).hexdigest())
    return settings.fleet, zenoh, address_of(settings, socket), digests


def _open(configuration: dict[str, Any]) -> zenoh.Session:
    """Open a session in a thread: signals interrupt the wait for a router, which may be endless.

    Raises:
        OrientdError: see :func:`~orientd_fleet.access.open_session`.
    """
    opened: Future[zenoh.Session] = Future()

    def work() -> None:
        try:
            opened.set_result(open_session(configuration))
        except OrientdError as error:
            opened.set_exception(error)

    threading.Thread(target=work, name="orientd fleet session", daemon=True).start()
    return opened.result()
