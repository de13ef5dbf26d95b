"""Calls that come by the gateway, to the control socket's handlers, behind the same check."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import grpc
from google.rpc import status_pb2

from orientd.rpc import DETAILS_KEY

_log = logging.getLogger(__name__)

Send = Callable[[bytes], Awaitable[None]]
"""Sends one answer on."""

FindHandler = Callable[[Any], Awaitable[Any]]
"""Returns what handles a call, with the check of it in front; ``None`` for no such call."""


@dataclass(frozen=True)
class _Details:
    """What gRPC tells of a call before its handler is found."""

    method: str
    invocation_metadata: Sequence[tuple[str, str]] = ()


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


async def carry(find: FindHandler, method: str, peer: str, body: bytes, send: Send) -> bytes:
    """Handle one call, and send its answers; return the status that it ended with, empty if OK.

    Args:
        find: finds its handler.
        method: full name, ``/service/Name``.
        peer: what the door knows the caller by.
        body: the request, as serialised.
        send: takes the answers, as serialised.
    """
    handler = await find(_Details(method))
    if handler is None or handler.request_streaming:
        text = f"{method} is for the control socket alone"
        return _written(_status(grpc.StatusCode.UNIMPLEMENTED, text))
    context = _Context(peer)
    request = handler.request_deserializer(body)
    try:
        if handler.response_streaming:
            async for answer in handler.unary_stream(request, context):
                await send(handler.response_serializer(answer))
        else:
            await send(handler.response_serializer(await handler.unary_unary(request, context)))
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
