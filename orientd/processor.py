"""Which build of the kernels this machine runs, found without loading it.

Every build is of the same sources.  For x86-64 there is one for each level of its vector
instructions (v2, v3: AVX2 and FMA, v4: AVX-512), for any other architecture there is one.
"""

from __future__ import annotations

import os
import platform
import zlib
from pathlib import Path

from orientd.errors import KernelsError

LEVELS = {
    "x86-64-v2": ("cx16", "lahf_lm", "popcnt", "sse4_1", "sse4_2", "ssse3"),
    "x86-64-v3": ("abm", "avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe"),
    "x86-64-v4": ("avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"),
}
"""Processor flags for each level, in addition to those of the narrower levels."""

FORCED = "ORIENTD_LEVEL"
"""The environment variable that names a level to run in place of the widest one."""

KERNELS = Path(__file__).parent / "kernels"
SOURCES = KERNELS / "c"
BUILD = KERNELS / "build.py"
LIBRARY = "native.abi3.so"


def builds() -> list[str]:
    """Return the levels that there are builds for on this architecture, narrowest first."""
    machine = platform.machine().lower()
    return list(LEVELS) if machine in ("x86_64", "amd64") else [machine]


def level() -> str:
    """Return the level to run: the one that ``ORIENTD_LEVEL`` names, or the widest possible.

    Raises:
        KernelsError: the named one is unknown, or the processor cannot run it, or cannot run any.
    """
    known = builds()
    forced = os.environ.get(FORCED)
    if forced and forced not in known:
        raise KernelsError(f"{FORCED}: expected one of {', '.join(known)}, got {forced!r}")
    candidates = [forced] if forced else known[::-1]
    for candidate in candidates:
        if candidate in runnable():
            return candidate
    narrowest = candidates[-1]
    lacking = ", ".join(_lacking(narrowest))
    raise KernelsError(f"this processor cannot run orientd's kernels for {narrowest}: no {lacking}")


def runnable() -> list[str]:
    """Return the levels that this machine can run, narrowest first."""
    return [candidate for candidate in builds() if not _lacking(candidate)]


def library() -> Path:
    """Return the library of kernels for this machine.

    Raises:
        KernelsError: there is none, or it was built from other sources than the present ones.
    """
    found = KERNELS / level() / LIBRARY
    mend = f"run `python {BUILD}`" if SOURCES.is_dir() else "install orientd again"
    if not found.is_file():
        raise KernelsError(f"orientd has no kernels for {found.parent.name}: {mend}")
    # The library holds the checksum of its sources; from a wheel, which has none, any will do.
    if digest().encode() not in found.read_bytes():
        raise KernelsError(f"the sources of orientd's kernels have changed: {mend}")
    return found


def digest() -> str:
    """Return a checksum of the sources; empty where they are not installed, as from a wheel."""
    if not SOURCES.is_dir():
        return ""
    checksum = 0
    for source in [*sorted(SOURCES.glob("*.[ch]")), BUILD]:
        checksum = zlib.crc32(source.read_bytes(), zlib.crc32(source.name.encode(), checksum))
    return f"{checksum:08x}"


def _lacking(level: str) -> list[str]:
    """Return the missing processor flags of *level* and the narrower levels."""
    names = list(LEVELS)
    needed = names[: names.index(level) + 1] if level in LEVELS else []
    flags = _flags() if needed else set()
    return [flag for name in needed for flag in LEVELS[name] if flag not in flags]


def _flags() -> set[str]:
    """Return the flags of the processor; the minimum if they cannot be read."""
    try:
        for line in Path("/proc/cpuinfo").read_text(errors="replace").splitlines():
            if line.startswith("flags"):
                return set(line.partition(":")[2].split())
    except OSError:
        pass
    return set(LEVELS["x86-64-v2"])
