"""What each version of a controller's software has: one table, and what to say of it.

Versions are tuples that begin with major and minor: 3 is CB3, 5 the e-Series, 10 PolyScope X.
"""

from __future__ import annotations

from collections.abc import Sequence

Version = tuple[int, ...]

# Feature: the first version that has it, of CB3, of the e-Series, of PolyScope X; None for none.
# Client library: its registers, and its script; tcp_offset: pull request 110 of
# Universal_Robots_Client_Library; remote control: `dashboard_client.cpp` there.
_SINCE: dict[str, dict[int, Version | None]] = {
    "the client library": {3: (3, 4), 5: (5, 4), 10: (10, 10)},
    "tcp_offset": {3: (3, 12), 5: (5, 5, 1), 10: (10,)},
    "a dashboard server": {3: (3,), 5: (5,), 10: None},
    "is in remote control": {3: None, 5: (5, 6), 10: None},
}


def name(version: Sequence[int]) -> str:
    """Return how to call the software."""
    return "PolyScope " + ".".join(str(part) for part in version[:3])


def series(version: Sequence[int]) -> int:
    """Return 3 for CB3, 5 for the e-Series, 10 for PolyScope X."""
    return 3 if version[0] < 5 else 5 if version[0] < 10 else 10


def since(feature: str, version: Sequence[int]) -> Version | None:
    """Return the first version of the robot's series with *feature*; ``None`` where none has it."""
    return _SINCE[feature][series(version)]


def has(feature: str, version: Sequence[int]) -> bool:
    """Return whether a robot with this *version* has *feature*."""
    first = since(feature, version)
    return first is not None and tuple(version) >= first


def problem(version: Sequence[int]) -> str:
    """Return why the client library cannot drive this version; nothing where it can."""
    if has("the client library", version):
        return ""
    first = since("the client library", version)
    needed = ".".join(map(str, first or ()))
    return f"{name(version)} is too old for the client library; {needed} or newer is needed"


def first_versions(feature: str) -> str:
    """Return in words since when robots have *feature*."""
    words = {3: "CB3", 5: "e-Series", 10: "PolyScope X"}
    return ", ".join(
        f"{words[one]} from {'.'.join(map(str, first))}"
        for one, first in _SINCE[feature].items()
        if first is not None
    )
