"""Who is at the other end of a Unix socket, by what the kernel says."""

from __future__ import annotations

import errno
import socket
import struct
from dataclasses import dataclass

_SO_PEERGROUPS = 59
_GROUPS_BYTES = 1024  # as much as Python asks the kernel for: 256 groups
_UCRED = struct.Struct("iII")


@dataclass(frozen=True)
class Process:
    """What the kernel says of the process at the other end of a Unix socket.

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

    Of somebody in more than 256 groups only the first one counts.

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
