"""From a request to a motion: geometry, timing, leads, certificate."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from orientd.errors import LimitError, PlanError, RequestError, StartError
from orientd.planner import refusal
from orientd.planner.candidate import CandidateMotion, to_single
from orientd.planner.connect import (
    STOPS,
    WITHOUT_RESERVE,
    Caution,
    stops_take,
    turns_with_stops,
)
from orientd.planner.keyframes import at_rate, in_device_coordinates, with_least_roll, wound
from orientd.planner.limits import ANGULAR, LONGEST, PERIODS, Limits
from orientd.planner.motion import Motion
from orientd.planner.plan_job import PlanJob
from orientd.planner.request import DEFAULT_METHOD, MotionRequest, State
from orientd.planner.resting import (
    CONNECTS,
    WAITS,
    WORTH,
    Connectors,
    arrives,
    can_rest,
    connected,
    job_between,
    least_with_connectors,
    more_careful,
    quickest_connectors,
    rests_noted,
    unhurried,
    with_a_rest,
)
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
    least_with_rests,
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
    turned = at_rate(in_device_coordinates(request, start), start, within)
    request = with_least_roll(wound(turned, start), start)
    job = PlanJob.of(request, start, within, period)
    if not job.is_led_by_connector:
        return _told_of_stops(_motion(job, name))
    first: LimitError | None = None
    for caution in Caution:
        try:
            motion = _motion(job.with_caution(caution), name)
        except LimitError as error:
            first = first or error
        else:
            return _without_reserve(job, motion) if _arrives(job) else _told_of_stops(motion)
    raise first or PlanError("no lead-in was tried")


def _arrives(job: PlanJob) -> bool:
    request = job.request
    return request.is_single and arrives(job.start, request.keys[0], job.limits)


def _without_reserve(job: PlanJob, motion: Motion) -> Motion:
    """Return *motion*, or one without the reserve where that is much quicker.

    What brakes with all of the limits and is to stop a little later with less of them overshoots.
    """
    for caution in WITHOUT_RESERVE:
        with suppress(PlanError):
            other = _motion(job.with_caution(caution), motion.id)
            if other.duration < WORTH * motion.duration:
                return other
    return motion


def _motion(job: PlanJob, name: str) -> Motion:
    """Return the motion, certified."""
    if job.request.is_single:
        return _to_single(job, name)
    if job.request.times is not None:
        return job.certified(_as_timed(job), name)
    if job.is_even:
        return _at_even_pace(job, name)
    if any(job.ends.moves) and can_rest(job):
        return _with_moving_ends(job, name)
    motion, took, refused = None, math.inf, None
    try:
        motion = _quick_or_even(job, name)
        took = motion.end_time - motion.start_time
    except (StartError, refusal.TotalError):
        raise
    except PlanError as error:
        if job.is_for_more_caution(error):
            raise
        refused = error
    for share in (SHARE, CAREFUL_JERK_SHARE) if can_rest(job) else ():
        stops = turns_with_stops(job.request, job.ends, job.start, job.limits, took, share)
        if stops is None or stops.duration >= took:
            break
        with suppress(PlanError):
            motion = job.certified(job.with_leads(stops), name)
            return motion.noted(STOPS) if len(job.request.keyframes) > 2 else motion
    if motion is None:
        raise refused or PlanError("no motion was tried")
    return motion if can_rest(job) else _slow_noted(job, motion)


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


def _with_moving_ends(job: PlanJob, name: str) -> Motion:
    """Return the quicker motion: along one curve, or with rests beside the ends that move."""
    total = job.request.total
    if total is not None:
        with suppress(PlanError):
            return _at_even_pace(replace(job, is_even=True, leads={}), name)
    motion, refused, connectors, least = None, None, None, math.inf
    try:
        connectors = quickest_connectors(job)
        least = least_with_connectors(job, connectors)
    except PlanError as error:
        refused = error
    try:
        longest = min(_FAR_LONGER * least, LONGEST)
        motion = _as_quick_as_possible(job, name, longest=longest)
    except StartError:
        raise
    except PlanError as error:
        if job.is_for_more_caution(error):
            raise
        refused = error
    if motion is not None and (motion.duration <= least or total is not None):
        return motion
    if connectors is not None:
        try:
            resting = _resting(job, connectors, name)
        except PlanError as error:
            if motion is None and job.is_for_more_caution(error):
                raise
            is_short = isinstance(error, refusal.TotalError)
            if refused is None or isinstance(refused, refusal.TotalError) or not is_short:
                refused = error
        else:
            if motion is None or resting.duration < motion.duration:
                return resting
    if motion is None:
        raise refused or PlanError("no motion was tried")
    return motion


def _resting(job: PlanJob, connectors: Connectors, name: str) -> Motion:
    """Return the motion with rests beside the ends that move, and connectors there.

    Raises:
        PlanError: there is none.
    """
    if job.request.total is not None and connectors.has_no_rest:
        return _unhurried(job, job.request.total, name)
    part = job_between(job)
    between = None if part is None else _motion(part, name)
    notes = () if between is None else between.certificate.notes
    note = rests_noted(job, connectors)
    try:
        motion = job.certified(connected(job, connectors, between), name, merged=notes)
        return motion.noted(note)
    except PlanError as error:
        if job.is_for_more_caution(error):
            raise
        first = error
    for one in more_careful(job):
        with suppress(PlanError):
            motion = job.certified(connected(job, one, between), name, merged=notes)
            return motion.noted(note)
    raise first


def _unhurried(job: PlanJob, total: float, name: str) -> Motion:
    """Return the motion between two keyframes that both move, in a duration.

    Raises:
        TotalError: it takes longer.
        PlanError: there is none, as there may be between two durations that are possible.
    """
    for path in unhurried(job, total):
        with suppress(PlanError):
            motion = _timed(job, path, None, name, has_rests=False)
            return motion.noted(CONNECTS)
    rests = with_a_rest(job)
    for connectors in rests:
        with suppress(PlanError):
            motion = job.certified(connected(job, connectors, None), name)
            return motion.noted(WAITS)
    raise refusal.of_duration(total, [sum(one.durations) for one in rests])


def _quick_or_even(job: PlanJob, name: str) -> Motion:
    try:
        try:
            return _as_quick_as_possible(job, name)
        except LimitError as error:
            if error.is_in_lead_in:
                raise
            return _as_quick_as_possible(job, name, by_chord=True)
    except (StartError, refusal.TotalError):
        raise
    except PlanError as error:
        if job.is_for_more_caution(error):
            raise
        even = replace(job, is_even=True, leads={})
        return _at_even_pace(even, name).noted(f"at an even pace: {error}")


def _at_even_pace(job: PlanJob, name: str) -> Motion:
    """Return the motion at the curve's own pace, slowed down by one factor."""
    if job.request.total is not None:
        refusal.check_duration(job.request.total)
        path_request, *_ = job.shape(is_quick=False)
        core = job.moving(path_request, job.request.total)
        return job.certified(job.with_leads(core), name)
    try:
        return job.certified(_evenly_paced(job, everywhere=False), name)
    except LimitError:
        # A peak where none was expected: look at every record then.
        return job.certified(_evenly_paced(job, everywhere=True), name)


