"""Recorded samples of an orientation, and notes on their irregularities."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orientd.curves.fitting import describe_bursts
from orientd.recorder.writer import RecordingError
from orientd.rotation import Floats
from orientd.tolerances import NORM_TOLERANCE

NO_TIME = -(2**63)
"""Stands for a missing time."""

_NORMS = (0.5, 2.0)
"""Norms of a quaternion, in multiples of the median norm: a recording may have a scale."""

_MOST_LEFT_OUT = 0.1
"""Share of samples that may be unusable."""

_RESTART = 20.0
"""A clock was set back if it steps back by more than this many usual steps."""

_MIXED = 2
"""Fewest samples from before such a step that the later ones would mix with."""

_SLOW_NS = 10**9
"""Rows of a table are rarely further apart; their times may be in another unit."""

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
        first_words: first word of a text file that is no number, and its column; if there is one.
    """

    times_ns: Stamps
    q: Floats
    clock: str
    lines: NDArray[np.int64] | None = None
    first_words: str = ""

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


def usable(path: Path, samples: Samples) -> tuple[Floats, list[str]]:
    """Return the orientations with norms of one, NaN for unusable ones, and notes on both.

    Raises:
        RecordingError: more than a tenth of the samples are unusable.
    """
    norms: Floats = np.hypot.reduce(samples.q, axis=1)
    known = norms[np.isfinite(norms) & (norms > 0.0)]
    usual = float(np.median(known)) if len(known) else 1.0
    least, most = (usual * multiple for multiple in _NORMS)
    is_whole = (samples.times_ns != NO_TIME) & ~np.isnan(samples.q).any(axis=1)
    has_norm = (norms > least) & (norms < most)
    is_usable = is_whole & has_norm
    reasons = []
    if not is_whole.all():
        first = samples.place(int(np.argmin(is_whole)))
        words = f": {samples.first_words}" if samples.first_words else ""
        reasons.append(
            f"{_of(~is_whole)} samples without a time or number (first in {first}{words})"
        )
    if not has_norm[is_whole].all():
        is_far = is_whole & ~has_norm
        at = int(np.argmax(is_far))
        reasons.append(
            f"{_of(is_far)} quaternions with a norm outside {least:.4g} to {most:.4g} (first in "
            f"{samples.place(at)}: {norms[at]:.6g})"
        )
    if np.count_nonzero(~is_usable) > _MOST_LEFT_OUT * len(is_usable):
        raise RecordingError(
            f"{path}: more than a tenth of the samples is unusable: {', '.join(reasons)}; cut or "
            "repair the recording"
        )
    notes = [f"left out: {reason}" for reason in reasons]
    is_off = has_norm & (np.abs(norms - 1.0) > NORM_TOLERANCE)
    if is_off.any():
        lowest, highest = (f"{norm:.6g}" for norm in (norms[is_off].min(), norms[is_off].max()))
        which = f"norm {lowest}" if lowest == highest else f"norms from {lowest} to {highest}"
        notes.append(f"scaled to 1: {_of(is_off)} quaternions with {which}")
    q = samples.q.copy()
    q[is_off] /= norms[is_off, None]
    q[~has_norm] = np.nan
    return q, notes


def check_order(path: Path, samples: Samples) -> list[str]:
    """Return notes on times that repeat, step back or come in bursts.

    Raises:
        RecordingError: all times are the same, they are of two clocks, or the clock was set back in
            the middle, which would mix later samples with earlier ones.
    """
    notes = []
    places = np.flatnonzero((samples.times_ns != NO_TIME) & ~np.isnan(samples.q).any(axis=1))
    times = samples.times_ns[places]
    if len(times) > 1 and not np.ptp(times):
        raise RecordingError(
            f"{path}: all {len(times)} samples have the same time, {1e-9 * times[0]:.9g} s, by "
            f"{samples.clock}; expected a time of its own for each"
        )
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
    if samples.lines is not None and usual > _SLOW_NS:
        notes.append(
            f"rows are {1e-9 * usual:.4g} s apart; if the times are not in seconds, name their "
            "unit, as in 'time [ms]'"
        )
    if len(back):
        first = int(places[back[0] + 1])
        largest = 1e-9 * float(-steps.min())
        count = "once" if len(back) == 1 else f"{len(back)} times"
        notes.append(
            f"the time steps back {count}, first in {samples.place(first)}, by at most "
            f"{largest:.6g} s: samples are taken in the order of their times"
        )
    bursts = describe_bursts(1e-9 * (times - times[:1]))
    if bursts:
        notes.append(bursts)
    repeated = len(times) - len(np.unique(times))
    if repeated:
        notes.append(
            f"not used: {repeated} of {len(times)} samples with the time of an earlier sample"
        )
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
