"""Blending: run one motion into the next one without stopping at the corner between them.

A quintic leaves the first motion shortly before its end and joins the next one shortly after its
start.  It has the orientation, velocity and acceleration of both.  A wider cut of the corner is
faster, and the tolerance limits it: no part of the quintic is further from both motions.  Up to the
corner it keeps the limits of the first motion, and is no faster than the rest of that would be.

The tolerance of the position is in proportion: as far as the position moves on either motion while
that turns by the tolerance, whichever is more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from orientd.curves.trajectory import Trajectory
from orientd.errors import LimitError, PlanError, StartError
from orientd.model.limits import Limits
from orientd.model.request import MotionRequest
from orientd.planner import refusal
from orientd.planner.certify.measuring import measure
from orientd.planner.certify.summary import before
from orientd.planner.connect.connector import join, sample_joins, try_joins
from orientd.planner.facts import HISTORY
from orientd.planner.job import certified
from orientd.planner.motion import Motion
from orientd.planner.path import Path, PositionPath, quintic, quintics
from orientd.planner.planning import plan, timed
from orientd.planner.recorded import RecordedMotion
from orientd.planner.state import State
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.knots import Indices
from orientd.planner.timing.profiles import QuickPath, quickest
from orientd.rotation import Floats, align, angle
from orientd.tolerances import GUARD_TOLERANCE

NOT_BLENDED = "not blended with the motion before"
"""The beginning of a note of the certificate that says why a motion is not blended."""

_DISTANCES = 16  # distances from the corner at which to leave and to join
_NEAREST = 1e-2  # the least of them, as a share of the largest
_SHARES = np.concatenate([np.linspace(0.3, 1.0, 8), [1.2]])  # of the replaced time
_FEW_SHARES = np.array([0.5, 0.6, 0.8, 1.0])  # for a computed timing
_SLOWEST = 0.05  # least rate of the second motion at which to join it
_NEARLY = 0.99  # share of a velocity that counts as all of it
_TRIES = 8  # blends with a computed timing
_POINTS = 65  # of a blend at which its distances are taken
_LEG = 16  # points of either motion, between which it counts as straight
_SURE = 0.97  # share of a tolerance that the points may use: a little more lies between them
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

    If the tolerance is zero, or no blend exists, the next motion begins from rest.  That is three
    cycles after the end of the first one, when the setpoints have no differences any more.  If the
    next one begins with the end velocity of the first one, it joins there instead.

    Args:
        first: the previous motion from *earliest* to its end, with three more records before that.
        request: the next motion.
        tolerance: largest distance of the blend from both motions, and from the corner, the final
            orientation of the first motion, rad.
        limits: the device's.
        period: the device's cycle, s.
        earliest: the first record of *first* at which the blend may leave it.
        motion_id: identifier of the motion; by default a new random one.

    Returns:
        The record of *first* at which to leave it, and the motion from there on.  Three records
        beyond the last one are at rest.  The certificate notes how far from the corner the motion
        passes, or why it does not blend.

    Raises:
        RequestError: its method or the device does not allow the request.
        StartError: it is too late to join at the end velocity of the first motion.
        PlanError: it cannot be planned.
        ValueError: *tolerance* is not a number from 0 on, or the periods differ.
    """
    if not tolerance >= 0.0:
        raise ValueError(f"tolerance must be a number from 0 on, got {tolerance}")
    facts = first.facts
    if facts.period != period:
        raise ValueError(f"period must be that of the first motion, {facts.period}, got {period}")
    if _joins_end(first, request):
        return _moving_on(first, request, limits, period, earliest, motion_id)
    end = first.state_at(first.last_record)
    start = State.at_rest(end.q, end.position)
    second = plan(request, start=start, limits=limits, period=period, motion_id=motion_id)
    if tolerance > 0.0:
        blended = _blended(first, second, tolerance, earliest)
        if not isinstance(blended, str):
            return blended
        second = second.noted(f"{NOT_BLENDED}: {blended}")
    return first.last_record + HISTORY, second


# Join at an end velocity


