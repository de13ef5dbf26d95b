"""A client's connection to the daemon, which raises orientd's own errors."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import grpc
from google.protobuf.message import DecodeError
from google.rpc import status_pb2

from orientd.client.channel import Way
from orientd.client.daemon_clock import DaemonClock, Reading
from orientd.client.stop_call import refusal
from orientd.errors import (
    AccessError,
    DaemonError,
    LeaseError,
    MessageSizeError,
    OrientdError,
    RequestError,
)
from orientd.protocol import control_pb2 as pb
from orientd.protocol.status import DETAILS_KEY, from_status
from orientd.protocol.stub import control_stub

Answer = TypeVar("Answer")

_CLOCK_TIMEOUT = 5.0
"""How long the daemon may take to tell its clock, s."""

_REPORT_TIMEOUT = 1.0
"""Timeout of the daemon's report after a stop, s."""


_UNSEEN = (
    "motion: expected a motion or a motion_id",
    "keyframes: expected at least 1, got 0",
    "a command needs the lease",
)
"""Errors of a daemon that does not know the fields of a request, as that of version 0.2."""


class UnreachableError(DaemonError):
    """No call reached a daemon."""


@dataclass(frozen=True, slots=True)
class StartAt:
    """A start time that does not depend on the time of day.

    Attributes:
        monotonic_ns: on the daemon's monotonic clock.
        armed_by: when the call is cancelled if the daemon has not armed the motion by then, s, by
            :func:`time.monotonic` here; ``None`` for never.
    """

    monotonic_ns: int
    armed_by: float | None = None


class Connection:
    """An open channel to the daemon, until it is closed.

    Attributes:
        way: endpoint of the daemon.
        stub: of the control service.
    """

    def __init__(self, way: Way, *, timeout: float) -> None:
        """Open *way*; it connects on first use.

        Args:
            way: endpoint of the daemon.
            timeout: s for an answer.

        Raises:
            DaemonError: a certificate cannot be read, or the path is not suitable for a socket.
        """
        self.way = way
        self._timeout = timeout
        self._channel = way.open()
        self._is_closed = False
        self.stub: Any = control_stub(self._channel)

    @cached_property
    def clock(self) -> DaemonClock:
        """The daemon's clock."""
        return DaemonClock(self._read_clock, is_local=not self.way.address)

    @contextlib.contextmanager
    def naming_versions(self) -> Iterator[None]:
        """Name both versions if the daemon is of an earlier one, which finds no motion or lease."""
        try:
            yield
        except (LeaseError, RequestError) as error:
            if not str(error).startswith(_UNSEEN):
                raise
            from importlib.metadata import version  # slow to load

            daemon = self.ask(self.stub.GetState, pb.GetStateRequest()).daemon
            theirs, ours = daemon.version, version("orientd-motion")
            if theirs == ours:
                raise
            problem = f"the daemon at {self.way} is of orientd {theirs}, and cannot"
            step = f"read the motions of this client, of orientd {ours}; update the older one"
            raise DaemonError(f"{problem} {step}") from error

    def after_stop(self, device: str) -> list[pb.DeviceReport]:
        """Return the report of a stopped device, or of all of them if *device* is empty.

        Raises:
            OrientdError: the daemon does not answer in time.
        """
        request = pb.GetStateRequest(device=device)
        now = self.call(self.stub.GetState, request, timeout=_REPORT_TIMEOUT)
        return list(now.devices)

    def close(self) -> None:
        """Close the channel, which ends every call."""
        self._is_closed = True
        self._channel.close()

    def ask(self, method: Callable[..., Answer], request: object) -> Answer:
        """Return the answer of a call.

        Raises:
            OrientdError: the daemon's error, or no daemon answers.
        """
        return self.call(method, request, timeout=self._timeout)

    def _read_clock(self) -> Reading:
        answer: Any = self.call(self.stub.GetState, pb.GetStateRequest(), timeout=_CLOCK_TIMEOUT)
        if not answer.monotonic_ns:
            raise DaemonError(
                f"the daemon at {self.way} is of another version: it does not tell its clock"
            )
        return Reading(answer.monotonic_ns, answer.clock)

    def call(
        self,
        method: Callable[..., Answer],
        request: object,
        *,
        timeout: float | None = None,
    ) -> Answer:
        """Call *method* of the stub, and return its answer or the stream of its answers.

        Errors in a stream are gRPC's: see :meth:`explain`.

        Args:
            method: of the stub.
            request: a message, or an iterator over messages.
            timeout: s for the call; ``None`` for no limit.

        Raises:
            OrientdError: the daemon's error, or no daemon answers.
        """
        try:
            return method(request, timeout=timeout)
        except grpc.RpcError as error:
            raise self.explain(error) from error
        except ValueError as error:
            if not self._is_closed:
                raise
            raise DaemonError(f"the connection to {self.way} is closed") from error

    def explain(self, error: grpc.RpcError, *, lost: str = "") -> OrientdError:
        """Return the exception for a call that failed.

        Args:
            error: gRPC's exception.
            lost: message of a call that the daemon had begun to answer, if the daemon is lost.
        """
        found = from_call(error, self.way)
        if not isinstance(found, UnreachableError):
            return found
        if not self.way.address:
            refused = refusal(self.way.socket)
            if refused:
                return AccessError(f"the daemon at {self.way}: {refused}")
        return DaemonError(lost) if lost else found


