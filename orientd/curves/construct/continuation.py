"""The search for the increments of an interpolating cumulative B-spline, for steps of any size.

Newton's method alone converges for small steps.  For large ones the steps between keyframes and
the end conditions are scaled from nothing, where the spline is the one of Euclidean space, up to
their full size, and the solution is carried along.  That also makes the result the branch
connected with small rotations, a choice a caller can rely on.  Where the path folds back on its
way, it is followed by its length; where it does not arrive at all, Newton's method with step
control looks for a solution near the Euclidean one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace

import numpy as np

from orientd.curves.construct.basis import Indices
from orientd.curves.construct.interpolation import KeyframeEquations
from orientd.errors import PlanError
from orientd.rotation import Floats

_CONTRACTION = 0.25
"""A Newton correction must shrink at least so fast, or the scale grows by less."""

_LARGEST_GUESS_ERROR = 0.4
"""The first correction of predicted increments must not be longer, in rad of half angle."""

_REACH = 10
"""How many keyframes away a correction may be forgotten: it decays by 0.27 with each."""

_PART, _BEYOND = 1000, 30
"""Rows that are carried by themselves where there are more, and how many behind go along."""

_COUPLING = 2
"""How many keyframes away an unknown stands in a row."""

_LARGEST_SHARE_OF_ROWS = 0.2
_POLISHINGS = 8
_POLISHED = 1e-14

_SMALLEST_GROWTH = 1e-5
_ROUNDING = 1e-7
"""After a correction as small as this one the next, its square, is lost in rounding."""

_ON_THE_WAY = 1e-2
"""How small a correction has to be before the full scale is reached."""

_FIRST_LENGTH = 0.05
_SMALLEST_LENGTH = 1e-6
_FOLLOWED_STEPS = 300

_DESCENT_ITERATIONS = 300
_SMALLEST_SHARE = 1e-6


_NOT_FOUND = (
    "no twice differentiable interpolant was found through the keyframes: add keyframes, "
    "lower the end velocities or make neighbouring intervals more alike"
)

_MOST_CORRECTIONS: ContextVar[int] = ContextVar("most corrections", default=20_000)
"""More than searches take that find something: some 13,000 for hundreds of keyframes at uneven
times with half turns between them.  Without an end others go on for minutes."""


@contextmanager
def corrections_at_most(count: int) -> Iterator[None]:
    """Have searches in this context end with a PlanError after so many corrections.

    For who has other curves to try: the ordinary search takes a handful, a hard one hundreds, and
    one that finds nothing thousands, up to some limit in any case.
    """
    token = _MOST_CORRECTIONS.set(count)
    try:
        yield
    finally:
        _MOST_CORRECTIONS.reset(token)


@dataclass(frozen=True)
class _Path:
    """The last points of a continuation path, and its direction at the first.

    Only the unknowns in *needed* are carried on; the others are zero in what comes out.
    """

    scales: list[float]
    points: list[Floats]
    tangent: Floats
    needed: Indices | slice

    def at(self, scale: float) -> Floats:
        """Return the polynomial through the points, carried on to another scale, as a new array.

        From the first point, where nothing turns yet, the path goes along the tangent.
        """
        need = self.needed
        total: Floats = np.zeros(self.tangent.shape)
        if len(self.points) == 1:
            total[need] = self.points[0][need] + (scale - self.scales[0]) * self.tangent[need]
            return total
        for i, point in enumerate(self.points):
            others = [other for j, other in enumerate(self.scales) if j != i]
            weight = math.prod((scale - other) / (self.scales[i] - other) for other in others)
            total[need] += weight * point[need]
        return total

    def extended(self, scale: float, point: Floats) -> _Path:
        """Return the path with one more point, the oldest of four dropped."""
        return replace(self, scales=[*self.scales[-2:], scale], points=[*self.points[-2:], point])

    def around(self, rows: Indices) -> _Path:
        """Return the path of the unknowns that some rows depend on."""
        reach = rows[:, None] + np.arange(-_COUPLING, _COUPLING + 1)
        return replace(self, needed=np.unique(np.clip(reach, 0, len(self.tangent) - 1)))


def solve(equations: KeyframeEquations, unknown: Floats, found: int | None = None) -> Floats:
    """Return all increments, those settled by the end conditions included, shape ``(W, 3)``.

    Args:
        equations: of the spline.
        unknown: half-angle vectors, shape ``(N, 3)``; written to.
        found: how many of them Newton's method has found; ``None`` where it was not tried.

    Raises:
        PlanError: neither continuation nor the descent from the Euclidean spline arrives.
    """
    search = _Search(equations)
    solved = search.by_parts(unknown, equations.find(unknown, 0) if found is None else found)
    if solved is None:
        solved = search.continued()
    if solved is None:
        solved = search.descended()
    if solved is None:
        raise PlanError(_NOT_FOUND)
    return equations.complete(solved)


@dataclass(frozen=True)
class _Search:
    _equations: KeyframeEquations
    _corrections: Iterator[int] = field(default_factory=itertools.count)

    def by_parts(self, unknown: Floats, found: int) -> Floats | None:
        """Return the unknown increments, where a hard place in many of them is carried by itself.

        Args:
            unknown: half-angle vectors, shape ``(N, 3)``; written to.
            found: how many of them are found, which the next ones could not be.
        """
        count = len(unknown)
        while found < count:
            end = min(found + _PART, count)
            if (found == 0 and end == count) or not self._has_carried(unknown, found, end):
                return None
            found = end if end == count else self._equations.find(unknown, end)
        return unknown

    def _has_carried(self, unknown: Floats, begin: int, end: int) -> bool:
        """Write the increments of some rows, by themselves, and return whether they fit.

        What lies further beyond them than others are told of hardly counts.
        """
        beyond = min(end + _BEYOND, len(unknown))
        part = _Search(self._equations.part(unknown, begin, beyond), self._corrections)
        carried = part.continued()
        if carried is None:
            return False
        unknown[begin:beyond] = carried
        rows = np.arange(max(begin - _REACH, 0), min(begin + _REACH, len(unknown)))
        correction = self._correction(unknown, 1.0, rows)
        unknown[rows] += correction
        return bool(np.max(np.abs(correction)) <= _ROUNDING)

    def _correction(self, here: Floats, scale: float, rows: Indices) -> Floats:
        self._count()
        return self._equations.correction(here, scale, rows)

    def _count(self) -> None:
        if next(self._corrections) >= _MOST_CORRECTIONS.get():
            raise PlanError(_NOT_FOUND)

    def continued(self) -> Floats | None:
        """Return the solution that is connected with small rotations, if there is a path to it."""
        everything = np.arange(len(self._equations.steps))
        tangent = self._equations.linear_solution()
        origin = np.zeros_like(self._equations.steps)
        start = _Path([0.0], [origin], tangent, needed=slice(None))
        found = self._march(everything, start, 1.0, growth=1.0)
        return None if found is None else self._polished(found)

    def _polished(self, found: Floats) -> Floats | None:
        """Return increments corrected until only rounding is left, if they are a solution."""
        everything = np.arange(len(found))
        enough = _POLISHED * max(1.0, float(np.max(np.abs(found))))
        previous = _LARGEST_GUESS_ERROR
        for _ in range(_POLISHINGS):
            correction = self._correction(found, 1.0, everything)
            size = float(np.max(np.abs(correction)))
            if not size <= previous:
                break
            found = found + correction
            if size <= enough:
                return found
            previous = 0.5 * size
        return found if previous <= _ROUNDING else None

    def _march(self, rows: Indices, path: _Path, target: float, growth: float) -> Floats | None:
        """Return the increments with those of some rows carried on to a target scale.

        The increments of the other rows follow the polynomial through the path so far.
        """
        while path.scales[-1] < target:
            scale = min(target, path.scales[-1] + growth)
            found = self._attempt(rows, path, scale)
            if found is None:
                growth *= 0.5
                if growth < _SMALLEST_GROWTH:
                    return self._follow(rows, path, target)
                continue
            growth = 2.0 * (scale - path.scales[-1])
            path = path.extended(scale, found)
        return path.points[-1]

    def _follow(self, rows: Indices, path: _Path, target: float) -> Floats | None:
        """Return what :meth:`_march` does where the path folds back, followed by its length.

        The scale is one more unknown, and a step is so long in whichever of the unknowns, the
        scale among them, changes most (Keller, 1977, pseudo-arclength continuation).
        """
        scale, here = path.scales[-1], path.points[-1]
        weight = float(np.max(np.abs(self._equations.steps[rows])))
        before = (path.at(scale + 1e-6) - here)[rows] / 1e-6
        sense, length = 1.0, _FIRST_LENGTH
        for _ in range(_FOLLOWED_STEPS):
            rate = self._rate(here, scale, rows, path)
            if sense * (np.sum(rate * before) + weight**2) < 0.0:
                sense = -sense
            unit = sense / max(float(np.max(np.abs(rate))), weight)
            tangent = unit * rate
            while True:
                ahead = scale + length * unit
                if ahead >= target and unit > 0.0:
                    length, ahead = (target - scale) / unit, target
                guess = self._with_rows(path, ahead, rows, here[rows] + length * tangent)
                if ahead == target:
                    found, bad = self._newton(guess, target, rows)
                    if not len(bad):
                        return found
                else:
                    point = self._return_to_path(guess, ahead, rows, path, tangent, weight, unit)
                    if point is not None:
                        break
                length *= 0.5
                if length < _SMALLEST_LENGTH:
                    return None
            before = (point[0] - here)[rows]
            here, scale = point
            length *= 1.5
        return None

    def _return_to_path(
        self,
        here: Floats,
        scale: float,
        rows: Indices,
        path: _Path,
        tangent: Floats,
        weight: float,
        unit: float,
    ) -> tuple[Floats, float] | None:
        """Return the point of the path in the plane across the tangent, if it is near."""
        limit = _LARGEST_GUESS_ERROR
        while True:
            correction = self._correction(here, scale, rows)
            rate = self._rate(here, scale, rows, path)
            slope = float(np.sum(tangent * rate)) + weight**2 * unit
            if slope == 0.0:
                return None
            change = -float(np.sum(tangent * correction)) / slope
            correction = correction + change * rate
            size = max(float(np.max(np.abs(correction))), weight * abs(change))
            if not size <= limit:
                return None
            scale += change
            here = self._with_rows(path, scale, rows, here[rows] + correction)
            if size <= _ON_THE_WAY:
                return here, scale
            limit = max(_CONTRACTION * size, _ON_THE_WAY)

    def _rate(self, here: Floats, scale: float, rows: Indices, path: _Path) -> Floats:
        """Return how fast the increments of some rows change with the scale along the path."""
        self._count()
        step = 1e-6
        error = self._equations.errors(here, scale, rows)
        there = self._with_rows(path, scale + step, rows, here[rows])
        change = (self._equations.errors(there, scale + step, rows) - error) / step
        return self._equations.correction(here, scale, rows, change)

    def _with_rows(self, path: _Path, scale: float, rows: Indices, values: Floats) -> Floats:
        """Return the increments at a scale: given ones in some rows, the path's in the others."""
        here = path.at(scale)
        here[rows] = values
        return here

    def _attempt(self, rows: Indices, path: _Path, scale: float) -> Floats | None:
        """Return the increments at a scale, if Newton's method converges to them quickly.

        Where a few rows are in the way, they are carried there in smaller steps by themselves: a
        correction decays by 0.27 with each keyframe, so the others hardly take notice.
        """
        found, bad = self._newton(path.at(scale), scale, rows)
        if not len(bad):
            return found
        window = self._around(bad, rows)
        if len(window) > _LARGEST_SHARE_OF_ROWS * len(rows):
            return None
        growth = 0.5 * (scale - path.scales[-1])
        carried = self._march(window, path.around(window), scale, growth)
        if carried is None:
            return None
        found[window] = carried[window]
        found, bad = self._newton(found, scale, rows)
        return None if len(bad) else found

    def _newton(self, here: Floats, scale: float, rows: Indices) -> tuple[Floats, Indices]:
        """Return improved increments, and the rows at which the corrections shrink too slowly.

        The increments near such rows are left as they were.
        """
        here = here.copy()
        limit = _LARGEST_GUESS_ERROR
        enough = _ROUNDING if scale == 1.0 else _ON_THE_WAY
        while True:
            correction = self._correction(here, scale, rows)
            size = np.max(np.abs(correction), axis=1)
            is_bad = ~(size <= limit)
            if np.any(is_bad):
                good = np.setdiff1d(rows, self._around(rows[is_bad], rows), assume_unique=True)
                here[good] += correction[np.searchsorted(rows, good)]
                return here, rows[is_bad]
            here[rows] += correction
            is_moving = size > enough
            limit = max(_CONTRACTION * float(np.max(size)), _ROUNDING)
            if not np.any(is_moving):
                return here, rows[:0]
            rows = self._around(rows[is_moving], rows)

    def _around(self, some: Indices, rows: Indices) -> Indices:
        """Return those rows that are within reach of some of them; both are increasing."""
        following = np.minimum(np.searchsorted(some, rows - _REACH), len(some) - 1)
        near: Indices = rows[np.abs(some[following] - rows) <= _REACH]
        return near

    def descended(self) -> Floats | None:
        """Return a solution near the Euclidean spline, by Newton's method with step control.

        It serves where the continuation path folds back before it arrives: intervals of very
        different lengths with large steps.  The solution is one of several then.
        """
        everything = np.arange(len(self._equations.steps))
        here = self._equations.linear_solution()
        error = self._total_error(here)
        for _ in range(_DESCENT_ITERATIONS):
            correction = self._correction(here, 1.0, everything)
            share = 1.0
            while True:
                tried = here + share * correction
                error_there = self._total_error(tried)
                if error_there <= (1.0 - 0.1 * share) * error or error_there < _ROUNDING**2:
                    break
                share *= 0.5
                if share < _SMALLEST_SHARE:
                    return None
            here, error = tried, error_there
            if share == 1.0 and np.max(np.abs(correction)) <= _ROUNDING:
                return self._polished(here)
        return None

    def _total_error(self, unknown: Floats) -> float:
        everything = np.arange(len(unknown))
        return float(np.sum(self._equations.errors(unknown, 1.0, everything) ** 2))
