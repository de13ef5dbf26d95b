"""How chunks are followed: figures that the servo keeps in the words of their ring."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from math import ceil
from typing import NamedTuple

from orientd.driver import ZERO, Vector3
from orientd.floats import dot, norm
from orientd.servo.tracking.quintic import Knot, time_of
from orientd.stream.ring import RecordRing

REMEMBERED = 1.0
"""How long a gap to the poses counts for the lag, s."""

STANDING, STANDING_PLACE = 0.01, 0.001
"""Speed of the poses up to which a gap to them is no lag, rad/s and m/s: noise."""

LONGEST_LAG = 60.0
"""Largest lag that is reported, s: no pose of a chunk is farther ahead."""

LATENCIES = 256
"""Newest chunks of which the latency counts."""

_MOST = 1e9
"""Largest figure in a word, rad, m or s."""

_COUNTS = 3


class ChunkReport(NamedTuple):
    """How chunks have been followed since the following began; names as in the protocol.

    Attributes:
        live: poses of the newest chunk that were still to come when it came.
        stale: poses of all chunks that were not, so far.
        starved: how many chunks came after the poses had run out, with poses to come or without.
        largest_seam: largest angle by which a chunk contradicted the one before, rad.
        largest_position_seam: largest distance by which it did, m.
        behind: angle from the last setpoint to the poses, rad: the limits cut it off.
        largest_behind: the largest that it has been, rad.
        lag: delay behind the poses that fits the last second best, s.
        position_behind: distance from the last setpoint to the position of the poses, m.
        largest_position_behind: the largest that it has been, m.
        position_lag: delay of the position that fits the last second best, s.
        longest_inference: least time from the observation of a chunk to the end of the poses before
            it, s.  A chunk that was late as a whole counts with its own end, too.  ``None`` before
            there is one.
        latency_p50: half of the chunks took no longer than this from the observation that they name
            to the first setpoint that they shaped, s; ``None`` before the first one.
        latency_p95: 95 of 100 chunks took no longer than this, s.
    """

    live: int
    stale: int
    starved: int
    largest_seam: float
    largest_position_seam: float
    behind: float
    largest_behind: float
    lag: float
    position_behind: float
    largest_position_behind: float
    position_lag: float
    longest_inference: float | None
    latency_p50: float | None
    latency_p95: float | None


_PLACES = {name: place for place, name in enumerate(ChunkReport._fields)}
_OPTIONAL = ("longest_inference", "latency_p50", "latency_p95")


def read_report(ring: RecordRing) -> ChunkReport:
    """Return how chunks have been followed, from the words of their ring."""
    return _report(ring.words[1 : 1 + len(_PLACES)].tolist())


def _report(words: Sequence[int]) -> ChunkReport:
    """Return the report of words.

    Counts come first.  The others are in units of 1e-9 rad, m or s, and one more than that if the
    figure may be absent.
    """
    figures: list[float | None] = [1e-9 * word for word in words[_COUNTS:]]
    for name in _OPTIONAL:
        place = _PLACES[name]
        figures[place - _COUNTS] = 1e-9 * (words[place] - 1) if words[place] else None
    return ChunkReport(*words[:_COUNTS], *figures)


class ChunkStatistics:
    """Figures of the chunks since the following began."""

    def __init__(self, period: float) -> None:
        """Begin for one setpoint per *period* seconds."""
        self._period = period
        self.clear()

    def clear(self) -> None:
        """Begin again."""
        self._words = array("Q", bytes(8 * len(_PLACES)))
        self._latencies: deque[float] = deque(maxlen=LATENCIES)
        self._is_new = True
        self.rest()

    @property
    def report(self) -> ChunkReport:
        """The figures."""
        return _report(self._words)

    def write(self, ring: RecordRing) -> None:
        """Write the figures to the words of a ring if they are new."""
        if self._is_new:
            self._is_new = False
            words = ring.words
            for place, word in enumerate(self._words, 1):
                words[place] = word

    def rest(self) -> None:
        """Note that there are no poses to follow."""
        self._lag, self._place_lag = Lag(self._period, STANDING), Lag(self._period, STANDING_PLACE)
        self.note_gap(ZERO, ZERO)
        self.note_position_gap(ZERO, ZERO)

    def note_chunk(
        self, knots: Sequence[Knot], observed_ns: int, end_ns: int | None, sent_ns: int
    ) -> None:
        """Note a chunk that has come.

        Args:
            knots: its curve.
            observed_ns: the observation that it answers; 0 for its first pose.
            end_ns: the last of the poses before it, if there are any.
            sent_ns: the last setpoint.
        """
        observed_ns = observed_ns or knots[0].time_ns
        late = bisect_right(knots, sent_ns, key=time_of)
        self._set("live", len(knots) - late)
        self._add("stale", late)
        is_late = late == len(knots)
        if is_late or end_ns is not None:
            self._add("starved", end_ns is None or end_ns <= sent_ns)
        ends = [end_ns] if end_ns is not None else []
        if is_late:
            ends.append(knots[-1].time_ns)
        left = [end - observed_ns for end in ends if end > observed_ns]
        if left:
            place = _PLACES["longest_inference"]
            least = 1 + min(*left, round(1e9 * _MOST))
            self._words[place] = min(self._words[place] or least, least)

    def note_seam(self, angle: float, distance: float) -> None:
        """Note by how much a chunk contradicts the one before, rad and m."""
        self._raise("largest_seam", angle)
        self._raise("largest_position_seam", distance)

    def note_action(self, latency: float) -> None:
        """Note the time from an observation to the first setpoint after it that it shapes, s."""
        self._latencies.append(latency)
        ascending = sorted(self._latencies)
        for name, part in (("latency_p50", 0.5), ("latency_p95", 0.95)):
            self._set(name, 1 + _units(ascending[ceil(part * len(ascending)) - 1]))

    def note_gap(self, gap: Vector3, rate: Vector3) -> None:
        """Note the turn from a setpoint to the poses, rad, and their rate."""
        self._note_gap(self._lag, gap, rate, ("behind", "largest_behind", "lag"))

    def note_position_gap(self, gap: Vector3, rate: Vector3) -> None:
        """Note the way from a setpoint to the position of the poses, m, and their velocity."""
        names = "position_behind", "largest_position_behind", "position_lag"
        self._note_gap(self._place_lag, gap, rate, names)

    def _note_gap(self, lag: Lag, gap: Vector3, rate: Vector3, names: tuple[str, str, str]) -> None:
        lag.note(gap, rate)
        behind, largest, delay = names
        self._set(behind, _units(norm(gap)))
        self._raise(largest, norm(gap))
        self._set(delay, _units(lag.seconds))

    def _set(self, name: str, word: int) -> None:
        self._words[_PLACES[name]] = word
        self._is_new = True

    def _add(self, name: str, count: int) -> None:
        self._set(name, self._words[_PLACES[name]] + count)

    def _raise(self, name: str, size: float) -> None:
        self._set(name, max(self._words[_PLACES[name]], _units(size)))


class Lag:
    """The delay of the setpoints behind the poses that fits the last second best.

    Attributes:
        seconds: that delay, s; 0 if the poses have stood still for that long.
    """

    def __init__(self, period: float, standing: float) -> None:
        """Know no gap yet; poses no faster than *standing*, rad/s or m/s, stand still."""
        self._kept, self._standing, self._period = 1.0 - period / REMEMBERED, standing, period
        self._slipped = self._swept = self._still = self.seconds = 0.0

    def note(self, gap: Vector3, rate: Vector3) -> None:
        """Note the way from a setpoint to the poses, rad or m, and the rate of that."""
        self._still += self._period
        if norm(rate) > self._standing:
            self._still = 0.0
            self._slipped = self._kept * self._slipped + dot(gap, rate)
            self._swept = self._kept * self._swept + dot(rate, rate)
        elif self._still > REMEMBERED:
            self._slipped = self._swept = 0.0
        else:
            self._slipped, self._swept = self._kept * self._slipped, self._kept * self._swept
        lag = self._slipped / self._swept if self._swept > 0.0 else 0.0
        self.seconds = min(max(lag, 0.0), LONGEST_LAG)


def _units(size: float) -> int:
    """Return a figure in units of 1e-9, as a word has it; one that is no number as 0."""
    return round(1e9 * min(max(0.0, size), _MOST))
