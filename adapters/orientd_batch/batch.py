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
from collections.abc import Iterator, Sequence
from dataclasses import fields
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as arrow
from pyarrow import parquet

from orientd import motion_file
from orientd.config import DeviceSettings
from orientd.errors import OrientdError
from orientd.files import check_regular, written
from orientd.planner.certify.certificate import Certificate
from orientd.planner.offline import in_parallel
from orientd.structured_text import read_structured, write_structured

PART = 200
"""Requests of a part."""

_FIGURES = {one.name: one.name for one in fields(Certificate) if one.type == "float"}
del _FIGURES["rate_hz"]  # that of the device
for _peak in (one.name for one in fields(Certificate) if one.type == "Peak"):
    _FIGURES |= {_peak: f"{_peak}.value", _peak.replace("peak", "limit"): f"{_peak}.limit"}
"""Attributes of a certificate by the names of their columns."""

_VECTORS = ("omega_body", "alpha_body", "position")
RECORD = ("qw", "qx", "qy", "qz", *(f"{name}_{axis}" for name in _VECTORS for axis in "xyz"))
"""Columns of the records, in addition to ``row`` and ``record``: setpoints in rad, m and s."""

_ROWS = arrow.schema(
    {
        "row": arrow.int64(),
        **dict.fromkeys(("name", "outcome", "refusal", "notes"), arrow.string()),
        "records": arrow.int64(),
        **dict.fromkeys(_FIGURES, arrow.float64()),
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
        cluster: ``backend``, ``jobs`` and ``address`` of
            :func:`~orientd.planner.offline.in_parallel`.

    Yields:
        At first and after each part: the number of planned or refused requests, including earlier
        runs, and the number of requests.

    Raises:
        OrientdError: the folder holds another batch, or a file cannot be read or written.
    """
    if requests.suffix != ".jsonl":
        raise OrientdError(
            f"expected a file that ends in .jsonl, got {requests.name}; the guide on batches shows "
            "how to make one of a table"
        )
    try:
        check_regular(requests)
        content = requests.read_bytes()
    except OSError as error:
        raise OrientdError(f"cannot read {requests}: {error.strerror}") from error
    lines = [line for line in content.splitlines() if line.strip()]
    asked = {
        "format": 1,
        "requests": hashlib.sha256(content).hexdigest(),
        "device": device.model_dump(mode="json"),
        "records": has_records,
    }
    label, table = folder / "batch.json", folder / "plans.parquet"
    if folder.exists() and not folder.is_dir():
        raise OrientdError(f"expected a folder for the plans, {folder} is a file")
    folder.mkdir(parents=True, exist_ok=True)
    if not label.exists():
        write_structured(label, asked)
    found = read_structured(label)
    known = found if isinstance(found, dict) else {}
    differing = [name for name in asked if known.get(name) != asked[name]]
    if differing:
        raise OrientdError(
            f"{folder} holds a batch with other {' and '.join(differing)}; expected a new "
            "folder, or the same request file, device and options as before"
        )
    if table.exists():
        yield len(lines), len(lines)
        return
    firsts = range(0, len(lines), PART)
    parts = [folder / "parts" / f"{first // PART:06d}.parquet" for first in firsts]
    done = min(len(lines), PART * len(list(itertools.takewhile(Path.exists, parts))))
    yield done, len(lines)
    work = functools.partial(plan_part, device=device, has_records=has_records)
    tasks = ((first, lines[first : first + PART]) for first in firsts if first >= done)
    for rows, records in in_parallel(work, tasks, **cluster):
        part = parts[done // PART]
        if has_records:
            _write(records, folder / "records" / part.name)
        _write(rows, part)  # last: the part is done once it is there
        done += rows.num_rows
        yield done, len(lines)
    _write(arrow.concat_tables([_ROWS.empty_table(), *map(parquet.read_table, parts)]), table)
    shutil.rmtree(folder / "parts", ignore_errors=True)


def _write(table: Any, path: Path) -> None:  # noqa: ANN401 - of Arrow
    path.parent.mkdir(exist_ok=True)
    with written(path) as part:
        parquet.write_table(table, part)


def plan_part(
    part: tuple[int, Sequence[bytes]], *, device: DeviceSettings, has_records: bool
) -> tuple[Any, Any]:
    """Plan some requests for a device.

    Args:
        part: row of the first request, and the requests, each a line of JSON.
        device: rate, limits and driver.
        has_records: whether to return records too.

    Returns:
        The table with a row for each request: its certificate, or the reason of its refusal; the
        table of the records.
    """
    planner, rows, records = device.planner(), [], [_RECORDS.empty_table()]
    for row, line in enumerate(part[1], part[0]):
        entries: dict[str, Any] = {"row": row, "name": "", "outcome": "refused"}
        rows.append(entries)
        try:
            mapping = json.loads(line)
        except (ValueError, RecursionError) as error:
            entries["refusal"] = f"not JSON: {error}"
            continue
        name = mapping.get("name") if isinstance(mapping, dict) else None
        entries["name"] = name if isinstance(name, str) else ""
        try:
            motion = planner.plan_offline(motion_file.parse(mapping))
        except OrientdError as error:
            entries["refusal"] = str(error)
            continue
        entries |= {"outcome": "planned", "records": motion.record_count}
        entries |= {name: attrgetter(path)(motion.certificate) for name, path in _FIGURES.items()}
        entries["notes"] = "; ".join(motion.certificate.notes)
        if has_records:
            setpoints = motion.rows(0, motion.record_count).T[: len(RECORD)]
            number = np.arange(motion.record_count)
            table = [np.full_like(number, row), number, *setpoints]
            records.append(arrow.table(table, schema=_RECORDS))
    return arrow.Table.from_pylist(rows, schema=_ROWS), arrow.concat_tables(records)
