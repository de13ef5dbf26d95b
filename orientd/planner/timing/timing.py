r"""Times for keyframes that come without: chord lengths, made as short as the limits allow.

The intervals are proportional to the angles between keyframes (Nielson 1993, eq. 23),
:math:`t_i = t_{i-1} + \arccos\langle q_{i-1}, q_i\rangle`, with the angle taken by an arc tangent,
which keeps its digits, and whole turns added.  Where a position has further to go than the
orientation, measured in time at the limits, the position sets the interval.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from orientd.errors import PlanError, RequestError
from orientd.planner.limits import LONGEST, Limits
from orientd.planner.request import MotionRequest
from orientd.rotation import Floats, angle

LONGER = 1.02
"""What an attempt returns where the rates are not known: how much longer to try."""

SAME = 1e-9
"""Rad and m; keyframes nearer than this are one."""

BESIDE = 1.5e-4
"""Rad; keyframes nearer than this, 0.009 degrees, are one where their neighbours are far: less than
a joint repeats, and a tenth of a servo's step, and to pass both would take a turn on the spot."""

PRECISION = 1e-3
"""Of the shortest duration."""

MOST_ATTEMPTS = 60
PATIENCE = 4
"""Attempts that trust the prediction before any has kept the limits."""

MOST_FAILURES = 16
"""Attempts until the first that keeps the limits."""

MOST_PREDICTIONS = 8
"""Attempts that trust the prediction; then bisection."""

SMALLEST_FACTOR, LARGEST_FACTOR = 1e-9, 1e4
"""Between which a prediction is made from a factor."""

_LONGEST_STRIDE = 2.0  # from one number of cycles to the next where the shape changes with them
_FAR = 2.0  # a factor beyond which it is doubted that it falls with the cycles
_DOWNWARD = 1.4  # from one to the next where fewer are looked at
_MOST_DOWNWARD = 10
_MOST_BETWEEN = 4


_FAR_LESS = 1e-3  # of the longer interval beside a short one

Indices = np.ndarray[Any, np.dtype[np.intp]]
Booleans = np.ndarray[Any, np.dtype[np.bool_]]


@dataclass(frozen=True, slots=True, eq=False)
class Knots:
    """Keyframes with times up to a factor.

    Attributes:
        times: from 0 to 1, one for every keyframe of the request.
        kept: indices of the keyframes that the curve passes; the others repeat one of them.
    """

    times: Floats
    kept: Indices
    length: float

    def merged(self, request: MotionRequest, first: int = 0) -> list[str]:
        """Return what there is to say of keyframes that are beside another and not passed.

        Args:
            request: the keyframes.
            first: the index of the first of them in what was asked for.
        """
        if len(self.kept) == len(request.keys):
            return []
        left_out = np.setdiff1d(np.arange(len(request.keys)), self.kept)
        owners = np.searchsorted(self.kept, left_out)
        owners = self.kept[np.minimum(owners, len(self.kept) - 1)]
        owners = np.where(self.times[owners] == self.times[left_out], owners, left_out)
        before = self.kept[np.searchsorted(self.kept, left_out) - 1]
        owners = np.where(owners == left_out, before, owners)
        apart = angle(request.keys[left_out], request.keys[owners])
        return [
            f"keyframes[{first + one}] is {far:.2g} rad beside keyframes[{first + owner}]: "
            "passed as one"
            for one, owner, far in zip(
                left_out.tolist(), owners.tolist(), apart.tolist(), strict=True
            )
            if far > SAME
        ]

    def first_guess(self, limits: Limits) -> float:
        """Return about how long the motion takes, s: a place to begin a search."""
        count = len(self.kept) - 1
        step = self.length / count
        return max(
            1.2 * self.length / limits.velocity,
            count * math.sqrt(3.0 * step / limits.acceleration),
            count * math.cbrt(12.0 * step / limits.jerk),
        )