def _to_single(job: PlanJob, name: str) -> Motion:
    """Return the motion to the only keyframe."""
    share = jerk_share = SHARE
    for _ in range(_MOST_TIMINGS):
        candidate = to_single(
            job.request,
            job.start,
            job.limits,
            job.own,
            job.period,
            job.caution,
            is_even=job.is_even,
            share=share,
            jerk_share=jerk_share,
        )
        try:
            return job.certified(candidate, name)
        except LimitError as error:
            over = error.value / error.limit
            if job.is_even or not job.start.is_at_rest or not 1.0 < over <= _MOST_DRAWN:
                raise
            # What is drawn between the records is a little more, where the jerk has a step.
            if error.quantity.startswith("angular jerk"):
                jerk_share /= over
            else:
                share /= over
    return _to_single(replace(job, is_even=True), name)


def _as_timed(job: PlanJob) -> CandidateMotion:
    """Return the path with the times of the request."""
    if job.request.times is None:
        raise ValueError("request must have times")
    times = job.request.times - job.request.times[0]
    duration = float(times[-1])
    refusal.check_duration(duration)
    refusal.check_intervals(times)
    keyframe_path = job.path_request(times, np.arange(len(times))).keyframe_path(duration)
    try:
        return job.with_leads(keyframe_path)
    except StartError:
        raise
    except PlanError:
        # No lead can mend a path that breaks a limit by itself: then that is what is wrong.
        place = refusal.Place(job.request, 0.0, duration, keyframe_path.times)
        refusal.check_limits(keyframe_path.peaks(job.period, job.limits), place)
        raise


