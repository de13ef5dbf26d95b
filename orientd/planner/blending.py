"""Blending: run one motion into the next one without stopping at the corner between them.

A connector leaves the first motion shortly before its end and joins the path of the next one
shortly after its start.  A wider cut of the corner is faster, and the tolerance limits it: no part
of the connector is further from both motions.  It keeps the limits of both, and is no faster than
the rest of the first motion would be.

If the next motion may be as fast as the limits permit, it continues at the speed of the connector.
Otherwise the connector joins it at its own times.

The tolerance of the position is in proportion: as far as the position moves on either motion while
that turns by the tolerance, whichever is more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from orientd.curves.hermite import KksQuinticHermite
from orientd.curves.quintic import quintic
from orientd.curves.trajectory import TimeMap, Trajectory
from orientd.errors import PlanError, StartError
from orientd.mechanism import Mechanism
from orientd.model.limits import Limits
from orientd.model.request import MotionRequest
from orientd.planner import refusal
from orientd.planner.certifying import certified
from orientd.planner.connect.connector import turn_to_stop
from orientd.planner.connect.leads import LEAD_SHARE, connected
from orientd.planner.facts import HISTORY
from orientd.planner.job import TAKE_OVER_SHARE
from orientd.planner.motion import Motion
from orientd.planner.path import Path, PositionPath
from orientd.planner.planning import plan
from orientd.planner.recorded import RecordedMotion
from orientd.planner.state import State
from orientd.planner.timing.axes import Axes
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.knots import Indices
from orientd.planner.timing.profiles import quickest
from orientd.rotation import Floats, align, angle, between, log

NOT_BLENDED = "not blended with the motion before"
"""The beginning of a note of the certificate that says why a motion is not blended."""

_DISTANCES = np.array([1.0, 0.8, 0.6, 0.4, 0.2])  # from the corner, as shares of the largest
_AHEAD = 4.0  # times the turn of a stop, at which a slower motion joins a faster one at most
_BEYOND = 1.4  # times the distance of an arc that touches both motions and keeps the tolerance
_SPEEDS = (1.2, 0.9)  # at which to join, as shares of that at which a cut leaves
_NEARLY = 0.99  # share of a velocity that counts as all of it
_MOST, _LEAST = 0.999, 0.01  # share of the velocity limit at which to join
_CHANGE = 1.4  # largest change of the squared rate, twice
_TRIES = 2  # cuts that are certified
_POINTS = 33  # of a cut at which its distances are taken
_LEG = 16  # points of either motion, between which it counts as straight
_SURE = 0.97  # share of a tolerance that the points may use: a little more lies between them
_KNOTS = 65  # of a position at another speed
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
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
    mechanism: Mechanism | None = None,
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
        mechanism: of a device whose axes the timings regard.

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
        return _moving_on(first, request, limits, period, earliest, motion_id, mechanism)
    end = first.state_at(first.last_record)
    start = State.at_rest(end.q, end.position)
    second = plan(
        request, start=start, limits=limits, period=period, motion_id=motion_id,
        axes=_axes(first, first.last_record, mechanism),
    )  # fmt: skip
    if tolerance > 0.0:
        blended = _blended(first, second, tolerance, earliest)
        if not isinstance(blended, str):
            return blended
        second = second.noted(f"{NOT_BLENDED}: {blended}")
    return first.last_record + HISTORY, second


def _axes(first: RecordedMotion, record: int, mechanism: Mechanism | None) -> Axes | None:
    """Return the axes of a device at a record, for the timing of the next motion."""
    if mechanism is None:
        return None
    return Axes(mechanism, first.joints_at(record), is_recorded=False)


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
    mechanism: Mechanism | None,
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
    second = plan(
        request, start=start, limits=limits, period=period, motion_id=motion_id,
        axes=_axes(first, record, mechanism),
    )  # fmt: skip
    path = second.path
    if not lead or not isinstance(path, Path):
        return record, second
    start, rest = first.state_at(record), _behind(second, path, 0.0)
    there = rest.first
    way = KksQuinticHermite(
        q0=start.q, q1=there.q, t0=0.0, t1=lead, omega0=start.omega_body, omega1=there.omega_body,
        alpha0=start.alpha_body, alpha1=there.alpha_body,
    )  # fmt: skip
    whole = _followed(way.trajectory, start, rest, lead)
    motion = certified(whole, request, start, second.limits, period, motion_id=second.id)
    known = motion.certificate.notes
    return record, motion.noted(*(one for one in second.certificate.notes if one not in known))


# Blend


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
    def is_fixed(self) -> bool:
        """Whether the second motion has its own times: as it was asked for, or for its curve."""
        request = self.second.request
        is_slower = request.total is not None or request.pace is not None
        is_rough = self.path.trajectory.continuity < 2
        is_held = request.omega_end is not None
        return is_slower or is_rough or is_held or not request.is_quickest

    @property
    def ahead(self) -> float:
        """How far from the corner to join the second motion, at most, rad.

        A cut is no faster than the first motion, so a second one that is faster must wait for it.
        """
        if self.narrow.velocity >= _NEARLY * self.second.certificate.peak_velocity.value:
            return math.inf
        rate, zero = np.array([self.narrow.velocity, 0.0, 0.0]), np.zeros(3)
        return _AHEAD * turn_to_stop(State(self.q, rate, zero, zero), self.narrow)

    def reach(self, before: Floats, after: Floats) -> float:
        """Return how far from the corner to leave and to join, at most, rad.

        An arc that touches both motions there passes the corner at the tolerance.

        Args:
            before: the orientation at which to leave the first motion at the earliest.
            after: that at which to join the second one at the latest.
        """
        one, other = log(between(before, self.q)), log(between(self.q, after))
        size = float(np.linalg.norm(one) * np.linalg.norm(other))
        turn = math.acos(min(max(float(one @ other) / size, -1.0), 1.0)) if size else math.pi
        return _BEYOND * self.tolerance / math.tan(max(0.25 * turn, _SAME))


@dataclass(frozen=True, slots=True, eq=False)
class _Cut:
    """A way that cuts a corner within the tolerance.

    Attributes:
        leave: record at which it leaves the first motion.
        lead: the connector.
        rest: the path of the second motion behind it.
        passed: path time at which it is nearest to the corner, s.
        gap: distance from it then, rad.
        expected: about when the second motion ends, s after the first record.
    """

    leave: int
    lead: Trajectory
    rest: KeyframePath
    passed: float
    gap: float
    expected: float


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
    for is_timed_anew in (False,) if corner.is_fixed else (True, False):
        cuts = _cuts(corner, *records, is_timed_anew=is_timed_anew)
        is_near |= bool(cuts)
        best = _best(corner, cuts, is_timed_anew=is_timed_anew)
        if best is not None:
            return best
    left = first.facts.period * (first.last_record - corner.begin)
    where = f" in the {left:.3g} s that were left of it" if corner.begin == earliest else ""
    if is_near:
        return f"no blend{where} keeps the limits of both and is sooner than a stop"
    bound = f"{tolerance:.4g} rad" + (f" or {corner.moved:.3g} m" if corner.moved else "")
    return f"every blend{where} is further than {bound} from both"


def _best(corner: _Corner, cuts: list[_Cut], *, is_timed_anew: bool) -> tuple[int, Motion] | None:
    """Return the record to leave and the motion of the fastest of some cuts.

    Args:
        corner: of both motions.
        cuts: within the tolerance.
        is_timed_anew: whether the second motion continues as fast as the limits permit.
    """
    period = corner.second.period
    by_rest = period * (corner.first.last_record + HISTORY) + corner.second.duration
    best: tuple[int, Motion] | None = None
    most_saved = 0.0
    for cut in sorted(cuts, key=lambda one: one.expected)[:_TRIES]:
        try:
            motion = _motion(cut, corner, is_timed_anew=is_timed_anew)
        except PlanError:
            continue
        saved = by_rest - period * cut.leave - motion.duration
        if saved > most_saved:
            note = (
                f"blended with the motion before: passes the corner at {cut.gap:.4g} rad, "
                f"{saved:.3f} s sooner than by way of rest"
            )
            best, most_saved = (cut.leave, motion.noted(note)), saved
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
    ends = first.state_at(int(leave[0])).q, second.sample([period * float(joined[-1])]).q[0]
    distances = min(most, corner.reach(*ends)) * _DISTANCES
    joins = np.minimum(distances, corner.ahead)
    back = np.minimum(np.searchsorted(coming, distances), len(leave) - 1)
    ahead = np.minimum(np.searchsorted(going, joins), len(joined) - 1)
    return leave[len(leave) - 1 - back], joined[ahead]


def _cuts(corner: _Corner, leave: Indices, joined: Indices, *, is_timed_anew: bool) -> list[_Cut]:
    """Return the cuts between given records that are within the tolerance.

    Args:
        corner: of both motions.
        leave: records at which to leave the first motion.
        joined: records at which to join the second one.
        is_timed_anew: whether the second motion continues as fast as the limits permit.
    """
    first, second, path = corner.first, corner.second, corner.path
    times = second.period * joined.astype(np.float64)
    legs = np.concatenate([_legs_before(first, leave), _legs_after(path, times)], axis=1)
    ahead = second.rows(0, second.record_count)
    speeds = np.linalg.norm(ahead[:, 4:7], axis=1)
    turned = np.concatenate([[0.0], np.cumsum(angle(ahead[:-1, :4], ahead[1:, :4]))])
    found = []
    for record, join, time, leg in zip(
        leave.tolist(), joined.tolist(), times.tolist(), legs, strict=True
    ):
        start, own = first.state_at(record), float(speeds[join])
        speed = float(np.linalg.norm(start.omega_body))
        if not min(own, speed) > _LEAST * second.limits.velocity:
            continue
        most = _MOST * next(iter(corner.narrow.along((ahead[join, 4:7] / own).tolist())))
        wanted = [min(share * speed, most) for share in _SPEEDS] if is_timed_anew else [own]
        if wanted[0] > most:
            continue
        for pace in sorted(set(wanted)):
            rest = _behind(second, path, time)
            if is_timed_anew:
                rest = _at_speed(rest, pace)
            later = join + int(np.argmax(speeds[join:] >= min(pace, float(speeds[join:].max()))))
            left = second.duration - second.period * later + (turned[later] - turned[join]) / pace
            cut = _cut(corner, record, start, rest, left, leg, is_timed_anew=is_timed_anew)
            if cut is not None:
                found.append(cut)
    return found


def _cut(
    corner: _Corner, record: int, start: State, rest: KeyframePath, left: float, leg: Floats,
    *, is_timed_anew: bool,
) -> _Cut | None:  # fmt: skip
    """Return the cut from a record onto a path, if it is within the tolerance.

    It is within it at the corner and at its farthest distance from both motions.

    Args:
        corner: of both motions.
        record: of the first motion.
        start: its state.
        rest: the path of the second motion.
        left: about how long that takes, s.
        leg: poses of both motions, shape ``(n, 7)``.
        is_timed_anew: as in :func:`_cuts`.
    """
    period = corner.second.period
    share = TAKE_OVER_SHARE if is_timed_anew else LEAD_SHARE
    limits = corner.narrow.lower(corner.second.limits)
    find = partial(
        connected, start, rest.first, limits=limits, own=limits, period=period, share=share
    )
    shares, least, over = np.linspace(0.0, 1.0, _POINTS), 0.0, math.inf
    while over > 1.0:
        lead = find(least=least)
        moves, *rates = _positions(lead, start, rest).sample(shares * lead.duration)
        speed, push = (float(np.max(np.linalg.norm(one, axis=1))) for one in rates)
        over = max(speed / limits.linear_velocity, math.sqrt(push / limits.linear_acceleration))
        over /= _NEARLY
        if least and over > 1.0:
            return None
        # A position may need more time.
        least = over * lead.duration
    q = lead.orientations(shares * lead.duration)
    gaps = angle(q, corner.q)
    nearest = int(np.argmin(gaps[1:-1])) + 1
    # The parabola through the squares of three distances gives the place and the distance between.
    a, b, c = (gaps[nearest - 1 : nearest + 2] ** 2).tolist()
    bend = max(a - 2.0 * b + c, np.finfo(np.float64).tiny)
    shift = min(max(0.5 * (a - c) / bend, -0.5), 0.5)
    gap = math.sqrt(max(b - 0.5 * bend * shift**2, 0.0))
    passed = float(shares[nearest] + shift * shares[1]) * lead.duration
    lines = align(np.concatenate([q[:1], leg[:, :4]]))[1:]
    away = 4.0 * math.asin(min(0.5 * _farthest(q, lines), 1.0))
    if max(gap, away) > _SURE * corner.tolerance:
        return None
    moved = _farthest(moves, leg[:, 4:]) if np.ptp(leg[:, 4:], axis=0).any() else 0.0
    if moved > _SURE * corner.moved + refusal.SAME_POSITION:
        return None
    expected = period * record + lead.duration + left
    return _Cut(record, lead, rest, passed, gap, expected)


def _farthest(points: Floats, lines: Floats) -> float:
    """Return the farthest distance of points, shape ``(k, d)``, from lines, shape ``(m, d)``."""
    begins, steps = lines[None, :-1], np.diff(lines, axis=0)[None]
    squares = np.maximum(np.sum(steps**2, axis=2), np.finfo(np.float64).tiny)
    away = points[:, None] - begins
    shares = np.clip(np.sum(away * steps, axis=2) / squares, 0.0, 1.0)
    gaps = np.linalg.norm(away - shares[..., None] * steps, axis=2)
    return float(np.max(np.min(gaps, axis=1)))


def _behind(second: Motion, path: Path, time: float) -> KeyframePath:
    """Return the path of a motion behind a path time, s, which is then its time 0."""
    whole = KeyframePath(path.trajectory, path.positions, second.keyframe_times)
    return whole.since(time)


def _at_speed(path: KeyframePath, speed: float) -> KeyframePath:
    """Return a path that begins at a constant speed, rad/s, with its own times changed for that."""
    trajectory, length = path.trajectory, path.duration
    _, omega, alpha = trajectory.ends()
    own = float(np.linalg.norm(omega[0]))
    # The squared rate ends the change of the speed, and then stays.
    rate = (speed / own) ** 2
    slope = -2.0 * rate * float(omega[0] @ alpha[0]) / own**2
    reach = min(0.5 * length, _CHANGE * rate / abs(slope) if slope else length)
    last = rate + 0.5 * reach * slope
    at = 0.5 * (_NODES + 1.0)
    squared = rate + reach * slope * (at - 0.5 * at**2)
    took = 0.5 * reach * float(_WEIGHTS @ (1.0 / np.sqrt(squared)))
    clock = TimeMap(
        np.array([0.0, took, took + (length - reach) / math.sqrt(last)]),
        np.array([0.0, reach, length]),
        np.array([rate, last, last]),
        np.array([slope, 0.0, 0.0]),
        np.zeros(2),
    )
    positions = path.positions
    if not positions.is_held:
        positions = positions.retimed(clock, clock.times_of(np.linspace(0.0, length, _KNOTS)))
    times = np.where(path.times > 0.0, clock.times_of(np.maximum(path.times, 0.0)), path.times)
    retimed = replace(clock.retimed(trajectory), continuity=trajectory.continuity)
    return KeyframePath(retimed, positions, times, path.notes)


def _positions(lead: Trajectory, start: State, rest: KeyframePath) -> PositionPath:
    """Return the position during a lead and behind it."""
    there = rest.positions.state(0.0)
    positions = rest.positions.delayed(lead.duration)
    if not (start.is_position_moving or np.any(there[0] != start.position)):
        return positions
    piece = quintic((start.position, start.velocity, start.acceleration), there, lead.duration)
    breaks = np.array([0.0, lead.duration])
    return positions.after(PositionPath(breaks, piece[None], start.position, there[0]))


def _followed(lead: Trajectory, start: State, rest: KeyframePath, passed: float) -> KeyframePath:
    """Return a lead and the path behind it.

    Args:
        lead: the orientations of the lead, from path time 0 on.
        start: where it begins.
        rest: the path behind it.
        passed: path time at which the lead passes the keyframes that are not behind it, s.
    """
    trajectory = Trajectory.joined([lead, rest.trajectory.shifted(lead.duration)])
    times = np.where(rest.times < 0.0, passed, rest.times + lead.duration)
    return KeyframePath(trajectory, _positions(lead, start, rest), times)


def _motion(cut: _Cut, corner: _Corner, *, is_timed_anew: bool) -> Motion:
    """Return the motion along a cut and behind it.

    Raises:
        PlanError: it breaks a limit.
    """
    second, rest, start = corner.second, cut.rest, corner.first.state_at(cut.leave)
    limits, period = second.limits, second.period
    if is_timed_anew:
        quick = quickest(rest, limits.at_period(period), period)
        # A timing does not keep times before its path.
        rest = replace(quick, times=np.where(rest.times < 0.0, rest.times, quick.times))
    whole = _followed(cut.lead, start, rest, cut.passed)
    motion = certified(whole, second.request, start, limits, period, motion_id=second.id)
    return replace(motion, corner=(cut.passed, cut.gap), joined=cut.lead.duration)
