"""Authorization: every call passes it, whichever way it came, and is served behind it.

It asks three things.  Does the caller's role allow the call?  Has the caller room for one more?  Is
the lease that the request names the caller's own?  It records commands, and everything refused.
Handlers raise what they refuse a call for; the caller gets it as a status with all details.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import aclosing
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import DecodeError, Message
from google.rpc import code_pb2, status_pb2

from orientd.daemon.access.audit import AuditLog
from orientd.daemon.access.connection import Send
from orientd.daemon.access.identity import Caller
from orientd.daemon.access.rules import Rule, rule
from orientd.daemon.observe import about
from orientd.errors import (
    AccessError,
    LeaseError,
    OrientdError,
    RequestError,
    TooMuchError,
    UnknownNameError,
)
from orientd.rpc import to_status

_log = logging.getLogger(__name__)

SECRETS = ("lease_token", "token")
"""Fields that name a lease, wherever they are; they are written down nowhere."""

_MOST_TEXT = 200
"""Characters of one text of a request that are recorded."""

CountCall = Callable[[str, str, float], object]
"""Told the name of a call that has ended, its code, and how long it took in s."""

OwnerOf = Callable[[str], str | None]
"""Returns whose a lease is by its token; ``None`` if it is nobody's."""


@dataclass(frozen=True)
class Method:
    """One call of a service.

    Attributes:
        name: short.
        run: the handler, called with the request, or an iterator over requests, and the caller.
        request: class of its requests.
        takes_stream: whether there are many.
        gives_stream: whether there are many answers.
        is_library: whether the handler is grpclib's, which is called with a stream of its kind.
    """

    name: str
    run: Callable[..., Any]
    request: type[Message]
    takes_stream: bool = False
    gives_stream: bool = False
    is_library: bool = False


class Authorization:
    """Serve the calls that their callers may make.

    Attributes:
        most_calls: of one identity at one time; stops and renewals do not count.
    """

    def __init__(
        self,
        methods: Mapping[str, Method],
        audit: AuditLog,
        *,
        owner_of: OwnerOf,
        count_call: CountCall,
        most_calls: int,
    ) -> None:
        """Serve *methods*.

        Args:
            methods: by their full names, ``/service/Name``.
            audit: records commands and refusals.
            owner_of: says whose a lease is.
            count_call: called with every call that has ended.
            most_calls: of one identity at one time.
        """
        self.most_calls = most_calls
        self._methods, self._audit = methods, audit
        self._owner_of, self._count_call = owner_of, count_call
        self._numbers = itertools.count(1)
        self._calls: Counter[str] = Counter()

    async def serve(
        self, path: str, caller: Caller, requests: AsyncIterator[bytes], send: Send
    ) -> status_pb2.Status | None:
        """Serve one call.

        Args:
            path: its full name, ``/service/Name``.
            caller: who calls.
            requests: its messages as they come; may raise what is wrong with one.
            send: sends an answer.

        Returns:
            Why it failed; ``None`` if it did not.
        """
        method = self._methods.get(path)
        if method is None:
            problem = f"there is no call {path[:_MOST_TEXT]}"
            return status_pb2.Status(code=code_pb2.UNIMPLEMENTED, message=problem)
        call = _Call(next(self._numbers), method, rule(path), caller)
        key, is_counted = caller.identity.key, call.rule.is_limited
        status: status_pb2.Status | None = None
        self._calls[key] += is_counted
        try:
            self._admit(call)
            await self._run(call, requests, send)
        except OrientdError as error:
            status = to_status(error)
        except asyncio.CancelledError:
            status = status_pb2.Status(code=code_pb2.CANCELLED)
            raise
        except Exception as error:  # noqa: BLE001 - one call is no reason to end
            _log.exception("call %d: %s failed", call.number, method.name)
            status = status_pb2.Status(code=code_pb2.UNKNOWN, message=repr(error)[:_MOST_TEXT])
        finally:
            self._calls[key] -= is_counted
            self._conclude(call, status)
        return status

    def _admit(self, call: _Call) -> None:
        """Refuse a call that its caller may not make.

        Raises:
            AccessError: the caller's role does not do, or its certificate has expired.
            TooMuchError: the caller has too many calls under way.
        """
        identity = call.caller.identity
        if call.caller.has_expired:
            raise AccessError(f"the certificate of {identity.name} has expired")
        if identity.role < call.rule.role:
            raise AccessError(
                f"{call.method.name} needs the role {call.rule.role.name.lower()}, "
                f"{identity.name} ({identity.key}) is {identity.role.name.lower()}"
            )
        if call.rule.is_limited and self._calls[identity.key] > self.most_calls:
            raise TooMuchError(f"at most {self.most_calls} calls at the same time")

    async def _run(self, call: _Call, requests: AsyncIterator[bytes], send: Send) -> None:
        method = call.method
        asked: Any = (self._read(call, content) async for content in requests)
        answer = partial(self._send, call, send)
        if method.is_library:
            await method.run(_LibraryStream(asked, answer))
            return
        if not method.takes_stream:
            asked = await anext(asked, None)
            if asked is None:
                raise RequestError("", "expected a request, got none")
        if not method.gives_stream:
            await answer(await method.run(asked, call.caller))
            return
        async with aclosing(method.run(asked, call.caller)) as answers:
            async for one in answers:
                await answer(one)

    def _read(self, call: _Call, content: bytes) -> Message:
        """Return a request of a call as a message.

        Raises:
            RequestError: it cannot be read.
            LeaseError: it names a lease that is somebody else's.
        """
        try:
            request = call.method.request.FromString(content)
        except DecodeError as error:
            problem = " ".join(str(error).split())
            raise RequestError("", f"the request cannot be read: {problem}") from error
        token = next((one for one in map(_token, _parts(request)) if one), "")
        owner, key = self._owner_of(token) if token else None, call.caller.identity.key
        if owner is not None and owner != key:
            raise LeaseError(f"the lease is held by {owner}, its token is of no use to {key}")
        if not call.asked:
            call.asked = describe(request)
        return request

    async def _send(self, call: _Call, send: Send, answer: Message | bytes) -> None:
        if not isinstance(answer, bytes):
            self._note(call, answer)
            answer = answer.SerializeToString()
        await send(answer)

    def _note(self, call: _Call, answer: Message) -> None:
        """Note what an answer says of the motion that the call began."""
        started, summary = getattr(answer, "started", None), getattr(answer, "summary", None)
        if started is not None and started.ByteSize():
            call.result["motion"] = started.motion_number
            call.result["motion_id"] = started.plan.motion_id
            told = call.told()
            self._audit.record(event="began", **told)
            name, number = call.caller.identity.name, started.motion_number
            what = f"{name} began motion {number} ({started.plan.motion_id})"
            _log.info("call %d: %s", call.number, what, extra=about(**told))
        if summary is not None and summary.ByteSize():
            kind = summary.DESCRIPTOR.fields_by_name["outcome"].enum_type
            call.result["motion_outcome"] = kind.values_by_number[summary.outcome].name
            call.result["motion_text"] = summary.text[:400]

    def _conclude(self, call: _Call, status: status_pb2.Status | None) -> None:
        """Count, log and, if it is a command or was refused, record a call that has ended."""
        code = "OK" if status is None else code_pb2.Code.Name(status.code)
        text = "" if status is None else status.message
        name, is_command = call.method.name, call.rule.is_command
        self._count_call(name, code, time.monotonic() - call.began)
        level = logging.INFO if is_command else logging.DEBUG
        if code != "OK" and is_command:
            level = logging.WARNING
        told = call.told()
        detail = f": {text}" if text else ""
        _log.log(level, "call %d: %s: %s%s", call.number, name, code, detail,
                 extra=about(outcome=code, **told))  # fmt: skip
        is_refused = code in ("PERMISSION_DENIED", "RESOURCE_EXHAUSTED")
        is_foreign = name == "RenewLease" and code == "FAILED_PRECONDITION"
        if is_command or is_refused or is_foreign:
            self._audit.record(event="answered", outcome=code, text=text[:400], **told)


