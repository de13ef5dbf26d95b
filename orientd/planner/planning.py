"""From a request to a motion: which ways of planning it are tried, in which order.

This is the only place where a refusal leads to another attempt.  :func:`_attempts` lists them, and
:func:`_quickest` runs them; what was tried is in the certificate's notes or in the refusal.  The
lead-ins that are tried, one after the other, are :data:`.CONNECTIONS`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from orientd.errors import LimitError, PlanError, RequestError, StartError
from orientd.planner import refusal, resting
from orientd.planner.candidate import CandidateMotion, to_single
from orientd.planner.connect import (
    CONNECTIONS,
    STOPS,
    WITHOUT_RESERVE,
    Connection,
    LeadIn,
    approach,
    stops_take,
    turns_with_stops,
)
from orientd.planner.limits import ANGULAR, LONGEST, PERIODS, Limits
from orientd.planner.motion import Motion
from orientd.planner.path import Path, PositionPath
from orientd.planner.plan_job import PlanJob
from orientd.planner.request import DEFAULT_METHOD, MotionRequest, State
from orientd.planner.resolve import resolved
from orientd.planner.timing import (
    CAREFUL_JERK_SHARE,
    LEAST_SHARE,
    LONGEST_STOP,
    SHARE,
    FirstProfile,
    KeyframePath,
    Profile,
    QuickPath,
    corners,
    evenly_paced,
    lasting,
    least_with_stops,
    longest_stop,
    quickest,
    quickest_by_parts,
)

EVEN = "at an even pace: stopping wherever the acceleration jumps is no quicker"

_FAR_LONGER = 4.0
"""Times as long as stops take: the usual duration of a curve that is hardly the quicker way."""

_FAR_SLOWER = 4.0
"""Times as long as stops take: a note says so of a motion that is slower."""

SLOW = (
    f"slower than its limits allow, so that a stop on the path takes {LONGEST_STOP:g} s: with such "
    "an acceleration it takes that long from a higher velocity"
)

_MUCH = 0.9  # of a limit, and of the longest stop
_MOST_DRAWN = 1.1  # times what is on the records is the most that is drawn between them
_MOST_TIMINGS = 12  # until a stop is short enough, each of them a whole search
_NO_LONGER = 0.98  # of a stop's time, above which twice the reserve has not helped
_LEAST_MORE, _GREATEST_MORE = 2.0, 4.0  # times the reserve, for the next timing


def plan(
    request: MotionRequest,
    *,
    start: State,
    limits: Limits,
    period: float,
    motion_id: str | None = None,
) -> Motion:
    """Return the motion that a request asks for, or refuse it.

    Keyframes with times are passed at those times, or not at all; keyframes without are passed
    as quickly as the limits permit at every point of the curve, or with ``pace="even"`` at the
    curve's own pace, slowed down by one factor.  Where no quickest timing is found the pace is
    even, too, which a note of the certificate says.  Beside an end that moves a motion of the
    default method may stop at a keyframe if that is quicker, with a connector there.  The motion
    begins in the state the device is commanded to be in and ends at rest: in front of the keyframes
    goes a lead-in where the request says ``approach``, behind them a lead-out where they end with a
    velocity or an acceleration.  A single keyframe is where to go, by the shortest way found.

    A start that moves is the state of another motion at one of its records, which this one takes
    over with continuous acceleration; the certificate covers the differences across the seam.

    Args:
        request: what to do.
        start: where the device is commanded to be.
        limits: the device's.
        period: the device's cycle, s.
        motion_id: names the motion; by default a new random name.

    Raises:
        RequestError: the request is not one that its method or the device allows.
        LimitError: the motion would break a limit.
        StartError: it does not begin where the device is commanded to be.
        PlanError: it cannot be planned for another reason.
        ValueError: *period* is out of :data:`.PERIODS`.
    """
    shortest, longest = PERIODS
    if not shortest <= period <= longest:
        raise ValueError(f"period must be within {shortest:g} and {longest:g} s, got {period} s")
    within, name = limits.narrowed(request.limits), motion_id or os.urandom(6).hex()
    within.check_range(period)
    is_free = not within.has_axes and math.isinf(min(getattr(within, one) for one in ANGULAR))
    if is_free and request.times is None:
        raise RequestError(
            "limits", "none are set, so there is no quickest motion: set one, or give times"
        )
    job = PlanJob.of(resolved(request, start, within), start, within, period)
    return _told_of_stops(_quickest(job, name))


class _Attempt(NamedTuple):
    """One way of planning a motion.

    Attributes:
        name: in reports of what was tried.
        plan: returns the motion; ``None`` if it is not quicker than what was found before.
        is_fallback: whether it is only tried if nothing was found before.
        is_optional: whether its refusal says nothing about the request.
    """

    name: str
    plan: Callable[[], Motion | None]
    is_fallback: bool = False
    is_optional: bool = False


@dataclass(slots=True)
class _Tried:
    """What has been tried so far.

    Attributes:
        best: the quickest motion.
        refused: refusals by the names of the attempts.
    """

    best: Motion | None = None
    refused: dict[str, PlanError] = field(default_factory=dict)

    @property
    def took(self) -> float:
        """How long the quickest motion takes, s."""
        return math.inf if self.best is None else self.best.duration

    @property
    def last(self) -> PlanError | None:
        """The last refusal."""
        return next(reversed(self.refused.values()), None)


def _quickest(job: PlanJob, name: str) -> Motion:
    """Return the quickest motion of the attempts at a job, or refuse it.

    Raises:
        PlanError: all of them were refused.
    """
    tried = _Tried()
    for attempt in _attempts(job, name, tried):
        if attempt.is_fallback and tried.best is not None:
            continue
        try:
            motion = attempt.plan()
        except PlanError as error:
            if not attempt.is_optional:
                if isinstance(error, StartError):
                    raise
                tried.refused[attempt.name] = error
        else:
            if motion is not None and motion.duration < tried.took:
                tried.best = motion
    if tried.best is None:
        raise refusal.of_attempts(tried.refused)
    return tried.best


def _attempts(job: PlanJob, name: str, tried: _Tried) -> Iterator[_Attempt]:
    """Yield the attempts at a job, in order; which come next may depend on what was tried."""
    request = job.request
    if request.is_single:
        yield from _to_single(job, name, tried)
    elif request.times is not None:
        yield _Attempt("the times of the request", partial(_as_timed, job, name))
    elif job.is_even:
        yield from _evenly(job, name, tried)
    elif any(job.ends.moves) and resting.can_rest(job):
        yield from _with_moving_ends(job, name, tried)
    else:
        yield from _along_curve(job, name, tried)
        yield from _with_stops(job, name, tried)


def _to_single(job: PlanJob, name: str, tried: _Tried) -> Iterator[_Attempt]:
    """Yield the attempts to go to a single keyframe."""
    request, start, position = job.request, job.start, job.halt.last
    omega = np.zeros(3) if job.ends.omega_end is None else job.ends.omega_end
    if request.positions is not None:
        position = request.positions[0]
    target = State(request.keys[0], omega, np.zeros(3), position)
    is_turn = start.is_at_rest and not omega.any() and bool((position == start.position).all())
    if is_turn and not (job.is_even and request.total is None):
        yield _Attempt("the quickest turn", partial(_turn, job, target, name))
        if job.is_even:
            return
    elif request.total is not None:
        raise PlanError("a single keyframe is reached in a duration by turning from rest only")

    def led(to: PlanJob, connections: Sequence[Connection] = CONNECTIONS) -> Motion:
        def candidate(lead: LeadIn | None) -> CandidateMotion:
            if lead is None:
                raise ValueError("a single keyframe needs a lead-in")
            return to_single(target, lead, start, to.limits, to.period)

        return to.led(target, candidate, name, connections=connections)

    if is_turn and request.total is not None:
        return
    if is_turn:
        yield _Attempt("an even pace", partial(led, job.evenly()), is_fallback=True)
        return
    yield _Attempt("a connector", partial(led, job))
    if tried.best is None or not resting.arrives(start, target.q, job.limits):
        return
    # What brakes with all of the limits and is to stop a little later with less of them overshoots.
    enough = resting.WORTH * tried.took
    for one in WITHOUT_RESERVE:
        yield _Attempt(one.name, partial(_shorter, enough, partial(led, job, (one,))))
        if tried.took < enough:
            return


def _shorter(enough: float, plan_it: Callable[[], Motion]) -> Motion | None:
    motion = plan_it()
    return motion if motion.duration < enough else None


def _turn(job: PlanJob, target: State, name: str) -> Motion:
    """Return the turn to a single keyframe, from rest to rest about one axis.

    What is drawn between the records is a little more, where the jerk has a step: then it is timed
    again with a smaller share of the limit.
    """
    share = jerk_share = SHARE
    for _ in range(_MOST_TIMINGS):
        turn = approach(
            job.start.q, target.q, job.limits, is_even=job.is_even, share=share,
            jerk_share=jerk_share, is_part=False,
        )  # fmt: skip
        if turn is None:
            lead = job.lead_to(target)
            return job.certified(to_single(target, lead, job.start, job.limits, job.period), name)
        total = job.request.total
        if total is not None:
            refusal.check_total(total, turn.duration)
            turn = turn.slowed(max(total, turn.duration))
        # It need not take a whole number of periods: nothing comes after it.
        path = Path.joined([turn], PositionPath.held(target.position), job.start.q)
        end = turn.duration
        candidate = CandidateMotion(path, end, end, np.array([end]), None)
        try:
            return job.certified(candidate, name)
        except LimitError as error:
            refused, over = error, error.value / error.limit
            if job.is_even or not 1.0 < over <= _MOST_DRAWN:
                raise
            if error.quantity.startswith("angular jerk"):
                jerk_share /= over
            else:
                share /= over
    raise refused


def _evenly(
    job: PlanJob, name: str, tried: _Tried, *, is_fallback: bool = False
) -> Iterator[_Attempt]:
    """Yield the attempts at the curve's own pace, slowed down by one factor."""
    even, note = job.evenly(), () if tried.last is None else (f"at an even pace: {tried.last}",)

    def plan_it(*, everywhere: bool) -> Motion:
        return _at_even_pace(even, name, everywhere=everywhere).noted(*note)

    some = _Attempt("an even pace", partial(plan_it, everywhere=False), is_fallback)
    yield some
    if job.request.total is None and isinstance(tried.refused.get(some.name), LimitError):
        # A peak where none was expected: look at every record then.
        yield some._replace(plan=partial(plan_it, everywhere=True), is_fallback=True)


