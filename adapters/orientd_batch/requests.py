"""Files of many requests: a motion per line as JSON, or a keyframe per row in a table.

In a table (``.csv``, ``.parquet``) consecutive rows with the same ``motion`` form one motion.  The
columns of a keyframe are ``qw, qx, qy, qz``, ``time``, ``x, y, z`` and ``turns``.  Those of a
motion are the text keys of a motion file, and its end velocities as ``start_velocity_x`` and so on.
The first row of the motion counts.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pyarrow as arrow
from pyarrow import csv, parquet

from orientd.errors import OrientdError
from orientd.files import check_regular
from orientd.one_line import one_line

_VELOCITIES = {
    name: tuple(f"{name}_{axis}" for axis in "xyz") for name in ("start_velocity", "end_velocity")
}
_TEXTS = ("method", "velocity_frame", "name", "pointing_axis", "frame")
_NEEDED = ("motion", "qw", "qx", "qy", "qz")
_FLOATS = ("time", *_NEEDED[1:], "x", "y", "z", *itertools.chain(*_VELOCITIES.values()))
_COLUMNS = {
    **dict.fromkeys(_FLOATS, arrow.float64()),
    **dict.fromkeys(("motion", *_TEXTS), arrow.string()),
    "turns": arrow.int64(),
}

Request = str | Mapping[str, Any]
"""A line of JSON, or a mapping as of a motion file."""


def read_requests(path: Path) -> Iterator[Request]:
    """Yield the requests in a file.

    Raises:
        OrientdError: the file cannot be read, is of another kind, or lacks a column.
    """
    try:
        check_regular(path)
        if path.suffix == ".jsonl":
            with path.open(encoding="utf-8") as file:
                yield from filter(str.strip, file)
        elif path.suffix in (".csv", ".parquet"):
            rows = itertools.chain.from_iterable(_batches(path))
            for _, group in itertools.groupby(rows, key=lambda row: row["motion"]):
                yield _motion(list(group))
        else:
            expected = ".jsonl, .csv or .parquet"
            raise OrientdError(f"expected a file that ends in {expected}, got {path.name}")
    except (OSError, ValueError, arrow.ArrowException) as error:
        reason = getattr(error, "strerror", None) or one_line(str(error), 300)
        raise OrientdError(f"cannot read {path}: {reason}") from error


def _batches(path: Path) -> Iterator[list[dict[str, Any]]]:
    """Yield the rows of a table, some at a time."""
    if path.suffix == ".csv":
        reader = csv.open_csv(path, convert_options=csv.ConvertOptions(column_types=_COLUMNS))
        names, batches = reader.schema.names, iter(reader)
    else:
        file = parquet.ParquetFile(path)
        names, batches = file.schema_arrow.names, file.iter_batches()
    for name in _NEEDED:
        if name not in names:
            came = one_line(", ".join(names), 300)
            raise OrientdError(f"{path}: expected a column {name!r}, got {came}")
    for name in names:
        if name not in _COLUMNS:
            known = ", ".join(_COLUMNS)
            raise OrientdError(f"{path}: unknown column {one_line(name, 100)!r}; known: {known}")
    for batch in batches:
        yield batch.to_pylist()


def _motion(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what a motion file would say of a motion of a table."""
    first, keyframes = rows[0], []
    for row in rows:
        q = {axis: row[f"q{axis}"] for axis in "wxyz"}
        keyframes.append({"quaternion": q, "time": row.get("time"), "turns": row.get("turns") or 0})
        if row.get("x") is not None:
            keyframes[-1]["position"] = [row.get(axis) for axis in "xyz"]
    motion: dict[str, Any] = {"keyframes": keyframes}
    motion |= {name: first[name] for name in _TEXTS if first.get(name) is not None}
    for name, columns in _VELOCITIES.items():
        if first.get(columns[0]) is not None:
            motion[name] = [first.get(column) for column in columns]
    return motion
