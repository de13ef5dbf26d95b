"""Frames between a daemon and its gateway: a header of JSON and a body, each with its length."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any, BinaryIO

LENGTHS = struct.Struct("<II")
"""Of the header and of the body, bytes."""

Header = dict[str, Any]


def write_frame(header: Mapping[str, Any], body: bytes = b"") -> bytes:
    """Return a frame as it is sent."""
    said = json.dumps(header).encode()
    return LENGTHS.pack(len(said), len(body)) + said + body


def read_frame(incoming: BinaryIO) -> tuple[Header, bytes] | None:
    """Return the next frame; ``None`` at the end."""
    lengths = incoming.read(LENGTHS.size)
    if len(lengths) < LENGTHS.size:
        return None
    head, size = LENGTHS.unpack(lengths)
    said, body = incoming.read(head), incoming.read(size)
    return None if len(said) < head or len(body) < size else (json.loads(said), body)