def _along_curve(job: PlanJob, name: str, tried: _Tried) -> Iterator[_Attempt]:
    """Yield the attempts along the curve, the quickest first."""
    request, even = job.request, job.evenly()
    if request.total is not None:
        # In a time that was asked for the pace is even wherever the curve would have to rest.
        yield _Attempt("an even pace", partial(_even_without_rests, job, name), is_optional=True)
        if tried.best is not None:
            return
    quick = _Attempt("the quickest timing", partial(_as_quick_as_possible, job, name))
    yield quick
    is_beyond = isinstance(tried.refused.get(quick.name), LimitError) and job.has_one_shape
    if is_beyond and job.shape(is_quick=True).has_chosen_times:
        other = partial(_as_quick_as_possible, job, name, by_chord=True)
        yield _Attempt("the quickest timing with times by chord", other, is_fallback=True)
    if tried.best is not None and request.total is None:
        if _rests(job) is not None:
            yield _Attempt(
                "an even pace", partial(_even_within, even, name, tried.took), is_optional=True
            )
    else:
        if isinstance(tried.last, refusal.TotalError):
            raise tried.last
        yield from _evenly(job, name, tried, is_fallback=True)


def _with_stops(job: PlanJob, name: str, tried: _Tried) -> Iterator[_Attempt]:
    """Yield the attempts to stop at every keyframe."""
    if not resting.can_rest(job):
        if tried.best is not None:
            tried.best = _slow_noted(job, tried.best)
        return

    def stopping(share: float) -> Motion | None:
        best = tried.best
        took = math.inf if best is None else best.end_time - best.start_time
        stops = turns_with_stops(job.request, job.ends, job.start, job.limits, took, share)
        if stops is None:
            return None
        motion = job.motion(stops, name)
        return motion.noted(STOPS) if len(job.request.keyframes) > 2 else motion

    at_most = _Attempt("a stop at every keyframe", partial(stopping, SHARE))
    yield at_most
    if at_most.name in tried.refused:
        yield at_most._replace(plan=partial(stopping, CAREFUL_JERK_SHARE))


