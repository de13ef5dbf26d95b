"""Peer credentials: whoever connects is identified before gRPC hears a byte of them.

gRPC's Python server cannot say which process is at the other end of a Unix socket, and cannot ask
for TLS 1.3.  It therefore listens at a socket of its own that the daemon's user alone can open.
The door accepts connections, asks the kernel (``SO_PEERCRED``) or the TLS handshake who is there,
turns away whom no table admits, and carries the bytes of the others to the server from a socket
with an abstract name.  That name is what the server tells as the peer of a call.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import logging
import os
import resource
import secrets
import socket
import ssl
from collections import Counter
from collections.abc import Callable, Collection, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orientd.daemon.access.identity import ClientCertificate, Credentials, Identity, RolePolicy
from orientd.daemon.access.peer import peer_process
from orientd.daemon.access.tls import peer_certificate, until_spoken
from orientd.errors import DaemonError

_log = logging.getLogger(__name__)

HANDSHAKE_TIMEOUT = 5.0
"""How long a TLS handshake may take from the connection on, s."""

LONGEST_SILENCE = 60.0
"""How long somebody who was let in may say nothing at first, s."""

MOST_HANDSHAKES = 32
"""TLS handshakes at the same time; for one more, the oldest of the busiest address is given up."""

RESERVED = 8
"""One in so many connections is kept for whoever commands a device."""

_DESCRIPTORS, _OTHER_DESCRIPTORS = 3, 200
"""Files that a connection takes, and those that are kept for everything else."""

_ALL = "all"
_BACKLOG = 1024  # of those who are not let in yet; a client that finds it full gives up at once
_CHUNK = 32 * 1024

Refused = Callable[[str, str], None]
"""Called with where somebody came from and why they were turned away."""

_Receive = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Coroutine[Any, Any, None]]
_Meet = Callable[[asyncio.StreamReader, asyncio.StreamWriter], None]


@dataclass(eq=False)
class PeerConnection:
    """Somebody who came in.

    Attributes:
        credentials: what they proved.
        origin: where they came from, for people.
        identity: who that makes them at present.
        hang_up: ends it.
        is_silent: whether nothing has come from there yet.
    """

    credentials: Credentials
    origin: str
    identity: Identity
    hang_up: Callable[[], object]
    is_silent: bool = True


class PeerListener:
    """Let in whom the policy admits, and know who they are.

    Attributes:
        has_lease: whether an identity, by its key, commands a device at present; for whom does,
            some of the room there is for everybody is kept.
    """

    def __init__(
        self, policy: RolePolicy, inner: str, *, most_connections: int, refused: Refused
    ) -> None:
        """Admit nobody yet.

        Args:
            policy: who somebody is.
            inner: path of the socket that the server listens at.
            most_connections: of one identity at the same time, and from one address.
            refused: told of everybody who is turned away.
        """
        self._policy = policy
        self._inner = inner
        self._most = most_connections
        self._refused = refused
        self.has_lease: Callable[[str], bool] = lambda _: False
        self._connections: dict[str, PeerConnection] = {}
        self._counts: Counter[str] = Counter()
        self._counted: dict[PeerConnection, Counter[str]] = {}
        self._listeners: list[asyncio.Server] = []
        self._visits: set[asyncio.Task[None]] = set()
        self._context: ssl.SSLContext | None = None
        self._handshakes: dict[asyncio.Task[Any], str] = {}
        self._path: Path | None = None

    # In and out

    async def open_unix(self, path: Path) -> None:
        """Listen at the Unix socket *path*: for the daemon's user, or for all if any may come in.

        Raises:
            DaemonError: that is not possible.
        """
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
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
        self._listeners.append(
            await asyncio.start_unix_server(
                self._meet(self._from_unix), sock=listener, backlog=_BACKLOG
            )
        )

    async def open_tcp(self, host: str, port: int, context: ssl.SSLContext) -> int:
        """Listen for TLS at *host* and *port*; return the port, which 0 leaves to the system.

        Raises:
            DaemonError: that is not possible.
        """
        self._context = context
        try:
            server = await asyncio.start_server(
                self._meet(self._from_tcp, is_read=False), host, port, backlog=_BACKLOG
            )
        except OSError as error:
            raise DaemonError(f"cannot listen at {host}:{port}: {error.strerror}") from error
        self._listeners.append(server)
        return int(server.sockets[0].getsockname()[1])

    def change(self, policy: RolePolicy, context: ssl.SSLContext | None) -> None:
        """Go by another policy from now on, and hang up on whom it does not admit."""
        self._policy = policy
        self._let_reach()
        if context is not None:
            self._context = context
        for connection in list(self._connections.values()):
            now = policy.identify(connection.credentials)
            if now is None:
                self._refused(connection.origin, f"{connection.identity.name} is admitted no more")
                connection.hang_up()
            else:
                connection.identity = now

    def have_certificates_shown_again(self) -> None:
        """Hang up on everybody who came in with a certificate."""
        for connection in list(self._connections.values()):
            if isinstance(connection.credentials, ClientCertificate):
                connection.hang_up()

    async def close(self) -> None:
        """Let nobody in any more, hang up on everybody, and wait until they are out."""
        for listener in self._listeners:
            listener.close()
        for connection in list(self._connections.values()):
            connection.hang_up()
        for visit in self._visits:
            visit.cancel()
        await asyncio.gather(*self._visits, return_exceptions=True)

    def who(self, peer: str) -> PeerConnection | None:
        """Return whose connection the server calls *peer*; ``None`` if it did not come in here."""
        connection = self._connections.get(peer.removeprefix("unix-abstract:"))
        # A certificate may have expired since.
        if connection is None or self._policy.identify(connection.credentials) is None:
            return None
        return connection

    def guest(self, credentials: Credentials, origin: str) -> str:
        """Admit somebody who comes by no connection; return what :meth:`who` knows them by.

        Args:
            credentials: what they have proved elsewhere.
            origin: where they come from, for people.
        """
        name = f"orientd-guest-{secrets.token_hex(16)}"
        identity = self._policy.identify(credentials)
        if identity is None:
            self._refused(origin, f"nobody admits {credentials}")
            return name
        forget = functools.partial(self._connections.pop, name, None)
        self._connections[name] = PeerConnection(credentials, origin, identity, forget)
        return name

    # How

    def _let_reach(self) -> None:
        """Let others open the socket if any may come in; who they are is asked then."""
        if self._path is not None:
            self._path.chmod(0o666 if self._policy.admits_others else 0o600)

    def _meet(self, receive: _Receive, *, is_read: bool = True) -> _Meet:
        """Return what has *receive* look after everybody who comes, to their end or to ours."""

        def meet(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            if not is_read:
                # Before Python 3.11.3 a transport begins to read after this, paused or not.
                pause = writer.transport.pause_reading  # type: ignore[attr-defined] # it reads, too
                asyncio.get_running_loop().call_soon(pause)
            visit = asyncio.ensure_future(receive(reader, writer))
            self._visits.add(visit)
            visit.add_done_callback(self._visits.discard)

        return meet

    async def _from_unix(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            process = peer_process(writer.get_extra_info("socket"))
        except OSError as error:
            self._refused("unix", f"credentials: {error}")
            writer.close()
            return
        await self._admit(process, f"unix, process {process.pid}", reader, writer)

    async def _from_tcp(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        host, port, *_ = writer.get_extra_info("peername") or ("?", 0)
        origin = f"tcp, {host}:{port}"
        context, task = self._context, asyncio.current_task()
        if context is None or task is None:
            writer.close()
            return
        self._make_room()
        self._handshakes[task] = host
        spare = writer.get_extra_info("socket").dup()
        try:
            async with asyncio.timeout(HANDSHAKE_TIMEOUT):
                # TLS takes a quarter of a megabyte for each connection, which silence is not worth.
                await until_spoken(spare)
                await writer.start_tls(context)
            certificate = peer_certificate(writer.get_extra_info("ssl_object"))
        except (OSError, ValueError, EOFError) as error:
            self._refused(origin, f"handshake: {_reason(error)}")
            with contextlib.suppress(OSError):
                spare.send(getattr(error, "alert", b""))
            writer.transport.abort()
            return
        except asyncio.CancelledError:
            writer.transport.abort()
            self._refused(origin, "handshake: given up for others that came later")
            raise
        finally:
            spare.close()
            self._handshakes.pop(task, None)
        await self._admit(certificate, origin, reader, writer)

    def _make_room(self) -> None:
        """Give up a handshake where there are too many: whoever says nothing keeps nobody out."""
        if len(self._handshakes) >= MOST_HANDSHAKES:
            ((busiest, _),) = Counter(self._handshakes.values()).most_common(1)
            oldest = next(task for task, host in self._handshakes.items() if host == busiest)
            del self._handshakes[oldest]
            oldest.cancel()

    async def _admit(
        self,
        credentials: Credentials,
        origin: str,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        identity = self._policy.identify(credentials)
        # All processes of one user come from the same place; addresses from theirs.
        counted = Counter({origin.rpartition(":")[0] or "unix", _ALL})
        problem = ""
        if identity is None:
            problem = f"nobody admits {credentials}"
        else:
            counted[identity.key] = 1
            while (problem := self._why_full(identity, counted)) and self._gives_way(identity):
                pass
        if identity is None or problem:
            self._refused(origin, problem)
            writer.transport.abort()
            return
        connection = PeerConnection(credentials, origin, identity, writer.transport.abort)
        self._counted[connection] = counted
        self._counts += counted
        try:
            await self._carry(connection, reader, writer)
        finally:
            self._forget(connection)

    def _why_full(self, identity: Identity, counted: Collection[str]) -> str:
        """Return why there is no room for one more connection, or nothing."""
        for key in counted:
            if key not in (_ALL, "unix") and self._counts[key] >= self._most:
                whose = identity.name if key == identity.key else key
                return f"{whose} has {self._most} connections already"
        most = most_together()
        kept = 0 if self.has_lease(identity.key) else most // RESERVED
        if self._counts[_ALL] >= most - kept:
            return (
                f"there are {most - kept} connections already, and {kept} are kept for commanders"
            )
        return ""

    def _gives_way(self, identity: Identity) -> bool:
        """Hang up on the oldest connection of the same identity that has said nothing, if any."""
        for connection in self._counted:
            if connection.is_silent and connection.identity == identity:
                self._forget(connection)
                self._refused(connection.origin, "said nothing, and gave way to a later one")
                connection.hang_up()
                return True
        return False

    def _forget(self, connection: PeerConnection) -> None:
        """Count a connection no more."""
        # Without those of whom there is none any more.
        self._counts -= self._counted.pop(connection, Counter())

    async def _carry(
        self, connection: PeerConnection, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """Carry bytes both ways until either end has had enough."""
        name = f"orientd-{secrets.token_hex(16)}"
        self._connections[name] = connection
        first = b""
        try:
            # Until something is said, the server need not know of it.
            with contextlib.suppress(OSError):
                async with asyncio.timeout(LONGEST_SILENCE):
                    first = await reader.read(_CHUNK)
            if first:
                connection.is_silent = False
                await self._carry_in(name, first, reader, writer)
        finally:
            del self._connections[name]
            # What is written is still sent; a peer that does not take it is not waited for.
            writer.close()

    async def _carry_in(
        self, name: str, first: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        inside = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        inside.setblocking(False)
        try:
            inside.bind(f"\0{name}")
            await asyncio.get_running_loop().sock_connect(inside, self._inner)
            source, into = await asyncio.open_unix_connection(sock=inside, limit=_CHUNK)
        except OSError as error:
            _log.warning("door: the server does not answer: %s", error)
            inside.close()
            writer.transport.abort()
            return
        into.write(first)
        ways = {
            asyncio.ensure_future(_pour(reader, into)),
            asyncio.ensure_future(_pour(source, writer)),
        }
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
            into.close()


async def _pour(source: asyncio.StreamReader, into: asyncio.StreamWriter) -> None:
    # By itself asyncio reads into 256 KiB every time, for a few hundred bytes.
    vars(into.transport)["max_size"] = _CHUNK
    with contextlib.suppress(OSError):
        while chunk := await source.read(_CHUNK):
            into.write(chunk)
            await into.drain()


def most_together() -> int:
    """Return how many connections there may be of all together: as many as there are files for."""
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return max(2 * RESERVED, (files - _OTHER_DESCRIPTORS) // _DESCRIPTORS)


def _reason(error: Exception) -> str:
    if isinstance(error, ssl.SSLError):
        return error.reason or str(error)
    if isinstance(error, TimeoutError):
        return f"not done within {HANDSHAKE_TIMEOUT:g} s"
    return str(error) or type(error).__name__
