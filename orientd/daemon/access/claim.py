"""One daemon for each socket: a lock that dies with its process, and no stale sockets."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket as sockets
import stat
from collections.abc import Iterator
from pathlib import Path

from orientd.client.trust import check_folder
from orientd.errors import DaemonError


@contextlib.contextmanager
def claimed(path: Path) -> Iterator[None]:
    """Hold the right to listen at *path*; nothing is left there in the end.

    The directory is made if need be, for its owner only.  A socket that a daemon left behind when
    it was killed is removed.

    Raises:
        DaemonError: a daemon listens there, something else is there, or it is not permitted.
    """
    _make_directory(path.parent)
    lock_path = path.with_name(f"{path.name}.lock")
    descriptor = _lock(lock_path, path)
    try:
        _remove_stale(path)
        try:
            yield
        finally:
            path.unlink(missing_ok=True)
    finally:
        # Unlink before unlocking: no other daemon can then lock a file that is already deleted.
        lock_path.unlink(missing_ok=True)
        os.close(descriptor)


def _make_directory(directory: Path) -> None:
    try:
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise DaemonError(f"cannot make {directory}: {error.strerror}") from error
    check_folder(directory)


def _lock(lock_path: Path, path: Path) -> int:
    """Return the descriptor of the locked file, with this process' id in it."""
    flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
    while True:
        try:
            descriptor = os.open(lock_path, flags, 0o600)
        except OSError as error:
            raise DaemonError(f"cannot lock {lock_path}: {error.strerror}") from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.read(descriptor, 32).decode(errors="replace").strip()
            os.close(descriptor)
            if error.errno not in (errno.EAGAIN, errno.EACCES):
                raise DaemonError(f"cannot lock {lock_path}: {error.strerror}") from error
            who = f"process {holder}" if holder else "another process"
            raise DaemonError(f"a daemon listens at {path} already ({who})") from error
        if is_same_file(descriptor, lock_path):
            content = os.read(descriptor, 32).strip()
            if content and not content.isdigit():
                os.close(descriptor)
                raise DaemonError(
                    f"{lock_path} is no lock of a daemon: move it away, or choose another socket"
                )
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
            return descriptor
        os.close(descriptor)  # removed by its last holder in between


def is_same_file(descriptor: int, path: Path) -> bool:
    """Whether the open file is the one at *path* now."""
    try:
        there = path.stat()
    except FileNotFoundError:
        return False
    return os.path.samestat(os.fstat(descriptor), there)


def _remove_stale(path: Path) -> None:
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(mode):
        raise DaemonError(f"cannot listen at {path}: the file exists and is not a socket")
    listens = f"cannot listen at {path}: another program listens there"
    with sockets.socket(sockets.AF_UNIX, sockets.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink(missing_ok=True)
        except BlockingIOError as error:  # as many connections wait there as it permits
            raise DaemonError(listens) from error
        except OSError as error:
            raise DaemonError(f"cannot use the socket {path}: {error.strerror}") from error
        else:
            raise DaemonError(listens)