_HUNG_UP = "Socket closed", "Connection reset by peer"
"""gRPC's message if the daemon closes the connection right after the handshake."""


def from_call(error: grpc.RpcError, where: Way) -> OrientdError:
    """Return the exception for a call that failed.

    Args:
        error: gRPC's exception.
        where: endpoint of the daemon, for the message if none answers.
    """
    if not isinstance(error, grpc.Call):
        return DaemonError(f"the call to the daemon at {where} failed: {error}")
    metadata: Any = error.trailing_metadata()
    details = dict(metadata or ()).get(DETAILS_KEY)
    if details is not None:
        with contextlib.suppress(DecodeError):
            return from_status(status_pb2.Status.FromString(details))
    code, text = error.code(), " ".join((error.details() or "").split())
    if code is grpc.StatusCode.UNAVAILABLE:
        if where.address:
            return UnreachableError(_tls_problem(where.address, text))
        return UnreachableError(f"no daemon answers at {where}; start one with `orientd run`")
    if code is grpc.StatusCode.DEADLINE_EXCEEDED:
        return DaemonError(f"the daemon at {where} did not answer in time")
    if code is grpc.StatusCode.CANCELLED:
        return DaemonError("the call was cancelled")
    if code is grpc.StatusCode.RESOURCE_EXHAUSTED:
        return MessageSizeError("", f"the message is too large: {text}")
    if code is grpc.StatusCode.UNIMPLEMENTED:
        return DaemonError(f"the daemon at {where} is of another version: {text}")
    return OrientdError(f"the daemon at {where} failed: {text}")


def _tls_problem(where: str, text: str) -> str:
    """Return why no call reaches *where*, from gRPC's message."""
    reason = text.rpartition("last error: ")[2]
    if "Hostname Verification Check failed" in reason:
        host = where.rpartition(":")[0]
        return (
            f"the certificate of the daemon at {where} is not for {host!r}; use a host that it "
            "names, or sign one for this host (subjectAltName)"
        )
    _, is_refused, verdict = reason.partition("CERTIFICATE_VERIFY_FAILED: ")
    if is_refused:
        return (
            f"the certificate of the daemon at {where} is refused: {verdict.removesuffix(': OK')}"
        )
    if any(end in reason for end in _HUNG_UP):
        return (
            f"the daemon at {where} does not admit this certificate: another authority signed it, "
            "or it has expired, is revoked, is not one for clients or has no role; "
            "its log says which"
        )
    return f"no daemon listens at {where}: {reason}"
