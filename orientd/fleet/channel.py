"""gRPC's channel to one daemon, over Zenoh: a stub of ``Control`` knows no difference.

A call is a query with the request; its answers are replies, and its end is the end of the replies.
Where there are many requests each of them is a query of its own (:mod:`orientd.fleet.requests`).
What gRPC would raise is raised here in its name, with the same details.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import queue
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Self, cast

import grpc
from google.protobuf.message import DecodeError
from google.rpc import status_pb2

from orientd.errors import StateError, TooMuchError
from orientd.fleet import keys
from orientd.fleet.requests import RequestStream
from orientd.rpc import DETAILS_KEY, to_status

if TYPE_CHECKING:
    import zenoh

LONGEST_CALL = 7 * 86400.0
"""How long a call may go on, s: Zenoh wants to know."""

START_KEY = "orientd-start"
"""The metadata of a Move that takes part in a start, JSON."""

_CODES = {code.value[0]: code for code in grpc.StatusCode}

Metadata = Sequence[tuple[str, str]]
Write = Callable[[Any], bytes] | None
Read = Callable[[bytes], Any] | None


class FleetCallError(grpc.aio.AioRpcError):
    """A call that failed, as gRPC tells of one that is over."""

    def __init__(self, code: grpc.StatusCode, text: str, details: bytes = b"") -> None:
        """Have failed with *code*; *details* is a whole ``google.rpc.Status``, if there is one."""
        trailing = [(DETAILS_KEY, details)] if details else []
        super().__init__(code, grpc.aio.Metadata(), grpc.aio.Metadata(*trailing), text, "")

    def __str__(self) -> str:
        return str(self.details())


class _Answers(Iterator[Any]):
    """The answers to one call, as they come."""

    def __init__(self, read: Callable[[bytes], Any], cancel: Callable[[], None]) -> None:
        self._read, self._cancel = read, cancel
        self._replies: queue.SimpleQueue[zenoh.Reply | None] = queue.SimpleQueue()
        self._has_ended = threading.Event()
        self._is_cancelled = False
        self.requests: RequestStream | None = None

    # Called by Zenoh

    def take(self, reply: zenoh.Reply) -> None:
        self._replies.put(reply)

    def finish(self) -> None:
        self._has_ended.set()
        self._replies.put(None)

    # Called by whoever asked

    def __next__(self) -> Any:  # noqa: ANN401 - a message
        reply = None if self._is_cancelled else self._replies.get()
        if self._is_cancelled:
            raise FleetCallError(grpc.StatusCode.CANCELLED, "cancelled")
        if reply is None:
            self._replies.put(None)
            raise StopIteration
        if reply.ok is not None:
            return self._read(reply.ok.payload.to_bytes())
        self._replies.put(None)
        raise _failure(reply.err.payload.to_bytes() if reply.err is not None else b"")

    def result(self) -> Any:  # noqa: ANN401
        """Return the one answer."""
        for answer in self:
            return answer
        raise FleetCallError(grpc.StatusCode.UNAVAILABLE, "nobody answers there")

    def cancel(self) -> bool:
        """End the call, at the other end too."""
        if not self._has_ended.is_set() and not self._is_cancelled:
            self._is_cancelled = True
            self._replies.put(None)
            if self.requests is not None:
                self.requests.end()
            self._cancel()
        return True


def _failure(said: bytes) -> FleetCallError:
    """Return what an error says: a ``google.rpc.Status``, JSON of the gateway, or Zenoh's text."""
    if said.startswith(b"{"):
        told = json.loads(said)
        error = TooMuchError(told["busy"]) if "busy" in told else StateError(told["refused"])
        said = to_status(error).SerializeToString()
    elif said.lower().startswith(b"timeout"):
        return FleetCallError(grpc.StatusCode.DEADLINE_EXCEEDED, "timeout")
    status = status_pb2.Status()
    try:
        status.ParseFromString(said)
    except DecodeError:
        return FleetCallError(grpc.StatusCode.UNKNOWN, said.decode(errors="replace"))
    code = _CODES.get(status.code, grpc.StatusCode.UNKNOWN)
    # An answer without details, such as "no such call", is gRPC's own and has other words.
    is_own = code is grpc.StatusCode.UNIMPLEMENTED
    return FleetCallError(code, status.message, b"" if is_own else said)


class _Method:
    """One call of the protocol."""

    def __init__(
        self,
        channel: FleetChannel,
        method: str,
        write: Write,
        read: Read,
        *,
        is_stream: bool,
        has_many: bool = False,
    ) -> None:
        if write is None or read is None:
            raise TypeError("expected a call of messages, got one of bytes")
        self._channel, self._name = channel, method.rpartition("/")[2]
        self._write, self._read = write, read
        self._is_stream, self._has_many = is_stream, has_many

    def __call__(
        self, request: object, timeout: float | None = None, metadata: Metadata | None = None
    ) -> Any:  # noqa: ANN401 - a message, or an iterator over messages
        answers = self.future(request, timeout, metadata)
        return answers if self._is_stream else answers.result()

    def future(
        self, request: object, timeout: float | None = None, metadata: Metadata | None = None
    ) -> _Answers:
        start = dict(metadata or ()).get(START_KEY)
        if not self._has_many:
            return self._channel.begin(
                self._name, self._write(request), self._read, timeout, start=start
            )
        requests = map(self._write, cast("Iterable[object]", request))
        return self._channel.begin(self._name, b"", self._read, timeout, requests=requests)


