"""Tables of a target's directions by time: their rows, the curve between them, and its error.

A row that cannot be right is refused by its line and column.  Its angles or its time are outside
their ranges, or it alone is far off the path of its neighbours, as after a lost decimal point.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from orientd.errors import OrientdError
from orientd.rotation import Floats
from orientd_rotctld.satellite_pass import RANGES
from orientd_rotctld.sky import Target, text_of
from orientd_serving.pointing import angles, vectors

MOST_ERROR = 0.1
"""Error between two rows above which a table counts as too coarse, degrees."""

_COLUMNS = ("time", "azimuth", "elevation")
_FIRST, _LAST = 946684800.0, 4102444800.0
"""The years 2000 to 2100, Unix time in s."""
_FINER = {"ms": 1e3, "us": 1e6, "ns": 1e9}
"""Units of time that are mistaken for seconds, and how many of them a second has."""
_GAP = 10.0
"""Time between two rows of a table, in the usual times between them, that ends a pass."""
_ROUNDS = 30
_FEWEST = 3
"""Rows of a table, and of a curve that is not a straight line."""
_ESTIMATED = 2 * _FEWEST - 1
"""Fewest rows of a pass whose error can be estimated."""
_ROUNDING = math.radians(0.5 * math.sqrt(2.0))
"""Largest error of a direction whose angles are whole degrees, rad."""
_TIMES = 5.0
"""How many times as far a wrong row is from the path of its neighbours as they are without it."""
_AROUND, _BESIDE = 6, 2
"""Rows on each side of a suspect that judge it, and of these the ones whose path it would bend."""
_MOST_GAIN, _LEAST_GAIN = 16.0, 4.0
"""Factor by which the error of a cubic falls when rows are twice as close: once they are close, and
if there are too few rows to see it."""
_SCATTER = 2.0
"""The factor below which closer rows do not help: the angles scatter."""
_SPACINGS = (60.0, 30.0, 20.0, 15.0, 10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1)
"""Times between two rows that are recommended, s."""


class _Row(NamedTuple):
    """A row: its line in the file, Unix time in s, azimuth and elevation in degrees."""

    line: int
    time: float
    azimuth: float
    elevation: float


@dataclass(frozen=True, slots=True)
class Table:
    """A table of directions.

    Attributes:
        target: it is on a cubic curve between the rows; in a gap, as between two passes, its place
            is not known.
        error: estimate of the largest angle between the target and this curve, degrees; NaN if no
            pass has enough rows.
        summary: one line about the rows and the error.
    """

    target: Target
    error: float
    summary: str

    @property
    def is_exact(self) -> bool:
        """Whether the error is known to be at most :data:`MOST_ERROR`."""
        return self.error <= MOST_ERROR


def from_table(path: Path) -> Table:
    """Return a table with the columns time, azimuth and elevation.

    Between its rows the target is on a cubic curve through them.  The error of the curve is
    estimated from the curve through every second row: it misses the rows that it leaves out.  The
    curve through every fourth row shows by how much closer rows lower this.

    Args:
        path: a CSV file; times are Unix time in s, or ISO 8601 (UTC without a zone).

    Raises:
        OrientdError: the file cannot be read, or is not such a table.
    """
    rows = list(_rows(path))
    if len(rows) < _FEWEST:
        problem = f"expected at least {_FEWEST} rows, got {len(rows)}; add rows"
        raise OrientdError(f"{path}: {problem}")
    for before, row in pairwise(rows):
        if not row.time > before.time:
            raise _refusal(
                path,
                row.line,
                "time",
                f"expected a time after {_shown(before.time)} of line {before.line}, "
                f"got {_shown(row.time)}; sort the rows by time",
            )
    _, times, azimuth, elevation = np.array(rows).T
    points = vectors(azimuth, elevation)
    spacing = np.diff(times)
    is_gap = spacing > _GAP * np.median(spacing)
    passes = np.split(np.arange(len(times)), np.flatnonzero(is_gap) + 1)
    for one in passes:
        _check_path(path, [rows[k] for k in one], times[one], points[one])
    rates = np.concatenate([_rates(times[one], points[one]) for one in passes])

    def at(when: Floats) -> Floats:
        found = _curve(times, points, rates, when)
        row = np.clip(np.searchsorted(times, when, side="right") - 1, 0, len(times) - 2)
        is_within = is_gap[row] & (when > times[row]) & (when < times[row + 1])
        found[(when < times[0]) | (when > times[-1]) | is_within] = np.nan
        return found

    known = [_estimate(one, times[one], points[one]) for one in passes if len(one) >= _ESTIMATED]
    error, summary = _judged(known, rows)
    return Table(Target(path.stem, at), error, f"{path}: {summary}")


class _Estimate(NamedTuple):
    """The estimated error between the rows of a pass.

    Attributes:
        error: the largest, degrees.
        row: number of the row near which it is largest.
        gain: factor by which it falls when rows are twice as close.
        spacing: usual time from row to row, s.
    """

    error: float
    row: int
    gain: float
    spacing: float


def _estimate(rows: NDArray[np.int64], times: Floats, points: Floats) -> _Estimate:
    """Return the error between the rows of a pass that has enough of them."""
    second, fourth = (_missed(times, points, every) for every in (2, 4))
    worst, gain = int(np.argmax(second)), _LEAST_GAIN
    if fourth.any() and second.any():
        gain = min(max(float(fourth.max() / second.max()), 1.0), _MOST_GAIN)
    spacing = float(np.median(np.diff(times)))
    return _Estimate(math.degrees(second[worst]) / gain, int(rows[worst]), gain, spacing)


def _judged(known: list[_Estimate], rows: list[_Row]) -> tuple[float, str]:
    """Return the largest error of the passes, degrees, and what is said about it."""
    if not known:
        return math.nan, (
            f"{len(rows)} rows do not show how far the target is from the curve between them; "
            f"give each pass at least {_ESTIMATED} rows"
        )
    worst = max(known, key=lambda one: one.error)
    row = rows[worst.row]
    where = f"near line {row.line} (azimuth {row.azimuth:g}, elevation {row.elevation:g})"
    size = f"{worst.error:.2g}" if worst.error >= 1e-4 else "less than 0.0001"
    every = f"a row every {worst.spacing:.3g} s"
    if worst.error <= MOST_ERROR:
        return worst.error, (
            f"{len(rows)} rows, {every}: between them the target is known to {size} degrees, "
            f"worst {where}"
        )
    if worst.gain < _SCATTER:
        return worst.error, (
            f"the angles scatter: the path of the target is only known to {size} degrees, worst "
            f"{where}, expected {MOST_ERROR:g}; give the angles with more digits"
        )
    wanted = worst.spacing * math.cbrt(MOST_ERROR / worst.error)
    closer = next((one for one in _SPACINGS if one <= wanted), wanted)
    return worst.error, (
        f"{every} is too coarse: between them the target is only known to {size} degrees, worst "
        f"{where}; a row every {closer:.2g} s keeps it below {MOST_ERROR:g} degrees"
    )


def _missed(times: Floats, points: Floats, every: int) -> Floats:
    """Return how far the rows are from the curves through each *every*-th, rad, shape ``(n,)``."""
    missed = np.zeros(len(times))
    for first in range(every):
        kept = slice(first, None, every)
        if len(times[kept]) < _FEWEST:
            continue
        inner = slice(first, first + every * (len(times[kept]) - 1) + 1)
        rates = _rates(times[kept], points[kept])
        found = _curve(times[kept], points[kept], rates, times[inner])
        missed[inner] = np.maximum(missed[inner], _apart(found, points[inner]))
    return missed


def _check_path(path: Path, rows: list[_Row], times: Floats, points: Floats) -> None:
    """Check that no single row of a pass is far off the path of its neighbours.

    Raises:
        OrientdError: one is.
    """
    if len(rows) < _AROUND:
        return
    aside, leads = _aside(times, points)
    suspects = np.flatnonzero(aside > 1.0)
    for k in suspects[np.argsort(-aside[suspects])].tolist():
        around = np.arange(max(0, k - _AROUND), min(len(rows), k + _AROUND + 1))
        others = around[around != k]
        near = np.abs(others - k) <= _BESIDE
        if aside[k] < _TIMES * _aside(times[others], points[others])[0][near].max():
            continue
        row, (azimuth, height) = rows[k], angles(leads[k])
        off = math.degrees(_apart(leads[k], points[k]))
        turned = math.remainder(azimuth - row.azimuth, 360.0)
        raise OrientdError(
            f"{path}, line {row.line}: azimuth {row.azimuth:g}, elevation {row.elevation:g} is "
            f"{off:.3g} degrees off the path of the rows around it, expected about azimuth "
            f"{row.azimuth + turned:.4g}, elevation {height:.4g}; check the decimal points of this "
            "row"
        )


def _aside(times: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Return how far each row is from the path of its neighbours, and where that leads.

    The path is the cubic through the four nearest other rows.  It takes at least five rows.

    Returns:
        Angles, in the largest one that a table in whole degrees has, shape ``(n,)``; the path at
        the times of the rows, unit vectors of shape ``(n, 3)``.
    """
    count = len(times)
    own = np.arange(count)[:, None]
    window = np.clip(own - 2, 0, count - 5) + np.arange(5)
    others = window[window != own].reshape(count, 4)
    since = times[others] - times[:, None]
    # Lagrange's polynomials at time 0.
    ratio = since[:, None, :] / (since[:, None, :] - since[:, :, None] + np.eye(4))
    weights = np.where(np.eye(4, dtype=bool), 1.0, ratio).prod(axis=2)
    leads = np.einsum("nk,nkc->nc", weights, points[others])
    leads /= np.linalg.norm(leads, axis=1, keepdims=True)
    rounding = _ROUNDING * (1.0 + np.abs(weights).sum(axis=1))
    return _apart(leads, points) / rounding, leads


