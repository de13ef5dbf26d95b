"""What crosses as JSON: a driver's options of a motion, and how a device's parts are."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from orientd.driver import PartHealth
from orientd.stream.records import HEALTH_TEXT_BYTES, TUNING_TEXT_BYTES
from orientd.stream.ring import RecordRing


def tuning_text(options: Mapping[str, Any]) -> bytes:
    """Return *options* as they cross to the servo.

    Raises:
        ValueError: they are too long, or more than JSON can say.
    """
    try:
        text = json.dumps(dict(options), allow_nan=False).encode()
    except TypeError as error:
        raise ValueError(str(error)) from error
    if len(text) > TUNING_TEXT_BYTES:
        raise ValueError(f"at most {TUNING_TEXT_BYTES} bytes of JSON are allowed, got {len(text)}")
    return text


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
