"""Predict an orientation or a point shortly ahead, from stamped samples of it.

Samples arrive 10 to 250 times a second, late and with noise.  A Kalman filter of the motion and its
derivatives predicts it.  White noise drives the highest derivative (Bar-Shalom, Li and Kirubarajan,
Estimation with Applications to Tracking and Navigation, 2001, 6.2).  The three axes share one
covariance.  If samples have a rate, from a gyroscope for example, the filter is one of the rate.

The filter learns the noise of the samples.  Successive surprises in the same direction mean that
it is too slow, alternating ones that it follows the noise (Mehra 1970).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import exp as exp_of
from math import factorial, pi, sqrt
from typing import Generic, TypeVar

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import difference, dot, exp, multiply, norm, normalize, plus

Place = TypeVar("Place", Quaternion, Vector3)

POWER = 1e7
"""Power spectral density of the fifth derivative of the angle, (rad/s^5)^2/Hz.

Only its ratio to the noise counts.  With the least noise the filter follows motion of 2 Hz.
"""

LEAST_RATE_NOISE = 2e-4
"""Least assumed standard deviation of the rate of a sample about each axis, rad/s."""

MOST_RATE_NOISE = 1e3

LEAST_NOISE = 2e-5
"""Least assumed standard deviation of a sample without rate, rad."""

MOST_NOISE = 1e2
"""Largest assumed ones.  They average for seconds, because only the ratio to the power counts."""

LEARNING = 0.25
"""Change of the logarithm of the noise variance with one surprise."""

SMOOTHING = 0.2
"""Mean cosine between successive surprises at which the noise stays: it prefers to average."""

SPREADS = (0.0, 2.0, 10.0, 100.0, 1000.0)
"""Standard deviations of the unknown first to fourth derivatives, rad/s to rad/s^4."""

GATE = 5.0
"""Standard deviations from which the rate of a sample begins another motion, in addition to a
change of :data:`LARGEST_CHANGE`."""

LARGEST_CHANGE = 40.0
"""Largest plausible surprise of the rate per time between two samples, rad/s^2."""

JUMP = 0.1
"""Surprise from which a sample begins another motion, rad."""

LONGEST_NS = 250_000_000
"""Longest spacing of samples that belong together.  A place without rate is at rest after that."""

STILL = 1e-4
"""Estimated rate below which a place without rate is at rest, rad/s."""

BENT = 0.08
"""Time after the newest sample from which the rate is held constant, s."""

DEGREES = 180.0 / pi
SIMILAR = 0.2
"""How far the rates may be from :data:`DEGREES` times too large, relative to that."""

COMPARED = 20
"""Samples over which rates are compared with the places."""

CORRELATED = 0.95
"""Least correlation of rates and places at which their ratio counts."""

_NOTHING = 1e-12


class Derivatives:
    """A Kalman filter of a quantity with three components and its derivatives.

    Attributes:
        state: the quantity and its derivatives, lowest first.
    """

    def __init__(self, spreads: tuple[float, ...], least: float, most: float) -> None:
        """Create it without a sample.

        Args:
            spreads: standard deviations of the initial state; the first one does not count.
            least: least standard deviation of a sample.
            most: largest one.
        """
        self._spreads = spreads
        self._least, self._most = least * least, most * most
        self._noise = 9.0 * self._least
        self.begin(ZERO)

    def begin(self, first: Vector3) -> None:
        """Begin with one sample; the learned noise stays."""
        n = len(self._spreads)
        self.state: list[Vector3] = [first, *[ZERO] * (n - 1)]
        variances = [self._noise, *(x * x for x in self._spreads[1:])]
        self._covariance = [[variances[i] if i == j else 0.0 for j in range(n)] for i in range(n)]
        self._surprise = ZERO

    def advance(self, t: float) -> None:
        """Predict the state *t* seconds later."""
        n, p = len(self._spreads), self._covariance
        step = [t**k / factorial(k) for k in range(n)]
        self.state = [_series(self.state[i:], t) for i in range(n)]
        half = [
            [sum(step[k - i] * p[k][j] for k in range(i, n)) for j in range(n)] for i in range(n)
        ]
        self._covariance = [
            [
                sum(step[k - j] * half[i][k] for k in range(j, n)) + _driven(n, i, j, t)
                for j in range(n)
            ]
            for i in range(n)
        ]

    def correct(self, surprise: Vector3) -> None:
        """Correct the state by the difference of a sample from its prediction."""
        p = self._covariance
        agreement = sum(x * y for x, y in zip(surprise, self._surprise, strict=True))
        cosine = agreement / (norm(surprise) * norm(self._surprise) + _NOTHING)
        noise = self._noise * exp_of(LEARNING * (SMOOTHING - cosine))
        self._noise = noise = min(max(noise, self._least), self._most)
        total = p[0][0] + noise
        gains = [row[0] / total for row in p]
        self.state = [plus(x, surprise, g) for x, g in zip(self.state, gains, strict=True)]
        first = p[0]
        self._covariance = [
            [x - g * y for x, y in zip(row, first, strict=True)]
            for row, g in zip(p, gains, strict=True)
        ]
        self._surprise = surprise

    @property
    def deviation(self) -> float:
        """Expected length of a surprise, after :meth:`advance`."""
        return sqrt(3.0 * (self._covariance[0][0] + self._noise))


class RateCheck:
    """Compare the rates of samples with the change of their places.

    Both are least squares over the newest samples.  Noise of the places does not correlate with the
    rates, so it decides nothing.
    """

    def __init__(self) -> None:
        """Know no sample yet."""
        self._along = self._turned = self._rated = 0.0
        self._samples = 0

    def note(self, change: Vector3, expected: Vector3) -> None:
        """Note a change of the place, and the change that the rates say."""
        self._samples += 1
        self._along += dot(change, expected) - self._along / COMPARED
        self._turned += dot(change, change) - self._turned / COMPARED
        self._rated += dot(expected, expected) - self._rated / COMPARED

    @property
    def ratio(self) -> float:
        """How many times too large the rates are; 1 unless that is about degrees to radians."""
        if self._samples < COMPARED or min(self._turned, self._rated) <= STILL * STILL:
            return 1.0
        if self._along < CORRELATED * sqrt(self._turned * self._rated):
            return 1.0
        ratio = self._rated / self._along
        for unit in (DEGREES, 1.0 / DEGREES):
            if abs(ratio / unit - 1.0) < SIMILAR:
                return ratio
        return 1.0


class Predictor(Generic[Place]):
    """Predict a place, an orientation or a point, from stamped samples.

    Attributes:
        time_ns: time of the newest sample, monotonic clock; 0 without a sample.
        rates: whether the rates of the samples fit the places.
    """

    def __init__(
        self,
        between: Callable[[Place, Place], Vector3],
        moved: Callable[[Place, Vector3], Place],
        size: float = 1.0,
    ) -> None:
        """Create it without a sample.

        Args:
            between: returns the displacement from one place to another.
            moved: returns a place after a displacement.
            size: displacement that corresponds to 1 rad: the distance of a point, m.
        """
        self._between: Callable[[Place, Place], Vector3] = between
        self._moved: Callable[[Place, Vector3], Place] = moved
        self._size = size
        self._rates = Derivatives(SPREADS[1:], LEAST_RATE_NOISE, MOST_RATE_NOISE)
        self._places = Derivatives(SPREADS, LEAST_NOISE, MOST_NOISE)
        self._has_rate = False
        self._place: Place | None = None
        self._sample: tuple[Place, Vector3, int] | None = None
        self.time_ns = 0
        self.rates = RateCheck()

    def take(self, place: Place, rate: Vector3 | None, time_ns: int) -> bool:
        """Accept a sample.

        Args:
            place: orientation or point.
            rate: its rate of change in its own frame, rad/s or m/s; ``None`` to estimate it.
            time_ns: time of the sample.

        Returns:
            Whether it is newer than the samples before, and the rates fit the places.
        """
        if self._place is not None and time_ns <= self.time_ns:
            return False
        if rate is not None:
            rate = plus(ZERO, rate, 1.0 / self._size)
        self._compare(place, rate, time_ns)
        if self.rates.ratio != 1.0:
            return False
        if not self._continues(place, rate, time_ns):
            self._place, self._has_rate = place, rate is not None
            (self._places if rate is None else self._rates).begin(rate or ZERO)
        self.time_ns = time_ns
        return True

    def _compare(self, place: Place, rate: Vector3 | None, time_ns: int) -> None:
        """Compare the rates of this sample and the one before with the change between them."""
        before, self._sample = self._sample, None if rate is None else (place, rate, time_ns)
        if before is None or rate is None or not 0 < time_ns - before[2] <= LONGEST_NS:
            return
        change = plus(ZERO, self._between(before[0], place), 1.0 / self._size)
        expected = plus(before[1], rate, 1.0)
        self.rates.note(change, plus(ZERO, expected, 0.5e-9 * (time_ns - before[2])))

    def _continues(self, place: Place, rate: Vector3 | None, time_ns: int) -> bool:
        """Whether a sample continues the motion of the samples before; if so, take it."""
        gap_ns = time_ns - self.time_ns
        if self._place is None or gap_ns > LONGEST_NS or self._has_rate is (rate is None):
            return False
        seconds = gap_ns * 1e-9
        expected = self._carried(self._place, seconds)
        surprise = plus(ZERO, self._between(expected, place), 1.0 / self._size)
        if norm(surprise) > JUMP:
            return False
        if rate is None:
            # The state is relative to the filtered place.
            kalman = self._places
            kalman.advance(seconds)
            kalman.state[0] = ZERO
            kalman.correct(surprise)
            self._place = self._moved(expected, plus(ZERO, kalman.state[0], self._size))
            kalman.state[0] = ZERO
            return True
        kalman = self._rates
        kalman.advance(seconds)
        change = plus(rate, kalman.state[0], -1.0)
        if norm(change) > GATE * kalman.deviation + LARGEST_CHANGE * seconds:
            return False
        kalman.correct(change)
        self._place = place
        return True

    def at(self, time_ns: int) -> tuple[Place, Vector3]:
        """Return the place at a time, and its rate in its own frame; rad/s or m/s.

        Raises:
            ValueError: there is no sample.
        """
        if self._place is None:
            raise ValueError("expected a sample before a prediction")
        ahead_ns = time_ns - self.time_ns
        if not self._has_rate and ahead_ns > LONGEST_NS:
            return self._place, ZERO
        ahead = ahead_ns * 1e-9
        rate = _series(self._derivatives, min(ahead, BENT))
        if not self._has_rate and norm(rate) < STILL:
            return self._place, ZERO
        return self._carried(self._place, ahead), plus(ZERO, rate, self._size)

    @property
    def _derivatives(self) -> list[Vector3]:
        """The rate and its derivatives at the newest sample."""
        return self._rates.state if self._has_rate else self._places.state[1:]

    def _carried(self, place: Place, ahead: float) -> Place:
        """Return *place* carried on from the newest sample for *ahead* seconds."""
        bent = min(ahead, BENT)
        derivatives: list[Vector3] = self._derivatives
        way = _series([ZERO, *derivatives], bent)
        place = self._moved(place, plus(ZERO, way, self._size))
        if ahead > bent:
            rate = _series(derivatives, bent)
            place = self._moved(place, plus(ZERO, rate, (ahead - bent) * self._size))
        return place


def turning() -> Predictor[Quaternion]:
    """Return a predictor of orientations; rates are in the orientation's own frame."""
    return Predictor(difference, lambda q, way: normalize(multiply(q, exp(way))))


def moving(distance: float) -> Predictor[Vector3]:
    """Return a predictor of points that are seen from a *distance*, m."""
    return Predictor(lambda a, b: plus(b, a, -1.0), lambda a, way: plus(a, way, 1.0), distance)


def _series(derivatives: Sequence[Vector3], t: float) -> Vector3:
    """Return the Taylor polynomial of a value and its derivatives, *t* seconds later."""
    total, factor = ZERO, 1.0
    for k, derivative in enumerate(derivatives):
        total = plus(total, derivative, factor)
        factor *= t / (k + 1)
    return total


def _driven(n: int, i: int, j: int, t: float) -> float:
    """Return the covariance that the noise in the highest derivative adds in *t* seconds."""
    power = 2 * n - 1 - i - j
    return POWER * t**power / (power * factorial(n - 1 - i) * factorial(n - 1 - j))
