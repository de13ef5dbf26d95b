"""Thin helpers for the messages that the daemon reports with: words, arrays, plain values.

The client returns the messages of ``control.proto`` themselves.  A field that is absent reads as
its default: ``message.HasField("settled_after")`` says whether it is there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from google.protobuf.message import Message

from orientd.protocol import control_pb2 as pb

if TYPE_CHECKING:
    from orientd.rotation import Floats

STALE = 1.0
"""s; older reports are no longer shown as the current state."""

Outline = tuple["Floats", ...]
"""A device's shape: lines from point to point in the world, m, each of shape ``(n, 3)``."""

GOOD_OUTCOMES = (pb.OUTCOME_DONE, pb.OUTCOME_PASSED)
"""Of a motion that ran as it was requested."""


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """A planned motion at many instants.

    Attributes:
        times: s from the beginning of the motion, shape ``(n,)``.
        q: orientations ``(w, x, y, z)``, tool to world, shape ``(n, 4)``.
        omega_body: angular velocities, rad/s, shape ``(n, 3)``.
        alpha_body: their derivatives, rad/s^2, shape ``(n, 3)``.
        position: of the tool in the world, m, shape ``(n, 3)``.
        velocity: their derivatives, m/s, shape ``(n, 3)``.
    """

    times: Floats
    q: Floats
    omega_body: Floats
    alpha_body: Floats
    position: Floats
    velocity: Floats


@dataclass(frozen=True, slots=True)
class CellReport:
    """A daemon and its devices at one instant.

    Attributes:
        daemon: the process, its socket and its leases.
        devices: by name.
    """

    daemon: pb.DaemonReport
    devices: Mapping[str, pb.DeviceReport]


def titled(number: int, name: str) -> str:
    """Return what to call a motion: its number, and its name if it has one.

    >>> titled(3, ""), titled(3, "pick")
    ('3', "3 'pick'")
    """
    return f"{number} {name!r}" if name else str(number)


def orientation(q: Sequence[float]) -> str:
    """Return a quaternion with its components by name.

    >>> orientation((1.0, 0.0, 0.0, 0.0))
    'w +1.0000 x +0.0000 y +0.0000 z +0.0000'
    """
    # Rounded first: what is hardly below zero would be shown as -0.0000.
    parts = (round(part, 4) + 0.0 for part in q)
    return " ".join(f"{name} {part:+.4f}" for name, part in zip("wxyz", parts, strict=True))


def word(message: Message, field: str) -> str:
    """Return the value of an enumeration in *message* as a word.

    >>> word(pb.MoveSummary(outcome=pb.OUTCOME_DONE), "outcome")
    'done'
    """
    return _word(message.DESCRIPTOR.fields_by_name[field], getattr(message, field))


def ending(of: pb.MoveSummary | pb.EndedMotion) -> str:
    """Return how a motion has ended, in a few words.

    >>> ending(pb.MoveSummary(outcome=pb.OUTCOME_DONE))
    'done'
    >>> ending(pb.MoveSummary(outcome=pb.OUTCOME_STOPPED, text="stopped by ana"))
    'stopped by ana'
    >>> ending(pb.MoveSummary(outcome=pb.OUTCOME_FAULT, text="the link is lost"))
    'fault: the link is lost'
    """
    outcome = word(of, "outcome")
    if not of.text or of.outcome == pb.OUTCOME_DONE:
        return outcome
    return of.text if of.text.startswith(outcome) else f"{outcome}: {of.text}"


def last_ending(device: pb.DeviceReport) -> str:
    """Return how the newest motion of a device has ended; empty while it has not.

    >>> ended = {"name": "turn", "outcome": pb.OUTCOME_STOPPED, "path_time": 0.5, "duration": 2.0}
    >>> last_ending(pb.DeviceReport(motion_number=3, ended={"motion_number": 3, **ended}))
    "3 'turn': stopped, at 0.500 of 2.000 s"
    >>> last_ending(pb.DeviceReport(motion_number=4, ended={"motion_number": 3, **ended}))
    ''
    """
    of = device.ended
    if not of.motion_number or of.motion_number != device.motion_number:
        return ""
    when = ""
    if of.duration:
        place = "" if of.outcome in GOOD_OUTCOMES else f"at {of.path_time:.3f} of "
        when = f", {place}{of.duration:.3f} s"
    return f"{titled(of.motion_number, of.name)}: {ending(of)}{when}"


def samples(plan: pb.Plan) -> Samples:
    """Return the samples of *plan* as arrays."""
    import numpy as np

    columns = plan.samples
    vectors = (columns.omega_body, columns.alpha_body, columns.position, columns.velocity)
    return Samples(
        np.array(columns.path_times, dtype=np.float64),
        np.array(columns.q, dtype=np.float64).reshape(-1, 4),
        *(np.array(column, dtype=np.float64).reshape(-1, 3) for column in vectors),
    )


def outline(lines: Iterable[pb.Polyline]) -> Outline:
    """Return a device's shape as arrays."""
    import numpy as np

    return tuple(np.array(line.coordinates, dtype=np.float64).reshape(-1, 3) for line in lines)


def plain(message: Message) -> dict[str, Any]:
    """Return *message* as plain values for JSON: absent fields are ``None``, enumerations words.

    >>> plain(pb.LeaseReport(holder="ana", remaining=2.5, devices=["arm"]))
    {'holder': 'ana', 'remaining': 2.5, 'identity': '', 'devices': ['arm']}
    """
    return {field.name: _plain(message, field) for field in message.DESCRIPTOR.fields}


def _plain(message: Message, field: Any) -> Any:  # noqa: ANN401 - a descriptor; what JSON can hold
    value = getattr(message, field.name)
    if field.has_presence and not message.HasField(field.name):
        return None
    if field.is_repeated:
        return [_one(field, one) for one in value]
    return _one(field, value)


def _one(field: Any, value: Any) -> Any:  # noqa: ANN401
    if field.enum_type is not None:
        return _word(field, value)
    if field.message_type is None:
        return value
    return [value.x, value.y, value.z] if isinstance(value, pb.Vector3) else plain(value)


def _word(field: Any, number: int) -> str:  # noqa: ANN401
    enum = field.enum_type
    # Every value begins with the enumeration's own name, as the first one does.
    letters = (f"_{letter}" if letter.isupper() else letter for letter in enum.name)
    prefix = "".join(letters).removeprefix("_").upper()
    known = enum.values_by_number.get(number)  # a newer daemon may have more
    name: str = known.name if known else str(number)
    return name.removeprefix(f"{prefix}_").lower()
