"""The fastest profile along a path: its speed on elements that are narrow where it matters.

What is sought and how is in ``orientd/kernels/c/profile.h``; the parameter *x* of the path is its
time but for the way from and to rest, see ``orientd/kernels/c/clock.h``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from orientd import kernels
from orientd.curves import TimeMap, places_of
from orientd.errors import PlanError
from orientd.planner.certify import limit_table
from orientd.planner.limits import Limits
from orientd.planner.path import end_states
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.timing import Indices
from orientd.rotation import Floats

_REST = 1e-9  # of the largest angular velocity of the keyframe path
_LEAVING = 0.8  # of a length L that the parameter goes while it leaves rest
_PIECES = 10  # that an interval between knots begins with
_FEWEST = 100  # pieces of all intervals together
_LEAST_PIECES = 3  # of an interval where there are very many
MOST_ELEMENTS = 400_000
"""More of them are not cut into narrower ones."""
_NARROW = 0.25  # of a period: elements that take less time are narrow enough
_RAMP = 0.25  # change of the acceleration in an element, as a share of its limit
_CHANGE = 0.5  # of the squared rate in an element
_GIVEN = 1.0002  # share of a limit that is used where an end is at it
_MISSED = 1.01  # share of a limit between the places that were looked at
_MOST_PIECES = 4
_LEAVING_PIECES = 3
_EASE = 3.0  # one over the share of the elements near an end that moves
_SECANTS = 12
_ROUNDING = 1e-13


def pieces_of(intervals: int) -> int:
    """Return how many pieces intervals between knots begin with, each.

    Tens of thousands of intervals have fewer: planning 200,000 keyframes takes a fifth of the time
    and memory, and the motion takes 4 % longer.
    """
    if intervals * _PIECES > MOST_ELEMENTS:
        return max(_LEAST_PIECES, MOST_ELEMENTS // intervals)
    return max(_PIECES, math.ceil(_FEWEST / intervals))


@dataclass(frozen=True, slots=True, eq=False)
class Elements:
    """Elements of a path.

    Attributes:
        places: where they begin and where the last one ends, shape ``(n + 1,)``.
        aims: what the limits of velocity, acceleration and jerk are divided by in each, ``(3, n)``.
    """

    places: Floats
    aims: Floats

    @classmethod
    def first(cls, keyframe_path: KeyframePath, rates: PathRates) -> Elements:
        """Return wide ones, which end where the formula of the curve changes."""
        knots = places_of(rates.knots, rates.leaves, rates.total)
        pieces = pieces_of(len(knots) - 1)
        first = cls.split(knots, np.full(len(knots) - 1, pieces))
        # What is given at an end is inside, by a little: nothing can be done about that.
        for end, moves, near in zip(
            end_states(keyframe_path.trajectory),
            rates.moves,
            (np.arange(pieces), -1 - np.arange(pieces)),
            strict=True,
        ):
            if moves:
                fading = 1.0 - np.maximum(np.arange(pieces) - 1.0, 0.0) / pieces
                for row, vector, name, most in (
                    (0, end.omega_body, "velocity", 0.9999),
                    (1, end.alpha_body, "acceleration", 0.9993),
                ):
                    share = rates.share(vector, name)
                    if share > most:
                        eased = 1.0 - fading * (1.0 - most / share)
                        first.aims[row, near] = np.minimum(first.aims[row, near], eased)
        return first

    @classmethod
    def split(cls, places: Floats, pieces: Indices, aims: Floats | None = None) -> Elements:
        """Return elements cut into pieces of one width."""
        begins = np.repeat(places[:-1], pieces)
        widths = np.repeat(np.diff(places) / pieces, pieces)
        first = np.repeat(np.cumsum(pieces) - pieces, pieces)
        finer = np.append(begins + widths * (np.arange(len(begins)) - first), places[-1])
        aims = np.ones((3, len(begins))) if aims is None else np.repeat(aims, pieces, axis=1)
        return cls(finer, aims)

    @property
    def widths(self) -> Floats:
        """How far each goes."""
        return np.diff(self.places)

    def slower_inside(self, factor: float, moves: tuple[bool, bool]) -> Elements:
        """Return the same with the limits of a slower pace, but not where an end moves.

        Args:
            factor: by which the pace is slower.
            moves: whether the path moves at its start and at its end.
        """
        shares = (self.places[:-1] + 0.5 * self.widths) / self.places[-1]
        slower = 1.0 + (factor - 1.0) * _away_from(shares, moves)
        return replace(self, aims=self.aims * slower ** np.array([[1.0], [2.0], [3.0]]))

    def aiming_lower(self, shares: Floats, excess: float = 1.0) -> Elements:
        """Return the same with lower aims where limits are exceeded, or by a factor everywhere."""
        powers = np.array([[1.0], [2.0], [3.0]])
        lower = self.aims * np.maximum(shares, 1.0) * excess**powers
        # But not where what is given at an end is at a limit.
        is_given = (self.aims < 1.0) & (shares < _GIVEN)
        return replace(self, aims=np.where(is_given, self.aims, lower))


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """A squared rate over elements of a path.

    Attributes:
        elements: of the path.
        coefficients: of its quadratic B-splines, shape ``(n + 2,)``.
        shares: of the limits that are used in each element, shape ``(3, n)``.
        leaves: lengths over which the path leaves rest, shape ``(2,)``.
    """

    elements: Elements
    coefficients: Floats
    shares: Floats
    leaves: Floats

    def nodes(self) -> tuple[Floats, Floats]:
        """Return value and slope at the nodes."""
        h = np.concatenate([[0.0], self.elements.widths, [0.0]])
        c, sums = self.coefficients, h[:-1] + h[1:]
        return (h[1:] * c[:-1] + h[:-1] * c[1:]) / sums, 2.0 * np.diff(c) / sums

    @property
    def dips(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Whether the squared rate falls below zero inside each element, between the nodes."""
        values, slopes = self.nodes()
        inner = values[:-1] + 0.5 * self.elements.widths * slopes[:-1]
        return (inner <= 0.0) & (inner * inner >= values[:-1] * values[1:])

    def clock(self) -> TimeMap:
        """Return the parameter by time."""
        values, slopes = self.nodes()
        return TimeMap(self.elements.places, values, slopes, self.leaves)

    def lasting(self, duration: float, moves: tuple[bool, bool]) -> Profile:
        """Return the profile slowed down a little, but not where an end moves, by secants.

        Args:
            duration: that it is to take, s.
            moves: whether the path moves at its start and at its end.
        """
        bump = _away_from(np.linspace(0.0, 1.0, len(self.coefficients)), moves)
        bump[: 2 * moves[0]] = 0.0
        bump[len(bump) - 2 * moves[1] :] = 0.0
        before, slower = (0.0, float(self.clock().times[-1])), 0.0
        goal = duration - before[1]
        profile, slower = self, 2.0 * goal / duration
        for _ in range(_SECANTS):
            profile = replace(self, coefficients=self.coefficients * (1.0 - slower * bump))
            here = slower, float(profile.clock().times[-1])
            if abs(here[1] - duration) <= _ROUNDING * duration or here[1] == before[1]:
                break
            slope = (here[1] - before[1]) / (here[0] - before[0])
            before, slower = here, slower + (duration - here[1]) / slope
        return profile

    def pieces(self, rates: PathRates, period: float) -> Indices | None:
        """Return into how many pieces to cut each element; ``None`` if none need be cut."""
        values, slopes = self.nodes()
        h = self.elements.widths
        times = 2.0 * h / (np.sqrt(values[:-1]) + np.sqrt(values[1:]))
        ramp = 0.5 * np.abs(np.diff(slopes)) * rates.most_pull(self.elements)
        change = np.abs(np.diff(values)) / np.maximum(values[:-1], values[1:])
        wanted = np.maximum(
            np.maximum(ramp / _RAMP, change / _CHANGE), self.shares.max(0) / _MISSED
        )
        # The jerk of what leaves rest bends between the places that were looked at.
        for end in np.array([0, -1])[self.leaves > 0.0]:
            wanted[end] = max(wanted[end], _LEAVING_PIECES)
        # What is beside a quick change may become one.
        around = np.maximum(
            wanted, np.maximum(np.append(0.0, wanted[:-1]), np.append(wanted[1:], 0.0))
        )
        pieces = np.ceil(np.minimum(around, times / (_NARROW * period))).astype(np.intp)
        pieces = np.clip(pieces, 1, _MOST_PIECES)
        return None if (pieces == 1).all() else pieces

    def lifted(self) -> tuple[Elements, Floats]:
        """Return narrower elements where the squared rate dips, and coefficients above zero."""
        c = self.coefficients.copy()
        low = np.flatnonzero(c <= 0.0)
        c[low] = np.inf
        for place in low:
            c[place] = c[max(place - 1, 0) : place + 2].min()
        pieces = np.where(self.dips, _MOST_PIECES, 1)
        return replace(self, coefficients=c).narrowed(pieces)

    def narrowed(self, pieces: Indices | None) -> tuple[Elements, Floats]:
        """Return elements cut into pieces, and the coefficients of the same profile on them."""
        lower = self.elements.aiming_lower(self.shares)
        if pieces is None:
            return lower, self.coefficients
        finer = Elements.split(self.elements.places, pieces, lower.aims)
        values, slopes = self.nodes()
        bend = np.repeat(np.diff(slopes) / self.elements.widths, pieces)
        begins = np.repeat(self.elements.places[:-1], pieces)
        ahead = finer.places[:-1] - begins
        value = np.repeat(values[:-1], pieces) + ahead * (
            np.repeat(slopes[:-1], pieces) + 0.5 * ahead * bend
        )
        slope = np.repeat(slopes[:-1], pieces) + ahead * bend
        # A coefficient is the polar form of the quadratic at both ends of its element.
        middle = value + 0.5 * finer.widths * slope
        return finer, np.concatenate([values[:1], middle, values[-1:]])


