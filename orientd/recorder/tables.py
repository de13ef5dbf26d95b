"""Recordings as tables: csv, npz or parquet, by the ending of the name."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orientd.errors import OrientdError
from orientd.recorder.planned import planned_orientations
from orientd.recorder.reader import Recording
from orientd.rotation import Floats
from orientd.stream import CycleFlag, ServoState
from orientd.whole_file import written

_COMPONENTS = {"q": "wxyz", "joints": "12345678"}
_UNITS = {
    "q": "",
    "omega_body": "_rad_s",
    "alpha_body": "_rad_s2",
    "position": "_m",
    "joints": "_rad",
}
_COUNTS = ("index", "motion", "overruns", "missed")


def columns(recording: Recording, device: str) -> dict[str, Floats]:
    """Return the cycles of *device* column by column; not a number where there is none.

    ``time_s`` is the time of day, ``measured_time_s`` when the feedback was measured.
    """
    cycles = recording.cycles[device]
    has_feedback = (cycles["flags"] & CycleFlag.FEEDBACK) != 0
    path_times, planned = planned_orientations(recording, device)
    table: dict[str, Floats] = {
        "time_s": (cycles["deadline_ns"] + recording.offset_ns) * 1e-9,
        "deadline_ns": cycles["deadline_ns"],
        "lateness_s": cycles["lateness_ns"] * 1e-9,
        "work_s": cycles["work_ns"] * 1e-9,
        "state": cycles["state"],
        "fault": cycles["fault"],
        "is_written": (cycles["flags"] & CycleFlag.WRITTEN) != 0,
        "speed": cycles["speed"],
        "path_time_s": path_times,
        **{name: cycles[name] for name in _COUNTS},
    }
    _spread(table, "planned_q", planned)
    for name in cycles.dtype.names or ():
        if name.startswith("sent_"):
            _spread(table, name, cycles[name])
    stamps = np.where(has_feedback, cycles["feedback_time_ns"] + recording.offset_ns, np.nan)
    table["measured_time_s"] = stamps * 1e-9
    for name in cycles.dtype.names or ():
        if name.startswith("measured_"):
            _spread(table, name, np.where(has_feedback[:, None], cycles[name], np.nan))
    return table


def export(recording: Recording, device: str, path: Path) -> int:
    """Write the cycles of *device* to *path*; return how many.

    Raises:
        OrientdError: the file cannot be written, or needs the extra `parquet`, which is not there.
    """
    table = columns(recording, device)
    rows = len(table["time_s"])
    with written(path) as file:
        if path.suffix == ".npz":
            np.savez_compressed(file, allow_pickle=False, **table)
        elif path.suffix == ".parquet":
            _write_parquet(file, table)
        else:
            _write_csv(file, table)
    return rows


def _spread(table: dict[str, Floats], name: str, content: Floats) -> None:
    """Add the components of a quantity, without those that are nowhere there."""
    quantity = name.split("_", 1)[1]
    for component, column in zip(_COMPONENTS.get(quantity, "xyz"), content.T, strict=True):
        if quantity == "joints" and np.all(np.isnan(column)):
            continue
        joint = "" if quantity == "q" else "_"
        table[f"{name}{joint}{component}{_UNITS[quantity]}"] = column


def _write_csv(path: Path, table: dict[str, Floats]) -> None:
    names = {state.value: state.name.lower() for state in ServoState}
    with path.open("w", encoding="utf-8") as stream:
        stream.write(",".join(table) + "\n")
        listed = [column.tolist() for column in table.values()]
        state = list(table).index("state")
        listed[state] = [names.get(value, str(value)) for value in listed[state]]
        for row in zip(*listed, strict=True):
            stream.write(",".join("" if cell != cell else str(cell) for cell in row) + "\n")


def _write_parquet(path: Path, table: dict[str, Floats]) -> None:
    try:
        import pyarrow as arrow
        from pyarrow import parquet
    except ImportError as error:
        problem = "parquet needs the extra `parquet`: pip install 'orientd-motion[parquet]'"
        raise OrientdError(problem) from error
    parquet.write_table(arrow.table(dict(table)), path)
