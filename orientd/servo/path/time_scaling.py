r"""The time scaling: how fast the setpoint moves along its path, and how that may change.

The rate sigma is 1 as planned, 0 at rest.  It changes with bounded acceleration and jerk,
:math:`|\dot\sigma| \le 2x` and :math:`|\ddot\sigma| \le 4x^2` for the motion's brake rate *x*.  So
a stop from full speed takes :math:`1/x` seconds with a triangular :math:`\dot\sigma`.  The planner
has certified that every change of this kind keeps the motion's limits at every point of the path
(``planner/certify/brake.py``).
"""

from __future__ import annotations

from math import copysign

from orientd import kernels
from orientd.stream.records import records_to_stop


class TimeScaling:
    """The rate sigma and its acceleration, advanced by one cycle at a time.

    Attributes:
        rate: present rate; 1 is as planned.
        acceleration: its derivative over the last cycle, 1/s.
        target: the rate it is moving to.
        plan: rates of the next cycles, the last one first, chosen by a quick stop
            (:mod:`orientd.servo.path.quick_stop`); empty if there is none.
        moves: number of times it was moved, started or halted.
        brake_rate: a stop from full speed takes ``1 / brake_rate`` seconds; 1/s.
    """

    def __init__(self, period: float) -> None:
        """Create it at rest.  *period* is the cycle in seconds."""
        self.period = period
        self.rate = 0.0
        self.acceleration = 0.0
        self.target = 0.0
        self.plan: list[float] = []
        self.moves = 0
        self.brake_rate = 0.0

    def begin(self, brake_rate: float, target: float) -> None:
        """Run at *target* at once, which is smooth only if the path itself is at rest."""
        self.brake_rate = brake_rate
        self.target = target
        self.rate = target
        self.acceleration = 0.0
        self.plan = []
        self.moves += 1

    def halt(self) -> None:
        """Set the rate to zero at once: the path has ended, or is no longer in use."""
        self.rate = self.acceleration = self.target = 0.0
        self.plan = []
        self.moves += 1

    @property
    def braking_cycles(self) -> int:
        """Number of path records that a stop from any rate may still use."""
        return records_to_stop(self.brake_rate, self.period) if self.brake_rate else 0

    @property
    def is_steady(self) -> bool:
        """Whether the rate has reached its target and stays there."""
        return self.acceleration == 0.0 and self.rate == self.target

    @property
    def is_at_rest(self) -> bool:
        """Whether the rate is zero and stays zero."""
        return self.rate == 0.0 and self.target == 0.0

    def advance(self) -> float:
        """Advance by one cycle and return the new rate, in path records per cycle."""
        self.moves += 1
        if self.plan:
            before, self.rate = self.rate, self.plan.pop()
            self.acceleration = (self.rate - before) / self.period if self.rate > 0.0 else 0.0
            return self.rate
        difference = self.target - self.rate
        if difference == 0.0 and self.acceleration == 0.0:
            return self.rate
        most, step = 2.0 * self.brake_rate, 4.0 * self.brake_rate * self.brake_rate * self.period
        # The fastest change from which the rate can still come down in time.
        wanted = copysign(kernels.first_change(abs(difference) / self.period, step), difference)
        highest = min(self.acceleration + step, most)
        lowest = max(self.acceleration - step, -most)
        self.acceleration = min(max(wanted, lowest), highest)
        rate = self.rate + self.acceleration * self.period
        if abs(self.target - rate) <= 1e-12:
            rate = self.target
        self.rate = min(max(rate, 0.0), 1.0)
        return self.rate
