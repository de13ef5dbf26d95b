"""Files of many requests: a motion per line as JSON, or a keyframe per row in a table.

In a table (``.csv``, ``.parquet``) consecutive rows with the same ``motion`` form one motion.  The
columns of a keyframe are ``qw, qx, qy, qz``, ``time``, ``x, y, z`` and ``turns``.  Those of a
motion are the text keys of a motion file, and its end velocities as ``start_velocity_x`` and so on.
The first row of the motion counts.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orientd.errors import OrientdError
from orientd.files import check_regular
from orientd.one_line import one_line
from orientd.structured_text import MOST_BYTES

_Q = ("qw", "qx", "qy", "qz")
_POSITION = ("x", "y", "z")
_VELOCITIES = {
    name: tuple(f"{name}_{axis}" for axis in "xyz") for name in ("start_velocity", "end_velocity")
}
_TEXTS = ("method", "velocity_frame", "name", "pointing_axis", "frame")
_FLOATS = ("time", *_Q, *_POSITION, *itertools.chain(*_VELOCITIES.values()))
_ROWS = 10_000

Row = Mapping[str, Any]
Request = str | Mapping[str, Any]
"""A line of JSON, or a mapping as of a motion file."""


@dataclass(frozen=True, slots=True)
class Requests:
    """A file of requests.

    Attributes:
        count: number of requests.
        digest: of the file's content, SHA-256.
        each: yields them from the first on.
    """

    count: int
    digest: str
    each: Callable[[], Iterator[Request]]


def open_requests(path: Path) -> Requests:
    """Return the requests in a file.

    Raises:
        OrientdError: the file cannot be read, is of another kind, or lacks a column.
    """
    try:
        check_regular(path)
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise OrientdError(f"cannot read {path}: {error.strerror}") from error
    if path.suffix not in (".jsonl", ".csv", ".parquet"):
        raise OrientdError(
            f"expected a file that ends in .jsonl, .csv or .parquet, got {path.name}"
        )
    read = _lines if path.suffix == ".jsonl" else _motions
    return Requests(sum(1 for _ in read(path)), digest, lambda: read(path))


def _lines(path: Path) -> Iterator[str]:
    try:
        with path.open(encoding="utf-8") as file:
            while line := file.readline(MOST_BYTES + 1):
                if len(line) > MOST_BYTES:
                    raise OrientdError(f"{path}: a line of more than {MOST_BYTES} characters")
                if not line.isspace():
                    yield line
    except (OSError, UnicodeDecodeError) as error:
        raise OrientdError(f"cannot read {path}: {one_line(str(error), 300)}") from error


def _motions(path: Path) -> Iterator[Mapping[str, Any]]:
    """Yield what a motion file would say of each motion of a table."""
    rows = itertools.chain.from_iterable(_batches(path))
    for _, group in itertools.groupby(rows, key=lambda row: row["motion"]):
        keyframes = list(group)
        first = keyframes[0]
        motion: dict[str, Any] = {"keyframes": [_keyframe(row) for row in keyframes]}
        motion |= {name: first[name] for name in _TEXTS if first.get(name) is not None}
        for name, columns in _VELOCITIES.items():
            if first.get(columns[0]) is not None:
                motion[name] = [first.get(column) for column in columns]
        yield motion


def _keyframe(row: Row) -> dict[str, Any]:
    keyframe: dict[str, Any] = {
        "quaternion": {name[1]: row[name] for name in _Q},
        "time": row.get("time"),
        "turns": row.get("turns") or 0,
    }
    if row.get("x") is not None:
        keyframe["position"] = [row.get(name) for name in _POSITION]
    return keyframe


def _batches(path: Path) -> Iterator[Sequence[Row]]:
    try:
        import pyarrow as arrow
        from pyarrow import csv, parquet
    except ImportError as error:
        raise OrientdError(
            "tables need the extra `batch`: pip install 'orientd-motion[batch]'"
        ) from error
    floats = dict.fromkeys(_FLOATS, arrow.float64())
    types = {**floats, **dict.fromkeys(("motion", *_TEXTS), arrow.string()), "turns": arrow.int64()}
    try:
        if path.suffix == ".csv":
            reader = csv.open_csv(path, convert_options=csv.ConvertOptions(column_types=types))
            names, batches = reader.schema.names, iter(reader)
        else:
            file = parquet.ParquetFile(path)
            names, batches = file.schema_arrow.names, file.iter_batches(_ROWS)
        _check_columns(path, names, tuple(types))
        for batch in batches:
            yield batch.to_pylist()
    except (OSError, ValueError, arrow.ArrowException) as error:
        raise OrientdError(f"cannot read {path}: {one_line(str(error), 300)}") from error


def _check_columns(path: Path, names: Sequence[str], known: Sequence[str]) -> None:
    missing = [name for name in ("motion", *_Q) if name not in names]
    unknown = [name for name in names if name not in known]
    if missing:
        came = one_line(", ".join(names), 300)
        raise OrientdError(f"{path}: expected a column {missing[0]!r}, got {came}")
    if unknown:
        came = one_line(unknown[0], 100)
        raise OrientdError(f"{path}: unknown column {came!r}; known: {', '.join(known)}")
