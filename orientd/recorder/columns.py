"""The columns of a cycle: the servo's record as a table, its message in a recording, its export.

A recording has one message for each cycle of a device.  Its schema is a ROS 2 message definition
(encoding ``ros2msg``, messages as ``cdr``) that names every quantity with its unit and stands in
each file.  Strings come last, so that all messages of a schema begin with one fixed layout, which
NumPy writes and reads as an array.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from orientd import rotation
from orientd.errors import Fault
from orientd.stream.records import JOINTS, CycleFlag, ServoState

SCHEMA_NAME = "orientd/msg/Cycle"
QUATERNION, VECTOR, AXES = "geometry_msgs/Quaternion", "geometry_msgs/Vector3", f"float64[{JOINTS}]"


class Column(NamedTuple):
    """One quantity of a cycle.

    Attributes:
        name: in the servo's record, and with components and unit in exports; empty for a quantity
            that the recorder computes.
        path: in a recording.
        type: in a recording, a type of ROS 2.
        unit: ``""`` for a number without one.
        doc: one sentence.
        step: a recording holds multiples of this; 0 for exact numbers.  A power of two below what
            any device resolves, so that the zeros behind it compress.
    """

    name: str
    path: str
    type: str
    unit: str
    doc: str
    step: float = 0.0


# In the order of the servo's record, byte for byte.
COLUMNS = (
    Column("index", "index", "int64", "", "Number of the cycle since the servo started."),
    Column("deadline_ns", "deadline_ns", "int64", "ns", "Deadline, monotonic clock."),
    Column("lateness_ns", "lateness_ns", "int64", "ns", "Delay of the cycle after its deadline."),
    Column("work_ns", "work_ns", "int64", "ns", "Computing time of the cycle before."),
    Column("feedback_time_ns", "measured.age_ns", "int64", "ns",
           "Age of the measurement at the deadline; 0 without feedback."),
    Column("path_index", "path_index", "int64", "",
           "Record of the path at or before the setpoint."),
    Column("state", "state", "string", "", "State of the servo."),
    Column("fault", "fault", "string", "", "Fault of the device; none without a fault."),
    Column("motion", "motion", "uint32", "",
           "Number of the motion of the setpoint; 0 before the first."),
    Column("flags", "", "uint32", "", ""),
    Column("overruns", "overruns", "uint32", "",
           "Cycles so far that began more than half a period late."),
    Column("missed", "missed", "uint32", "", "Deadlines skipped so far."),
    Column("path_fraction", "path_fraction", "float64", "",
           "Place of the setpoint from that record (0) to the next (1).", 2.0**-30),
    Column("speed", "speed", "float64", "", "Rate of the time scaling.", 2.0**-30),
    Column("sent_q", "sent.q", QUATERNION, "", "Orientation, tool to world.", 2.0**-34),
    Column("sent_omega_body", "sent.omega_body", VECTOR, "rad/s",
           "Angular velocity, body frame.", 2.0**-27),
    Column("sent_alpha_body", "sent.alpha_body", VECTOR, "rad/s^2",
           "Angular acceleration, body frame.", 2.0**-20),
    Column("sent_position", "sent.position", VECTOR, "m", "Position, world frame.", 2.0**-30),
    Column("measured_q", "measured.q", QUATERNION, "",
           "Orientation, tool to world.", 2.0**-27),
    Column("measured_omega_body", "measured.omega_body", VECTOR, "rad/s",
           "Angular velocity, body frame.", 2.0**-20),
    Column("measured_position", "measured.position", VECTOR, "m",
           "Position, world frame.", 2.0**-24),
    Column("measured_joints", "measured.joints", AXES, "rad",
           "Axis angles; NaN for an axis that the device does not have.", 2.0**-27),
    Column("sent_joints", "sent.joints", AXES, "rad",
           "Axis angles; NaN if the driver sends none.", 2.0**-27),
    Column("planned_q", "planned.q", QUATERNION, "",
           "Orientation of the path at path_index and path_fraction; NaN without one.", 2.0**-34),
    Column("", "measured.tracking_error", "float64", "rad",
           "Angle from the orientation sent to the one measured in the same cycle.", 2.0**-27),
)  # fmt: skip

FLAGS = {
    "has_feedback": (CycleFlag.FEEDBACK, "Whether there is feedback."),
    "is_written": (CycleFlag.WRITTEN, "Whether a setpoint was written."),
    "is_from_rest": (CycleFlag.FROM_REST, "Whether the motion goes on from rest after a stall."),
    "is_arriving": (CycleFlag.ARRIVING, "Whether the axes have yet to arrive at the end."),
}
"""Bits of the record's ``flags``, each a truth value in a recording."""

