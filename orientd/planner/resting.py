"""Motions that rest inside: turns from keyframe to keyframe, and stops next to moving ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from orientd.curves.contract import METHODS
from orientd.curves.roles import is_pair
from orientd.curves.trajectory import Trajectory
from orientd.errors import PlanError
from orientd.model.limits import Limits
from orientd.model.request import DEFAULT_METHOD, Keyframe
from orientd.planner import refusal
from orientd.planner.connect.connector import hold, turn_to_stop
from orientd.planner.connect.leads import SAME_PLACE, approach, straight
from orientd.planner.job import PlanJob
from orientd.planner.motion import Motion
from orientd.planner.path import PositionPath
from orientd.planner.remarks import SWING
from orientd.planner.state import State
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.knots import SAME, turn_lengths
from orientd.planner.timing.profiles import quickest
from orientd.rotation import Floats, angle

STOPS = "stops at every keyframe: this takes less time than the curve through them"
CONNECTS = "a connector joins both keyframes, in place of the curve between them"
BRAKES = "brakes next to its moving ends: the curve turns further, takes longer, or breaks a limit"
MOVES = "rests at every keyframe: the curve through them turns further, or breaks a limit"
WAITS = "waits at the end that is at rest: no slower motion was found"

_SLOWER = 1.2
"""Multiple of the duration of single moves from which on a note says so."""

_WHOLE = 1e-9  # of a period, and of a duration
_CURVE = 0.9  # of the time of stops at every keyframe: a curve through them seldom takes less

Planned = Callable[[PlanJob], KeyframePath]
"""Plans the path of a job, without a check of its records."""


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


def least_singly(job: PlanJob) -> float:
    """Return the least duration of single moves, of which only those from rest to rest count, s."""
    starts, ends = job.ends.moves
    keys = job.request.keys[int(starts) : len(job.request.keys) - int(ends)]
    return least_with_stops(keys, job.limits) if len(keys) > 1 else 0.0


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
    path = _laid(job, [[turn] for turn in turns if turn is not None], times)
    return replace(path, notes=(STOPS,)) if len(keys) > 2 else path


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
    path = quickest(path, limits, job.period, has_rests=True, axes=job.axes_along(path))
    return replace(path, notes=(STOPS,)) if len(states) > 2 else path


def single_moves(job: PlanJob, limits: Limits) -> KeyframePath:
    """Return single moves with a rest at every keyframe between.

    Each waits at an end at rest, for the time that the request leaves it.

    Raises:
        TotalError: they take longer than the requested duration.
        PlanError: one was refused, takes longer than its times, or has no end at rest to wait at.
    """
    job, states = replace(job, limits=limits, _leads={}), _states_to_rest_at(job)
    total, asked = job.request.total, job.request.times
    pairs = list(pairwise(states))
    joints, moves = job.joints_at(states[0]), []
    for one, other in pairs:
        is_direct = not (one.is_at_rest and other.is_at_rest)
        moves.append(job.connected(one, other, is_direct=is_direct, near=joints))
        joints = moves[-1].joints
    takes = np.array([move.cycles * job.period for move in moves])
    waits = np.zeros(len(moves))
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
    return replace(_laid(job, parts, times, (MOVES,)), positions=positions)


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
    is_compared = is_free and not job.is_taken_over and job.axes is None
    is_likely = not request.is_single and took >= _SLOWER * least_singly(job)
    has_tried = can_rest(job) or (can_move_singly(job) and any(job.ends.moves))
    if has_tried or not (is_compared and is_likely):
        return motion
    moves = job.with_leads(single_moves(job.with_quick_leads(), job.limits)).duration
    if took < _SLOWER * moves:
        return motion
    return motion.noted(
        f"takes {took:.4g} s: single moves with a stop at every keyframe would take {moves:.4g} s; "
        "another method or other velocities may be quicker"
    )


def swing(job: PlanJob, path: KeyframePath | State) -> float:
    """Return how much further than the short way a part between moving ends turns, rad.

    It is zero if that is little, or if the request chooses the way.  It does not count a stop next
    to a moving end and the turn back from there.
    """
    if isinstance(path, State) or not any(job.ends.moves):
        return 0.0
    request, short = job.request, turn_lengths(job.request)
    is_chosen = is_pair(METHODS[request.method]) and bool(request.options)
    if is_chosen or job.limits.velocity * path.duration <= short.sum() + SWING:
        return 0.0
    further = np.diff(path.trajectory.turned(path.times)) - short
    for part, state in zip((0, -1), states_at_ends(job), strict=True):
        further[part] -= 2.0 * turn_to_stop(state, job.limits)
    most = float(further.max())
    return most if most > SWING else 0.0


def braking(
    job: PlanJob, limits: Limits, plan_it: Planned, *, is_connected: bool = False
) -> KeyframePath:
    """Return the path that brakes after a moving first keyframe, and runs up to a moving last one.

    The part between is planned from rest to rest.  So it turns the short way, and can take any
    time.

    Args:
        job: has a moving end.
        limits: to keep.
        plan_it: plans the part between.
        is_connected: whether to rest at the keyframes next to the moving ends, with connectors from
            and to these ends.

    Raises:
        TotalError: it takes longer than the requested duration.
        PlanError: the times leave no room to brake, or a part was refused.
    """
    job = replace(job, limits=limits, _leads={})
    request, period = job.request, job.period
    first, last = rests = _resting_keyframes(job) if is_connected else (0, len(request.keys) - 1)
    if first > last:
        return _connected(job)
    stop, run_up, keys = (_connectors if is_connected else _stops_at_ends)(job)
    before, after = (0.0 if part is None else part.duration for part in (stop, run_up))
    passed, positions, duration = np.zeros(len(keys)), PositionPath.held(job.halt.last), 0.0
    inner: list[Trajectory] = []
    notes: tuple[str, ...] = ()
    if request.positions is not None or bool((angle(keys[:-1], keys[1:]) > SAME).any()):
        between = plan_it(_from_rest_to_rest(job, keys, first, (before, after)))
        if not between.is_from_rest_to_rest:
            raise PlanError(f"{request.method} does not come to rest at its last keyframe")
        duration = between.duration
    least = before + duration + after
    if request.total is not None:
        refusal.check_total(request.total, least)
        duration += max(request.total - least, 0.0)
    elif request.times is None and run_up is not None:
        # A velocity begins at a record.
        duration = math.ceil(duration / period - _WHOLE) * period
    if least > before + after:
        between = between.slowed(duration)
        inner, passed, notes = [between.trajectory], between.times, between.notes
        positions = between.positions.delayed(before)
    elif duration:
        inner = [hold(keys[0], duration)]
    ends = np.full(len(request.keys) - 1 - last, 0.0)
    times = np.concatenate([np.zeros(first), before + passed, ends])
    times[0], times[-1] = 0.0, before + duration + after
    parts = [[part] for part in (stop, *inner, run_up) if part is not None]
    note = _stops_noted(job, rests) if is_connected else BRAKES
    return replace(_laid(job, parts, times, (note, *notes)), positions=positions)


def _stops_noted(job: PlanJob, rests: tuple[int, int]) -> str:
    inner = sorted({one for one in rests if 0 < one < len(job.request.keys) - 1})
    names = " and ".join(f"keyframes[{one}]" for one in inner)
    return (
        f"stops at {names}: no quicker curve through all keyframes was found" if inner else CONNECTS
    )


def _connected(job: PlanJob) -> KeyframePath:
    """Return the connector of two moving keyframes, in the requested duration if there is one.

    Raises:
        TotalError: it takes longer.
    """
    begin, end = states_at_ends(job)
    total, least = job.request.total, 0.0
    if total is not None:
        # Whole periods fill the duration exactly.
        period = total / max(round(total / job.period), 1)
        job, least = replace(job, period=period, _leads={}), total - 0.5 * period
    move = job.connected(begin, end, least=least)
    times = np.array([0.0, move.cycles * job.period])
    if total is not None:
        refusal.check_total(total, float(times[1]))
    return _laid(job, [move.parts], times, (CONNECTS,))


def _resting_keyframes(job: PlanJob) -> tuple[int, int]:
    """Return the first and last keyframe to rest at; the last is below the first if none is."""
    begins, ends = job.ends.moves
    return int(begins), len(job.request.keys) - 1 - int(ends)


def least_with_braking(job: PlanJob) -> float:
    """Return about the least time that the path of :func:`braking` takes, s.

    Raises:
        PlanError: as for :func:`braking`.
    """
    stop, run_up, keys = _stops_at_ends(job)
    leads = sum(part.duration for part in (stop, run_up) if part is not None)
    return leads + _CURVE * least_with_stops(keys, job.limits)


def _connectors(job: PlanJob) -> tuple[Trajectory | None, Trajectory | None, Floats]:
    """Return the connectors at moving ends, and the keyframes between.

    Raises:
        PlanError: one of them was not found.
    """
    first, last = _resting_keyframes(job)
    starts, ends = job.ends.moves
    keys, (begin, end) = job.request.keys[first : last + 1], states_at_ends(job)
    here, there = (State.at_rest(keys[at], job.halt.last) for at in (0, -1))
    near, head, tail = job.joints_at(begin), None, None
    if starts:
        lead = job.connected(begin, here, near=near)
        head, near = Trajectory.joined(lead.parts), lead.joints
    if ends:
        tail = Trajectory.joined(job.connected(there, end, near=near).parts)
    return head, tail, keys


def _stops_at_ends(job: PlanJob) -> tuple[Trajectory | None, Trajectory | None, Floats]:
    """Return the stop after the first keyframe, the run-up to the last, and the keyframes between.

    Raises:
        PlanError: a position moves, or one of them was not found.
    """
    if job.is_taken_over:
        raise PlanError("a position that moves does not wait for the tool to brake")
    begin, end = states_at_ends(job)
    starts, ends = job.ends.moves
    near, stop, run_up = job.joints_at(begin), None, None
    if starts:
        lead = job.stop_from(begin, near, job.share_from(begin))
        stop, near = Trajectory.joined(lead.parts), lead.joints
    if ends:
        mirrored = replace(end, omega_body=-end.omega_body)
        lead = job.stop_from(mirrored, near, job.lead_share)
        run_up = Trajectory.joined(lead.parts).reversed()
    keys = job.request.keys.copy()
    keys[0] = begin.q if stop is None else stop.ends()[0][1]
    keys[-1] = end.q if run_up is None else run_up.ends()[0][0]
    return stop, run_up, keys


def _from_rest_to_rest(
    job: PlanJob, keys: Floats, first: int, took: tuple[float, float]
) -> PlanJob:
    """Return the job of the part between two rests.

    Args:
        keys: its keyframes, shape ``(n, 4)``.
        first: index of the first of them in the request.
        took: durations of the stop before it and of the run-up after it, s.
    """
    request, times, (before, after) = job.request, job.request.times, took
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
        for index, (q, one) in enumerate(
            zip(keys.tolist(), request.keyframes[first:], strict=False)
        )
    ]
    part = replace(
        request, keyframes=keyframes, start_velocity=None, end_velocity=None, approach=False,
        duration=None, limits=None, notes=(), method=DEFAULT_METHOD if is_turn else request.method,
        options={} if is_turn else request.options,
    )  # fmt: skip
    given = [one.position for one in keyframes if one.position is not None]
    here = State.at_rest(keys[0], given[0] if given else job.halt.last)
    axes = job.axes
    if axes is not None:
        joints = job.joints_at(states_at_ends(job)[0])
        axes = replace(axes, joints=joints, before=(), rates=())
    return replace(PlanJob.of(part, here, job.own, job.period, axes), limits=job.limits)


def waiting(job: PlanJob, limits: Limits, plan_it: Planned) -> KeyframePath:
    """Return the path that no duration is given, with a wait at an end that is at rest.

    Args:
        job: has a duration, and a moving end.
        limits: to keep.
        plan_it: plans the same job without a duration.

    Raises:
        TotalError: it takes longer than the requested duration.
        PlanError: both ends move, so the duration lies between two feasible ones.
    """
    starts, ends = job.ends.moves
    total, free = job.request.total, replace(job.request, duration=None)
    if total is None:
        raise ValueError("the request must have a duration")
    quick = replace(job.with_quick_leads(), request=free, limits=limits)
    path = plan_it(quick)
    refusal.check_total(total, path.duration)
    if starts and ends:
        raise refusal.of_duration(total, braking(quick, limits, plan_it).duration)
    wait = total - path.duration
    if wait <= _WHOLE * total:
        return path
    notes = *path.notes, WAITS
    if ends:
        return replace(_delayed(path, wait), notes=notes)
    held = hold(job.request.keys[-1], wait).shifted(path.duration)
    times = np.append(path.times[:-1], total)
    return KeyframePath(Trajectory.joined([path.trajectory, held]), path.positions, times, notes)


def ended_at_record(path: KeyframePath, period: float) -> KeyframePath:
    """Return a path from rest that begins so much later that it ends at a record.

    A motion that follows can then continue from the velocity at its end.
    """
    wait = period * math.ceil(path.duration / period - _WHOLE) - path.duration
    return path if wait <= _WHOLE * period else _delayed(path, wait)


def _delayed(path: KeyframePath, wait: float) -> KeyframePath:
    """Return a path that waits at its first keyframe, s."""
    held, times = hold(np.array(path.first.q), wait), np.append(0.0, path.times[1:] + wait)
    trajectory = Trajectory.joined([held, path.trajectory.shifted(wait)])
    return KeyframePath(trajectory, path.positions.delayed(wait), times, path.notes)


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