def _joins_end(first: RecordedMotion, request: MotionRequest) -> bool:
    """Return whether a request begins with the end velocity of the first motion."""
    facts, omega = first.facts, request.omega_start
    if omega is None or request.approach or facts.end_time >= facts.duration - _SAME:
        return False
    is_same = float(np.linalg.norm(omega - first.end_state.omega_body)) <= _SAME
    return is_same and float(angle(request.keys[0], first.end_state.q)) <= _SAME


def _moving_on(
    first: RecordedMotion,
    request: MotionRequest,
    limits: Limits,
    period: float,
    earliest: int,
    motion_id: str | None,
) -> tuple[int, Motion]:
    """Return the record before the end of the first motion, and the motion that continues there.

    If the end is not on a record, the next motion has other records than it would have alone.

    Raises:
        StartError: it is too late for that.
        PlanError: it cannot be planned.
    """
    end = first.facts.end_time / period
    record, lead = int(end + _SAME), 0.0
    if abs(end - record) > _SAME:
        record, lead = record - 1, first.facts.end_time - (record - 1) * period
    if record < max(earliest, first.at_hand[0] + HISTORY):
        late = max(0.0, (earliest - end) * period)
        raise StartError(
            "it is too late to begin with the end velocity of the motion before, whose end is "
            f"passed {late:.3g} s before this is ready; queue it earlier, or set `approach: true`"
        )
    start = first.state_at(record) if not lead else first.end_state
    second = plan(request, start=start, limits=limits, period=period, motion_id=motion_id)
    path = second.path
    if not lead or not isinstance(path, Path):
        return record, second
    start, there = first.state_at(record), path.trajectory.sample(np.zeros(1))
    begins = start.q[None], start.omega_body[None], start.alpha_body[None]
    w, _ = try_joins(begins, there, np.array([lead]), start, second.limits)
    followed = _followed(join(start.q, w[0], lead), start, second, path, 0.0, 1.0, lead)
    whole = replace(followed, times=followed.times[2:])
    motion = certified(whole, request, start, second.limits, period, motion_id=second.id)
    known = motion.certificate.notes
    return record, motion.noted(*(one for one in second.certificate.notes if one not in known))


# Blend


class _Timing(Enum):
    """How fast to run a blend and the second motion.

    Attributes:
        WHOLE: all of it as fast as the limits permit.
        BEHIND: only what is behind the corner, if the first motion is slower than the second one.
        OWN: the second motion at its own times.
    """

    WHOLE = "whole"
    BEHIND = "behind the corner"
    OWN = "its own"


@dataclass(frozen=True, slots=True, eq=False)
class _Corner:
    """The corner between two motions.

    Attributes:
        first: the motion before it.
        second: the motion after it, from rest.
        path: of the second motion.
        q: the orientation there.
        begin: record of the first motion at which to leave it at the earliest.
        end: path time of the second motion up to which no other keyframe comes, s.
        tolerance: largest distance of a blend from the corner and from both motions, rad.
        moved: largest distance of its positions from both motions, m.
        narrow: limits of a blend up to the corner.
    """

    first: RecordedMotion
    second: Motion
    path: Path
    q: Floats
    begin: int
    end: float
    tolerance: float
    moved: float
    narrow: Limits

    @classmethod
    def of(
        cls, first: RecordedMotion, second: Motion, path: Path, tolerance: float, earliest: int
    ) -> _Corner:
        """Return the corner between two motions.

        Args:
            first: the motion before it, to be left at *earliest* or later.
            second: the motion after it.
            path: of the second motion.
            tolerance: rad; the tolerance of the position follows from it.
            earliest: record of the first motion.
        """
        facts, last = first.facts, first.last_record
        q = first.state_at(last).q
        coming = second.keyframe_times[angle(second.request.keys, q) > _SAME]
        end = float(coming[0]) if len(coming) else second.end_time
        begin = max(first.at_hand[0] + HISTORY, math.ceil(facts.last_passed / facts.period))
        begin = min(max(earliest, begin), last)
        moved = 0.0
        for (leg,) in (
            _legs_before(first, np.array([begin])),
            _legs_after(path, np.array([end])),
        ):
            turn = float(np.sum(angle(leg[:-1, :4], leg[1:, :4])))
            move = float(np.sum(np.linalg.norm(np.diff(leg[:, 4:], axis=0), axis=1)))
            moved = max(moved, move * min(1.0, tolerance / turn) if turn > _SAME else 0.0)
        # Not only limits make a motion slow: a pace, a duration or times do, too.
        omega = first.rows(begin - 1, last + 2 - begin)[:, 4:7]
        fastest = float(np.max(np.linalg.norm(omega, axis=1))) / _NEARLY or math.inf
        narrow = replace(facts.limits, velocity=min(facts.limits.velocity, fastest))
        return cls(first, second, path, q, begin, end, tolerance, moved, narrow)

    @property
    def timings(self) -> tuple[_Timing, ...]:
        """The timings to try, in order."""
        second, narrow = self.second, self.narrow
        request, limits = second.request, second.limits
        is_slower = request.total is not None or request.pace is not None
        if is_slower or not request.is_quickest or self.path.trajectory.continuity < 2:
            return (_Timing.OWN,)
        is_within = narrow.lower(limits) == replace(limits, velocity=narrow.velocity)
        fastest = second.certificate.peak_velocity.value
        is_even = is_within and narrow.velocity >= fastest
        return (_Timing.WHOLE if is_even else _Timing.BEHIND, _Timing.OWN)


