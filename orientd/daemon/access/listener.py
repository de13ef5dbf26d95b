"""The listener: clients connect here, and the daemon knows who they are before it serves them.

The kernel says which user is at the other end of a Unix socket (``SO_PEERCRED``), the certificate
of the TLS handshake who comes over TCP.  The daemon hangs up on everybody whom no table admits.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import resource
import socket
import ssl
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orientd.config import AccessSettings, TcpSettings, TlsFileError, check_tls_files
from orientd.daemon.access.audit import AuditLog
from orientd.daemon.access.connection import Connection, FindRoute, Turns
from orientd.daemon.access.identity import (
    Caller,
    ClientCertificate,
    Credentials,
    RolePolicy,
    look_up,
    peer_process,
)
from orientd.daemon.access.refusals import Refusals
from orientd.daemon.workers import LOOK_UP
from orientd.errors import AccessError, ConfigError, DaemonError

_log = logging.getLogger(__name__)

HANDSHAKE_TIMEOUT = 5.0
"""Time that a TLS handshake may take from the connection on, s."""

MOST_HANDSHAKES = 256
"""Most clients over TCP without a certificate yet; one more closes the oldest."""

SILENCE = 15
"""Time after which the daemon hangs up on a client over TCP that the network has lost, s."""

BUSY = 2
"""So many times the connections of one identity may be open while calls are under way on them."""

_OTHER_DESCRIPTORS = 200
_BACKLOG = 1024  # a client that finds it full gives up at once
_AGAIN = 0.1  # s before the next accept if the process has run out of descriptors

Receive = Callable[[socket.socket, str], Awaitable[None]]
"""Receives a connection from somewhere."""


@dataclass(frozen=True)
class Tables:
    """Hold the roles of clients, and the TLS context and revocations."""

    policy: RolePolicy
    tcp: TcpSettings | None = None
    context: ssl.SSLContext | None = None
    revocations: bytes = b""

    @classmethod
    def read(cls, access: AccessSettings, tcp: TcpSettings | None) -> Tables:
        """Return the tables of the settings, and of the files that they name.

        Raises:
            ConfigError: the settings name what is not there.
        """
        if tcp is None:
            return cls(RolePolicy(access))
        policy, context = RolePolicy(access, tcp.revoked), server_context(tcp)
        try:
            revocations = b"" if tcp.crl is None else tcp.crl.read_bytes()
        except OSError as error:
            raise ConfigError(f"tcp.crl: cannot read {tcp.crl}: {error.strerror}") from error
        return cls(policy, tcp, context, revocations)


class Listener:
    """Accept connections that the settings allow, and serve them."""

    def __init__(
        self,
        access: AccessSettings,
        tcp: TcpSettings | None,
        find_route: FindRoute,
        audit: AuditLog,
    ) -> None:
        """Prepare the listener; it accepts no client yet.

        Args:
            access: roles and limits.
            tcp: settings of the TCP listener, if there is one.
            find_route: returns how to serve each call.
            audit: records refused clients.

        Raises:
            ConfigError: the settings name a user, group or file that does not exist.
        """
        self._access, self._tcp = access, tcp
        self._tables = Tables.read(access, tcp)
        self._find_route, self._refusals = find_route, Refusals(audit)
        self._path: Path | None = None
        self._listeners: list[socket.socket] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._handshakes: dict[asyncio.Task[Any], None] = {}
        self._connections: dict[Connection, None] = {}
        self._turns = Turns()
        # As many of all together as there are files for.
        files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        self._most_together = max(16, files - _OTHER_DESCRIPTORS)

    @property
    def policy(self) -> RolePolicy:
        """Return the roles and permissions now in force."""
        return self._tables.policy

    async def open(self, path: Path) -> None:
        """Listen at the Unix socket *path*, and for TLS if the settings say so.

        Raises:
            DaemonError: that is not possible.
        """
        listener = socket.socket(socket.AF_UNIX)
        before = os.umask(0o177)
        try:
            listener.bind(str(path))
        except OSError as error:
            listener.close()
            raise DaemonError(f"cannot listen at {path}: {error.strerror}") from error
        finally:
            os.umask(before)
        self._path = path
        self._let_reach()
        self._accept_at(listener, self._from_unix)
        if self._tcp is not None:
            host, port = self._tcp.host_and_port
            try:
                family = socket.AF_INET6 if ":" in host else socket.AF_INET
                listener = socket.create_server((host, port), family=family, backlog=_BACKLOG)
            except OSError as error:
                problem = error.strerror or str(error)
                raise DaemonError(f"cannot listen at {host}:{port}: {problem}") from error
            _log.info("listens at %s:%d too, with TLS", host, listener.getsockname()[1])
            self._accept_at(listener, self._from_tcp)

    def read(self, access: AccessSettings, tcp: TcpSettings | None) -> Tables:
        """Return other roles and certificates, for :meth:`change`; the address stays the same.

        Raises:
            ConfigError: the settings name a missing user, group or file.
        """
        return Tables.read(access, None if self._tcp is None else tcp or self._tcp)

    def change(self, tables: Tables) -> None:
        """Go by other roles and certificates from now on.

        The daemon hangs up on clients that it admits no more.  A change of the revocation list
        cuts off every client with a certificate; those that it does not name may come again.
        """
        before, self._tables, self._tcp = self._tables, tables, tables.tcp
        try:
            self._let_reach()
        except OSError as error:  # such as a socket that a cleaner of old files has removed
            _log.warning("%s: cannot change who reaches it: %s", self._path, error.strerror)
        for connection in list(self._connections):
            caller = connection.caller
            now = tables.policy.identify(caller.credentials)
            if now is None:
                self._refusals.note(caller.origin, f"{caller.identity.name} is admitted no more")
                connection.hang_up()
            elif isinstance(caller.credentials, ClientCertificate) and (
                tables.revocations != before.revocations
            ):
                # Only the handshake asks whether a certificate is on the list.
                connection.hang_up()
            else:
                caller.identity = now

    async def close(self, grace: float = 0.0) -> None:
        """Accept no more clients, wait *grace* s for calls to end, then close all connections."""
        for task in self._tasks:
            task.cancel()
        for listener in self._listeners:
            listener.close()
        self._listeners.clear()
        self._refusals.close()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.gather(*[one.ends_within(grace) for one in self._connections])
        for connection in list(self._connections):
            connection.hang_up()

    # How

    def _let_reach(self) -> None:
        """Open the socket to other users if any are admitted; each connection is identified."""
        if self._path is not None:
            self._path.chmod(0o666 if self.policy.admits_others else 0o600)

    def _accept_at(self, listener: socket.socket, receive: Receive) -> None:
        listener.listen(_BACKLOG)
        listener.setblocking(False)
        self._listeners.append(listener)
        self._spawn(self._accept(listener, receive))

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _accept(self, listener: socket.socket, receive: Receive) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                accepted, _ = await loop.sock_accept(listener)
            except OSError as error:  # of a client that is gone, or for want of a descriptor
                _log.warning("cannot accept a connection: %s", error)
                await asyncio.sleep(_AGAIN)
                continue
            self._spawn(self._receive(accepted, receive))

    async def _receive(self, accepted: socket.socket, receive: Receive) -> None:
        """Receive a connection, and close it unless it is served."""
        origin = _origin(accepted)
        try:
            await receive(accepted, origin)
        except BaseException as error:
            accepted.close()
            if isinstance(error, ssl.SSLError):
                reason = getattr(error, "verify_message", "") or error.reason or str(error)
                self._refusals.note(origin, f"handshake: {reason}")
            elif isinstance(error, OSError | AccessError):
                self._refusals.note(origin, str(error) or type(error).__name__)
            else:
                raise

    async def _from_unix(self, accepted: socket.socket, origin: str) -> None:
        process, loop = peer_process(accepted), asyncio.get_running_loop()
        name = asyncio.wrap_future(look_up(process.uid))
        await asyncio.wait([name], timeout=LOOK_UP)  # after that the number will do
        connection = self._connection(lambda _: process, origin)
        await loop.connect_accepted_socket(lambda: connection, accepted)

    async def _from_tcp(self, accepted: socket.socket, origin: str) -> None:
        if len(self._handshakes) >= MOST_HANDSHAKES:
            next(iter(self._handshakes)).cancel()
        task: Any = asyncio.current_task()
        self._handshakes[task] = None
        connection, loop = self._connection(peer_certificate, origin), asyncio.get_running_loop()
        try:
            async with asyncio.timeout(HANDSHAKE_TIMEOUT):
                # TLS takes a quarter of a megabyte for each connection, which silence is not worth.
                if not await _has_spoken(accepted):
                    accepted.close()
                    return
                _keep_alive(accepted)
                await loop.connect_accepted_socket(
                    lambda: connection, accepted, ssl=self._tables.context
                )
        except TimeoutError as error:
            raise OSError(f"handshake: not done within {HANDSHAKE_TIMEOUT:g} s") from error
        finally:
            self._handshakes.pop(task, None)

    def _connection(
        self, credentials_of: Callable[[asyncio.BaseTransport], Credentials], origin: str
    ) -> Connection:
        """Return what serves a connection, once it is made and its client is admitted."""

        def meet(transport: asyncio.BaseTransport) -> Caller | None:
            try:
                credentials = credentials_of(transport)
                identity = self._tables.policy.identify(credentials)
                if identity is None:
                    raise AccessError(f"no role admits {credentials}")
                caller = Caller(credentials, origin, identity)
                self._enter(connection, caller)
            except (AccessError, ValueError) as error:
                self._refusals.note(origin, str(error))
                return None
            return caller

        connection = Connection(
            meet,
            self._find_route,
            message_bytes=self._access.message_bytes,
            turns=self._turns,
            ended=lambda ended: self._connections.pop(ended, None),
        )
        return connection

    def _enter(self, connection: Connection, caller: Caller) -> None:
        """Count *connection*; close an idle one of the same identity if there are too many.

        If all of them are busy, the daemon admits the new one as well.  Its caller can then still
        stop devices, and gets an error for a call beyond the limit.

        Raises:
            AccessError: far too many are busy.
        """
        name, most = caller.identity.name, self._access.connections
        own = [one for one in self._connections if one.caller.identity.key == caller.identity.key]
        is_full = len(self._connections) >= self._most_together
        if is_full or len(own) >= most:
            oldest = next((one for one in own if one.is_idle), None)
            if oldest is not None:
                del self._connections[oldest]
                _log.info("%s: was idle, and gave way to a later one", oldest.caller.origin)
                oldest.hang_up()
            elif is_full or len(own) >= BUSY * most:
                raise AccessError(f"{name} has {len(own)} connections already, all in use")
        connection.caller = caller
        self._connections[connection] = None


async def _has_spoken(peer: socket.socket) -> bool:
    """Wait until something has come from *peer*, which is left to be read, or it has hung up."""
    loop, heard = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(peer, heard.set)
    try:
        await heard.wait()
    finally:
        loop.remove_reader(peer)
    return bool(peer.recv(1, socket.MSG_PEEK))


def _keep_alive(peer: socket.socket) -> None:
    """Let the kernel end a TCP connection that the network has lost."""
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in (
        (socket.TCP_USER_TIMEOUT, SILENCE * 1000),
        (socket.TCP_KEEPIDLE, SILENCE // 3),
        (socket.TCP_KEEPINTVL, SILENCE // 3),
        (socket.TCP_KEEPCNT, 2),
    ):
        peer.setsockopt(socket.IPPROTO_TCP, option, value)


def _origin(peer: socket.socket) -> str:
    """Return the address of the other end of a socket, for people."""
    if peer.family == socket.AF_UNIX:
        with contextlib.suppress(OSError):
            return f"unix, process {peer_process(peer).pid}"
        return "unix"
    with contextlib.suppress(OSError):
        host, port, *_ = peer.getpeername()
        return f"tcp, {host}:{port}"
    return "tcp"


def server_context(settings: TcpSettings) -> ssl.SSLContext:
    """Return what to speak TLS with.

    OpenSSL refuses a client without a certificate of the CA, or with one that has expired, is on
    the revocation list, or is for another purpose.

    Raises:
        ConfigError: a file of *settings* cannot be read or does not fit.
    """
    try:
        check_tls_files(settings.certificate, settings.key, settings.ca, settings.crl)
    except TlsFileError as error:
        raise ConfigError(f"tcp.{error.name}: {error}") from error
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.verify_mode = ssl.CERT_REQUIRED
    context.set_alpn_protocols(["h2"])
    # A resumed session would not be checked against a newer revocation list.
    context.num_tickets = 0
    name, path = "certificate", settings.certificate
    try:
        context.load_cert_chain(settings.certificate, settings.key)
        name, path = "ca", settings.ca
        context.load_verify_locations(settings.ca)
        if settings.crl is not None:
            name, path = "crl", settings.crl
            context.load_verify_locations(settings.crl)
            context.verify_flags |= ssl.VerifyFlags.VERIFY_CRL_CHECK_LEAF
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(f"tcp.{name}: cannot use {path}: {error}") from error
    return context


def peer_certificate(transport: asyncio.BaseTransport) -> ClientCertificate:
    """Return the certificate at the other end, which OpenSSL has verified.

    Raises:
        ValueError: it has not exactly one common name.
    """
    found: dict[str, Any] = transport.get_extra_info("peercert") or {}
    fields = [pair for part in found.get("subject", ()) for pair in part]
    names = [value for key, value in fields if key == "commonName"]
    if len(names) != 1:
        raise ValueError(f"expected one common name, got {len(names)}")
    return ClientCertificate(
        name=str(names[0]),
        serial=str(found["serialNumber"]).upper().lstrip("0"),
        expires=ssl.cert_time_to_seconds(str(found["notAfter"])),
    )
