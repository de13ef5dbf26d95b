"""Calls that come by the gateway, to the control socket's handlers, behind the same check."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from types import SimpleNamespace
from typing import Any, NoReturn

import grpc
from google.rpc import status_pb2

from orientd.rpc import DETAILS_KEY

_log = logging.getLogger(__name__)

Send = Callable[[bytes], Awaitable[None]]
"""Sends one answer on."""

FindHandler = Callable[[Any], Awaitable[Any]]
"""Returns what handles a call, with the check of it in front; ``None`` for no such call.

It is given what gRPC tells of a call at first: its method.
"""


class _Refused(Exception):  # noqa: N818 - nobody but this module sees it
    """A handler has ended its call."""


class _Context:
    """As much of gRPC's context of a call as handlers here make use of."""

    def __init__(self, peer: str) -> None:
        self._peer = peer
        self.status = status_pb2.Status()

    def peer(self) -> str:
        return self._peer

    def code(self) -> grpc.StatusCode | None:
        return _CODES.get(self.status.code)

    def details(self) -> str:
        return str(self.status.message)

    async def abort(
        self, code: grpc.StatusCode, text: str, trailing: Sequence[tuple[str, bytes]] = ()
    ) -> NoReturn:
        details = dict(trailing).get(DETAILS_KEY)
        if details is not None:
            self.status.ParseFromString(details)
        else:
            self.status = _status(code, text)
        raise _Refused


_CODES = {code.value[0]: code for code in grpc.StatusCode}


class Requests:
    """The requests of a call that has many, as they come."""

    def __init__(self, *, taken: Callable[[], Awaitable[None]]) -> None:
        """Begin with none; tell *taken* of each that the handler has had."""
        self._taken = taken
        self._bodies: asyncio.Queue[bytes | None] = asyncio.Queue()
        self.waiting = 0
        """Bytes that the handler has not taken yet."""

    def add(self, body: bytes | None) -> None:
        """Add one, as serialised; ``None`` after the last."""
        self.waiting += len(body or b"")
        self._bodies.put_nowait(body)

    async def read(self, deserialize: Callable[[bytes], Any]) -> AsyncIterator[Any]:
        """Yield each as a message."""
        while (body := await self._bodies.get()) is not None:
            self.waiting -= len(body)
            await self._taken()
            yield deserialize(body)


async def carry(
    find: FindHandler, method: str, peer: str, body: bytes | Requests, send: Send
) -> bytes:
    """Handle one call, and send its answers; return the status that it ended with, empty if OK.

    Args:
        find: finds its handler.
        method: full name, ``/service/Name``.
        peer: what the door knows the caller by.
        body: the request, as serialised; or all of them, of a call that has many.
        send: takes the answers, as serialised.
    """
    handler = await find(SimpleNamespace(method=method))
    if handler is None or handler.request_streaming != isinstance(body, Requests):
        return _written(_status(grpc.StatusCode.UNIMPLEMENTED, f"there is no call {method}"))
    context = _Context(peer)
    if isinstance(body, Requests):
        request: Any = body.read(handler.request_deserializer)
        stream, single = handler.stream_stream, handler.stream_unary
    else:
        request = handler.request_deserializer(body)
        stream, single = handler.unary_stream, handler.unary_unary
    try:
        if handler.response_streaming:
            async for answer in stream(request, context):
                await send(handler.response_serializer(answer))
        else:
            await send(handler.response_serializer(await single(request, context)))
    except _Refused:
        return _written(context.status)
    except Exception as error:  # noqa: BLE001 - as gRPC: one call is no reason to end
        _log.exception("fleet: %s failed", method)
        return _written(_status(grpc.StatusCode.INTERNAL, repr(error)))
    return b""


def too_large(size: int, most: int) -> bytes:
    """Return the status of a request that is larger than any may be, as gRPC's server has it."""
    text = f"Received message larger than max ({size} vs. {most})"
    return _written(_status(grpc.StatusCode.RESOURCE_EXHAUSTED, text))


def _written(status: status_pb2.Status) -> bytes:
    content: bytes = status.SerializeToString()
    return content


def _status(code: grpc.StatusCode, text: str) -> status_pb2.Status:
    return status_pb2.Status(code=code.value[0], message=text)
