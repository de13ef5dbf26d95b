"""One axis of a gimbal: between its angle and the servo's ticks, and where it is believed to be.

A servo now and then reports a position at which it is not.  So a reading is believed only if the
servo can be there: with its torque on it is between where it was last seen and where it was sent
since, and with its torque off it has turned no faster than it can by hand.  A reading that is not
believed changes nothing, and no goal ever comes from one.
"""

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


NEAR = TICKS // 8
"""A servo that nobody watched may have moved this far, ticks: 45 degrees."""
_PLAY_TICKS = 24
"""Backlash, overshoot and rounding."""
_MARGIN = 1.5
_AGE_S = 0.008
"""How old a reading may be when it arrives."""


class Axis:
    """Convert angles of the axis to ticks of its servo.

    Attributes:
        options: what it was configured as.
        turns: whole turns of the servo by which its reading is short; it forgets them when it
            starts again.
        position: where the servo is believed to be, in its ticks; ``None`` before it is known.
        seen_ns: when it was last seen there.
        play: how far a reading may be from where the servo can be, ticks.
    """

    def __init__(self, options: AxisOptions) -> None:
        self.options = options
        self.turns = 0
        self._goal = self._low = self._high = CENTRE
        self.position: int | None = None
        self.seen_ns = 0
        self._most = _MARGIN * options.velocity * options.gear * TICKS / (2 * math.pi)
        self.play = _PLAY_TICKS + self._most * _AGE_S
        self._scale = options.direction * options.gear * TICKS / (2 * math.pi)

    @property
    def goal(self) -> int:
        """Ticks last sent, as the servo counts them."""
        return self._goal

    @goal.setter
    def goal(self, goal: int) -> None:
        self._goal = goal
        self._low, self._high = min(self._low, goal), max(self._high, goal)

    def believe(self, position: int, now_ns: int) -> None:
        """Take *position*, in ticks, as where the servo is."""
        self.position, self.seen_ns = position, now_ns
        self._low, self._high = min(position, self._goal), max(position, self._goal)

    def doubt(self, position: int, *, is_driven: bool, now_ns: int | None = None) -> str:
        """Return why the servo cannot be at *position*, or nothing where it can.

        Args:
            position: as it reports, ticks.
            is_driven: whether its torque is on.
            now_ns: when it was asked; ``None`` where it may have been turned by hand for any time.
        """
        ahead = position - self._goal
        if is_driven and _is_turns_away(ahead, self.play):
            return f"reports a jump of {abs(ahead)} ticks from its goal"
        if self.position is None:
            return ""
        jump = position - self.position
        if is_driven:
            is_possible = self._low - self.play <= position <= self._high + self.play
        elif now_ns is not None:
            reach = self.play + self._most * max(0, now_ns - self.seen_ns) * 1e-9
            is_possible = abs(jump) <= min(reach, NEAR)
        else:
            # By hand it comes to any angle, but hardly to the same one after whole turns.
            is_possible = not _is_turns_away(jump, self.play)
        return "" if is_possible else f"reports a jump of {abs(jump)} ticks"

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


def _is_turns_away(jump: float, play: float) -> bool:
    """Return whether a *jump* is one by whole turns, give or take *play*, ticks."""
    turns = round(jump / TICKS)
    return turns != 0 and abs(jump - turns * TICKS) <= play