def _apart(found: Floats, points: Floats) -> Floats:
    """Return the angles between unit vectors, rad, shape ``(...)``."""
    half: Floats = np.minimum(0.5 * np.linalg.norm(found - points, axis=-1), 1.0)
    return 2.0 * np.arcsin(half)


def _curve(times: Floats, points: Floats, rates: Floats, when: Floats) -> Floats:
    """Return unit vectors of the cubic curve through *points*, shape ``(n, 3)``."""
    row = np.clip(np.searchsorted(times, when, side="right") - 1, 0, len(times) - 2)
    length = (times[row + 1] - times[row])[:, None]
    u = (when - times[row])[:, None] / length
    found: Floats = (
        (1.0 + 2.0 * u) * (1.0 - u) ** 2 * points[row]
        + u**2 * (3.0 - 2.0 * u) * points[row + 1]
        + length * u * (1.0 - u) * ((1.0 - u) * rates[row] - u * rates[row + 1])
    )
    unit: Floats = found / np.linalg.norm(found, axis=1, keepdims=True)
    return unit


def _rates(times: Floats, points: Floats) -> Floats:
    """Return the derivatives of a cubic spline through points, shape ``(n, 3)``.

    At the ends they are those of parabolas.  The equations of the others are dominated by their
    diagonal, so that each round halves the error.  Fewer than three points are on a straight line.
    """
    if len(times) < _FEWEST:
        span = max(times[-1] - times[0], np.finfo(np.float64).tiny)
        return np.tile((points[-1] - points[0]) / span, (len(times), 1))
    lengths = np.diff(times)[:, None]
    before, after = lengths[:-1], lengths[1:]
    slopes = np.diff(points, axis=0) / lengths
    rates: Floats = np.gradient(points, times, axis=0, edge_order=2)
    wanted = 3.0 * (after * slopes[:-1] + before * slopes[1:])
    for _ in range(_ROUNDS):
        others = after * rates[:-2] + before * rates[2:]
        rates[1:-1] = (wanted - others) / (2.0 * (before + after))
    return rates


