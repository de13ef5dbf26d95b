r"""The quick stop: how the path clock comes to rest in hardly more time than the limits demand.

The certified law of :mod:`orientd.servo.path_clock` has one brake rate for a whole motion, set by
its worst point.  Here every cycle of a stop takes the least rate that keeps the limits at the point
where the device is (:mod:`orientd.servo.reach`), down to a release in which velocity and
acceleration reach zero together.

Such a law looks at one cycle and could run into a place from which no rate keeps the limits.  So it
is looked ahead first: the same law in larger steps, over the records that are in the ring, until
rest.  Only if that comes to rest is the clock handed over; until then, and wherever it does not,
the certified law brakes, which always works.  A quick stop once begun is carried through to rest.
"""

from __future__ import annotations

from math import ceil, inf, sqrt

from orientd.driver import ZERO, Vector3
from orientd.driver.floats import difference, norm
from orientd.servo.guard import Guard
from orientd.servo.path_clock import PathClock
from orientd.servo.path_follower import PathFollower, StarvedError
from orientd.servo.reach import Ahead, Past, allowed, released
from orientd.servo.segment import PathPoint
from orientd.stream import Terms

SHARES = (0.98, 0.9, 0.75, 0.5)
"""Parts of the limits that a stop is tried with, one in each cycle."""

STEPS = 24
"""Steps that a look ahead is meant to take; twice as many are its end."""

_RETRY = 8  # cycles from one round of tries to the next
_TOLERABLE = 1.0008  # of a limit, where its share is exceeded already; the guard's is 1.001
_RELEASE = 0.9  # of the share of jerk
_NEAR = 0.01  # records; a setpoint so near to its guess is not looked at a second time
_SLACK = 3  # records that a stop may use beyond what was foreseen