class FleetChannel(grpc.Channel):
    """A channel to a daemon of a cell."""

    def __init__(
        self,
        session: zenoh.Session,
        *,
        cell: str,
        daemon: str,
        caller: str,
        on_close: Callable[[], object],
    ) -> None:
        """Call *daemon* of *cell* as *caller*, over *session*; tell *on_close* of the end."""
        self._session, self._on_close = session, on_close
        self._cell, self._daemon, self._caller = cell, daemon, caller
        self._numbers = itertools.count(1)
        self._open: set[_Answers] = set()

    def begin(
        self,
        method: str,
        body: bytes,
        read: Callable[[bytes], Any],
        timeout: float | None,
        *,
        start: str | None = None,
        requests: Iterable[bytes] | None = None,
    ) -> _Answers:
        """Begin a call; return the answers to come.

        Args:
            method: its name.
            body: the request, as serialised.
            read: makes a message of an answer.
            timeout: how long the call may take, s; ``None`` for as long as it takes.
            start: the start that a Move takes part in, JSON.
            requests: all of them, instead of *body*, where the call has many.
        """
        import zenoh

        name = f"{self._session.zid()}-{id(self):x}-{next(self._numbers)}"
        said: dict[str, Any] = {"session": str(self._session.zid()), "id": name}
        if start is not None:
            said["start"] = json.loads(start)
        if requests is not None:
            said["parts"] = True
        answers = _Answers(read, lambda: self._cancel(name))
        self._open.add(answers)

        def finish() -> None:
            self._open.discard(answers)
            answers.finish()
            if answers.requests is not None:
                answers.requests.end()

        answers_to = zenoh.handlers.Callback(answers.take, finish)
        self._ask(method, answers_to, body, said, LONGEST_CALL if timeout is None else timeout)
        if requests is not None:

            def hear(_: zenoh.Reply) -> None:
                """Go by the end of the replies, of which there are none."""

            def send(part: dict[str, Any], body: bytes, taken: Callable[[], object]) -> None:
                end_of = zenoh.handlers.Callback(hear, taken)
                self._ask(method, end_of, body, {**said, **part}, LONGEST_CALL)

            answers.requests = RequestStream(requests, send, answers.cancel)
        return answers

    def _ask(
        self,
        method: str,
        handler: zenoh.handlers.Callback[zenoh.Reply],
        body: bytes,
        said: dict[str, Any],
        timeout: float,
    ) -> None:
        import zenoh

        try:
            self._session.get(
                self._key(f"rpc/{method}"),
                handler,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                congestion_control=zenoh.CongestionControl.BLOCK,
                timeout=timeout,
                payload=body,
                attachment=json.dumps(said).encode(),
                express=True,
            )
        except zenoh.ZError as error:
            text = f"the cell was left: {error}".partition(" at /")[0]
            raise FleetCallError(grpc.StatusCode.UNAVAILABLE, text) from error

    def _cancel(self, name: str) -> None:
        import zenoh

        # Whoever cancels does not wait for the other end to know, which knows of a session's end.
        with contextlib.suppress(zenoh.ZError):
            self._session.get(self._key(f"cancel/{name}"), lambda _: None, timeout=1.0)

    def _key(self, what: str) -> str:
        return keys.as_caller(self._cell, self._daemon, self._caller, what)

    # What gRPC asks of a channel

    def unary_unary(
        self, method: str, request_serializer: Write, response_deserializer: Read, **_: object
    ) -> Any:  # noqa: ANN401 - as gRPC has them
        """Return what makes a call with one answer."""
        return _Method(self, method, request_serializer, response_deserializer, is_stream=False)

    def unary_stream(
        self, method: str, request_serializer: Write, response_deserializer: Read, **_: object
    ) -> Any:  # noqa: ANN401
        """Return what makes a call with many answers."""
        return _Method(self, method, request_serializer, response_deserializer, is_stream=True)

    def stream_unary(
        self, method: str, request_serializer: Write, response_deserializer: Read, **_: object
    ) -> Any:  # noqa: ANN401
        """Return what makes a call with many requests and one answer."""
        return _Method(
            self, method, request_serializer, response_deserializer, is_stream=False, has_many=True
        )

    def stream_stream(
        self, method: str, request_serializer: Write, response_deserializer: Read, **_: object
    ) -> Any:  # noqa: ANN401
        """Return what makes a call with many requests and many answers."""
        return _Method(
            self, method, request_serializer, response_deserializer, is_stream=True, has_many=True
        )

    def subscribe(self, callback: object, try_to_connect: bool | None = False) -> None:
        """Tell nobody how the connection is: Zenoh finds its ways itself."""

    def unsubscribe(self, callback: object) -> None:
        """Take back nothing."""

    def close(self) -> None:
        """End every call."""
        for answers in list(self._open):
            answers.cancel()
        self._on_close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