def _with_moving_ends(job: PlanJob, name: str, tried: _Tried) -> Iterator[_Attempt]:
    """Yield the attempts along one curve, and with rests beside the ends that move."""
    total = job.request.total
    if total is not None:
        yield _Attempt("an even pace", partial(_at_even_pace, job.evenly(), name), is_optional=True)
        if tried.best is not None:
            return
    least, most = resting.times_with_rests(job)
    longest = min(_FAR_LONGER * most, LONGEST)
    curve = partial(_as_quick_as_possible, job, name, longest=longest)
    yield _Attempt("the quickest timing", curve)
    if tried.best is not None:
        took = tried.best.end_time - tried.best.start_time
        if total is not None or took <= least:
            return
    try:
        connectors = resting.quickest_connectors(job)
    except PlanError as error:
        tried.refused["connectors at the ends"] = error
        return
    if tried.took <= least + sum(connectors.durations):
        return
    if total is not None and connectors.has_no_rest:
        yield from _unhurried(job, total, name, tried)
        return
    part = resting.job_between(job)
    between = None if part is None else cache(partial(_quickest, part, name))

    def rested(connection: Connection | None) -> Motion:
        found = connectors if connection is None else resting.Connectors.of(job, connection)
        inner = None if between is None else between()
        notes = () if inner is None else inner.certificate.notes
        motion = job.motion(resting.connected(job, found, inner), name, merged=notes)
        return motion.noted(resting.rests_noted(job, found))

    usual = _Attempt("connectors at the ends", partial(rested, None))
    yield usual
    if usual.name in tried.refused:
        for one in CONNECTIONS[1:]:
            yield _Attempt(f"{one.name} at the ends", partial(rested, one), is_fallback=True)


