"""Whether an axis may turn by a step within its limits."""

from __future__ import annotations

import math

from orientd_dynamixel.options import AxisOptions

SLACK = 1.05
"""How far above a limit a step of an axis may be, as a factor; goals are whole ticks besides."""
TICK = 2 * math.pi / 4096
"""One tick of a servo, rad."""


def complain_of_step(
    axis: AxisOptions, step: float, rate: float | None, span: float, slack: float, least: float
) -> str:
    """Return why *axis* must not turn by *step* within *span* seconds, or nothing.

    Args:
        axis: the limits.
        step: from the angle commanded before, rad.
        rate: at which it turned there, rad/s; ``None`` where it is not known.
        span: since then, s.
        slack: how far above its limit the acceleration may be, as a factor; the rate always by
            :data:`SLACK`.
        least: rad, by which a step may be more than that.
    """
    if abs(step) > axis.velocity * span * SLACK + least:
        return (
            f"{axis.name} would have to turn at {math.degrees(abs(step) / span):.0f} deg/s, at "
            f"most {math.degrees(axis.velocity):.0f} deg/s are allowed"
        )
    if rate is not None:
        change = abs(step - rate * span)
        if change > axis.acceleration * span * span * slack + least:
            return (
                f"{axis.name} would have to accelerate by "
                f"{math.degrees(change / span**2):.0f} deg/s^2, at most "
                f"{math.degrees(axis.acceleration):.0f} deg/s^2 are allowed"
            )
    return ""
