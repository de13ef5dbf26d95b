"""The fastest turn about one axis from rest to rest: its jerk is constant in seven phases.

Only velocity, acceleration and jerk along its axis limit such a turn, so the shortest time has a
closed form (the double S; Biagiotti and Melchiorri 2008, section 3.4).
"""

from __future__ import annotations

import math

import numpy as np

from orientd.curves.axis_turn import AxisTurn
from orientd.model.limits import Limits
from orientd.planner.certify.brake import jerk_to_stop, longest_stop, share_to_stop, speed_to_stop
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.rotation import Floats, angle, exp, multiply

SHARE = 0.999
"""Share of acceleration and jerk that the fastest timing uses; the rest is for stops."""

CAREFUL_JERK_SHARE = 0.994
"""Share of the jerk if it changes its sign between two records.

The interpolation between them then exceeds it by up to 0.53 %.
"""

VELOCITY_SHARE = 0.9998
"""Share of the velocity, for a motion that continues."""

LEAST_SHARE = 0.2
"""Shares below which a timing would no longer be the fastest."""

_ONE_WAY = 1e-9  # share of the velocity by which it may differ from the one along the axis
_ON_AXIS = 5e-10  # rad; tolerance of a path that is a turn about one axis
_EASED = 2.0 / 3.0  # share of the longest stop from which a motion gets some reserve
_MUCH = 0.95  # of the acceleration
_SHARES_TO_STOP = 1.0 - np.linspace(0.0, 0.97, 25) ** 2  # of the acceleration, to choose from
_LOOKS = 8  # between two knots
_BISECTIONS = 60


def double_s(distance: float, velocity: float, acceleration: float, jerk: float) -> Floats:
    """Return durations of the seven phases of the fastest motion from rest to rest, s.

    Args:
        distance: to cover.
        velocity: largest; may be infinite.
        acceleration: largest, finite.
        jerk: largest; may be infinite.
    """
    rise, hold, cruise = _durations(distance, velocity, acceleration, jerk)
    return np.array([rise, hold, rise, cruise, rise, hold, rise])


def _durations(
    distance: float, velocity: float, acceleration: float, jerk: float
) -> tuple[float, float, float]:
    """Return the durations of rising and of constant acceleration, and of constant velocity, s."""
    rise = 0.0 if jerk == math.inf else acceleration / jerk
    # First ignore the velocity limit.
    if rise and distance < 2.0 * acceleration * rise * rise:
        rise = math.cbrt(0.5 * distance / jerk)
        hold = 0.0
        peak = jerk * rise * rise
    else:
        hold = 0.5 * (math.sqrt(rise * rise + 4.0 * distance / acceleration) - 3.0 * rise)
        hold = max(hold, 0.0)
        peak = acceleration * (rise + hold)
    cruise = 0.0
    if peak > velocity:
        if rise and velocity < jerk * rise * rise:
            rise, hold = math.sqrt(velocity / jerk), 0.0
        else:
            hold = max(velocity / acceleration - rise, 0.0)
        cruise = max(distance / velocity - (2.0 * rise + hold), 0.0)
    return rise, hold, cruise


def phases_of_turn(
    axis: Floats,
    turn: float,
    limits: Limits,
    *,
    share: float = SHARE,
    jerk_share: float = SHARE,
    is_part: bool = False,
) -> Floats:
    """Return the phases of the fastest turn from rest to rest that has a reserve for stops.

    Args:
        turn: its angle, rad, positive.
        share: usable share of the acceleration.
        jerk_share: usable share of the jerk.
        is_part: whether it is part of a longer motion.
    """
    velocity, acceleration, jerk = limits.along(axis.tolist())
    most = VELOCITY_SHARE * velocity, share * acceleration, jerk_share * jerk
    phases = double_s(turn, *most)
    total, rest = float(phases.sum()), float(phases[4:].sum())
    stop = longest_stop(rest)
    weight = 1.0 if is_part else (total / stop - _EASED) / (1.0 - _EASED)
    if weight <= 0.0:
        return phases
    # A motion shorter than a stop needs no reserve; the reserve then grows with the duration.
    can_be_stopped = _most_to_stop(turn, phases, (acceleration, jerk), most, stop)
    weight = min(weight, 1.0)
    return double_s(
        turn,
        *(
            one if one == other else (1.0 - weight) * one + weight * other
            for one, other in zip(most, can_be_stopped, strict=True)
        ),
    )


def _most_to_stop(
    turn: float,
    phases: Floats,
    limits: tuple[float, float],
    most: tuple[float, float, float],
    stop: float,
) -> tuple[float, float, float]:
    """Return the shares of *most* that the fastest turn with a stop within a time, s, uses.

    *phases* are those of the turn without a reserve, and *limits* of acceleration and jerk.
    """
    (rise, hold), (acceleration, jerk) = phases[:2].tolist(), limits
    pull = min(most[1], most[2] * rise) if rise else most[1]
    highest = pull * (rise + hold)
    share = share_to_stop(min(most[0], highest) / acceleration, stop)
    pulls, speeds = np.array([min(share * acceleration, pull)]), np.array([most[0]])
    if share < _MUCH:
        # A lower velocity may be better.
        pulls = pull * _SHARES_TO_STOP
        speeds = np.minimum(most[0], speed_to_stop(pulls / acceleration, stop) * acceleration)
    best, least = most, math.inf
    for pulled, velocity in zip(pulls.tolist(), speeds.tolist(), strict=True):
        turned = jerk_to_stop(min(velocity, highest), pulled, stop)
        if not turned < jerk:
            continue
        used = velocity, pulled, min(most[2], jerk - turned)
        rise, hold, cruise = _durations(turn, *used)
        total = 4.0 * rise + 2.0 * hold + cruise
        if total < least:
            best, least = used, total
    return best


def turned_at_once(
    keyframe_path: KeyframePath, limits: Limits, share: float = SHARE
) -> KeyframePath | None:
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
    found = AxisTurn(
        q[0], axis, turn, phases_of_turn(axis, turn, limits, share=share, jerk_share=share)
    )
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
