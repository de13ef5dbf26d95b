"""Motions that rest inside: turns from keyframe to keyframe, and connectors at moving ends.

A **connector** leads from the velocity at the first keyframe to rest at the second.  Another one
leads from rest at the next-to-last keyframe to the velocity at the last.  The part between them
goes from rest to rest.  If two keyframes both have velocities, a single connector joins them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import cast

import numpy as np

from orientd.curves.trajectory import Trajectory
from orientd.driver import Joints
from orientd.errors import PlanError
from orientd.model.limits import LONGEST, Limits
from orientd.model.request import DEFAULT_METHOD, Keyframe, MotionRequest
from orientd.planner import refusal
from orientd.planner.connect.connector import connector_lasting, hold, turn_to_stop
from orientd.planner.connect.leads import SAME_PLACE, LeadIn, approach, lead_out, straight
from orientd.planner.job import PlanJob
from orientd.planner.methods import Ends
from orientd.planner.motion import Motion
from orientd.planner.path import Path, PositionPath
from orientd.planner.remarks import SWING, excess
from orientd.planner.state import State
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.knots import SAME
from orientd.planner.timing.profiles import quickest
from orientd.rotation import Floats, angle, log
from orientd.rotation import between as turn_between

STOPS = "stops at every keyframe: this takes less time than the curve through them"
CONNECTS = "a connector joins both keyframes, in place of the curve between them"
BRAKES = "brakes next to its moving ends: the curve turns further, takes longer, or breaks a limit"
MOVES = "rests at every keyframe: the curve through them turns further, or breaks a limit"
SHARES = (1.0, 0.96, 0.92, 0.86, 0.77, 0.68)
"""Shares of acceleration and jerk for single moves: the less, the shorter the stops on them."""
RESTS = "rests on its way, since it was given that much time"
WAITS = "waits at the end that is at rest: no slower motion was found"

WORTH = 0.95
"""Share of a duration that is worth going without the reserve."""

_AHEAD = 0.7
"""Cosine between the velocity and the direction to a keyframe that is ahead of a device."""

_NEAR = 1.25
"""Targets closer than this many stopping distances may be overshot."""

_SLOWER = 1.2
"""Multiple of the duration of single moves from which on a note says so."""

_WHOLE = 1e-9  # of a period, and of a duration
_PACES = np.geomspace(1.0, 0.1, 12)  # in the search for a longer connector


def arrives(start: State, key: Floats, limits: Limits) -> bool:
    """Return whether a keyframe is ahead of a device, and hardly farther than a stop."""
    speed = float(np.linalg.norm(start.omega_body))
    if not speed:
        return False
    way, direction = log(turn_between(start.q, key)), start.omega_body / speed
    distance = float(np.linalg.norm(way))
    is_near = distance < _NEAR * turn_to_stop(start, limits)
    return is_near and float(way @ direction) > _AHEAD * distance


def can_move_singly(job: PlanJob) -> bool:
    """Return whether the request allows single moves with a rest at every keyframe."""
    request = job.request
    return request.method == DEFAULT_METHOD and not (request.turns.any() or job.is_taken_over)


def can_rest(job: PlanJob) -> bool:
    """Return whether the request allows rests at keyframes."""
    return can_move_singly(job) and job.request.positions is None


def least_with_stops(keys: Floats, limits: Limits) -> float:
    """Return the least duration of turns from keyframe to keyframe, from rest to rest, s.

    It ignores limits of the jerk and of components.
    """
    turns = angle(keys[:-1], keys[1:])
    turns = turns[turns > 0.0]
    velocity, acceleration = limits.velocity, limits.acceleration
    peaks = np.minimum(np.sqrt(turns * acceleration), velocity)
    # Without either limit their quotient is NaN.
    rises = np.fmin(np.sqrt(turns / acceleration), velocity / acceleration)
    return float(np.sum(turns / peaks + rises))


def with_stops(job: PlanJob, limits: Limits) -> KeyframePath:
    """Return the turns from keyframe to keyframe, from rest to rest.

    Raises:
        PlanError: one of them takes longer than the longest allowed motion.
    """
    keys = job.request.keys
    if job.axes is not None:
        return _with_stops_of_axes(job, limits)
    turns = [approach(*pair, limits, is_part=len(keys) > 2) for pair in pairwise(keys)]
    durations = [0.0 if turn is None else turn.duration for turn in turns]
    times = np.concatenate([[0.0], np.cumsum(durations)])
    return _laid(job, [[turn] for turn in turns if turn is not None], times)


def _with_stops_of_axes(job: PlanJob, limits: Limits) -> KeyframePath:
    """Return the same turns, timed for the axes too: the path may rest where its axis changes."""
    states = [State.at_rest(q, job.halt.last) for q in job.request.keys]
    turns = [
        straight(*pair).trajectory if angle(pair[0].q, pair[1].q) > SAME_PLACE else None
        for pair in pairwise(states)
    ]
    times = np.cumsum([0.0, *(0.0 if turn is None else turn.duration for turn in turns)])
    path = _laid(job, [[turn] for turn in turns if turn is not None], times)
    path = replace(path, trajectory=replace(path.trajectory, continuity=1))
    return quickest(path, limits, job.period, has_rests=True, axes=job.axes_along(path))


@dataclass(frozen=True, slots=True, eq=False)
class Connectors:
    """The connectors at the ends of a motion, each from path time 0 on.

    Attributes:
        head: from the first keyframe to rest at the next one, or to the last one if no keyframe is
            left to rest at.  Empty if the motion begins at rest.
        tail: from rest to the last keyframe; may be empty.
        rests: the first and the last keyframe to rest at; the last is below the first if there is
            none.
    """

    head: tuple[Trajectory, ...]
    tail: tuple[Trajectory, ...]
    rests: tuple[int, int]

    @classmethod
    def of(cls, job: PlanJob) -> Connectors:
        """Return the connectors that are found.

        Raises:
            PlanError: a connector was not found.
        """
        keys, (begin, end) = job.request.keys, states_at_ends(job)
        first, last = rests = resting_keyframes(job)
        if first > last:
            return cls(job.connected(begin, end).parts, (), rests)
        here, there = (State.at_rest(keys[at], job.halt.last) for at in (first, last))
        starts, ends = job.ends.moves
        head = job.connected(begin, here).parts if starts else ()
        tail = job.connected(there, end).parts if ends else ()
        return cls(head, tail, rests)

    @property
    def has_no_rest(self) -> bool:
        """Whether no keyframe is left to rest at."""
        return self.rests[0] > self.rests[1]

    @property
    def durations(self) -> tuple[float, float]:
        """Duration of both, s."""
        head, tail = (part[-1].domain[1] if part else 0.0 for part in (self.head, self.tail))
        return head, tail

    def note(self, job: PlanJob) -> str:
        """Return the notes on a motion with these connectors."""
        last = len(job.request.keys) - 1
        inner = sorted({one for one in self.rests if 0 < one < last})
        if self.has_no_rest or not inner:
            return CONNECTS
        names = " and ".join(f"keyframes[{one}]" for one in inner)
        return f"stops at {names}: no quicker curve through all keyframes was found"


def resting_keyframes(job: PlanJob) -> tuple[int, int]:
    """Return the first and last keyframe to rest at; the last is below the first if none is."""
    begins, ends = job.ends.moves
    return int(begins), len(job.request.keys) - 1 - int(ends)


def job_between(job: PlanJob) -> PlanJob | None:
    """Return the job of the part from rest to rest; ``None`` if it has no turn."""
    first, last = resting_keyframes(job)
    keys = job.request.keys[first : last + 1]
    if len(keys) < 2 or not bool((angle(keys[:-1], keys[1:]) > SAME).any()):
        return None
    keyframes = [Keyframe(tuple(q)) for q in keys.tolist()]
    request = MotionRequest(keyframes, options=job.request.options)
    start = State.at_rest(request.keys[0], job.halt.last)
    halt = PositionPath.held(start.position)
    return replace(
        job, request=request, start=start, ends=Ends(), halt=halt, notes=(), offset=first
    )


def single_moves(job: PlanJob, pause: int | None = None) -> KeyframePath:
    """Return single moves with a rest at every keyframe between.

    Each waits at an end at rest, for the time that the request leaves it.

    Args:
        job: the input of the plan.
        pause: for two moving keyframes, the one to rest at too.

    Raises:
        TotalError: they take longer than the requested duration.
        PlanError: one was refused, takes longer than its times, or has no end at rest to wait at.
    """
    states = _states_to_rest_at(job)
    if pause is not None:
        states.insert(1, State.at_rest(states[pause].q, states[pause].position))
    pairs = list(pairwise(states))
    joints, moves = job.joints_at(states[0]), []
    for pair in pairs:
        moves.append(_single_move(job, *pair, joints))
        joints = moves[-1].joints
    takes = np.array([move.cycles * job.period for move in moves])
    waits, total, asked = np.zeros(len(moves)), job.request.total, job.request.times
    if asked is not None and pause is not None:
        total = float(asked[-1] - asked[0])
    if total is not None:
        refusal.check_total(total, float(takes.sum()))
        waits[-1 if pairs[-1][0].is_at_rest else 0] = total - takes.sum()
    elif asked is not None:
        waits = np.diff(asked) - takes
    waits[np.abs(waits) < _WHOLE * takes] = 0.0
    times = np.concatenate([[0.0], np.cumsum(takes + waits)])
    refusal.check_duration(float(times[-1]))
    parts: list[Sequence[Trajectory]] = []
    positions = PositionPath.held(states[0].position)
    for index, ((one, other), move, wait) in enumerate(zip(pairs, moves, waits, strict=True)):
        waits_first = not other.is_at_rest
        rest = one if waits_first else other
        if wait < 0.0 or (wait and not rest.is_at_rest):
            raise PlanError(
                f"the single move to keyframes[{index + 1}] takes {takes[index]:.4g} s, its times "
                f"leave {takes[index] + wait:.4g} s"
            )
        held = [hold(rest.q, wait)] if wait else []
        parts += [held, move.parts] if waits_first else [move.parts, held]
        begin = times[index] + (wait if waits_first else 0.0)
        positions = move.positions.delayed(begin).after(positions)
    times = times if pause is None else times[[0, -1]]
    return replace(_laid(job, parts, times), positions=positions)


def _single_move(job: PlanJob, one: State, other: State, joints: Joints) -> LeadIn:
    is_direct = not (one.is_at_rest and other.is_at_rest)
    return job.connected(one, other, is_direct=is_direct, near=joints)


def _states_to_rest_at(job: PlanJob) -> list[State]:
    """Return the states at all keyframes, at rest between the first and the last."""
    request, keys = job.request, job.request.keys
    begin, end = states_at_ends(job)
    places = np.repeat(job.halt.last[None], len(keys), axis=0)
    if request.positions is not None:
        is_given = np.isfinite(request.positions[:, 0])
        places = request.positions[is_given][np.maximum(np.cumsum(is_given) - 1, 0)]
    rests = [State.at_rest(*pair) for pair in zip(keys[1:-1], places[1:-1], strict=True)]
    return [replace(begin, position=places[0]), *rests, replace(end, position=places[-1])]


def compared(job: PlanJob, motion: Motion) -> Motion:
    """Return the motion, with a note if single moves would take far less time."""
    request, took = job.request, motion.duration
    is_free = request.is_quickest and request.total is None and not request.turns.any()
    has_stopped = can_rest(job) and not any(job.ends.moves)  # a stop everywhere was tried
    is_compared = is_free and not has_stopped and not job.is_taken_over and job.axes is None
    if request.is_single or not is_compared:
        return motion
    if took < _SLOWER * least_with_stops(request.keys, job.limits):
        return motion
    moves = _duration_of_single_moves(job)
    if took < _SLOWER * moves:
        return motion
    return motion.noted(
        f"takes {took:.4g} s: single moves with a stop at every keyframe would take {moves:.4g} s; "
        "another method or other velocities may be quicker"
    )


def _duration_of_single_moves(job: PlanJob) -> float:
    """Return their duration with both leads, s; infinite if one of them is refused."""
    try:
        path = single_moves(job)
        lead = job.lead_to(path.first) if job.request.approach else None
        return job.with_leads(path, lead).duration
    except PlanError:
        return math.inf


def times_with_rests(job: PlanJob) -> tuple[float, float]:
    """Return the least and the approximate duration of a motion with a stop at every keyframe, s.

    The least one counts only the turns from rest to rest.
    """
    keys, limits = job.request.keys, job.limits
    first, last = resting_keyframes(job)
    inner = keys[first : last + 1]
    least = least_with_stops(inner, limits) if len(inner) > 1 else 0.0
    stop = limits.velocity / limits.acceleration + limits.acceleration / limits.jerk
    about = least_with_stops(keys, limits) + 2.0 * stop
    return least, about if math.isfinite(about) else LONGEST


def connected(job: PlanJob, connectors: Connectors, between: Motion | None) -> KeyframePath:
    """Return the path from the first keyframe to the last with connectors at its moving ends.

    Args:
        connectors: at its ends.
        between: the motion of :func:`job_between`, if there is one.

    Raises:
        TotalError: it takes longer than the requested duration.
    """
    (first, last), (head, tail) = connectors.rests, (connectors.head, connectors.tail)
    before, after = connectors.durations
    if first > last:
        return _laid(job, [head], np.array([0.0, before]))
    duration = least = 0.0 if between is None else between.duration
    if job.request.total is not None:
        refusal.check_total(job.request.total, before + least + after)
        duration = max(job.request.total - before - after, least)
    elif tail:
        # A velocity begins at a record.
        duration = math.ceil(least / job.period - _WHOLE) * job.period
    inner: Sequence[Trajectory] = ()
    passed: Floats = np.full(last - first + 1, 0.0 if tail else duration)
    notes: tuple[str, ...] = ()
    if between is not None:
        passed, notes = duration / least * between.keyframe_times, between.certificate.notes
        inner = [cast("Path", between.path).trajectory.slowed(duration)]
    elif duration > _WHOLE * job.period:
        inner = [hold(job.request.keys[first], duration)]
    begin, end = np.zeros(int(bool(head))), np.full(int(bool(tail)), before + duration + after)
    times = np.concatenate([begin, before + passed, end])
    return _laid(job, [head, inner, tail], times, notes)


def unhurried(job: PlanJob, total: float) -> list[KeyframePath]:
    """Return connectors of two moving keyframes that take *total* seconds, at ever slower paces.

    Raises:
        TotalError: the fastest takes longer.
        PlanError: none was found.
    """
    begin, end = states_at_ends(job)
    times, paths = np.array([0.0, total]), []
    for pace in _PACES:
        within = job.limits if pace == 1.0 else job.limits.slowed(pace)
        limits = [one.with_reserve(job.share_from(begin)) for one in (within, job.limits)]
        find = partial(connector_lasting, limits=limits[0], own=limits[1], period=job.period)
        found = find(begin, end, total)
        if found is not None:
            paths.append(_laid(job, [[found]], times))
    if not paths:
        refusal.check_total(total, job.connected(begin, end).cycles * job.period)
    return paths


def swings(job: PlanJob, motion: Motion) -> bool:
    """Return whether a motion swings out or makes whole turns between its keyframes.

    Stopping at a moving end and turning back from there is not counted.
    """
    further = excess(motion)[1:-1]
    for part, state in zip((0, -1), states_at_ends(job), strict=True):
        further[part] -= 2.0 * turn_to_stop(state, job.limits)
    return float(further.max()) > SWING


def braking(job: PlanJob, plan_it: Callable[[PlanJob], Motion]) -> KeyframePath:
    """Return the path that brakes after a moving first keyframe, and runs up to a moving last one.

    The part between is planned from rest to rest.  So it turns the short way, and can take any
    time.

    Args:
        job: has a moving end.
        plan_it: plans the part between.

    Raises:
        TotalError: it takes longer than the requested duration.
        PlanError: the times leave no room to brake, or the part between was refused.
    """
    request, period = job.request, job.period
    stop, run_up, keys = _stops_at_ends(job)
    before, after = (0.0 if part is None else part.duration for part in (stop, run_up))
    between = plan_it(_from_rest_to_rest(job, keys, before, after))
    is_led_out = between.end_time < (1.0 - _WHOLE) * between.duration
    if is_led_out or not isinstance(between.path, Path):
        raise PlanError(f"{request.method} does not come to rest at its last keyframe")
    duration = between.duration
    if request.total is not None:
        refusal.check_total(request.total, before + duration + after)
        duration = max(request.total - before - after, duration)
    elif request.times is None and run_up is not None:
        # A velocity begins at a record.
        duration = math.ceil(duration / period - _WHOLE) * period
    factor, inner = duration / between.duration, between.path.trajectory.slowed(duration)
    parts = [inner.shifted(before)]
    if stop is not None:
        parts.insert(0, stop)
    if run_up is not None:
        parts.append(run_up.shifted(before + duration))
    positions = between.path.positions
    positions = positions if positions.is_held else positions.slowed(factor).delayed(before)
    times = before + factor * between.keyframe_times
    times[0], times[-1] = 0.0, before + duration + after
    notes = (BRAKES, *between.certificate.notes)
    return KeyframePath(Trajectory.joined(parts), positions, times, notes)


def about_with_braking(job: PlanJob) -> float:
    """Return about how long the path of :func:`braking` takes with a stop at every keyframe, s."""
    try:
        stop, run_up, keys = _stops_at_ends(job)
    except PlanError:
        return math.inf
    leads = sum(part.duration for part in (stop, run_up) if part is not None)
    return leads + least_with_stops(keys, job.limits)


def _stops_at_ends(job: PlanJob) -> tuple[Trajectory | None, Trajectory | None, Floats]:
    """Return the stop after the first keyframe, the run-up to the last, and the keyframes between.

    Raises:
        PlanError: a position moves, or one of them was not found.
    """
    if job.is_taken_over:
        raise PlanError("a position that moves does not wait for the tool to brake")
    begin, end = states_at_ends(job)
    find = partial(lead_out, limits=job.limits, period=job.period)
    starts, ends = job.ends.moves
    stop = find(begin, share=job.share_from(begin)) if starts else None
    mirrored = replace(end, omega_body=-end.omega_body)
    run_up = find(mirrored, share=job.lead_share).reversed() if ends else None
    keys = job.request.keys.copy()
    keys[0] = begin.q if stop is None else stop.ends()[0][1]
    keys[-1] = end.q if run_up is None else run_up.ends()[0][0]
    return stop, run_up, keys


def _from_rest_to_rest(job: PlanJob, keys: Floats, before: float, after: float) -> PlanJob:
    """Return the job of the part between the stop and the run-up at moving ends.

    Args:
        keys: its keyframes, shape ``(n, 4)``.
        before: duration of the stop, s.
        after: duration of the run-up, s.
    """
    request, times = job.request, job.request.times
    if times is not None:
        times = times.copy()
        times[0], times[-1] = times[0] + before, times[-1] - after
        if (np.diff(times) <= 0.0).any():
            raise PlanError(
                f"the times leave no room to brake in {before:.4g} s from the first velocity and "
                f"to run up in {after:.4g} s to the last one"
            )
    is_turn = len(keys) == 2
    keyframes = [
        Keyframe(tuple(q), None if times is None else float(times[index]), one.position, one.turns)
        for index, (q, one) in enumerate(zip(keys.tolist(), request.keyframes, strict=True))
    ]
    part = replace(
        request, keyframes=keyframes, start_velocity=None, end_velocity=None, approach=False,
        duration=None, limits=None, notes=(), method=DEFAULT_METHOD if is_turn else request.method,
        options={} if is_turn else request.options,
    )  # fmt: skip
    given = [one.position for one in keyframes if one.position is not None]
    here = State.at_rest(keys[0], given[0] if given else job.halt.last)
    return PlanJob.of(part, here, job.own, job.period)


def waiting(job: PlanJob, motion: Motion) -> KeyframePath:
    """Return the path of a motion between the keyframes, with a wait at an end that is at rest.

    Args:
        job: has a duration, and one end at rest.
        motion: of the same request without a duration.

    Raises:
        TotalError: it takes longer than the requested duration.
        PlanError: both ends move.
    """
    starts, ends = job.ends.moves
    if (starts and ends) or job.request.total is None or not isinstance(motion.path, Path):
        raise PlanError("the motion does not rest at either end")
    begin, end = motion.start_time, motion.end_time
    refusal.check_total(job.request.total, end - begin)
    wait = job.request.total - (end - begin)
    inner = motion.path.trajectory.restricted(begin, end).shifted(-begin)
    positions = motion.path.positions.since(begin).delayed(-begin)
    times = motion.keyframe_times - begin
    if wait <= _WHOLE * job.request.total:
        return KeyframePath(inner, positions, times, motion.certificate.notes)
    held = hold(job.request.keys[0 if ends else -1], wait)
    if ends:
        parts = [held, inner.shifted(wait)]
        times, positions = times + wait, positions.delayed(wait)
        times[0] = 0.0
    else:
        parts = [inner, held.shifted(end - begin)]
        times[-1] = job.request.total
    return KeyframePath(Trajectory.joined(parts), positions, times, motion.certificate.notes)


def states_at_ends(job: PlanJob) -> tuple[State, State]:
    """Return the states at the first and the last keyframe."""
    ends, keys, zero = job.ends, job.request.keys, np.zeros(3)
    vectors = (ends.omega_start, ends.alpha_start, ends.omega_end)
    first, first_rate, last = (zero if one is None else one for one in vectors)
    at = job.halt.last
    return State(keys[0], first, first_rate, at), State(keys[-1], last, zero, at)


def _laid(
    job: PlanJob,
    parts: Sequence[Sequence[Trajectory]],
    times: Floats,
    notes: tuple[str, ...] = (),
) -> KeyframePath:
    """Return the path of parts laid end to end, each given from time 0 on."""
    laid: list[Trajectory] = []
    since = 0.0
    for part in parts:
        laid += [one.shifted(since) for one in part]
        since = laid[-1].domain[1] if laid else since
    held = PositionPath.held(job.halt.last)
    return KeyframePath(Trajectory.joined(laid), held, times, notes)
