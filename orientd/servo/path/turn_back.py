r"""The way to a place where the path turns back: as slow as still leads beyond it.

Along the direction in which the device moves, the path ends where it turns back, and what is to
come past that place has no velocity along it there, and has some all the way to it.  What braking
has built up of the acceleration falls by at most *d* a cycle (in units of velocity, as the jerk
allows), so that the velocities after *v* now and :math:`v_0` in the next cycle are

.. math::
    v_n = v_0 + n (v_0 - v) + d \, n (n + 1) / 2 .

Where that is zero, :math:`v_0 + v_1 + \dots + v_n`, times the period, has to be what is left of
the way, *D*.  Both together leave one equation for *n*, whose smallest root is the one,

.. math::
    D / h = v n / 2 - d \, n (n + 1)(n + 2) / 12 .
"""

from __future__ import annotations

from orientd.driver import Vector3
from orientd.servo.path.segment import Law

_ITERATIONS = 4
_BISECTIONS = 24
_MISSED = 0.0625  # of what the velocity changes by in a cycle


class TurnBackPoint:
    """The next place where the path turns back, looked for from record to record.

    Attributes:
        axis: unit vector along which the device comes there.
        place: records to it, or to where it was looked for.
        way: angle to that along the axis, in units of the period, rad/s.
        is_found: whether it is there.
    """

    def __init__(self, axis: Vector3, index: int) -> None:
        """Begin with a record."""
        self.axis = axis
        self.place = float(index)
        self.way = 0.0
        self.is_found = False

    def look(self, piece: Law) -> None:
        """Look for it between the record so far and the next.

        Args:
            piece: angle from the first of them on, in units of the period, rad/s.
        """
        if dot(piece.rate(1.0), self.axis) > 0.0:
            self.way += dot(piece.value(1.0), self.axis)
            self.place += 1.0
            return
        low, high = 0.0, 1.0
        for _ in range(_BISECTIONS):
            u = 0.5 * (low + high)
            if dot(piece.rate(u), self.axis) > 0.0:
                low = u
            else:
                high = u
        self.way += dot(piece.value(low), self.axis)
        self.place += low
        self.is_found = True

    def come(self, angle: Vector3) -> None:
        """Note what is left of the way behind an angle, in units of the period."""
        self.way -= dot(angle, self.axis)

    def slowest(self, speed: float, step: float, until: float) -> float | None:
        """Return the least velocity along the axis in the next cycle that leads to the turn.

        No setpoint need be where the path turns: a continuous motion through those on both sides
        comes further than either, by up to an eighth of what the velocity changes by in a cycle,
        times the period.  Half of that is counted on.

        Args:
            speed: along the axis in the cycle before, rad/s.
            step: how much the velocity's change may change from cycle to cycle, rad/s.
            until: cycles before the turn, less than which it is passed as it comes.

        Returns:
            The velocity; zero where a stop is possible before the turn, or ``None`` where the turn
            is as near as that.
        """
        if speed <= 0.0:
            return None
        n = 2.0 * self.way / speed
        if n <= until:
            return None
        way = self.way - _MISSED * speed / n
        for _ in range(_ITERATIONS):
            slope = 0.5 * speed - step * ((3.0 * n + 6.0) * n + 2.0) / 12.0
            if slope <= 0.0:
                return 0.0
            n += (way - 0.5 * speed * n + step * n * (n + 1.0) * (n + 2.0) / 12.0) / slope
        return speed * n / (n + 1.0) - 0.5 * step * n


def dot(a: Vector3, b: Vector3) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
