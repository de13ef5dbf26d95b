"""Judge planned motions by the setpoints that a driver would get.

It shares nothing with the certificate: it differentiates backwards in NumPy, from rest on.  Call
:func:`judged` with a case of :mod:`bench.following_requests`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from bench.following_requests import Case

from orientd.errors import PlanError
from orientd.model.limits import Limits
from orientd.model.request import MotionRequest
from orientd.planner.blending import NOT_BLENDED, blend
from orientd.planner.motion import Motion
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import Floats

HELD = 3
"""Setpoints at rest before a motion and behind its last one."""

MOST = 1.0 + 1e-5
"""Largest allowed share of a limit."""

NEARLY = 1.02
"""Largest allowed share of a tolerance: the legs are sampled."""

ALMOST = 1.011
"""How much faster than the rest of the motion before a blend may be before the corner."""

_ROUNDING = 1e-14  # rad and m, of a difference
_NAMES = ("velocity", "acceleration", "jerk", "linear velocity", "linear acceleration")
_POINTS = 200  # of a leg, and of a blend


@dataclass
class Verdict:
    """What came of a case.

    Attributes:
        problems: broken promises, in words.
        refused: the refusal; empty if everything was planned.
        corners: how many corners have a tolerance.
        blended: how many of them were blended.
        joined: how many end velocities were joined.
        largest: the largest share of a limit.
        farthest: the largest share of a tolerance.
    """

    problems: list[str] = field(default_factory=list)
    refused: str = ""
    corners: int = 0
    blended: int = 0
    joined: int = 0
    largest: float = 0.0
    farthest: float = 0.0


@dataclass(frozen=True, eq=False)
class Setpoints:
    """The setpoints of a case.

    Attributes:
        q: orientations, shape ``(n, 4)``.
        p: positions, shape ``(n, 3)``.
        rates: velocity, acceleration, jerk, and the first two of the position, shape ``(n, 5)``.
        owner: of which motion each is.
        begins: the first one of each motion.
        limits: of each motion, shape ``(m, 5)``, with an allowance for rounding.
    """

    q: Floats
    p: Floats
    rates: Floats
    owner: np.ndarray
    begins: list[int]
    limits: Floats

    @classmethod
    def of(cls, case: Case, motions: list[tuple[int, Motion]]) -> Setpoints:
        """Return the setpoints of motions; the first of each pair is where the one before ends."""
        h, rows, owner, begins = case.period, [], [], []
        for place, (_, motion) in enumerate(motions):
            every = _poses(motion)
            every = np.concatenate([every, np.repeat(every[-1:], HELD + 1, axis=0)])
            # At the record where a motion is left, the limits of the next one hold.
            until = motions[place + 1][0] if place + 1 < len(motions) else len(every)
            begins.append(HELD + sum(map(len, rows)))
            rows.append(every[:until])
            owner += [place] * until
        start = np.concatenate([case.start.q, case.start.position])
        whole = np.concatenate([np.repeat(start[None], HELD, axis=0), *rows])
        rounding = _ROUNDING / np.array([h, h**2, h**3, h, h**2])
        limits = [_numbers(case.limits.narrowed(one.request.limits)) for _, one in motions]
        q, p = whole[:, :4], whole[:, 4:]
        return cls(
            q, p, rates(q, p, h), np.array([0] * HELD + owner), begins, np.array(limits) + rounding
        )


def judged(case: Case) -> Verdict:
    """Plan a case as the daemon would, and return what is wrong with it."""
    verdict, motions = Verdict(), []
    for place, request in enumerate(case.requests):
        try:
            motions.append(_planned(case, motions, place))
        except PlanError as error:
            verdict.refused = f"{type(error).__name__}: {error}"
            if all(_alone(case, one) is not None for one in case.requests):
                verdict.problems.append(f"motion {place} is refused, alone it is not: {error}")
            break
        if not place:
            continue
        leave, motion = motions[-1]
        if case.tolerances[place - 1]:
            verdict.corners += 1
            verdict.blended += motion.corner is not None
            is_noted = any(NOT_BLENDED in note for note in motion.certificate.notes)
            if is_noted == (motion.corner is not None):
                verdict.problems.append(f"motion {place} does not say whether it is blended")
        if request.omega_start is not None:
            is_joined = leave < motions[-2][1].record_count
            verdict.joined += is_joined
            if not is_joined:
                verdict.problems.append(f"motion {place} does not join the end velocity")
    if motions:
        setpoints = Setpoints.of(case, motions)
        _judge_limits(case, setpoints, verdict)
        for place, (_, motion) in enumerate(motions):
            _judge_keyframes(case, place, motion, setpoints.q, verdict)
            if motion.corner is not None:
                _judge_blend(case, motions, place, setpoints, verdict)
    return verdict


def _planned(case: Case, motions: list[tuple[int, Motion]], place: int) -> tuple[int, Motion]:
    """Return the record at which a motion leaves the one before, and the motion."""
    request, device = case.requests[place], {"limits": case.limits, "period": case.period}
    if not place:
        return 0, plan(request, start=case.start, **device)
    first = motions[-1][1]
    earliest = int(case.passed[place - 1] * first.record_count)
    tolerance = case.tolerances[place - 1]
    return blend(first.recorded(), request, tolerance=tolerance, earliest=earliest, **device)


def _alone(case: Case, request: MotionRequest) -> Motion | None:
    """Return a motion planned from rest at its first keyframe; ``None`` if it is refused."""
    first = request.keyframes[0]
    start = State.at_rest(first.q, first.position or case.start.position)
    if request.omega_start is not None:
        request = replace(request, approach=True)
    try:
        return plan(request, start=start, limits=case.limits, period=case.period)
    except PlanError:
        return None


def _judge_limits(case: Case, setpoints: Setpoints, verdict: Verdict) -> None:
    shares = setpoints.rates / setpoints.limits[setpoints.owner]
    verdict.largest = float(np.max(shares))
    for column in np.flatnonzero(np.max(shares, axis=0) > MOST):
        at = int(np.argmax(shares[:, column]))
        place = setpoints.owner[at]
        verdict.problems.append(
            f"the {_NAMES[column]} is {shares[at, column]:.5f} of its limit in motion {place}, "
            f"{(at - setpoints.begins[place]) * case.period:.4f} s after its beginning"
        )


def _judge_keyframes(case: Case, place: int, motion: Motion, q: Floats, verdict: Verdict) -> None:
    """Judge whether the setpoints pass the keyframes, but those of corners to be cut."""
    keys = list(case.requests[place].keyframes)
    if motion.corner is not None or case.requests[place].omega_start is None:
        keys = keys[1:]
    if place < len(case.tolerances) and case.tolerances[place]:
        keys = keys[:-1]
    # Between two setpoints the path is no further than this from the straight turn.
    within = case.limits.acceleration * case.period**2 + 1e-9
    for keyframe in keys:
        key = np.array(keyframe.q)
        near = int(np.argmin(np.linalg.norm(turns(q, key), axis=1)))
        distance = _distances(key[None], q[max(near - 1, 0) : near + 2], is_turn=True)[0]
        if distance > within:
            verdict.problems.append(f"motion {place} misses a keyframe by {distance:.3g} rad")


def _judge_blend(
    case: Case,
    motions: list[tuple[int, Motion]],
    place: int,
    setpoints: Setpoints,
    verdict: Verdict,
) -> None:
    """Judge how far a blend is from both motions, and its part before the corner."""
    tolerance, begin = case.tolerances[place - 1], setpoints.begins[place]
    following = setpoints.begins[place + 1 :]
    end = following[0] if following else len(setpoints.q)
    legs = [_alone(case, case.requests[one]) for one in (place - 1, place)]
    poses = [_poses(leg) for leg in legs]
    some = slice(begin, end, max(1, (end - begin) // _POINTS))
    away, moved = (
        np.min(
            [_distances(points, _thinned(line[:, columns]), is_turn=is_turn) for line in poses],
            axis=0,
        ).max()
        for points, columns, is_turn in (
            (setpoints.q[some], slice(0, 4), True),
            (setpoints.p[some], slice(4, 7), False),
        )
    )
    late = int(case.passed[place - 1] * len(poses[0]))
    before, after = poses[0][_last(legs[0]) :], poses[1][: _first(legs[1])]
    reached = max(_reach(leg, tolerance) for leg in (before, poses[0][late:], after))
    share = away / tolerance
    if moved > 1e-6:
        share = max(share, (moved - 1e-6) / max(reached, 1e-12))
    verdict.farthest = max(verdict.farthest, float(share))
    if share > NEARLY:
        verdict.problems.append(
            f"blend {place} is {away:.4f} rad and {moved:.4f} m off, allowed are {tolerance:.4f} "
            f"rad and {reached:.4f} m"
        )
    corner = np.array(case.requests[place].keyframes[0].q)
    gaps = np.linalg.norm(turns(setpoints.q[begin:end], corner), axis=1)
    if gaps.min() > NEARLY * tolerance:
        verdict.problems.append(f"blend {place} is {gaps.min():.4f} rad from its corner")
    # A slow blend is nearly as near for a while.
    passed = int(np.argmax(gaps <= gaps.min() + 0.02 * tolerance))
    rates = setpoints.rates[begin : begin + passed]
    for column, rate in enumerate(np.max(rates, axis=0, initial=0.0)):
        limit = setpoints.limits[place - 1, column]
        if rate > MOST * limit:
            verdict.problems.append(
                f"before corner {place} the {_NAMES[column]} is {rate / limit:.4f} of the limit of "
                "the motion before"
            )
    # A pace, a duration or times make a motion slow, too.
    first = motions[place - 1][1]
    usual = np.linalg.norm(first.rows(0, first.record_count)[:, 4:7], axis=1).max()
    if np.max(rates[:, 0], initial=0.0) > ALMOST * usual:
        verdict.problems.append(f"before corner {place} it is faster than the motion before")


def _last(motion: Motion) -> int:
    """Return the record of the keyframe before the last one."""
    times = motion.keyframe_times
    return int(max(times[times < motion.end_time - 1e-9], default=0.0) / motion.period)


def _first(motion: Motion) -> int:
    """Return the record behind the keyframe after the first one."""
    times = motion.keyframe_times
    return int(min(times[times > 1e-9]) / motion.period) + 2


def _reach(leg: Floats, tolerance: float) -> float:
    """Return how far the position moves on a leg while that turns by the tolerance, m."""
    turn = np.sum(np.linalg.norm(turns(leg[:-1, :4], leg[1:, :4]), axis=1))
    move = np.sum(np.linalg.norm(np.diff(leg[:, 4:], axis=0), axis=1))
    return float(move * min(1.0, tolerance / max(turn, 1e-12)))


# Mathematics


def _poses(motion: Motion) -> Floats:
    return motion.rows(0, motion.record_count)[:, [0, 1, 2, 3, 10, 11, 12]]


def _numbers(limits: Limits) -> list[float]:
    angular = [limits.velocity, limits.acceleration, limits.jerk]
    return [*angular, limits.linear_velocity, limits.linear_acceleration]


def rates(q: Floats, p: Floats, period: float) -> Floats:
    """Return the rates at each setpoint by backward differences, shape ``(n, 5)``."""
    rates = np.zeros((len(q), 5))
    turn, move = turns(q[:-1], q[1:]) / period, np.diff(p, axis=0) / period
    for order in range(3):
        rates[order + 1 :, order] = np.linalg.norm(turn, axis=1)
        turn = np.diff(turn, axis=0) / period
    for order in range(2):
        rates[order + 1 :, 3 + order] = np.linalg.norm(move, axis=1)
        move = np.diff(move, axis=0) / period
    return rates


def turns(a: Floats, b: Floats) -> Floats:
    """Return the rotation vectors from orientations to others, in the body frame."""
    w = np.sum(a * b, axis=-1)
    v = a[..., :1] * b[..., 1:] - b[..., :1] * a[..., 1:] - np.cross(a[..., 1:], b[..., 1:])
    v, w = v * np.where(w < 0.0, -1.0, 1.0)[..., None], np.abs(w)
    size = np.linalg.norm(v, axis=-1)
    scale = np.where(size > 0.0, 2.0 * np.arctan2(size, w) / np.maximum(size, 1e-300), 2.0)
    return v * scale[..., None]


def _thinned(rows: Floats) -> Floats:
    return rows[np.unique(np.linspace(0, len(rows) - 1, _POINTS).astype(int))]


def _distances(points: Floats, line: Floats, *, is_turn: bool) -> Floats:
    """Return the distances of points from a line of straight pieces, rad or m."""
    signs = (1.0,)
    if is_turn:
        flips = np.where(np.sum(line[1:] * line[:-1], axis=1) < 0.0, -1.0, 1.0)
        line, signs = line * np.append(1.0, np.cumprod(flips))[:, None], (1.0, -1.0)
    chords = []
    for sign in signs:
        away, steps = sign * points[:, None] - line[:-1], np.diff(line, axis=0)
        squares = np.maximum(np.sum(steps**2, axis=1), 1e-300)
        shares = np.clip(np.sum(away * steps, axis=2) / squares, 0.0, 1.0)
        chords.append(np.linalg.norm(away - shares[..., None] * steps, axis=2).min(axis=1))
    chord = np.min(chords, axis=0)
    return 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)) if is_turn else chord
