"""Write a file completely or not at all: a full disk or a power cut leaves the old file."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from orientd.errors import OrientdError


@contextlib.contextmanager
def written(path: Path) -> Iterator[Path]:
    """Yield the file to write, with the suffix of *path*, which it replaces at the end.

    A path that is no file, such as a pipe, is written directly.

    Raises:
        OrientdError: it cannot be written; then *path* is unchanged.
    """
    target = Path(os.path.realpath(path))
    is_special = target.exists() and not target.is_file()
    part = target if is_special else target.with_name(f".{secrets.token_hex(4)}{path.suffix}")
    try:
        try:
            yield part
            if not is_special:
                _sync(part)
            part.replace(target)
        finally:
            if not is_special:
                part.unlink(missing_ok=True)
    except OSError as error:
        raise OrientdError(f"cannot write {path}: {error.strerror or error}") from error


def _sync(path: Path) -> None:
    """Have the disk keep the content before the name: a power cut would leave an empty file."""
    descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
