"""Search for the shortest connector: all ramps with a grid of durations, then the best ones."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from reference.joins import Ends, arrival, increments, rates, rough_rates

from orientd.model.limits import ACCELERATION_RESERVE, Limits
from orientd.planner import State
from orientd.planner.certify.measuring import limit_table
from orientd.rotation import Floats, between, exp, log, multiply

VELOCITY_MARGIN = 0.9995
"""Used share of the velocity limit; peaks between the checked points take the rest."""

ROUNDING = 1e-9
"""Tolerance for rounding: ramps reach their bounds exactly."""

RAMPS = 6
"""Most ramps at either end."""

SUBSTEPS = 2
"""Steps of Magnus' expansion in a ramp."""

GRID = 16
"""Number of durations in the first search."""

REFINED = 12
"""Number of durations in the second search."""

BEST = 6
"""Number of connectors that are measured first."""

CLOSE = (1.0, 1.004, 1.012, 1.03, 1.07, 1.15)
"""Factors of their durations to try."""

SHORTEST = 1e-6
"""Shortest join between two ramps, s."""

STILL = 1e-9
"""Rates up to this size count as zero, rad/s and rad/s^2."""

_BLOCK = 12  # connectors measured in one go: the first few mostly decide

Indices = np.ndarray[Any, np.dtype[np.intp]]
Booleans = np.ndarray[Any, np.dtype[np.bool_]]


class Way(NamedTuple):
    """A connector: a ramp, a join and another ramp, each a quintic.

    Attributes:
        q: orientations that they begin at, signs continuous, shape ``(3, 4)``.
        w: their half-angle increments, shape ``(3, 5, 3)``; of one that takes no time any.
        times: when they begin and when the last one ends, s, shape ``(4,)``.
    """

    q: Floats
    w: Floats
    times: Floats


class Ramps(NamedTuple):
    """Changes of the acceleration at one end, several to choose from.

    Attributes:
        ends: the states they lead to.
        durations: s; zero for none.
    """

    ends: Ends
    durations: Floats


def search(start: State, end: State, limits: Limits, period: float, least: float) -> Way | None:
    """Return the shortest connector, or ``None`` if the search finds none.

    Args:
        start: where it begins.
        end: where it ends.
        limits: to keep, with their reserve.
        period: it takes a whole number of periods, s.
        least: it takes at least this long, s.
    """
    bounds = Bounds.of(start, end, limits)
    way = log(between(start.q, end.q))
    into = ramps(start, way, bounds, limits, period)
    mirrored = State(end.q, -end.omega_body, end.alpha_body, end.position)
    out_of = ramps(mirrored, -way, bounds, limits, period)
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
    if not len(found.totals):
        return None
    # Once more, between the shortest duration that will do and the one before it.
    step = totals[1] / totals[0] if len(totals) > 1 else 1.0
    nearest = np.unique(found.pairs[:BEST])
    finer = found.totals[0] * step ** -np.linspace(0.0, 1.0, REFINED)
    finer = np.unique(np.ceil(finer[finer >= least - 1e-9] / period - 1e-9)) * period
    of_pairs, of_totals = np.repeat(nearest, len(finer)), np.tile(finer, len(nearest))
    found = found.and_also(_look(first, last, ramped, of_pairs, of_totals, bounds))
    near = found.some(slice(0, BEST)).longer(period)
    kept = _first_kept(first, last, ramped, near, bounds)
    kept = kept or _first_kept(first, last, ramped, found, bounds)
    if kept is None:
        return None
    pair, total, w = kept
    begin = Ends(start.q, start.omega_body, start.alpha_body)
    finish = Ends(end.q, end.omega_body, end.alpha_body)
    into_join, out_of_join = first.one(pair), last.one(pair)
    before, after = float(into.durations[one[pair]]), float(out_of.durations[other[pair]])
    ramps_w = increments_of(begin, into_join, before), increments_of(out_of_join, finish, after)
    q = [start.q, into_join.q, out_of_join.q]
    # The sign of each goes on from the one before.
    if before > 0.0:
        q[1] = math.copysign(1.0, float(arrival(q[0], ramps_w[0]) @ q[1])) * q[1]
    q[2] = math.copysign(1.0, float(arrival(q[1], w) @ q[2])) * q[2]
    return Way(
        np.stack(q),
        np.stack([ramps_w[0], w, ramps_w[1]]),
        np.array([0.0, before, total - after, total]),
    )


def increments_of(first: Ends, last: Ends, duration: float) -> Floats:
    """Return the increments of one join, the shorter way round, shape ``(5, 3)``."""
    one, other = (Ends(*(part[None] for part in ends)) for ends in (first, last))
    found: Floats = increments(one, other, np.array([duration]))[0, 0]
    return found


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
        totals = np.ceil((self.totals[:, None] * np.array(CLOSE)) / period - 1e-9) * period
        pairs, ways = (np.repeat(part, len(CLOSE)) for part in (self.pairs, self.ways))
        return _Found(pairs, ways, totals.reshape(-1)).sorted()


def _look(
    first: Ends, last: Ends, ramped: Floats, pairs: Indices, totals: Floats, bounds: Bounds
) -> _Found:
    """Return which of the connectors seem to keep the bounds, the shortest first."""
    durations = totals - ramped[pairs]
    is_long = durations > SHORTEST
    pairs, totals, durations = pairs[is_long], totals[is_long], durations[is_long]
    is_kept = [
        bounds.keeps(rough_rates(way, durations, with_axes=bounds.has_axes))
        for way in increments(first.at(pairs), last.at(pairs), durations)
    ]
    found = [np.flatnonzero(way) for way in is_kept]
    ways = np.repeat([0, 1], [len(part) for part in found])
    index = np.concatenate(found)
    return _Found(pairs[index], ways, totals[index]).sorted()


