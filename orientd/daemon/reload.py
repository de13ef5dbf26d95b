"""Separate the settings that a running daemon can change from those that need a restart."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from orientd.config import Settings

CHANGEABLE = (
    "daemon.log_level",
    "access.users",
    "access.groups",
    "access.certificates",
    "access.keyframes",
    "access.streams",
    "tcp.certificate",
    "tcp.key",
    "tcp.ca",
    "tcp.crl",
    "tcp.revoked",
    "metrics",
)
"""Keys, with everything below them; the daemon reads the files that they name again too."""


def changes(before: Settings, after: Settings) -> tuple[list[str], list[str]]:
    """Return the keys that differ: those that can change while the daemon runs, and the others."""
    differing = sorted(set(_differing(before.model_dump(), after.model_dump(), "")))
    can = [key for key in differing if any(f"{key}.".startswith(f"{c}.") for c in CHANGEABLE)]
    return can, [key for key in differing if key not in can]


def _differing(before: Any, after: Any, key: str) -> Iterator[str]:  # noqa: ANN401 - any value
    if before == after:
        return
    if isinstance(before, dict) and isinstance(after, dict):
        for name in before.keys() | after.keys():
            inner = f"{key}.{name}" if key else str(name)
            yield from _differing(before.get(name), after.get(name), inner)
    else:
        yield key
