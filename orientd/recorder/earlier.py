"""Read cycles of version 0.2 and before: blocks of columns, differenced from row to row."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from orientd.recorder.columns import CYCLES, Table, numbers, without_numbers
from orientd.stream.records import CycleFlag

SCHEMA_NAME = "orientd.v1.CycleBlock"

_STATES = ("idle", "holding", "streaming", "stopping", "fault", "tracking")
"""States by their numbers in such a file."""

_MOST_DIFFERENCES = 3


def cycles_of(block: Any, size: int) -> Table:  # noqa: ANN401 - decoded by the schema in the file
    """Return the cycles of a block; axis angles that the file does not have are NaN.

    Args:
        block: as a message of ``orientd.v1.CycleBlock``.
        size: of the message, bytes.

    Raises:
        ValueError: no version has written it.
    """
    count = block.count
    # Each cycle takes a byte of each column, or more.
    if count > size:
        raise ValueError("more cycles than it has bytes for")
    table = without_numbers(count)
    for name in CYCLES.names or ():
        content = _content(getattr(block, name, None), count)
        target = table[name] if table[name].ndim > 1 else table[name][:, None]
        target[:, : content.shape[1]] = content
    table["state"] = numbers("state", [_STATES[number] for number in table["state"].tolist()])
    due, age = table["deadline_ns"], _content(block.feedback_age_ns, count)[:, 0]
    table["feedback_time_ns"] = np.where(table["flags"] & CycleFlag.FEEDBACK, due - age, 0)
    return table


def _content(column: Any, count: int) -> NDArray[Any]:  # noqa: ANN401 - as above
    if column is None:
        return np.zeros((count, 0))
    if column.raw:
        return np.array(column.raw).reshape(column.width, count).T
    if column.order > _MOST_DIFFERENCES:
        raise ValueError(f"differences of order {column.order}")
    steps = np.array(column.steps, dtype=np.int64).reshape(column.width, count).T
    for _ in range(column.order):
        steps = np.cumsum(steps, axis=0)
    return steps * column.quantum if column.quantum else steps
