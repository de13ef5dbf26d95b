"""What a request asked for, as the audit log tells it: short, and without anybody's secrets."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Mapping
from typing import Any

from google.protobuf.json_format import MessageToDict, SerializeToJsonError
from google.protobuf.message import DecodeError, Message

from orientd.rpc import control_pb2 as pb

SECRETS = ("lease_token", "token", "share_token")
"""Fields that are nobody's business, wherever they are."""

MOST_BYTES = 4096
"""Of a request that is told in full; of a larger one there is a summary."""

MOST_TEXT = 200
"""Characters of one text."""


def describe(request: Message) -> dict[str, Any]:
    """Return what *request* asks for.

    >>> from orientd.rpc import control_pb2 as pb
    >>> describe(pb.SetSpeedRequest(lease_token="abc", device="arm", speed=0.5))
    {'device': 'arm', 'speed': 0.5}
    """
    size = request.ByteSize()
    if size <= MOST_BYTES:
        if isinstance(getattr(request, "motion", None), bytes):
            with contextlib.suppress(DecodeError):
                request = getattr(pb, request.DESCRIPTOR.name).FromString(
                    request.SerializeToString()
                )
        # A time out of its range has no text; what it is in is refused by whoever reads it.
        with contextlib.suppress(SerializeToJsonError):
            return _tidy(MessageToDict(request, preserving_proto_field_name=True))
    told: dict[str, Any] = {
        "bytes": size,
        "sha256": hashlib.sha256(request.SerializeToString(deterministic=True)).hexdigest(),
    }
    for field, content in request.ListFields():
        if isinstance(content, str) and field.name not in SECRETS:
            told[field.name] = content[:MOST_TEXT]
    count = keyframes(request)
    if count:
        told["keyframes"] = count
    return told


def keyframes(request: Message) -> int:
    """Return how many keyframes *request* has."""
    motion = getattr(request, "motion", None)
    return len(getattr(motion, "keyframes", ()))


def token(request: Message) -> str:
    """Return the token of the lease that *request* is made under; empty where it has none."""
    for part in (request, getattr(request, "start", None), getattr(request, "request", None)):
        for name in SECRETS:
            found = getattr(part, name, "")
            if isinstance(found, str) and found:
                return found
    return ""


def _tidy(content: Mapping[str, Any]) -> dict[str, Any]:
    tidy: dict[str, Any] = {}
    for name, inner in content.items():
        if name in SECRETS:
            continue
        if isinstance(inner, Mapping):
            tidy[name] = _tidy(inner)
        elif isinstance(inner, str):
            tidy[name] = inner[:MOST_TEXT]
        else:
            tidy[name] = inner
    return tidy
