"""Cycles as a table: one row for each, out of the servo's records, into a recording and back.

A block holds every quantity as whole multiples of a quantum far below what any device resolves,
differenced from row to row as often as makes the numbers smallest: a smooth motion takes one or two
bytes a number, before compression.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orientd.recorder import recording_pb2 as pb
from orientd.stream import JOINTS, CycleFlag

CYCLES = np.dtype(
    [
        ("index", "i8"),
        ("deadline_ns", "i8"),
        ("lateness_ns", "i8"),
        ("work_ns", "i8"),
        ("feedback_time_ns", "i8"),
        ("path_index", "i8"),
        ("state", "u4"),
        ("fault", "u4"),
        ("motion", "u4"),
        ("flags", "u4"),
        ("overruns", "u4"),
        ("missed", "u4"),
        ("path_fraction", "f8"),
        ("speed", "f8"),
        ("sent_q", "f8", (4,)),
        ("sent_omega_body", "f8", (3,)),
        ("sent_alpha_body", "f8", (3,)),
        ("sent_position", "f8", (3,)),
        ("measured_q", "f8", (4,)),
        ("measured_omega_body", "f8", (3,)),
        ("measured_position", "f8", (3,)),
        ("measured_joints", "f8", (JOINTS,)),
        ("sent_joints", "f8", (JOINTS,)),
    ]
)
"""The servo's cycle record, byte for byte."""

Table = NDArray[np.void]

QUANTA = {
    "path_fraction": 1e-9,
    "speed": 1e-9,
    "sent_q": 1e-10,
    "sent_omega_body": 1e-8,
    "sent_alpha_body": 1e-6,
    "sent_position": 1e-9,
    "measured_q": 1e-8,
    "measured_omega_body": 1e-6,
    "measured_position": 1e-7,
    "measured_joints": 1e-8,
    "sent_joints": 1e-8,
}
"""Of what is no whole number: in rad, m and s."""

MOST_DIFFERENCES = 3
_LARGEST = 2.0**60


def from_records(records: bytes | Sequence[bytes]) -> Table:
    """Return the table of packed records.

    Raises:
        ValueError: the bytes are no whole number of records.
    """
    packed = records if isinstance(records, bytes) else b"".join(records)
    return np.frombuffer(packed, dtype=CYCLES)


def to_block(table: Table) -> pb.CycleBlock:
    """Return *table* as a message; numbers are rounded to the quantum of their quantity."""
    block = pb.CycleBlock(count=len(table))
    for name in table.dtype.names or ():
        if name == "feedback_time_ns":
            age = table["deadline_ns"] - table["feedback_time_ns"]
            _fill(block.feedback_age_ns, np.where(table["flags"] & CycleFlag.FEEDBACK, age, -1))
        else:
            _fill(getattr(block, name), table[name], QUANTA.get(name, 0.0))
    return block


def from_block(block: pb.CycleBlock) -> Table:
    """Return the table that *block* was made of.

    Raises:
        ValueError: it is not one that :func:`to_block` makes.
    """
    table = np.zeros(block.count, dtype=CYCLES)
    for name in CYCLES.names or ():
        if name == "feedback_time_ns":
            age = _content(block.feedback_age_ns, block.count)[:, 0]
            flags = _content(block.flags, block.count)[:, 0].astype(np.int64)
            due = _content(block.deadline_ns, block.count)[:, 0]
            table[name] = np.where(flags & CycleFlag.FEEDBACK, due - age, 0)
            continue
        content = _content(getattr(block, name), block.count)
        if name in ("measured_joints", "sent_joints"):
            table[name] = np.nan
            table[name][:, : content.shape[1]] = content
        else:
            table[name] = content.reshape(table[name].shape)
    return table


def _fill(column: pb.Column, content: NDArray[Any], quantum: float = 0.0) -> None:
    rows = content.reshape(len(content), int(np.prod(content.shape[1:])))
    if quantum:
        # A device with fewer axes than there is room for.
        used = np.flatnonzero(np.any(np.isfinite(rows), axis=0))
        rows = rows[:, : int(used[-1]) + 1] if len(used) else rows[:, :0]
    column.width = rows.shape[1]
    if not rows.size:
        return
    if quantum:
        column.quantum = quantum
        scaled = rows / quantum
        if not np.all(np.abs(scaled) < _LARGEST):
            column.raw.extend(rows.T.ravel().tolist())
            return
        whole = np.rint(scaled).astype(np.int64)
    else:
        whole = rows.astype(np.int64)
    best, order = whole, 0
    steps = whole
    for times in range(1, MOST_DIFFERENCES + 1):
        steps = np.diff(steps, axis=0, prepend=0)
        if _cost(steps) < _cost(best):
            best, order = steps, times
    column.order = order
    column.steps.extend(best.T.ravel().tolist())


def _cost(steps: NDArray[np.int64]) -> float:
    """Return about how many bits the numbers take."""
    return float(np.sum(np.log2(1.0 + np.abs(steps.astype(np.float64)))))


def _content(column: pb.Column, count: int) -> NDArray[Any]:
    if column.raw:
        return np.array(column.raw).reshape(column.width, count).T
    if column.order > MOST_DIFFERENCES:
        raise ValueError(f"differences of order {column.order}")
    steps = np.array(column.steps, dtype=np.int64).reshape(column.width, count).T
    for _ in range(column.order):
        steps = np.cumsum(steps, axis=0)
    return steps * column.quantum if column.quantum else steps
