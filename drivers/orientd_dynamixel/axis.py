"""One axis of a gimbal: between its angle and the servo's ticks, and what it may do."""

from __future__ import annotations

import math

from orientd_dynamixel.options import AxisOptions

TICKS = 4096
CENTRE = 2048
GOAL_LIMIT = 1_048_575
UNSENDABLE = -131_073
"""The one goal whose bytes hold a packet header, which the SDK cannot send."""


def sendable(goal: int) -> int:
    """Return *goal*, or the tick beside it if it cannot be sent."""
    return goal + 1 if goal == UNSENDABLE else goal


class Axis:
    """Convert angles of the axis to ticks of its servo.

    Attributes:
        options: what it was configured as.
        turns: whole turns of the servo by which its reading is short; it forgets them when it
            starts again.
        goal: ticks last sent, as the servo counts them.
    """

    def __init__(self, options: AxisOptions) -> None:
        self.options = options
        self.turns = 0
        self.goal = CENTRE
        self._scale = options.direction * options.gear * TICKS / (2 * math.pi)

    def angle(self, position: float) -> float:
        """Return the angle, rad, of a position in the servo's ticks."""
        return self.options.zero + (position + self.turns * TICKS - CENTRE) / self._scale

    def ticks(self, angle: float) -> int:
        """Return the goal, in the servo's ticks, nearest to an angle in rad.

        Raises:
            ValueError: the servo cannot count that far.
        """
        exact = CENTRE + (angle - self.options.zero) * self._scale - self.turns * TICKS
        goal = sendable(round(exact))
        if not -GOAL_LIMIT <= goal <= GOAL_LIMIT:
            raise ValueError(f"{self.options.name} cannot go to {goal} ticks")
        return goal

    def rate(self, servo_rate: float) -> float:
        """Return the axis' rate, rad/s, of a servo's rate in rad/s."""
        return servo_rate * self.options.direction / self.options.gear
