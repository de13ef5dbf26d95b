"""Choose branches and whole turns by dynamic programming over the whole path.

The candidates at each sample are both branches with the whole turns within the limits, except turns
that a nearer one covers.  An axis can turn only so far from sample to sample.  A passage near the
pole leads from its first sample to its last in one step.  Anything else is a slew, which costs more
than any detour.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from orientd.driver import AxisLimits
from orientd.mechanism.arrays import wrapped
from orientd.mechanism.joint_path import Bounds
from orientd.mechanism.pole import Passage
from orientd.mechanism.slews import slew_times
from orientd.rotation import Floats

Bools = np.ndarray[Any, np.dtype[np.bool_]]

SAME = 1e-3
"""Largest distance of the path's start from the given angles, rad."""
_SLEW_COST = 1e3
"""Cost of a second during which the path stands still."""
_ERROR_COST = 20.0
_TURN = 2.0 * math.pi
_PAIRS = 250_000  # pairs of candidates at a time, to bound memory
_MATCH = 1e-5


class Choice(NamedTuple):
    """The chosen axis angles.

    Attributes:
        joints: rad, unwrapped, shape ``(n, axes)``, including the passages.
        slews: indices of samples before which the axes have to slew.
        passages: the passages used.
        reached: number of samples that could be reached; *n* if all.
    """

    joints: Floats
    slews: tuple[int, ...]
    passages: tuple[Passage, ...]
    reached: int


def candidates(
    principal: Floats, axes: Sequence[AxisLimits], start: Floats | None = None
) -> Floats:
    """Return the axis angles within the limits for each orientation, without needless turns.

    Args:
        principal: both branches in (-pi, pi], shape ``(n, 2, axes)``.
        axes: limits of every axis.
        start: axis angles at the start of the path; ``None`` is about zero.

    Returns:
        Angles in rad, shape ``(n, count, axes)``, padded with NaN.
    """
    low, high = _ranges(axes)
    begun = np.clip(np.zeros(len(axes)) if start is None else start, low, high)
    lines = _followed(principal, begun)
    options = []
    for place in range(len(axes)):
        pair = lines[..., place]
        ranges = [_turns(line, float(low[place]), float(high[place])) for line in pair.T]
        least, most = min(first for first, _ in ranges), max(last for _, last in ranges)
        shifted = pair[..., None] + _TURN * np.arange(least, most + 1)
        inside = (shifted >= low[place]) & (shifted <= high[place])
        options.append(np.where(inside, shifted, np.nan)[..., np.any(inside, axis=(0, 1))])
    rows = [
        np.stack([options[axis][:, branch, pick] for axis, pick in enumerate(picks)], axis=-1)
        for branch in (0, 1)
        for picks in product(*(range(option.shape[-1]) for option in options))
    ]
    if not rows:
        return np.full((len(principal), 1, len(axes)), np.nan)
    every = np.stack(rows, axis=1)
    every[np.any(np.isnan(every), axis=-1)] = np.nan
    # Put feasible rows first, and keep only as many columns as the fullest sample needs.
    valid = ~np.isnan(every[..., 0])
    order = np.argsort(~valid, axis=1, kind="stable")
    most = max(1, int(np.max(np.sum(valid, axis=1))))
    return np.take_along_axis(every, order[..., None], axis=1)[:, :most]


def _followed(principal: Floats, begun: Floats) -> Floats:
    """Return both lines of axis angles that follow the path without a jump, from near *begun*.

    They have the shape of *principal*; each begins on one branch.
    """
    gaps = np.max(np.abs(wrapped(principal[1:, None] - principal[:-1, :, None])), axis=-1)
    swaps = gaps[:, 0, 1] + gaps[:, 1, 0] < gaps[:, 0, 0] + gaps[:, 1, 1]
    branch = (np.arange(2) + np.concatenate([[0], np.cumsum(swaps)])[:, None]) % 2
    lines = np.unwrap(np.take_along_axis(principal, branch[..., None], axis=1), axis=0)
    found: Floats = lines + _TURN * np.round((begun - lines[0]) / _TURN)
    return found


