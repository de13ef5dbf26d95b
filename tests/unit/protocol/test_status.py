"""Errors cross the wire as what they were."""

import contextlib

import pytest
from google.rpc import code_pb2, error_details_pb2

from orientd.errors import (
    DaemonError,
    LeaseError,
    LimitError,
    LimitKind,
    OrientdError,
    PlanError,
    RequestError,
    StartError,
    StateError,
    UnknownNameError,
    naming,
)
from orientd.protocol.status import from_status, to_status

ERRORS = [
    RequestError("keyframes[2].quaternion", "norm must be 1 within 1e-06, got 1.1"),
    RequestError("", "a motion must be a mapping"),
    UnknownNameError("device", "expected one of arm, got 'leg'"),
    LimitError(
        "angular velocity", 3.0, 2.5, 0.125, "rad/s", "give it more time", kind=LimitKind.VELOCITY
    ),
    StartError("it does not begin where the device is"),
    PlanError("it cannot be planned"),
    StateError("device arm is idle"),
    LeaseError("the lease is held by 'ana'"),
    DaemonError("the daemon is going down"),
    OrientdError("something else"),
]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_an_error_arrives_as_what_it_was(error):
    arrived = from_status(to_status(error))
    assert type(arrived) is type(error)
    assert str(arrived) == str(error)
    assert vars(arrived) == vars(error)


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_a_refused_motion_tells_how_long_it_was_waited_for(error):
    told = from_status(to_status(error)).__dict__ | {"planning": 4.25, "waiting": 3.5}
    error = from_status(to_status(error))
    error.planning, error.waiting = 4.25, 3.5
    arrived = from_status(to_status(error))
    assert vars(arrived) == told
    assert type(arrived) is type(error)


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ERRORS[0], code_pb2.INVALID_ARGUMENT),
        (ERRORS[2], code_pb2.NOT_FOUND),
        *((error, code_pb2.FAILED_PRECONDITION) for error in ERRORS[3:8]),
        (ERRORS[8], code_pb2.UNAVAILABLE),
        (ERRORS[9], code_pb2.INTERNAL),
    ],
)
def test_every_error_has_the_code_of_its_kind(error, code):
    assert to_status(error).code == code


def test_a_bad_request_names_the_field():
    bad_request = error_details_pb2.BadRequest()
    (detail,) = to_status(ERRORS[0]).details
    assert detail.Unpack(bad_request)
    (violation,) = bad_request.field_violations
    assert violation.field == "keyframes[2].quaternion"
    assert violation.description == "norm must be 1 within 1e-06, got 1.1"


@pytest.mark.parametrize(
    ("error", "kind", "subject"),
    [
        (ERRORS[3], "LIMIT", "angular velocity"),
        (ERRORS[4], "START", "start"),
        (ERRORS[5], "PLAN", "plan"),
        (ERRORS[6], "STATE", "state"),
        (ERRORS[7], "LEASE", "lease"),
    ],
)
def test_a_failed_precondition_says_which(error, kind, subject):
    precondition, cause = error_details_pb2.PreconditionFailure(), error_details_pb2.ErrorInfo()
    first, second = to_status(error).details
    assert first.Unpack(precondition)
    assert second.Unpack(cause)
    assert precondition.violations[0].type == kind
    assert precondition.violations[0].subject == subject
    assert (cause.reason, cause.domain) == (kind, "orientd")


def test_a_refusal_keeps_the_name_of_its_file():
    error = RequestError("pace", "expected 'even'")
    with contextlib.suppress(RequestError), naming("wave.yaml"):
        raise error
    assert str(from_status(to_status(error))) == "wave.yaml: pace: expected 'even'"


@pytest.mark.parametrize("key", ["a\nb", "a\x1b[31mb", "a\0b", "\ud800", "\u202e"])
def test_a_field_of_any_characters_is_printable_on_one_line(key):
    arrived = from_status(to_status(RequestError(f"options.{key}", "unknown option")))
    assert str(arrived).isprintable()
    assert str(arrived).startswith("options.")
    assert str(arrived).endswith(": unknown option")


def test_a_message_stays_one_line_that_fits_a_header():
    status = to_status(RequestError("keyframes", "x" * 100_000 + "\nmore"))
    assert "\n" not in status.message
    assert status.ByteSize() < 4096
