"""Which build of the kernels this machine runs: the widest vector instructions that it has.

Every build is of the same sources.  One for each level of x86-64 (v2, v3: AVX2 and FMA, v4:
AVX-512), one for any other architecture.
"""

from __future__ import annotations

import os
import platform
import zlib
from pathlib import Path

LEVELS = {
    "x86-64-v4": ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"),
    "x86-64-v3": ("avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"),
    "x86-64-v2": ("cx16", "lahf_lm", "popcnt", "sse4_1", "sse4_2", "ssse3"),
}
"""What a processor must say of itself for each level and those below it, widest first."""

FORCED = "ORIENTD_LEVEL"
"""The environment variable that names a level to use in place of the widest one."""

HOME = Path(__file__).parent
SOURCES = HOME / "c"

REBUILD = "python -m orientd.kernels.build"


def machine_levels() -> list[str]:
    """Return the levels that this machine can run, widest first."""
    machine = platform.machine().lower()
    if machine not in ("x86_64", "amd64"):
        return [machine]
    flags = _flags()
    narrower = list(LEVELS)
    while narrower and not all(flags.issuperset(LEVELS[level]) for level in narrower):
        narrower.pop(0)
    return narrower


def folder() -> Path:
    """Return where the build for this machine lies.

    Raises:
        ImportError: there is none.
    """
    forced = os.environ.get(FORCED)
    levels = [forced] if forced else machine_levels()
    for level in levels:
        if list((HOME / level).glob("native.*")):
            return HOME / level
    raise ImportError(
        f"orientd has no kernels for {' or '.join(levels) or 'this processor'}: run `{REBUILD}`"
    )


def digest() -> str:
    """Return a checksum of the sources; empty where they are not installed, as from a wheel."""
    checksum = 0
    for source in sorted(SOURCES.glob("*.[ch]")):
        checksum = zlib.crc32(source.read_bytes(), zlib.crc32(source.name.encode(), checksum))
    return f"{checksum:08x}" if SOURCES.is_dir() else ""


def check_sources(built_from: str) -> None:
    """Refuse kernels that were built from other sources than those beside them.

    Raises:
        ImportError: a source has changed since.
    """
    if digest() not in ("", built_from):
        raise ImportError(f"the sources of orientd's kernels have changed: run `{REBUILD}`")


def _flags() -> set[str]:
    with Path("/proc/cpuinfo").open(encoding="ascii", errors="replace") as lines:
        for line in lines:
            if line.startswith("flags"):
                return set(line.partition(":")[2].split())
    return set()
