"""Forecast a target's motion from its samples.

The samples of the newest motion are fitted by many polynomials, of several degrees and through
several numbers of samples (``kernels/c/fit.h``).  Each fit keeps a score: how well it has foretold
samples so far.  The forecast is the mean of the fits, weighted by their scores.  A smooth motion
thus gets a short memory and a high degree, and hardly any lag.  Noise, losses and jitter lengthen
the memory and lower the degree.

A new sample changes the forecast.  The difference fades within about one gap between samples, so
the reference does not jump.

A sample that no motion can explain begins another motion, at rest.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Sequence
from math import exp as exp_of
from math import sqrt
from typing import NamedTuple, cast

from orientd import kernels
from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import combine, cross, difference, exp, multiply, norm, normalize, plus
from orientd.mechanism.mechanism import Rows
from orientd.servo.tracking.quintic import time_of

WINDOW = 27
"""Most samples of a fit."""

FITS, NUMBERS = 77, 24
"""Number of fits, and of the coefficients of each."""

SPACING_NS = 4_900_000
"""Least time between two samples of a fit, and between the newest ones of two fits."""

AHEAD = 2
"""Samples whose time has not come that a fit takes, if there are any."""

MEMORY = 0.6
"""Time that the samples of a fit span at most, s."""

LONGEST = 0.25
"""Longest spacing of samples that belong to one motion, s."""

LEARNING = 0.06
"""Weight of the newest error of a fit in its score."""

TRUST = 0.05
"""Time for which given velocities count more than orientations, s: this averages the noise."""

JUMP = 0.1
"""Surprise from which a target with velocity is a new order rather than a correction, rad."""

GATE = 5.0
"""Expected errors from which a surprise is a new order rather than noise or motion."""

AGILITY = 20.0
"""Assumed acceleration of a target between two samples, rad/s^2 or m/s^2."""

ANY_VELOCITY = 2.0
"""Velocity that a target without known motion may have, rad/s or m/s."""

BENT = 0.05
"""Time for which the last acceleration is continued, s, once samples are older than ever."""

FORGETTING = 0.01
"""Decay of the largest age of samples with every new one."""

FADING = 0.6
"""Time constant in which a change of the forecast fades, in gaps between samples."""

QUICKEST = 1.3e-3
"""Least time constant of that, s."""

FARTHEST = 1.5
"""Largest distance of a sample from the newest one that is fitted, rad or m."""

_LINE = 7
"""The fit of a line through two samples."""


Value = Quaternion | Vector3
"""An orientation ``(w, x, y, z)``, or a position, m."""


class TimedValue:
    """A sample of the motion of a target, of its orientation or its position.

    Attributes:
        time_ns: when.
        value: an orientation ``(w, x, y, z)``, or a position, m.
        rate: angular velocity in its own frame, rad/s, if it is given.
        is_noted: whether it has been compared with its forecast.
    """

    __slots__ = ("is_noted", "rate", "time_ns", "value")

    def __init__(self, time_ns: int, value: Value, rate: Vector3 | None = None) -> None:
        self.time_ns, self.value, self.rate = time_ns, value, rate
        self.is_noted = False


class Moving(NamedTuple):
    """A forecast at a time.

    Attributes:
        value: an orientation ``(w, x, y, z)``, or a position, m.
        rate: in the frame of an orientation, rad/s, or m/s.
        change: rad/s^2 or m/s^2.
        lead: expected change of that within a cycle, for feed-forward.
    """

    value: Value
    rate: Vector3
    change: Vector3
    lead: Vector3


class Forecast:
    """The motion that samples foretell, of an orientation or of a position.

    Attributes:
        begin_ns: time of the sample with which the motion begins.
    """

    def __init__(self, period: float, *, is_turn: bool) -> None:
        """Know nothing yet; there is one call for every *period*, s."""
        self._period, self._is_turn = period, is_turn
        self._scores = Rows(FITS, 2)
        self._mean, self._read = array("d", bytes(8 * NUMBERS)), array("d", bytes(96))
        self._fits = Rows(FITS, NUMBERS)
        self._reach = self._gap = 0.0
        self._looked = 0, 0
        self._begin(0)

    def _begin(self, time_ns: int) -> None:
        """Begin another motion, at rest; the scores stay, because the noise does."""
        self.begin_ns = time_ns
        self._newest: TimedValue | None = None
        self._seen: tuple[int, TimedValue] | None = None
        self._offset = ZERO, ZERO, ZERO

    def at(self, samples: Sequence[TimedValue], version: int, now_ns: int) -> Moving:
        """Return the motion at an instant.

        Args:
            samples: by time, at least one of them in the past; those ahead may be more.
            version: changes with every change of *samples*.
            now_ns: the instant, later than in the last call.
        """
        due = bisect_right(samples, now_ns, key=time_of) - 1
        end = self._noted(samples, version, due, now_ns)
        newest = self._newest
        if newest is None or not 0 < samples[end - 1].time_ns - newest.time_ns < SPACING_NS:
            newest = samples[end - 1]
            if self._seen != (seen := (version, newest)):
                self._fit(samples, end, now_ns)
                self._seen = seen
        value, rate, change, lead = self._moving(newest, now_ns)
        way, speed, _ = self._offset
        self._offset = _faded(self._offset, max(FADING * self._gap, QUICKEST), self._period)
        return Moving(self._moved(value, way), plus(rate, speed, 1.0), change, lead)

    def _noted(self, samples: Sequence[TimedValue], version: int, due: int, now_ns: int) -> int:
        """Compare new samples with the fits; return the number of samples that may be fitted.

        If a sample begins another motion, it and all after it may not before the next cycle.
        """
        end = min(due + 1 + AHEAD, len(samples))
        if self._looked == (version, end):
            return end
        for place in range(max(0, end - WINDOW), end):
            sample = samples[place]
            if sample.is_noted:
                continue
            is_late = place + 1 < end and samples[place + 1].is_noted
            if not is_late and self._begins(samples, place):
                if sample.time_ns > now_ns + round(1e9 * self._period):
                    return place
                self._begin(sample.time_ns)
            else:
                self._score(sample)
            sample.is_noted = True
        self._looked = version, end
        return end

    def _begins(self, samples: Sequence[TimedValue], place: int) -> bool:
        """Return whether no motion of the samples before explains a sample."""
        sample, before = samples[place], samples[place - 1]
        if place == 0 or before.time_ns < self.begin_ns or not before.is_noted:
            return True
        span = (sample.time_ns - before.time_ns) * 1e-9
        way, rates = self._way(before.value, sample.value), (before.rate, sample.rate)
        if rates != (None, None):
            here, there = rates
            if here is None or there is None or ZERO in rates:
                return True
            return norm(plus(way, combine(here, 0.5, there, 0.5), -span)) > JUMP
        if span > LONGEST:
            return True
        earlier = samples[place - 2] if place > 1 else None
        square, count = self._scores[_LINE]
        if earlier is None or earlier.time_ns < self.begin_ns or not count:
            return norm(way) > GATE * sqrt(3.0) * ANY_VELOCITY * span
        spacing = (before.time_ns - earlier.time_ns) * 1e-9
        surprise = plus(way, self._way(earlier.value, before.value), -span / spacing)
        most = GATE * sqrt(square) + 0.5 * AGILITY * span * (span + spacing)
        return norm(surprise) > most

    def _score(self, sample: TimedValue) -> None:
        """Note how well the fits have foretold a sample."""
        newest = self._newest
        if newest is None:
            return
        horizon = (sample.time_ns - newest.time_ns) * 1e-9
        if horizon <= LONGEST:
            way = array("d", self._way(newest.value, sample.value))
            kernels.score_fits(self._fits.view, horizon, way, LEARNING, self._scores.view)

    def _fit(self, samples: Sequence[TimedValue], end: int, now_ns: int) -> None:
        """Fit the newest samples; the change of the forecast begins to fade."""
        newest, last = samples[end - 1], self._newest
        before = None
        if last is not None:
            before, age = self._moving(last, now_ns), (now_ns - last.time_ns) * 1e-9
            self._reach = max(min(age, LONGEST), (1.0 - FORGETTING) * self._reach)
        rows: list[tuple[float, ...]] = []
        place = end - 1
        while place >= 0 and len(rows) < WINDOW:
            sample = samples[place]
            t = (sample.time_ns - newest.time_ns) * 1e-9
            x, y, z = way = self._way(newest.value, sample.value)
            is_far = -t > MEMORY or x * x + y * y + z * z > FARTHEST * FARTHEST
            if rows and (sample.time_ns < self.begin_ns or (is_far and len(rows) > 1)):
                break
            if newest.rate is None:
                rows.append((t, *way))
            elif sample.rate is not None:
                # As the frame of the newest sample sees it.
                once = cross(way, sample.rate)
                seen = plus(plus(sample.rate, once, 0.5), cross(way, once), 1.0 / 12.0)
                rows.append((t, *way, *seen))
            place, latest_ns = place - 1, sample.time_ns - SPACING_NS
            if place >= 0 and samples[place].time_ns > latest_ns:
                place = bisect_right(samples, latest_ns, 0, place, key=time_of) - 1
        self._gap = -rows[-1][0] / max(len(rows) - 1, 1)
        table = Rows(len(rows), len(rows[0]), [number for row in rows for number in row])
        kernels.fit_samples(table.view, TRUST, self._fits.view)
        kernels.mix_fits(self._fits.view, self._scores.view, self._mean)
        self._newest = newest
        if before is not None:
            after = self._moving(newest, now_ns)
            way, speed, change = self._offset
            self._offset = (
                plus(way, self._way(after.value, before.value), 1.0),
                plus(speed, plus(before.rate, after.rate, -1.0), 1.0),
                plus(change, plus(before.change, after.change, -1.0), 1.0),
            )

    def _moving(self, newest: TimedValue, now_ns: int) -> Moving:
        """Return the forecast from the newest sample at an instant, without its last change."""
        t = (now_ns - newest.time_ns) * 1e-9
        tried = min(t, self._reach)
        kernels.read_fit(self._mean, tried, self._read)
        x, y, z, a, b, c, d, e, f, g, h, i = self._read
        way, rate, change, twist = (x, y, z), (a, b, c), (d, e, f), (g, h, i)
        if t > tried:
            # No fit has been tried so far ahead.
            bent = min(t - tried, BENT)
            way = plus(plus(way, rate, t - tried), change, bent * (t - tried - 0.5 * bent))
            rate = plus(rate, change, bent)
            change, twist = change if bent < BENT else ZERO, ZERO
        if self._is_turn:
            # The right Jacobian of the exponential, and its derivative.
            once = cross(way, rate)
            change = plus(plus(change, cross(way, change), -0.5), cross(rate, once), 1.0 / 6.0)
            rate = plus(plus(rate, once, -0.5), cross(way, once), 1.0 / 6.0)
        value = self._moved(newest.value, way)
        return Moving(value, rate, change, plus(ZERO, twist, self._period))

    def _way(self, here: Value, there: Value) -> Vector3:
        if self._is_turn:
            return difference(cast(Quaternion, here), cast(Quaternion, there))
        return plus(cast(Vector3, there), cast(Vector3, here), -1.0)

    def _moved(self, value: Value, way: Vector3) -> Value:
        if self._is_turn:
            return normalize(multiply(cast(Quaternion, value), exp(way)))
        return plus(cast(Vector3, value), way, 1.0)


def _faded(
    offset: tuple[Vector3, Vector3, Vector3], constant: float, period: float
) -> tuple[Vector3, Vector3, Vector3]:
    """Return an offset and its first two derivatives a period later: three equal time constants."""
    way, speed, change = offset
    rate = 1.0 / constant
    first = plus(speed, way, rate)
    second = plus(plus(change, speed, 2.0 * rate), way, rate * rate)
    left = exp_of(-period * rate)
    way = plus(plus(plus(ZERO, way, left), first, left * period), second, 0.5 * left * period**2)
    speed = plus(combine(first, left, second, left * period), way, -rate)
    change = plus(plus(plus(ZERO, second, left), speed, -2.0 * rate), way, -rate * rate)
    return way, speed, change