@dataclass(eq=False)
class _Call:
    """One call under way: what was *asked*, and the *result*, as far as they are recorded."""

    number: int
    method: Method
    rule: Rule
    caller: Caller
    began: float = field(default_factory=time.monotonic)
    asked: dict[str, Any] = field(default_factory=dict)
    result: dict[str, Any] = field(default_factory=dict)

    def told(self) -> dict[str, Any]:
        """Return what every record of this call says."""
        identity = self.caller.identity
        return {
            "call": self.number,
            "method": self.method.name,
            "identity": identity.key,
            "name": identity.name,
            "role": identity.role.name.lower(),
            "origin": self.caller.origin,
            "device": self.asked.get("device", ""),
            "request": self.asked,
            **self.result,
        }


class _LibraryStream:
    """As much of a call as the services of grpclib make use of."""

    def __init__(
        self, requests: AsyncIterator[Message], send: Callable[[Message], Awaitable[None]]
    ) -> None:
        self._requests = requests
        self.send_message = send

    def __aiter__(self) -> AsyncIterator[Message]:
        return self._requests

    async def recv_message(self) -> Message | None:
        return await anext(self._requests, None)

    async def send_trailing_metadata(self, *, status: object) -> None:  # noqa: ARG002 - not found
        raise UnknownNameError("service", "expected one that reflection lists")


def describe(request: Message) -> dict[str, Any]:
    """Return the numbers and texts of *request*, but what is secret.

    >>> from orientd.rpc import control_pb2 as pb
    >>> describe(pb.SetSpeedRequest(lease_token="abc", device="arm", speed=0.5))
    {'device': 'arm', 'speed': 0.5}
    """
    kinds = (FieldDescriptor.TYPE_MESSAGE, FieldDescriptor.TYPE_BYTES)
    return {
        one.name: content[:_MOST_TEXT] if isinstance(content, str) else content
        for part in _parts(request)
        for one, content in part.ListFields()
        if one.type not in kinds and not one.is_repeated and one.name not in SECRETS
    }


def _parts(request: Message) -> Iterator[Message]:
    """Yield *request*, and the beginning that it wraps if it is one of a stream."""
    yield request
    part = getattr(request, "start", None)
    if isinstance(part, Message):
        yield part


def _token(part: Message) -> str:
    """Return the token of the lease that a request is made under; empty if it has none."""
    found = (getattr(part, name, "") for name in SECRETS)
    return next((one for one in found if isinstance(one, str) and one), "")
