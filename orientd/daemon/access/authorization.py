"""Authorization: every call passes it before its handler sees it.

It knows the caller by their connection, and asks: does the table of roles let them make this call,
are they within what one caller may ask for, and is the lease they name their own?  Commands, and
whatever is refused, are recorded with what came of them.  Handlers raise what they refuse a call
for: it is told in full here.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import inspect
import itertools
import logging
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any, NoReturn

import grpc
from google.protobuf.message import DecodeError, Message

from orientd.daemon.access import request_text
from orientd.daemon.access.audit import AuditLog
from orientd.daemon.access.gate import Interceptor
from orientd.daemon.access.identity import CALLER
from orientd.daemon.access.peer_credentials import PeerConnection, PeerListener
from orientd.daemon.access.rules import Rule, rule
from orientd.daemon.access.throttle import Throttle
from orientd.daemon.observe import about
from orientd.errors import AccessError, LeaseError, OrientdError, RequestError, TooMuchError
from orientd.rpc import DETAILS_KEY, to_status

_log = logging.getLogger(__name__)

_LEFT = 2**24
"""Bytes of refused requests that may be left in memory."""

_STREAMED = 2**20
"""What a refused call is taken to leave whose requests came one by one, bytes."""

Context = Any
Handler = Any

CountCall = Callable[[str, str, float], object]
"""Told the name of a call that has ended, its code, and how long it took in s."""

Read = Callable[[bytes], Message]

OwnerOf = Callable[[str], str | None]
"""Returns whose a lease is by its token, for others to be refused; ``None`` if it is nobody's."""


class Authorization(Interceptor):
    """Let calls through that their callers may make."""

    def __init__(
        self, door: PeerListener, audit: AuditLog, throttle: Throttle, *, keyframes: int
    ) -> None:
        """Check calls of whoever came in by *door*.

        Args:
            door: knows callers.
            audit: records commands and refusals.
            throttle: counts what callers ask for.
            keyframes: the most of one motion.
        """
        self.keyframes = keyframes
        self._door = door
        self._audit = audit
        self._throttle = throttle
        self.owner_of: OwnerOf = lambda _: None
        self.count_call: CountCall = lambda *_: None
        self._numbers = itertools.count(1)
        self._left = 0
        self._wrapped: dict[tuple[str, Handler], Handler] = {}

    async def intercept_service(
        self,
        continuation: Callable[[grpc.HandlerCallDetails], Awaitable[Any]],
        handler_call_details: grpc.HandlerCallDetails,
    ) -> Any:  # noqa: ANN401 - whatever handles the call
        """Put the check in front of whatever handles the call."""
        handler = await continuation(handler_call_details)
        if handler is None:
            return None
        method = handler_call_details.method
        if (method, handler) not in self._wrapped:
            self._wrapped[method, handler] = self._wrap(method, handler)
        return self._wrapped[method, handler]

    def _wrap(self, method: str, handler: Handler) -> Handler:
        kind = (
            f"{'stream' if handler.request_streaming else 'unary'}_"
            f"{'stream' if handler.response_streaming else 'unary'}"
        )
        inner = getattr(handler, kind)
        makes_answers = inspect.isasyncgenfunction(inner)

        async def stream(asked: Any, context: Context) -> AsyncIterator[Any]:  # noqa: ANN401
            async with (
                self._call(method, asked, context) as call,
                contextlib.aclosing(inner(call.request, context)) as answers,
            ):
                async for answer in answers:
                    call.hear(answer)
                    yield answer

        async def single(asked: Any, context: Context) -> Any:  # noqa: ANN401
            async with self._call(method, asked, context) as call:
                answer = await inner(call.request, context)
                call.hear(answer)
                return answer

        return handler._replace(
            **{kind: stream if makes_answers else single},
            request_deserializer=legible(handler.request_deserializer),
        )

    @contextlib.asynccontextmanager
    async def _call(self, method: str, asked: Any, context: Context) -> AsyncIterator[_Call]:  # noqa: ANN401
        """Admit a call, and record how it ends."""
        found, connection = rule(method), self._door.who(context.peer())
        call = _Call(next(self._numbers), method.rpartition("/")[2], found, connection)
        key = "" if connection is None else connection.identity.key
        is_counted = False
        try:
            try:
                has_lease = isinstance(asked, Message) and self._has_lease(asked, key)
                connection = self._admit(call, found, connection, has_lease=has_lease)
                is_counted = self._throttle.begins(key, has_lease=has_lease)
                if not is_counted and found.is_limited:
                    raise TooMuchError(f"at most {self._throttle.at_once} calls at the same time")
                if isinstance(asked, Message | RequestError):
                    self._look_at(asked, key)
                    call.request = asked
                else:
                    call.request = self._looking(asked, call, key, context)
                if found.is_command:
                    is_whole = isinstance(asked, Message)
                    told = {"request": request_text.describe(asked)} if is_whole else {}
                    self._audit.record(event="asked", **call.who(), **told)
                CALLER.set(connection.identity)
                yield call
            except OrientdError as error:
                await _refuse(context, error)
        except (asyncio.CancelledError, GeneratorExit):
            self._conclude(call, "CANCELLED", "")
            self._sweep(asked)
            raise
        except BaseException:
            self._sweep(asked)
            code = context.code()
            name = code.name if isinstance(code, grpc.StatusCode) else "UNKNOWN"
            self._conclude(call, name, context.details() or "")
            raise
        else:
            self._conclude(call, "OK", "")
        finally:
            if is_counted:
                self._throttle.ends(key)

    def _sweep(self, asked: Any) -> None:  # noqa: ANN401
        """Have Python look for circles once those that refused calls have left may be large.

        What ended a call holds, by way of its traceback, the request and gRPC's context, and that
        holds what ended it.
        """
        self._left += asked.ByteSize() if isinstance(asked, Message) else _STREAMED
        if self._left > _LEFT:
            self._left = 0
            gc.collect()

    def _has_lease(self, request: Message, key: str) -> bool:
        """Whether a request names a lease that is its caller's own."""
        token = request_text.token(request)
        return bool(token and key) and self.owner_of(token) == key

    def _admit(
        self, call: _Call, found: Rule, connection: PeerConnection | None, *, has_lease: bool
    ) -> PeerConnection:
        """Return who calls, if they may.

        Raises:
            AccessError: nobody knows them, or their role does not do.
            TooMuchError: they ask for more than they may.
        """
        if connection is None:
            raise AccessError("nobody knows who asks")
        identity = connection.identity
        if identity.role < found.role:
            raise AccessError(
                f"{call.name} needs the role {found.role.name.lower()}, "
                f"{identity.name} ({identity.key}) is {identity.role.name.lower()}"
            )
        if found.is_limited and not self._throttle.takes(
            connection, identity.key, time.monotonic(), has_lease=has_lease
        ):
            raise TooMuchError(
                f"more than {self._throttle.per_second} requests a second over one connection"
            )
        return connection

    def _look_at(self, request: Message | RequestError, key: str) -> None:
        """Check what a message itself says.

        Raises:
            LeaseError: it names a lease that is somebody else's.
            RequestError: it is no message, or has too many keyframes.
        """
        if isinstance(request, RequestError):
            raise request
        token = request_text.token(request)
        owner = self.owner_of(token) if token else None
        if owner is not None and owner != key:
            raise LeaseError(f"the lease is held by {owner}, its token is of no use to {key}")
        count = request_text.keyframes(request)
        if count > self.keyframes:
            raise RequestError("keyframes", f"expected at most {self.keyframes}, got {count}")

    async def _looking(
        self, requests: AsyncIterator[Message], call: _Call, key: str, context: Context
    ) -> AsyncIterator[Message]:
        is_first = True
        async for request in requests:
            try:
                self._look_at(request, key)
            except OrientdError as error:
                await _refuse(context, error)
            if is_first and call.rule.is_command:
                self._audit.record(
                    event="began", **call.who(), request=request_text.describe(request)
                )
            is_first = False
            yield request

    def _conclude(self, call: _Call, code: str, text: str) -> None:
        self.count_call(call.name, code, time.monotonic() - call.began)
        level = logging.INFO if call.rule.is_command else logging.DEBUG
        if code != "OK" and call.rule.is_command:
            level = logging.WARNING
        story = about(**call.who(), outcome=code, **call.result)
        detail = f": {text}" if text else ""
        _log.log(level, "call %d: %s: %s%s", call.number, call.name, code, detail, extra=story)
        is_refused = code in ("PERMISSION_DENIED", "RESOURCE_EXHAUSTED")
        is_foreign = call.name == "RenewLease" and code == "FAILED_PRECONDITION"
        if call.rule.is_command or is_refused or is_foreign:
            self._audit.record(
                event="answered", **call.who(), outcome=code, text=text[:400], **call.result
            )


