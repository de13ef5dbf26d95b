"""The way of a report to its message and back, field by field.

What a report has is declared once for each side: by a class of :mod:`orientd.rpc.reports`, and by a
message of ``control.proto``.  How a field is converted follows from the message; only where the two
are called differently, or are of kinds of their own, a codec is told so.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from enum import Enum
from typing import Any, Generic, TypeVar

from google.protobuf.message import Message

from orientd.errors import Fault
from orientd.rpc import control_pb2 as pb
from orientd.rpc.reports import Outcome
from orientd.rpc.wire.values import quaternion, to_quaternion, to_vector, vector
from orientd.stream import ServoState

Report = TypeVar("Report")
Sent = TypeVar("Sent", bound=Message)
Converters = tuple[Callable[[Any], Any], Callable[[Any], Any]]
"""From the value of a report to that of a message, and back."""


def _both(kind: type[Enum], of: Any) -> Converters:  # noqa: ANN401 - generated
    numbers = {one: of.Value(f"{of.DESCRIPTOR.name.upper()}_{one.name}") for one in kind}
    back = {number: one for one, number in numbers.items()}
    return numbers.__getitem__, back.__getitem__


_ENUMS: dict[str, Converters] = {
    "State": _both(ServoState, pb.State),
    "Fault": _both(Fault, pb.Fault),
    "Outcome": _both(Outcome, pb.Outcome),
}
_VALUES: dict[str, Converters] = {
    "Vector3": (vector, to_vector),
    "Quaternion": (quaternion, to_quaternion),
}


@dataclass(frozen=True, slots=True)
class _Entry:
    """A field of a report: *wire* is its name in the message, or in *group*, a message of that."""

    name: str
    group: str
    wire: str
    is_optional: bool
    is_repeated: bool
    to: Callable[[Any], Any] | None = None
    back: Callable[[Any], Any] | None = None


class Codec(Generic[Report, Sent]):
    """The way of one kind of report to its message and back.

    Attributes:
        report: the class of the report.
        message: the class of the message.
        paths: where the message has each field of the report.
    """

    def __init__(
        self,
        report: type[Report],
        message: type[Sent],
        *,
        names: Mapping[str, str] | None = None,
        kinds: Mapping[str, Converters] | None = None,
        without: tuple[str, ...] = (),
    ) -> None:
        """Pair the fields of the two.

        Args:
            report: the class of the report, a dataclass or a named tuple.
            message: the class of the message.
            names: of fields in the message that are called otherwise in the report, by their names
                there; ``a.b`` is the field ``b`` of the message in the field ``a``.
            kinds: how to convert those that are no plain values, by their names in the report.
            without: fields of the report that are not in the message.

        Raises:
            KeyError: the message lacks a field.
        """
        known = getattr(report, "_fields", None) or [entry.name for entry in fields(report)]  # type: ignore[arg-type] # one of the two
        self.paths = {name: (names or {}).get(name, name) for name in known if name not in without}
        self.report, self.message = report, message
        self._entries = [
            _entry(name, path, message.DESCRIPTOR, (kinds or {}).get(name))
            for name, path in self.paths.items()
        ]

    def to_message(self, report: Report) -> Sent:
        """Return *report* as a message; what is ``None`` is left out."""
        said: dict[str, Any] = {}
        for entry in self._entries:
            value = getattr(report, entry.name)
            if value is None:
                continue
            if entry.to is not None:
                value = list(map(entry.to, value)) if entry.is_repeated else entry.to(value)
            group = said.setdefault(entry.group, {}) if entry.group else said
            group[entry.wire] = value
        return self.message(**said)

    def from_message(self, message: Sent, **more: object) -> Report:
        """Return the report that *message* was made of, with *more* fields that are not in it."""
        for entry in self._entries:
            group = getattr(message, entry.group) if entry.group else message
            if entry.is_optional and not group.HasField(entry.wire):
                more[entry.name] = None
                continue
            value = getattr(group, entry.wire)
            if entry.is_repeated:
                value = tuple(value if entry.back is None else map(entry.back, value))
            elif entry.back is not None:
                value = entry.back(value)
            more[entry.name] = value
        return self.report(**more)

    @property
    def kind(self) -> Converters:
        """How other codecs convert a field that holds such a report."""
        return self.to_message, self.from_message


def _entry(name: str, path: str, of: Any, kind: Converters | None) -> _Entry:  # noqa: ANN401
    group, _, wire = path.rpartition(".")
    field = (of.fields_by_name[group].message_type if group else of).fields_by_name[wire]
    value = None
    if field.message_type is not None:
        value = _VALUES.get(field.message_type.name)
    elif field.enum_type is not None:
        value = _ENUMS[field.enum_type.name]
    to, back = kind or value or (None, None)
    # A vector is never absent, but for its components, which are 0 then.
    is_optional = field.has_presence and value is None
    is_repeated = field.default_value == []
    return _Entry(name, group, wire, is_optional, is_repeated, to, back)