@dataclass(frozen=True, slots=True, eq=False)
class _Cuts:
    """Quintics that cut a corner, one row each, those that save most first.

    Attributes:
        leave: records at which they leave the first motion.
        here: rows of the first motion there.
        times: path times at which they join the second one, s.
        rates: of the second motion there.
        durations: s.
        w: half-angle increments, shape ``(n, 5, 3)``.
    """

    leave: Indices
    here: Floats
    times: Floats
    rates: Floats
    durations: Floats
    w: Floats

    def path(self, corner: _Corner, one: int, passed: float) -> KeyframePath:
        """Return the path along a cut that passes the corner at a given time, s."""
        lead = join(self.here[one, :4], self.w[one], float(self.durations[one]))
        start, time, rate = self.start(corner, one), float(self.times[one]), float(self.rates[one])
        return _followed(lead, start, corner.second, corner.path, time, rate, passed)

    def start(self, corner: _Corner, one: int) -> State:
        """Return the state of the first motion at which a cut leaves it."""
        return corner.first.state_at(int(self.leave[one]))


def _blended(
    first: RecordedMotion, second: Motion, tolerance: float, earliest: int
) -> tuple[int, Motion] | str:
    """Return the fastest blend within the tolerance, or why there is none."""
    path = second.path
    if not isinstance(path, Path):
        return "it goes around a keep-out cone"
    corner = _Corner.of(first, second, path, tolerance, earliest)
    records = _records(corner)
    if isinstance(records, str):
        return records
    is_near = False
    for timing in corner.timings:
        cuts = _cuts(corner, *records, timing)
        if not len(cuts.leave):
            continue
        passed, gaps, near = _measured(corner, cuts)
        is_near |= len(near) > 0
        best = _best(corner, cuts, passed, gaps, near, timing)
        if best is not None:
            return best
    left = first.facts.period * (first.last_record - corner.begin)
    where = f" in the {left:.3g} s that were left of it" if corner.begin == earliest else ""
    if is_near:
        return f"no blend{where} keeps the limits of both and is sooner than a stop"
    bound = f"{tolerance:.4g} rad" + (f" or {corner.moved:.3g} m" if corner.moved else "")
    return f"every blend{where} is further than {bound} from both"


def _best(
    corner: _Corner, cuts: _Cuts, passed: Floats, gaps: Floats, near: Indices, timing: _Timing
) -> tuple[int, Motion] | None:
    """Return the record to leave and the motion of the fastest of some cuts.

    Args:
        corner: of both motions.
        cuts: the cuts.
        passed: path times at which they are nearest to the corner, s.
        gaps: distances from it then, rad.
        near: those within the tolerance.
        timing: of the motion.
    """
    period = corner.second.period
    by_rest = period * (corner.first.last_record + HISTORY) + corner.second.duration
    best: tuple[int, Motion] | None = None
    tries, most_saved, done = 0, 0.0, -1
    for one in near.tolist():
        leave, start = int(cuts.leave[one]), cuts.start(corner, one)
        if leave == done:
            continue  # a quicker one from there was found
        path = cuts.path(corner, one, float(passed[one]))
        if timing is not _Timing.WHOLE and not _keeps_first(path, start, corner):
            continue
        if tries == _TRIES:
            break
        tries += 1
        try:
            motion = _motion(path, start, corner, float(gaps[one]), timing)
        except PlanError:
            continue
        done, saved = leave, by_rest - period * leave - motion.duration
        if saved > most_saved:
            note = (
                f"blended with the motion before: passes the corner at {gaps[one]:.4g} rad, "
                f"{saved:.3f} s sooner than by way of rest"
            )
            best, most_saved = (leave, motion.noted(note)), saved
        if timing is _Timing.OWN:
            break
    return best