def _rows(path: Path) -> Iterator[_Row]:
    reader = csv.DictReader(text_of(path).splitlines(keepends=True))
    try:
        names = reader.fieldnames or ()
        if missing := [name for name in _COLUMNS if name not in names]:
            came = ",".join(names)[:60]
            raise OrientdError(
                f"{path}, line 1: expected the columns {', '.join(_COLUMNS)}, got {came!r} with no "
                f"{missing[0]}; name the columns in the first line, with commas between"
            )
        twice = next((name for name in _COLUMNS if names.count(name) > 1), None)
        if twice is not None:
            raise OrientdError(f"{path}, line 1: two columns are called {twice!r}; rename one")
        for row in reader:
            line = reader.line_num
            for cell in row.values():
                if isinstance(cell, str) and "\n" in cell:
                    begun = line - cell.rstrip("\n").count("\n")
                    problem = "a quote that is not closed in its line; remove it"
                    raise OrientdError(f"{path}, line {begun}: {problem}")
            if None in row:
                raise OrientdError(
                    f"{path}, line {line}: expected {len(names)} cells, got "
                    f"{len(names) + len(row[None])}; write numbers with a decimal point"
                )
            when = _time(path, line, row["time"])
            azimuth, elevation = (_angle(path, line, name, row[name]) for name in RANGES)
            yield _Row(line, when, azimuth, elevation)
    except csv.Error as error:
        raise OrientdError(f"{path}, line {reader.line_num}: expected CSV: {error}") from None


