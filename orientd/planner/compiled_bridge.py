"""The search for the shortest bridge, compiled by Numba.

Imported by :mod:`orientd.planner.fast` only.  The reference is
:mod:`orientd.planner.bridge_search`.  Here the durations are looked at one after the other until
enough bridges are found, and every bridge is given up at the first point where it exceeds its
bounds (:mod:`orientd.planner.compiled_join`).
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numba import boolean, float64, njit, types

from orientd.curves.basis import Indices
from orientd.curves.compiled_lanes import Quaternion, Vector
from orientd.curves.compiled_rotation import (
    exponential,
    inner,
    logarithm,
    multiplied,
    relative,
)
from orientd.planner.bridge_search import (
    BEST,
    CLOSE,
    GRID,
    RAMPS,
    REFINED,
    ROUNDING,
    SHORTEST,
    STILL,
    SUBSTEPS,
    VELOCITY_MARGIN,
)
from orientd.planner.compiled_join import (
    exceeds,
    increments,
    keeps,
    orientation,
    put_middle,
    seems_to_keep,
    three,
    weighted_sum,
)
from orientd.planner.fast import Booleans, Search
from orientd.rotation import Floats


@inner
def _none() -> int:
    """Return 0, as a number like any other: for a literal one Numba compiles functions anew."""
    return int(np.int64(0))


@inner
def _turn(state: Floats, goal: Vector, duration: float) -> Quaternion:
    """Return where a ramp leads to; see :func:`orientd.planner.bridge_search.turned`."""
    omega, alpha = three(state, 4), three(state, 7)
    h = duration / SUBSTEPS
    slope = weighted_sum(goal, 1.0, alpha, -1.0)
    rate = 1.0 / duration if duration > 0.0 else 1.0
    share = math.sqrt(3.0) / 24.0 * h * h
    here = orientation(state)
    for step in range(SUBSTEPS):
        t = (step + 0.5 - math.sqrt(3.0) / 6.0) * h
        other = (step + 0.5 + math.sqrt(3.0) / 6.0) * h
        a = weighted_sum(weighted_sum(omega, 1.0, alpha, t), 1.0, slope, 0.5 * t * t * rate)
        b = weighted_sum(
            weighted_sum(omega, 1.0, alpha, other), 1.0, slope, 0.5 * other * other * rate
        )
        here = multiplied(
            here,
            exponential(
                h / 4.0 * (a[0] + b[0]) + share * (a[1] * b[2] - a[2] * b[1]),
                h / 4.0 * (a[1] + b[1]) + share * (a[2] * b[0] - a[0] * b[2]),
                h / 4.0 * (a[2] + b[2]) + share * (a[0] * b[1] - a[1] * b[0]),
            ),
        )
    return here


@inner
def _bounds(start: Floats, end: Floats, reserved: Floats, has_axes: bool) -> Floats:
    """Return what a bridge keeps; see :class:`orientd.planner.bridge_search.Bounds`."""
    most = np.empty((3, 4 if has_axes else 1))
    for order in range(3):
        for k in range(most.shape[1]):
            bound = reserved[order, k] * (VELOCITY_MARGIN if order == 0 else 1.0)
            for state in (start, end):
                if order < 2:
                    v = three(state, 4 + 3 * order)
                    size = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
                    bound = max(bound, size if k == 0 else abs(v[k - 1]))
            most[order, k] = bound * (1.0 + ROUNDING)
    return most


@inner
def _along(direction: Vector, limits: Floats) -> float:
    """Return a limit on the component along a direction."""
    limit: float = limits[0]
    for k in range(3):
        if abs(direction[k]) * limit > limits[k + 1]:
            limit = limits[k + 1] / abs(direction[k])
    return limit


@inner
def _put_ramp(
    state: Floats, goal: Vector, reserved: Floats, most: Floats, period: float, count: int,
    ends: Floats, durations: Floats,
) -> int:  # fmt: skip
    """Add the ramp to an acceleration, unless it becomes too fast, and return how many there are.

    The first one is none at all.
    """
    omega, alpha = three(state, 4), three(state, 7)
    change = weighted_sum(goal, 1.0, alpha, -1.0)
    size = math.sqrt(change[0] * change[0] + change[1] * change[1] + change[2] * change[2])
    duration = size / reserved[2, 0]
    for k in range(3):
        duration = max(duration, abs(change[k]) / reserved[2, k + 1])
    duration = max(duration, period) if count else 0.0
    speed = weighted_sum(omega, 1.0, weighted_sum(alpha, 1.0, goal, 1.0), 0.5 * duration)
    size = math.sqrt(speed[0] * speed[0] + speed[1] * speed[1] + speed[2] * speed[2])
    if count and (not size <= most[0, 0] or exceeds(speed, 1.0, most[0])):
        return count
    end = ends[count]
    end[0], end[1], end[2], end[3] = _turn(state, goal, duration)
    end[4], end[5], end[6] = speed
    end[7], end[8], end[9] = goal
    durations[count] = duration
    return count + 1


@inner
def _ramps(
    state: Floats, way: Vector, reserved: Floats, most: Floats, period: float,
    ends: Floats, durations: Floats,
) -> int:  # fmt: skip
    """Write the ramps that a bridge may begin with, and return how many there are."""
    omega, alpha = three(state, 4), three(state, 7)
    count = _put_ramp(state, alpha, reserved, most, period, _none(), ends, durations)
    if math.sqrt(alpha[0] * alpha[0] + alpha[1] * alpha[1] + alpha[2] * alpha[2]) > STILL:
        rest = (0.0, 0.0, 0.0)
        count = _put_ramp(state, rest, reserved, most, period, count, ends, durations)
    for v in ((-omega[0], -omega[1], -omega[2]), way):
        size = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        if not size > STILL:
            continue
        direction = v[0] / size, v[1] / size, v[2] / size
        limit = _along(direction, reserved[1])
        if limit < math.inf:
            for share in (0.5, 1.0):
                goal = weighted_sum(direction, share * limit, direction, 0.0)
                count = _put_ramp(state, goal, reserved, most, period, count, ends, durations)
    return count


@inner
def _grid(
    start: Floats, end: Floats, angle: float, most: Floats, period: float, least: float,
    totals: Floats,
) -> int:  # fmt: skip
    """Write durations to look at, in whole periods, and return how many there are."""
    velocity, acceleration, jerk = most[0, 0], most[1, 0], most[2, 0]
    for k in range(1, most.shape[1]):
        velocity, acceleration = min(velocity, most[0, k]), min(acceleration, most[1, k])
        jerk = min(jerk, most[2, k])
    change, speeds, sizes = 0.0, 0.0, 0.0
    for k in range(4, 7):
        change += (end[k] - start[k]) ** 2
    for state in (start, end):
        speeds += math.sqrt(state[4] ** 2 + state[5] ** 2 + state[6] ** 2)
        sizes += math.sqrt(state[7] ** 2 + state[8] ** 2 + state[9] ** 2)
    shortest = max(
        0.5 * angle / most[0, 0], math.sqrt(angle / most[1, 0]), math.sqrt(change) / most[1, 0]
    )
    shortest = max(shortest, period, least)
    longest = (
        2.0 * angle / velocity
        + 3.0 * math.sqrt(angle / acceleration)
        + 5.0 * math.pow(angle / jerk, 1.0 / 3.0)
        + 5.0 * speeds / acceleration
        + 8.0 * math.sqrt(speeds / jerk)
        + 12.0 * sizes / jerk
        + 8.0 * period
    )
    longest = max(longest, 3.0 * least, shortest)
    step = math.log(longest / shortest) / (len(totals) - 1)
    count = _none()
    for k in range(len(totals)):
        count = _put_duration(shortest * math.exp(step * k), period, count, totals)
    return count


@inner
def _put_duration(duration: float, period: float, count: int, totals: Floats) -> int:
    """Add a duration in whole periods unless it is there already, and return how many there are."""
    total = math.ceil(duration / period - 1e-9) * period
    if count and total == totals[count - 1]:
        return count
    totals[count] = total
    return count + 1


@inner
def _seen(
    into: Floats, out_of: Floats, durations: Floats, others: Floats, pairs: Indices, total: float,
    to_rates: Floats, most: Floats, found: Floats, count: int, kept: Booleans,
) -> int:  # fmt: skip
    """Add the bridges of a duration that seem to keep the bounds, and return how many there are.

    Args:
        into: states that the ramps lead to, shape ``(n, 10)``.
        out_of: states that the ramps at the other end come from, shape ``(m, 10)``.
        durations: of the ramps, s.
        others: of those at the other end, s.
        pairs: of ramps to look at, in order, numbered row by row.
        total: duration of the bridge, s.
        to_rates: what turns increments to rates, shape ``(3, points, 5)``.
        most: the bounds, shape ``(3, 1 or 4)``.
        found: receives duration, pair and way round of each, shape ``(many, 3)``.
        count: how many there are already.
        kept: room for what is found out, shape ``(2, pairs)``.
    """
    w = np.empty((5, 3))
    for i in range(len(pairs)):
        one, other = divmod(pairs[i], len(others))
        h = total - (durations[one] + others[other])
        kept[0, i] = kept[1, i] = False
        if h > SHORTEST:
            middle = increments(into[one], out_of[other], h, w)
            for way in range(2):
                put_middle(w, middle, way)
                kept[way, i] = seems_to_keep(w, h, to_rates, most)
    for way in range(2):
        for i in range(len(pairs)):
            if kept[way, i]:
                found[count, 0], found[count, 1], found[count, 2] = total, pairs[i], way
                count += 1
    return count


@inner
def _refined(best: float, step: float, least: float, period: float, totals: Floats) -> int:
    """Write durations from the one before the best up to that, and return how many there are."""
    count, last = _none(), len(totals) - 1
    for k in range(last, -1, -1):
        duration = best * math.pow(step, -k / last)
        if duration >= least - 1e-9:
            count = _put_duration(duration, period, count, totals)
    return count


@inner
def _pairs_of(found: Floats, count: int, pairs: Indices) -> int:
    """Write the pairs of the first few, each once and in order, and return how many there are."""
    many = 0
    for i in range(count):
        pair = int(found[i, 1])
        place = 0
        while place < many and pairs[place] < pair:
            place += 1
        if place == many or pairs[place] != pair:
            for k in range(many, place, -1):
                pairs[k] = pairs[k - 1]
            pairs[place] = pair
            many += 1
    return many


@inner
def _copy(row: Floats, other: Floats) -> None:
    for k in range(len(row)):
        other[k] = row[k]


@inner
def _merged(found: Floats, count: int, fine: Floats, fines: int, both: Floats) -> int:
    """Write the first of two lists in order of duration, and return how many there are."""
    i, j = 0, 0
    while i + j < len(both) and (i < count or j < fines):
        if j == fines or (i < count and found[i, 0] <= fine[j, 0]):
            _copy(found[i], both[i + j])
            i += 1
        else:
            _copy(fine[j], both[i + j])
            j += 1
    return i + j


@inner
def _longer(near: Floats, count: int, period: float, tries: Floats) -> int:
    """Write bridges again with durations a little longer, too, the shortest first."""
    many = 0
    for i in range(count):
        for k in range(len(CLOSE)):
            total = math.ceil(near[i, 0] * CLOSE[k] / period - 1e-9) * period
            place = many
            while place and tries[place - 1, 0] > total:
                _copy(tries[place - 1], tries[place])
                place -= 1
            tries[place, 0], tries[place, 1], tries[place, 2] = total, near[i, 1], near[i, 2]
            many += 1
    return many


@inner
def _first_kept(
    into: Floats, out_of: Floats, durations: Floats, others: Floats, tries: Floats, count: int,
    at_points: Floats, most: Floats, w: Floats,
) -> int:  # fmt: skip
    """Write the increments of the first bridge that keeps the bounds, and return which; -1: none.

    Arguments are as in :func:`_seen`, and *at_points* the basis functions with two derivatives at
    the points to look at, shape ``(3, 5, points)``.
    """
    squares = np.empty((3, at_points.shape[2]))
    for i in range(count):
        one, other = divmod(int(tries[i, 1]), len(others))
        h = tries[i, 0] - (durations[one] + others[other])
        middle = increments(into[one], out_of[other], h, w)
        put_middle(w, middle, int(tries[i, 2]))
        if keeps(w, h, at_points, most, squares):
            return i
    return -1


@inner
def _way(start: Floats, end: Floats) -> Vector:
    """Return the rotation vector from one state to another, the short way round."""
    w, x, y, z = relative(orientation(start), orientation(end))
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    return weighted_sum(logarithm((w, x, y, z)), 2.0, (0.0, 0.0, 0.0), 0.0)


@inner
def _mirror(state: Floats) -> None:
    """Make a state what it is when time runs backwards."""
    for k in range(4, 7):
        state[k] = -state[k]


@inner
def _turns_over(q: Floats, w: Floats, end: Floats) -> bool:
    """Return whether a join arrives at the other of the two quaternions of its end."""
    arrival = orientation(q)
    for k in range(5):
        arrival = multiplied(arrival, exponential(w[k, 0], w[k, 1], w[k, 2]))
    cosine = 0.0
    for k in range(4):
        cosine += arrival[k] * end[k]
    return cosine < 0.0


@inner
def _negate(q: Floats) -> None:
    for k in range(4):
        q[k] = -q[k]


def _search(
    start: Floats, end: Floats, reserved: Floats, has_axes: bool, period: float, least: float,
    to_rates: Floats, at_points: Floats, q: Floats, w: Floats, times: Floats,
) -> bool:  # fmt: skip
    """Write the shortest bridge that is found: a ramp, a join and another ramp.

    Args:
        start: orientation, velocity and acceleration it begins with, shape ``(10,)``.
        end: the same where it ends.
        reserved: limits of velocity, acceleration and jerk with their reserve: of the norm and of
            the components, shape ``(3, 4)``.
        has_axes: whether the components are limited.
        period: it takes a whole number of periods, s.
        least: it takes at least this long, s.
        to_rates: what turns increments to rates, shape ``(3, points, 5)``.
        at_points: basis functions with two derivatives, shape ``(3, 5, points)``.
        q: receives the orientations that the three begin at, signs continuous, shape ``(3, 4)``.
        w: receives the increments of the three, shape ``(3, 5, 3)``.
        times: receives when the three begin and end, s, shape ``(4,)``.

    Returns:
        Whether one was found.
    """
    begin, finish = start.copy(), end.copy()
    most = _bounds(begin, finish, reserved, has_axes)
    way = _way(begin, finish)
    into, durations = np.empty((RAMPS, 10)), np.empty(RAMPS)
    count = _ramps(begin, way, reserved, most, period, into, durations)
    into, durations = into[:count], durations[:count]
    out_of, others = np.empty((RAMPS, 10)), np.empty(RAMPS)
    back = -way[0], -way[1], -way[2]
    _mirror(finish)
    count = _ramps(finish, back, reserved, most, period, out_of, others)
    _mirror(finish)
    out_of, others = out_of[:count], others[:count]
    for i in range(count):
        _mirror(out_of[i])

    angle = math.sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2])
    totals = np.empty(GRID)
    totals = totals[: _grid(begin, finish, angle, most, period, least, totals)]
    pairs = np.empty(len(into) * len(out_of), dtype=np.int64)
    for pair in range(len(pairs)):
        pairs[pair] = pair
    found, kept = np.empty((2 * GRID * len(pairs), 3)), np.empty((2, len(pairs)), dtype=np.bool_)
    count, looked = _none(), 0
    while looked < len(totals) and count < BEST:
        count = _seen(
            into, out_of, durations, others, pairs, totals[looked], to_rates, most,
            found, count, kept,
        )  # fmt: skip
        looked += 1
    if not count:
        return False
    # Once more, between the shortest duration that will do and the one before it.
    nearest = np.empty(BEST, dtype=np.int64)
    nearest = nearest[: _pairs_of(found, min(count, BEST), nearest)]
    finer = np.empty(REFINED)
    step = totals[1] / totals[0] if len(totals) > 1 else 1.0
    finer = finer[: _refined(found[0, 0], step, least, period, finer)]
    fine, fines = np.empty((2 * REFINED * BEST, 3)), _none()
    for i in range(len(finer)):
        fines = _seen(
            into, out_of, durations, others, nearest, finer[i], to_rates, most, fine, fines, kept
        )
    near, tries = np.empty((BEST, 3)), np.empty((BEST * len(CLOSE), 3))
    many = _longer(near, _merged(found, count, fine, fines, near), period, tries)
    place = _first_kept(into, out_of, durations, others, tries, many, at_points, most, w[1])
    if place < 0:
        # None of these: then any.
        while looked < len(totals):
            count = _seen(
                into, out_of, durations, others, pairs, totals[looked], to_rates, most,
                found, count, kept,
            )  # fmt: skip
            looked += 1
        tries = np.empty((count + fines, 3))
        many = _merged(found, count, fine, fines, tries)
        place = _first_kept(into, out_of, durations, others, tries, many, at_points, most, w[1])
        if place < 0:
            return False
    pair = int(tries[place, 1])
    one, other = divmod(pair, len(others))
    total, before, after = tries[place, 0], durations[one], others[other]
    times[0], times[1], times[2], times[3] = 0.0, before, total - after, total
    for k in range(4):
        q[0, k], q[1, k], q[2, k] = begin[k], into[one, k], out_of[other, k]
    if before > 0.0:
        put_middle(w[0], increments(begin, into[one], before, w[0]), 0)
    if after > 0.0:
        put_middle(w[2], increments(out_of[other], finish, after, w[2]), 0)
    # The sign of each goes on from the one before.
    if before > 0.0 and _turns_over(q[0], w[0], q[1]):
        _negate(q[1])
    if _turns_over(q[1], w[1], q[2]):
        _negate(q[2])
    return True


_ONE, _TWO, _THREE = (types.Array(float64, n, "C", readonly=True) for n in (1, 2, 3))

search: Search = cast(
    Search,
    njit(
        boolean(
            _ONE, _ONE, _TWO, boolean, float64, float64, _THREE, _THREE,
            float64[:, ::1], float64[:, :, ::1], float64[::1],
        ),
        error_model="numpy", nogil=True, cache=True,
    )(_search),
)  # fmt: skip
