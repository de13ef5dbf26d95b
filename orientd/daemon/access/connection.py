"""One connection of a client: gRPC's messages and statuses over the HTTP/2 of grpclib.

Of grpclib only the connection is used.  Its server bounds no message, and does not let us see the
socket of a caller.  The protocol is gRPC's: `gRPC over HTTP/2
<https://github.com/grpc/grpc/blob/master/doc/PROTOCOL-HTTP2.md>`_.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from typing import Any

from google.rpc import code_pb2, status_pb2
from grpclib.config import Configuration
from grpclib.metadata import decode_timeout, encode_bin_value, encode_grpc_message
from grpclib.protocol import AbstractHandler, EventsProcessor, H2Protocol, Stream
from grpclib.protocol import Connection as HttpConnection
from h2.config import H2Configuration
from h2.connection import H2Connection
from h2.events import UnknownFrameReceived
from h2.exceptions import ProtocolError
from h2.settings import SettingCodes

from orientd.daemon.access.identity import Caller
from orientd.errors import MessageSizeError, RequestError
from orientd.rpc import DETAILS_KEY

_log = logging.getLogger(__name__)

WINDOW = 256 * 1024
"""Bytes that a client may send ahead of what is read, over one connection and for one call."""

MOST_STREAMS = 1024
"""Calls over one connection that its client has not done with; a client waits with more."""

PIECE = 4 * 1024
"""Bytes of one client that are taken at once; then others have their turn."""

MOST_UNREAD = 16 * 1024 * 1024
"""Bytes that wait for a client to read them; a client that asks for more is hung up on."""

Send = Callable[[bytes], Awaitable[None]]
"""Sends one answer."""

Serve = Callable[[str, Caller, AsyncIterator[bytes], Send], Awaitable[status_pb2.Status | None]]
"""Serves the call of a full name for a caller; returns why it failed, ``None`` where it has not."""

Meet = Callable[[asyncio.BaseTransport], Caller | None]
"""Says who is at the other end of a connection; ``None`` for somebody to hang up on."""

_HTTP2 = H2Configuration(
    client_side=False,
    header_encoding=None,
    validate_inbound_headers=False,
    validate_outbound_headers=False,
    normalize_inbound_headers=False,
    normalize_outbound_headers=False,
)
_CONFIGURATION = Configuration().__for_server__()
_CONTENT = b"application/grpc"
_HEAD = ((":status", "200"), ("content-type", _CONTENT.decode()))
_PREFIX_BYTES = 5
_TIMEOUT_BYTES = 9  # eight digits and a unit: no more is a timeout of gRPC


class Connection(H2Protocol, AbstractHandler):
    """Serve the calls of one caller, each in a task of its own.

    Attributes:
        caller: who is at the other end, once that is known.
    """

    def __init__(
        self,
        meet: Meet,
        serve: Serve,
        *,
        message_bytes: int,
        ended: Callable[[Connection], object],
    ) -> None:
        """Serve nothing until the connection is made.

        Args:
            meet: says who is at the other end, once the connection is made.
            serve: serves each call.
            message_bytes: of the largest message.
            ended: called once, when the connection is over.
        """
        super().__init__(self, _CONFIGURATION, _HTTP2)
        self.caller: Any = None
        self._meet, self._serve = meet, serve
        self._message_bytes = message_bytes
        self._ended = ended
        self._transport: Any = None
        self._calls: dict[Stream, asyncio.Task[None]] = {}
        self._untaken = bytearray()
        self._has_begun = False

    @property
    def is_idle(self) -> bool:
        """Whether no call is under way."""
        return not self._calls

    async def ends_within(self, seconds: float) -> None:
        """Wait *seconds* at the most until no call is under way."""
        if self._calls and seconds:
            await asyncio.wait(self._calls.values(), timeout=seconds)

    def hang_up(self) -> None:
        """End the connection and every call over it."""
        self._transport.abort()

    # asyncio's protocol

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Hang up unless the client is admitted."""
        self._transport = transport
        self.caller = self._meet(transport)
        if self.caller is None:
            self.hang_up()

    def _begin(self) -> None:
        """Begin to speak HTTP/2; a client that says nothing is not worth the memory."""
        http2 = H2Connection(config=_HTTP2)
        http2.initiate_connection()
        http2.increment_flow_control_window(WINDOW - http2.local_settings.initial_window_size)
        http2.update_settings(
            {
                SettingCodes.INITIAL_WINDOW_SIZE: WINDOW,
                SettingCodes.MAX_CONCURRENT_STREAMS: MOST_STREAMS,
            }
        )
        gathering: Any = _Gathering(self._transport)
        self.connection = HttpConnection(http2, gathering, config=self.config)
        self.connection.flush()
        self.processor = EventsProcessor(self, self.connection)
        # RFC 9113, 5.5: frames of an unknown type are ignored.
        self.processor.processors[UnknownFrameReceived] = lambda _: None
        self._has_begun = True

    def data_received(self, data: bytes) -> None:
        """Take what has come, a piece in each turn of the event loop.

        A quarter of a megabyte of the smallest frames would keep everybody waiting for half a
        second.
        """
        if not self._has_begun:
            self._begin()
        is_taking = bool(self._untaken)
        self._untaken += data
        if not is_taking:
            self._take()

    def _take(self) -> None:
        """Take a piece; hang up on a client that does not speak HTTP/2, or does not read."""
        if self._transport.is_closing():
            return
        piece = bytes(self._untaken[:PIECE])
        del self._untaken[:PIECE]
        try:
            super().data_received(piece)
        except Exception as error:  # noqa: BLE001 - whatever a library says of strange bytes
            _log.debug("what is no HTTP/2 has come: %r", error)
            self.hang_up()
            return
        if self._transport.get_write_buffer_size() > MOST_UNREAD:
            _log.warning("%s: hung up on, it does not read what it asks for", self.caller.origin)
            self.hang_up()
        elif self._untaken:
            self._transport.pause_reading()
            asyncio.get_running_loop().call_soon(self._take)
        else:
            self._transport.resume_reading()

    def connection_lost(self, exc: BaseException | None) -> None:
        """End every call."""
        if self._has_begun:
            super().connection_lost(exc)
        if self.caller is not None:
            self._ended(self)

    # grpclib's handler

    def accept(self, stream: Stream, headers: Any, release_stream: Callable[[], None]) -> None:  # noqa: ANN401 - a list of pairs
        """Begin a call."""
        task = asyncio.get_running_loop().create_task(self._call(stream, dict(headers)))
        self._calls[stream] = task

        def end(_: asyncio.Task[None]) -> None:
            del self._calls[stream]
            release_stream()

        task.add_done_callback(end)

    def cancel(self, stream: Stream) -> None:
        """Cancel a call whose client has given it up."""
        if stream in self._calls:
            self._calls[stream].cancel()

    def close(self) -> None:
        """Cancel every call."""
        for task in self._calls.values():
            task.cancel()

    # Calls

    async def _call(self, stream: Stream, headers: Mapping[bytes, bytes]) -> None:
        has_begun = False

        async def send(answer: bytes) -> None:
            nonlocal has_begun
            if not has_begun:
                has_begun = True
                await stream.send_headers(list(_HEAD))
            await stream.send_data(b"\0" + len(answer).to_bytes(4, "big") + answer)

        # Nobody is told of what they no longer listen to.
        with contextlib.suppress(ProtocolError):
            if not headers.get(b"content-type", b"").startswith(_CONTENT):
                await stream.send_headers([(":status", "415")], end_stream=True)
                return
            path = headers.get(b":path", b"").decode(errors="replace")
            requests = _messages(stream, self._message_bytes)
            try:
                async with asyncio.timeout(_timeout(headers)):
                    status = await self._serve(path, self.caller, requests, send)
            except TimeoutError:
                status = status_pb2.Status(code=code_pb2.DEADLINE_EXCEEDED, message="too late")
            trailers = _trailers(status)
            await stream.send_headers(
                trailers if has_begun else [*_HEAD, *trailers], end_stream=True
            )
            if stream.closable:
                stream.reset_nowait()  # whatever else the client would send


