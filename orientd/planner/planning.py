"""From a request to a motion: the attempts of the planner and their order.

Only this module tries something else after a refusal.  The certificate's notes, or the final
refusal, name what was tried.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial

import numpy as np

from orientd.errors import LimitError, PlanError, RequestError, StartError
from orientd.model.limits import ANGULAR, LONGEST, PERIODS, UNITS, Limits
from orientd.model.request import DEFAULT_METHOD, MotionRequest
from orientd.planner import refusal, resting
from orientd.planner.connect.leads import SAME_PLACE, approach
from orientd.planner.errors import JoinError, LeadOutError, TotalError
from orientd.planner.job import WITHOUT_RESERVE, PlanJob
from orientd.planner.keep_out import Around, Cones, Planning
from orientd.planner.motion import Motion
from orientd.planner.path import PositionPath
from orientd.planner.remarks import excess, remarked
from orientd.planner.resolve import resolved
from orientd.planner.state import State
from orientd.planner.timing.axes import Axes
from orientd.planner.timing.even import evenly_made, evenly_paced
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.knots import SAME, Knots
from orientd.planner.timing.profiles import corners, quickest
from orientd.rotation import Floats, angle

EVEN = "at an even pace: stopping wherever the acceleration jumps is no quicker"

_FAR_LONGER = 4.0
"""Multiple of the stop time: the usual duration of a curve that is hardly faster than stops."""

_QUANTITIES = {unit: name for name, unit in UNITS.items()}
_BELOW = 0.9998  # share of a limit that the next timing uses
_TO_JOIN, _TO_LEAVE = 0.8, 0.95  # changes of an even pace until it has room for a lead
_ROUNDING = 1e-9  # of a period
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


def _planned(job: PlanJob, name: str) -> Motion:
    """Return the fastest motion, with short leads only if the time that is given needs them.

    Raises:
        PlanError: it was refused.
    """
    has_time = job.request.times is not None or job.request.total is not None
    try:
        return _quickest(job, name)
    except PlanError:
        if not has_time or not any(job.ends.moves):
            raise
    return _quickest(job.with_quick_leads(), name)


@dataclass(slots=True)
class _Tried:
    """The attempts so far.

    Attributes:
        best: the fastest motion.
        refused: refusals by the names of the attempts.
    """

    best: Motion | None = None
    refused: dict[str, PlanError] = field(default_factory=dict)

    def attempt(
        self, name: str, plan_it: Callable[[], Motion | None], *, is_optional: bool = False
    ) -> None:
        """Make one attempt, and keep its motion if it is the fastest.

        Args:
            name: name of the attempt in reports.
            plan_it: returns the motion; ``None`` if it is not faster than the best so far.
            is_optional: whether its refusal is not relevant to the request.

        Raises:
            StartError: no other attempt could begin at the device's state.
        """
        try:
            motion = plan_it()
        except PlanError as error:
            if is_optional:
                return
            if isinstance(error, StartError):
                raise
            self.refused[name] = error
        else:
            if motion is not None and motion.duration < self.took:
                self.best = motion

    @property
    def took(self) -> float:
        """Duration of the fastest motion, s."""
        return math.inf if self.best is None else self.best.duration

    @property
    def took_keyframes(self) -> float:
        """Its duration from the first keyframe to the last, s."""
        return math.inf if self.best is None else self.best.end_time - self.best.start_time


def _quickest(job: PlanJob, name: str) -> Motion:
    """Return the fastest motion of the attempts at a job.

    Raises:
        PlanError: all of them were refused.
    """
    request, tried = job.request, _Tried()
    if request.is_single:
        _to_single(job, name, tried)
    elif request.times is not None:
        tried.attempt("the times of the request", partial(_as_timed, job, name))
    elif job.is_even:
        tried.attempt("an even pace", partial(_at_even_pace, job, name))
    elif any(job.ends.moves) and resting.can_rest(job):
        _with_moving_ends(job, name, tried)
    else:
        # The curve through two keyframes is a turn, which has a closed form.
        is_turn = len(request.keyframes) == 2 and float(angle(*request.keys)) > SAME
        if is_turn:
            _with_stops(job, name, tried)
        if tried.best is None:
            _along_curve(job, name, tried)
            if not is_turn:
                _with_stops(job, name, tried)
    if not request.is_single and (any(job.ends.moves) or tried.best is None):
        _with_rests(job, name, tried)
    if tried.best is None:
        raise refusal.of_attempts(tried.refused)
    return tried.best


def _to_single(job: PlanJob, name: str, tried: _Tried) -> None:
    """Try motions to a single keyframe."""
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
        tried.attempt("the quickest turn", partial(_turn, job, target, name))
        return
    tried.attempt("a connector", partial(job.motion, target, name))
    if tried.best is None or not resting.arrives(start, target.q, job.limits):
        return
    # A motion that brakes at the full limits overshoots if it must stop later with reduced ones.
    other, share = _Tried(), WITHOUT_RESERVE
    other.attempt("a connector without a reserve", partial(job.motion, target, name, share=share))
    if other.took < resting.WORTH * tried.took:
        tried.best = other.best


def _is_for_axes(job: PlanJob) -> bool:
    """Return whether a way to a single keyframe is timed for the axes; an even pace is not."""
    return job.axes is not None and not job.is_even


def _turn(job: PlanJob, target: State, name: str) -> Motion:
    """Return the turn to a single keyframe, from rest to rest about one axis."""
    total, held, here = job.request.total, PositionPath.held(target.position), job.start.q
    is_there = bool(np.linalg.norm(target.position - job.start.position) <= SAME_PLACE)
    if angle(here, target.q) <= SAME_PLACE and is_there:
        return job.motion(target, name)
    if _is_for_axes(job):
        straight, _ = job.straight(job.start, target)
        cycles = math.ceil(straight.duration / job.period - _ROUNDING)
        straight = straight.lasting(cycles * job.period if total is None else total)
        return job.certified(replace(straight, times=straight.times[-1:]), name)

    def make(limits: Limits) -> KeyframePath:
        turn = approach(here, target.q, limits, is_even=job.is_even, is_part=False)
        if turn is None:
            raise ValueError("a turn needs another orientation")
        # The turn need not take a whole number of periods: nothing follows it.
        path = KeyframePath(turn, held, np.array([turn.duration]))
        return path if total is None else path.lasting(total)

    return timed(make, partial(job.certified, name=name), job.limits)


def _along_curve(job: PlanJob, name: str, tried: _Tried) -> None:
    """Try the curve, at its fastest timing first."""
    even, total = job.evenly(), job.request.total
    curve = cache(partial(_curve, job))
    if total is not None and job.request.approach:
        # With a requested duration the pace is even wherever the curve would have to rest, if it is
        # led in and out.
        def without_rests() -> Motion | None:
            return _at_even_pace(even, name) if job.has_one_shape and curve()[1] else None

        tried.attempt("an even pace", without_rests, is_optional=True)
        if tried.best is not None:
            return

    def quick() -> Motion:
        if not job.has_one_shape:
            return _along_usual_curve(job, name)
        path, _ = curve()
        motion = _timed(job, path, name)
        rests = len(corners(path.trajectory))
        return motion.noted(*([_rests_noted(job, path, rests)] if rests else []))

    tried.attempt("the quickest timing", quick)
    if tried.best is None:
        refused = tried.refused["the quickest timing"]
        if isinstance(refused, TotalError):
            raise refused
    elif total is None and job.has_one_shape and curve()[1]:
        took = tried.took
        at_even_pace = partial(_at_even_pace, even, name, EVEN, longest=took)
        tried.attempt("an even pace", at_even_pace, is_optional=True)


def _curve(job: PlanJob) -> tuple[KeyframePath, bool]:
    """Return the curve to be timed, and whether to rest on it.

    It rests at its corners, and at moving ends if it has a given duration.
    """
    knots, guess = job.knots(is_quick=True)
    path = job.path(knots, guess, is_paced=False)
    is_moving = job.request.total is not None and not path.is_from_rest_to_rest
    return path, is_moving or bool(len(corners(path.trajectory)))


def _rests_noted(job: PlanJob, path: KeyframePath, rests: int) -> str:
    method, level = job.request.method, path.trajectory.continuity
    return (
        f"comes to rest {rests} times on its way, where {method} is only C{level}; "
        f"{DEFAULT_METHOD} is C2 and passes the same keyframes"
    )


def _with_stops(job: PlanJob, name: str, tried: _Tried) -> None:
    """Try to stop at every keyframe."""
    request, took = job.request, tried.took_keyframes
    if request.total is not None or request.positions is not None or request.turns.any():
        return
    least = resting.least_with_stops(request.keys, job.limits)
    if resting.can_rest(job) and not any(job.ends.moves):

        def make(limits: Limits) -> KeyframePath:
            return resting.with_stops(job, limits)

        def stopping() -> Motion | None:
            if least >= took or (math.isfinite(took) and make(job.limits).duration >= took):
                return None
            certify, has_lead_in = partial(job.motion, name=name), request.approach
            motion = timed(make, certify, job.limits, has_lead_in=has_lead_in)
            return motion.noted(resting.STOPS) if len(request.keyframes) > 2 else motion

        tried.attempt("a stop at every keyframe", stopping)


def _with_moving_ends(job: PlanJob, name: str, tried: _Tried) -> None:
    """Try one curve, and rests next to the moving ends."""
    total = job.request.total
    if total is not None:
        tried.attempt("an even pace", partial(_at_even_pace, job.evenly(), name), is_optional=True)
        if tried.best is not None:
            return
    least, most = resting.times_with_rests(job)
    if total is None:
        longest = min(_FAR_LONGER * most, LONGEST)
        curve = partial(_along_usual_curve, job, name, longest=longest)
        tried.attempt("the quickest timing", curve)
        if tried.best is not None and tried.took_keyframes <= least:
            return
    connecting = "connectors at the ends"
    try:
        connectors = resting.Connectors.of(job)
    except PlanError as error:
        tried.refused[connecting] = error
        return
    # A curve between the rests may be faster than the turns that the estimate counts.
    if tried.took <= resting.WORTH * (least + sum(connectors.durations)):
        return
    if total is not None and connectors.has_no_rest:
        _unhurried(job, total, name, tried)
        return

    part = resting.job_between(job)
    between = None if part is None else cache(partial(_quickest, part, name))

    def rested() -> Motion:
        path = resting.connected(job, connectors, between and between())
        return job.motion(path, name, connectors.note(job))

    tried.attempt(connecting, rested)


def _unhurried(job: PlanJob, total: float, name: str, tried: _Tried) -> None:
    """Try to connect two moving keyframes in a given duration."""

    def slower(path: KeyframePath) -> Motion:
        return job.motion(path, name, resting.CONNECTS)

    try:
        paths = resting.unhurried(job, total)
    except PlanError as error:
        tried.refused["a slower connector"] = error
        return
    for path in paths:
        if tried.best is None:
            tried.attempt("a slower connector", partial(slower, path))


def _with_rests(job: PlanJob, name: str, tried: _Tried) -> None:
    """Try to rest next to moving ends or everywhere, if the curve was refused, swings or is slow.

    Raises:
        PlanError: no motion of the requested duration was found; it names one that was.
    """
    swinging, request, moves = tried.best, job.request, job.ends.moves
    total, times = request.total, request.times
    is_swinging = swinging is not None and resting.swings(job, swinging)
    if swinging is not None and not is_swinging:
        is_free = total is None and times is None
        about = resting.about_with_braking(job) if is_free else math.inf
        if not tried.refused and resting.WORTH * tried.took_keyframes < about:
            return
    other = _Tried(None if is_swinging else swinging)

    def braking() -> Motion:
        return job.motion(resting.braking(job, partial(_quickest, name=name)), name)

    def everywhere(calm: PlanJob, pause: int | None) -> Motion:
        note = resting.MOVES if pause is None else resting.RESTS
        return calm.motion(resting.single_moves(calm, pause), name, note)

    if any(moves):
        other.attempt("a stop next to the moving ends", braking)
    is_pair, rested = len(request.keyframes) == 2 and all(moves), _Tried()
    if times is not None and is_pair and other.best is None:
        _unhurried(job, float(times[-1] - times[0]), name, other)
    is_found = other.best is not None and not resting.swings(job, other.best)
    # A device that cannot follow a path with its axes cannot follow it more slowly either.
    shares = resting.SHARES[: None if job.axes is None else 1]
    for share in shares if resting.can_move_singly(job) and not is_found else ():
        for pause in (0, 1) if is_pair else (None,):
            if rested.best is None:
                attempt = partial(everywhere, job.calmer(share), pause)
                rested.attempt("a rest at every keyframe", attempt)
    tried.refused = other.refused | rested.refused | tried.refused
    for one in (other, rested):
        if one.best is not None and (
            tried.best is None
            or one.best.duration < tried.best.duration
            or excess(one.best).sum() < excess(tried.best).sum()
        ):
            tried.best = one.best
    if tried.best is not None or total is None or not any(job.ends.moves):
        return
    # The duration lies between two feasible ones, or below all of them.
    free = replace(job, request=replace(job.request, duration=None), _leads={})
    quickest = _quickest(free, name)
    refusal.check_total(total, quickest.end_time - quickest.start_time)

    def waiting() -> Motion:
        return job.motion(resting.waiting(job, quickest), name, resting.WAITS)

    tried.attempt("a wait at the end at rest", waiting)
    if tried.best is None:
        raise refusal.of_duration(total, tried.refused)


def _as_timed(job: PlanJob, name: str) -> Motion:
    """Return the motion with the times of the request."""
    if job.request.times is None:
        raise ValueError("request must have times")
    times = job.request.times - job.request.times[0]
    duration = float(times[-1])
    refusal.check_duration(duration)
    refusal.check_intervals(times)
    return job.motion(job.path(Knots(times, np.arange(len(times))), duration), name)


def _at_even_pace(job: PlanJob, name: str, *notes: str, longest: float = LONGEST) -> Motion:
    """Return the motion at the curve's own pace, slowed down by one factor, in less than *longest*.

    *longest* is the time from the first keyframe to the last, s.
    """
    knots, guess = job.knots(is_quick=False)
    total, curve = job.request.total, partial(job.path, knots)
    if total is not None:
        refusal.check_duration(total)
        return job.motion(curve(total), name, *notes)
    if not job.has_one_shape:
        return job.motion(_usual_curve(job, knots, guess, longest), name, *notes)
    path, intervals = curve(guess), len(knots.kept) - 1
    pace = partial(evenly_paced, path, intervals=intervals, longest=longest)
    axes = job.axes_along(path)

    def make(limits: Limits) -> KeyframePath:
        found = pace(limits, job.period, axes=axes)
        if found is None:
            raise refusal.of_any_duration(job.start, job.limits)
        return found

    certify, has_lead_in = partial(job.motion, name=name), job.request.approach
    motion = timed(make, certify, job.limits, has_lead_in=has_lead_in)
    return motion.noted(*notes)


def _usual_curve(job: PlanJob, knots: Knots, guess: float, longest: float) -> KeyframePath:
    """Return the curve of the usual duration, at most *longest*, s, if longer ones swing out."""
    path = evenly_made(partial(job.path, knots), guess, job.limits, job.period, longest=longest)
    if path is None:
        raise refusal.of_any_duration(job.start, job.limits)
    return path


def _along_usual_curve(job: PlanJob, name: str, *, longest: float = LONGEST) -> Motion:
    """Return the fastest motion along a curve with a velocity at an end, which fixes its duration.

    The duration is at most *longest*, s.
    """
    knots, guess = job.knots(is_quick=False)
    refusal.check_smooth(job.request, job.path(knots, guess).trajectory.continuity)
    path = _usual_curve(job, knots, guess, longest)
    return _timed(job, path, name, has_rests=False)


def _timed(job: PlanJob, path: KeyframePath, name: str, *, has_rests: bool = True) -> Motion:
    """Return the fastest motion along one keyframe path.

    Args:
        has_rests: whether to begin and end at rest, and to rest at corners.
    """
    total, period = job.request.total, job.period
    known: Floats | None = None
    axes = job.axes_along(path)

    def make(limits: Limits) -> KeyframePath:
        nonlocal known
        quick = quickest(path, limits, period, known=known, has_rests=has_rests, axes=axes)
        known = None if quick.profile is None else quick.profile.rows
        if total is None:
            return quick
        if not quick.is_from_rest_to_rest:
            raise PlanError(f"no timing of {total:g} s keeps the velocities at the ends")
        return quick.lasting(total)

    certify, has_lead_in = partial(job.motion, name=name), job.request.approach
    return timed(make, certify, job.limits, has_lead_in=has_lead_in)


def timed(
    make: Callable[[Limits], KeyframePath],
    certify: Callable[[KeyframePath], Motion],
    limits: Limits,
    *,
    has_lead_in: bool = False,
) -> Motion:
    """Return the motion along a path, timed until its records keep the limits.

    A timing leaves a share of the limits to the law between the records.  If that is not enough
    somewhere, the next timing keeps a limit that is lower by the excess.

    Args:
        make: times the path for given limits.
        certify: makes the whole motion and checks its limits.
        has_lead_in: whether the lead-in is not a part of the path.

    Raises:
        LimitError: it breaks a limit with any of these timings.
        PlanError: there is no timing, or no lead with any of them.
    """
    for count in range(1, _MOST_TIMINGS + 1):
        try:
            return certify(make(limits))
        except LimitError as error:
            over = error.value / error.limit
            is_elsewhere = (error.is_in_lead_in and has_lead_in) or error.unit not in _QUANTITIES
            if is_elsewhere or not 1.0 < over < math.inf or count == _MOST_TIMINGS:
                raise
            limits = limits.times(**{_QUANTITIES[error.unit]: _BELOW / over})
        except (LeadOutError, JoinError) as error:
            # An even pace may use the full limits, without a reserve for a lead.
            if count == _MOST_TIMINGS:
                raise
            limits = limits.slowed(_TO_JOIN if isinstance(error, JoinError) else _TO_LEAVE)
    raise PlanError("no timing keeps the limits")