def chord_knots(request: MotionRequest, limits: Limits, *, is_uniform: bool) -> Knots:
    """Return times for the keyframes of a request that gives none.

    Args:
        request: without times.
        limits: weigh turns against moves.
        is_uniform: equal intervals instead, for curves that do not interpolate.

    Raises:
        RequestError: the keyframes are all the same.
        PlanError: the way is too long for the limits of velocity, whatever the curve.
    """
    lengths = turn_lengths(request)
    if not is_uniform:
        _check_way(lengths, limits.velocity)
    moves = move_lengths(request, limits)
    if moves is not None:
        _check_way(moves, limits.linear_velocity)
        lengths = np.maximum(lengths, moves * radians_per_metre(limits))
    is_repeated = lengths <= SAME
    if not is_uniform:
        is_repeated |= _is_beside(lengths)
    if is_repeated.all():
        raise RequestError("keyframes", "are all the same; give them times to make the device wait")
    length = float(lengths.sum())
    count = len(request.keyframes)
    kept = np.arange(count)
    if is_uniform:
        return Knots(np.linspace(0.0, 1.0, count), kept, length)
    if is_repeated.any():
        lengths[is_repeated] = 0.0
        kept = np.flatnonzero(np.concatenate([[True], ~is_repeated]))
        # The motion ends at the last one, whichever it is beside.
        is_other = float(angle(request.keys[kept[-1]], request.keys[-1])) > SAME
        if is_other and len(kept) > 1 and not request.turns[kept[-1] :].any():
            kept[-1] = count - 1
    times: Floats = np.zeros(count)
    np.cumsum(lengths, out=times[1:])
    return Knots(times / times[-1], kept, length)


def _is_beside(lengths: Floats) -> Booleans:
    """Return which intervals are so short, beside their neighbours, that nobody can mean them."""
    padded = np.concatenate([[0.0], lengths, [0.0]])
    longer = np.maximum(padded[:-2], padded[2:])
    is_beside: Booleans = (lengths <= BESIDE) & (lengths <= _FAR_LESS * longer)
    return is_beside


def turn_lengths(request: MotionRequest) -> Floats:
    """Return by how much each interval turns, whole turns included, rad, shape ``(n - 1,)``."""
    lengths = angle(request.keys[:-1], request.keys[1:])
    if request.turns.any():
        lengths += 2.0 * np.pi * np.abs(request.turns[1:])
    return lengths


def move_lengths(request: MotionRequest, limits: Limits) -> Floats | None:
    """Return how far the position has to go in each interval, m; ``None`` where that is no matter.

    Moves are spread over intervals whose ends have no position.
    """
    positions = request.positions
    if positions is None or not math.isfinite(limits.linear_velocity):
        return None
    lengths = np.zeros(len(positions) - 1)
    given = np.flatnonzero(np.isfinite(positions[:, 0]))
    for first, last in pairwise(given):
        distance = float(np.linalg.norm(positions[last] - positions[first]))
        lengths[first:last] = distance / (last - first)
    return lengths


def _check_way(lengths: Floats, velocity: float) -> None:
    least = float(lengths.sum()) / velocity
    if not least <= LONGEST:
        raise PlanError(
            f"the keyframes take {least:.6g} s at the limit of the velocity, at most {LONGEST:g} s "
            "is planned"
        )


def radians_per_metre(limits: Limits) -> float:
    """Return how far it turns in the time of a metre, both at their limits, rad/m."""
    if not math.isfinite(limits.velocity):
        return 1.0
    # Finite, as it is multiplied by no way at all, too.
    return min(limits.velocity / limits.linear_velocity, sys.float_info.max)


