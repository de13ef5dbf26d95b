"""The socket through which a servo receives stops: datagrams, read once a cycle.

Nothing stands between the sender and the cycle that brakes: no daemon, no connection, no other
process.  A request is one word: ``stop``, ``halt``, or ``hello``, which only asks whether the
sender may stop.  The kernel identifies the sender (``SO_PASSCRED``, unix(7)).  The answer goes to
the sender's own address: ``took STREAMING 3``, ``admitted``, ``refused USER`` or ``wrong``.  The
daemon sends ``admit`` with the users and groups that may stop, whenever these change.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import socket
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

LONGEST = 16_384
"""Largest datagram, bytes; a longer one is invalid."""

HEARD = 4
"""Most datagrams that are read in one cycle."""

_UCRED = struct.Struct("iII")


class StopRequest(NamedTuple):
    """A requested stop.

    Attributes:
        is_quickest: whether it is a halt.
        pid: process that sent it.
        uid: its user.
        gid: its group, or the group that admits it.
        sender: address for the answer.
    """

    is_quickest: bool
    pid: int
    uid: int
    gid: int
    sender: bytes | str


class StopSocket:
    """The stop socket of one servo."""

    def __init__(self, path: str, daemon_pid: int, admitted: Mapping[str, Sequence[int]]) -> None:
        """Listen at *path*, in place of the previous servo process.

        Args:
            path: of the socket.
            daemon_pid: the process that may set who is admitted.
            admitted: numbers of ``users`` and ``groups`` that may stop.

        Raises:
            OSError: *path* is not suitable for a socket.
        """
        self._daemon_pid = daemon_pid
        self._admit(admitted)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)  # noqa: PTH108 - no pathlib here
        folder, name = os.path.split(path)
        # Through its directory, so that the path is never too long.
        directory = os.open(folder, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            self._socket.bind(f"/proc/self/fd/{directory}/{name}")
        finally:
            os.close(directory)
        os.chmod(path, 0o666)  # noqa: PTH101 - the folder says who gets here
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def requests(self) -> Iterator[StopRequest]:
        """Yield the stops that have arrived; answer all other requests."""
        for _ in range(HEARD):
            if not self._poll.poll(0):
                return
            try:
                content, ancillary, _, sender = self._socket.recvmsg(
                    LONGEST, socket.CMSG_SPACE(_UCRED.size)
                )
                pid, uid, gid = _UCRED.unpack(ancillary[0][2][: _UCRED.size])
            except (OSError, IndexError, struct.error):
                continue
            word, _, rest = content.strip().partition(b" ")
            admitting = self._admitting_group(pid, uid, gid)
            if word == b"admit" and pid == self._daemon_pid:
                with contextlib.suppress(ValueError, KeyError, TypeError):
                    self._admit(json.loads(rest))
            elif admitting is None:
                self.answer(sender, f"refused {uid}")
            elif word in (b"stop", b"halt"):
                yield StopRequest(word == b"halt", pid, uid, admitting, sender)
            else:
                self.answer(sender, "admitted" if word == b"hello" else "wrong")

    def answer(self, sender: bytes | str | None, text: str) -> None:
        """Send *text* to the sender of a request, if it still exists."""
        with contextlib.suppress(OSError, TypeError):  # an address that was never bound is None
            self._socket.sendto(text.encode(), socket.MSG_DONTWAIT, sender or "")

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _admit(self, admitted: Mapping[str, Sequence[int]]) -> None:
        self._users, self._groups = set(admitted["users"]), set(admitted["groups"])

    def _admitting_group(self, pid: int, uid: int, gid: int) -> int | None:
        """Return a group of a process that may stop; ``None`` if it may not."""
        if uid in self._users or gid in self._groups:
            return gid
        if self._groups:
            with contextlib.suppress(OSError), open(f"/proc/{pid}/status", "rb") as status:  # noqa: PTH123
                found = next((line for line in status if line.startswith(b"Groups:")), b"")
                return next((g for g in map(int, found.split()[1:]) if g in self._groups), None)
        return None
