"""Files of many requests: a motion a line as JSON, or a keyframe a row in a table.

In a table (``.csv``, ``.parquet``) rows with the same ``motion``, one below the other, are one
motion.  The columns of a keyframe are ``qw, qx, qy, qz``, ``time``, ``x, y, z`` and ``turns``;
those of a motion, of which the first row counts, are the keys of a motion file that hold a text or
a number, and its end velocities as ``start_velocity_x`` and so on.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orientd.bounded_file import check_regular
from orientd.errors import OrientdError, RequestError
from orientd.one_line import one_line
from orientd.schema import MOTION, FieldKind
from orientd.structured_text import MOST_BYTES

_Q = ("qw", "qx", "qy", "qz")
_POSITION = ("x", "y", "z")
_VELOCITIES = {
    name: tuple(f"{name}_{axis}" for axis in "xyz") for name in ("start_velocity", "end_velocity")
}
_KINDS = {FieldKind.TEXT, FieldKind.CHOICE}
_TEXTS = tuple(field.name for field in MOTION if field.kind in _KINDS)
_FLOATS = ("time", *_Q, *_POSITION, *_VELOCITIES["start_velocity"], *_VELOCITIES["end_velocity"])
_ROWS = 10_000

Row = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Requests:
    """A file of requests.

    Attributes:
        path: of the file.
        count: how many there are.
        digest: of the file's content, SHA-256.
        each: yields them from the first on: a line of JSON, or a mapping as of a motion file.
    """

    path: Path
    count: int
    digest: str
    each: Callable[[], Iterator[str | Mapping[str, Any]]]


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
    if path.suffix == ".jsonl":
        return Requests(path, sum(1 for _ in _lines(path)), digest, lambda: _lines(path))
    if path.suffix not in (".csv", ".parquet"):
        raise OrientdError(
            f"expected a file that ends in .jsonl, .csv or .parquet, got {path.name}"
        )
    groups = _groups(path)
    return Requests(
        path, sum(1 for _ in groups), digest, lambda: map(motion_of_rows, _groups(path))
    )


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


def mapping_of(line: str) -> Any:  # noqa: ANN401 - whatever JSON holds
    """Return what a line of JSON says.

    Raises:
        RequestError: it is none.
    """
    try:
        return json.loads(line)
    except (ValueError, RecursionError) as error:
        raise RequestError("", f"not JSON: {error}") from None


def _groups(path: Path) -> Iterator[list[Row]]:
    """Yield the rows of each motion of a table."""
    rows = itertools.chain.from_iterable(_batches(path))
    for _, group in itertools.groupby(rows, key=lambda row: row["motion"]):
        yield list(group)


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
    strange = [name for name in names if name not in known]
    if missing:
        came = one_line(", ".join(names), 300)
        raise OrientdError(f"{path}: expected a column {missing[0]!r}, got {came}")
    if strange:
        came = one_line(strange[0], 100)
        raise OrientdError(f"{path}: unknown column {came!r}; known: {', '.join(known)}")


def motion_of_rows(rows: Sequence[Row]) -> dict[str, Any]:
    """Return what a motion file would say of the motion in some rows of a table."""
    first = rows[0]
    motion: dict[str, Any] = {"keyframes": [_keyframe(row) for row in rows]}
    motion |= {name: first[name] for name in _TEXTS if first.get(name) is not None}
    for name, columns in _VELOCITIES.items():
        if first.get(columns[0]) is not None:
            motion[name] = [first.get(column) for column in columns]
    return motion


def _keyframe(row: Row) -> dict[str, Any]:
    keyframe: dict[str, Any] = {
        "quaternion": {name[1]: row[name] for name in _Q},
        "time": row.get("time"),
        "turns": row.get("turns") or 0,
    }
    if row.get("x") is not None:
        keyframe["position"] = [row.get(name) for name in _POSITION]
    return keyframe
