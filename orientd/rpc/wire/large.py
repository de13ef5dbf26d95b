"""Motions too large for one message: sent in pieces."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeVar

from orientd.rpc import control_pb2 as pb

LARGE_BYTES = 500_000
"""Of a motion that goes in pieces: some 10,000 keyframes."""

PIECE_BYTES = 256 * 1024

Request = TypeVar("Request", pb.PlanRequest, pb.MoveRequest)
Part = TypeVar("Part", pb.PlanLargeRequest, pb.MoveLargeRequest)


def cut_motion(request: Request) -> bytes:
    """Take a large motion out of *request* and return its bytes; leave a small one there."""
    if request.motion.ByteSize() <= LARGE_BYTES:
        return b""
    motion = request.motion.SerializeToString()
    request.ClearField("motion")
    return motion


def in_pieces(make: Callable[..., Part], request: Request, motion: bytes) -> Iterator[Part]:
    """Yield *request* and the bytes of its *motion*, as messages that *make* makes."""
    yield make(request=request)
    for first in range(0, len(motion), PIECE_BYTES):
        yield make(piece=motion[first : first + PIECE_BYTES])