@dataclass(eq=False)
class _Call:
    """One call under way."""

    number: int
    name: str
    rule: Rule
    connection: PeerConnection | None
    began: float = field(default_factory=time.monotonic)
    request: Any = None
    result: dict[str, Any] = field(default_factory=dict)

    def who(self) -> dict[str, Any]:
        """Return what every record of this call begins with."""
        connection = self.connection
        if connection is None:
            return {"call": self.number, "method": self.name, "identity": "", "origin": ""}
        identity = connection.identity
        return {
            "call": self.number,
            "method": self.name,
            "identity": identity.key,
            "name": identity.name,
            "role": identity.role.name.lower(),
            "origin": connection.origin,
        }

    def hear(self, answer: object) -> None:
        """Note what an answer says of the motion that the call began."""
        started, summary = getattr(answer, "started", None), getattr(answer, "summary", None)
        if started is not None and started.ByteSize():
            self.result["motion"] = started.motion_number
            self.result["motion_id"] = started.plan.motion_id
            story = about(**self.who(), device=getattr(self.request, "device", ""), **self.result)
            _log.info(
                "call %d: %s began motion %d (%s)",
                self.number,
                self.who()["name"],
                started.motion_number,
                started.plan.motion_id,
                extra=story,
            )
        if summary is not None and summary.ByteSize():
            kind = summary.DESCRIPTOR.fields_by_name["outcome"].enum_type
            self.result["motion_outcome"] = kind.values_by_number[summary.outcome].name
            self.result["motion_text"] = summary.text[:400]


def legible(read: Read | None) -> Callable[[bytes], Message | RequestError] | None:
    """Return *read*, made to return what is wrong, in one line, instead of raising it.

    gRPC reads a request before anybody can check who asks or how often, and answers bytes that say
    nothing with a traceback in the log.  So they become an error, which is refused like any other
    request.

    Args:
        read: makes a message of bytes; ``None`` where bytes are passed on as they are.
    """
    if read is None:
        return None

    def attempt(content: bytes) -> Message | RequestError:
        try:
            return read(content)
        except DecodeError as error:
            problem = " ".join(str(error).split())
            return RequestError("", f"the request cannot be read: {problem}")

    return attempt


async def _refuse(context: Context, error: OrientdError) -> NoReturn:
    """End the call with *error*, in full."""
    status = to_status(error)
    codes = {code.value[0]: code for code in grpc.StatusCode}
    await context.abort(
        codes[status.code], status.message, ((DETAILS_KEY, status.SerializeToString()),)
    )
    raise AssertionError("abort returned")