def _unhurried(job: PlanJob, total: float, name: str, tried: _Tried) -> Iterator[_Attempt]:
    """Yield the attempts between two keyframes that both move, in a duration.

    Raises:
        PlanError: the quickest takes longer, or there is none, as there may be between two
            durations that are possible.
    """
    for path in resting.unhurried(job, total):
        timed = partial(_timed, job, path, None, name, has_rests=False, note=resting.CONNECTS)
        yield _Attempt("a slower connector", timed, is_fallback=True)
    rests = resting.with_a_rest(job)
    for connectors in rests:

        def waiting(connectors: resting.Connectors = connectors) -> Motion:
            path = resting.connected(job, connectors, None)
            return job.motion(path, name).noted(resting.WAITS)

        yield _Attempt("a rest on its way", waiting, is_fallback=True)
    if tried.best is None:
        raise refusal.of_duration(total, [sum(one.durations) for one in rests])


def _slow_noted(job: PlanJob, motion: Motion) -> Motion:
    """Return the motion, with a note if stopping at every keyframe would take far less time."""
    request, took = job.request, motion.end_time - motion.start_time
    is_turning = request.total is None and request.positions is None and not request.turns.any()
    if not is_turning or took < _FAR_SLOWER * least_with_stops(request.keys, job.limits):
        return motion
    stops = stops_take(request.keys, job.limits)
    if took < _FAR_SLOWER * stops:
        return motion
    return motion.noted(
        f"takes {took:.4g} s from the first keyframe to the last: with a stop at every keyframe "
        f"the turns would take {stops:.4g} s; another method or other velocities may be quicker"
    )


