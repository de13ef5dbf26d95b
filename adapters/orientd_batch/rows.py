"""A row of the result for each request: its certificate, or the reason of its refusal."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

from orientd import motion_file
from orientd.config import DeviceSettings
from orientd.errors import OrientdError, RequestError
from orientd.planner import Motion
from orientd.rotation import Floats
from orientd_batch.request_file import Request

_PEAKS = ("velocity", "acceleration", "jerk", "linear_velocity", "linear_acceleration")
_FIGURES = ("duration", "lead_in", "lead_out", "start_velocity_error", "end_velocity_error",
            "keyframe_error", "brake_rate", "stop_time", "usual_stop_time")  # fmt: skip
_VECTORS = ("omega_body", "alpha_body", "position")

COLUMNS = {
    "row": "int64",
    **dict.fromkeys(("name", "outcome", "refusal", "notes"), "string"),
    "records": "int64",
    **dict.fromkeys(_FIGURES, "float64"),
    **{f"{kind}_{name}": "float64" for name in _PEAKS for kind in ("peak", "limit")},
}
"""Columns of the result and their types."""

RECORD = ("qw", "qx", "qy", "qz", *(f"{name}_{axis}" for name in _VECTORS for axis in "xyz"))
"""Columns of the records, in addition to ``row`` and ``record``: setpoints in rad, m and s."""


class Part(NamedTuple):
    """Some requests of a file: the number of the part, the row of its first request, requests."""

    number: int
    first: int
    requests: Sequence[Request]


class Planned(NamedTuple):
    """A part's rows, and the records of each motion that was planned, by its row."""

    number: int
    rows: list[dict[str, Any]]
    records: list[tuple[int, Floats]]


def plan_part(part: Part, *, device: DeviceSettings, has_records: bool) -> Planned:
    """Plan the requests of a part for a device."""
    planner = device.planner()
    planned = Planned(part.number, [], [])
    for row, request in enumerate(part.requests, part.first):
        entries: dict[str, Any] = {"row": row, "name": ""}
        try:
            mapping = _parsed(request) if isinstance(request, str) else request
            name = mapping.get("name") if isinstance(mapping, dict) else None
            entries["name"] = name if isinstance(name, str) else ""
            motion = planner.plan_offline(motion_file.parse(mapping))
        except OrientdError as error:
            entries |= {"outcome": "refused", "refusal": str(error)}
        else:
            entries |= _certified(motion)
            if has_records:
                records = motion.rows(0, motion.record_count)[:, : len(RECORD)]
                planned.records.append((row, records))
        planned.rows.append(entries)
    return planned


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
