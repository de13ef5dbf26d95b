"""How a device's parts are, as it crosses to the daemon."""

from __future__ import annotations

import json
from collections.abc import Sequence

from orientd.driver import PartHealth
from orientd.stream.records import HEALTH_TEXT_BYTES
from orientd.stream.ring import RecordRing


def publish_health(ring: RecordRing, parts: Sequence[PartHealth]) -> None:
    """Write how *parts* are, without those for which there is no room."""
    kept = list(parts)
    while len(text := json.dumps(kept).encode()) > HEALTH_TEXT_BYTES:
        kept.pop()
    ring.publish(len(text), text)


def newest_health(ring: RecordRing) -> tuple[PartHealth, ...]:
    """Return how the parts were last said to be; empty before that."""
    fields = ring.read(ring.head - 1) if ring.head else None
    if fields is None:
        return ()
    _, length, text = fields
    return tuple(PartHealth(*part) for part in json.loads(text[:length]))
