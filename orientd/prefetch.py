"""Shared libraries read before they are imported, so that nobody has to wait for the disk.

While a library is being loaded the interpreter's lock is held.  From a disk that has not been read
lately, as after booting, LLVM alone takes over a second: long enough for a servo to hear no
heartbeat and to stop what moves.  Reading a file takes as long, but lets everybody else go on.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

_BLOCK = 1 << 20
_lock = threading.Lock()
_read: set[str] = set()


def prefetch(*packages: str) -> None:
    """Read the shared libraries of packages, unless this process has done so before.

    Args:
        packages: top-level names; what is not installed is left out.
    """
    with _lock:
        for name in packages:
            if name not in _read:
                for library in libraries(name):
                    with contextlib.suppress(OSError):
                        _read_through(library)
                _read.add(name)


def libraries(package: str) -> Iterator[Path]:
    """Yield the shared libraries inside a package, and those that its wheel has put beside it."""
    spec = find_spec(package)
    for place in (spec and spec.submodule_search_locations) or ():
        home = Path(place)
        yield from home.rglob("*.so*")
        yield from home.parent.glob(f"{package}.libs/*.so*")


def _read_through(file: Path) -> None:
    block = bytearray(_BLOCK)
    descriptor = os.open(file, os.O_RDONLY)
    try:
        while os.readv(descriptor, [block]):
            pass
    finally:
        os.close(descriptor)