def _legs_before(first: RecordedMotion, records: Indices) -> Floats:
    """Return poses of the first motion from some records to its end, shape ``(n, _LEG, 7)``."""
    places = np.linspace(records, first.last_record, _LEG, axis=1).astype(np.intp)
    rows = first.rows_at(places.reshape(-1)).reshape(*places.shape, -1)
    return np.concatenate([rows[..., :4], rows[..., 10:13]], axis=-1)


def _legs_after(path: Path, times: Floats) -> Floats:
    """Return poses of the second motion up to some times, shape ``(n, _LEG, 7)``."""
    instants = np.linspace(0.0, times, _LEG, axis=1)
    samples = path.sample(instants.reshape(-1))
    poses = np.concatenate([samples.q, samples.position], axis=1)
    return poses.reshape(*instants.shape, -1)


def _records(corner: _Corner) -> tuple[Indices, Indices] | str:
    """Return records to leave and to join, equally far from the corner; or why there are none."""
    first, second, period = corner.first, corner.second, corner.first.facts.period
    leave = np.arange(corner.begin, first.last_record)
    joined = np.arange(1, min(int(corner.end / period), second.record_count - 2) + 1)
    if not len(leave):
        return "it came too late: that was at its end"
    if not len(joined):
        return "it is too short"
    coming = angle(first.rows_at(leave)[:, :4], corner.q)
    going = angle(second.sample(period * joined.astype(np.float64)).q, corner.q)
    # Stop where the distance from the corner no longer grows.
    coming = np.maximum.accumulate(coming[::-1])
    going = np.maximum.accumulate(going)
    most = min(coming[-1], going[-1])
    if not most > _SAME:
        return "the orientation changes on one side of the corner only, or not at all"
    distances = most * np.geomspace(1.0, _NEAREST, _DISTANCES)
    back = np.minimum(np.searchsorted(coming, distances), len(leave) - 1)
    ahead = np.minimum(np.searchsorted(going, distances), len(joined) - 1)
    return leave[len(leave) - 1 - back], joined[ahead]


