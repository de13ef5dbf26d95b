"""Authorization: every call passes it, whichever way it came, and is served behind it.

It asks two things.  Does the caller's role allow the call?  Has the caller room for one more?  It
records commands, and everything refused.
Handlers raise what they refuse a call for; the caller gets it as a status with all details.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import aclosing
from dataclasses import dataclass, field
from functools import cached_property, partial
from hashlib import sha256
from typing import Any, NamedTuple

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import DecodeError, Message
from google.rpc import code_pb2, status_pb2
from grpclib.const import Cardinality, Status
from grpclib.const import Handler as Route
from grpclib.exceptions import GRPCError
from grpclib.server import Stream

from orientd.config import Role
from orientd.daemon.access.audit import AuditLog
from orientd.daemon.access.identity import Caller
from orientd.daemon.log import about
from orientd.daemon.workers import DIGESTS
from orientd.errors import (
    AccessError,
    OrientdError,
    RequestError,
    TooMuchError,
)
from orientd.protocol import control_pb2 as pb
from orientd.protocol.status import to_status

CONTROL = "orientd.v1.Control"


@dataclass(frozen=True)
class Rule:
    """Describe the requirements of a call.

    Attributes:
        role: lowest role that may make it.
        is_command: whether it changes something, and is therefore recorded.
        is_limited: whether it counts against the limit of calls at once of one identity.
    """

    role: Role
    is_command: bool = False
    is_limited: bool = True


_LOOK = Rule(Role.OBSERVER)
_PLAN = Rule(Role.OPERATOR)
_STOP = Rule(Role.OBSERVER, is_command=True, is_limited=False)
_COMMAND = Rule(Role.OPERATOR, is_command=True)

RULES: Mapping[str, Rule] = {
    "GetState": _LOOK,
    "WatchState": _LOOK,
    "WatchEvents": _LOOK,
    "GetConfiguration": _LOOK,
    "GetPlan": _LOOK,
    "ListMethods": _LOOK,
    "ListDevices": _LOOK,
    "Plan": _PLAN,
    "Stop": _STOP,
    "Halt": _STOP,
    "Move": _COMMAND,
    "Track": _COMMAND,
    "Pause": _COMMAND,
    "Resume": _COMMAND,
    "SetSpeed": _COMMAND,
    "Enable": _COMMAND,
    "Disable": _COMMAND,
    "Reset": _COMMAND,
    "AcquireLease": _COMMAND,
    # Several times a lease; a renewal that is refused is recorded like every refusal.
    "RenewLease": Rule(Role.OPERATOR, is_limited=False),
    "ReleaseLease": _COMMAND,
    "SeizeLease": Rule(Role.ADMINISTRATOR, is_command=True),
}
"""By the name of the call; every client that may connect may stop."""

_UNLISTED = Rule(Role.ADMINISTRATOR, is_command=True)


def rule(method: str) -> Rule:
    """Return the requirements of a call by its full name *method*, ``/service/Name``.

    Health and reflection need the lowest role.  A call that no table lists needs an administrator.
    """
    service, _, name = method.removeprefix("/").partition("/")
    if service == CONTROL:
        return RULES.get(name, _UNLISTED)
    return _LOOK


_log = logging.getLogger(__name__)

SECRETS = ("lease_token", "token")
"""Fields that name a lease, wherever they are; they are written down nowhere."""

_MOST_TEXT = 200
"""Characters of one text of a request that are recorded."""

MANY_BYTES = 100_000
"""Of a motion with more, the digest is made in a thread: it takes milliseconds."""

CountCall = Callable[[str, str, float], object]
"""Is called after each call with its name, its code and its duration, s."""


@dataclass(frozen=True)
class Method:
    """One call of a service.

    Attributes:
        name: short.
        run: the handler, called with the request, or an iterator over requests, and the caller.
        request: class of its requests.
        cardinality: whether there are many requests, and many answers.
        is_library: whether the handler is grpclib's, which is called with the stream alone.
    """

    name: str
    run: Callable[..., Any]
    request: Any
    cardinality: Cardinality = Cardinality.UNARY_UNARY
    is_library: bool = False


class Answer(NamedTuple):
    """An answer that its call has serialised.

    Attributes:
        content: the serialised message.
        noted: a message of the same type with the fields that audit and log name.
    """

    content: bytes
    noted: Message


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
        count_call: CountCall,
        most_calls: int,
    ) -> None:
        """Serve *methods*.

        Args:
            methods: by their full names, ``/service/Name``.
            audit: records commands and refusals.
            count_call: called with every call that has ended.
            most_calls: of one identity at one time.
        """
        self.most_calls = most_calls
        self._methods, self._audit = methods, audit
        self._count_call = count_call
        self._numbers = itertools.count(1)
        self._calls: Counter[str] = Counter()

    def route(self, path: str, caller: Caller) -> Route | None:
        """Return how to serve the call of the full name *path*; ``None`` if there is none."""
        method = self._methods.get(path)
        if method is None:
            return None
        call = _Call(next(self._numbers), method, rule(path), caller)
        serve = partial(self._serve, call)
        return Route(serve, method.cardinality, method.request, Message)

    async def _serve(self, call: _Call, stream: Stream[Any, Any]) -> None:
        """Serve one call.

        Raises:
            GRPCError: it failed, and why.
        """
        key, is_counted = call.caller.identity.key, call.rule.is_limited
        status: status_pb2.Status | None = None
        self._calls[key] += is_counted
        try:
            self._admit(call)
            await self._run(call, stream)
        except OrientdError as error:
            status = to_status(error)
        except asyncio.CancelledError as error:
            status = status_pb2.Status(code=code_pb2.CANCELLED)
            # grpclib keeps the error, in a cycle: without the frames that hold the request.
            raise error.with_traceback(None) from None
        except Exception as error:  # noqa: BLE001 - one call is no reason to end
            _log.exception("call %d: %s failed", call.number, call.method.name)
            status = status_pb2.Status(code=code_pb2.UNKNOWN, message=repr(error)[:_MOST_TEXT])
        finally:
            self._calls[key] -= is_counted
            self._conclude(call, status)
        if status is not None:
            raise GRPCError(Status(status.code), status.message, status)

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

    async def _run(self, call: _Call, stream: Stream[Any, Any]) -> None:
        method = call.method
        if method.is_library:
            await method.run(stream)
            return
        asked: Any = self._requests(call, stream)
        if not method.cardinality.client_streaming:
            asked = await anext(asked, None)
            if asked is None:
                raise RequestError("", "expected a request, got none")
        if not method.cardinality.server_streaming:
            await self._send(call, stream, await method.run(asked, call.caller))
            return
        async with aclosing(method.run(asked, call.caller)) as answers:
            async for answer in answers:
                await self._send(call, stream, answer)

    async def _requests(self, call: _Call, stream: Stream[Any, Any]) -> AsyncIterator[Message]:
        """Yield the requests of a call.

        Raises:
            RequestError: one cannot be read.
        """
        while True:
            try:
                request = await stream.recv_message()
            except DecodeError as error:
                problem = " ".join(str(error).split())
                raise RequestError("", f"the request cannot be read: {problem}") from error
            except NotImplementedError as error:  # so grpclib says it
                problem = "the message is compressed, which is not supported"
                raise RequestError("", problem) from error
            if request is None:
                return
            if call.request is None:
                call.request = request
                if call.rule.is_command and sum(map(len, _motion(request))) > MANY_BYTES:
                    await DIGESTS.run(lambda: call.asked)
            yield request

    async def _send(
        self, call: _Call, stream: Stream[Any, Any], answer: Message | bytes | Answer
    ) -> None:
        if isinstance(answer, Answer):
            self._note(call, answer.noted)
            answer = answer.content
        elif not isinstance(answer, bytes):
            self._note(call, answer)
        await stream.send_message(answer)

    def _note(self, call: _Call, answer: Message) -> None:
        """Note what an answer says of the motion that the call began."""
        started, summary = getattr(answer, "started", None), getattr(answer, "summary", None)
        if started is not None and started.ByteSize():
            call.result["motion"] = started.motion_number
            call.result["motion_id"] = started.plan.motion_id
            if started.plan.name:
                call.asked.setdefault("motion", {})["name"] = started.plan.name
            fields = call.fields()
            self._audit.record(event="began", **fields)
            name, number = call.caller.identity.name, started.motion_number
            what = f"{name} began motion {number} ({started.plan.motion_id})"
            _log.info("call %d: %s", call.number, what, extra=about(**fields))
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
        is_refused = code in ("PERMISSION_DENIED", "RESOURCE_EXHAUSTED")
        is_foreign = name == "RenewLease" and code == "FAILED_PRECONDITION"
        is_recorded = is_command or is_refused or is_foreign
        if not (is_recorded or _log.isEnabledFor(level)):
            return
        fields = call.fields()
        detail = f": {text}" if text else ""
        _log.log(level, "call %d: %s: %s%s", call.number, name, code, detail,
                 extra=about(outcome=code, **fields))  # fmt: skip
        if is_recorded:
            self._audit.record(event="answered", outcome=code, text=text[:400], **fields)


@dataclass(eq=False)
class _Call:
    """One running call: its first *request*, and the recorded parts of its *result*."""

    number: int
    method: Method
    rule: Rule
    caller: Caller
    # Looked up at the call: the clock may be another one in tests.
    began: float = field(default_factory=lambda: time.monotonic())
    request: Message | None = None
    result: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def asked(self) -> dict[str, Any]:
        """The recorded parts of its request."""
        return {} if self.request is None else describe(self.request)

    def fields(self) -> dict[str, Any]:
        """Return the fields that every record of this call has."""
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


def describe(request: Message) -> dict[str, Any]:
    """Return the numbers and texts of *request*, without secrets.

    >>> from orientd.protocol import control_pb2 as pb
    >>> describe(pb.SetSpeedRequest(lease_token="abc", device="arm", speed=0.5))
    {'device': 'arm', 'speed': 0.5}

    Of a motion it is the number of its bytes, and a digest of them.
    """
    kinds = (FieldDescriptor.TYPE_MESSAGE, FieldDescriptor.TYPE_BYTES)
    # The first request of a stream wraps what it asks for.
    parts = [part for part in (request, getattr(request, "start", None)) if part is not None]
    described = {
        one.name: content[:_MOST_TEXT] if isinstance(content, str) else content
        for part in parts
        for one, content in part.ListFields()
        if one.type not in kinds and not one.is_repeated and one.name not in SECRETS
    }
    motion = _motion(request)
    if any(motion):
        digest = sha256(motion[0])
        digest.update(motion[1])
        described["motion"] = {"bytes": sum(map(len, motion)), "sha256": digest.hexdigest()}
    return described


def _motion(request: Message) -> tuple[bytes, bytes]:
    """Return the text and the columns of a request; both are empty if it has no motion."""
    if isinstance(request, pb.MoveRequest | pb.PlanRequest):
        return request.motion, request.columns
    return b"", b""
