"""Recorded samples of an orientation, and notes on their irregularities."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orientd.curves import describe_bursts
from orientd.recorder.writer import RecordingError
from orientd.rotation import Floats
from orientd.tolerances import NORM_TOLERANCE

NO_TIME = -(2**63)
"""Stands for a missing time."""

_NORMS = (0.5, 2.0)
"""Norms of a quaternion that only lacks its scale."""

_RESTART = 20.0
"""A clock was set back if it steps back by more than this many usual steps."""

_MIXED = 2
"""Fewest samples from before such a step that the later ones would mix with."""

_DAY_NS = 86_400 * 10**9
"""No pause of a recording is longer."""

Stamps = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """The samples under one name.

    Attributes:
        times_ns: :data:`NO_TIME` for a sample without one, shape ``(n,)``.
        q: orientations ``(w, x, y, z)``, shape ``(n, 4)``.
        clock: what the times are, in words.
        lines: line of each sample in a text file, shape ``(n,)``.
    """

    times_ns: Stamps
    q: Floats
    clock: str
    lines: NDArray[np.int64] | None = None

    def place(self, index: int) -> str:
        """Return the place of a sample in words."""
        if self.lines is not None:
            return f"line {self.lines[index]}"
        return f"sample {index}"

    def seconds(self) -> Floats:
        """Return the times from the first one on, s, NaN for a missing one."""
        known = np.flatnonzero(self.times_ns != NO_TIME)
        times: Floats = np.full(len(self.times_ns), np.nan)
        if len(known):
            times[known] = (self.times_ns[known] - self.times_ns[known[0]]) * 1e-9
        return times


def scaled(samples: Samples) -> tuple[Floats, list[str]]:
    """Return the orientations with norms of one, and notes on those that were scaled.

    Numbers far from a quaternion become NaN.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        norms = np.sqrt(np.sum(samples.q * samples.q, axis=1))
        is_off = np.abs(norms - 1.0) > NORM_TOLERANCE
        is_near = is_off & (norms > _NORMS[0]) & (norms < _NORMS[1])
        is_far = is_off & ~is_near
    q = samples.q.copy()
    q[is_near] /= norms[is_near, None]
    q[is_far] = np.nan
    notes = []
    if is_near.any():
        near = norms[is_near]
        notes.append(
            f"{_of(is_near)} quaternions have norms from {near.min():.6g} to {near.max():.6g}: "
            "scaled to 1"
        )
    if is_far.any():
        first = int(np.argmax(is_far))
        notes.append(
            f"{_of(is_far)} are no quaternions and left out, the first in {samples.place(first)}, "
            f"of norm {norms[first]:.6g}"
        )
    return q, notes


def check_order(path: Path, samples: Samples) -> list[str]:
    """Return notes on times that are missing, repeat or step back.

    Raises:
        RecordingError: a clock was set back in the middle, which would mix later samples with
            earlier ones.
    """
    notes = []
    is_known = (samples.times_ns != NO_TIME) & ~np.isnan(samples.q).any(axis=1)
    if not is_known.all():
        first = int(np.argmin(is_known))
        notes.append(
            f"{_of(~is_known)} samples lack a number and are left out, the first in "
            f"{samples.place(first)}"
        )
    places = np.flatnonzero(is_known)
    times = samples.times_ns[places]
    _check_one_clock(path, samples, places)
    steps = np.diff(times)
    back = np.flatnonzero(steps < 0)
    usual = float(np.median(np.abs(steps))) if len(steps) else 0.0
    for k in back[-steps[back] > _RESTART * usual].tolist():
        later = np.flatnonzero(times[k + 1 :] >= times[k])
        behind = times[k + 1 :][: later[0] if len(later) else None]
        among = (times[: k + 1] > behind.min()) & (times[: k + 1] < behind.max())
        if np.count_nonzero(among) >= _MIXED:
            origin = int(times[0])
            here, there = (1e-9 * (int(times[at]) - origin) for at in (k, k + 1))
            raise RecordingError(
                f"{path}: the time steps back by {here - there:.6g} s in "
                f"{samples.place(int(places[k + 1]))}, from {here:.6g} s to {there:.6g} s, and "
                f"{len(times) - k - 1} of {len(times)} samples come after that, among earlier "
                "ones; cut the recording there, or put its times right"
            )
    if len(back):
        first = int(places[back[0] + 1])
        largest = 1e-9 * float(-steps.min())
        notes.append(
            f"the time steps back {len(back)} times, first in {samples.place(first)}, by at most "
            f"{largest:.6g} s: samples are taken in the order of their times"
        )
    bursts = describe_bursts(1e-9 * (times - times[:1]))
    if bursts:
        notes.append(bursts)
    repeated = len(times) - len(np.unique(times))
    if repeated:
        notes.append(f"{repeated} of {len(times)} samples repeat a time and are left out")
    return notes


def _check_one_clock(path: Path, samples: Samples, places: NDArray[np.intp]) -> None:
    """Check that the times at *places* do not lie in two ranges that are too far apart.

    Raises:
        RecordingError: they do, and the recording changes between the two, or they are days apart.
    """
    times = samples.times_ns[places]
    ordered = np.sort(times)
    gaps = np.diff(ordered)
    if not len(gaps):
        return
    last = int(np.argmax(gaps))
    spans = (ordered[last] - ordered[0]) + (ordered[-1] - ordered[last + 1])
    is_later = times > ordered[last]
    changes = np.flatnonzero(np.diff(is_later)) + 1
    if gaps[last] > spans and (len(changes) > 1 or gaps[last] > _DAY_NS):
        ranges = ", ".join(
            f"{len(part)} from {1e-9 * part.min():.3f} s to {1e-9 * part.max():.3f} s"
            for part in (times[~is_later], times[is_later])
        )
        raise RecordingError(
            f"{path}: {samples.clock} are of two clocks: of {len(times)} samples {ranges}, the "
            f"first change in {samples.place(int(places[changes[0]]))}; keep the samples of one "
            "clock"
        )


def _of(which: NDArray[Any]) -> str:
    return f"{int(np.count_nonzero(which))} of {len(which)}"
