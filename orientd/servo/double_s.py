"""Stops about one axis with limited acceleration and jerk, in whole cycles and in continuous time.

A stop in whole cycles changes the velocity by *c*, *c - d*, *c - 2d*, ..., where *d* is what the
jerk allows: :func:`first_change`.  Between samples this chain equals an integrator with constant
jerk, for the shifted quantities ``omega - h alpha / 2`` and ``e + h omega - h^2 alpha / 6`` (h: the
period, e: the remaining angle).  With them the formulas of continuous time are exact at any rate:
:func:`stop_phases`, :func:`stopping_angle`.
"""

from __future__ import annotations

from math import floor, sqrt


def first_change(total: float, step: float) -> float:
    """Return the first of the changes by which a velocity changes by *total* without overshoot.

    The changes *c, c-d, c-2d, ...* of the next cycles sum up to ``(n+1)(c - d n/2)``, ``n =
    floor(c/d)``.

    Args:
        total: sum of all the changes; not negative.
        step: *d*, the largest difference of changes in two cycles, by the jerk.
    """
    left = total / step
    whole = floor(0.5 * (sqrt(1.0 + 8.0 * left) - 1.0))
    return (left / (whole + 1) + 0.5 * whole) * step


def stop_phases(
    speed: float, rate: float, acceleration: float, jerk: float
) -> tuple[float, float, float]:
    """Return the durations of falling, constant and rising acceleration in a stop, s.

    Args:
        speed: not negative, or becoming so before the acceleration has run out.
        rate: initial rate of the speed.
        acceleration: limit.
        jerk: limit.
    """
    square = max(jerk * speed + 0.5 * rate * rate, 0.0)
    peak = min(sqrt(square), acceleration)
    held = (square - peak * peak) / (peak * jerk) if peak > 0.0 else 0.0
    return max((rate + peak) / jerk, 0.0), held, peak / jerk


def stopping_angle(speed: float, rate: float, acceleration: float, jerk: float) -> float:
    """Return the remaining turn of a motion about one axis that stops as soon as it can, rad.

    Args:
        speed: rad/s, of either sign.
        rate: its acceleration, rad/s^2.
        acceleration: limit, rad/s^2.
        jerk: limit, rad/s^3.
    """
    if speed + 0.5 * rate * abs(rate) / jerk < 0.0:
        return -stopping_angle(-speed, -rate, acceleration, jerk)
    first, held, last = stop_phases(speed, rate, acceleration, jerk)
    peak = last * jerk
    angle = first * (speed + first * (0.5 * rate - jerk * first / 6.0))
    return angle + peak * (0.5 * held * (last + held) + last * last / 6.0)