_GROUPS = {"planned": "orientd/Planned", "sent": "orientd/Sent", "measured": "orientd/Measured"}
_ROS = {
    QUATERNION: "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    VECTOR: "float64 x\nfloat64 y\nfloat64 z\n",
}
_NUMPY: Mapping[str, Any] = {
    "bool": "?", "uint32": "<u4", "int64": "<i8", "float64": "<f8", "string": "<u4",
    QUATERNION: ("<f8", 4), VECTOR: ("<f8", 3), AXES: ("<f8", JOINTS),
}  # fmt: skip

CYCLES = np.dtype([(one.name, _NUMPY[one.type]) for one in COLUMNS if one.name])
"""The servo's cycle record, byte for byte; states and faults are numbers of their enumerations."""

Table = NDArray[np.void]

_NAMES: Mapping[str, Mapping[int, str]] = {
    "state": {state.value: state.name.lower() for state in ServoState},
    "fault": {fault.value: fault.name.lower() for fault in Fault},
}
_CDR = b"\x00\x01\x00\x00"
"""Head of a message: little-endian, plain."""
_LENGTH = struct.Struct("<I")


def named(name: str, numbers: NDArray[Any]) -> list[str]:
    """Return the names of states or faults, the number itself for one that has none."""
    names = _NAMES[name]
    return [names.get(number, str(number)) for number in numbers.tolist()]


def numbers(name: str, names: Sequence[str]) -> NDArray[np.uint32]:
    """Return the numbers of states or faults that *names* are of.

    Raises:
        ValueError: there is no such state or fault.
    """
    known = {text: number for number, text in _NAMES[name].items()}
    return np.array([known[one] if one in known else int(one) for one in names], dtype=np.uint32)


def from_records(records: bytes | Sequence[bytes]) -> Table:
    """Return the table of packed records of the servo.

    Raises:
        ValueError: the bytes are no whole number of records.
    """
    packed = records if isinstance(records, bytes) else b"".join(records)
    return np.frombuffer(packed, dtype=CYCLES)


def without_numbers(count: int) -> Table:
    """Return *count* cycles of zeros, with NaN for axis angles and the planned orientation."""
    table = np.zeros(count, CYCLES)
    for name in ("measured_joints", "sent_joints", "planned_q"):
        table[name] = np.nan
    return table


@cache
def schema() -> str:
    """Return the definition of a cycle's message."""
    plain = [one for one in COLUMNS if one.path and "." not in one.path]
    lines = ["# A cycle of a device. Without feedback, what was measured is NaN.\n\n"]
    lines += [_field(one) for one in plain if one.type != "string"]
    lines += [f"# {doc}\nbool {name}\n" for name, (_, doc) in FLAGS.items()]
    lines += [f"{kind} {group}\n" for group, kind in _GROUPS.items()]
    lines += [_field(one) for one in plain if one.type == "string"]
    for group, kind in _GROUPS.items():
        lines.append(_heading(kind))
        lines += [_field(one) for one in COLUMNS if one.path.startswith(f"{group}.")]
    lines += [_heading(kind) + text for kind, text in _ROS.items()]
    return "".join(lines)


def _field(column: Column) -> str:
    doc = column.doc.rstrip(".") + (f", {column.unit}." if column.unit else ".")
    return f"# {doc}\n{column.type} {column.path.rpartition('.')[2]}\n"


def _heading(kind: str) -> str:
    return f"{'=' * 80}\nMSG: {kind}\n"


