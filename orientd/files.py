"""Read a user's file within a bound, and write a file completely or not at all.

A device such as ``/dev/zero`` has no end, and a pipe may have no writer.  A file that is too large
is refused before it is read.  A full disk or a power cut leaves the old file.

A written file outlives a power cut: its content is synced first, then its name.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import stat
from collections.abc import Iterator
from pathlib import Path

from orientd.errors import OrientdError, RequestError

MEBIBYTE = 1024 * 1024
MOST_BYTES = 8 * MEBIBYTE
"""Of a YAML or JSON file; a keyframe takes about a hundred."""

MOST_VALUES = 1_000_000
"""Of such a file, those repeated by aliases included; each takes up to a hundred bytes."""

SILENCE = 5.0
"""Longest silence of a pipe, s."""

_PIECE = 256 * 1024

# The last one is Windows' only, which lacks the others.
_FLAGS = ("O_NONBLOCK", "O_CLOEXEC", "O_NOCTTY", "O_BINARY")
_READING = os.O_RDONLY | sum(getattr(os, flag, 0) for flag in _FLAGS)


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """Return the content of a file, or of a pipe until its writer closes it.

    Raises:
        OSError: it cannot be read, holds more than *most_bytes*, is neither file nor pipe, or is a
            pipe that says nothing for :data:`SILENCE`; ``strerror`` says which.
    """
    # Without waiting: opening a pipe without a writer would take for ever.
    descriptor = os.open(path, _READING)
    try:
        found = os.fstat(descriptor)
        is_pipe = stat.S_ISFIFO(found.st_mode)
        if not is_pipe:
            check_regular(path, found, most_bytes)
        pieces: list[bytes] = []
        size = 0
        while size <= most_bytes:
            if is_pipe and not select.select([descriptor], [], [], SILENCE)[0]:
                raise OSError(errno.ETIMEDOUT, f"nothing came through this pipe for {SILENCE:g} s")
            piece = os.read(descriptor, min(_PIECE, most_bytes + 1 - size))
            if not piece:
                return b"".join(pieces)
            pieces.append(piece)
            size += len(piece)
        raise _too_large(most_bytes)
    finally:
        os.close(descriptor)


def file_content(path: Path) -> bytes:
    """Return the bytes of a YAML or JSON file.

    Raises:
        RequestError: it cannot be read, or has more than :data:`MOST_BYTES`.
    """
    try:
        return read_bounded(path, MOST_BYTES)
    except OSError as error:
        raise RequestError("", f"cannot read {path}: {error.strerror}") from error


def check_regular(path: Path, found: os.stat_result | None = None, most_bytes: int = 0) -> None:
    """Check that there is a regular file at *path*, which can be read in pieces from its start.

    Args:
        path: of the file.
        found: what is known of it, if that is known.
        most_bytes: that it may hold; 0 for any number.

    Raises:
        OSError: there is none, or it is something else or larger; ``strerror`` says which.
    """
    found = path.stat() if found is None else found
    if stat.S_ISDIR(found.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "not a regular file")
    if most_bytes and found.st_size > most_bytes:
        raise _too_large(most_bytes, found.st_size)


def _too_large(most_bytes: int, size: int | None = None) -> OSError:
    came = "more" if size is None else f"{size / MEBIBYTE:.1f} MiB"
    return OSError(errno.EFBIG, f"expected at most {most_bytes / MEBIBYTE:g} MiB, got {came}")


@contextlib.contextmanager
def written(path: Path) -> Iterator[Path]:
    """Yield the file to write, with the suffix of *path*, which it replaces at the end.

    Afterwards the new file outlives a power cut.  A path that is no file, such as a pipe, is
    written directly.

    Raises:
        OrientdError: it cannot be written; then *path* is unchanged.
    """
    target = Path(os.path.realpath(path))
    is_special = target.exists() and not target.is_file()
    part = target if is_special else target.with_name(f".{os.urandom(4).hex()}{path.suffix}")
    try:
        try:
            yield part
            if not is_special:
                sync(part)
                part.replace(target)
                sync_name(target)
        finally:
            if not is_special:
                part.unlink(missing_ok=True)
    except OSError as error:
        raise OrientdError(f"cannot write {path}: {error.strerror or error}") from error


def sync(path: Path) -> None:
    """Have the disk keep the content of a file: after a power cut it would be empty.

    Raises:
        OSError: the disk did not take it.
    """
    descriptor = os.open(path, os.O_RDWR | getattr(os, "O_CLOEXEC", 0))
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def sync_name(path: Path) -> None:
    """Have the disk keep the name of a file, after its content; never raises.

    A folder that cannot be synced, for example on some network drives, keeps the name in its own
    time.
    """
    with contextlib.suppress(OSError):
        descriptor = os.open(path.parent, os.O_RDONLY | getattr(os, "O_CLOEXEC", 0))
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