Derivatives = tuple[Floats, Floats, Floats, Floats]
"""First and second ones by the parameter of a path, of the orientation and of the position."""


@dataclass(frozen=True, slots=True, eq=False)
class PathRates:
    """A keyframe path and what is limited along it.

    Attributes:
        path: the keyframe path.
        limits: to keep.
        moves: whether it moves at its start and at its end.
        leaves: lengths over which *x* leaves rest, 0 where it does not, shape ``(2,)``.
        knots: path times at which the formula changes, both ends included.
        sampled: the places that the path was last sampled at, and its derivatives there.
    """

    path: KeyframePath
    limits: Limits
    moves: tuple[bool, bool]
    leaves: Floats
    knots: Floats
    sampled: list[tuple[Floats, Derivatives]] = field(default_factory=list)

    @classmethod
    def of(cls, path: KeyframePath, limits: Limits) -> PathRates:
        """Return the rates of a keyframe path."""
        knots = path.trajectory.knots
        spots = np.concatenate([knots, 0.5 * (knots[1:] + knots[:-1])])
        _, omega, _ = path.trajectory.sample(spots)
        rest = _REST * float(np.linalg.norm(omega, axis=1).max())
        ends = end_states(path.trajectory)
        moves = [float(np.linalg.norm(end.omega_body)) > rest for end in ends]
        # Where the path sets out with an acceleration, its angle grows like the square of its
        # time, and that of a motion from rest like the cube: like the square without jerk limit.
        jerks = min(limits.jerk, *limits.axis_jerk) < math.inf
        leaves = np.zeros(2)
        room = np.diff(knots)[[0, -1]] * (0.5 if len(knots) == 2 else 1.0)
        for place, end in enumerate(ends):
            if jerks and not moves[place] and float(np.linalg.norm(end.alpha_body)) > rest:
                leaves[place] = room[place] / _LEAVING
        return cls(path, limits, (moves[0], moves[1]), leaves, knots)

    @property
    def total(self) -> float:
        """How far *x* goes."""
        return self.path.duration + 0.2 * float(self.leaves.sum())

    def share(self, vector: Floats, name: str) -> float:
        """Return what a rate uses of its limits, of the norm and of the components."""
        most: float = getattr(self.limits, name)
        norm = float(np.linalg.norm(vector)) / most
        return max(norm, float(np.max(np.abs(vector) / self.limits.axes(name))))

    def guess(self, elements: Elements) -> Floats:
        """Return coefficients to begin with, about as quick as the path where that moves."""
        first, second, *_ = self._derivatives(elements)
        level = math.inf
        for rows, name, power in (
            (first, "velocity", 2.0),
            (second, "acceleration", 1.0),
            (np.diff(second, axis=0) / np.repeat(0.5 * elements.widths, 2)[:, None], "jerk", 2 / 3),
        ):
            most = min(getattr(self.limits, name), *self.limits.axes(name))
            size = float(np.sqrt(np.max(np.einsum("ij,ij->i", rows, rows))))
            if size > 0.0 and most < math.inf:
                level = min(level, (most / size) ** power)
        level = 0.5 * level if level < math.inf else 1.0
        middles = 0.5 * (elements.places[:-1] + elements.places[1:])
        if not any(self.moves):
            return np.full(len(middles) + 2, level)
        slope = np.empty((3, len(middles)))
        kernels.leave_rest(middles, self.leaves, self.total, slope)
        inner = 1.0 / (slope[1] ** 2 + (1.0 / level if self.leaves.any() else 0.0))
        guess = np.concatenate([inner[:1], inner, inner[-1:]])
        if self.moves[0]:
            guess[:2] = 1.0
        if self.moves[1]:
            guess[-2:] = 1.0
        return guess

    def most_pull(self, elements: Elements) -> Floats:
        """Return how much of the limits of acceleration a change of the rate takes."""
        v = self._derivatives(elements)[0][1::2]
        share = np.sqrt(np.einsum("ij,ij->i", v, v)) / self.limits.acceleration
        pull: Floats = np.maximum(share, np.max(np.abs(v) / self.limits.axis_acceleration, axis=1))
        return pull

    def profile(
        self, elements: Elements, coefficients: Floats, gap: float, begin: float = 1.0
    ) -> Profile:
        """Return the quickest profile on some elements.

        Args:
            elements: of the path.
            coefficients: of a profile to begin with.
            gap: share of the duration by which it may be longer than the shortest.

        Raises:
            PlanError: there is none.
        """
        found, shares = coefficients.copy(), np.empty((3, len(elements.places) - 1))
        moves = np.array([self.limits.linear_velocity, self.limits.linear_acceleration])
        if not kernels.find_profile(
            elements.widths,
            *self._derivatives(elements),
            limit_table(self.limits),
            moves,
            elements.aims,
            *self.moves,
            begin,
            gap,
            found,
            shares,
        ):
            raise PlanError("no quickest timing was found: the limits leave no way along the path")
        return Profile(elements, found, shares, self.leaves)

    def jerk_steps(self, profile: Profile) -> Floats:
        """Return how much of its limits the jerk changes by behind each element.

        Shape ``(n,)``; behind the last one it ends.
        """
        first, second, *_ = self._derivatives(profile.elements)
        values, slopes = profile.nodes()
        width = profile.elements.widths[:, None]
        begin, middle, end = second[:-1:2], second[1::2], second[2::2]
        bend = 0.5 * np.diff(slopes)[:, None] / width
        # What both sides of a node have in common is left out.
        after = (4.0 * middle - 3.0 * begin - end) / width * values[:-1, None] + first[:-1:2] * bend
        before = (begin - 4.0 * middle + 3.0 * end) / width * values[1:, None] + first[2::2] * bend
        before[:-1] -= after[1:]
        change = np.sqrt(np.maximum(values[1:], 0.0))[:, None] * before
        norms = np.sqrt(np.einsum("ij,ij->i", change, change)) / self.limits.jerk
        steps: Floats = np.maximum(norms, np.max(np.abs(change) / self.limits.axis_jerk, axis=1))
        return steps

    def _turning(self, places: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        s = np.empty((3, len(places)))
        kernels.leave_rest(places, self.leaves, self.total, s)
        _, omega, alpha = self.path.trajectory.sample(s[0])
        return omega, s[1][:, None], s[2][:, None], alpha, s[0]

    def _derivatives(self, elements: Elements) -> Derivatives:
        """Return first and second derivatives of orientation and position by the parameter.

        At the nodes and half way between them, shape ``(2 n + 1, 3)`` or ``(0, 3)``.
        """
        if self.sampled and self.sampled[0][0] is elements.places:
            return self.sampled[0][1]
        places: Floats = np.empty(2 * len(elements.places) - 1)
        places[::2] = elements.places
        places[1::2] = 0.5 * (elements.places[:-1] + elements.places[1:])
        omega, slope, bend, alpha, s = self._turning(places)
        turning = _by_parameter(omega, alpha, slope, bend)
        moving = (
            _NOTHING
            if self.path.positions.is_held
            else _by_parameter(*self.path.positions.motion(s), slope, bend)
        )
        self.sampled[:] = [(elements.places, (*turning, *moving))]
        return self.sampled[0][1]


def _away_from(shares: Floats, moves: tuple[bool, bool]) -> Floats:
    """Return 0 at the ends of a path that move, and 1 far from them, at shares of its length."""
    far = np.ones(len(shares))
    for is_moving, part in zip(moves, (shares, 1.0 - shares), strict=True):
        if is_moving:
            u = np.minimum(part * _EASE, 1.0)
            far *= u * u * (3.0 - 2.0 * u)
    return far


_NOTHING = np.empty((0, 3)), np.empty((0, 3))


def _by_parameter(
    first: Floats, second: Floats, slope: Floats, bend: Floats
) -> tuple[Floats, Floats]:
    return (
        np.ascontiguousarray(first * slope),
        np.ascontiguousarray(second * slope**2 + first * bend),
    )
