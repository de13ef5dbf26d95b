"""Plan a file of requests into a folder: in parts, with one table of them at the end.

The folder holds ``parts``, a table for each finished part, until they are merged into
``plans.parquet``. ``batch.json`` describes their input.  An interrupted run, even a killed one,
resumes after the last part, and ends with the same files as any other.
"""

from __future__ import annotations

import functools
import itertools
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from orientd.config import DeviceSettings
from orientd.errors import OrientdError
from orientd.files import MEBIBYTE, read_bounded, written
from orientd.planner import in_parallel, need_backend
from orientd_batch.request_file import Requests
from orientd_batch.rows import COLUMNS, RECORD, Part, Planned, plan_part

PART = 200
"""Requests of a part."""

FORMAT = 1


class Batch:
    """The requests of one file and their plans in one folder.

    Attributes:
        table: the file with a row for each request, once all are done.
        count: number of requests.
        done: number of planned or refused requests, including earlier runs.
        begun_with: number of requests that earlier runs had done.
    """

    def __init__(
        self,
        requests: Requests,
        folder: Path,
        device: DeviceSettings,
        *,
        has_records: bool = False,
        backend: str = "loky",
        jobs: int = -1,
        address: str | None = None,
    ) -> None:
        """Check the present content of the folder.

        Args:
            requests: the file.
            folder: for the plans; created if it does not exist.
            device: rate, limits and driver.
            has_records: whether the records are written too.
            backend: ``loky``, ``ray`` or ``dask``.
            jobs: parallel parts; -1 for one on each core.
            address: of a cluster.

        Raises:
            OrientdError: the folder holds another batch or something else, or cannot be written; or
                the backend is not installed.
        """
        need_backend(backend)
        self._requests, self._folder, self._has_records = requests, folder, has_records
        self._work = functools.partial(plan_part, device=device, has_records=has_records)
        self._cluster: dict[str, Any] = {"backend": backend, "jobs": jobs, "address": address}
        self.table, self._parts = folder / "plans.parquet", folder / "parts"
        self.count = requests.count
        asked = {
            "format": FORMAT,
            "requests": requests.digest,
            "device": json.loads(device.model_dump_json()),
            "records": has_records,
            "part": PART,
        }
        label = folder / "batch.json"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if not label.exists():
                with written(label) as path:
                    path.write_text(json.dumps(asked, indent=1))
            found = json.loads(read_bounded(label, MEBIBYTE))
        except (OSError, ValueError, RecursionError) as error:
            raise OrientdError(f"cannot use {folder}: {error}") from error
        known = found if isinstance(found, dict) else {}
        differing = [name for name in asked if known.get(name) != asked[name]]
        if differing:
            raise OrientdError(
                f"{folder} holds a batch with other {' and '.join(differing)}; expected a new "
                "folder, or the same request file, device and options as before"
            )
        self._numbers = range(-(-self.count // PART))
        self._waiting = [number for number in self._numbers if not self._part(number).exists()]
        if self.table.exists():
            self._waiting = []
        done = PART * (len(self._numbers) - len(self._waiting))
        self.done = self.begun_with = min(self.count, done)

    def run(self) -> Iterator[None]:
        """Plan all remaining requests; yield whenever :attr:`done` has changed.

        Raises:
            OrientdError: a file cannot be read or written, or the backend is not available.
        """
        yield
        if self.table.exists():
            return
        self._parts.mkdir(exist_ok=True)
        for planned in in_parallel(self._work, self._tasks(), **self._cluster):
            self._write(planned)
            self.done += len(planned.rows)
            yield
        from pyarrow import parquet

        with written(self.table) as path, parquet.ParquetWriter(path, _schema()) as writer:
            for number in self._numbers:
                writer.write_table(parquet.read_table(self._part(number)))
        shutil.rmtree(self._parts)

    def _tasks(self) -> Iterator[Part]:
        each = self._requests.each()
        for number in self._numbers:
            requests = list(itertools.islice(each, PART))
            if number in self._waiting:
                yield Part(number, number * PART, requests)

    def _part(self, number: int) -> Path:
        return self._parts / f"{number:06d}.parquet"

    def _write(self, planned: Planned) -> None:
        import pyarrow as arrow
        from pyarrow import parquet

        if self._has_records:
            records = self._folder / "records" / f"{planned.number:06d}.parquet"
            records.parent.mkdir(exist_ok=True)
            with written(records) as path:
                parquet.write_table(arrow.table(_records(planned)), path)
        # Last: the part is done once it is there.
        with written(self._part(planned.number)) as path:
            parquet.write_table(arrow.Table.from_pylist(planned.rows, schema=_schema()), path)


def _schema() -> Any:  # noqa: ANN401 - a schema of Arrow
    import pyarrow as arrow

    return arrow.schema([(name, getattr(arrow, kind)()) for name, kind in COLUMNS.items()])


def _records(planned: Planned) -> dict[str, Any]:
    """Return the columns of a table of records."""
    counts = [len(records) for _, records in planned.records]
    records = np.concatenate(
        [np.zeros((0, len(RECORD))), *(records for _, records in planned.records)]
    )
    return {
        "row": np.repeat(np.array([row for row, _ in planned.records], np.int64), counts),
        "record": np.concatenate([np.zeros(0, int), *map(np.arange, counts)]),
        **{name: records[:, k] for k, name in enumerate(RECORD)},
    }