def _cuts(corner: _Corner, leave: Indices, joined: Indices, timing: _Timing) -> _Cuts:
    """Return the cuts between given records.

    Args:
        corner: of both motions.
        leave: records at which to leave the first motion.
        joined: records at which to join the second one.
        timing: if it is not the second motion's own, a cut joins that no faster than it leaves the
            first one.  To gain speed it would swing out.
    """
    first, second, period = corner.first, corner.second, corner.first.facts.period
    shares = _SHARES if timing is _Timing.OWN else _FEW_SHARES
    pairs = np.repeat(np.arange(len(leave)), len(shares))
    leave, times = leave[pairs], period * joined[pairs].astype(np.float64)
    here, there = first.rows_at(leave), corner.path.sample(times)
    speeds = np.linalg.norm(here[:, 4:7], axis=1)
    rates = np.ones(len(times))
    if timing is not _Timing.OWN and second.request.omega_end is None:
        rates = speeds / np.maximum(np.linalg.norm(there.omega_body, axis=1), _SAME)
        rates = np.clip(rates, _SLOWEST, 1.0)
    spared = period * (first.last_record - leave) + times / rates
    durations = spared * np.tile(shares, len(pairs) // len(shares))
    if timing is _Timing.OWN:
        durations = period * np.maximum(np.rint(durations / period), 2.0)
    begins, rate = (here[:, :4], here[:, 4:7], here[:, 7:10]), rates[:, None]
    ends = there.q, there.omega_body * rate, there.alpha_body * rate**2
    # The first motion may be at its limits where the blend leaves it.
    around = first.state_at(int(leave[np.argmax(speeds)]))
    w, kept = try_joins(begins, ends, durations, around, second.limits)
    order = np.arange(len(leave))
    if timing is _Timing.OWN:
        kept = kept[(spared - durations)[kept] > 0.0]
        order = kept[np.argsort(-(spared - durations)[kept], kind="stable")]
    return _Cuts(leave[order], here[order], times[order], rates[order], durations[order], w[order])


def _measured(corner: _Corner, cuts: _Cuts) -> tuple[Floats, Floats, Indices]:
    """Return when the cuts are nearest to the corner, how near, and which are within the tolerance.

    Those are within it at the corner and at their farthest distance from both motions.
    """
    records, coming = np.unique(cuts.leave, return_inverse=True)
    times, going = np.unique(cuts.times, return_inverse=True)
    before_it, after_it = _legs_before(corner.first, records), _legs_after(corner.path, times)
    legs = np.concatenate([before_it[coming], after_it[going]], axis=1)
    shares = np.linspace(0.0, 1.0, _POINTS)
    q = sample_joins(cuts.here[:, :4], cuts.w, shares)
    gaps = angle(q, corner.q)
    nearest = np.argmin(gaps[:, 1:-1], axis=1) + 1
    # The parabola through the squares of three distances gives the place and the distance between.
    a, b, c = (gaps[np.arange(len(gaps)), nearest + step] ** 2 for step in (-1, 0, 1))
    bend = np.maximum(a - 2.0 * b + c, np.finfo(np.float64).tiny)
    shift = np.clip(0.5 * (a - c) / bend, -0.5, 0.5)
    gap = np.sqrt(np.maximum(b - 0.5 * bend * shift**2, 0.0))
    passed = (shares[nearest] + shift * shares[1]) * cuts.durations
    lines = align(np.concatenate([q[:, :1], legs[..., :4]], axis=1))[:, 1:]
    away = 4.0 * np.arcsin(np.minimum(0.5 * _farthest(q, lines), 1.0))
    is_near = np.maximum(gap, away) <= _SURE * corner.tolerance
    if np.ptp(legs[..., 4:], axis=(0, 1)).any():
        moves = _moves(corner.path, cuts, shares)
        is_near &= _farthest(moves, legs[..., 4:]) <= _SURE * corner.moved + refusal.SAME_POSITION
    return passed, gap, np.flatnonzero(is_near)


def _moves(path: Path, cuts: _Cuts, shares: Floats) -> Floats:
    """Return positions of cuts at shares of their durations, shape ``(n, len(shares), 3)``."""
    whole, rate = cuts.durations[:, None], (cuts.rates * cuts.durations)[:, None]
    position, velocity, acceleration = path.positions.sample(cuts.times)
    here = cuts.here[:, 10:13], cuts.here[:, 13:16] * whole, cuts.here[:, 16:19] * whole**2
    there = position, velocity * rate, acceleration * rate**2
    ends = [np.stack(both, axis=1).reshape(-1, 3) for both in zip(here, there, strict=True)]
    pieces = quintics(np.ones(len(ends[0]) - 1), *ends)[::2]
    moves: Floats = np.vander(shares, pieces.shape[1], increasing=True) @ pieces
    return moves


def _farthest(points: Floats, lines: Floats) -> Floats:
    """Return the farthest distance of points from lines of straight pieces.

    Args:
        points: shape ``(n, k, d)``.
        lines: shape ``(n, m, d)``.

    Returns:
        Shape ``(n,)``.
    """
    begins, steps = lines[:, None, :-1], np.diff(lines, axis=1)[:, None]
    squares = np.maximum(np.sum(steps**2, axis=3), np.finfo(np.float64).tiny)
    away = points[:, :, None] - begins
    shares = np.clip(np.einsum("nkmd,njmd->nkm", away, steps) / squares, 0.0, 1.0)
    gaps = np.linalg.norm(away - shares[..., None] * steps, axis=3)
    farthest: Floats = np.max(np.min(gaps, axis=2), axis=1)
    return farthest


def _followed(
    lead: Trajectory,
    start: State,
    second: Motion,
    path: Path,
    time: float,
    rate: float,
    passed: float,
) -> KeyframePath:
    """Return a lead onto a motion, and the rest of that at a constant rate.

    Args:
        lead: the orientations of the lead, from path time 0 on.
        start: where it begins.
        second: the motion.
        path: its path.
        time: path time of the motion at which the lead joins it, s.
        rate: of the motion from there on.
        passed: path time of the lead at which it passes the keyframes before that, s.

    Returns:
        The whole path; its first times are *passed* and the end of the lead.
    """
    whole = lead.duration
    position, velocity, acceleration = path.positions.state(time)
    there = position, velocity * rate, acceleration * rate**2
    positions = path.positions.since(time).delayed(-time)
    positions = (positions if positions.is_held else positions.slowed(1.0 / rate)).delayed(whole)
    if start.is_position_moving or np.any(position != start.position):
        piece = quintic((start.position, start.velocity, start.acceleration), there, whole)
        breaks = np.array([0.0, whole])
        positions = positions.after(PositionPath(breaks, piece[None], start.position, position))
    later = path.trajectory.restricted(time, path.duration).shifted(-time)
    later = later.slowed(later.duration / rate).shifted(whole)
    times = second.keyframe_times
    times = np.where(times < time, passed, whole + (times - time) / rate)
    times = np.concatenate([[passed, whole], times])
    return KeyframePath(Trajectory.joined([lead, later]), positions, times)


def _motion(
    path: KeyframePath, start: State, corner: _Corner, gap: float, timing: _Timing
) -> Motion:
    """Return the motion along a cut and its continuation.

    Args:
        path: its first times are those of the corner and of the end of the cut.
        start: where it leaves the first motion.
        corner: of both motions.
        gap: distance from the corner when it passes that, rad.
        timing: of the motion.

    Raises:
        PlanError: it breaks a limit.
    """
    second, fastest = corner.second, corner.narrow.velocity
    request, limits, period = second.request, second.limits, second.period
    # An end velocity that holds at a given time fixes everything after it.
    end = path.duration if request.omega_end is None else float(path.times[-1])

    def certify(timed_path: KeyframePath) -> Motion:
        passed, joined, *times = timed_path.times.tolist()
        whole = replace(timed_path, times=np.array(times))
        if timing is not _Timing.OWN and end < path.duration - _SAME:
            rest = path.trajectory.restricted(end, path.duration).shifted(whole.duration - end)
            whole = replace(whole, trajectory=Trajectory.joined([whole.trajectory, rest]))
        motion = certified(whole, request, start, limits, period, motion_id=second.id)
        if timing is _Timing.WHOLE and not _keeps_first(timed_path, start, corner):
            raise PlanError("it is too fast before the corner")
        return replace(motion, corner=(passed, gap), joined=joined)

    if timing is _Timing.OWN:
        return certify(path)
    core, passed = replace(path, trajectory=path.trajectory.restricted(0.0, end)), path.times[0]

    def make(within: Limits) -> QuickPath:
        if timing is _Timing.WHOLE:
            within = replace(within, velocity=min(within.velocity, fastest))
            return quickest(core, within, period)
        quick = quickest(core.since(passed), within, period)
        lead = path.trajectory.restricted(0.0, passed)
        return replace(
            quick,
            trajectory=Trajectory.joined([lead, quick.trajectory.shifted(passed)]),
            positions=quick.positions.delayed(passed).after(path.positions.until(passed)),
            times=passed + quick.times,
        )

    return timed(make, certify, limits)


def _keeps_first(path: KeyframePath, start: State, corner: _Corner) -> bool:
    """Return whether a path keeps the limits before the corner; its first time is that of it."""
    period, passed = corner.second.period, float(path.times[0])
    peaks = measure(
        Path.joined([path.trajectory], path.positions, start.q),
        int(passed / period) + 1,
        period,
        corner.narrow,
        before=before(start, period),
        rests=(False, False),
        tolerance=GUARD_TOLERANCE,
    )
    try:
        refusal.check_limits(peaks, refusal.Place(corner.second.request, 0.0, passed, path.times))
    except LimitError:
        return False
    return True
