"""One connection of a client: gRPC as grpclib speaks it, with bounds that grpclib does not have.

A client's messages have a largest size, alone and together.  The daemon reads a flood of them in
pieces.  It hangs up on a client that does not read the answers.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from typing import Any

from google.protobuf.message import Message
from google.rpc import status_pb2
from grpclib.config import Configuration
from grpclib.const import Handler as Route
from grpclib.encoding.base import StatusDetailsCodecBase
from grpclib.encoding.proto import ProtoCodec
from grpclib.events import _DispatchServerEvents
from grpclib.protocol import Connection as HttpConnection
from grpclib.protocol import EventsProcessor, H2Protocol, Stream
from grpclib.server import Handler
from h2.config import H2Configuration
from h2.connection import H2Connection
from h2.events import UnknownFrameReceived
from h2.settings import SettingCodes

from orientd.daemon.access.identity import Caller
from orientd.errors import MessageSizeError, RequestError, TooMuchError

_log = logging.getLogger(__name__)

WINDOW = 256 * 1024
"""Bytes that a client may send before the daemon reads them, per connection and per call."""

MOST_STREAMS = 1024
"""Calls over one connection that its client has not done with; a client waits with more."""

PIECE = 4 * 1024
"""Bytes of one client that are taken at once; then other work and other clients have their turn."""

LARGE = 32 * 1024
"""A message of more bytes is large, such as a motion of 800 keyframes."""

MOST_HELD = 24 * 1024 * 1024
"""Bytes of large messages over one connection whose calls may wait for their answers."""

_BYTE_TAKES = 2.5e-9
"""s that a byte of a large message keeps the event loop busy: to be read, and to be handed on."""

MOST_UNREAD = 16 * 1024 * 1024
"""Bytes that wait for a client to read them; the daemon hangs up on a client that asks for more."""

FindRoute = Callable[[str, Caller], Route | None]
"""Returns how to serve a call of a full name, ``/service/Name``, for a caller."""

Meet = Callable[[asyncio.BaseTransport], Caller | None]
"""Identifies the client of a connection; ``None`` if the daemon must hang up on it."""

_HTTP2 = H2Configuration(
    client_side=False,
    header_encoding="utf-8",
    validate_outbound_headers=False,
    normalize_outbound_headers=False,
)
_CONFIGURATION = Configuration().__for_server__()
_TIMEOUT_BYTES = 9  # eight digits and a unit: no more is a timeout of gRPC

# Every call that fails is logged where it is served.
logging.getLogger("grpclib").setLevel(logging.CRITICAL)


class Turns:
    """Take one piece of one client in each turn of the event loop, however many clients send.

    A quarter of a megabyte of the smallest frames would keep everybody waiting for half a second,
    and a piece of each of many clients for milliseconds.  Large messages that are whole at the same
    time have pauses between them, for the same reason.
    """

    def __init__(self) -> None:
        self._waiting: deque[Callable[[], object]] = deque()
        self._large = asyncio.Lock()

    async def pause(self, size: int) -> None:
        """Leave other work as much time as a large message will take, once it is the next one."""
        async with self._large:
            await asyncio.sleep(size * _BYTE_TAKES)

    def later(self, take: Callable[[], object]) -> None:
        """Call *take* once all that came before have been called."""
        if not self._waiting:
            asyncio.get_running_loop().call_soon(self._next)
        self._waiting.append(take)

    def _next(self) -> None:
        take = self._waiting.popleft()
        if self._waiting:
            asyncio.get_running_loop().call_soon(self._next)
        take()


class Connection(H2Protocol):
    """Serve the calls of one caller, each in a task of its own.

    Attributes:
        caller: the client, once it is identified.
    """

    connection: _Bounded

    def __init__(
        self,
        meet: Meet,
        find_route: FindRoute,
        *,
        message_bytes: int,
        turns: Turns,
        ended: Callable[[Connection], object],
    ) -> None:
        """Serve nothing until the connection is made.

        Args:
            meet: identifies the client, once the connection is made.
            find_route: says how to serve each call.
            message_bytes: of the largest message.
            turns: of all clients.
            ended: called once, when the connection is over.
        """
        self._calls = _Calls(self, find_route)
        super().__init__(self._calls, _CONFIGURATION, _HTTP2)
        self.caller: Any = None
        self._meet, self._ended = meet, ended
        self._message_bytes, self._turns = message_bytes, turns
        self._transport: Any = None
        self._untaken = bytearray()
        self._has_begun = False

    @property
    def is_idle(self) -> bool:
        """Whether no call is under way."""
        return self._calls.check_closed()

    async def ends_within(self, seconds: float) -> None:
        """Wait at most *seconds* until no call is running."""
        if seconds and (tasks := self._calls.tasks):
            await asyncio.wait(tasks, timeout=seconds)

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
        self.connection = _Bounded(http2, gathering, config=self.config)
        self.connection.message_bytes, self.connection.turns = self._message_bytes, self._turns
        self.connection.flush()
        self.processor = EventsProcessor(self._calls, self.connection)
        # RFC 9113, 5.5: frames of an unknown type are ignored.
        self.processor.processors[UnknownFrameReceived] = lambda _: None
        self._has_begun = True

    def data_received(self, data: bytes) -> None:
        """Take the first piece of the bytes; the others take turns with those of other clients."""
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
            # A client with calls under way spoke it before.
            level = logging.DEBUG if self.is_idle else logging.WARNING
            _log.log(level, "%s: what is no HTTP/2 has come: %r", self.caller.origin, error)
            self.hang_up()
            return
        if self._transport.get_write_buffer_size() > MOST_UNREAD:
            _log.warning("%s: hung up on, it does not read what it asks for", self.caller.origin)
            self.hang_up()
        elif self._untaken:
            self._transport.pause_reading()
            self._turns.later(self._take)
        else:
            self._transport.resume_reading()

    def connection_lost(self, exc: BaseException | None) -> None:
        """End every call."""
        if self._has_begun:
            super().connection_lost(exc)
        if self.caller is not None:
            self._ended(self)


class _Calls(Handler):
    """The calls over one connection; it is its own table of them, by their full names."""

    def __init__(self, connection: Connection, find_route: FindRoute) -> None:
        self._connection, self._find_route = connection, find_route
        table: Any = self
        super().__init__(table, Codec(), _Details(), _DispatchServerEvents())

    @property
    def tasks(self) -> set[asyncio.Task[None]]:
        """The calls that are under way."""
        self.__gc_collect__()
        return {*self._tasks.values(), *self._cancelled}

    def accept(self, stream: Stream, headers: Any, release_stream: Callable[[], Any]) -> None:  # noqa: ANN401 - a list of pairs
        """Begin a call, without a timeout of more digits than any may have."""
        kept = [one for one in headers if one[0] != "grpc-timeout" or len(one[1]) <= _TIMEOUT_BYTES]
        super().accept(stream, kept, release_stream)
        self._tasks[stream].add_done_callback(lambda _: self._let_go(stream))

    def get(self, path: str) -> Route | None:
        """Return how to serve the call of a full name."""
        return self._find_route(path, self._connection.caller)

    def _let_go(self, stream: Stream) -> None:
        """Break the cycle in which grpclib holds a cancelled call, and so its request."""
        self._connection.connection.held.pop(stream, None)
        error = getattr(stream.wrapper, "_error", None)
        if error is not None:
            error.__traceback__ = error.__context__ = None


class _Bounded(HttpConnection):
    """A connection whose calls take no message that is too large, and not too many large ones.

    Attributes:
        message_bytes: of the largest message.
        turns: of all clients.
        held: bytes of the large message of each call without an answer.
    """

    message_bytes = 0
    turns: Turns

    def __init__(self, *given: Any, **more: Any) -> None:  # noqa: ANN401 - of the library
        super().__init__(*given, **more)
        self.held: dict[Stream, int] = {}

    def create_stream(self, **more: Any) -> Stream:  # noqa: ANN401 - of the library
        return _BoundedStream(self, self._connection, self._transport, **more)


class _BoundedStream(Stream):
    connection: _Bounded

    async def recv_data(self, size: int) -> bytes:
        """Return *size* bytes; none at the end.

        Raises:
            MessageSizeError: no message is so large.
            TooMuchError: it is large, and others of too many bytes wait for their answers.
            RequestError: the end comes before.
        """
        if size > self.connection.message_bytes:
            most = self.connection.message_bytes
            problem = f"the message is too large: {size} bytes, at most {most}"
            raise MessageSizeError("", problem)
        held = self.connection.held
        held.pop(self, None)
        if size > LARGE:
            if sum(held.values()) >= MOST_HELD:
                problem = f"{MOST_HELD >> 20} MiB of requests over one connection wait already"
                raise TooMuchError(problem)
            held[self] = size
        try:
            content = await super().recv_data(size)
        except AssertionError as error:  # so grpclib says it
            raise RequestError("", "the message is cut short") from error
        if size > LARGE:
            await self.connection.turns.pause(size)
        return content

    async def send_headers(self, *given: Any, **more: Any) -> None:  # noqa: ANN401 - of the library
        """Begin to answer."""
        self.connection.held.pop(self, None)
        await super().send_headers(*given, **more)


class Codec(ProtoCodec):
    """Messages, of which some are serialised already."""

    def encode(self, message: Any, message_type: Any) -> bytes:  # noqa: ANN401, ARG002
        """Return the bytes of a message."""
        return message if isinstance(message, bytes) else super().encode(message, Message)


class _Details(StatusDetailsCodecBase):
    """Encode the details of a status: the whole status, with google.rpc's error details."""

    def encode(self, status: Any, message: str | None, details: status_pb2.Status) -> bytes:  # noqa: ANN401, ARG002
        return bytes(details.SerializeToString())

    def decode(self, status: Any, message: str | None, data: bytes) -> status_pb2.Status:  # noqa: ANN401, ARG002
        return status_pb2.Status.FromString(data)


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