def _as_timed(job: PlanJob, name: str) -> Motion:
    """Return the motion with the times of the request."""
    if job.request.times is None:
        raise ValueError("request must have times")
    times = job.request.times - job.request.times[0]
    duration = float(times[-1])
    refusal.check_duration(duration)
    refusal.check_intervals(times)
    path = job.path_request(times, np.arange(len(times))).keyframe_path(duration)
    try:
        return job.motion(path, name)
    except (StartError, LimitError):
        raise
    except PlanError:
        # No lead can mend a path that breaks a limit by itself: then that is what is wrong.
        place = refusal.Place(job.request, 0.0, duration, path.times)
        refusal.check_limits(path.peaks(job.period, job.limits), place)
        raise


def _at_even_pace(job: PlanJob, name: str, *, everywhere: bool = False) -> Motion:
    """Return the motion at the curve's own pace, slowed down by one factor.

    Args:
        job: what to plan.
        name: of the motion.
        everywhere: whether to look at every record at every attempt.
    """
    if job.request.total is None:
        return job.motion(_evenly_paced(job, job.leads_to, everywhere=everywhere), name)
    refusal.check_duration(job.request.total)
    path_request = job.shape(is_quick=False).path_request
    return job.motion(job.moving(path_request, job.request.total), name)


def _evenly_paced(
    job: PlanJob,
    led: Callable[[KeyframePath], KeyframePath],
    *,
    everywhere: bool = False,
    longest: float = LONGEST,
) -> KeyframePath:
    """Return the path with the shortest times that keep the limits, in whole periods.

    Args:
        job: what to plan.
        led: refuses a path that has no leads.
        everywhere: whether to look at every record at every attempt.
        longest: that the path may take, s.

    Raises:
        PlanError: no duration keeps the limits.
    """
    shape = job.shape(is_quick=False)
    path_request = shape.path_request
    found = evenly_paced(
        shape.path,
        job.limits,
        job.period,
        intervals=len(path_request.kept) - 1,
        other=None if path_request.has_one_shape else partial(job.moving, path_request),
        led=led,
        everywhere=everywhere,
        longest=longest,
    )
    if found is None:
        raise refusal.of_any_duration(job.start, job.limits)
    return found


def _rests(job: PlanJob) -> int | None:
    """Return how often the quickest motion rests on its way along a curve, at its corners.

    Returns:
        ``None`` where it need not, not even at its ends.
    """
    if not job.has_one_shape:
        return None
    shape = job.shape(is_quick=True)
    count = len(corners(shape.path.trajectory))
    is_free = job.request.total is None or shape.path.is_from_rest_to_rest
    return None if not count and is_free else count


def _even_without_rests(job: PlanJob, name: str) -> Motion | None:
    """Return the motion at an even pace, if the quickest one would have to rest on its way."""
    if _rests(job) is None:
        return None
    return _at_even_pace(job.evenly(), name)


def _even_within(job: PlanJob, name: str, longest: float) -> Motion | None:
    """Return the motion at an even pace, in less than *longest*, s."""
    motion = job.motion(_evenly_paced(job, job.leads_to, longest=longest), name)
    return motion.noted(EVEN) if motion.duration < longest else None


