"""The quickest timing of a keyframe path: along itself as fast as its limits permit.

The limits are Bobrow's, of velocity, acceleration and jerk of a motion along a given path (Bobrow,
Dubowsky and Gibson 1985; Pham and Pham 2018 for what is usual today), here as norms and components
of vectors of the rotation group, where omega and alpha are as linear in the derivatives of the
parameter as on any other path.  The squared path velocity is found on a mesh that is narrow where
it changes quickly; ``orientd/kernels/c/timing.h`` and ``profile.h`` say how.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from orientd.curves import TimeMap
from orientd.errors import PlanError
from orientd.kernels import time_quickest
from orientd.planner import refusal
from orientd.planner.certify import before, limit_table, measure
from orientd.planner.limits import Limits
from orientd.planner.path import Path
from orientd.planner.request import State
from orientd.planner.timing.axis_turn import SHARE, VELOCITY_SHARE, turned_at_once
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.geometry import Geometry
from orientd.rotation import Floats
from orientd.tolerances import GUARD_TOLERANCE

_ATTEMPTS = 5  # to get below the limits where they are exceeded between the places
_PACE_POWER = 1.3  # about: ends that move keep their own pace
_MOST_PACES = 16  # to try until one takes a given duration
_NEARLY = 0.994  # of a duration that was asked for: the rest slows the path down inside
_ABOVE = 1.00005
_SLIGHT = 1.01  # times a limit that a path slowed down by as much keeps without another look
_ROOTS = np.array([1.0, 1 / 2, 1 / 3])  # of shares of velocity, acceleration and jerk, for a pace
_WHOLE = 1e-9  # of a period
_SAME = 1e-9  # of a duration

# Rows of a profile, see timing.h.
_COEFFICIENTS, _SHARES, _AIMS, _PLACES, _VALUES, _SLOPES, _TIMES, _ROWS = 0, 1, 4, 7, 8, 9, 10, 11
_PART = 7  # numbers of a part

FirstProfile = Floats
"""Coefficients of a profile on the first mesh of a path and its utilisation, ``(4, n + 2)``."""

_NOTHING: Floats = np.empty((0, 0))


def aimed_at(limits: Limits, share: float = SHARE) -> Limits:
    """Return the limits that the quickest timing uses, with *share* of acceleration and jerk."""
    return limits.with_reserve(share).times(velocity=VELOCITY_SHARE, linear_velocity=VELOCITY_SHARE)


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """The squared path velocity on a mesh of *n* elements, a quadratic spline.

    Attributes:
        rows: as ``orientd/kernels/c/timing.h`` has them, shape ``(11, n + 2)``, read only.
        leaves: lengths over which the path leaves rest, shape ``(2,)``.
        moves: whether the path moves at its start and at its end.
        span: path times where the part begins and ends that it is of, s.
    """

    rows: Floats
    leaves: Floats
    moves: tuple[bool, bool]
    span: tuple[float, float]

    @property
    def duration(self) -> float:
        """How long the path takes, s."""
        return float(self.rows[_TIMES, -2])

    @property
    def shares(self) -> Floats:
        """The largest utilisation of velocity, acceleration and jerk in each element, (3, n)."""
        return self.rows[_SHARES:_AIMS, :-2]

    @property
    def slower(self) -> float:
        """How much slower to be where some utilisation is above 1, as a factor; else 1."""
        return max(1.0, float(np.max(self.shares.max(1) ** _ROOTS)))

    def clock(self) -> TimeMap:
        """Return the path time since the part begins by time."""
        places, values, slopes, times = self.rows[_PLACES:, :-1]
        return TimeMap(times, places, values, slopes, self.leaves)


@dataclass(frozen=True, slots=True, eq=False)
class QuickPath(KeyframePath):
    """A path in the shortest time that keeps some share of the limits.

    Attributes:
        profile: that it is timed by.
    """

    profile: Profile | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TimingProblem:
    """A path to be timed, and what is limited along it.

    Attributes:
        geometry: of the path.
        limits: to aim at.
        period: of the device, s.
        share: of the limits of acceleration and jerk that is used.
    """

    geometry: Geometry
    limits: Limits
    period: float
    share: float

    @classmethod
    def of(cls, path: KeyframePath, limits: Limits, period: float, share: float) -> TimingProblem:
        """Return the problem of a path that is to keep *limits*, of which a *share* is used."""
        return cls(Geometry.of(path), aimed_at(limits, share), period, share)

    def solved(
        self,
        known: Floats | None = None,
        *,
        excess: float = 1.0,
        slower: float = 1.0,
        total: float = 0.0,
    ) -> Profile:
        """Return the quickest profile.

        Args:
            known: the first profile, or the rows of one to be improved on its own mesh; ``None``
                searches on ever narrower meshes from a guess on.
            excess: by how much slower to be everywhere.
            slower: by how much slower to be where no end that moves is near; the coefficients of
                the known profile are not used then.
            total: how long to take, s, if that is a little longer; 0 for the shortest time.

        Raises:
            PlanError: there is none.
        """
        known = _NOTHING if known is None else known
        return self._profiles(self.geometry.ends, False, total, known, excess, slower)[0]

    def solved_at_rest(self, edges: Floats) -> list[Profile]:
        """Return the quickest profiles of the parts between *edges*, each from rest to rest.

        Args:
            edges: knots of the path, both ends included, s, shape ``(p + 1,)``.

        Raises:
            PlanError: there is none of some part.
        """
        return self._profiles(edges, True, 0.0, _NOTHING, 1.0, 1.0)

    def _profiles(
        self,
        edges: Floats,
        is_at_rest: bool,
        total: float,
        known: Floats,
        excess: float,
        slower: float,
    ) -> list[Profile]:
        found = time_quickest(
            *self.geometry.orientation,
            edges,
            is_at_rest,
            *self.geometry.moves,
            limit_table(self.limits),
            np.array([self.limits.linear_velocity, self.limits.linear_acceleration]),
            self.share / GUARD_TOLERANCE,
            self.period,
            total,
            known,
            excess,
            slower,
        )
        if isinstance(found, bool):
            why = "it would have to stand still on the way" if found else "the limits leave no way"
            raise PlanError(f"no quickest timing was found: {why}")
        parts = np.frombuffer(found[1]).reshape(-1, _PART)
        rows = np.split(
            np.frombuffer(found[0]).reshape(_ROWS, -1),
            np.cumsum(parts[:-1, 0].astype(np.intp) + 2),
            axis=1,
        )
        return [
            Profile(np.ascontiguousarray(some), part[1:3], (bool(part[3]), bool(part[4])), span)
            for some, part, span in zip(rows, parts, parts[:, 5:].tolist(), strict=True)
        ]


def quickest(
    keyframe_path: KeyframePath,
    limits: Limits,
    period: float,
    *,
    share: float = SHARE,
    guess: FirstProfile | Profile | None = None,
) -> KeyframePath:
    """Return the same path in the shortest time that keeps the limits.

    An end at rest stays at rest and gets no acceleration where there is a limit of the jerk; at an
    end that moves, velocity and acceleration stay what they are.

    Args:
        keyframe_path: with continuous acceleration.
        limits: to keep, as seen on records a *period* apart.
        period: of the device, s.
        share: of the limits of acceleration and jerk to use.
        guess: the quickest profile to the gap of the first round, if it is known, with the usual
            share; or the one of nearly the same share.

    Raises:
        PlanError: none was found.
    """
    # Where a profile is known already it is not one turn about one axis.
    turn = turned_at_once(keyframe_path, limits, share) if guess is None else None
    if turn is not None:
        return turn
    problem = TimingProblem.of(keyframe_path, limits, period, share)
    if isinstance(guess, Profile):
        profile = problem.solved(guess.rows)
    else:
        profile = problem.solved(guess if share == SHARE else None)
    return _kept(keyframe_path, problem, profile, limits, period)


def lasting(
    keyframe_path: KeyframePath,
    quick: KeyframePath,
    limits: Limits,
    period: float,
    total: float,
) -> KeyframePath:
    """Return a path in a longer time than the shortest, with the same velocities at its ends.

    Args:
        keyframe_path: the path.
        quick: what :func:`quickest` made of it.
        limits: to keep, as seen on records a *period* apart.
        period: of the device, s.
        total: how long it is to take, s.

    Raises:
        PlanError: no such timing was found.
    """
    known = quick.profile if isinstance(quick, QuickPath) else None
    if known is None or not any(known.moves):
        return quick.in_total(total)
    refusal.check_total(total, quick.duration)
    problem, excess, slower = TimingProblem.of(keyframe_path, limits, period, SHARE), 1.0, 1.0
    for _ in range(_MOST_PACES):
        profile = problem.solved(known.rows, excess=excess, slower=slower, total=total)
        if abs(profile.duration - total) <= _SAME * total:
            path = retimed(keyframe_path, profile).slowed(total)
            path, over = looked_at(path, limits, period, known.moves)
            if over <= 1.0:
                return path
            excess *= max(over, _ABOVE)
        else:
            slower *= (0.5 * (1.0 + _NEARLY) * total / profile.duration) ** _PACE_POWER
    raise PlanError(f"no timing of {total:g} s was found that keeps the velocities at the ends")


def _kept(
    keyframe_path: KeyframePath,
    problem: TimingProblem,
    profile: Profile,
    limits: Limits,
    period: float,
) -> KeyframePath:
    """Return the path at the speed of a profile, or as much slower as its records need it.

    Raises:
        PlanError: they keep the limits at no such speed.
    """
    moves, excess = profile.moves, math.inf
    # Where nothing moves at the ends the same pace, a little slower, mends a little too much.
    slower = 1.0 if any(moves) else profile.slower
    for _ in range(_ATTEMPTS):
        # What goes on from an end that moves begins at a record.
        quick = retimed(keyframe_path, profile)
        if moves[1]:
            quick = quick.slowed(period * round(profile.duration / period))
        if slower > 1.0:
            quick = quick.slowed(quick.duration * slower)
        refusal.check_duration(quick.duration)
        quick, excess = looked_at(quick, limits, period, moves)
        if excess <= 1.0:
            return quick
        if excess <= _SLIGHT and not any(moves):
            # So much slower it is below them; the certificate looks at what it becomes part of.
            slow = quick.slowed(quick.duration * excess * _ABOVE)
            return replace(slow, stop_time=quick.stop_time)
        if any(moves):
            profile = problem.solved(profile.rows, excess=max(excess, _ABOVE))
        else:
            slower = max(slower, 1.0) * excess * _ABOVE
    raise PlanError(f"no quickest timing keeps the limits, by a factor of {excess:g}")


def looked_at(
    path: KeyframePath, limits: Limits, period: float, moves: tuple[bool, bool]
) -> tuple[KeyframePath, float]:
    """Return a path, with the peaks if it is held before and after, and how much slower to be."""
    if any(moves) or not path.positions.is_held:
        # Where a lead goes on, the last record that is the keyframe path's own.
        last = math.floor(path.duration / period + _WHOLE) if moves[1] else None
        peaks = path.peaks(period, limits, last=last)
    else:
        whole = Path.joined([path.trajectory], path.positions)
        peaks = measure(
            whole,
            math.ceil(path.duration / period - _WHOLE) + 1,
            period,
            limits,
            before=before(State.at_rest(whole.first, path.positions.first), period),
            tolerance=GUARD_TOLERANCE,
        )
        rate = peaks.brake_rate
        stop_time = 1.0 / rate if rate else math.inf
        path = replace(path, found=(period, limits, peaks), stop_time=stop_time)
    spins, bends, twists = peaks.planned
    excess = max(
        spins,
        peaks.drawn[0],
        math.sqrt(bends),
        math.cbrt(twists),
        peaks.linear_velocity.ratio,
        math.sqrt(peaks.linear_acceleration.ratio),
    )
    return path, excess


def retimed(keyframe_path: KeyframePath, profile: Profile) -> KeyframePath:
    """Return the part of a keyframe path that a profile is of, timed by it, from time 0 on."""
    clock, trajectory = profile.clock(), keyframe_path.trajectory
    begin, end = profile.span
    if (begin, end) != trajectory.domain:
        trajectory = trajectory.restricted(begin, end)

    def path_times(times: Floats) -> tuple[Floats, Floats, Floats]:
        s, rate, change = clock(times)
        return begin + s, rate, change

    positions = keyframe_path.positions.retimed(path_times, clock.times)
    times = clock.times_of(keyframe_path.times - begin)
    # Corners are where parts meet, at rest.
    smooth = replace(clock.retimed(trajectory), continuity=2)
    return QuickPath(smooth, positions, times, profile=profile)