class BrakeLaw:
    """A stop of the path clock that uses what the limits leave at each point of the path.

    Args:
        clock: is handed over while a quick stop lasts.
        follower: where the path is.
        guard: what was written.
    """

    def __init__(self, clock: PathClock, follower: PathFollower, guard: Guard) -> None:
        self._clock = clock
        self._follower = follower
        self._guard = guard
        self._share = 1.0
        self._is_coasting = False
        self._tries = 0

    def advance(self, terms: Terms, *, may_end: bool) -> float:
        """Move the clock by one cycle of a stop and return the new rate.

        Args:
            terms: the limits.
            may_end: whether the end of the path is as good as a stop before it.
        """
        clock = self._clock
        if clock.acceleration == 0.0 and not clock.is_led:
            self._tries = 0
        if (not clock.is_led or self._is_coasting) and not self._begin(terms, may_end=may_end):
            return clock.advance()
        if self._is_coasting:
            return clock.rate
        try:
            clock.lead(self._next(terms))
        except StarvedError:
            clock.lead(clock.rate)  # whoever moves on by it meets the same
        return clock.rate

    def _begin(self, terms: Terms, *, may_end: bool) -> bool:
        """Take over the clock if a look ahead comes to rest, or the path's end is near."""
        clock = self._clock
        attempt, self._tries = self._tries, self._tries + 1
        time = inf
        if attempt < len(SHARES) or attempt % _RETRY == 0:
            self._share = SHARES[attempt % len(SHARES)]
            time = self._look_ahead(terms, self._share, may_end=may_end)
        # A path that ends sooner than any stop is left as it is.
        rest = self._follower.records_left() * clock.period / clock.rate
        self._is_coasting = (
            may_end
            and (self._is_coasting if clock.is_led else clock.acceleration == 0.0)
            and rest <= min(time, 1.0 / clock.brake_rate)
        )
        if self._is_coasting or time < inf:
            clock.lead(clock.rate)
        return clock.is_led

    def _next(self, terms: Terms) -> float:
        """Return the least rate that keeps the limits in this cycle."""
        clock, guard, follower = self._clock, self._guard, self._follower
        h = clock.period
        past = Past(guard.omega, guard.alpha, guard.velocity)
        guess = min(max(clock.rate + clock.acceleration * h, 0.0), 1.0)
        rate = guess
        for _ in range(3):
            guess = rate
            point = follower.look(guess)
            omega = _over(difference(guard.q, point.q), ZERO, h)
            velocity = _over(point.position, guard.position, h)
            ahead = Ahead(
                point.omega_body,
                _bend(omega, point.omega_body, guess),
                point.velocity,
                _bend(velocity, point.velocity, guess),
            )
            least = _least(past, ahead, terms, h, self._share, _TOLERABLE)
            rate = clock.rate if least is None else least
            if abs(rate - guess) <= _NEAR:
                break
        return rate if rate > 1e-9 else 0.0

    def _look_ahead(self, terms: Terms, share: float, *, may_end: bool) -> float:
        """Return how long this law takes to rest, s; infinity where it is not sure to get there."""
        clock, follower = self._clock, self._follower
        speed = norm(self._guard.omega)
        expected = max(
            1.2 * speed / terms.acceleration + terms.acceleration / terms.jerk,
            2.2 * sqrt(speed / terms.jerk),
            norm(self._guard.velocity) / terms.linear_acceleration,
        )
        stride = ceil(expected / (STEPS * clock.period))
        period = stride * clock.period
        past = Past(self._guard.omega, self._guard.alpha, self._guard.velocity)
        end = follower.fraction + follower.records_left()
        place, rate, change = follower.fraction, clock.rate, clock.acceleration * period
        for step in range(1, 2 * STEPS + 1):
            guess = min(max(rate + change, 0.0), 1.0)
            there = place + 0.5 * stride * (rate + guess)
            if there >= end:
                return step * period if may_end else inf
            point = _near(follower, there, clock.period)
            if point is None:
                return inf
            ahead = Ahead(point.omega_body, ZERO, point.velocity, ZERO)
            following = _least(past, ahead, terms, period, share, 1.0)
            if following is None:
                return inf
            place += 0.5 * stride * (rate + following)
            if following <= 1e-9:
                last = min(ceil(place) + _SLACK, end)
                is_there = follower.peek_ahead(int(last)) is not None
                return step * period if is_there else inf
            omega = _times(point.omega_body, following)
            past = Past(omega, _over(omega, past.omega, period), _times(point.velocity, following))
            change, rate = following - rate, following
        return inf


def _least(
    past: Past, ahead: Ahead, terms: Terms, period: float, share: float, most: float
) -> float | None:
    """Return the least rate that is allowed and can still be released.

    The share of the limits is exceeded, up to *most*, where nothing else is left.
    """
    wanted = released(past, ahead, terms, period, _RELEASE * share)
    for part, jerk_part in ((share, share), (share, most), (most, most)):
        low, high = allowed(past, ahead, terms, period, part, jerk_part)
        low, high = max(low, 0.0), min(high, 1.0)
        if low <= high:
            return min(max(wanted, low), high)
    return None


def _near(follower: PathFollower, place: float, period: float) -> PathPoint | None:
    """Return the velocities at a place of the path, in records from the present one."""
    index = round(place)
    point = follower.peek_ahead(index)
    if point is None:
        return None
    offset = (place - index) * period
    x, y, z = point.omega_body
    u, v, w = point.alpha_body
    return point._replace(omega_body=(x + u * offset, y + v * offset, z + w * offset))


def _over(a: Vector3, b: Vector3, period: float) -> Vector3:
    return ((a[0] - b[0]) / period, (a[1] - b[1]) / period, (a[2] - b[2]) / period)


def _bend(whole: Vector3, slope: Vector3, rate: float) -> Vector3:
    return (
        whole[0] - slope[0] * rate,
        whole[1] - slope[1] * rate,
        whole[2] - slope[2] * rate,
    )


def _times(a: Vector3, s: float) -> Vector3:
    return (a[0] * s, a[1] * s, a[2] * s)