class Layout:
    """How the messages of a schema are laid out: a fixed part, and strings after it.

    Attributes:
        fixed: of the part before the strings.
        strings: their names, in their order.
    """

    def __init__(self, definition: str) -> None:
        """Read a definition as :func:`schema` of this version or another writes it.

        Raises:
            ValueError: it has a type that no version knows.
        """
        main, *others = re.split(r"^=+\nMSG: (.*)\n", definition, flags=re.MULTILINE)
        bodies = dict(zip(others[::2], others[1::2], strict=True))
        fields = list(_fields(main, bodies, ""))
        self.strings = [name for name, kind in fields if kind == "string"]
        names, formats, offsets, end = [], [], [], 0
        for name, kind in fields:
            if kind != "string":
                one = np.dtype(_NUMPY[kind])
                end += -end % one.base.itemsize
                names.append(name)
                formats.append(one)
                offsets.append(end)
                end += one.itemsize
        end += -end % _LENGTH.size
        self.fixed = np.dtype(
            {"names": names, "formats": formats, "offsets": offsets, "itemsize": end}
        )

    def cycles(self, messages: Sequence[bytes]) -> Table:
        """Return the cycles of messages.

        A quantity that they lack is zero, NaN for axis angles and the planned orientation.

        Raises:
            ValueError: they are of another layout.
        """
        end = len(_CDR) + self.fixed.itemsize
        fixed = np.frombuffer(b"".join([one[len(_CDR) : end] for one in messages]), self.fixed)
        table = without_numbers(len(messages))
        for column in COLUMNS:
            if column.name and column.path in (self.fixed.names or ()):
                content = fixed[column.path]
                is_q = column.type == QUATERNION
                table[column.name] = content[:, [3, 0, 1, 2]] if is_q else content
        table["feedback_time_ns"] = table["deadline_ns"] - table["feedback_time_ns"]
        for name in FLAGS.keys() & (self.fixed.names or ()):
            table["flags"] |= np.where(fixed[name], np.uint32(FLAGS[name][0]), np.uint32(0))
        table["feedback_time_ns"][(table["flags"] & CycleFlag.FEEDBACK) == 0] = 0
        tails = {one[end:] for one in messages}
        strings = {tail: self._strings(tail) for tail in tails}
        for name in self.strings:
            table[name] = numbers(name, [strings[one[end:]][name] for one in messages])
        return table

    def _strings(self, tail: bytes) -> dict[str, str]:
        found, at = {}, 0
        for name in self.strings:
            at += -at % _LENGTH.size
            (length,) = _LENGTH.unpack_from(tail, at)
            found[name] = tail[at + 4 : at + 3 + length].decode()
            at += 4 + length
        return found


def _fields(body: str, bodies: Mapping[str, str], prefix: str) -> Iterator[tuple[str, str]]:
    for line in body.splitlines():
        words = line.partition("#")[0].split()
        if len(words) != 2:
            continue
        kind, name = words
        if kind in _NUMPY:
            yield prefix + name, kind
        elif kind in bodies:
            yield from _fields(bodies[kind], bodies, f"{prefix}{name}.")
        else:
            raise ValueError(f"the unknown type {kind!r} of {prefix}{name}")


@cache
def _own() -> Layout:
    return Layout(schema())


def to_messages(cycles: Table) -> list[bytes]:
    """Return a message for each of *cycles*, by :func:`schema`."""
    layout = _own()
    fixed = np.zeros(len(cycles), layout.fixed)
    has_feedback = (cycles["flags"] & CycleFlag.FEEDBACK) != 0
    for column in COLUMNS:
        if column.type == "string" or not column.path:
            continue
        if column.name == "feedback_time_ns":
            content = cycles["deadline_ns"] - cycles["feedback_time_ns"]
        elif column.name:
            content = cycles[column.name]
        else:
            content = rotation.angle(cycles["sent_q"], cycles["measured_q"])
        if column.step:
            content = np.rint(content / column.step) * column.step
        if column.path.startswith("measured."):
            nothing = np.nan if column.step else 0
            shape = (-1, *(1,) * (content.ndim - 1))
            content = np.where(has_feedback.reshape(shape), content, nothing)
        is_q = column.type == QUATERNION
        fixed[column.path] = content[:, [1, 2, 3, 0]] if is_q else content
    for name, (flag, _) in FLAGS.items():
        fixed[name] = (cycles["flags"] & flag) != 0
    packed, size = fixed.tobytes(), fixed.itemsize
    told = zip(*(named(name, cycles[name]) for name in layout.strings), strict=True)
    return [
        _CDR + packed[size * k : size * (k + 1)] + _tail(strings) for k, strings in enumerate(told)
    ]


@cache
def _tail(strings: tuple[str, ...]) -> bytes:
    tail = b""
    for text in strings:
        content = text.encode() + b"\0"
        tail += bytes(-len(tail) % _LENGTH.size) + _LENGTH.pack(len(content)) + content
    return tail
