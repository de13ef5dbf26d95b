"""Run a batch: parts in order, each written once it is done, and one table in the end.

The folder holds ``parts``, a table for each part that is done, until ``plans.parquet`` has been put
together of all of them; ``batch.json`` says of what.  A run that was ended, however, goes on after
the last part that was written, and ends in the same files as one that was not.
"""

from __future__ import annotations

import functools
import itertools
import json
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from orientd.batch.requests import Requests
from orientd.batch.rows import FLOATS, RECORD, TEXTS, Outcomes, Part, plan_part
from orientd.bounded_file import MEBIBYTE, read_bounded
from orientd.config import DeviceSettings
from orientd.errors import OrientdError
from orientd.planner import in_parallel, need_backend

PART = 200
"""Requests of a part."""

FORMAT = 1


@dataclass(frozen=True, slots=True)
class Settings:
    """What a batch is planned for, and by whom.

    Attributes:
        device: rate, limits and driver.
        has_records: whether the records are written too.
        backend: ``loky``, ``ray`` or ``dask``.
        jobs: parts at a time; -1 for one on each core.
        address: of a cluster.
    """

    device: DeviceSettings
    has_records: bool = False
    backend: str = "loky"
    jobs: int = -1
    address: str | None = None


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a batch has come.

    Attributes:
        done: requests, those of earlier runs included.
        begun_with: requests that earlier runs had done.
        count: of requests.
    """

    done: int
    begun_with: int
    count: int


class Batch:
    """The requests of one file on their way into one folder.

    Args:
        requests: the file.
        folder: where plans go; made where there is none.
        settings: what they are planned for.

    Raises:
        OrientdError: the folder holds another batch or something else, or cannot be written; or the
            backend is not there.
    """

    def __init__(self, requests: Requests, folder: Path, settings: Settings) -> None:
        need_backend(settings.backend)
        self._requests, self._folder, self._settings = requests, folder, settings
        self._device = pickle.dumps(settings.device)
        asked = {
            "format": FORMAT,
            "requests": requests.digest,
            "device": json.loads(settings.device.model_dump_json()),
            "records": settings.has_records,
            "part": PART,
        }
        label = folder / "batch.json"
        try:
            self._parts.mkdir(parents=True, exist_ok=True)
            if not label.exists():
                _write(label, lambda path: path.write_text(json.dumps(asked, indent=1)))
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

    @property
    def table(self) -> Path:
        """The file with a row for each request, once all are done."""
        return self._folder / "plans.parquet"

    def run(self) -> Iterator[Progress]:
        """Plan what is not planned yet, and say now and then how far it has come.

        Raises:
            OrientdError: a file cannot be read or written, or the backend is not there.
        """
        count = self._requests.count
        numbers = range(-(-count // PART))
        if self.table.exists():
            yield Progress(count, count, count)
            return
        waiting = [number for number in numbers if not self._part(number).exists()]
        done = begun_with = min(count, PART * (len(numbers) - len(waiting)))
        yield Progress(done, begun_with, count)
        results = in_parallel(
            plan_part,
            self._tasks(set(waiting)),
            backend=self._settings.backend,
            jobs=self._settings.jobs,
            address=self._settings.address,
        )
        for outcomes in results:
            self._write_part(outcomes)
            done += len(outcomes.rows)
            yield Progress(done, begun_with, count)
        self._put_together(numbers)

    def _tasks(self, waiting: set[int]) -> Iterator[Part]:
        each = self._requests.each()
        parts = iter(lambda: list(itertools.islice(each, PART)), [])
        for number, requests in enumerate(parts):
            if number in waiting:
                first, has_records = number * PART, self._settings.has_records
                yield Part(number, first, requests, self._device, has_records)

    @property
    def _parts(self) -> Path:
        return self._folder / "parts"

    def _part(self, number: int) -> Path:
        return self._parts / f"{number:06d}.parquet"

    def _write_part(self, outcomes: Outcomes) -> None:
        import pyarrow as arrow
        from pyarrow import parquet

        if self._settings.has_records:
            records = self._folder / "records" / f"{outcomes.number:06d}.parquet"
            records.parent.mkdir(exist_ok=True)
            _write(records, functools.partial(parquet.write_table, _records(outcomes)))
        table = arrow.Table.from_pylist(outcomes.rows, schema=_schema())
        # Last: the part is done once it is there.
        _write(self._part(outcomes.number), functools.partial(parquet.write_table, table))

    def _put_together(self, numbers: range) -> None:
        from pyarrow import parquet

        def write(path: Path) -> None:
            with parquet.ParquetWriter(path, _schema()) as writer:
                for number in numbers:
                    writer.write_table(parquet.read_table(self._part(number)))

        _write(self.table, write)
        for number in numbers:
            self._part(number).unlink()
        self._parts.rmdir()


def _schema() -> Any:  # noqa: ANN401 - a schema of Arrow
    import pyarrow as arrow

    texts = [(name, arrow.string()) for name in TEXTS]
    floats = [(name, arrow.float64()) for name in FLOATS]
    return arrow.schema([("row", arrow.int64()), *texts, ("records", arrow.int64()), *floats])


def _records(outcomes: Outcomes) -> Any:  # noqa: ANN401 - a table of Arrow
    import pyarrow as arrow

    counts = [len(rows) for _, rows in outcomes.records]
    columns: dict[str, Any] = {
        "row": np.repeat(np.array([row for row, _ in outcomes.records], np.int64), counts),
        "record": np.concatenate([np.arange(count) for count in counts] or [np.zeros(0, int)]),
    }
    rows = np.concatenate([rows for _, rows in outcomes.records] or [np.zeros((0, len(RECORD)))])
    columns |= {name: rows[:, k] for k, name in enumerate(RECORD)}
    return arrow.table(columns)


def _write(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file that is there whole or not at all.

    Raises:
        OrientdError: it cannot be written.
    """
    fresh = path.with_name(f".{path.name}.new")
    try:
        write(fresh)
        fresh.replace(path)
    except OSError as error:
        raise OrientdError(f"cannot write {path}: {error.strerror or error}") from error
