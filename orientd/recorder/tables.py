"""Recordings as tables: csv, npz or parquet, by the ending of the name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orientd.errors import OrientdError
from orientd.files import written
from orientd.recorder.columns import AXES, COLUMNS, QUATERNION, VECTOR, named
from orientd.recorder.planned import planned_orientations
from orientd.recorder.reader import Recording
from orientd.stream.records import CycleFlag

_COMPONENTS = {QUATERNION: "wxyz", VECTOR: ("_x", "_y", "_z"), AXES: [f"_{k}" for k in range(1, 9)]}
_UNITS = {"": "", "rad/s": "_rad_s", "rad/s^2": "_rad_s2", "m": "_m", "rad": "_rad"}

Columns = dict[str, NDArray[Any]]


def columns(recording: Recording, device: str) -> Columns:
    """Return the cycles of *device* column by column, with NaN for missing numbers.

    ``time_s`` is the deadline as a time of day, ``measured_time_s`` the time of the measurement.
    States and faults are names.
    """
    cycles = recording.cycles[device]
    has_feedback = (cycles["flags"] & CycleFlag.FEEDBACK) != 0
    path_times, planned = planned_orientations(recording, device)
    table: Columns = {
        "time_s": (cycles["deadline_ns"] + recording.offset_ns) * 1e-9,
        "deadline_ns": cycles["deadline_ns"],
        "lateness_s": cycles["lateness_ns"] * 1e-9,
        "work_s": cycles["work_ns"] * 1e-9,
        "state": np.array(named("state", cycles["state"]), dtype=np.str_),
        "fault": np.array(named("fault", cycles["fault"]), dtype=np.str_),
        "is_written": (cycles["flags"] & CycleFlag.WRITTEN) != 0,
        "speed": cycles["speed"],
        "path_time_s": path_times,
        **{name: cycles[name] for name in ("index", "motion", "overruns", "missed")},
        **{f"planned_q{axis}": planned[:, k] for k, axis in enumerate("wxyz")},
        **_components(cycles, "sent"),
    }
    stamps = np.where(has_feedback, cycles["feedback_time_ns"] + recording.offset_ns, np.nan)
    table["measured_time_s"] = stamps * 1e-9
    for name, column in _components(cycles, "measured").items():
        table[name] = np.where(has_feedback, column, np.nan)
    return table


def _components(cycles: NDArray[np.void], group: str) -> Columns:
    """Return the components sent or measured, without axes that the device does not have."""
    return {
        f"{one.name}{component}{_UNITS[one.unit]}": content
        for one in COLUMNS
        if one.name.startswith(f"{group}_")
        for component, content in zip(_COMPONENTS[one.type], cycles[one.name].T, strict=True)
        if one.type != AXES or not np.isnan(content).all()
    }


def export(recording: Recording, device: str, path: Path) -> int:
    """Write the cycles of *device* to *path*; return how many.

    Raises:
        OrientdError: the file cannot be written, or needs the extra `parquet`, which is not there.
    """
    table = columns(recording, device)
    with written(path) as file:
        if path.suffix == ".npz":
            np.savez_compressed(file, allow_pickle=False, **table)
        elif path.suffix == ".parquet":
            _write_parquet(file, table)
        else:
            _write_csv(file, table)
    return len(table["time_s"])


def _write_csv(path: Path, table: Columns) -> None:
    with path.open("w", encoding="utf-8") as stream:
        stream.write(",".join(table) + "\n")
        for row in zip(*(column.tolist() for column in table.values()), strict=True):
            stream.write(",".join("" if cell != cell else str(cell) for cell in row) + "\n")


def _write_parquet(path: Path, table: Columns) -> None:
    try:
        import pyarrow as arrow
        from pyarrow import parquet
    except ImportError as error:
        problem = "parquet needs the extra `parquet`: pip install 'orientd-motion[parquet]'"
        raise OrientdError(problem) from error
    parquet.write_table(arrow.table(table), path)
