"""One velocity with bounded acceleration and jerk: its quickest change and its quickest stop.

The servo needs this law in two forms.  In whole cycles, as the guard differentiates, a velocity
falls by *c*, *c - d*, *c - 2d*, ... to zero.  In continuous time the acceleration falls to a peak,
stays there for a while if the peak is the limit, and rises to zero (a double S).
"""

from __future__ import annotations

from math import floor, sqrt


def first_change(total: float, step: float) -> float:
    """Return the change with which a velocity begins to change by *total* without excess.

    The changes *c, c-d, c-2d, ...* of the cycles to come cover ``(n+1)(c - d n/2)``,
    ``n = floor(c/d)``.

    Args:
        total: of all the changes; not negative.
        step: *d*, how much the jerk lets the change differ from one cycle to the next.
    """
    left = total / step
    whole = floor(0.5 * (sqrt(1.0 + 8.0 * left) - 1.0))
    return (left / (whole + 1) + 0.5 * whole) * step


def stop_phases(
    speed: float, rate: float, acceleration: float, jerk: float
) -> tuple[float, float, float]:
    """Return for how long a stop's acceleration falls, stays and rises, s.

    Args:
        speed: not negative, or becoming so before the acceleration has run out.
        rate: at which the speed changes at first.
        acceleration: limit.
        jerk: limit.
    """
    square = max(jerk * speed + 0.5 * rate * rate, 0.0)
    peak = min(sqrt(square), acceleration)
    held = (square - peak * peak) / (peak * jerk) if peak > 0.0 else 0.0
    return max((rate + peak) / jerk, 0.0), held, peak / jerk


def stop_time(speed: float, rate: float, acceleration: float, jerk: float) -> float:
    """Return how long a stop takes, s; see :func:`stop_phases`."""
    fall, hold, rise = stop_phases(speed, rate, acceleration, jerk)
    return fall + hold + rise


def stopping_angle(speed: float, rate: float, acceleration: float, jerk: float) -> float:
    """Return how far a motion about one axis still turns if it stops as soon as it can, rad.

    Args:
        speed: rad/s, of either sign.
        rate: its acceleration, rad/s^2.
        acceleration: limit, rad/s^2.
        jerk: limit, rad/s^3.
    """
    if speed + 0.5 * rate * abs(rate) / jerk < 0.0:
        return -stopping_angle(-speed, -rate, acceleration, jerk)
    # As stop_phases() says, in one piece: the tracker asks several times a cycle.
    square = max(jerk * speed + 0.5 * rate * rate, 0.0)
    peak = min(sqrt(square), acceleration)
    t = (rate + peak) / jerk
    last = 0.5 * peak * peak / jerk
    angle = t * (speed + t * (0.5 * rate - jerk * t / 6.0)) + last * peak / (3.0 * jerk)
    if peak == acceleration:
        speed += 0.5 * (rate * rate - peak * peak) / jerk
        angle += 0.5 * (speed * speed - last * last) / peak
    return angle