def _turns(line: Floats, low: float, high: float) -> tuple[int, int]:
    """Return the least and the most turns from *line* that an axis needs within its limits.

    Once the whole line is within the limits, turns beyond it lead nowhere that the line does not.
    One more on either side leaves the choice of which way to turn.
    """
    least, most = float(np.min(line)), float(np.max(line))
    first, last = math.ceil((low - least) / _TURN), math.floor((high - most) / _TURN)
    if first > last:
        # No turn has the whole line within the limits: all that have a part of it.
        return math.floor((low - most) / _TURN), math.ceil((high - least) / _TURN)
    whole = min(max(0, first), last)
    return min(0, whole) - 1, max(0, whole) + 1


def continued(principal: Floats, bounds: Bounds, start: Floats) -> Choice:
    """Return the axis angles on the branch and turn of *start*, as far as the axes can follow.

    Without passages and slews there is no other solution: the outer axes of the two branches are
    half a turn apart.

    Args:
        principal: both branches, shape ``(n, 2, axes)``.
        bounds: limits of the plan.
        start: axis angles before the path, shape ``(axes,)``.
    """
    low, high = _ranges(bounds.axes)
    best = Choice(np.full_like(principal[:, 0], np.nan), (), (), 0)
    for branch in (0, 1):
        angles = np.unwrap(principal[:, branch], axis=0)
        angles += 2 * np.pi * np.round((start - angles[0]) / (2 * np.pi))
        if np.max(np.abs(angles[0] - start)) >= SAME:
            continue
        is_off = np.any((angles < low) | (angles > high), axis=1)
        is_off[1:] |= np.any(np.abs(np.diff(angles, axis=0)) > bounds.longest_step, axis=1)
        reached = int(np.argmax(is_off)) if np.any(is_off) else len(angles)
        if reached > best.reached:
            best = Choice(angles, (), (), reached)
    return best


