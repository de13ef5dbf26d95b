"""Identify clients and their roles by the kernel's peer credentials or by a certificate."""

from __future__ import annotations

import errno
import grp
import itertools
import os
import pwd
import socket
import struct
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field

from orientd.config import AccessSettings, Role
from orientd.daemon.workers import LOOK_UPS
from orientd.errors import ConfigError

_SO_PEERGROUPS = 59
_GROUPS_BYTES = 1024  # as much as Python asks the kernel for: 256 groups
_UCRED = struct.Struct("iII")


@dataclass(frozen=True)
class Process:
    """Hold the kernel's peer credentials of the process at the other end of a Unix socket.

    Attributes:
        pid: of the process that connected.
        uid: its effective user.
        gids: its groups, all of them.
    """

    pid: int
    uid: int
    gids: tuple[int, ...]

    def __str__(self) -> str:
        return f"user:{self.uid}"


def peer_process(connected: socket.socket) -> Process:
    """Return what the kernel says of who connected: ``SO_PEERCRED`` and ``SO_PEERGROUPS``, unix(7).

    If a user is in more than 256 groups, only the first one counts.

    Raises:
        OSError: the kernel does not say.
    """
    credentials = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size)
    pid, uid, gid = _UCRED.unpack(credentials)
    try:
        listed = connected.getsockopt(socket.SOL_SOCKET, _SO_PEERGROUPS, _GROUPS_BYTES)
    except OSError as error:
        if error.errno != errno.ERANGE:
            raise
        listed = b""
    gids = struct.unpack(f"{len(listed) // 4}I", listed)
    return Process(pid, uid, (gid, *gids))


@dataclass(frozen=True)
class Identity:
    """Identify an admitted client.

    Attributes:
        key: permanent name, ``user:NUMBER`` or ``certificate:NAME``.
        name: readable name.
        role: decides which calls the client may make.
    """

    key: str
    name: str
    role: Role

    def __str__(self) -> str:
        return f"{self.name} ({self.key})"


@dataclass(frozen=True)
class ClientCertificate:
    """Hold the contents of a certificate that a trusted authority signed.

    Attributes:
        name: the common name.
        serial: hexadecimal, upper case, without leading zeros.
        expires: Unix time in s.
    """

    name: str
    serial: str
    expires: float

    def __str__(self) -> str:
        return f"certificate:{self.name}, serial {self.serial}"


Credentials = Process | ClientCertificate

_NUMBERS = itertools.count(1)


@dataclass(eq=False)
class Caller:
    """A client that was let in.

    Attributes:
        credentials: its peer credentials or certificate.
        origin: its process or address, for people.
        identity: who that makes it at present.
        key: names it among all callers, for taking turns.
    """

    credentials: Credentials
    origin: str
    identity: Identity
    key: str = field(default_factory=lambda: f"caller {next(_NUMBERS)}")

    @property
    def has_expired(self) -> bool:
        """Whether its certificate counted when it came in, and does not any more."""
        credentials = self.credentials
        return isinstance(credentials, ClientCertificate) and credentials.expires <= time.time()


class RolePolicy:
    """The tables of roles, with every name looked up."""

    def __init__(self, settings: AccessSettings, revoked: Sequence[str] = ()) -> None:
        """Look up the names in *settings*.

        Args:
            settings: roles by name.
            revoked: serial numbers of certificates that count for nothing.

        Raises:
            ConfigError: there is no such user or group.
        """
        self._users = {_uid(name): role for name, role in settings.users.items()}
        self._users |= {0: Role.ADMINISTRATOR, os.geteuid(): Role.ADMINISTRATOR}
        self._groups = {_gid(name): role for name, role in settings.groups.items()}
        self._certificates: Mapping[str, Role] = settings.certificates
        self._revoked = frozenset(revoked)

    @property
    def admits_others(self) -> bool:
        """Whether users other than the daemon's own may connect to the Unix socket."""
        return bool(self._groups) or set(self._users) != {0, os.geteuid()}

    def tables(self) -> dict[str, list[int]]:
        """Return the numbers of the users, and of the groups, that may connect."""
        return {"users": list(self._users), "groups": list(self._groups)}

    def identify(self, credentials: Credentials) -> Identity | None:
        """Return the client with these *credentials*; ``None`` if it has no role.

        This waits for nothing: a user goes by number until :func:`look_up` has found the name.
        """
        if isinstance(credentials, Process):
            uid = credentials.uid
            roles = [self._groups[gid] for gid in credentials.gids if gid in self._groups]
            if uid in self._users:
                roles.append(self._users[uid])
            found = look_up(uid)
            user = found.result() if found.done() else f"uid {uid}"
            return Identity(f"user:{uid}", user, max(roles)) if roles else None
        name = credentials.name
        role = self._certificates.get(name)
        is_over = credentials.serial in self._revoked or credentials.expires <= time.time()
        return None if role is None or is_over else Identity(f"certificate:{name}", name, role)


def _uid(name: str) -> int:
    return _number("user", name, lambda: pwd.getpwnam(name).pw_uid)


def _gid(name: str) -> int:
    return _number("group", name, lambda: grp.getgrnam(name).gr_gid)


def _number(kind: str, name: str, find: Callable[[], int]) -> int:
    if name.isascii() and name.isdigit():
        return int(name)
    try:
        return find()
    except (KeyError, ValueError) as error:  # a name with a null byte is a mistake of another kind
        raise ConfigError(f"access.{kind}s: there is no {kind} {name!r} on this machine") from error


_MOST_NAMES = 1024
_names: dict[int, Future[str]] = {}
_names_lock = threading.Lock()


def look_up(uid: int) -> Future[str]:
    """Have the name of a user looked up, unless it has been; return at once."""
    with _names_lock:
        if uid not in _names:
            if len(_names) >= _MOST_NAMES:
                del _names[next(iter(_names))]
            _names[uid] = LOOK_UPS.submit(_found, uid)
        return _names[uid]


def _found(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except (KeyError, OSError):
        return f"uid {uid}"
