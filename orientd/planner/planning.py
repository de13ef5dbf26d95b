"""From a request to a motion: the attempts of the planner and their order.

Only this module tries something else after a refusal.  The final refusal names what was tried.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from orientd.curves.contract import METHODS
from orientd.errors import LimitError, LimitKind, PlanError, RequestError, StartError
from orientd.model.limits import ANGULAR, PERIODS, UNITS, Limits
from orientd.model.request import DEFAULT_METHOD, MotionRequest
from orientd.planner import refusal, resting
from orientd.planner.certifying import certified
from orientd.planner.connect.leads import approach
from orientd.planner.errors import AxisLimitError, LeadError
from orientd.planner.job import WITHOUT_RESERVE, PlanJob
from orientd.planner.keep_out import Around, Cones, Planning
from orientd.planner.motion import Motion
from orientd.planner.path import PositionPath
from orientd.planner.remarks import remarked
from orientd.planner.resolve import resolved
from orientd.planner.state import State
from orientd.planner.timing.axes import Axes
from orientd.planner.timing.axis_ways import quickest_of
from orientd.planner.timing.even import evenly_made, evenly_paced
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.knots import SAME, Knots
from orientd.planner.timing.profiles import corners, quickest
from orientd.rotation import angle

EVEN = "at an even pace: stopping wherever the acceleration jumps is no quicker"

_QUICKEST = "the quickest timing"
_QUANTITIES = {unit: name for name, unit in UNITS.items()}
_BELOW, _BELOW_IN_LEADS = 0.9998, 0.999  # share of a limit that the next timing uses
_PACES = 1.0, 0.95, 0.8, 0.64  # of an even pace, until it has room for its leads
_ROUNDING = 1e-9  # of a period
_FAR_OVER = 1.1  # excess that leads with less acceleration do not help
_MOST_TIMINGS = 3  # of one path, until its records keep the limits


def plan(
    request: MotionRequest,
    *,
    start: State,
    limits: Limits,
    period: float,
    motion_id: str | None = None,
    unix_ns: int | None = None,
    axes: Axes | None = None,
) -> Motion:
    """Return the requested motion, or refuse it.

    Keyframes with times are passed at exactly those times.  Keyframes without times are passed as
    fast as the limits permit at every point of the curve.  With ``pace="even"``, or if no such
    timing exists, the curve keeps its own pace, slowed down by one factor; a note of the
    certificate says so.  If an end of the motion moves, the default method may stop at a keyframe
    if that is faster, with a connector there.

    The motion begins in the commanded state of the device and ends at rest.  With ``approach`` it
    begins with a lead-in.  If the keyframes end with a velocity or an acceleration, a lead-out
    follows.  A single keyframe is the goal of the shortest motion found.

    A moving start is the state of another motion at one of its records.  The new motion takes over
    with continuous acceleration, and its certificate covers the differences across the seam.

    Args:
        request: the requested motion.
        start: the commanded state of the device.
        limits: the device's.
        period: the device's cycle, s.
        motion_id: identifier of the motion; by default a new random one.
        unix_ns: Unix time at the beginning of the motion, ns; required if a keep-out cone moves.
        axes: of the device, which the timing of a motion from rest regards.

    Raises:
        RequestError: its method or the device does not allow the request.
        LimitError: the motion would break a limit.
        StartError: it does not begin in the commanded state of the device.
        PlanError: it cannot be planned for another reason.
        ValueError: *period* is out of :data:`.PERIODS`.
    """
    if request.keep_out:

        def path_from(state: State) -> Planning:
            return partial(plan, start=state, limits=limits, period=period, motion_id=motion_id)

        cones, is_turn = Cones.of(request.keep_out, unix_ns), request.rate is not None
        around = Around(cones, start, path_from(start), path_from, is_turn=is_turn)
        return around.motion(request)
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
    try:
        job = PlanJob.of(resolved(request, start, within), start, within, period, axes)
        return remarked(resting.compared(job, _planned(job, name)))
    except PlanError as error:
        refusal.name_pace(error, request.pace)
        raise


@dataclass(frozen=True, slots=True)
class _Attempt:
    """One way to plan a job.

    Attributes:
        name: of the attempt in refusals.
        make: returns the path from the first keyframe to the last, timed for given limits; or the
            state at a single keyframe.
        job: plans the leads.
        least: returns about the least duration of that path, s.
        is_slower: whether it repeats an attempt of its name more slowly, to leave room for a lead.
    """

    name: str
    make: Callable[[Limits], KeyframePath | State]
    job: PlanJob
    least: Callable[[], float] = float
    is_slower: bool = False


@dataclass(frozen=True, slots=True)
class _Made:
    """A path of an attempt.

    Attributes:
        attempt: the attempt.
        core: from the first keyframe to the last, or the state at a single keyframe.
        whole: with its leads.
        further: how much further than the short way it turns between keyframes, if too far, rad.
    """

    attempt: _Attempt
    core: KeyframePath | State
    whole: KeyframePath
    further: float = 0.0

    @property
    def between(self) -> float:
        """Duration from the first keyframe to the last, s; of all of it for a single one."""
        return self.core.duration if isinstance(self.core, KeyframePath) else self.whole.duration


Refused = dict[str, PlanError]
"""Refusals by the names of the attempts, in order."""


@contextmanager
def _noted(refused: Refused, name: str) -> Iterator[None]:
    """Note the refusal of an attempt.

    Raises:
        StartError: no other attempt could begin at the device's state.
    """
    try:
        yield
    except StartError:
        raise
    except PlanError as error:
        refused[name] = error


def _planned(job: PlanJob, name: str) -> Motion:
    """Return the motion of the first attempt, in their order, whose records keep the limits.

    Raises:
        PlanError: all of them were refused.
    """
    refused: Refused = {}
    is_fixed = job.request.times is not None or job.request.total is not None
    # Short leads only if the time that is given needs them.
    hurried = [job.with_quick_leads()] if is_fixed and any(job.ends.moves) else []
    for one in (job, *hurried):
        for made in _ordered(one, refused, is_again=one is not job):
            with _noted(refused, made.attempt.name):
                return _certified(made, name)
    raise refusal.of_attempts(refused)


def _ordered(job: PlanJob, refused: Refused, *, is_again: bool = False) -> Iterator[_Made]:
    """Yield the paths of all attempts: the fastest of a group first, those that swing out last."""
    swinging: list[_Made] = []
    for group in _attempts(job, is_again=is_again):
        paths: list[_Made] = []
        for attempt in group:
            if attempt.is_slower and not isinstance(refused.get(attempt.name), LeadError):
                continue
            with _noted(refused, attempt.name):
                least = attempt.least()
                if any(one.between <= least for one in paths if not one.further):
                    continue
                core = attempt.make(attempt.job.limits)
                whole = attempt.job.with_leads(core)
                paths.append(_Made(attempt, core, whole, resting.swing(job, core)))
        paths.sort(key=_duration)
        swinging += [one for one in paths if one.further]
        yield from (one for one in paths if not one.further)
    yield from sorted(swinging, key=_further)


def _duration(made: _Made) -> float:
    return made.whole.duration


def _further(made: _Made) -> float:
    return made.further


def _fastest(job: PlanJob) -> KeyframePath:
    """Return the path of the first attempt, in their order, without a check of its records.

    Raises:
        PlanError: all of them were refused.
    """
    refused: Refused = {}
    for made in _ordered(job, refused):
        if isinstance(made.core, KeyframePath):
            return made.core
    raise refusal.of_attempts(refused)


def _certified(made: _Made, name: str) -> Motion:
    """Return the motion along a path, timed until its records keep the limits.

    A timing leaves a share of the limits to the law between the records.  If that is not enough
    somewhere, the next timing keeps a limit that is lower by the excess, and so do the next leads.

    Raises:
        LimitError: it breaks a limit with any of these timings.
        PlanError: there is no timing, or no lead with any of them.
    """
    attempt, whole, share = made.attempt, made.whole, 1.0
    job, limits = attempt.job, attempt.job.limits
    is_fixed = job.request.times is not None or job.request.total is not None
    for _ in range(1, _MOST_TIMINGS):
        try:
            return _motion(job, whole, name)
        except LimitError as error:
            over = error.value / error.limit
            is_in_lead = error.is_in_lead_in or error.time > whole.times[-1]
            if job.request.is_single and isinstance(made.core, KeyframePath):
                # All of it leads to the keyframe, but has a timing of its own.
                is_in_lead = False
            is_rising = error.unit == UNITS["velocity"]
            # A velocity that still rises stops rising sooner with all of the limits, if at all.
            is_late = over > _FAR_OVER or (is_rising and share == WITHOUT_RESERVE)
            is_last = is_late if is_in_lead else is_fixed
            is_stop = is_in_lead and error.kind is LimitKind.TIME
            is_known = is_stop or error.unit in _QUANTITIES
            # No limit of the tool is as low as the one of an axis that would help.
            is_known = is_known and not isinstance(error, AxisLimitError)
            if is_last or not 1.0 < over < math.inf or not is_known:
                raise
            if not is_in_lead:
                limits = limits.times(**{_QUANTITIES[error.unit]: _BELOW / over})
            elif is_stop:
                # It takes about the inverse root of the share that the lead leaves.
                share = job.share_leaving((over / _BELOW_IN_LEADS) ** 2, share)
            elif is_rising:
                share = WITHOUT_RESERVE
            else:
                share *= _BELOW_IN_LEADS / over
        whole = job.with_leads(attempt.make(limits), share)
    return _motion(job, whole, name)


def _motion(job: PlanJob, whole: KeyframePath, name: str) -> Motion:
    """Return the motion along a path from rest to rest, checked against its limits.

    Raises:
        LimitError: it breaks one.
    """
    motion = certified(
        whole, job.request, job.start, job.own, job.period, motion_id=name, axes=job.axes
    )
    return motion.noted(*job.notes, *whole.notes)


def _attempts(job: PlanJob, *, is_again: bool) -> list[list[_Attempt]]:
    """Return the attempts at a job, in groups.

    The fastest path of a group is the one to use.  A later group follows if all paths of the
    earlier ones were refused or swing out.  Its paths rest at keyframes or next to moving ends.

    Args:
        is_again: whether only the leads are shorter than at first, which those of single moves were
            already.
    """
    request, moves = job.request, any(job.ends.moves)
    if request.is_single:
        return [[_to_single(job)]]
    next_to_ends = _next_to_moving_ends(job) if moves else []
    quick = replace(job.with_quick_leads(), is_even=False)
    singly = _resting(quick, "a rest at every keyframe", resting.moves)
    rests = [singly] if resting.can_move_singly(job) and not is_again else []
    usual = _Attempt(_QUICKEST, partial(_along_usual_curve, job), job)
    if request.times is not None:
        groups = [[_Attempt("the times of the request", partial(_as_timed, job), job)]]
    elif job.is_even or (moves and request.total is not None):
        groups = _evenly(job)
    elif moves or not job.has_one_shape:
        groups = [[usual]]
    else:
        groups = _along_curve(job, rests)
    if job.has_one_shape or request.times is not None or request.total is not None:
        groups.append(next_to_ends)
    else:
        # Single moves have no even pace, and turns between connectors are one of their attempts.
        is_enough = job.is_even or request.positions is None
        near = next_to_ends if is_enough else next_to_ends + rests
        # Leads that the axes follow take long to find.
        groups = [groups[0] + near, *groups[1:]] if job.axes is None else [*groups, near]
    groups.append([one for one in rests if all(one not in group for group in groups)])
    if request.total is not None and moves and not job.is_even:
        groups.append([usual])
    return groups


def _next_to_moving_ends(job: PlanJob) -> list[_Attempt]:
    """Return the attempts to rest at the keyframes next to moving ends, or right at these ends."""
    stops = _resting(job, "a stop next to the moving ends", _fastest, is_connected=False)
    if not resting.can_move_singly(job) or job.is_even:
        return [stops]
    return [_resting(job, "connectors at the ends", _fastest), stops]


def _resting(
    job: PlanJob, name: str, plan_it: resting.Planned, *, is_connected: bool = True
) -> _Attempt:
    """Return an attempt to rest next to moving ends; see :func:`.resting.resting`."""

    def make(limits: Limits) -> KeyframePath:
        return resting.resting(job.within(limits), plan_it, is_connected=is_connected)

    least = resting.least if is_connected else resting.least_with_stops
    return _Attempt(name, make, job, partial(least, job))


def _to_single(job: PlanJob) -> _Attempt:
    """Return the attempt to reach a single keyframe."""
    request, start, position = job.request, job.start, job.halt.last
    omega = np.zeros(3) if job.ends.omega_end is None else job.ends.omega_end
    if request.positions is not None:
        position = request.positions[0]
    target = State(request.keys[0], omega, np.zeros(3), position)
    is_turn = start.is_at_rest and not omega.any() and bool((position == start.position).all())
    if request.total is not None and not is_turn:
        raise PlanError("a single keyframe is reached in a duration by turning from rest only")
    is_straight = _is_for_axes(job) and start.is_at_rest and not omega.any()
    if is_turn or (is_straight and request.total is None):
        return _Attempt("the quickest turn", partial(_turn, job, target), job)

    def state(_: Limits) -> State:
        return target

    return _Attempt("a connector", state, job)


def _is_for_axes(job: PlanJob) -> bool:
    """Return whether a way to a single keyframe is timed for the axes; an even pace is not."""
    return job.axes is not None and not (job.is_even and not job.axes.goal)


def _turn(job: PlanJob, target: State, limits: Limits) -> KeyframePath | State:
    """Return the turn to a single keyframe, from rest to rest about one axis."""
    total, held, here = job.request.total, PositionPath.held(target.position), job.start.q
    if job.is_there(job.start, target):
        return target
    if _is_for_axes(job):
        straight, _ = job.within(limits).straight(job.start, target, has_shape=False)
        cycles = max(math.ceil(straight.duration / job.period - _ROUNDING), 1)
        straight = straight.lasting(cycles * job.period if total is None else total)
        return replace(straight, times=straight.times[-1:])
    turn = approach(here, target.q, limits, is_even=job.is_even, is_part=False)
    if turn is None:
        raise ValueError("a turn needs another orientation")
    # The turn need not take a whole number of periods: nothing follows it.
    path = KeyframePath(turn, held, np.array([turn.duration]))
    return path if total is None else path.lasting(total)


def _along_curve(job: PlanJob, stops: list[_Attempt]) -> list[list[_Attempt]]:
    """Return the attempts at a curve from rest to rest.

    Args:
        job: the job.
        stops: the attempt to stop at every keyframe, if the job allows it.
    """
    request, total = job.request, job.request.total
    knots, guess = job.knots(is_quick=True)
    path = job.path(knots, guess, is_paced=False)
    rests = len(corners(path.trajectory))
    if rests:
        path = replace(path, notes=(*path.notes, _rests_noted(job, path, rests)))
    # Where the axes do not follow the curve, they may follow single moves.
    ways = cache(partial(job.ways_along, path))

    def make(limits: Limits) -> KeyframePath:
        quick, _ = quickest_of(ways(), limits, job.period)
        return quick if total is None else quick.lasting(total)

    quick = _Attempt(_QUICKEST, make, job)
    even = _Attempt("an even pace", partial(_at_even_pace, job), job)
    if total is not None:
        # With a requested duration the pace is even wherever the curve would have to rest, if it is
        # led in and out.
        has_rests = rests or not path.is_from_rest_to_rest
        return [[even], [quick]] if request.approach and has_rests else [[quick]]
    if rests:
        return [[quick, even]]
    # The curve through two orientations is a turn, which has a closed form.
    is_turn = request.positions is None and len(request.keyframes) == 2
    is_turn = is_turn and float(angle(*request.keys)) > SAME
    return [stops, [quick]] if is_turn else [[quick, *stops]]


def _rests_noted(job: PlanJob, path: KeyframePath, rests: int) -> str:
    method, level = job.request.method, path.trajectory.continuity
    return (
        f"comes to rest {rests} times on its way, where {method} is only C{level}; "
        f"{DEFAULT_METHOD} is C2 and passes the same keyframes"
    )


def _as_timed(job: PlanJob, _: Limits) -> KeyframePath:
    """Return the path with the times of the request."""
    if job.request.times is None:
        raise ValueError("request must have times")
    times = job.request.times - job.request.times[0]
    duration = float(times[-1])
    refusal.check_duration(duration)
    refusal.check_intervals(job.request, times)
    return job.path(Knots(times, np.arange(len(times))), duration)


def _evenly(job: PlanJob) -> list[list[_Attempt]]:
    """Return the attempts at a curve at its own pace, which may leave no room for its leads."""
    has_leads = METHODS[job.request.method].meets_end_accelerations
    paces = _PACES[:1] if has_leads or job.request.total is not None else _PACES

    def at(pace: float) -> Callable[[Limits], KeyframePath]:
        return lambda limits: _at_even_pace(job, limits.slowed(pace))

    return [[_Attempt("an even pace", at(pace), job, is_slower=pace < 1.0)] for pace in paces]


def _at_even_pace(job: PlanJob, limits: Limits) -> KeyframePath:
    """Return the curve at its own pace, slowed down by one factor."""
    knots, guess = job.knots(is_quick=False)
    total, curve = job.request.total, partial(job.path, knots)
    if total is not None:
        refusal.check_duration(total)
        return curve(total)
    if not job.has_one_shape:
        made = evenly_made(curve, guess, limits, job.period, axes_along=job.axes_along)
        found = None if made is None else made[0]
    else:
        path, intervals = curve(guess), len(knots.kept) - 1
        axes = job.axes_along(path)
        found = evenly_paced(path, limits, job.period, intervals=intervals, axes=axes)
    if found is None:
        raise refusal.of_any_duration(job.start, job.limits)
    return found if job.is_even else replace(found, notes=(*found.notes, EVEN))


def _along_usual_curve(job: PlanJob, limits: Limits) -> KeyframePath:
    """Return the fastest timing of a curve with a velocity at an end, which fixes its shape."""
    total, (knots, guess) = job.request.total, job.knots(is_quick=False)
    make = partial(job.path, knots)
    found = evenly_made(make, guess, job.limits, job.period, axes_along=job.axes_along)
    if found is None:
        raise refusal.of_any_duration(job.start, job.limits)
    path, axes = found
    refusal.check_smooth(job.request, path.trajectory.continuity)
    quick = quickest(path, limits, job.period, axes=axes)
    starts, ends = job.ends.moves
    if total is None:
        # A velocity at the end begins at a record.
        cycles = math.ceil(quick.duration / job.period - _ROUNDING)
        return quick if starts else resting.waited(quick, cycles * job.period - quick.duration)
    if not (starts or ends):
        return quick.lasting(total)
    refusal.check_total(total, quick.duration)
    if starts and ends:
        raise PlanError(f"no timing of {total:g} s keeps the velocities at the ends")
    path = resting.waited(quick, total - quick.duration, is_before=ends)
    return replace(path, notes=(*path.notes, resting.WAITS))
