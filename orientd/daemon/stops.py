"""Stops that reach the servos directly: who may stop, and what is written of each stop.

The servo of each device listens at its own socket, in a folder next to the control socket.  It
brakes whatever the daemon does (:mod:`orientd.servo.stop_socket`).  The daemon makes the folder and
lists the admitted users.  Afterwards it reads in the servo's memory who stopped.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import socket
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from orientd.daemon.access.identity import Process, RolePolicy
from orientd.errors import DaemonError
from orientd.first_stop import KINDS, stop_folder
from orientd.stream.records import Stop

_log = logging.getLogger(__name__)

_TAKING = 0.5
"""How long a servo may take to make room for the news of who is admitted, s."""

_ADVICE = "move it away, or choose another socket"

Record = Callable[..., object]
"""Records a stop, by keywords: its origin, the identity, the kind, devices and times."""


class StopFolder:
    """The folder where the servos of one daemon listen for stops."""

    def __init__(self, control_socket: Path, policy: RolePolicy, *, record: Record) -> None:
        """Make the folder, in the place of one that an earlier daemon has left.

        Args:
            control_socket: the daemon's socket.
            policy: who may stop.
            record: records stops.

        Raises:
            DaemonError: that is not possible, or something of the user's is there.
        """
        self._folder = Path(stop_folder(str(control_socket)))
        self._policy, self._record = policy, record
        try:
            _remove_left_over(self._folder)
            self._folder.mkdir(mode=0o700)
            self._let_reach()
        except OSError as error:
            raise DaemonError(f"cannot make {self._folder}: {error.strerror}") from error

    def path(self, device: str) -> str:
        """Return where the servo of a device listens."""
        return str(self._folder / device)

    @property
    def admitted(self) -> dict[str, list[int]]:
        """The numbers of the users and the groups that may stop."""
        return self._policy.tables()

    def admit(self, policy: RolePolicy) -> None:
        """Allow other users and groups to stop from now on."""
        self._policy = policy
        news = b"admit " + json.dumps(self.admitted).encode()
        try:
            self._let_reach()
            folder = os.open(self._folder, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        except OSError as error:
            what = "%s: the servos do not take the news of who may stop: %s"
            _log.warning(what, self._folder, error.strerror)
            return
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sending:
                sending.settimeout(_TAKING)
                for path in self._folder.iterdir():
                    try:
                        sending.sendto(news, f"/proc/self/fd/{folder}/{path.name}")
                    except (ConnectionRefusedError, FileNotFoundError):
                        pass  # a servo that does not run reads it when it starts
                    except OSError:
                        what = "%s: the servo does not take the news of who may stop; reload again"
                        _log.warning(what, path.name)
        finally:
            os.close(folder)

    def log_stops(self, device: str, stops: Sequence[Stop]) -> str:
        """Record stops that the servo of a device took; return who stopped it, in words."""
        who = ""
        for (is_quickest, pid, uid, gid), times in Counter(stop[1:] for stop in stops).items():
            process = Process(pid, uid, (gid,))
            who, kind = str(self._policy.identify(process) or process), KINDS[is_quickest]
            self._record(
                origin=f"unix, process {pid}",
                identity=str(process),
                kind=kind,
                devices=[device],
                times=times,
            )
            again = f", {times} times" if times > 1 else ""
            _log.info("%s: %s by %s%s", device, kind, who, again)
        return who

    def close(self) -> None:
        """Remove the folder, once the servos have ended; files of the user stay."""
        with contextlib.suppress(OSError, DaemonError):
            _remove_left_over(self._folder)

    def _let_reach(self) -> None:
        self._folder.chmod(0o755 if self._policy.admits_others else 0o700)


def _remove_left_over(folder: Path) -> None:
    """Remove a folder of stop sockets; a user's folder of the same name keeps all of its files.

    Raises:
        DaemonError: it is no folder, or holds anything but sockets.
        OSError: it cannot be removed.
    """
    if folder.is_symlink() or not folder.is_dir():
        if folder.is_socket():  # of an older version
            folder.unlink()
        elif folder.is_symlink() or folder.exists():
            raise DaemonError(f"{folder} is no folder of stop sockets: {_ADVICE}")
        return
    entries = sorted(folder.iterdir())
    other = next((path for path in entries if path.is_symlink() or not path.is_socket()), None)
    if other is not None:
        raise DaemonError(f"{folder} holds {other.name!r}, which is no stop socket: {_ADVICE}")
    for path in entries:
        path.unlink()
    folder.rmdir()