def shortest(
    attempt: Callable[[int], float],
    first: int,
    *,
    least: int = 1,
    most: int,
    has_one_shape: bool = True,
) -> int | None:
    """Return the fewest cycles that keep the limits, to 0.1 %.

    Args:
        attempt: plans with a number of cycles and returns by which factor it should be longer; at
            most 1 keeps the limits, and infinity says that there is no curve.
        first: where to begin.
        least: cycles not to go below.
        most: cycles not to go beyond.
        has_one_shape: whether more cycles are the same curve at a lower rate.  A curve that begins
            in motion swings out further the longer it takes: then the rates have a least at some
            number of cycles, beyond which nothing is looked for, and no step is a long one.

    Returns:
        The number of cycles, for which *attempt* has returned at most 1; ``None`` if nothing was
        found.
    """
    low, high = least - 1, most + 1
    cycles, growth = min(max(first, least), most), 1.02
    before: tuple[float, float] | None = None
    tried: dict[int, float] = {}
    for count in range(MOST_ATTEMPTS):
        factor = attempt(cycles)
        if factor != LONGER:
            tried[cycles] = factor
        if factor <= 1.0:
            high = cycles
            if factor >= 1.0 - PRECISION:
                break
        elif not (count or has_one_shape) and factor > _FAR:
            # Far more than the limits: perhaps because it swings out, which fewer would tell.
            low, cycles = cycles, max(int(cycles / _DOWNWARD), least)
            continue
        elif high > most and not has_one_shape and factor != LONGER and _is_rising(tried):
            found = _fewer(attempt, tried, least)
            if found is None:
                break
            high, cycles = found, found
            factor, low = tried[found], max((n for n in tried if n < found), default=least - 1)
            before = None
        else:
            low = max(low, cycles)
        if high - low <= max(1.0, PRECISION * high):
            break
        here = math.log(cycles), math.log(min(max(factor, SMALLEST_FACTOR), LARGEST_FACTOR))
        guess = math.exp(_secant(before, here))
        before = here
        if high > most:
            if count >= MOST_FAILURES:
                break
            if count >= PATIENCE:
                # Nothing has worked yet: no ever smaller steps.
                guess, growth = max(guess, cycles * growth), min(growth**2, 2.0)
            if not has_one_shape:
                guess = min(guess, _LONGEST_STRIDE * cycles)
        elif count >= MOST_PREDICTIONS or not low < guess < high:
            guess = math.sqrt(low * high) if low else 0.5 * high
        cycles = min(max(math.ceil(guess), low + 1), high - 1)
    return high if high <= most else None


def _is_rising(tried: Mapping[int, float]) -> bool:
    """Return whether more cycles have turned out to be worse, or too many for any curve."""
    *_, before, here = sorted([(0, math.inf), *tried.items()])
    if here[1] == math.inf:
        return True
    return here[0] > 1.01 * before[0] and here[1] > 1.001 * before[1]


def _fewer(attempt: Callable[[int], float], tried: dict[int, float], least: int) -> int | None:
    """Look for cycles that keep the limits, fewer than those where the factor begins to rise.

    First downward as long as the factor falls, then around the least one.
    """
    best = min(tried, key=lambda cycles: tried[cycles])
    cycles = min(tried)
    for _ in range(_MOST_DOWNWARD):
        cycles = int(cycles / _DOWNWARD)
        if cycles < least:
            break
        tried[cycles] = attempt(cycles)
        if tried[cycles] > tried[best]:
            break
        best = cycles
        if tried[best] <= 1.0:
            return best
    for _ in range(_MOST_BETWEEN):
        order = sorted(tried)
        place = order.index(best)
        if not 0 < place < len(order) - 1:
            break
        left, right = order[place - 1], order[place + 1]
        cycles = round(math.sqrt(best * (right if best * best < left * right else left)))
        if cycles in tried:
            break
        tried[cycles] = attempt(cycles)
        if tried[cycles] <= 1.0:
            return cycles
        best = min(best, cycles, key=lambda some: tried[some])
    return None


def _secant(before: tuple[float, float] | None, here: tuple[float, float]) -> float:
    """Return the logarithm of the duration where the factor should be just below 1.

    Where the ends are at rest the factor is inversely proportional to the duration; otherwise it
    falls more slowly, as the last two attempts show.
    """
    slope = -1.0
    if before is not None and abs(here[0] - before[0]) > 1e-9:
        slope = (here[1] - before[1]) / (here[0] - before[0])
    return here[0] - (here[1] + 0.5 * PRECISION) / min(max(slope, -1.5), -0.3)
