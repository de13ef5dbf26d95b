r"""Bridges: the shortest way found from one state of motion to another, inside the limits.

A bridge is a quintic join with, where that is quicker or needed, a ramp before it and one behind:
a ramp changes the acceleration alone, at the limit of the jerk.  Without a ramp a quintic that
begins with a large acceleration keeps some of it for long, and may not keep the limit of the
velocity for any duration.  All ramps are tried with a grid of durations; the shortest of the
bridges is refined and measured on the curve.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from orientd.curves import Curve
from orientd.errors import PlanError
from orientd.planner.fast import Booleans, kernels
from orientd.planner.limits import ACCELERATION_RESERVE, ANGULAR, Limits
from orientd.planner.path import Stretch
from orientd.planner.quintic import (
    AT_FINE,
    TO_RATES,
    Ends,
    increments,
    join,
    rates,
    rough_rates,
)
from orientd.planner.request import State
from orientd.rotation import Floats, between, exp, log, multiply

_VELOCITY_MARGIN = 0.9995  # of the limit, for peaks between the points that are looked at
_GRID = 16  # durations of the first look
_REFINED = 12  # durations of the second look
_CLOSE = np.array([1.0, 1.004, 1.012, 1.03, 1.07, 1.15])
_BEST = 6  # bridges that are measured first
_BLOCK = 12  # bridges measured in one go: the first few mostly decide
_SUBSTEPS = 2
_STILL = 1e-9
_ROUNDING = 1e-9

Indices = np.ndarray[Any, np.dtype[np.intp]]


class _Ramps(NamedTuple):
    """Changes of the acceleration at one end, several to choose from.

    Attributes:
        ends: the states they lead to.
        durations: s; zero for none.
    """

    ends: Ends
    durations: Floats


def bridge(
    start: State, end: State, *, limits: Limits, period: float, least: float = 0.0
) -> list[Stretch]:
    """Return stretches from path time 0 that lead from one state to another.

    The velocity, and the acceleration, may be as high as they are at the ends, and otherwise keep
    *limits* with their reserve.

    Args:
        start: where they begin.
        end: where they end.
        limits: to keep.
        period: they take a whole number of periods, s.
        least: they take at least this long, s.

    Raises:
        PlanError: nothing was found.
    """
    bounds = Bounds.of(start, end, limits)
    way = log(between(start.q, end.q))
    into = _ramps(start, way, bounds, limits, period)
    mirrored = State(end.q, -end.omega_body, end.alpha_body, end.position)
    out_of = _ramps(mirrored, -way, bounds, limits, period)
    out_of = out_of._replace(ends=out_of.ends._replace(omega=-out_of.ends.omega))

    one = np.repeat(np.arange(len(into.durations)), len(out_of.durations))
    other = np.tile(np.arange(len(out_of.durations)), len(into.durations))
    ramped = into.durations[one] + out_of.durations[other]
    first, last = into.ends.at(one), out_of.ends.at(other)
    totals = _grid(start, end, float(np.linalg.norm(way)), bounds, period, least)
    pairs = np.arange(len(one))
    found = _look(
        first, last, ramped, np.repeat(pairs, len(totals)), np.tile(totals, len(one)), bounds
    )
    if len(found.totals):
        # Once more, between the shortest duration that will do and the one before it.
        step = totals[1] / totals[0] if len(totals) > 1 else 1.0
        nearest = np.unique(found.pairs[:_BEST])
        best = found.totals[0]
        finer = best * step ** -np.linspace(0.0, 1.0, _REFINED)
        finer = np.unique(np.ceil(finer[finer >= least - 1e-9] / period - 1e-9)) * period
        if len(finer):
            fine = _look(
                first,
                last,
                ramped,
                np.repeat(nearest, len(finer)),
                np.tile(finer, len(nearest)),
                bounds,
            )
            found = found.and_also(fine)
        near = found.some(slice(0, _BEST))
        tries = [near.longer(period), found]
    else:
        tries = []
    for some in tries:
        for begin in range(0, len(some.totals), _BLOCK):
            block = some.some(slice(begin, begin + _BLOCK))
            kept = _first_kept(first, last, ramped, block, bounds)
            if kept is not None:
                index, w = kept
                pair = int(block.pairs[index])
                return _stretches(
                    start,
                    end,
                    Ends(*(part[pair] for part in first)),
                    Ends(*(part[pair] for part in last)),
                    (float(into.durations[one[pair]]), float(out_of.durations[other[pair]])),
                    w,
                    float(block.totals[index]),
                )
    raise PlanError(
        f"no way found from {np.linalg.norm(start.omega_body):.4g} rad/s to "
        f"{np.linalg.norm(end.omega_body):.4g} rad/s over {np.linalg.norm(way):.4g} rad"
    )


class _Found(NamedTuple):
    pairs: Indices
    ways: Indices
    totals: Floats

    def some(self, index: slice | Indices) -> _Found:
        return _Found(self.pairs[index], self.ways[index], self.totals[index])

    def and_also(self, other: _Found) -> _Found:
        pairs, ways, totals = (np.concatenate(parts) for parts in zip(self, other, strict=True))
        return _Found(pairs, ways, totals).sorted()

    def sorted(self) -> _Found:
        return self.some(np.argsort(self.totals, kind="stable"))

    def longer(self, period: float) -> _Found:
        """Return each with durations a little longer, too."""
        totals = np.ceil((self.totals[:, None] * _CLOSE) / period - 1e-9) * period
        pairs, ways = (np.repeat(part, len(_CLOSE)) for part in (self.pairs, self.ways))
        return _Found(pairs, ways, totals.reshape(-1)).sorted()


def _look(
    first: Ends, last: Ends, ramped: Floats, pairs: Indices, totals: Floats, bounds: Bounds
) -> _Found:
    """Return which of the bridges seem to keep the bounds, the shortest first."""
    durations = totals - ramped[pairs]
    is_long = durations > 1e-6
    pairs, totals, durations = pairs[is_long], totals[is_long], durations[is_long]
    compiled = kernels().look
    if compiled is not None:
        is_kept = np.empty((2, len(pairs)), dtype=np.bool_)
        compiled(*first, *last, pairs, durations, TO_RATES, bounds.most, is_kept)
    else:
        is_kept = np.stack(
            [
                bounds.keeps(rough_rates(way, durations, with_axes=bounds.has_axes))
                for way in increments(first.at(pairs), last.at(pairs), durations)
            ]
        )
    found = [np.flatnonzero(way) for way in is_kept]
    ways = np.repeat([0, 1], [len(part) for part in found])
    index = np.concatenate(found)
    return _Found(pairs[index], ways, totals[index]).sorted()


def _first_kept(
    first: Ends, last: Ends, ramped: Floats, some: _Found, bounds: Bounds
) -> tuple[int, Floats] | None:
    """Return the first of some bridges that keeps the bounds on the curve, and its increments."""
    durations = some.totals - ramped[some.pairs]
    compiled = kernels().measure
    if compiled is not None:
        found: Floats = np.empty((5, 3))
        index = compiled(
            *first, *last, some.pairs, some.ways, durations, AT_FINE, bounds.most, found
        )
        return None if index < 0 else (index, found)
    w = increments(first.at(some.pairs), last.at(some.pairs), durations)
    w = w[some.ways, np.arange(len(durations))]
    is_kept = bounds.keeps(rates(w, durations, with_axes=bounds.has_axes))
    index = int(np.argmax(is_kept))
    return (index, w[index]) if is_kept[index] else None


class Bounds(NamedTuple):
    """What a bridge keeps: the limits with their reserve, but never less than what it begins with.

    Attributes:
        most: velocity, acceleration and jerk: the norm, and the components where they are limited,
            shape ``(3, 1 or 4)``.
        has_axes: whether they are.
    """

    most: Floats
    has_axes: bool

    @classmethod
    def of(
        cls, start: State, end: State, limits: Limits, reserve: float = ACCELERATION_RESERVE
    ) -> Bounds:
        """Return the bounds for a way between two states."""
        reserved = limits.with_reserve(reserve)
        most: Floats = np.array(
            [(getattr(reserved, name), *reserved.axes(name)) for name in ANGULAR]
        )
        most[0] *= _VELOCITY_MARGIN
        given: Floats = np.empty((2, 2, 4))
        given[..., 1:] = np.abs([(state.omega_body, state.alpha_body) for state in (start, end)])
        given[..., 0] = np.sqrt(np.einsum("...i,...i->...", given[..., 1:], given[..., 1:]))
        np.maximum(most[:2], given.max(axis=0), out=most[:2])
        # Ramps go right up to the bounds: rounding must not decide which of them keep them.
        most *= 1.0 + _ROUNDING
        return cls(most if limits.has_axes else most[:, :1].copy(), limits.has_axes)

    @property
    def least(self) -> tuple[float, float, float]:
        """What is allowed in any direction."""
        velocity, acceleration, jerk = self.most.min(axis=1).tolist()
        return velocity, acceleration, jerk

    def keeps(self, rates: Floats) -> Booleans:
        """Return which of several ways keep the bounds, by their largest rates."""
        kept: Booleans = np.all(rates <= self.most[..., None], axis=(0, 1))
        return kept


def _grid(
    start: State, end: State, angle: float, bounds: Bounds, period: float, least: float
) -> Floats:
    """Return durations from too short to long enough, in whole periods, s."""
    velocity, acceleration, jerk = bounds.least
    change = float(np.linalg.norm(end.omega_body - start.omega_body))
    speed = float(np.linalg.norm(start.omega_body) + np.linalg.norm(end.omega_body))
    size = float(np.linalg.norm(start.alpha_body) + np.linalg.norm(end.alpha_body))
    shortest = max(
        0.5 * angle / float(bounds.most[0, 0]),
        math.sqrt(angle / float(bounds.most[1, 0])),
        change / float(bounds.most[1, 0]),
        period,
        least,
    )
    longest = (
        2.0 * angle / velocity
        + 3.0 * math.sqrt(angle / acceleration)
        + 5.0 * math.cbrt(angle / jerk)
        + 5.0 * speed / acceleration
        + 8.0 * math.sqrt(speed / jerk)
        + 12.0 * size / jerk
        + 8.0 * period
    )
    longest = max(longest, 3.0 * least, shortest)
    step = math.log(longest / shortest) / (_GRID - 1)
    durations = shortest * np.exp(step * np.arange(_GRID))
    return np.unique(np.ceil(durations / period - 1e-9)) * period


def _ramps(
    state: State,
    way: Floats,
    bounds: Bounds,
    limits: Limits,
    period: float,
    *,
    in_cycles: bool = False,
) -> _Ramps:
    """Return changes of the acceleration that a bridge from *state* may begin with."""
    omega, alpha = state.omega_body, state.alpha_body
    reserved = limits.with_reserve()
    targets = [alpha]
    if np.linalg.norm(alpha) > _STILL:
        targets.append(np.zeros(3))
    for vector in (-omega, way):
        size = float(np.linalg.norm(vector))
        if size > _STILL:
            direction = vector / size
            _, most, _ = reserved.along(direction.tolist())
            if math.isfinite(most):
                targets += [direction * (share * most) for share in (0.5, 1.0)]
    goals = np.array(targets)
    change = goals - alpha
    sizes = np.sqrt(np.einsum("ni,ni->n", change, change))
    durations = sizes / reserved.jerk
    if limits.has_axes:
        durations = np.maximum(durations, np.max(np.abs(change) / reserved.axis_jerk, axis=1))
    durations = np.maximum(durations, period)
    if in_cycles:
        durations = np.ceil(durations / period - 1e-9) * period
    durations[0] = 0.0
    speeds = omega + 0.5 * durations[:, None] * (alpha + goals)
    is_slow = np.sqrt(np.einsum("ni,ni->n", speeds, speeds)) <= bounds.most[0, 0]
    if limits.has_axes:
        is_slow &= np.all(np.abs(speeds) <= bounds.most[0, 1:], axis=1)
    is_slow[0] = True
    goals, durations, speeds = goals[is_slow], durations[is_slow], speeds[is_slow]
    q = turned(state.q, omega, alpha, goals, durations)
    return _Ramps(Ends(q, speeds, goals), durations)


def turned(q: Floats, omega: Floats, alpha: Floats, goals: Floats, durations: Floats) -> Floats:
    r"""Return where ramps lead to, by Magnus' expansion of fourth order.

    .. math:: \exp\bigl(\tfrac h2 (\omega_a + \omega_b) + \tfrac{\sqrt3}{12} h^2
              \omega_a \times \omega_b\bigr)

    Blanes et al. (2009), eq. 254, for :math:`\dot q = \tfrac12 q \omega`, whose sign of the
    commutator is the opposite one, with the velocities at Gauss' two nodes.
    """
    compiled = kernels().turn
    if compiled is not None:
        ends: Floats = np.empty((len(goals), 4))
        compiled(q, omega, alpha, goals, durations, _SUBSTEPS, ends)
        return ends
    ends = np.repeat(q[None], len(goals), axis=0)
    h = durations[:, None] / _SUBSTEPS
    slope = (goals - alpha) / np.where(durations > 0.0, durations, 1.0)[:, None]
    for step in range(_SUBSTEPS):
        a, b = (
            omega + t * alpha + 0.5 * t * t * slope
            for t in ((step + 0.5 + side * math.sqrt(3.0) / 6.0) * h for side in (-1.0, 1.0))
        )
        ends = multiply(
            ends, exp(h / 2.0 * (a + b) + math.sqrt(3.0) / 12.0 * h * h * np.cross(a, b))
        )
    return ends


def ramped_stops(
    state: State, limits: Limits, period: float
) -> Iterator[tuple[Stretch | None, State]]:
    """Yield ramps that a stop may begin with, of whole periods, and the states they lead to.

    The first one is none at all.
    """
    bounds = Bounds.of(state, state, limits)
    ramps = _ramps(state, np.zeros(3), bounds, limits, period, in_cycles=True)
    begin = Ends(state.q, state.omega_body, state.alpha_body)
    for index, duration in enumerate(ramps.durations.tolist()):
        end = Ends(*(part[index] for part in ramps.ends))
        ramp = Stretch(_single(begin, end, duration), 0.0, duration) if duration else None
        yield ramp, State(*end, state.position)


def _stretches(
    start: State,
    end: State,
    first: Ends,
    last: Ends,
    ramps: tuple[float, float],
    w: Floats,
    total: float,
) -> list[Stretch]:
    before, after = ramps
    stretches = []
    begin = Ends(start.q, start.omega_body, start.alpha_body)
    finish = Ends(end.q, end.omega_body, end.alpha_body)
    if before > 0.0:
        stretches.append(Stretch(_single(begin, first, before), 0.0, before))
    stretches.append(Stretch(join(first.q, w, total - before - after), before, total - after))
    if after > 0.0:
        stretches.append(Stretch(_single(last, finish, after), total - after, total))
    return stretches


def _single(first: Ends, last: Ends, duration: float) -> Curve:
    compiled = kernels().join
    if compiled is not None:
        w: Floats = np.empty((5, 3))
        compiled(*first, *last, duration, w)
        return join(first.q, w, duration)
    one, other = (Ends(*(part[None] for part in ends)) for ends in (first, last))
    return join(first.q, increments(one, other, np.array([duration]))[0, 0], duration)