def choose(
    every: Floats,
    bounds: Bounds,
    *,
    start: Floats | None = None,
    passages: Sequence[Passage] = (),
    slews: Bools | None = None,
    stop: float = 0.0,
) -> Choice:
    """Return the axis angles for the whole path that take the least time, then the least travel.

    Args:
        every: as from :func:`candidates`, shape ``(n, count, axes)``.
        bounds: limits of the plan.
        start: axis angles before the path, shape ``(axes,)``; ``None`` is anywhere.
        passages: available passages near the pole.
        slews: samples before which the path may stop to change branch or turn, shape ``(n,)``;
            ``None`` allows no stop.
        stop: duration of a stop without its slew, s.
    """
    length, count = every.shape[:2]
    cost = np.where(np.isnan(every[0, :, 0]), np.inf, _entry(every[0], start))
    back = np.full((length, count), -1, dtype=np.int32)
    jumped = np.zeros((length, count), dtype=bool)
    via: dict[tuple[int, int], tuple[int, int, Passage]] = {}
    costs = [cost]
    by_last: dict[int, list[Passage]] = {}
    for passage in passages:
        by_last.setdefault(passage.last, []).append(passage)
    columns = np.arange(count)
    together = max(1, _PAIRS // count**2)
    for begin in range(1, length, together):
        end = min(length, begin + together)
        # One array for each axis: reductions over a short last axis are slow.
        after, before = every[begin:end, :, None], every[begin - 1 : end - 1, None]
        gaps = [np.abs(after[..., k] - before[..., k]) for k in range(every.shape[-1])]
        travel = np.sum(gaps, axis=0)
        far = [gap > most for gap, most in zip(gaps, bounds.longest_step, strict=True)]
        too_far = np.logical_or.reduce(far)
        steps = np.where(too_far, np.inf, travel)
        if slews is not None:
            may = too_far & slews[begin:end, None, None]
            steps[may] = _SLEW_COST * slew_times(np.stack([gap[may] for gap in gaps]).T, bounds)
        steps[np.isnan(travel)] = np.inf
        for k in range(begin, end):
            # Several slow samples in a row count as one stop.
            stops = too_far[k - begin] & ~jumped[k - 1][None, :]
            total = steps[k - begin] + cost[None, :] + _SLEW_COST * stop * stops
            pick = np.argmin(total, axis=1)
            cost = total[columns, pick]
            back[k] = pick
            jumped[k] = too_far[k - begin][columns, pick]
            for passage in by_last.get(k, ()):
                _offer(passage, every, costs[passage.first], cost, bounds, via)
            costs.append(cost)
    # Inside a passage no cost is finite, so trace back from its end.
    finite = [k for k in range(length) if np.any(np.isfinite(costs[k]))]
    reached = finite[-1] + 1 if finite else 0
    return _trace(every, costs, back, jumped, via, reached)


def _entry(candidate: Floats, start: Floats | None) -> Floats:
    if start is None:
        least: Floats = np.sum(np.abs(candidate), axis=-1) * 1e-3
        return least
    gap = np.max(np.abs(candidate - start), axis=-1)
    return np.where(gap < SAME, gap, np.inf)


def _offer(
    passage: Passage,
    every: Floats,
    before: Floats,
    cost: Floats,
    bounds: Bounds,
    via: dict[tuple[int, int], tuple[int, int, Passage]],
) -> None:
    """Add *passage* wherever it connects two candidates within the limits."""
    low, high = _ranges(bounds.axes)
    for origin in np.nonzero(np.isfinite(before))[0]:
        shift = every[passage.first, origin] - passage.joints[0]
        if np.max(np.abs(np.exp(1j * shift) - 1)) > _MATCH:
            continue
        joints = passage.joints + shift
        if np.any((joints < low) | (joints > high)):
            continue
        gap = np.max(np.abs(every[passage.last] - joints[-1]), axis=-1)
        goal = int(np.nanargmin(gap)) if np.any(~np.isnan(gap)) else -1
        if goal < 0 or gap[goal] > _MATCH:
            continue
        travel = float(np.sum(np.abs(np.diff(joints, axis=0))))
        price = before[origin] + travel + _ERROR_COST * passage.error
        if price < cost[goal]:
            cost[goal] = price
            via[passage.last, goal] = (passage.first, int(origin), passage)


def _ranges(axes: Sequence[AxisLimits]) -> tuple[Floats, Floats]:
    """Return the least and the largest angles of *axes* on a path, rad, both ``(axes,)``."""
    low, high, edge = np.array([(axis.low, axis.high, axis.resolution) for axis in axes]).T
    return low - edge, high + edge


def _trace(
    every: Floats,
    costs: list[Floats],
    back: np.ndarray[tuple[int, int], np.dtype[np.int32]],
    jumped: np.ndarray[tuple[int, int], np.dtype[np.bool_]],
    via: dict[tuple[int, int], tuple[int, int, Passage]],
    reached: int,
) -> Choice:
    joints = np.full((len(costs), every.shape[-1]), np.nan)
    slews: list[int] = []
    taken: list[Passage] = []
    if reached == 0:
        return Choice(joints, (), (), 0)
    k = reached - 1
    state = int(np.argmin(costs[k]))
    joints[k] = every[k, state]
    while k > 0:
        if (k, state) in via:
            first, origin, passage = via[k, state]
            joints[first : k + 1] = passage.joints + (every[first, origin] - passage.joints[0])
            taken.append(passage)
            k, state = first, origin
            continue
        if jumped[k, state]:
            slews.append(k)
        k, state = k - 1, int(back[k, state])
        joints[k] = every[k, state]
    return Choice(joints, tuple(reversed(slews)), tuple(reversed(taken)), reached)
