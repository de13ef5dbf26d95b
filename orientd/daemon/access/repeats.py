"""What of a flood of records is written: the first of a kind in full, the rest of them counted.

Nobody can have the audit log put its older files out by asking for the same again and again, nor by
asking for ever other things: somebody's lines in full are limited in bytes over time, and what is
beyond is counted by call and outcome.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Record = Mapping[str, Any]

FULL = 5
"""Records that say the same and are written in full, of each window."""

WINDOW = 30.0
"""How long the same is counted before that is written, s."""

BURST_BYTES, BYTES_PER_SECOND = 256 * 1024, 2048.0
"""Of one identity, written in full: at once, and over time."""

LINK_BYTES = 110
"""Of a line, what makes it one of the chain."""

MOST_KINDS = 4096
"""Kinds that are told apart at one time; further ones of an identity are one."""

_VARYING = ("time", "call", "motion", "motion_id")
_KIND = ("event", "method", "identity", "role", "outcome")


@dataclass(slots=True)
class _Kind:
    """Records that count as the same: since when, how many, and what is not written yet."""

    began: float
    count: int = 0
    waiting: int = 0
    first: float = 0.0
    last: Record | None = None


class Repeats:
    """Decide what is written of the records that come."""

    def __init__(self) -> None:
        self._kinds: dict[str, _Kind] = {}
        self._room: dict[str, tuple[float, float]] = {}
        self._next_look = 0.0

    def take(self, record: Record, now: float) -> list[Record]:
        """Return what is to be written because *record* came at *now*, s; often just that."""
        if "times" not in record:  # else whoever tells it has counted
            kind = self._kind(_sameness(record), record, now)
            kind.count += 1
            if kind.count > FULL:
                _count(kind, record)
                return []
        if self._has_room(record, now):
            return [record]
        times = int(record.get("times", 1))
        told = {name: record[name] for name in _KIND if name in record}
        _count(self._kind(json.dumps(told), record, now), {**told, "time": record["time"]}, times)
        return []

    def due(self, now: float, *, is_last: bool = False) -> list[Record]:
        """Return what was counted in windows that have ended by *now*; all if *is_last*."""
        if now < self._next_look and not is_last:
            return []
        self._next_look = now + 1.0
        over = [key for key, kind in self._kinds.items() if is_last or now - kind.began >= WINDOW]
        ended = [self._kinds.pop(key) for key in over]
        return [
            {**kind.last, "times": kind.waiting, "since": kind.first}
            for kind in ended
            if kind.last is not None
        ]

    def _kind(self, key: str, record: Record, now: float) -> _Kind:
        if key not in self._kinds and len(self._kinds) >= MOST_KINDS:
            key = _who(record)
        return self._kinds.setdefault(key, _Kind(now))

    def _has_room(self, record: Record, now: float) -> bool:
        """Whether what this identity has had written leaves room for one more record."""
        who = _who(record)
        room, before = self._room.get(who, (float(BURST_BYTES), now))
        room = min(BURST_BYTES, room + BYTES_PER_SECOND * (now - before))
        size = LINK_BYTES + len(json.dumps(record, default=str))
        self._room[who] = (room - size if room >= size else room, now)
        return room >= size


def _who(record: Record) -> str:
    return str(record.get("identity", ""))


def _count(kind: _Kind, record: Record, times: int = 1) -> None:
    if not kind.waiting:
        kind.first = record["time"]
    kind.waiting += times
    kind.last = record


def _sameness(record: Record) -> str:
    """Return what is equal of records that say the same."""
    same = {name: value for name, value in record.items() if name not in _VARYING}
    # Whoever connects anew comes from another port, or as another process.
    same["origin"] = str(record.get("origin", "")).rstrip("0123456789")
    told = json.dumps(same, default=str, sort_keys=True)
    return hashlib.blake2b(told.encode(), digest_size=16).hexdigest()
