"""Whether what listens at a Unix socket is the daemon of somebody who may be trusted.

Whoever can put a socket there could answer "stopped" while nothing stops.  So nobody but the user,
root, or whose daemon the user says it is, may own or write any folder on the way to it, and the
process at the other end must be one of theirs.
"""

from __future__ import annotations

import contextlib
import grp
import os
import pwd
import socket
import stat
import struct
from pathlib import Path

from orientd.errors import AccessError, DaemonError

SYSTEM_FOLDER = Path("/run/orientd")
"""Of the daemon that runs as a service of the system: whose it is, root has said."""

DAEMON_USER = "ORIENTD_DAEMON_USER"
"""Names the user of the environment whose daemon is to be trusted too."""

_OTHERS_WRITE, _GROUP_WRITES = 0o002, 0o020
_UCRED = struct.Struct("iII")
_PROBE = 1.0


def trusted_users(folder: Path) -> set[int]:
    """Return the numbers of the users whose daemon in *folder* is trusted.

    Raises:
        DaemonError: the environment names a user that there is not.
    """
    users = {0, os.geteuid()}
    named = os.environ.get(DAEMON_USER, "")
    try:
        if named:
            users.add(int(named) if named.isdigit() else pwd.getpwnam(named).pw_uid)
    except KeyError as error:
        raise DaemonError(f"{DAEMON_USER}: there is no user {named!r} on this machine") from error
    if folder == SYSTEM_FOLDER:
        with contextlib.suppress(OSError):
            users.add(folder.stat().st_uid)
    return users


def check_folder(folder: Path) -> None:
    """Refuse a folder that others own or can write, or that can be replaced by others.

    Raises:
        DaemonError: it is one; the message says which part of its path, and why.
    """
    users = trusted_users(folder)
    for place in reversed([folder, *folder.parents]):
        if place.is_symlink():
            _check(place, place.lstat(), users, is_folder=False)
    whole = Path(os.path.realpath(folder))
    for place in [*reversed(whole.parents), whole]:
        try:
            found = place.stat()
        except OSError:
            return  # what is not there is nobody's
        _check(place, found, users, is_folder=place == whole)


def _check(place: Path, found: os.stat_result, users: set[int], *, is_folder: bool) -> None:
    if found.st_uid not in users:
        raise DaemonError(f"{place} belongs to another user ({_user(found.st_uid)})")
    mode = found.st_mode
    if stat.S_ISLNK(mode) or (mode & stat.S_ISVTX and not is_folder):
        return
    if mode & _OTHERS_WRITE or (mode & _GROUP_WRITES and not _is_private(found)):
        raise DaemonError(f"others can write {place} (mode {stat.S_IMODE(mode):o}): chmod go-w it")


def _is_private(found: os.stat_result) -> bool:
    """Whether the group of a file has its owner alone in it."""
    with contextlib.suppress(KeyError):
        owner = pwd.getpwuid(found.st_uid)
        members = set(grp.getgrgid(found.st_gid).gr_mem)
        return owner.pw_gid == found.st_gid and members <= {owner.pw_name}
    return False


def check_socket(path: Path) -> None:
    """Refuse a socket that is not of somebody trusted, or in a folder of others.

    Where there is none, or nobody listens, nothing is refused.

    Raises:
        DaemonError: it is refused; the message says why.
        AccessError: its daemon admits its own user alone.
    """
    path = path.absolute()
    check_folder(path.parent)
    try:
        found = path.lstat()
    except OSError:
        return
    if not stat.S_ISSOCK(found.st_mode):
        kind = "a symbolic link" if stat.S_ISLNK(found.st_mode) else "no socket"
        raise DaemonError(f"{path} is {kind}")
    with socket.socket(socket.AF_UNIX) as probe:
        probe.settimeout(_PROBE)
        try:
            probe.connect(str(path))
        except PermissionError as error:
            raise AccessError(
                f"the daemon at {path} is {_user(found.st_uid)}'s, and does not admit "
                f"{_user(os.geteuid())}"
            ) from error
        except OSError:
            # Of one that is too busy the owner is known from the file.
            check_uid(path, found.st_uid)
            return
        check_peer(path, probe)


def check_peer(path: Path, connected: socket.socket) -> None:
    """Refuse the process at the other end of a connection to *path* unless it is trusted.

    Raises:
        DaemonError: it is of another user.
    """
    credentials = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size)
    _, uid, _ = _UCRED.unpack(credentials)
    check_uid(path, uid)


def check_uid(path: Path, uid: int) -> None:
    """Refuse what is of the user *uid* at *path* unless they are trusted.

    Raises:
        DaemonError: they are not.
    """
    if uid not in trusted_users(path.parent):
        raise DaemonError(
            f"what listens at {path} is {_user(uid)}'s, and no daemon of yours; "
            f"if it is to be trusted: {DAEMON_USER}={uid}"
        )


def _user(uid: int) -> str:
    try:
        return f"{pwd.getpwuid(uid).pw_name} (user {uid})"
    except KeyError:
        return f"user {uid}"
