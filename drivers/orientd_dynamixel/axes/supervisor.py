"""Whether every servo does what it is told, from what it reports each cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence

from orientd.errors import DeviceFaultError
from orientd_dynamixel.axis import TICKS, Axis
from orientd_dynamixel.bus import WATCHDOG_TRIPPED, Reading, explain_error
from orientd_dynamixel.options import GimbalOptions

_ANGLE_SLACK = math.radians(0.5)
_SLACK = 1.05
"""How far above a limit a step may be, as a factor, and a tick more: goals are whole ticks."""
_TICK = 2 * math.pi / TICKS


class Supervisor:
    """Compare readings with what was commanded.

    Args:
        options: the tolerances.
        axes: with their goals.
    """

    def __init__(self, options: GimbalOptions, axes: Sequence[Axis]) -> None:
        self._options = options
        self._axes = axes
        self._apart_since_ns = [0] * len(axes)

    def complain(self, place: int, reading: Reading, now_ns: int) -> str:
        """Return what is wrong with the servo of the axis at *place*, or nothing."""
        axis = self._axes[place]
        servo = f"servo {axis.options.id} ({axis.options.name})"
        if reading.hardware_error:
            return f"{servo} reports {explain_error(reading.hardware_error)}"
        if reading.watchdog == WATCHDOG_TRIPPED:
            return f"{servo} stopped because nothing was sent for too long"
        if not reading.is_torque_on:
            return f"{servo} has lost its torque"
        apart = abs(axis.angle(reading.position) - axis.angle(axis.goal))
        if apart <= self._options.follow_tolerance:
            self._apart_since_ns[place] = 0
        elif not self._apart_since_ns[place]:
            self._apart_since_ns[place] = now_ns
        elif now_ns - self._apart_since_ns[place] > self._options.follow_time * 1e9:
            return (
                f"{servo} does not follow: it is {math.degrees(apart):.1f} deg behind for "
                f"more than {self._options.follow_time:g} s; is it jammed or overloaded?"
            )
        return ""


def check_angle(axis: Axis, angle: float) -> None:
    """Refuse an angle outside the limits of *axis*.

    Raises:
        DeviceFaultError: it is, by more than the servo's play.
    """
    options = axis.options
    if not options.low - _ANGLE_SLACK <= angle <= options.high + _ANGLE_SLACK:
        raise DeviceFaultError(
            f"{options.name} would be at {math.degrees(angle):.2f} deg, allowed are "
            f"{math.degrees(options.low):.2f} to {math.degrees(options.high):.2f} deg"
        )


def complain_of_step(axis: Axis, angle: float, last: float, rate: float | None, span: float) -> str:
    """Return why *axis* must not turn from *last* to *angle* within a cycle, or nothing.

    Args:
        axis: the limits.
        angle: rad.
        last: angle commanded before, rad.
        rate: at which it turned there, rad/s; ``None`` where it is not known.
        span: since then, s.
    """
    options, step = axis.options, angle - last
    if abs(step) > options.velocity * span * _SLACK + _TICK:
        return (
            f"{options.name} would have to turn at {math.degrees(abs(step) / span):.0f} deg/s, at "
            f"most {math.degrees(options.velocity):.0f} deg/s are allowed"
        )
    if rate is not None:
        change = abs(step - rate * span)
        if change > options.acceleration * span * span * _SLACK + _TICK:
            return (
                f"{options.name} would have to accelerate by "
                f"{math.degrees(change / span**2):.0f} deg/s^2, at most "
                f"{math.degrees(options.acceleration):.0f} deg/s^2 are allowed"
            )
    return ""
