"""Connect the daemon to its cell: start the gateway, publish the state, record its stops."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import logging
import os
import socket
import sys
import time
from collections.abc import Awaitable, Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from orientd.config import Settings
from orientd.daemon.access import AuditLog
from orientd.daemon.workers import LoopErrors
from orientd.errors import ConfigError, OrientdError
from orientd.fleet import PACKET_BYTES, TIME_BYTES, address_of, member_configuration
from orientd.protocol import control_pb2 as pb

_log = logging.getLogger(__name__)

_AGAIN, _SELDOM = 1.0, 30.0
"""Shortest and longest time before the daemon restarts a gateway that has ended, s."""

_END = 2.0
"""How long the gateway may take to end, s."""

State = Callable[[], Awaitable[pb.GetStateResponse]]
"""Returns the daemon and its devices as they are now."""


class FleetLink:
    """A gateway for as long as the daemon runs."""

    def __init__(self, settings: Settings, path: Path, *, audit: AuditLog, state: State) -> None:
        """Prepare to join the cell of *settings*.

        Args:
            settings: of the daemon; they have the table ``[fleet]``.
            path: of the control socket.
            audit: records stops.
            state: of the daemon.

        Raises:
            ConfigError: Zenoh is not installed, or the settings do not suffice.
            DaemonError: the folder of a Unix socket is open to others.
        """
        if settings.fleet is None or find_spec("zenoh") is None:
            problem = "needs `eclipse-zenoh`: pip install 'orientd-motion[fleet]'"
            raise ConfigError(f"fleet: {problem}")
        self._initial, self._fleet, self._path = settings, settings.fleet, path
        self._audit, self._state = audit, state
        self._watched = asyncio.Event()
        self._link: socket.socket | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._begin = self.configured(settings)

    def configured(self, settings: Settings) -> dict[str, Any]:
        """Return the gateway's configuration, with the roles and certificates of *settings*.

        Raises:
            ConfigError: the settings do not suffice.
            DaemonError: the folder of a Unix socket is open to others.
        """
        # The place in the cell is that of the daemon's start.
        initial = self._initial
        tcp = settings.tcp or initial.tcp
        settings = settings.model_copy(update={"fleet": self._fleet, "tcp": tcp})
        zenoh = member_configuration(settings)
        return {
            "cell": self._fleet.cell,
            "name": self._fleet.name,
            "socket": str(self._path),
            "address": address_of(initial, self._path),
            "zenoh": zenoh,
            # Only compared: Zenoh reads a renewed file when it starts.
            "files": _digests(zenoh["transport"]["link"].get("tls", {})),
        }

    def start(self) -> None:
        """Join the cell, and join again whenever the gateway has ended."""
        self._tasks = [asyncio.create_task(work) for work in (self._keep(), self._publish())]

    def change(self, begin: dict[str, Any]) -> None:
        """Apply what :meth:`configured` returned; another configuration needs a new gateway."""
        if begin != self._begin and self._link is not None:
            self._link.shutdown(socket.SHUT_RDWR)
        self._begin = begin

    async def close(self) -> None:
        """Leave the cell."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _keep(self) -> None:
        """Run gateways, one after the other."""
        pause = 0.5 * _AGAIN
        errors = LoopErrors(_log, "fleet: the gateway fails, and is started again")
        while True:
            began = time.monotonic()
            with errors.logged():
                try:
                    await self._run_gateway()
                except OSError as error:
                    _log.error("fleet: the gateway: %s", error)
            lasted = time.monotonic() - began > _SELDOM
            pause = _AGAIN if lasted else min(2.0 * pause, _SELDOM)
            await asyncio.sleep(pause)

    async def _run_gateway(self) -> None:
        """Run a gateway until it ends."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with ours:
            with theirs:
                process = await asyncio.create_subprocess_exec(
                    sys.executable, "-m", "orientd.fleet.gateway", str(theirs.fileno()),
                    stdin=asyncio.subprocess.DEVNULL,
                    pass_fds=(theirs.fileno(),),
                    process_group=0,
                    cwd="/",
                )  # fmt: skip
            try:
                ours.setblocking(False)
                ours.send(json.dumps(self._begin).encode())
                self._link = ours
                while packet := await asyncio.get_running_loop().sock_recv(ours, PACKET_BYTES):
                    self._take(json.loads(packet))
                _log.warning("fleet: the gateway has ended; it is started again")
            finally:
                self._link = None
                self._watched.clear()
                ours.shutdown(socket.SHUT_RDWR)
                await _end(process)

    def _take(self, told: Mapping[str, Any]) -> None:
        """Take one packet of the gateway."""
        if "watched" in told:
            self._watched.set() if told["watched"] else self._watched.clear()
        elif "stopped" in told:
            caller = (
                f"certificate:{told['caller']}" if self._fleet.is_tls else f"user:{os.geteuid()}"
            )
            self._audit.record(
                event="stopped",
                origin="fleet",
                identity=caller,
                kind=told["stopped"],
                devices=[one["name"] for one in told.get("devices") or ()],
            )
        elif "joined" in told:
            _log.info("fleet: joined cell %s as %s", self._fleet.cell, self._fleet.name)
        elif "failed" in told:
            _log.error("fleet: %s", told["failed"])

    async def _publish(self) -> None:
        """Publish the state at its rate while a client watches."""
        due, errors = 0.0, LoopErrors(_log, "fleet: the state is not published")
        while True:
            await self._watched.wait()
            now = time.monotonic_ns()
            with errors.logged(), contextlib.suppress(OSError):
                # A gateway that is busy, or has ended, misses this state.
                try:
                    state = (await self._state()).SerializeToString()
                    if self._link is not None:
                        self._link.send(now.to_bytes(TIME_BYTES, "little") + state)
                except OrientdError as error:
                    _log.warning("fleet: no state: %s", error)
            due = max(due + 1.0 / self._fleet.state_hz, time.monotonic())
            await asyncio.sleep(due - time.monotonic())


async def _end(process: asyncio.subprocess.Process) -> None:
    """Wait until the gateway has ended by itself, or kill it."""
    try:
        await asyncio.wait_for(process.wait(), _END)
    except (TimeoutError, asyncio.CancelledError):
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


def _digests(tls: Mapping[str, Any]) -> list[str]:
    """Return digests of the certificate, the key and the CA, as far as they can be read."""
    digests = []
    for name in ("root_ca_certificate", "listen_certificate", "listen_private_key"):
        with contextlib.suppress(KeyError, OSError):
            digests.append(hashlib.sha256(Path(tls[name]).read_bytes()).hexdigest())
    return digests