def _as_quick_as_possible(
    job: PlanJob, name: str, *, by_chord: bool = False, longest: float = LONGEST
) -> Motion:
    """Return the motion along the keyframe path as quickly as the limits permit.

    Args:
        job: what to plan.
        name: of the motion.
        by_chord: whether the path is that of an even pace.
        longest: that the usual duration of a curve with a velocity at an end may be, s.
    """
    if not job.has_one_shape:
        # A velocity at an end is one at some duration: take the curve of the usual one.
        refusal.check_smooth(job.request, job.shape(is_quick=False).path.continuity)
        path = _evenly_paced(job, job.leads_from, longest=longest)
        return _timed(job, path, None, name, has_rests=False)
    shape = job.shape(is_quick=not by_chord)
    rests = _rests(job)
    motion = _timed(job, shape.path, shape.profile if rests is None else None, name)
    if not rests:
        return motion
    method, level = job.request.method, shape.path.continuity
    return motion.noted(
        f"comes to rest {rests} times on its way, where {method} is only C{level}; "
        f"{DEFAULT_METHOD} is C2 and passes the same keyframes",
    )


def _timed(
    job: PlanJob,
    keyframe_path: KeyframePath,
    profile: FirstProfile | None,
    name: str,
    *,
    has_rests: bool = True,
    note: str = "",
) -> Motion:
    """Return the motion along one keyframe path as quickly as the limits permit.

    Args:
        job: what to plan.
        keyframe_path: to go along.
        profile: the first one, if it is known.
        name: of the motion.
        has_rests: whether to begin and end at rest, and to rest at corners.
        note: what the certificate is to say of it.
    """
    find = quickest_by_parts if has_rests else quickest
    guess: FirstProfile | Profile | None = profile
    share, before, stop_time, longest = SHARE, None, math.inf, LONGEST_STOP
    for _ in range(_MOST_TIMINGS):
        quick = find(keyframe_path, job.limits, job.period, share=share, guess=guess)
        guess = quick.profile if isinstance(quick, QuickPath) else profile
        if has_rests:
            quick = quick.in_total(job.request.total)
        elif job.request.total is not None:
            quick = lasting(keyframe_path, quick, job.limits, job.period, job.request.total)
        try:
            motion = job.motion(quick, name).noted(*([note] if note else []))
        except LimitError as error:
            # What is drawn between the records is a little more, where the jerk has a step.
            over = error.value / error.limit
            is_of_timing = 1.0 < over <= _MOST_DRAWN and not error.is_in_lead_in
            if not (is_of_timing and share > LEAST_SHARE):
                raise
            # It falls as the share does about one axis, by about half as much along a curve.
            share /= over if quick.is_turn else over**2
            continue
        rate, last = motion.certificate.brake_rate, stop_time
        stop_time = 1.0 / rate if rate else math.inf
        longest = _longest_stop(motion)
        if stop_time <= longest or motion.duration <= longest:
            return motion
        if quick.stop_time is not None and quick.stop_time <= longest:
            # It is not this timing that is slow to stop, but what leads to it or from it.
            return motion
        if before is not None and stop_time > _NO_LONGER * last:
            return before
        before = motion
        if share <= LEAST_SHARE:
            break
        # How fast a stop can be goes with the square root of the reserve.
        more = min(max(1.05 * (stop_time / longest) ** 2, _LEAST_MORE), _GREATEST_MORE)
        share = max(1.0 - more * (1.0 - share), LEAST_SHARE)
    raise refusal.of_slow_stop(stop_time, longest, share)


def _told_of_stops(motion: Motion) -> Motion:
    """Return the motion, with a note if it is slower than its limits so that it can be stopped.

    That is where a stop with all of the acceleration takes long already.
    """
    found = motion.certificate
    is_slower = max(found.peak_velocity.ratio, found.peak_acceleration.ratio) < _MUCH
    if not (motion.request.is_quickest and found.stop_time > _MUCH * LONGEST_STOP and is_slower):
        return motion
    return motion.noted(SLOW)


def _longest_stop(motion: Motion) -> float:
    """Return how long a stop on a motion may take, s."""
    limits, speed = motion.limits, motion.certificate.peak_velocity.value
    rise = min(limits.acceleration / limits.jerk, math.sqrt(speed / limits.jerk))
    return longest_stop(max(speed / limits.acceleration, rise) + rise)