def _angle(path: Path, line: int, column: str, cell: str | None) -> float:
    """Return the angle of a cell, degrees.

    Raises:
        OrientdError: it is none, or outside the range of its column.
    """
    low, high = RANGES[column]
    expected = f"expected {low:g} to {high:g} degrees"
    text = cell or ""
    try:
        angle = float(text) if "_" not in text else float("")
    except ValueError:
        step = "write the number alone" if text.strip() else "fill it in, or leave out the row"
        raise _refusal(path, line, column, f"{expected}, got {text!r}; {step}") from None
    if not low <= angle <= high:
        problem = f"{expected}, got {angle:.10g}; check the decimal point"
        raise _refusal(path, line, column, problem)
    return angle


def _time(path: Path, line: int, cell: str | None) -> float:
    """Return the time of a cell, Unix time in s.

    Raises:
        OrientdError: it is none, or not one of the years 2000 to 2100.
    """
    text = (cell or "").strip()
    try:
        when = float(text)
    except ValueError:
        try:
            parsed = datetime.fromisoformat(text)
            when = (parsed if parsed.tzinfo else parsed.replace(tzinfo=UTC)).timestamp()
        except (ValueError, OverflowError):
            expected = "expected Unix time in s, or ISO 8601 as in 2026-05-01T12:00:00Z"
            problem = f"{expected}, got {text!r}; write it so"
            raise _refusal(path, line, "time", problem) from None
    if not _FIRST <= when <= _LAST:
        units = [unit for unit, most in _FINER.items() if _FIRST <= when / most <= _LAST]
        step = f"convert it from {units[0]} to s" if units else "check its unit and its digits"
        expected = "expected Unix time in s, of the years 2000 to 2100"
        raise _refusal(path, line, "time", f"{expected}, got {text}; {step}")
    return when


def _shown(when: float) -> str:
    """Return a time as in ``2026-05-01T12:00:00.25``."""
    shown = datetime.fromtimestamp(when, UTC).isoformat(timespec="milliseconds")
    return shown.removesuffix("+00:00").rstrip("0").rstrip(".")


def _refusal(path: Path, line: int, column: str, problem: str) -> OrientdError:
    return OrientdError(f"{path}, line {line}, {column}: {problem}")