def _first_kept(
    first: Ends, last: Ends, ramped: Floats, some: _Found, bounds: Bounds
) -> tuple[int, float, Floats] | None:
    """Return pair, duration and increments of the first connector that keeps the bounds."""
    for begin in range(0, len(some.totals), _BLOCK):
        block = some.some(slice(begin, begin + _BLOCK))
        durations = block.totals - ramped[block.pairs]
        w = increments(first.at(block.pairs), last.at(block.pairs), durations)
        w = w[block.ways, np.arange(len(durations))]
        is_kept = bounds.keeps(rates(w, durations, with_axes=bounds.has_axes))
        index = int(np.argmax(is_kept))
        if is_kept[index]:
            return int(block.pairs[index]), float(block.totals[index]), w[index]
    return None


class Bounds(NamedTuple):
    """Bounds of a connector: the limits with their reserve, but never below its initial rates.

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
        """Return the bounds for a connector between two states."""
        reserved = limits.with_reserve(reserve)
        most = limit_table(reserved).copy()
        most[0] *= VELOCITY_MARGIN
        given: Floats = np.empty((2, 2, 4))
        given[..., 1:] = np.abs([(state.omega_body, state.alpha_body) for state in (start, end)])
        given[..., 0] = np.sqrt(np.einsum("...i,...i->...", given[..., 1:], given[..., 1:]))
        np.maximum(most[:2], given.max(axis=0), out=most[:2])
        # Ramps go right up to the bounds: rounding must not decide which of them keep them.
        most *= 1.0 + ROUNDING
        return cls(most if limits.has_axes else most[:, :1].copy(), limits.has_axes)

    @property
    def least(self) -> tuple[float, float, float]:
        """The bounds that hold in any direction."""
        velocity, acceleration, jerk = self.most.min(axis=1).tolist()
        return velocity, acceleration, jerk

    def keeps(self, rates: Floats) -> Booleans:
        """Return which of several connectors keep the bounds, by their largest rates."""
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
    step = math.log(longest / shortest) / (GRID - 1)
    durations = shortest * np.exp(step * np.arange(GRID))
    return np.unique(np.ceil(durations / period - 1e-9)) * period


def ramps(
    state: State,
    way: Floats,
    bounds: Bounds,
    limits: Limits,
    period: float,
    *,
    in_cycles: bool = False,
) -> Ramps:
    """Return changes of the acceleration that a connector from *state* may begin with."""
    omega, alpha = state.omega_body, state.alpha_body
    reserved = limits.with_reserve()
    targets = [alpha]
    if np.linalg.norm(alpha) > STILL:
        targets.append(np.zeros(3))
    for vector in (-omega, way):
        size = float(np.linalg.norm(vector))
        if size > STILL:
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
    most = bounds.most[0]
    if in_cycles:
        most = np.maximum(most, limit_table(limits)[0, : len(most)])
        least, durations = durations, np.ceil(durations / period - 1e-9) * period
        is_fast = _are_fast(omega + 0.5 * durations[:, None] * (alpha + goals), most)
        is_fast &= durations > period
        is_fast[0] = False
        # What whole cycles there are of a ramp that would become too fast with the last one.
        durations = np.where(is_fast, durations - period, durations)
        share = np.where(is_fast, durations / least, 1.0)[:, None]
        goals = np.where(is_fast[:, None], alpha + share * change, goals)
    durations[0] = 0.0
    speeds = omega + 0.5 * durations[:, None] * (alpha + goals)
    is_slow = ~_are_fast(speeds, most)
    is_slow[0] = True
    goals, durations, speeds = goals[is_slow], durations[is_slow], speeds[is_slow]
    q = turned(state.q, omega, alpha, goals, durations)
    return Ramps(Ends(q, speeds, goals), durations)


def _are_fast(speeds: Floats, most: Floats) -> Booleans:
    """Return which angular velocities are above a bound on the norm, or on a component."""
    sizes = np.sqrt(np.einsum("ni,ni->n", speeds, speeds))[:, None]
    if len(most) > 1:
        sizes = np.concatenate([sizes, np.abs(speeds)], axis=1)
    is_fast: Booleans = np.any(sizes > most, axis=1)
    return is_fast


def turned(q: Floats, omega: Floats, alpha: Floats, goals: Floats, durations: Floats) -> Floats:
    r"""Return where ramps lead to, by Magnus' expansion of fourth order.

    .. math:: \exp\bigl(\tfrac h2 (\omega_a + \omega_b) + \tfrac{\sqrt3}{12} h^2
              \omega_a \times \omega_b\bigr)

    Blanes et al. (2009), eq. 254, for :math:`\dot q = \tfrac12 q \omega`, whose sign of the
    commutator is the opposite one, with the velocities at Gauss' two nodes.
    """
    ends = np.repeat(q[None], len(goals), axis=0)
    h = durations[:, None] / SUBSTEPS
    slope = (goals - alpha) / np.where(durations > 0.0, durations, 1.0)[:, None]
    for step in range(SUBSTEPS):
        a, b = (
            omega + t * alpha + 0.5 * t * t * slope
            for t in ((step + 0.5 + side * math.sqrt(3.0) / 6.0) * h for side in (-1.0, 1.0))
        )
        ends = multiply(
            ends, exp(h / 2.0 * (a + b) + math.sqrt(3.0) / 12.0 * h * h * np.cross(a, b))
        )
    return ends
