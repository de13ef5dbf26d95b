"""The quickest timing of a keyframe path: along itself as fast as its limits permit.

The limits are Bobrow's, of velocity, acceleration and jerk of a motion along a given path (Bobrow,
Dubowsky and Gibson 1985; Pham and Pham 2018 for what is usual today), here as norms and components
of vectors of the rotation group, where omega and alpha are as linear in the derivatives of the
parameter as on any other path.  :mod:`orientd.planner.timing.profile` finds the speed on elements
of the path, first on wide ones and then on narrower ones where the acceleration changes quickly.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from orientd.errors import PlanError
from orientd.planner import refusal
from orientd.planner.certify import before, measure_path
from orientd.planner.limits import Limits
from orientd.planner.path import Path, repositioned
from orientd.planner.request import State
from orientd.planner.timing.axis_turn import SHARE, VELOCITY_SHARE, turned_at_once
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.profile import MOST_ELEMENTS, Elements, PathRates, Profile
from orientd.rotation import Floats
from orientd.tolerances import GUARD_TOLERANCE

_GAPS = 0.03, 0.003, 5e-4, 3e-4  # share of the duration that a round may cost
_FEWEST_ROUNDS, _MOST_ROUNDS = 2, 6  # of ever narrower elements
_BUDGET = 420, 5  # elements of all rounds together, and of these for each interval between knots
_DIPS = 4  # attempts to have no squared rate below zero between the nodes
_ATTEMPTS = 5  # to get below the limits where they are exceeded between the places
_PACE_POWER = 1.3  # about: ends that move keep their own pace
_MOST_PACES = 16  # to try until one takes a given duration
_NEARLY = 0.994  # of a duration that was asked for: the rest slows the path down inside
_ABOVE = 1.00005
_BELOW = 1.0003
_DRAWN_BY = 3.0  # cycles on either side of a step that it is seen in
_SLIGHT = 1.01  # times a limit that a path slowed down by as much keeps without another look
_FEW = 300  # elements, of which another round costs little
_MANY = 2000  # elements, of which it costs too much
_BEYOND = 1.0003  # share of a limit that is worth it
_FAR_BEYOND = 1.003  # where it costs more
_ROOTS = np.array([1.0, 1 / 2, 1 / 3])  # of shares of velocity, acceleration and jerk, for a pace
_WHOLE = 1e-9  # of a period


FirstProfile = tuple[Floats, Floats]
"""Coefficients of a profile on the first elements of a path, and shares of limits that it uses."""


def aimed_at(limits: Limits, share: float = SHARE) -> Limits:
    """Return the limits that the quickest timing uses, with *share* of acceleration and jerk."""
    return limits.with_reserve(share).times(velocity=VELOCITY_SHARE, linear_velocity=VELOCITY_SHARE)


@dataclass(frozen=True, slots=True, eq=False)
class QuickPath(KeyframePath):
    """A path in the shortest time that keeps some share of the limits.

    Attributes:
        profile: that it is timed by.
    """

    profile: Profile | None = None


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
    rates = PathRates.of(keyframe_path, aimed_at(limits, share))
    if isinstance(guess, Profile):
        profile = rates.profile(guess.elements, guess.coefficients, _GAPS[-1], 10.0 * _GAPS[-1])
    else:
        profile = _found(rates, guess if share == SHARE else None, share, period)
    beyond, size = float(profile.shares.max()), len(profile.coefficients)
    if size < _MANY and beyond > (_BEYOND if size < _FEW else _FAR_BEYOND):
        elements = profile.elements.aiming_lower(profile.shares)
        with suppress(PlanError):
            profile = rates.profile(elements, profile.coefficients, _GAPS[-1], 10.0 * _GAPS[-1])
    for _ in range(_DIPS):
        if not profile.dips.any():
            break
        profile = rates.profile(*profile.lifted(), _GAPS[-1])
    if profile.dips.any():
        raise PlanError("no quickest timing was found: it would have to stand still on the way")
    return _kept(keyframe_path, rates, profile, limits, period)


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
    rates = PathRates.of(keyframe_path, aimed_at(limits))
    if not isinstance(quick, QuickPath) or quick.profile is None or not any(rates.moves):
        return quick.in_total(total)
    refusal.check_total(total, quick.duration)
    profile, elements, slower = quick.profile, quick.profile.elements, 1.0
    for _ in range(_MOST_PACES):
        took = float(profile.clock().times[-1])
        if _NEARLY * total <= took <= total:
            retimed = _retimed(keyframe_path, profile.lasting(total, rates.moves)).slowed(total)
            retimed, excess = _looked_at(retimed, limits, period, rates.moves)
            if excess <= 1.0:
                return retimed
            elements = elements.aiming_lower(profile.shares, max(excess, _ABOVE))
        else:
            slower *= (0.5 * (1.0 + _NEARLY) * total / took) ** _PACE_POWER
        # What is quick is far from what is slow: the search begins anew.
        inside = elements.slower_inside(slower, rates.moves)
        profile = rates.profile(inside, rates.guess(inside), _GAPS[-1])
    raise PlanError(f"no timing of {total:g} s was found that keeps the velocities at the ends")


def _found(rates: PathRates, guess: FirstProfile | None, share: float, period: float) -> Profile:
    """Return the quickest profile that is found on ever narrower elements."""
    elements = Elements.first(rates.path, rates)
    coefficients = rates.guess(elements) if guess is None else guess[0]
    count, most = 0, _BUDGET[0] + _BUDGET[1] * (len(rates.knots) - 1)
    for round_ in range(_MOST_ROUNDS):
        gap = _GAPS[min(round_, len(_GAPS) - 1)]
        try:
            if guess is not None and not round_:
                profile = Profile(elements, *guess, rates.leaves)
            else:
                begin = 10.0 * gap if round_ else 1.0
                profile = rates.profile(elements, coefficients, gap, begin)
        except PlanError:
            if not round_:
                raise
            break
        count += len(elements.aims[0])
        if round_ + 1 >= _FEWEST_ROUNDS and count >= most:
            break
        is_fine = len(elements.aims[0]) >= MOST_ELEMENTS
        pieces = None if is_fine else profile.pieces(rates, period)
        if pieces is None and gap == _GAPS[-1]:
            break
        if round_:
            lower = _less_at_steps(rates, profile, share, period)
            if lower is not None:
                np.maximum(profile.elements.aims[2], lower, out=profile.elements.aims[2])
        elements, coefficients = profile.narrowed(pieces)
    return profile


def _less_at_steps(
    rates: PathRates, profile: Profile, share: float, period: float
) -> Floats | None:
    """Return by what to divide the limits of the jerk in each element; ``None`` for nothing.

    Where the jerk has a step between two records, what a servo draws there has up to a 192nd of the
    step more, as a cubic that has place and velocity in common with the motion at both.  There is
    room for less of it above the share of the limits that is used.
    """
    over = (1.0 + rates.jerk_steps(profile) / 192.0) * _BELOW * share / GUARD_TOLERANCE
    steps = np.flatnonzero(over > 1.0)
    if not len(steps):
        return None
    times, less = profile.clock().times, np.ones(len(over))
    at = times[steps + 1]
    begins = np.searchsorted(times, at - _DRAWN_BY * period, side="right") - 1
    ends = np.searchsorted(times, at + _DRAWN_BY * period)
    for begin, end, most in zip(np.maximum(begins, 0), ends, over[steps], strict=True):
        less[begin:end] = np.maximum(less[begin:end], most)
    return less


def _kept(
    keyframe_path: KeyframePath, rates: PathRates, profile: Profile, limits: Limits, period: float
) -> KeyframePath:
    """Return the path at the speed of a profile, or as much slower as its records need it.

    Raises:
        PlanError: they keep the limits at no such speed.
    """
    # Where nothing moves at the ends the same pace, a little slower, mends a little too much.
    slower = 1.0 if any(rates.moves) else float(np.max(profile.shares.max(1) ** _ROOTS))
    excess = math.inf
    for _ in range(_ATTEMPTS):
        if rates.moves[1]:
            # What goes on from there begins at a record.
            cycles = math.ceil(float(profile.clock().times[-1]) / period - _WHOLE)
            profile = profile.lasting(cycles * period, rates.moves)
        quick = _retimed(keyframe_path, profile)
        if rates.moves[1]:
            quick = quick.slowed(cycles * period)
        if slower > 1.0:
            quick = quick.slowed(quick.duration * slower)
        refusal.check_duration(quick.duration)
        quick, excess = _looked_at(quick, limits, period, rates.moves)
        if excess <= 1.0:
            return quick
        if excess <= _SLIGHT and not any(rates.moves):
            # So much slower it is below them; the certificate looks at what it becomes part of.
            slow = quick.slowed(quick.duration * excess * _ABOVE)
            return replace(slow, stop_time=quick.stop_time)
        if any(rates.moves):
            elements = profile.elements.aiming_lower(profile.shares, max(excess, _ABOVE))
            profile = rates.profile(elements, profile.coefficients, _GAPS[-1], 10.0 * _GAPS[-1])
        else:
            slower = max(slower, 1.0) * excess * _ABOVE
    raise PlanError(f"no quickest timing keeps the limits, by a factor of {excess:g}")


def _looked_at(
    path: KeyframePath, limits: Limits, period: float, moves: tuple[bool, bool]
) -> tuple[KeyframePath, float]:
    """Return a path, with the peaks if it is held before and after, and how much slower to be."""
    if any(moves) or not path.positions.is_held:
        # Where a lead goes on, the last record that is the keyframe path's own.
        last = math.floor(path.duration / period + _WHOLE) if moves[1] else None
        peaks = path.peaks(period, limits, last=last)
    else:
        whole = Path.joined([path.trajectory], path.positions)
        peaks = measure_path(
            whole,
            math.ceil(path.duration / period - _WHOLE) + 1,
            period,
            limits,
            before=before(State.at_rest(whole.first, path.positions.first), period),
            brake_limits=limits.scaled(GUARD_TOLERANCE),
            rough=None,
        )
        rate = peaks.brake_rate
        stop_time = 1.0 / rate if rate else math.inf
        path = replace(path, found=(period, limits, peaks), stop_time=stop_time)
    excess = max(
        peaks.spins,
        peaks.drawn[0],
        math.sqrt(peaks.bends),
        math.cbrt(peaks.twists),
        peaks.linear_velocity.ratio,
        math.sqrt(peaks.linear_acceleration.ratio),
    )
    return path, excess


def _retimed(keyframe_path: KeyframePath, profile: Profile) -> KeyframePath:
    """Return the keyframe path at the speed of a profile."""
    clock = profile.clock()
    return QuickPath(
        clock.retimed(keyframe_path.trajectory),
        repositioned(keyframe_path.positions, clock, clock.times),
        clock.times_of(keyframe_path.times),
        profile=profile,
    )
