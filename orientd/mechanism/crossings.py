"""Crossings between the lines of a path at fixed times: which there are, and what they cost.

The path does not wait.  A crossing begins before the axes would leave the path, and ends behind
that: the choice of this instant splits the loss between both sides of the keyhole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orientd.driver import AxisLimits
from orientd.mechanism.router import EDGE, Bools, Chain, Crossing, Edges, Indices, Sky, cheapest
from orientd.rotation import Floats

_COARSE = 0.2
"""Time between the samples of the search, before crossings are refined, s."""
_MOST_SAMPLES, _MOST_STARTS = 3500, 700
"""Samples of the search, and those of them at which a crossing may begin."""
_POINTS, _FINE_POINTS = 128, (512, 1024, 2048)
"""Points at which a crossing is weighed in the search, and in each round of its refinement."""
_REFINED = 41
"""Instants of its begin that a round compares."""
_FINER = 12
"""How much finer they are than those of the round before."""
_LEAVING = 1e-3
"""Cost of a second off the line, in seconds lost: of equal losses the exact path is better."""
_TRAVEL = 1e-4
"""Cost of a radian of the outer axis, in seconds lost."""


class Crossings:
    """The search for the chain of lines with the least time off a path.

    Args:
        sky: the path with its lines.
        period: of its samples, s.
        axes: limits of the axes that the plan may use.
        tolerance: largest error that counts as on the path, rad.
        counts: of each sample, whether being off the path there counts as lost, shape ``(n,)``.
    """

    def __init__(
        self,
        sky: Sky,
        period: float,
        axes: Sequence[AxisLimits],
        tolerance: float,
        counts: Bools,
    ) -> None:
        self._sky, self._period = sky, period
        self._limit, self._speed = np.sin(tolerance), np.array([axis.velocity for axis in axes])
        self._weight = np.where(counts, 1.0, _LEAVING)
        is_off = [line.error > tolerance for line in sky.lines]
        self._off = [np.cumsum(period * self._weight * one) for one in is_off]
        """Time off the path on each line, up to and with each sample, s."""
        count = len(sky.exact)
        stride = max(1, round(_COARSE / period), -(-count // _MOST_SAMPLES))
        self._at = at = np.unique(np.append(np.arange(0, count, stride), count - 1))
        self._joints = np.stack([line.joints[at] for line in sky.lines])
        self._quick = np.stack(
            [np.logical_or.reduceat(line.is_quick, at[:-1]) for line in sky.lines]
        )
        lost = np.stack(is_off)[:, at[:-1]] * (self._weight[at[:-1]] * np.diff(at) * period)
        self._stay = lost + _TRAVEL * np.abs(np.diff(self._joints[..., 0], axis=1))
        self._runs = [self._runs_of(one) for one in self._quick]
        self._closed: set[tuple[int, int]] = set()

    def _runs_of(self, quick: Bools) -> list[tuple[int, int]]:
        """Return the first and the last place in the grid of each run of a line."""
        cuts = np.flatnonzero(quick).tolist()
        ends = zip([0, *(cut + 1 for cut in cuts)], [*cuts, len(self._at) - 1], strict=True)
        return [(a, b) for a, b in ends if b > a]

    def close(self, origin: int, goal: int) -> None:
        """Leave out all crossings from one line to another from now on."""
        self._closed.add((origin, goal))

    def best(self, entry: Floats) -> Chain | None:
        """Return the chain with the least time off the path; ``None`` if none reaches its end.

        Args:
            entry: cost of beginning on each line, s; infinite where that is impossible.
        """
        if len(self._at) < 2:
            return Chain(int(np.argmin(entry)), ())
        found = cheapest(entry, self._stay, self._quick, self._edges, self._at)
        if found is None:
            return None
        crossings: list[Crossing] = []
        after = [*(one.first for one in found.crossings[1:]), len(self._sky.exact) - 1]
        for one, most in zip(found.crossings, after, strict=False):
            least = crossings[-1].last if crossings else 0
            crossings.append(self.refined(one, least, most) or one)
        return found._replace(crossings=tuple(crossings))

    def _edges(self, origin: int, goal: int) -> list[Edges]:
        """Return the quickest crossing from samples of a line to each run of another.

        On a run ``angle - v t`` falls and ``angle + v t`` rises with the time.  So the earliest
        sample at which an axis can be there is found by bisection, on either side.
        """
        if (origin, goal) in self._closed:
            return []
        at, size, way = self._at, len(self._at), self._speed * self._period
        starts = np.arange(0, size, max(1, size // _MOST_STARTS))
        starts = np.unique(np.concatenate([starts, [b for _, b in self._runs[origin]]]))
        starts = starts.astype(np.intp)
        found = []
        for a, b in self._runs[goal]:
            here = starts[starts < (a if origin == goal else b)]
            if not len(here):
                continue
            own, ahead = self._joints[origin, here], self._joints[goal, a : b + 1]
            arrived = np.maximum(here + 1 - a, 0)
            for k in range(len(way)):
                falls = np.minimum.accumulate(ahead[:, k] - way[k] * at[a : b + 1])
                rises = np.maximum.accumulate(ahead[:, k] + way[k] * at[a : b + 1])
                least, most = own[:, k] - way[k] * at[here], own[:, k] + way[k] * at[here]
                arrived = np.maximum(arrived, np.searchsorted(-falls, -least - EDGE))
                arrived = np.maximum(arrived, np.searchsorted(rises, most - EDGE))
            fits = arrived <= b - a
            begin, end = here[fits], arrived[fits] + a
            if len(begin):
                cost = self._cost(Crossing(0, 0, origin, goal), at[begin], at[end], _POINTS)
                found.append(Edges(begin, end, cost))
        return found

    def _cost(self, crossing: Crossing, first: Indices, last: Indices, points: int) -> Floats:
        """Return the cost of a crossing with each of other ends, s, shape ``(m,)``."""
        sky, begin = self._sky, self._sky.lines[crossing.origin].joints[first, 0]
        turn = self._sky.lines[crossing.goal].joints[last, 0] - begin
        lasts = (last - first) * self._period
        share = (np.arange(points) + 0.5) / points
        at = np.rint(first[:, None] + share * (last - first)[:, None]).astype(np.intp)
        weight = self._weight[at]
        if crossing.via is None:
            ahead = begin[:, None] + share * turn[:, None] - sky.exact[at]
            sine, is_open = sky.sine[at], sky.is_open
            error = sine * np.abs(np.sin(ahead))
            if not all(is_open):
                # On the far side of the pole the inner axis stays at the pole.
                error = np.where((np.cos(ahead) > 0.0) == is_open[0], error, sine)
            weight = weight * (error > self._limit)
        cost: Floats = lasts * np.mean(weight, axis=1) + _LEAVING * lasts + _TRAVEL * np.abs(turn)
        return cost

    def _needed(self, crossing: Crossing, first: Indices, last: Indices) -> Floats:
        """Return the least time of a crossing with other ends, s, shape ``(first, last)``."""
        begin = self._sky.lines[crossing.origin].joints[first]
        end = self._sky.lines[crossing.goal].joints[last]
        if crossing.via is None or not len(crossing.via):
            gaps = np.abs(end[None] - begin[:, None])
            return np.asarray(np.max(gaps / self._speed, axis=2), dtype=np.float64)
        via = crossing.via
        head = np.max(np.abs(via[0] - begin) / self._speed, axis=1)
        tail = np.max(np.abs(end - via[-1]) / self._speed, axis=1)
        middle = float(np.sum(np.max(np.abs(np.diff(via, axis=0)) / self._speed, axis=1)))
        found: Floats = head[:, None] + middle + tail[None]
        return found

    def refined(self, crossing: Crossing, least: int, most: int, wide: int = 0) -> Crossing | None:
        """Return a crossing with the best ends around its own, among all samples.

        Time off the path counts on the crossing, and on both lines next to it.  ``None`` if no ends
        give the axes the time that they need.

        Args:
            crossing: it begins and ends on its lines, or nearly.
            least: first sample at which it may begin.
            most: last sample at which it may end.
            wide: samples by which it may begin earlier or later, if more than the search leaves
                open.
        """
        origin, goal = (self._sky.lines[place] for place in (crossing.origin, crossing.goal))
        wide = max(wide, 4 * max(1, len(self._at) // _MOST_STARTS) * int(self._at[1]))
        off = self._off[crossing.origin], self._off[crossing.goal]
        begin, end, is_found = crossing.first, crossing.last, False
        for points in _FINE_POINTS:
            first = np.unique(np.linspace(begin - wide, begin + wide, _REFINED).astype(np.intp))
            first = first[(first >= least) & (first < end + wide)]
            # It stays on its line until it begins, and on the other one from its end on.
            slow = np.flatnonzero(origin.is_quick[crossing.first : int(first.max(initial=0))])
            if len(slow):
                first = first[first <= crossing.first + slow[0]]
            last = np.arange(max(1, end - 3 * wide), min(most, end + 3 * wide) + 1)
            if not len(first) or not len(last):
                break
            quick = np.flatnonzero(goal.is_quick[last[0] : crossing.last])
            if len(quick):
                last = last[last > last[0] + quick[-1]]
            lasts = (last[None] - first[:, None]) * self._period
            fits = self._needed(crossing, first, last) <= lasts + EDGE * self._period
            fits &= lasts > 0.0
            # After its last step that is too quick the line must continue.
            fits &= ~np.append(goal.is_quick, False)[last]
            is_any = np.any(fits, axis=1)
            if not np.any(is_any):
                break
            first, last = first[is_any], last[np.argmax(fits[is_any], axis=1)]
            cost = self._cost(crossing, first, last, points) + off[0][first] - off[1][last]
            best = int(np.argmin(cost))
            begin, end, is_found = int(first[best]), int(last[best]), True
            wide = max(1, wide // _FINER)
        return crossing._replace(first=begin, last=end) if is_found else None