def _evenly_paced(job: PlanJob, *, everywhere: bool, longest: float = LONGEST) -> CandidateMotion:
    """Return the path with the shortest times that keep the limits, in whole periods.

    Args:
        job: what to plan.
        everywhere: whether to look at every record at every attempt.
        longest: that the keyframe path may take, s.
    """
    path_request, shape, _ = job.shape(is_quick=False)
    found = evenly_paced(
        shape,
        job.limits,
        job.period,
        intervals=len(path_request.kept) - 1,
        other=None if path_request.has_one_shape else partial(job.moving, path_request),
        led=job.with_leads,
        everywhere=everywhere,
        longest=longest,
    )
    if found is None:
        raise refusal.of_any_duration(job.start, job.limits)
    return found


def _as_quick_as_possible(
    job: PlanJob, motion_id: str, *, by_chord: bool = False, longest: float = LONGEST
) -> Motion:
    """Return the motion along the keyframe path as quickly as the limits permit.

    Args:
        job: what to plan.
        motion_id: names the motion.
        by_chord: whether the path is that of an even pace.
        longest: that the usual duration of a curve with a velocity at an end may be, s.
    """
    path_request, keyframe_path, profile = job.shape(is_quick=not by_chord)
    if path_request.has_one_shape:
        rests = len(corners(keyframe_path.trajectory))
        if not rests and (job.request.total is None or keyframe_path.is_from_rest_to_rest):
            return _timed(job, keyframe_path, profile, motion_id)
        return _resting_or_even(job, keyframe_path, rests, motion_id)
    refusal.check_smooth(job.request, keyframe_path.continuity)
    # A velocity at an end is one at some duration: take the curve of the usual one.
    keyframe_path = (
        _evenly_paced(job, everywhere=False, longest=longest).keyframe_path or keyframe_path
    )
    return _timed(job, keyframe_path, profile, motion_id, has_rests=False)


def _resting_or_even(
    job: PlanJob, keyframe_path: KeyframePath, rests: int, motion_id: str
) -> Motion:
    """Return the quicker motion along a path: at rest at its ends and corners, or at an even pace.

    In a time that was asked for, the pace is even wherever that is possible.
    """
    even = _even_within(job, motion_id, least_with_rests(keyframe_path, job.limits))
    if even is not None:
        return even
    motion = _timed(job, keyframe_path, None, motion_id)
    even = _even_within(job, motion_id, motion.duration) if job.request.total is None else None
    if even is not None or not rests:
        return even or motion
    method, level = job.request.method, keyframe_path.continuity
    return motion.noted(
        f"comes to rest {rests} times on its way, where {method} is only C{level}; "
        f"{DEFAULT_METHOD} is C2 and passes the same keyframes",
    )


def _even_within(job: PlanJob, motion_id: str, longest: float) -> Motion | None:
    """Return the motion at an even pace: in the time asked for, or in less than *longest*, s."""
    even = replace(job, is_even=True, leads={})
    try:
        if job.request.total is not None:
            return _at_even_pace(even, motion_id)
        motion = even.certified(_evenly_paced(even, everywhere=False, longest=longest), motion_id)
    except PlanError:
        return None
    return motion.noted(EVEN) if motion.duration < longest else None


def _timed(
    job: PlanJob,
    keyframe_path: KeyframePath,
    profile: FirstProfile | None,
    motion_id: str,
    *,
    has_rests: bool = True,
) -> Motion:
    """Return the motion along one keyframe path as quickly as the limits permit.

    Args:
        job: what to plan.
        keyframe_path: to go along.
        profile: the first one, if it is known.
        motion_id: names the motion.
        has_rests: whether to begin and end at rest, and to rest at corners.
    """
    find = quickest_by_parts if has_rests else quickest
    guess: FirstProfile | Profile | None = profile
    share, before, stop_time, longest = SHARE, None, math.inf, LONGEST_STOP
    for _ in range(_MOST_TIMINGS):
        quick = job.timed(keyframe_path, share, partial(find, guess=guess))
        guess = quick.profile if isinstance(quick, QuickPath) else profile
        if has_rests:
            quick = quick.in_total(job.request.total)
        elif job.request.total is not None:
            quick = lasting(keyframe_path, quick, job.limits, job.period, job.request.total)
        try:
            motion = job.certified(job.with_leads(quick), motion_id)
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
    """Return the motion, with a note where it is slower than its limits so that it can be stopped.

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
