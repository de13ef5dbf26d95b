"""Motions that rest inside: turns from keyframe to keyframe, and stops next to moving ends."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from orientd.curves.contract import METHODS
from orientd.curves.roles import is_pair
from orientd.curves.trajectory import Trajectory
from orientd.driver import Joints
from orientd.errors import PlanError
from orientd.model.limits import Limits
from orientd.model.request import DEFAULT_METHOD, Keyframe, MotionRequest
from orientd.planner import refusal
from orientd.planner.connect.connector import hold, turn_to_stop
from orientd.planner.job import PlanJob
from orientd.planner.motion import Motion
from orientd.planner.path import PositionPath, end_states
from orientd.planner.remarks import SWING
from orientd.planner.state import State
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.knots import SAME, turn_lengths
from orientd.rotation import Floats, angle

STOPS = "stops at every keyframe: the curve turns further, takes longer, or breaks a limit"
CONNECTS = "a connector joins both keyframes, in place of the curve between them"
BRAKES = "brakes next to its moving ends: the curve turns further, takes longer, or breaks a limit"
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


def least(job: PlanJob) -> float:
    """Return the least duration of moves, of which only those from rest to rest count, s."""
    states, (starts, ends) = _states(job), job.ends.moves
    return _least(states[int(starts) : len(states) - int(ends)], job.limits)


def least_with_stops(job: PlanJob) -> float:
    """Return about the least duration of a path that stops next to moving ends, s.

    Raises:
        PlanError: as for :func:`resting`.
    """
    head, rests, tail = _stops(job, _states(job))
    return head.duration + _CURVE * _least(rests, job.limits) + tail.duration


def _least(states: list[State], limits: Limits) -> float:
    """Return the least duration of moves between states at rest, s.

    It ignores limits of the jerk and of components.
    """
    if len(states) < 2:
        return 0.0
    q, places = (np.array([getattr(one, name) for one in states]) for name in ("q", "position"))
    turns, moves = angle(q[:-1], q[1:]), np.linalg.norm(np.diff(places, axis=0), axis=1)
    took = np.zeros(len(turns))
    for lengths, velocity, acceleration in (
        (turns, limits.velocity, limits.acceleration),
        (moves, limits.linear_velocity, limits.linear_acceleration),
    ):
        far = lengths > 0.0
        peaks = np.minimum(np.sqrt(lengths[far] * acceleration), velocity)
        # Without either limit their quotient is NaN.
        rises = np.fmin(np.sqrt(lengths[far] / acceleration), velocity / acceleration)
        took[far] = np.maximum(took[far], lengths[far] / peaks + rises)
    return float(took.sum())


def moves(job: PlanJob) -> KeyframePath:
    """Return the moves from keyframe to keyframe, from rest to rest.

    Raises:
        TotalError: they take longer than the requested duration.
        PlanError: one was refused, or takes longer than its times.
    """
    request, states = job.request, _states(job)
    near, legs = job.joints_at(states[0]), []
    for index, (one, other) in enumerate(pairwise(states), start=1):
        if job.axes is not None and (one.position != other.position).any():
            leg, near = _connector(job, one, other, near)
        else:
            leg, near = job.straight(one, other, near, is_part=len(states) > 2)
        if request.times is not None:
            time = float(request.times[index] - request.times[index - 1])
            if leg.duration > time:
                raise PlanError(
                    f"the single move to {request.named(index)} takes {leg.duration:.4g} s, its "
                    f"times leave {time:.4g} s"
                )
            leg = _lasting(leg, one, time)
        legs.append(leg)
    times = np.cumsum([0.0, *(leg.duration for leg in legs)])
    of_legs = tuple(note for leg in legs for note in leg.notes)
    path = KeyframePath.joined(legs, times, ((STOPS,) if len(states) > 2 else ()) + of_legs)
    refusal.check_duration(path.duration)
    return path if request.total is None else path.lasting(request.total)


def _states(job: PlanJob) -> list[State]:
    """Return the states at all keyframes, at rest between the first and the last."""
    keys, places, zero = job.request.keys, job.request.positions, np.zeros(3)
    if places is None:
        places = np.repeat(job.halt.last[None], len(keys), axis=0)
    else:
        is_given = np.isfinite(places[:, 0])
        places = places[is_given][np.maximum(np.cumsum(is_given) - 1, 0)]
    # Orientations of a request are checked already.
    states = [State(q, zero, zero, place) for q, place in zip(keys, places, strict=True)]
    vectors = job.ends.omega_start, job.ends.alpha_start, job.ends.omega_end
    first, rate, last = (zero if one is None else one for one in vectors)
    states[0] = replace(states[0], omega_body=first, alpha_body=rate)
    states[-1] = replace(states[-1], omega_body=last)
    return states


def compared(job: PlanJob, motion: Motion) -> Motion:
    """Return the motion, with a note if single moves would take far less time."""
    request, took = job.request, motion.duration
    is_free = request.is_quickest and request.total is None and not request.turns.any()
    is_compared = is_free and not (job.is_taken_over or job.axes is not None or request.is_single)
    # The moves were an attempt of the default method.
    if request.method == DEFAULT_METHOD or not is_compared or took < _SLOWER * least(job):
        return motion
    single = job.with_leads(resting(job, moves)).duration
    if took < _SLOWER * single:
        return motion
    return motion.noted(
        f"takes {took:.4g} s: single moves with a stop at every keyframe would take {single:.4g} "
        "s; another method or other velocities may be quicker"
    )


def swing(job: PlanJob, path: KeyframePath | State) -> float:
    """Return how much further than the short way a part between moving ends turns, rad.

    Only a path with a moving end turns further, and one past a pole of two axes, with their roll.
    It is zero if that is little, or if the request chooses the way.  It does not count a stop next
    to a moving end and the turn back from there.
    """
    gives_roll = job.axes is not None and job.axes.gives_roll and not job.request.is_single
    if isinstance(path, State) or not (any(job.ends.moves) or gives_roll):
        return 0.0
    request, short = job.request, turn_lengths(job.request)
    is_chosen = is_pair(METHODS[request.method]) and bool(request.options)
    if is_chosen or job.limits.velocity * path.duration <= short.sum() + SWING:
        return 0.0
    further = np.diff(path.trajectory.turned(path.times)) - short
    states = _states(job)
    for part in (0, -1):
        further[part] -= 2.0 * turn_to_stop(states[part], job.limits)
    most = float(further.max())
    return most if most > SWING else 0.0


def resting(job: PlanJob, plan_it: Planned, *, is_connected: bool = True) -> KeyframePath:
    """Return the path that rests next to its moving ends, and is planned from rest to rest between.

    So the part between turns the short way, and can take any time.

    Args:
        job: the job; without a moving end it is planned as it is.
        plan_it: plans the part between.
        is_connected: whether to rest at the keyframes next to the moving ends, with connectors from
            and to these ends.  Otherwise it brakes after a moving first keyframe, and runs up to a
            moving last one.

    Raises:
        TotalError: it takes longer than the requested duration.
        PlanError: the times leave no room to rest, or a part was refused.
    """
    request, states, (starts, ends) = job.request, _states(job), job.ends.moves
    if not (starts or ends):
        return plan_it(job)
    first, end = int(starts and is_connected), len(states) - int(ends and is_connected)
    if first == end:
        return _connected(job, *states)
    head, rests, tail = (_connectors if is_connected else _stops)(job, states)
    before, after = head.duration, tail.duration
    times = _times_between(request, first, end, (before, after))
    inner = _held(rests[0], 0.0, count=len(rests))
    if any(_is_elsewhere(*pair) for pair in pairwise(rests)):
        inner = plan_it(_from_rest_to_rest(job, rests, first, times))
        if not inner.is_from_rest_to_rest:
            raise PlanError(f"{request.method} does not come to rest at its last keyframe")
    begin, duration = before, inner.duration
    if times is not None:
        begin, duration = float(times[0]), float(times[-1] - times[0])
    elif ends:
        # A velocity begins at a record.
        duration = math.ceil(duration / job.period - _WHOLE) * job.period
    if request.total is not None:
        refusal.check_total(request.total, before + duration + after)
        duration = max(duration, request.total - before - after)
    inner, until = _lasting(inner, rests[0], duration), begin + duration
    whole = until + after if request.times is None else float(np.ptp(request.times))
    pauses = _held(rests[0], begin - before), _held(rests[-1], whole - after - until)
    passed = begin + inner.times if times is None else times
    passed = np.concatenate([np.zeros(first), passed, np.zeros(len(states) - end)])
    passed[0], passed[-1] = 0.0, whole
    note = _connects(request, {first, end - 1} - {0, len(states) - 1}) if is_connected else BRAKES
    legs = head, pauses[0], inner, pauses[1], tail
    return KeyframePath.joined(legs, passed, (note, *inner.notes))


def _connects(request: MotionRequest, stops: set[int]) -> str:
    """Return the note on connectors, and the keyframes at which they stop."""
    names = " and ".join(map(request.named, sorted(stops)))
    return (
        f"stops at {names}: no quicker curve through all keyframes was found" if names else CONNECTS
    )


def _connected(job: PlanJob, begin: State, end: State) -> KeyframePath:
    """Return the connector of two moving keyframes, in the requested time if there is one.

    Raises:
        TotalError: it takes longer.
    """
    request, least = job.request, 0.0
    total = request.total if request.times is None else float(np.ptp(request.times))
    if total is not None:
        # Whole periods fill the time exactly.
        period = total / max(round(total / job.period), 1)
        job, least = replace(job.within(job.limits), period=period), total - 0.5 * period
    path, _ = _connector(job, begin, end, least=least)
    if total is not None:
        refusal.check_total(total, path.duration)
    return replace(path, notes=(CONNECTS,))


def _connector(
    job: PlanJob, begin: State, end: State, near: Joints = (), *, least: float = 0.0
) -> tuple[KeyframePath, Joints]:
    """Return the path of a lead-in from one state to another, and the axes at its end."""
    lead = job.connected(begin, end, least=least, near=near)
    trajectory = Trajectory.joined(lead.parts)
    times = np.array([0.0, trajectory.duration])
    return KeyframePath(trajectory, lead.positions, times, slews=lead.slews), lead.joints


def _connectors(
    job: PlanJob, states: list[State]
) -> tuple[KeyframePath, list[State], KeyframePath]:
    """Return the connectors at moving ends, and the states at rest between.

    Raises:
        PlanError: one of them was not found.
    """
    near, (starts, ends), count = job.joints_at(states[0]), job.ends.moves, len(states)
    head, tail = _held(states[0], 0.0), _held(states[-1], 0.0)
    if starts:
        head, near = _connector(job, states[0], states[1], near)
    if ends:
        tail, _ = _connector(job, states[-2], states[-1], near)
    return head, states[int(starts) : count - int(ends)], tail


def _stops(job: PlanJob, states: list[State]) -> tuple[KeyframePath, list[State], KeyframePath]:
    """Return the stop after the first keyframe, the run-up to the last, and the rests between.

    Raises:
        PlanError: a position moves, or one of them was not found.
    """
    if job.is_taken_over:
        raise PlanError("a position that moves does not wait for the tool to brake")
    head, tail = _held(states[0], 0.0), _held(states[-1], 0.0)
    (starts, ends), begin, end = job.ends.moves, states[0], states[-1]
    near = job.joints_at(begin)
    if starts:
        lead = job.stop_from(begin, near, job.share_from(begin))
        head, near = replace(head, trajectory=Trajectory.joined(lead.parts)), lead.joints
        begin = State.at_rest(head.trajectory.ends()[0][1], begin.position)
    if ends:
        lead = job.stop_from(replace(end, omega_body=-end.omega_body), near, job.lead_share)
        tail = replace(tail, trajectory=Trajectory.joined(lead.parts).reversed())
        end = State.at_rest(tail.trajectory.ends()[0][0], end.position)
    return head, [begin, *states[1:-1], end], tail


def _times_between(
    request: MotionRequest, first: int, end: int, took: tuple[float, float]
) -> Floats | None:
    """Return the times of the part between two rests, s; none if the keyframes have none.

    Args:
        request: has the times of its keyframes.
        first: the index of the first keyframe of that part.
        end: one more than that of its last keyframe.
        took: durations of the stop before it and of the run-up after it, s.
    """
    if request.times is None:
        return None
    times, (before, after) = request.times - request.times[0], took
    inside: Floats = times[first:end].copy()
    until = float(times[-1]) - after
    if first == 0:
        inside[0] = before
    if end == len(times):
        inside[-1] = until
    is_late = before > inside[0] + _WHOLE or inside[-1] > until + _WHOLE
    if is_late or (np.diff(inside) <= 0.0).any():
        raise PlanError(
            f"the times leave no room to come to rest in {before:.4g} s next to the first velocity "
            f"and to run up in {after:.4g} s to the last one"
        )
    return inside


def _from_rest_to_rest(
    job: PlanJob, rests: list[State], first: int, times: Floats | None
) -> PlanJob:
    """Return the job of the part between two rests, which begins at a keyframe of this index."""
    request, is_turn = job.request, len(rests) == 2
    asked = request.keyframes[first : first + len(rests)]
    keyframes = [
        Keyframe(
            tuple(state.q.tolist()),
            None if times is None else float(times[index]),
            one.position,
            turns=one.turns,
        )
        for index, (state, one) in enumerate(zip(rests, asked, strict=True))
    ]
    part = replace(
        request, keyframes=keyframes, start_velocity=None, end_velocity=None, approach=False,
        duration=None, limits=None, notes=(), method=DEFAULT_METHOD if is_turn else request.method,
        options={} if is_turn else request.options,
    )  # fmt: skip
    axes = job.axes
    if axes is not None:
        axes = replace(axes, joints=job.joints_at(_states(job)[0]), before=(), rates=())
    return PlanJob.of(part, rests[0], job.own, job.period, axes).within(job.limits)


def waited(path: KeyframePath, wait: float, *, is_before: bool = True) -> KeyframePath:
    """Return a path that waits at its first keyframe, or at its last, s."""
    first, last = end_states(path.trajectory)
    rest = replace(first, position=path.positions.first)
    legs, times = [_held(rest, wait), path], np.append(0.0, path.times[1:] + wait)
    if not is_before:
        rest = replace(last, position=path.positions.last)
        legs, times = [path, _held(rest, wait)], np.append(path.times[:-1], path.duration + wait)
    return KeyframePath.joined(legs, times, path.notes)


def _is_elsewhere(one: State, other: State) -> bool:
    return bool(angle(one.q, other.q) > SAME) or bool((one.position != other.position).any())


def _lasting(path: KeyframePath, begin: State, duration: float) -> KeyframePath:
    """Return a path of another duration, s; one without a duration is a rest where it begins."""
    if path.duration:
        return path.slowed(duration)
    return _held(begin, duration, count=len(path.times))


def _held(state: State, duration: float, *, count: int = 2) -> KeyframePath:
    """Return a rest for a duration, s, from *count* keyframes on."""
    held = hold(np.array(state.q), duration if duration > _WHOLE else 0.0)
    return KeyframePath(held, PositionPath.held(state.position), np.zeros(count))
