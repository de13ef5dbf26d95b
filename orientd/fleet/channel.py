"""gRPC's channel to one daemon, over Zenoh: a stub of ``Control`` knows no difference.

A call is a query with the request; its answers are replies, and its end is the end of the replies.
What gRPC would raise is raised here in its name, with the same details.
"""

from __future__ import annotations

import itertools
import json
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Self

import grpc

from orientd.errors import OrientdError, StateError, TooMuchError
from orientd.fleet import keys
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


class FleetCallError(grpc.RpcError, grpc.Call):
    """A call that failed, as gRPC tells of it."""

    def __init__(self, code: grpc.StatusCode, text: str, details: bytes = b"") -> None:
        """Have failed with *code*; *details* is a whole ``google.rpc.Status``, if there is one."""
        super().__init__(text)
        self._code, self._text, self._details = code, text, details

    def code(self) -> grpc.StatusCode:
        """Return the kind of failure."""
        return self._code

    def details(self) -> str:
        """Return what happened, in words."""
        return self._text

    def trailing_metadata(self) -> Any:  # noqa: ANN401 - as gRPC has it
        """Return the whole status, where there is one."""
        return ((DETAILS_KEY, self._details),) if self._details else ()

    def initial_metadata(self) -> tuple[()]:
        """Return nothing: a failure is all that came."""
        return ()

    def is_active(self) -> bool:
        """Whether the call goes on; it has failed."""
        return False

    def time_remaining(self) -> float:
        """Return how long the call may go on, s."""
        return 0.0

    def cancel(self) -> bool:
        """End what has ended."""
        return False

    def add_callback(self, callback: Callable[[], None]) -> bool:
        """Refuse to tell of the end, which has been."""
        del callback
        return False


class _Answers(Iterator[Any]):
    """The answers to one call, as they come."""

    def __init__(self, read: Callable[[bytes], Any], cancel: Callable[[], None]) -> None:
        self._read, self._cancel = read, cancel
        self._replies: queue.SimpleQueue[zenoh.Reply | None] = queue.SimpleQueue()
        self._has_ended = threading.Event()
        self._is_cancelled = False

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

    def result(self, timeout: float | None = None) -> Any:  # noqa: ANN401
        """Return the one answer."""
        del timeout
        for answer in self:
            return answer
        raise FleetCallError(grpc.StatusCode.UNAVAILABLE, "nobody answers there")

    def cancel(self) -> bool:
        """End the call, at the other end too."""
        if not self._has_ended.is_set() and not self._is_cancelled:
            self._is_cancelled = True
            self._replies.put(None)
            self._cancel()
        return True


def _failure(said: bytes) -> FleetCallError:
    """Return what an error says: a ``google.rpc.Status``, JSON of the gateway, or Zenoh's text."""
    error: OrientdError | None = None
    if said.startswith(b"{"):
        told = json.loads(said)
        error = TooMuchError(told["busy"]) if "busy" in told else StateError(told["refused"])
        said = to_status(error).SerializeToString()
    elif said.lower().startswith(b"timeout"):
        return FleetCallError(grpc.StatusCode.DEADLINE_EXCEEDED, "timeout")
    from google.protobuf.message import DecodeError
    from google.rpc import status_pb2

    status = status_pb2.Status()
    try:
        status.ParseFromString(said)
    except DecodeError:
        return FleetCallError(grpc.StatusCode.UNKNOWN, said.decode(errors="replace"))
    code = _CODES.get(status.code, grpc.StatusCode.UNKNOWN)
    # An answer without details, such as "no such call", is gRPC's own and has other words.
    return FleetCallError(code, status.message, b"" if code is _UNIMPLEMENTED else said)


_UNIMPLEMENTED = grpc.StatusCode.UNIMPLEMENTED


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
    ) -> None:
        if write is None or read is None:
            raise TypeError("expected a call of messages, got one of bytes")
        self._channel, self._name = channel, method.rpartition("/")[2]
        self._write, self._read, self._is_stream = write, read, is_stream

    def __call__(
        self, request: object, timeout: float | None = None, metadata: Metadata | None = None
    ) -> Any:  # noqa: ANN401 - a message, or an iterator over messages
        answers = self.future(request, timeout, metadata)
        return answers if self._is_stream else answers.result()

    def future(
        self, request: object, timeout: float | None = None, metadata: Metadata | None = None
    ) -> _Answers:
        body, start = self._write(request), dict(metadata or ()).get(START_KEY)
        return self._channel.begin(self._name, body, self._read, timeout, start)


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
        start: str | None = None,
    ) -> _Answers:
        """Send a request; return the answers to come."""
        import zenoh

        name = f"{self._session.zid()}-{id(self):x}-{next(self._numbers)}"
        said: dict[str, Any] = {"session": str(self._session.zid()), "id": name}
        if start is not None:
            said["start"] = json.loads(start)
        answers = _Answers(read, lambda: self._cancel(name))
        self._open.add(answers)

        def finish() -> None:
            self._open.discard(answers)
            answers.finish()

        self._session.get(
            self._key(f"rpc/{method}"),
            zenoh.handlers.Callback(answers.take, finish),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=LONGEST_CALL if timeout is None else timeout,
            payload=body,
            attachment=json.dumps(said).encode(),
            express=True,
        )
        return answers

    def _cancel(self, name: str) -> None:
        # Whoever cancels does not wait for the other end to know.
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

    def stream_unary(self, method: str, *_: object, **__: object) -> Any:  # noqa: ANN401
        """Return what refuses a call with many requests."""
        return _refuse(method)

    def stream_stream(self, method: str, *_: object, **__: object) -> Any:  # noqa: ANN401
        """Return what refuses a call with many requests."""
        return _refuse(method)

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


def _refuse(method: str) -> Callable[..., Any]:
    def refuse(*_: object, **__: object) -> None:
        text = f"{method.rpartition('/')[2]} is for the control socket alone, which keeps time"
        raise FleetCallError(_UNIMPLEMENTED, text)

    return refuse
