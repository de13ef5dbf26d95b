"""Records held against limits, as the device differentiates them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from orientd.planner.certify.differences import Rough, extremes
from orientd.planner.certify.peaks import Peaks, Tally
from orientd.planner.limits import Limits
from orientd.planner.path import Path
from orientd.planner.recorded import HISTORY
from orientd.rotation import Floats

CHUNK = 2048
"""Records looked at in one go, so that a long motion needs no more memory than a short one."""

Setpoints = Callable[[int, int], tuple[Floats, Floats]]
"""Gives orientations, angular velocities and accelerations ``(m, 10)`` and positions ``(m, 3)`` of
*m* records from an index on; positions that are all the same come as one, ``(1, 3)``.  With
orientations alone, ``(m, 4)``, only differences on the records are looked at."""

_KEPT = HISTORY + 2  # so that every difference is seen with those before and after it


def measure(
    setpoints: Setpoints,
    count: int,
    period: float,
    limits: Limits,
    *,
    before: tuple[Floats, Floats] | None,
    holds_after: bool,
    brake_limits: Limits | None = None,
    rough: Rough | None = None,
) -> Peaks:
    """Return the largest backward differences over the records 0 to *count* - 1.

    Args:
        setpoints: gives the records from an index on.
        count: number of records.
        period: time between them, s.
        limits: what the peaks are held against.
        before: the three setpoints before the first, ``(3, 4)`` and ``(3, 3)``; ``None`` looks at
            differences inside the records only.
        holds_after: whether the device stays where the last record is.
        brake_limits: limits for the brake rate; ``None`` leaves the brake rate out.
        rough: where the brake rate must expect more between the records than on them.
    """
    tally = Tally(period, limits)
    q_tail, p_tail = before if before is not None else (np.empty((0, 4)), np.empty((0, 3)))
    earlier = q_tail
    for first in range(0, count, CHUNK):
        size = min(CHUNK, count - first)
        q, p = setpoints(first, size)
        if first == 0 and q.shape[1] > earlier.shape[1]:
            q_tail = _with_rates(earlier)
        held = HISTORY if holds_after and first + size == count else 0
        # A device that keeps its place is the ordinary case.
        is_still = len(p) == 1 and bool((p_tail == p).all())
        q = _padded(q_tail, q, size, held)
        q[len(q) - held :, 4:] = 0.0
        p = p if is_still else _padded(p_tail, p, size, held)
        index = first - len(q_tail)
        q_tail = q[-_KEPT:]
        p_tail = np.repeat(p[-1:], len(q_tail), axis=0) if is_still else p[-_KEPT:]

        # What ends before the first record is the past, which nothing can change.
        past = 1 if first == 0 and before is not None else 0
        found = extremes(
            q,
            past=past,
            with_axes=limits.has_axes,
            period=period,
            start=period * (index + HISTORY),
            rough=rough,
            brake_limits=brake_limits,
        )
        tally.note_turns(found, index)
        if not is_still:
            tally.note_moves(p, index, past=past, brake_limits=brake_limits)
    return tally.peaks()


def measure_path(
    path: Path,
    count: int,
    period: float,
    limits: Limits,
    *,
    before: tuple[Floats, Floats] | None,
    brake_limits: Limits,
    rough: Rough | None,
) -> Peaks:
    """Return the largest backward differences of a path, at the end of which the device stays.

    Args:
        path: sampled at multiples of the period.
        count: number of records.
        period: time between them, s.
        limits: as for :func:`measure`, like all that have the same name.
        before: likewise.
        brake_limits: likewise.
        rough: likewise.
    """
    return measure(
        partial(path.records, period=period),
        count,
        period,
        limits,
        before=before,
        holds_after=True,
        brake_limits=brake_limits,
        rough=rough,
    )


def _with_rates(q: Floats) -> Floats:
    """Return orientations before a path with velocities and accelerations, where they are known.

    They are where the device was held; else its motion of before knows them.
    """
    rates = 0.0 if bool((q == q[:1]).all()) else np.nan
    return np.concatenate([q, np.full((len(q), 6), rates)], axis=1)


def _padded(before: Floats, rows: Floats, size: int, held: int) -> Floats:
    """Return *size* rows with those before them and the last one held after them.

    Components come first in memory, as from the curves.
    """
    begin, end = len(before), len(before) + size
    padded: Floats = np.empty((rows.shape[1], end + held)).T
    padded[:begin], padded[begin:end], padded[end:] = before, rows, rows[-1:]
    return padded
