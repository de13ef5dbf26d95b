"""Errors on the wire: orientd's exceptions as ``google.rpc.Status``, and back.

What a caller of the client catches is the class that the daemon raised, with the same one line and
the same attributes.
"""

from __future__ import annotations

from collections.abc import Mapping

from google.protobuf.message import Message
from google.rpc import code_pb2, error_details_pb2, status_pb2

from orientd.errors import (
    AccessError,
    DaemonError,
    DeadlineError,
    LeaseError,
    LimitError,
    LimitKind,
    MessageSizeError,
    OrientdError,
    PlanError,
    RequestError,
    StartError,
    StateError,
    TooMuchError,
    UnknownNameError,
)
from orientd.rpc import control_pb2 as pb

DETAILS_KEY = "grpc-status-details-bin"
DOMAIN = "orientd"

# gRPC sends a status as headers, which are few kilobytes at the most.
MAX_MESSAGE_LENGTH = 1000

_PRECONDITIONS: Mapping[str, type[OrientdError]] = {
    "LIMIT": LimitError,
    "START": StartError,
    "PLAN": PlanError,
    "STATE": StateError,
    "LEASE": LeaseError,
}

_REQUESTS: Mapping[type[RequestError], int] = {
    UnknownNameError: code_pb2.NOT_FOUND,
    MessageSizeError: code_pb2.RESOURCE_EXHAUSTED,
}

_CODES: Mapping[type[OrientdError], int] = {
    DeadlineError: code_pb2.DEADLINE_EXCEEDED,
    DaemonError: code_pb2.UNAVAILABLE,
    AccessError: code_pb2.PERMISSION_DENIED,
    TooMuchError: code_pb2.RESOURCE_EXHAUSTED,
}


def to_status(error: OrientdError) -> status_pb2.Status:
    """Return *error* as a status; the first line of its message is the status' message."""
    status = _status(error)
    if error.planning:
        timing = pb.MoveTiming(planning=error.planning, waiting=error.waiting)
        status.details.add().Pack(timing)
    return status


def _status(error: OrientdError) -> status_pb2.Status:
    message = (str(error).splitlines() or [type(error).__name__])[0][:MAX_MESSAGE_LENGTH]
    if isinstance(error, RequestError):
        code = _REQUESTS.get(type(error), code_pb2.INVALID_ARGUMENT)
        status = status_pb2.Status(code=code, message=message)
        bad_request = error_details_pb2.BadRequest()
        bad_request.field_violations.add(
            field=error.field, description=error.problem[:MAX_MESSAGE_LENGTH]
        )
        status.details.add().Pack(bad_request)
        return status
    for exception, code in _CODES.items():
        if isinstance(error, exception):
            return status_pb2.Status(code=code, message=message)
    for kind, exception in _PRECONDITIONS.items():
        if isinstance(error, exception):
            return _failed_precondition(error, kind, message)
    return status_pb2.Status(code=code_pb2.INTERNAL, message=message)


def from_status(status: status_pb2.Status) -> OrientdError:
    """Return the exception that *status* was made of."""
    error, timing = _exception(status), pb.MoveTiming()
    if _find(status, timing):
        error.planning, error.waiting = timing.planning, timing.waiting
    return error


def _exception(status: status_pb2.Status) -> OrientdError:
    bad_request = error_details_pb2.BadRequest()
    if _find(status, bad_request) and bad_request.field_violations:
        kinds = (kind for kind, code in _REQUESTS.items() if code == status.code)
        first = bad_request.field_violations[0]
        return next(kinds, RequestError)(first.field, first.description)
    precondition = error_details_pb2.PreconditionFailure()
    if _find(status, precondition) and precondition.violations:
        exception = _PRECONDITIONS.get(precondition.violations[0].type, OrientdError)
        return _limit_error(status) if exception is LimitError else exception(status.message)
    for exception, code in _CODES.items():
        if status.code == code:
            return exception(status.message)
    return OrientdError(status.message)


def _failed_precondition(error: OrientdError, kind: str, message: str) -> status_pb2.Status:
    status = status_pb2.Status(code=code_pb2.FAILED_PRECONDITION, message=message)
    subject = kind.lower()
    cause = error_details_pb2.ErrorInfo(reason=kind, domain=DOMAIN)
    if isinstance(error, LimitError):
        subject = error.quantity
        figures = {name: repr(float(getattr(error, name))) for name in ("value", "limit", "time")}
        words = {"kind": error.kind.value, "quantity": error.quantity, "unit": error.unit}
        cause.metadata.update({**words, **figures})
    precondition = error_details_pb2.PreconditionFailure()
    precondition.violations.add(type=kind, subject=subject, description=message)
    status.details.add().Pack(precondition)
    status.details.add().Pack(cause)
    return status


def _limit_error(status: status_pb2.Status) -> OrientdError:
    cause = error_details_pb2.ErrorInfo()
    if not _find(status, cause):
        return PlanError(status.message)
    known = cause.metadata
    error = LimitError(
        known["quantity"],
        float(known["value"]),
        float(known["limit"]),
        float(known["time"]),
        known["unit"],
        kind=LimitKind(known.get("kind", LimitKind.DEVIATION.value)),  # not of earlier daemons
    )
    # The daemon's own line: it may carry advice, which has no field.
    error.args = (status.message,)
    return error


def _find(status: status_pb2.Status, wanted: Message) -> bool:
    """Fill *wanted* from the first detail of its kind; say whether there was one."""
    return any(detail.Unpack(wanted) for detail in status.details)
