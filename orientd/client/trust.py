"""Check that a socket belongs to a trusted user: this one, root, or a named one.

Another user could answer "stopped" while nothing stops.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from orientd.errors import AccessError, DaemonError
from orientd.first_stop import SYSTEM_SOCKET

DAEMON_USER = "ORIENTD_DAEMON_USER"
"""Environment variable: another user whose daemon is trusted too."""


def check_uid(path: Path, uid: int) -> None:
    """Refuse a process of the user *uid* at *path*, unless it is this user, root or a trusted one.

    The owner of the system's folder is trusted there, since root created it.

    Raises:
        DaemonError: the user is not trusted.
    """
    import pwd  # a client on Windows reaches a daemon by its address alone

    trusted, named = {0, os.geteuid()}, os.environ.get(DAEMON_USER, "")
    try:
        if named:
            trusted.add(int(named) if named.isdigit() else pwd.getpwnam(named).pw_uid)
    except KeyError as error:
        raise DaemonError(f"{DAEMON_USER}: there is no user {named!r} on this machine") from error
    system = Path(SYSTEM_SOCKET).parent
    if path.is_relative_to(system) and system.exists():
        trusted.add(system.stat().st_uid)
    if uid not in trusted:
        raise DaemonError(
            f"{path} is of {_user(uid)}, no daemon of yours; to trust it set {DAEMON_USER}={uid}"
        )


def check_socket(path: Path) -> None:
    """Refuse a socket of an untrusted user, or one that this user may not use.

    Raises:
        DaemonError: it is not a socket, or belongs to another user.
        AccessError: its daemon admits only its own user.
    """
    try:
        found = path.lstat()
    except OSError:
        return  # gRPC says that there is none
    if not stat.S_ISSOCK(found.st_mode):
        raise DaemonError(f"{path} is not a socket")
    check_uid(path, found.st_uid)
    if not os.access(path, os.W_OK):
        raise AccessError(
            f"the daemon at {path} is of {_user(found.st_uid)}, and does not admit "
            f"{_user(os.geteuid())}"
        )


def check_folder(folder: Path) -> None:
    """Refuse a socket's folder that another user owns, or that everybody can write.

    A shared folder such as ``/tmp`` is refused too.  Its sticky bit protects the files that you
    have there.  But another user can take the name of your socket, its lock or its stop folder
    first, and then your daemon does not start.

    A folder that its group can write causes a warning.  A member can remove the socket, and then
    nothing can stop the device through it.  No member can answer in its place, since each answer
    is checked for its user.

    Raises:
        DaemonError: the folder is not safe.
    """
    found = folder.stat()
    check_uid(folder, found.st_uid)
    mode = stat.S_IMODE(found.st_mode)
    if mode & stat.S_IWOTH:
        is_shared = mode & stat.S_ISVTX
        advice = "" if is_shared else f"chmod o-w {folder}, or "
        raise DaemonError(
            f"others can write {folder} (mode {mode:o}): {advice}choose another folder"
        )
    if mode & stat.S_IWGRP:
        import logging  # a stop does without

        problem = "the group of %s can remove the sockets in it (mode %o): chmod g-w %s"
        logging.getLogger(__name__).warning(problem, folder, mode, folder)


def _user(uid: int) -> str:
    import pwd

    try:
        return f"{pwd.getpwuid(uid).pw_name} (user {uid})"
    except KeyError:
        return f"user {uid}"
