r"""The quick stop: how the path clock comes to rest in hardly more time than the limits demand.

The certified law of :mod:`orientd.servo.path_clock` has one brake rate for a whole motion, set by
its worst point.  Here every cycle of a stop takes the least rate that keeps the limits at the point
where the device is (:mod:`orientd.servo.reach`), down to a release in which velocity and
acceleration reach zero together.

Such a law looks at one cycle and could run into a place from which no rate keeps the limits.  So
the whole stop is rehearsed first, cycle by cycle over the records that are in the ring
(:mod:`orientd.servo.rehearsal`), with one share of the limits after the other.  What comes to rest
there is carried out as it was rehearsed; until then, and wherever nothing does, the certified law
brakes, which always works.  A long stop is rehearsed in several cycles, from where the certified
law will be by then.
"""

from __future__ import annotations

from math import ceil, sqrt

from orientd.driver.floats import norm
from orientd.servo.guard import Guard
from orientd.servo.path_clock import PathClock
from orientd.servo.path_follower import PathFollower
from orientd.servo.rehearsal import Outcome, Rehearsal
from orientd.stream import Terms

SHARES = (0.98, 0.9, 0.75, 0.5)
"""Parts of the limits that a stop is rehearsed with, one after the other."""

STEPS_PER_SECOND = 16_000.0
"""Cycles of a stop that are rehearsed in one second: few enough to leave most of a cycle free."""

FEWEST_STEPS = 8

_ALLOWANCE = 1.2  # times the cycles expected
_MOST = 8.0  # times them, where they have proved too few


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
        self._steps = max(FEWEST_STEPS, round(STEPS_PER_SECOND * clock.period))
        self._is_coasting = False
        self._moves = -1
        self._taken = 0
        self._tries = 0
        self._allowance = _ALLOWANCE
        self._rehearsal: Rehearsal | None = None
        self._rates: list[float] = []

    def advance(self, terms: Terms, *, may_end: bool) -> float:
        """Move the clock by one cycle of a stop and return the new rate.

        Args:
            terms: the limits.
            may_end: whether the end of the path is as good as a stop before it.
        """
        clock = self._clock
        if clock.moves != self._moves:
            self._renew(may_end=may_end)
        if not self._rates:
            self._rehearse(terms, may_end=may_end)
        if self._rates:
            clock.lead(self._rates.pop())
        elif self._is_coasting:
            clock.lead(clock.rate)
        else:
            clock.advance()
        self._moves = clock.moves
        return clock.rate

    def _renew(self, *, may_end: bool) -> None:
        """Begin with another stop."""
        clock = self._clock
        self._tries, self._allowance = 0, _ALLOWANCE
        self._rehearsal, self._rates = None, []
        # A path that ends sooner than the certified stop is left as it is.
        rest = self._follower.records_left() * clock.period / clock.rate
        is_even = clock.acceleration == 0.0
        self._is_coasting = may_end and is_even and rest <= 1.0 / clock.brake_rate

    def _rehearse(self, terms: Terms, *, may_end: bool) -> None:
        """Go on with the rehearsal, or with others, as far as one cycle allows."""
        left = self._steps
        while left > 0:
            rehearsal = self._rehearsal
            if rehearsal is None:
                rehearsal = self._rehearsal = self._begin(terms)
                self._taken = 0
            left -= rehearsal.go_on(terms, left, may_end=may_end)
            outcome = rehearsal.outcome
            if outcome is Outcome.FAILED:
                self._rehearsal = None
                self._tries += 1
                left -= 1
            elif outcome is not Outcome.UNFINISHED:
                break
        rehearsal = self._rehearsal
        if rehearsal is None:
            return
        if self._taken < rehearsal.lead:
            self._taken += 1
        elif rehearsal.outcome is Outcome.UNFINISHED:
            self._allowance = min(2.0 * self._allowance, _MOST)
            self._rehearsal = None
        else:
            self._rates = rehearsal.rates[self._taken :][::-1]
            self._rehearsal = None

    def _begin(self, terms: Terms) -> Rehearsal:
        """Rehearse with the next share, from where the device is when that is over."""
        speed = norm(self._guard.omega)
        time = max(
            speed / terms.acceleration + terms.acceleration / terms.jerk,
            2.0 * sqrt(speed / terms.jerk),
            norm(self._guard.velocity) / terms.linear_acceleration,
        )
        cycles = self._allowance * time / self._clock.period + 4.0
        return Rehearsal(
            self._clock,
            self._follower,
            self._guard,
            lead=ceil(cycles / (self._steps - 1)) - 1,
            share=SHARES[self._tries % len(SHARES)],
            is_coasting=self._is_coasting,
        )
