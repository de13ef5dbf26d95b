r"""Trajectories: the one table that every curve of orientations compiles to.

On piece *k*, over :math:`[t_k, t_{k+1}]` with *u* from -1 to 1 along it,

.. math:: q(t) = q_k \exp(r_k(u)), \qquad r_k(u) = \sum_{j=0}^{9} c_{kj} u^j

where :math:`r_k` is a rotation vector in rad.  The coefficients follow from the orientations at the
ten Lobatto nodes of the piece alone.  Body angular velocity, acceleration and jerk follow from the
right Jacobian of the exponential (Sola et al., 2018, eq. 143), so curves need no derivatives of
their own. ``orientd/kernels/c/trajectory.h`` has the formulas.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from orientd.errors import PlanError
from orientd.kernels import (
    fit_trajectory,
    product_trajectory,
    retime_trajectory,
    sample_trajectory,
    time_map,
)
from orientd.rotation import Floats, right_jacobian_inverse

Samples = tuple[Floats, Floats, Floats]
"""Orientation ``(n, 4)``, body angular velocity ``(n, 3)`` in rad/s, its rate ``(n, 3)``."""

DEGREE = 9
"""Degree of the rotation vector on a piece."""

PIECE = 4 + 3 * (DEGREE + 1)
"""Numbers of a piece: its base quaternion, then the three components of each coefficient."""

FINE = 1e-14
"""Largest error of a fit between the nodes, rad: a few rounding errors."""

_LARGEST = 1.0  # rad, |r| at the nodes of a piece; the series of the kernels hold up to 1.1
_MOST_HALVINGS = 40
_GAIN = 8.0  # least factor by which halving a piece lowers its error
_STALLED = (1, 1e-12), (3, 1e-8)  # halvings without that gain, and acceptable error, rad
_MOST_PIECES, _MOST_HALVES = 100_000, 64  # most pieces in all, and of each interval between knots
_FREE = (None, None), (None, None)
_BLUR = 4.0 * float(np.finfo(np.float64).eps)
_BLOCK = 4096  # pieces fitted at a time, to bound memory

# Gauss-Lobatto quadrature over a piece, on [0, 1].
_LOBATTO_PLACES = 0.5 + 0.5 * np.array([-1.0, -(0.2**0.5), 0.2**0.5, 1.0])
_LOBATTO_WEIGHTS = np.array([1.0, 5.0, 5.0, 1.0]) / 12.0

# The nodes of a piece, and two places between them to check the fit.
_U = np.sort(-np.cos(np.pi * np.array([*range(10), 1.5, 6.5]) / 9.0))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Orientations over a time interval, as pieces of degree nine; immutable.

    Attributes:
        breaks: start and end of the pieces, s, increasing, shape ``(n + 1,)``.
        pieces: base quaternion ``(w, x, y, z)`` and coefficients of each, shape ``(n, 34)``.
        knots: the times at which a derivative may have a step, both ends included, s.
        continuity: number of continuous derivatives at the knots: 0, 1 or 2.
    """

    breaks: Floats
    pieces: Floats
    knots: Floats
    continuity: int = 2

    @classmethod
    def fit(
        cls,
        orientations: Callable[[Floats], Floats],
        knots: ArrayLike,
        *,
        continuity: int = 2,
        tolerance: float = FINE,
        pieces: int = 1,
    ) -> Trajectory:
        """Return the trajectory of a function of time.

        Args:
            orientations: maps increasing times, s, shape ``(n,)``, to unit quaternions of either
                sign, shape ``(n, 4)``; smooth between neighbouring *knots*.
            knots: times at which a derivative may have a step, both ends included, s, increasing.
            continuity: number of continuous derivatives at the knots.
            tolerance: largest error of the trajectory, rad.
            pieces: initial number of equal pieces of each interval.  Each is halved until the fit
                is good, or until halving does not help because only rounding is left.

        Raises:
            ValueError: the function has a jump.
            PlanError: it takes too many pieces.
        """
        ends = np.array(knots, dtype=np.float64)
        inner = ends[:-1, None] + np.diff(ends)[:, None] * np.arange(pieces) / pieces
        begins = inner.ravel()
        finals = np.append(begins[1:], ends[-1])
        found: list[tuple[Floats, Floats]] = []
        before, stalled = np.full(len(begins), np.inf), np.zeros(len(begins))
        for _ in range(_MOST_HALVINGS):
            table, quality = _fitted(orientations, begins, finals)
            size, error = quality.T
            stalled = np.where(error * _GAIN <= before, 0.0, stalled + 1.0)
            is_left = [(stalled >= halvings) & (error <= most) for halvings, most in _STALLED]
            # A time is rounded, and the orientation there is off by the turn in between.
            latest = np.maximum(np.abs(begins), np.abs(finals))
            blurred = _BLUR * size * latest / (finals - begins)
            is_good = (error <= np.maximum(tolerance, blurred)) | is_left[0] | is_left[1]
            is_poor = (size > _LARGEST) | ~is_good
            found.append((begins[~is_poor], table[~is_poor]))
            if not is_poor.any():
                break
            begin, final = begins[is_poor], finals[is_poor]
            middle = 0.5 * (begin + final)
            begins = np.stack([begin, middle], axis=1).ravel()
            if len(begins) > max(_MOST_PIECES, _MOST_HALVES * len(ends)):
                raise PlanError(
                    f"the orientations near {float(begins[0])!r} s turn too often: they take "
                    f"{len(begins)} pieces and more, more pieces than are tried"
                )
            finals = np.stack([middle, final], axis=1).ravel()
            # A piece with too large an error to be measured tells nothing about its halves.
            before = np.repeat(np.where(size > _LARGEST, np.inf, error)[is_poor], 2)
            stalled = np.repeat(stalled[is_poor], 2)
        else:
            raise ValueError(f"orientations jump near {float(begins[0])!r} s: no piece fits there")
        starts, rows = (np.concatenate(part) for part in zip(*found, strict=True))
        order = np.argsort(starts, kind="stable")
        return cls(
            np.append(starts[order], ends[-1]), _signed(rows[order]), ends, min(continuity, 2)
        )

    @classmethod
    def of_product(
        cls,
        breaks: Floats,
        parts: tuple[Floats, NDArray[np.int64], Floats, Floats],
        *,
        ends: Sequence[tuple[Floats | None, Floats | None]] = _FREE,
        continuity: int = 2,
        cuts: int = 1,
        most: int = _MOST_PIECES,
    ) -> Trajectory:
        """Return the trajectory of a product of exponentials; see :class:`.Product`.

        Args:
            breaks: start and end of its spans, s, shape ``(S + 1,)``.
            parts: the quaternion before the product of each span, ``(S, 4)``; the index of its
                first increment, ``(S,)``; all increments, half-angle vectors, ``(n, 3)``; and the
                Bernstein coefficients of its functions, ``(S, m, d + 1)``.
            ends: velocities and accelerations given at both ends.
            continuity: number of continuous derivatives at the breaks.
            cuts: initial number of equal pieces of each span.
            most: largest number of pieces.

        Raises:
            PlanError: it takes more.
        """
        given: Floats = np.full((4, 3), np.nan)
        for row, vector in enumerate((*ends[0], *ends[1])):
            if vector is not None:
                given[row] = vector
        most = max(most, _MOST_HALVES * len(breaks))
        room = (2 * cuts + 2) * len(breaks)
        while True:
            found, pieces = np.empty(room + 1), np.empty((room, PIECE))
            count = product_trajectory(breaks, *parts, given, cuts, found, pieces)
            if count:
                return cls(found[: count + 1], pieces[:count], breaks, min(continuity, 2))
            if room >= most:
                raise PlanError(
                    f"the orientations turn too often: they take more than {most} pieces"
                )
            room = min(8 * room, most)

    @classmethod
    def joined(cls, parts: Sequence[Trajectory], continuity: int = 2) -> Trajectory:
        """Return trajectories laid end to end, each at its own times.

        Args:
            parts: each begins at the end of the previous one, in orientation and time; the sign of
                the first continues.
            continuity: number of continuous derivatives between them.
        """
        if len(parts) == 1:
            return parts[0]
        first = parts[0]
        return cls(
            np.concatenate([first.breaks, *(part.breaks[1:] for part in parts[1:])]),
            _signed(np.concatenate([part.pieces for part in parts])),
            np.concatenate([first.knots, *(part.knots[1:] for part in parts[1:])]),
            min(continuity, *(part.continuity for part in parts)),
        )

    @property
    def domain(self) -> tuple[float, float]:
        """The first and the last time, s."""
        return float(self.breaks[0]), float(self.breaks[-1])

    @property
    def duration(self) -> float:
        """Duration, s."""
        return float(self.breaks[-1] - self.breaks[0])

    def sample(self, times: Floats, out: Floats | None = None) -> Samples:
        """Return orientation, body angular velocity and body angular acceleration.

        Args:
            times: s, shape ``(n,)``, in any order; increasing ones are fastest.  Times beyond an
                end are moved to it.
            out: a C-contiguous array of shape ``(10, n)`` to fill; by default a new one.

        Returns:
            Views of *out*: quaternions ``(n, 4)``, rad/s ``(n, 3)`` and rad/s^2 ``(n, 3)``.

        Raises:
            ValueError: a time is NaN.
        """
        rows = self.rows(times, np.empty((10, len(times))) if out is None else out)
        return rows[:4].T, rows[4:7].T, rows[7:10].T

    def orientations(self, times: Floats) -> Floats:
        """Return quaternions at *times* as for :meth:`sample`, shape ``(n, 4)``."""
        return self.rows(times, np.empty((4, len(times)))).T

    def jerk(self, times: Floats) -> Floats:
        """Return the rate of the acceleration at *times*, body components, rad/s^3, ``(n, 3)``."""
        return self.rows(times, np.empty((13, len(times))))[10:].T

    def rows(self, times: Floats, out: Floats) -> Floats:
        """Fill and return *out*: 4, 10 or 13 rows of samples at *times*.

        Raises:
            ValueError: a time is NaN.
        """
        instants = np.ascontiguousarray(times, dtype=np.float64)
        if sample_trajectory(instants, self.breaks, self.pieces, math.inf, out) >= 0:
            raise ValueError("times must be numbers, got nan")
        return out

    @cached_property
    def _at_ends(self) -> Samples:
        return self.sample(self.breaks[[0, -1]])

    def ends(self) -> Samples:
        """Return the result of :meth:`sample` at both ends."""
        return self._at_ends

    def turned(self, times: Floats) -> Floats:
        """Return the length of the path from its start to increasing *times*, rad, ``(n,)``.

        It is exact to some 1e-3 of a turn at the ends of pieces, and interpolated between them.
        """
        steps = np.diff(self.breaks)
        lengths = np.zeros(len(self.breaks))
        for first in range(0, len(steps), _BLOCK // 4):
            block = slice(first, first + _BLOCK // 4)
            spots = self.breaks[:-1][block, None] + steps[block, None] * _LOBATTO_PLACES
            _, omega, _ = self.sample(spots.ravel())
            speeds = np.sqrt(np.einsum("ij,ij->i", omega, omega)).reshape(spots.shape)
            lengths[1:][block] = steps[block] * (speeds @ _LOBATTO_WEIGHTS)
        found: Floats = np.interp(times, self.breaks, np.cumsum(lengths))
        return found

    def shifted(self, delay: float) -> Trajectory:
        """Return the same trajectory *delay* seconds later.

        It leaves out a piece whose ends become one time by rounding.
        """
        breaks, knots = self.breaks + delay, self.knots + delay
        is_piece = np.diff(breaks) > 0.0
        if is_piece.all():
            return replace(self, breaks=breaks, knots=knots)
        breaks, pieces = breaks[np.append(True, is_piece)], self.pieces[is_piece]
        return replace(self, breaks=breaks, knots=np.unique(knots), pieces=pieces)

    def slowed(self, duration: float) -> Trajectory:
        """Return the same orientations from the same start time on, in *duration* seconds."""
        start, factor = self.breaks[0], duration / self.duration
        breaks, knots = (start + factor * (one - start) for one in (self.breaks, self.knots))
        breaks[-1] = knots[-1] = start + duration
        return replace(self, breaks=breaks, knots=knots)

    def reversed(self) -> Trajectory:
        """Return the same orientations in reverse, over the same interval."""
        first, last = self.domain
        pieces = self.pieces[::-1].copy()
        pieces[:, 4:].reshape(-1, DEGREE + 1, 3)[:, 1::2] *= -1.0
        breaks, knots = (first + (last - one[::-1]) for one in (self.breaks, self.knots))
        return replace(self, breaks=breaks, knots=knots, pieces=pieces)

    def restricted(self, begin: float, end: float) -> Trajectory:
        """Return the part from *begin* to *end*, s, at the same times.

        Raises:
            ValueError: these are not increasing times of the domain.
        """
        first, last = self.domain
        if not first <= begin < end <= last:
            raise ValueError(f"must be a part of {first!r} s to {last!r} s, got {begin!r}, {end!r}")
        low = int(np.searchsorted(self.breaks, begin, side="right")) - 1
        high = int(np.searchsorted(self.breaks, end, side="left"))
        breaks, pieces = self.breaks[low : high + 1].copy(), self.pieces[low:high].copy()
        for index, instants in {0: (begin, breaks[1]), len(pieces) - 1: (breaks[-2], end)}.items():
            part = max(instants[0], begin), min(instants[1], end)
            if part == (breaks[index], breaks[index + 1]):
                continue
            pieces[index] = _cut(pieces[index], breaks[index], breaks[index + 1], *part)
        breaks[0], breaks[-1] = begin, end
        inside = (self.knots > begin) & (self.knots < end)
        knots = np.concatenate([[begin], self.knots[inside], [end]])
        return replace(self, breaks=breaks, knots=knots, pieces=pieces)

    def turned_over(self) -> Trajectory:
        """Return the same orientations with the negated quaternions."""
        pieces = self.pieces.copy()
        pieces[:, :4] *= -1.0
        return replace(self, pieces=pieces)

    def pinned(
        self,
        start: tuple[Floats | None, Floats | None] = (None, None),
        end: tuple[Floats | None, Floats | None] = (None, None),
    ) -> Trajectory:
        """Return the trajectory with exact velocities and accelerations at its ends.

        This corrects the fit, which is off by some rounding errors, in the first and the last
        piece.

        Args:
            start: body angular velocity, rad/s, and acceleration, rad/s^2, at the beginning;
                ``None`` leaves them unchanged.
            end: the same at the end.
        """
        pieces = self.pieces.copy()
        found = replace(self, pieces=pieces)
        for index, wanted in ((0, start), (-1, end)):
            for order, value in enumerate(wanted, start=1):
                if value is not None:
                    pieces[index, 4:] += _correction(found, index, order, value)
        return found


def _fitted(
    orientations: Callable[[Floats], Floats], begins: Floats, ends: Floats
) -> tuple[Floats, Floats]:
    """Return a piece for each interval, ``(n, 34)``, its size and its error, rad, ``(n, 2)``."""
    pieces, quality = np.empty((len(begins), PIECE)), np.empty((len(begins), 2))
    for first in range(0, len(begins), _BLOCK):
        block = slice(first, first + _BLOCK)
        begin, end = begins[block, None], ends[block, None]
        instants = begin + 0.5 * (end - begin) * (1.0 + _U)
        instants[:, -1] = ends[block]
        q = np.ascontiguousarray(orientations(instants.ravel())).reshape(len(begin), len(_U), 4)
        fit_trajectory(q, pieces[block], quality[block])
    return pieces, quality


def _signed(pieces: Floats) -> Floats:
    """Return pieces with the signs of their base quaternions made continuous."""
    bases = pieces[:, :4]
    # Two bases are at most 2 rad apart, so their quaternions at most 1.
    signs = np.where(np.einsum("ij,ij->i", bases[:-1], bases[1:]) < 0.0, -1.0, 1.0)
    if (signs < 0.0).any():
        bases[1:] *= np.cumprod(signs)[:, None]
    return pieces


def _cut(piece: Floats, start: float, end: float, begin: float, final: float) -> Floats:
    """Return the part over [*begin*, *final*] of a piece over [*start*, *end*]."""
    # u = shift + scale v, where v goes from -1 to 1 along the part.
    scale = (final - begin) / (end - start)
    shift = (begin + final - start - end) / (end - start)
    c = piece[4:].reshape(DEGREE + 1, 3)
    powers = np.arange(DEGREE + 1)
    binomials = np.array([[math.comb(i, j) for i in powers] for j in powers], dtype=np.float64)
    shifts = shift ** np.maximum(powers[None] - powers[:, None], 0)
    return np.concatenate(
        [piece[:4], (scale ** powers[:, None] * (binomials * shifts @ c)).ravel()]
    )


def _correction(trajectory: Trajectory, index: int, order: int, wanted: Floats) -> Floats:
    """Return the correction of an end piece's coefficients that sets a derivative.

    Args:
        trajectory: the current trajectory.
        index: 0 for the first piece, -1 for the last.
        order: 1 for the velocity, 2 for the acceleration, which is set after it.
        wanted: body components.
    """
    side = -1.0 if index == 0 else 1.0
    now = trajectory.sample(trajectory.breaks[[index]])[order][0]
    r = side ** np.arange(DEGREE + 1) @ trajectory.pieces[index, 4:].reshape(DEGREE + 1, 3)
    rate = 2.0 / float(np.diff(trajectory.breaks)[index])
    change = right_jacobian_inverse(r) @ (wanted - now) / rate**order
    return np.outer(_pin(side, order), change).ravel()


@cache
def _pin(side: float, order: int) -> Floats:
    """Return the powers of a polynomial that changes one derivative at an end.

    It changes neither lower derivatives there nor anything at the other end.
    """
    ahead, fading = np.poly1d([1.0, -side]), np.poly1d([0.5 * side, 0.5]) ** 4
    shape = (ahead**order / math.factorial(order) * fading).coeffs[::-1]
    return np.append(shape, np.zeros(DEGREE + 1 - len(shape)))


_MOST_GROWTH = 256  # multiple of the least number of pieces of a retimed trajectory


@dataclass(frozen=True, slots=True, eq=False)
class TimeMap:
    r"""A parameter as a function of time: a trajectory on another clock.

    The trajectory's own time *s* is a function of time in two steps.  The outer function,
    :math:`x(t)`, has a squared rate :math:`y = \dot x^2` that is a quadratic spline in *x*.  The
    inner one, :math:`s(x)`, is fixed and lets a device leave rest.  ``orientd/kernels/c/clock.h``
    has both.

    Attributes:
        times: times of the nodes, from 0 on, s, shape ``(n,)``.
        places: parameters of the nodes, increasing from 0, shape ``(n,)``.
        values: squared rates there, shape ``(n,)``.
        slopes: derivatives of the squared rates by *x*, shape ``(n,)``.
        leaves: lengths of *x* over which the parameter leaves rest, at both ends, shape ``(2,)``. 0
            means that it does not, negative that a path that moves there must be at rest.
    """

    times: Floats
    places: Floats
    values: Floats
    slopes: Floats
    leaves: Floats

    def __call__(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the parameter, from 0 on, and its first two derivatives at *times*, (n,) each."""
        out: Floats = np.empty((3, len(times)))
        time_map(*self._nodes, np.ascontiguousarray(times), out)
        return out[0], out[1], out[2]

    def times_of(self, parameters: Floats) -> Floats:
        """Return the times of given parameter values, clipped to its ends, ``(n,)``."""
        out: Floats = np.empty((1, len(parameters)))
        time_map(*self._nodes, np.ascontiguousarray(parameters), out)
        times: Floats = out[0]
        return times

    def retimed(self, trajectory: Trajectory) -> Trajectory:
        """Return a trajectory whose time, since its start, is the parameter.

        If the parameter leaves rest, so do the orientations.

        Raises:
            PlanError: it would take far more pieces than the trajectory and the parameter have.
        """
        room, count = 2 * (len(self.times) + len(trajectory.breaks)), 0
        most = _MOST_GROWTH * room
        while not count:
            if room > most:
                raise PlanError(f"a retimed curve would take more than {most} pieces")
            breaks, pieces = np.empty(room + 1), np.empty((room, PIECE))
            count = retime_trajectory(
                trajectory.breaks, trajectory.pieces, *self._nodes, breaks, pieces
            )
            room *= 4
        knots = self.times_of(trajectory.knots - trajectory.domain[0])
        return Trajectory(breaks[: count + 1], pieces[:count], knots, trajectory.continuity)

    @property
    def _nodes(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        return self.times, self.places, self.values, self.slopes, self.leaves
