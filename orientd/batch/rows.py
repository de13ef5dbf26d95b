"""A row of the result for each request: its certificate, or why it was refused."""

from __future__ import annotations

import functools
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from orientd import motion_file
from orientd.batch.requests import mapping_of
from orientd.config import DeviceSettings
from orientd.errors import OrientdError
from orientd.planner import DevicePlanner, Motion
from orientd.rotation import Floats

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
FLOATS = (*_FIGURES, *(f"{kind}_{name}" for name in _PEAKS for kind in ("peak", "limit")))
TEXTS = ("name", "outcome", "refusal", "notes")
_VECTORS = ("omega_body", "alpha_body", "position")
RECORD = ("qw", "qx", "qy", "qz", *(f"{name}_{axis}" for name in _VECTORS for axis in "xyz"))
"""Columns of the records, beside ``row`` and ``record``: what is sent; rad, m and s."""


@dataclass(frozen=True, slots=True)
class Part:
    """Some of the requests of a file, for one worker.

    Attributes:
        number: of the part.
        first: which request of the file its first one is.
        requests: lines of JSON, or mappings as of motion files.
        device: pickled settings of the device that they are planned for.
        has_records: whether the records are asked for.
    """

    number: int
    first: int
    requests: Sequence[str | Mapping[str, Any]]
    device: bytes
    has_records: bool


@dataclass(frozen=True, slots=True)
class Outcomes:
    """What has become of a part.

    Attributes:
        number: of the part.
        rows: one for each request.
        records: for each request that was planned its row and its records, shape ``(n, 13)``.
    """

    number: int
    rows: list[dict[str, Any]]
    records: list[tuple[int, Floats]]


@functools.lru_cache(maxsize=4)
def _planner(pickled: bytes) -> DevicePlanner:
    device: DeviceSettings = pickle.loads(pickled)
    return device.planner()


def plan_part(part: Part) -> Outcomes:
    """Plan every request of a part."""
    planner = _planner(part.device)
    outcomes = Outcomes(part.number, [], [])
    for row, given in enumerate(part.requests, part.first):
        name = ""
        try:
            mapping = mapping_of(given) if isinstance(given, str) else given
            name = _name(mapping)
            request = motion_file.parse(mapping)
            motion = planner.plan_offline(request)
        except OrientdError as error:
            refused = {"outcome": "refused", "refusal": str(error)}
            outcomes.rows.append({"row": row, "name": name, **refused})
            continue
        outcomes.rows.append({"row": row, "name": name, **_certified(motion)})
        if part.has_records:
            outcomes.records.append((row, motion.rows(0, motion.record_count)[:, : len(RECORD)]))
    return outcomes


def _name(mapping: object) -> str:
    name = mapping.get("name") if isinstance(mapping, Mapping) else None
    return name if isinstance(name, str) else ""


def _certified(motion: Motion) -> dict[str, Any]:
    certificate = motion.certificate
    row: dict[str, Any] = {"outcome": "planned", "records": motion.record_count}
    row |= {name: getattr(certificate, name) for name in _FIGURES}
    for name in _PEAKS:
        peak = getattr(certificate, f"peak_{name}")
        row |= {f"peak_{name}": peak.value, f"limit_{name}": peak.limit}
    row["notes"] = "; ".join(certificate.notes)
    # What is not a number is nothing in the table.
    return {name: entry for name, entry in row.items() if entry == entry}
