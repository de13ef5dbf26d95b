"""Plan a file of requests into a folder: in parts, with one table of them at the end.

The folder holds ``parts``, a table for each finished part, until they are merged into
``plans.parquet``. ``batch.json`` describes their input.  An interrupted run, even a killed one,
resumes after the last part, and ends with the same files as any other.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as arrow
from pyarrow import parquet

from orientd import motion_file
from orientd.config import DeviceSettings
from orientd.errors import OrientdError, RequestError
from orientd.files import MEBIBYTE, check_regular, read_bounded, written
from orientd.one_line import one_line
from orientd.planner import Motion, in_parallel

PART = 200
"""Requests of a part."""

_PEAKS = ("velocity", "acceleration", "jerk", "linear_velocity", "linear_acceleration")
_FIGURES = (
    "duration",
    "lead_in",
    "lead_out",
    "start_velocity_error",
    "end_velocity_error",
    "keyframe_error",
    "brake_rate",
    "stop_time",
    "usual_stop_time",
)
_VECTORS = ("omega_body", "alpha_body", "position")
RECORD = ("qw", "qx", "qy", "qz", *(f"{name}_{axis}" for name in _VECTORS for axis in "xyz"))
"""Columns of the records, in addition to ``row`` and ``record``: setpoints in rad, m and s."""

_PEAK_COLUMNS = [f"{kind}_{name}" for name in _PEAKS for kind in ("peak", "limit")]
_ROWS = arrow.schema(
    {
        "row": arrow.int64(),
        **dict.fromkeys(("name", "outcome", "refusal", "notes"), arrow.string()),
        "records": arrow.int64(),
        **dict.fromkeys((*_FIGURES, *_PEAK_COLUMNS), arrow.float64()),
    }
)
_RECORDS = arrow.schema(
    dict.fromkeys(("row", "record"), arrow.int64()) | dict.fromkeys(RECORD, arrow.float64())
)


def plan_file(
    requests: Path,
    folder: Path,
    device: DeviceSettings,
    *,
    has_records: bool,
    **cluster: Any,  # noqa: ANN401 - the arguments of another function
) -> Iterator[tuple[int, int]]:
    """Plan all requests of a file that are not planned yet.

    Args:
        requests: a .jsonl file: each line is a motion file in JSON.
        folder: for ``plans.parquet``; created if it does not exist.
        device: rate, limits and driver.
        has_records: whether the records are written too.
        cluster: ``backend``, ``jobs`` and ``address`` of :func:`~orientd.planner.in_parallel`.

    Yields:
        At first and after each part: the number of planned or refused requests, including earlier
        runs, and the number of requests.

    Raises:
        OrientdError: the folder holds another batch, or a file cannot be read or written.
    """
    count = sum(1 for _ in _lines(requests))
    _check_folder(
        folder,
        {
            "format": 1,
            "requests": hashlib.sha256(requests.read_bytes()).hexdigest(),
            "device": json.loads(device.model_dump_json()),
            "records": has_records,
            "part": PART,
        },
    )
    table, firsts = folder / "plans.parquet", range(0, count, PART)
    parts = {first: folder / "parts" / f"{first // PART:06d}.parquet" for first in firsts}
    waiting = [one for one in firsts if not (table.exists() or parts[one].exists())]
    done = min(count, PART * (len(firsts) - len(waiting)))
    yield done, count
    if table.exists():
        return
    work = functools.partial(plan_part, device=device, has_records=has_records)
    lines = _lines(requests)
    tasks = ((first, list(itertools.islice(lines, PART))) for first in firsts)
    for first, rows, records in in_parallel(
        work, (one for one in tasks if one[0] in waiting), **cluster
    ):
        if has_records:
            _write(records, folder / "records" / parts[first].name)
        _write(rows, parts[first])  # last: the part is done once it is there
        done += rows.num_rows
        yield done, count
    with written(table) as path, parquet.ParquetWriter(path, _ROWS) as writer:
        for part in parts.values():
            writer.write_table(parquet.read_table(part))
    shutil.rmtree(folder / "parts")


def _lines(path: Path) -> Iterator[str]:
    """Yield the lines of a file that are not empty.

    Raises:
        OrientdError: it cannot be read, or is of another kind.
    """
    if path.suffix != ".jsonl":
        raise OrientdError(
            f"expected a file that ends in .jsonl, got {path.name}; the guide on batches shows how "
            "to make one of a table"
        )
    try:
        check_regular(path)
        with path.open(encoding="utf-8") as file:
            yield from filter(str.strip, file)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or one_line(str(error), 300)
        raise OrientdError(f"cannot read {path}: {reason}") from error


def _check_folder(folder: Path, asked: Mapping[str, object]) -> None:
    """Describe a batch in its folder, or check that this is done already.

    Raises:
        OrientdError: the folder holds another batch or something else, or cannot be written.
    """
    label = folder / "batch.json"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not label.exists():
            with written(label) as path:
                path.write_text(json.dumps(asked, indent=1))
        found = json.loads(read_bounded(label, MEBIBYTE))
        differing = [name for name in asked if found.get(name) != asked[name]]
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise OrientdError(f"cannot use {folder}: {error}") from error
    if differing:
        raise OrientdError(
            f"{folder} holds a batch with other {' and '.join(differing)}; expected a new "
            "folder, or the same request file, device and options as before"
        )


def _write(table: Any, path: Path) -> None:  # noqa: ANN401 - of Arrow
    path.parent.mkdir(exist_ok=True)
    with written(path) as part:
        parquet.write_table(table, part)


def plan_part(
    part: tuple[int, Sequence[str]], *, device: DeviceSettings, has_records: bool
) -> tuple[int, Any, Any]:
    """Plan some requests for a device.

    Args:
        part: row of the first request, and the requests, each a line of JSON.
        device: rate, limits and driver.
        has_records: whether to return records too.

    Returns:
        Row of the first request; the table with a row for each request: its certificate, or the
        reason of its refusal; the table of the records.
    """
    planner, rows, records = device.planner(), [], [_RECORDS.empty_table()]
    for row, line in enumerate(part[1], part[0]):
        entries: dict[str, Any] = {"row": row, "name": ""}
        try:
            mapping = _parsed(line)
            name = mapping.get("name") if isinstance(mapping, dict) else None
            entries["name"] = name if isinstance(name, str) else ""
            motion = planner.plan_offline(motion_file.parse(mapping))
        except OrientdError as error:
            entries |= {"outcome": "refused", "refusal": str(error)}
        else:
            entries |= _certified(motion)
            if has_records:
                setpoints = motion.rows(0, motion.record_count).T[: len(RECORD)]
                number = np.arange(motion.record_count)
                table = [np.full_like(number, row), number, *setpoints]
                records.append(arrow.table(table, schema=_RECORDS))
        rows.append(entries)
    return part[0], arrow.Table.from_pylist(rows, schema=_ROWS), arrow.concat_tables(records)


def _parsed(line: str) -> Any:  # noqa: ANN401 - whatever JSON holds
    try:
        return json.loads(line)
    except (ValueError, RecursionError) as error:
        raise RequestError("", f"not JSON: {error}") from None


def _certified(motion: Motion) -> dict[str, Any]:
    certificate = motion.certificate
    row: dict[str, Any] = {"outcome": "planned", "records": motion.record_count}
    row |= {name: getattr(certificate, name) for name in _FIGURES}
    for name in _PEAKS:
        peak = getattr(certificate, f"peak_{name}")
        row |= {f"peak_{name}": peak.value, f"limit_{name}": peak.limit}
    row["notes"] = "; ".join(certificate.notes)
    # A figure that is not a number is missing in the table.
    return {name: entry for name, entry in row.items() if entry == entry}
