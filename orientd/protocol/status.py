"""Errors on the wire: orientd's exceptions as ``google.rpc.Status``, and back.

The client raises the class that the daemon raised, with the same message and the same attributes.
"""

from __future__ import annotations

from google.protobuf.message import Message
from google.rpc import code_pb2, error_details_pb2, status_pb2

from orientd import errors
from orientd.errors import LimitError, LimitKind, OrientdError, RequestError
from orientd.one_line import one_line
from orientd.protocol import control_pb2 as pb

DETAILS_KEY = "grpc-status-details-bin"
DOMAIN = "orientd"

# gRPC sends a status as headers, which hold few kilobytes.
MAX_MESSAGE_LENGTH = 1000

_FIGURES = ("value", "limit", "time")

_KINDS: tuple[tuple[type[OrientdError], int, str], ...] = (
    (errors.UnknownNameError, code_pb2.NOT_FOUND, ""),
    (errors.MessageSizeError, code_pb2.RESOURCE_EXHAUSTED, ""),
    (RequestError, code_pb2.INVALID_ARGUMENT, ""),
    (errors.DeadlineError, code_pb2.DEADLINE_EXCEEDED, ""),
    (errors.DaemonError, code_pb2.UNAVAILABLE, ""),
    (errors.AccessError, code_pb2.PERMISSION_DENIED, ""),
    (errors.TooMuchError, code_pb2.RESOURCE_EXHAUSTED, ""),
    (LimitError, code_pb2.FAILED_PRECONDITION, "LIMIT"),
    (errors.StartError, code_pb2.FAILED_PRECONDITION, "START"),
    (errors.PlanError, code_pb2.FAILED_PRECONDITION, "PLAN"),
    (errors.StateError, code_pb2.FAILED_PRECONDITION, "STATE"),
    (errors.LeaseError, code_pb2.FAILED_PRECONDITION, "LEASE"),
    (OrientdError, code_pb2.INTERNAL, ""),
)
"""Each error with its code, and with the type of its violation if it is a failed precondition.

The first entry that fits counts.
"""


def to_status(error: OrientdError) -> status_pb2.Status:
    """Return *error* as a status; the first line of its message is the status' message."""
    code, kind = next((code, kind) for of, code, kind in _KINDS if isinstance(error, of))
    first = (str(error).splitlines() or [type(error).__name__])[0]
    message = one_line(first, MAX_MESSAGE_LENGTH)
    details: list[Message] = []
    if isinstance(error, RequestError):
        request = error_details_pb2.BadRequest()
        problem = one_line(error.problem, MAX_MESSAGE_LENGTH)
        request.field_violations.add(field=error.field, description=problem)
        details = [request]
    elif kind:
        subject, cause = kind.lower(), error_details_pb2.ErrorInfo(reason=kind, domain=DOMAIN)
        if isinstance(error, LimitError):
            subject = error.quantity
            words = {"kind": error.kind.value, "quantity": subject, "unit": error.unit}
            figures = {name: repr(float(getattr(error, name))) for name in _FIGURES}
            cause.metadata.update({**words, **figures})
        precondition = error_details_pb2.PreconditionFailure()
        precondition.violations.add(type=kind, subject=subject, description=message)
        details = [precondition, cause]
    if error.planning:
        details.append(pb.MoveTiming(planning=error.planning, waiting=error.waiting))
    status = status_pb2.Status(code=code, message=message)
    for detail in details:
        status.details.add().Pack(detail)
    return status


def from_status(status: status_pb2.Status) -> OrientdError:
    """Return the exception that *status* was made of."""
    error = _exception(status)
    timing = pb.MoveTiming()
    if _find(status, timing):
        error.planning, error.waiting = timing.planning, timing.waiting
    return error


def _exception(status: status_pb2.Status) -> OrientdError:
    request, failure = error_details_pb2.BadRequest(), error_details_pb2.PreconditionFailure()
    if _find(status, request) and request.field_violations:
        first = request.field_violations[0]
        kinds = (of for of, code, _ in _KINDS if code == status.code)
        found = next((of for of in kinds if issubclass(of, RequestError)), RequestError)
        refused = found(first.field, first.description)
        # The daemon's own line: it may begin with the name of a file, which has no field.
        refused.args = (status.message,)
        return refused
    if _find(status, failure) and failure.violations:
        kind = failure.violations[0].type
        if kind == "LIMIT":
            return _limit_error(status)
        return next((of for of, _, one in _KINDS if kind and one == kind), OrientdError)(
            status.message
        )
    kinds = (of for of, code, kind in _KINDS if code == status.code and not kind)
    other = next((of for of in kinds if not issubclass(of, RequestError)), OrientdError)
    return other(status.message)


def _limit_error(status: status_pb2.Status) -> OrientdError:
    cause = error_details_pb2.ErrorInfo()
    if not _find(status, cause):
        return errors.PlanError(status.message)
    known = cause.metadata
    value, limit, time = (float(known[name]) for name in _FIGURES)
    # Earlier daemons do not say the kind.
    kind = LimitKind(known.get("kind", LimitKind.DEVIATION.value))
    error = LimitError(known["quantity"], value, limit, time, known["unit"], kind=kind)
    # The daemon's own line: it may carry advice, which has no field.
    error.args = (status.message,)
    return error


def _find(status: status_pb2.Status, wanted: Message) -> bool:
    """Fill *wanted* from the first detail of its kind; return whether there was one."""
    return any(detail.Unpack(wanted) for detail in status.details)
