"""The daemon's end of the gateway: start it, serve what it carries, tell it what happens."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import logging
import math
import os
import socket
import sys
import time
from collections.abc import Awaitable, Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from google.rpc import status_pb2

from orientd.config import Settings
from orientd.daemon.access import (
    AuditLog,
    Caller,
    ClientCertificate,
    Listener,
    Process,
    Serve,
)
from orientd.daemon.fleet.carried import Requests
from orientd.daemon.observe import Journal
from orientd.errors import AccessError, ConfigError, MessageSizeError, OrientdError
from orientd.fleet import LENGTHS, Header, write_frame, zenoh_configuration
from orientd.rpc import control_pb2 as pb
from orientd.rpc import to_status

_log = logging.getLogger(__name__)

_AGAIN, _SELDOM = 1.0, 30.0
"""Time after which a gateway that has ended is started again: at first, and at the most, s."""

_END = 2.0
"""How long the gateway may take to end, s."""

_MOST_WAITING = 4 << 20
"""Bytes of requests that one call may have waiting: callers keep to less (``fleet.requests``)."""

_MOST_LAG = 1 << 20
"""Bytes that the gateway may have left unread before states are left out."""

State = Callable[[], Awaitable[pb.GetStateResponse]]
"""Returns the daemon and its devices as they are now."""


class FleetLink:
    """A gateway for as long as the daemon runs."""

    def __init__(
        self,
        settings: Settings,
        path: Path,
        *,
        service: str,
        listener: Listener,
        serve: Serve,
        audit: AuditLog,
        state: State,
        journal: Journal,
    ) -> None:
        """Prepare to join the cell of *settings*.

        Args:
            settings: of the daemon; it has the table ``[fleet]``.
            path: of the control socket.
            service: full name of what is called.
            listener: knows who may come in.
            serve: serves each call.
            audit: records stops.
            state: of the daemon.
            journal: tells what happens.

        Raises:
            ConfigError: there is no Zenoh, or it cannot be configured so.
            DaemonError: the folder of a Unix socket is open to others.
        """
        if settings.fleet is None or find_spec("zenoh") is None:
            problem = "needs `eclipse-zenoh`: pip install 'orientd-motion[fleet]'"
            raise ConfigError(f"fleet: {problem}")
        self._fleet, self._tcp = settings.fleet, settings.tcp
        self._most = settings.access.message_bytes
        self._path, self._service, self._listener = path, service, listener
        self._serve, self._audit = serve, audit
        self._state, self._journal = state, journal
        self._calls: dict[int, asyncio.Task[None]] = {}
        self._requests: dict[int, Requests] = {}
        self._cut_off: dict[int, status_pb2.Status] = {}
        self._watched = asyncio.Event()
        self._writer: asyncio.StreamWriter | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._begin = self.configured(settings)

    def configured(self, settings: Settings) -> Header:
        """Return what the gateway is told first: of *settings* roles and certificates alone.

        Raises:
            ConfigError: Zenoh cannot be configured so.
            DaemonError: the folder of a Unix socket is open to others.
        """
        fleet, callers = self._fleet, list(settings.access.certificates)
        zenoh = zenoh_configuration(fleet, settings.tcp or self._tcp, callers=callers)
        return {
            "cell": fleet.cell,
            "name": fleet.name,
            "socket": str(self._path),
            "zenoh": zenoh,
            # For nobody to read: with others in their places Zenoh has to be started again.
            "files": _digests(zenoh.get("transport/link/tls", {})),
        }

    def start(self) -> None:
        """Join the cell, and come back to it whenever the gateway has ended."""
        self._tasks = [
            asyncio.create_task(work) for work in (self._keep(), self._publish(), self._tell())
        ]

    def change(self, begin: Header) -> None:
        """Go by what :meth:`configured` has returned: Zenoh reads it at its start alone."""
        before, self._begin = self._begin, begin
        if begin != before and self._writer is not None:
            self._writer.close()

    async def close(self) -> None:
        """Leave the cell, and end every call that came by it."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    # The process

    async def _keep(self) -> None:
        pause = 0.5 * _AGAIN
        while True:
            began = time.monotonic()
            try:
                await self._be_served()
            except OSError as error:
                _log.error("fleet: the gateway: %s", error)
            finally:
                await self._clean_up()
            lasted = time.monotonic() - began > _SELDOM
            pause = _AGAIN if lasted else min(2.0 * pause, _SELDOM)
            await asyncio.sleep(pause)

    async def _be_served(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", "orientd.fleet", str(theirs.fileno()),
                stdin=asyncio.subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
                process_group=0,
                cwd="/",
            )  # fmt: skip
        reader, self._writer = await asyncio.open_connection(sock=ours)
        await self._send(self._begin)
        with contextlib.suppress(asyncio.IncompleteReadError):
            while True:
                head, size = LENGTHS.unpack(await reader.readexactly(LENGTHS.size))
                header: Header = json.loads(await reader.readexactly(head))
                self._hear(header, await reader.readexactly(size))
        _log.warning("fleet: the gateway has ended; it is started again")

    async def _clean_up(self) -> None:
        self._watched.clear()
        calls, self._calls = list(self._calls.values()), {}
        for call in calls:
            call.cancel()
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        process, self._process = self._process, None
        if process is not None:
            try:
                await asyncio.wait_for(process.wait(), _END)
            except (TimeoutError, asyncio.CancelledError):
                process.kill()
                await process.wait()
        await asyncio.gather(*calls, return_exceptions=True)

    def _hear(self, header: Header, body: bytes) -> None:
        if "call" in header:
            number = header["call"]
            if header.get("parts"):
                self._requests[number] = Requests(taken=lambda: self._send({"taken": number}))
            work = self._carry(number, header["method"], header["caller"], body)
            self._calls[number] = asyncio.create_task(work)
        elif "cancel" in header:
            call = self._calls.get(header["cancel"])
            if call is not None:
                call.cancel()
        elif "part" in header:
            self._take_part(header["part"], body, is_last=header["is_last"])
        elif "watched" in header:
            self._watched.set() if header["watched"] else self._watched.clear()
        elif "stopped" in header:
            self._note_stop(header)
        elif "joined" in header:
            _log.info("fleet: joined cell %s as %s", self._begin["cell"], self._begin["name"])
        elif "failed" in header:
            _log.error("fleet: %s", header["failed"])

    async def _send(self, header: Header, body: bytes = b"") -> None:
        writer = self._writer
        if writer is not None:
            with contextlib.suppress(OSError):
                writer.write(write_frame(header, body))
                await writer.drain()

    # Calls

    def _take_part(self, number: int, body: bytes, *, is_last: bool) -> None:
        """Take one request of a call with many; whoever sends more than they may is cut off."""
        requests = self._requests.get(number)
        if requests is None:
            return
        if is_last:
            requests.add(None)
        elif len(body) > self._most or requests.waiting > _MOST_WAITING:
            self._cut_off[number] = to_status(_too_large(len(body) + requests.waiting, self._most))
            self._calls[number].cancel()
        else:
            requests.add(body)

    async def _carry(self, number: int, method: str, caller: str, body: bytes) -> None:
        status: status_pb2.Status | None = None
        try:

            async def send(answer: bytes) -> None:
                await self._send({"answer": number}, answer)

            requests = self._requests.get(number)
            if requests is None:
                requests = Requests(taken=_nobody_is_told)
                requests.add(body)
                requests.add(None)
            if len(body) > self._most:
                raise _too_large(len(body), self._most)
            path = f"/{self._service}/{method}"
            status = await self._serve(path, self._caller(caller), requests, send)
        except OrientdError as error:
            status = to_status(error)
        finally:
            self._calls.pop(number, None)
            self._requests.pop(number, None)
            status = self._cut_off.pop(number, status)
            # Whoever cancels does not wait: what is written here is sent by and by.
            if self._writer is not None:
                told = b"" if status is None else status.SerializeToString()
                self._writer.write(write_frame({"end": number}, told))

    def _caller(self, name: str) -> Caller:
        """Return who is called *name*, which Zenoh has checked.

        Raises:
            AccessError: nobody admits them.
        """
        credentials: Process | ClientCertificate = (
            ClientCertificate(name, "", math.inf)
            if self._fleet.is_tls
            else Process(os.getpid(), os.geteuid(), tuple(os.getgroups()))
        )
        identity = self._listener.policy.identify(credentials)
        if identity is None:
            raise AccessError(f"nobody admits {name}")
        return Caller(credentials, "fleet", identity)

    def _note_stop(self, header: Header) -> None:
        caller = f"certificate:{header['caller']}" if self._fleet.is_tls else f"user:{os.geteuid()}"
        names = [one["name"] for one in header.get("devices") or ()]
        self._audit.record(
            event="stopped", origin="fleet", identity=caller, kind=header["stopped"], devices=names
        )

    # What happens

    async def _publish(self) -> None:
        """Publish the state at its rate, while anybody listens."""
        number, due = 0, 0.0
        while True:
            await self._watched.wait()
            if self._lag() < _MOST_LAG:
                number += 1
                now = time.monotonic_ns()
                try:
                    said = (await self._state()).SerializeToString()
                except OrientdError as error:
                    _log.warning("fleet: no state: %s", error)
                else:
                    await self._send({"state": number, "time_ns": now}, said)
            due = max(due + 1.0 / self._fleet.state_hz, time.monotonic())
            await asyncio.sleep(due - time.monotonic())

    async def _tell(self) -> None:
        """Publish events at once."""
        loop, wake = asyncio.get_running_loop(), asyncio.Event()
        subscription = self._journal.subscribe("", lambda: loop.call_soon_threadsafe(wake.set))
        try:
            while True:
                await wake.wait()
                wake.clear()
                said = subscription.take()
                await self._send(
                    {"events": len(said.events), "time_ns": time.monotonic_ns()},
                    said.SerializeToString(),
                )
        finally:
            subscription.close()

    def _lag(self) -> int:
        transport: Any = None if self._writer is None else self._writer.transport
        return 0 if transport is None else int(transport.get_write_buffer_size())


async def _nobody_is_told() -> None:
    """Say nothing: of a single request nobody waits until it is taken."""


def _too_large(size: int, most: int) -> MessageSizeError:
    return MessageSizeError("", f"the message is too large: {size} bytes, at most {most}")


def _digests(tls: Mapping[str, Any]) -> list[str]:
    """Return what is another list where a file of certificate, key or CA is another one."""
    digests = []
    for name in ("root_ca_certificate", "listen_certificate", "listen_private_key"):
        with contextlib.suppress(KeyError, OSError):
            digests.append(hashlib.sha256(Path(tls[name]).read_bytes()).hexdigest())
    return digests
