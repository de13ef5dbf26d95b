"""The fastest turn about one axis from rest to rest: its jerk is constant in seven phases.

Only velocity, acceleration and jerk along its axis limit such a turn, so the shortest time has a
closed form, the double S (``orientd/kernels/c/double_s.h``).
"""

from __future__ import annotations

import math

import numpy as np

from orientd import kernels
from orientd.curves.axis_turn import AxisTurn
from orientd.model.limits import Limits
from orientd.planner.certify.brake import jerk_to_stop, longest_stop, speed_to_stop
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.rotation import Floats, angle, exp, multiply

SHARE = 0.98
"""Share of acceleration and jerk that timings use.

The rest is for stops on the path, and for the law between two records, which exceeds the jerk where
that has a step.
"""

VELOCITY_SHARE = 0.9995
"""Share of the velocity, for a motion that continues."""

Rates = tuple[float, float, float]
"""Velocity, acceleration and jerk, rad/s, rad/s^2 and rad/s^3."""

_ONE_WAY = 1e-9  # share of the velocity by which it may differ from the one along the axis
_ON_AXIS = 5e-10  # rad; tolerance of a path that is a turn about one axis
_EASED = 2.0 / 3.0  # share of the longest stop from which a motion gets a larger reserve
_SHARES_TO_STOP = 1.0 - np.linspace(0.0, 0.97, 25) ** 2  # of the acceleration, to choose from
_LOOKS = 8  # between two knots
_BISECTIONS = 60
_SAME = 1e-9  # share of a duration


def usable(
    turn: float, velocity: float, acceleration: float, jerk: float, *, is_part: bool = False
) -> Rates:
    """Return how much of its limits the timing of a path uses.

    It is the usual share, unless a stop would then take too long.  Then the reserve is larger, or
    the velocity lower, whichever is faster.  A motion that ends sooner than it could be stopped
    needs no such reserve; from there the reserve grows with the duration.

    Args:
        turn: the length of the path, rad, positive.
        velocity: limit, rad/s.
        acceleration: limit, rad/s^2.
        jerk: limit, rad/s^3; may be infinite, as may that of the velocity.
        is_part: whether the path is part of a longer motion.
    """
    most = VELOCITY_SHARE * velocity, SHARE * acceleration, SHARE * jerk
    rise, hold, cruise = kernels.double_s(turn, *most)
    stop = longest_stop(2.0 * rise + hold)
    weight = ((4.0 * rise + 2.0 * hold + cruise) / stop - _EASED) / (1.0 - _EASED)
    weight = 1.0 if is_part else min(weight, 1.0)
    if weight <= 0.0:
        return most
    pull = most[2] * rise if rise else most[1]
    pulls, highest = pull * _SHARES_TO_STOP, pull * (rise + hold)
    speeds = np.minimum(highest, speed_to_stop(pulls / acceleration, stop) * acceleration)
    jerks = np.minimum(most[2], jerk - jerk_to_stop(speeds, pulls, stop))
    rows = np.stack([speeds, pulls, jerks], axis=1)[jerks > 0.0].tolist()
    best = min(rows, key=lambda row: _duration(turn, *row), default=most)
    if _duration(turn, *best) <= (1.0 + _SAME) * _duration(turn, *most):
        return most
    jerk = best[2]
    if math.isfinite(jerk):
        jerk = (1.0 - weight) * most[2] + weight * jerk
    return (
        (1.0 - weight) * highest + weight * best[0],
        (1.0 - weight) * most[1] + weight * best[1],
        jerk,
    )


def _duration(turn: float, velocity: float, acceleration: float, jerk: float) -> float:
    rise, hold, cruise = kernels.double_s(turn, velocity, acceleration, jerk)
    return 4.0 * rise + 2.0 * hold + cruise


def phases_of_turn(axis: Floats, turn: float, limits: Limits, *, is_part: bool = False) -> Floats:
    """Return the phases of the fastest turn from rest to rest, s.

    Args:
        turn: its angle, rad, positive.
        is_part: whether it is part of a longer motion.
    """
    used = usable(turn, *limits.along(axis.tolist()), is_part=is_part)
    rise, hold, cruise = kernels.double_s(turn, *used)
    return np.array([rise, hold, rise, cruise, rise, hold, rise])


def turned_at_once(keyframe_path: KeyframePath, limits: Limits) -> KeyframePath | None:
    """Return the same path in the shortest time if it is a turn one way about one axis.

    Args:
        keyframe_path: the path.
    """
    is_free = keyframe_path.positions.is_held and math.isfinite(limits.acceleration)
    if not (is_free and keyframe_path.is_from_rest_to_rest):
        return None
    trajectory = keyframe_path.trajectory
    knots = trajectory.knots
    shares = np.arange(_LOOKS) / _LOOKS
    spots = (knots[:-1, None] + shares * np.diff(knots)[:, None]).ravel()
    spots = np.append(spots, keyframe_path.duration)
    q, omega, _ = trajectory.sample(spots)
    speeds = np.sqrt(np.einsum("ij,ij->i", omega, omega))
    axis = omega[int(np.argmax(speeds))] / speeds.max()
    if np.any(omega @ axis < (1.0 - _ONE_WAY) * speeds - _ONE_WAY * speeds.max()):
        return None
    so_far = np.concatenate([[0.0], np.cumsum(angle(q[:-1], q[1:]))])
    # The time at which it has turned as far as the curve at each keyframe.
    keys = trajectory.orientations(keyframe_path.times)
    before = np.clip(np.searchsorted(spots, keyframe_path.times, side="right") - 1, 0, None)
    goal = so_far[before] + angle(q[before], keys)
    turned = multiply(q[0], exp(np.concatenate([so_far, goal])[:, None] * axis))
    if np.any(angle(turned, np.concatenate([q, keys])) > _ON_AXIS):
        return None
    turn = float(so_far[-1])
    found = AxisTurn(q[0], axis, turn, phases_of_turn(axis, turn, limits))
    times = _times(found, goal)
    return KeyframePath(found.trajectory, keyframe_path.positions, times)


def _times(turn: AxisTurn, turns: Floats) -> Floats:
    times: Floats = np.array([0.0, turn.duration])
    if len(turns) == 2:
        return times
    low, high = np.zeros(len(turns)), np.full(len(turns), turn.duration)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        is_late = turn.turned(middle) >= turns
        low, high = np.where(is_late, low, middle), np.where(is_late, middle, high)
    high[0], high[-1] = times
    return high
