"""Who is admitted to one daemon: policy, peer listener, authorization and audit log together."""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orientd.config import AccessSettings, TcpSettings
from orientd.daemon.access.audit import AuditLog
from orientd.daemon.access.authorization import Authorization, OwnerOf
from orientd.daemon.access.identity import RolePolicy
from orientd.daemon.access.peer_credentials import PeerListener
from orientd.daemon.access.throttle import Throttle
from orientd.daemon.devices import report_directory

if TYPE_CHECKING:
    import ssl

_log = logging.getLogger(__name__)


@contextlib.contextmanager
def inner_socket(socket: Path) -> Iterator[str]:
    """Yield the path at which the server is to listen behind the door of *socket*.

    It is beside *socket*, and is named by way of an open directory: that path is never too long.
    """
    place = socket.with_name(f"{socket.name}.in")
    place.unlink(missing_ok=True)
    directory = os.open(socket.parent, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield f"/proc/self/fd/{directory}/{place.name}"
    finally:
        place.unlink(missing_ok=True)
        os.close(directory)


def audit_path(access: AccessSettings) -> Path:
    """Return where commands are recorded."""
    return access.audit or Path(report_directory()) / "audit.jsonl"


class Admission:
    """Everything that stands between a caller and the service.

    Attributes:
        policy: who may do what at present.
        door: knows who has come in.
        checkpoint: what every call passes.
    """

    def __init__(self, access: AccessSettings, tcp: TcpSettings | None, inner: str) -> None:
        """Prepare to let in whom the settings admit; nobody comes in yet.

        Args:
            access: roles and limits.
            tcp: the way in over TCP, if there is one.
            inner: the path from :func:`inner_socket`.

        Raises:
            ConfigError: the settings name what is not there.
        """
        self._tcp = tcp
        self.policy, self._context = _checked(access, tcp)
        self._revocations = _revocations(tcp)
        path = audit_path(access)
        self._audit = AuditLog(path, most_bytes=access.audit_bytes, most_files=access.audit_files)
        self._throttle = Throttle(per_second=access.requests_per_second, at_once=access.streams)
        self.door = PeerListener(
            self.policy, inner, most_connections=access.connections, refused=self._refused
        )
        self.checkpoint = Authorization(
            self.door, self._audit, self._throttle, keyframes=access.keyframes
        )

    async def open(self, socket: Path) -> None:
        """Let people in.

        Raises:
            DaemonError: an address cannot be listened at.
        """
        await self.door.open_unix(socket)
        if self._tcp is not None and self._context is not None:
            host, _ = self._tcp.host_and_port
            port = await self.door.open_tcp(*self._tcp.host_and_port, self._context)
            _log.info("door: listens at %s:%d too, with TLS", host, port)

    def change(self, access: AccessSettings, tcp: TcpSettings | None) -> None:
        """Go by other roles, certificates and rates from now on; what cannot change stays.

        A way in over TCP is neither opened nor closed by this.  Where the revocation list is
        another, everybody who came in that way is hung up on, and may come again.

        Raises:
            ConfigError: the settings name what is not there; then nothing has changed.
        """
        present = None if self._tcp is None else tcp or self._tcp
        self.policy, self._context = _checked(access, present)
        self._tcp = present
        revocations = _revocations(present)
        if revocations != self._revocations:
            # Whether it is on the list is asked of a certificate in the handshake alone.
            self._revocations = revocations
            self.door.have_certificates_shown_again()
        self._throttle.per_second = access.requests_per_second
        self._throttle.at_once = access.streams
        self.checkpoint.keyframes = access.keyframes
        self.door.change(self.policy, self._context)

    def guard_leases(self, owner_of: OwnerOf, owners: Callable[[], Collection[str]]) -> None:
        """Refuse tokens of others from now on, and keep room for whoever holds a lease.

        Args:
            owner_of: returns whose a lease is by its token.
            owners: returns who holds any.
        """
        self.checkpoint.owner_of = owner_of
        self.door.has_lease = lambda key: key in owners()

    def record_stop(self, origin: str, identity: str, **what: Any) -> None:  # noqa: ANN401 - JSON
        """Record what somebody has stopped beside the daemon who came by *origin*."""
        self._audit.record(event="stopped", identity=identity, origin=origin, **what)

    async def close(self) -> None:
        """Hang up on everybody, and finish the audit log."""
        await self.door.close()
        self._audit.close()

    def _refused(self, origin: str, problem: str) -> None:
        _log.warning("door: refused %s: %s", origin, problem)
        self._audit.record(event="refused", origin=origin, text=problem)


def _revocations(tcp: TcpSettings | None) -> bytes:
    return tcp.crl.read_bytes() if tcp is not None and tcp.crl is not None else b""


def _checked(
    access: AccessSettings, tcp: TcpSettings | None
) -> tuple[RolePolicy, ssl.SSLContext | None]:
    policy = RolePolicy(access, () if tcp is None else tcp.revoked)
    if tcp is None:
        return policy, None
    from orientd.daemon.access.tls import server_context

    return policy, server_context(tcp)