class _Gathering:
    """A transport that writes once what is written in one turn of the event loop.

    Each write lets other threads run, which may then take milliseconds.
    """

    def __init__(self, transport: asyncio.Transport) -> None:
        self._transport = transport
        self._gathered: list[bytes] = []
        self.get_extra_info = transport.get_extra_info
        self.is_closing = transport.is_closing

    def write(self, content: bytes) -> None:
        if not self._gathered:
            asyncio.get_running_loop().call_soon(self._flush)
        self._gathered.append(content)

    def close(self) -> None:
        self._flush()
        self._transport.close()

    def _flush(self) -> None:
        gathered, self._gathered = self._gathered, []
        if gathered:
            self._transport.write(b"".join(gathered))


async def _messages(stream: Stream, most_bytes: int) -> AsyncIterator[bytes]:
    """Yield the messages of a call as they come.

    Raises:
        MessageSizeError: one is larger than any may be.
        RequestError: one is compressed, or cut short.
    """
    while head := await _read(stream, _PREFIX_BYTES):
        size = int.from_bytes(head[1:], "big")
        if head[0]:
            raise RequestError("", "the message is compressed, which is not supported")
        if size > most_bytes:
            problem = f"the message is too large: {size} bytes, at most {most_bytes}"
            raise MessageSizeError("", problem)
        yield await _read(stream, size)


async def _read(stream: Stream, size: int) -> bytes:
    """Return *size* bytes; none at the end.

    Raises:
        RequestError: the end comes before.
    """
    try:
        return await stream.recv_data(size)
    except AssertionError as error:  # so grpclib says it
        raise RequestError("", "the message is cut short") from error


def _timeout(headers: Mapping[bytes, bytes]) -> float | None:
    """Return how long a call may take, s."""
    given = headers.get(b"grpc-timeout", b"")
    if len(given) <= _TIMEOUT_BYTES:
        with contextlib.suppress(ValueError):
            return decode_timeout(given.decode(errors="replace"))
    return None


def _trailers(status: status_pb2.Status | None) -> list[tuple[str, str]]:
    if status is None:
        return [("grpc-status", "0")]
    told = [
        ("grpc-status", str(status.code)),
        ("grpc-message", encode_grpc_message(status.message)),
    ]
    return [*told, (DETAILS_KEY, encode_bin_value(status.SerializeToString()).decode())]
