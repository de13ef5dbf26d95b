"""Blending: run one motion into the next one without stopping at the corner between them.

A quintic leaves the first motion shortly before its end and joins the next one shortly after its
start.  It has the orientation, velocity and acceleration of both.  A wider cut of the corner is
faster, and the tolerance limits its width.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orientd.curves import Trajectory
from orientd.errors import PlanError
from orientd.model import Limits, MotionRequest
from orientd.planner.connect import join, try_joins
from orientd.planner.facts import HISTORY
from orientd.planner.job import certified
from orientd.planner.motion import Motion
from orientd.planner.path import Path, PositionPath, quintic
from orientd.planner.planning import plan, timed
from orientd.planner.recorded import RecordedMotion
from orientd.planner.state import State
from orientd.planner.timing import Indices, KeyframePath, quickest
from orientd.rotation import Floats, angle

_DISTANCES = 24  # distances from the corner at which to leave and to join
_SHARES = np.concatenate([np.linspace(0.3, 1.0, 15), [1.1, 1.2]])  # of the replaced time
_FEW_SHARES = np.array([0.6, 0.8, 1.0])  # for a computed timing: less at a larger distance
_BELOW = 0.99  # share of the velocity limit at which a blend may leave a motion
_TRIES = 12  # blends with a computed timing
_POINTS = 65
_SAME = 1e-9


def blend(
    first: RecordedMotion,
    request: MotionRequest,
    *,
    tolerance: float,
    limits: Limits,
    period: float,
    earliest: int = 0,
    motion_id: str | None = None,
) -> tuple[int, Motion]:
    """Plan a motion that follows another one, without a stop between them if possible.

    If the tolerance is zero, or no blend exists, the motions meet at the end of the first one. They
    meet there at its end velocity if the next one begins with the same velocity, otherwise at rest.

    Args:
        first: the previous motion from *earliest* to its end, with three more records before that.
        request: the next motion.
        tolerance: largest distance of the blend from the corner, the final orientation of the first
            motion, rad.
        limits: the device's.
        period: the device's cycle, s.
        earliest: the first record of *first* at which the blend may leave it.
        motion_id: identifier of the motion; by default a new random one.

    Returns:
        The record of *first* at which to leave it, and the motion from there on.  Its certificate
        notes how far from the corner it passes.

    Raises:
        RequestError: its method or the device does not allow the request.
        PlanError: it cannot be planned.
        ValueError: *tolerance* is not a number from 0 on, or the periods differ.
    """
    if not tolerance >= 0.0:
        raise ValueError(f"tolerance must be a number from 0 on, got {tolerance}")
    facts = first.facts
    if facts.period != period:
        raise ValueError(f"period must be that of the first motion, {facts.period}, got {period}")
    moving = _moving_on(first, request, limits, period, earliest, motion_id)
    if moving is not None:
        return moving
    rest = first.last_record
    second = plan(
        request, start=first.state_at(rest), limits=limits, period=period, motion_id=motion_id
    )
    if tolerance > 0.0 and isinstance(second.path, Path):
        found = _blended(first, second, second.path, tolerance, earliest)
        if found is not None:
            return found
    return max(rest, earliest), second


def _moving_on(
    first: RecordedMotion,
    request: MotionRequest,
    limits: Limits,
    period: float,
    earliest: int,
    motion_id: str | None,
) -> tuple[int, Motion] | None:
    """Return the motion that begins with the end velocity of the first one, if there is one."""
    end_time = first.facts.end_time
    record = round(end_time / period)
    is_on_record = abs(record * period - end_time) <= _SAME * period
    if end_time >= first.facts.duration - _SAME or not is_on_record or record < earliest:
        return None
    state = first.state_at(record)
    wanted = request.omega_start
    if wanted is None or np.linalg.norm(wanted - state.omega_body) > _SAME:
        return None
    if request.approach or angle(request.keys[0], state.q) > _SAME:
        return None
    try:
        return record, plan(request, start=state, limits=limits, period=period, motion_id=motion_id)
    except PlanError:
        return None


def _blended(
    first: RecordedMotion, second: Motion, path: Path, tolerance: float, earliest: int
) -> tuple[int, Motion] | None:
    """Return the fastest blend within the tolerance."""
    cuts = _cuts(first, second, first.state_at(first.last_record).q, earliest)
    request = second.request
    is_slower = request.total is not None or request.pace is not None or not request.is_quickest
    modes = (False,) if is_slower or path.trajectory.continuity < 2 else (True, False)
    for is_timed_anew in modes if len(cuts[0]) else ():
        found = _best(first, second, path, tolerance, cuts, is_timed_anew=is_timed_anew)
        if found is not None:
            return found
    return None


def _best(
    first: RecordedMotion,
    second: Motion,
    path: Path,
    tolerance: float,
    cuts: tuple[Indices, Indices],
    *,
    is_timed_anew: bool,
) -> tuple[int, Motion] | None:
    """Return the fastest blend between given records.

    Args:
        tolerance: largest distance from the corner, rad.
        cuts: records at which to leave the first motion and to join the second one.
        is_timed_anew: whether to run the blend and the second motion as fast as the limits permit,
            or the second motion at its own times.
    """
    period, corner, limits = first.facts.period, first.state_at(first.last_record).q, second.limits
    leave, joined = cuts
    omega = np.abs(first.rows_at(leave)[:, 4:7])
    speeds = np.linalg.norm(omega, axis=1) / limits.velocity
    speeds = np.maximum(speeds, np.max(omega / limits.axis_velocity, axis=1))
    # The first motion may be at its limits where the blend leaves it.
    quickest_state = first.state_at(int(leave[np.argmax(speeds)]))
    shares, pairs = _SHARES, np.arange(len(leave))
    if is_timed_anew:
        # Try those that save most first.  At the velocity limit only a straight path is possible.
        shares, pairs = _FEW_SHARES, np.argsort(leave - joined, kind="stable")
        pairs = pairs[speeds[pairs] <= _BELOW]
    if not len(pairs):
        return None
    pairs = np.repeat(pairs, len(shares))
    leave, joined = leave[pairs], joined[pairs]
    spared = first.last_record - leave + joined
    cycles = spared * np.tile(shares, len(pairs) // len(shares))
    if not is_timed_anew:
        cycles = np.maximum(np.rint(cycles), 2.0)
    durations = period * cycles
    here, there = first.rows_at(leave), second.sample(period * joined.astype(np.float64))
    begins = here[:, :4], here[:, 4:7], here[:, 7:10]
    w, kept = try_joins(begins, there, durations, quickest_state, limits)
    order = np.arange(len(spared))
    if not is_timed_anew:
        # Try the fastest first.
        kept = kept[(spared - cycles)[kept] > 0.0]
        order = kept[np.argsort(-(spared - cycles)[kept], kind="stable")]
    best: tuple[int, Motion] | None = None
    tries, most_saved = 0, 0.0
    for one in order.tolist():
        blended = join(here[one, :4], w[one], float(durations[one]))
        instants = np.linspace(0.0, float(durations[one]), _POINTS)
        distances = angle(blended.orientations(instants), corner)
        nearest = int(np.argmin(distances))
        if distances[nearest] > tolerance:
            continue
        if tries == _TRIES:
            break
        tries += 1
        start = first.state_at(int(leave[one]))
        passed, far = float(instants[nearest]), float(distances[nearest])
        followed = _followed(blended, start, second, path, period * int(joined[one]), passed)
        try:
            motion = _motion(followed, start, second, far, is_timed_anew=is_timed_anew)
        except PlanError:
            continue
        saved = period * (first.last_record - leave[one]) + second.duration - motion.duration
        if saved > most_saved:
            note = (
                f"blended with the motion before: passes the corner at {far:.4g} rad, "
                f"{saved:.3f} s sooner than by way of rest"
            )
            best, most_saved = (int(leave[one]), motion.noted(note)), saved
        if not is_timed_anew:
            break
    return best


def _cuts(
    first: RecordedMotion, second: Motion, corner: Floats, earliest: int
) -> tuple[Indices, Indices]:
    """Return records to leave and to join, equally far from the corner, near no other keyframe."""
    period, begin = first.facts.period, first.facts.last_passed
    coming = second.keyframe_times[angle(second.request.keys, corner) > _SAME]
    end = float(coming[0]) if len(coming) else second.end_time
    at_hand, last = first.at_hand[0] + HISTORY, first.last_record
    leave = np.arange(max(earliest, at_hand, int(np.ceil(begin / period))), last)
    joined = np.arange(1, min(int(end / period), second.record_count - 2) + 1)
    if not len(leave) or not len(joined):
        return leave[:0], joined[:0]
    before = angle(first.rows_at(leave)[:, :4], corner)
    after = angle(second.sample(period * joined.astype(np.float64)).q, corner)
    # Stop where the distance from the corner no longer grows.
    before = np.maximum.accumulate(before[::-1])
    after = np.maximum.accumulate(after)
    most = min(before[-1], after[-1])
    if not most > _SAME:
        return leave[:0], joined[:0]
    distances = most * np.linspace(0.0, 1.0, _DISTANCES + 1)[1:]
    back = np.minimum(np.searchsorted(before, distances), len(leave) - 1)
    ahead = np.minimum(np.searchsorted(after, distances), len(joined) - 1)
    return leave[len(leave) - 1 - back], joined[ahead]


def _followed(
    blended: Trajectory, start: State, second: Motion, path: Path, time: float, nearest: float
) -> KeyframePath:
    """Return a blend and its continuation; its first time is that of the corner.

    Args:
        time: path time of the second motion at which the blend joins it, s.
        nearest: path time at which the blend is nearest to the corner, s.
    """
    shift = blended.duration - time
    there = path.positions.state(time)
    positions = path.positions.since(time).delayed(shift)
    if start.is_position_moving or np.any(there[0] != start.position):
        here = start.position, start.velocity, start.acceleration
        piece = quintic(here, there, blended.duration)
        breaks = np.array([0.0, blended.duration])
        positions = positions.after(PositionPath(breaks, piece[None], start.position, there[0]))
    later = path.trajectory.restricted(time, path.duration).shifted(shift)
    passed = second.keyframe_times
    times = np.append(nearest, np.where(passed < time, nearest, passed + shift))
    return KeyframePath(Trajectory.joined([blended, later]), positions, times)


def _motion(
    followed: KeyframePath, start: State, second: Motion, far: float, *, is_timed_anew: bool
) -> Motion:
    """Return the motion along a blend and its continuation, *far* from the corner, rad.

    Raises:
        PlanError: it breaks a limit.
    """
    request, limits, period = second.request, second.limits, second.period
    # An end velocity that holds at a given time fixes everything after it.
    end, last = followed.duration, followed.duration
    if request.omega_end is not None:
        end = float(followed.times[-1])

    def certify(quick: KeyframePath) -> Motion:
        trajectory, (passed, *times) = quick.trajectory, quick.times.tolist()
        if is_timed_anew and end < last - _SAME:
            rest = followed.trajectory.restricted(end, last).shifted(quick.duration - end)
            trajectory = Trajectory.joined([trajectory, rest])
        whole = replace(quick, trajectory=trajectory, times=np.array(times))
        motion = certified(whole, request, start, limits, period, motion_id=second.id)
        return replace(motion, corner=(passed, far))

    if not is_timed_anew:
        return certify(followed)
    core = replace(followed, trajectory=followed.trajectory.restricted(0.0, end))

    def make(within: Limits, share: float) -> KeyframePath:
        return quickest(core, within, period, share=share)

    return timed(make, certify, limits)
