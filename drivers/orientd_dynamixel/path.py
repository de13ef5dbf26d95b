"""Map an orientation path to axis angles before it moves: branch, turns, keyholes, stops, limits.

The whole path is known, so nothing has to be decided on the way: branch and winding are chosen by
least cost over all of it, a passage near the pole deviates by the least angle that the axes need,
and what cannot be done is refused with axis, value and time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from orientd.errors import LimitError, LimitKind, PlanError, StartError
from orientd.rotation import Floats, angle, check_unit, conjugate, exp, log, multiply, rotate
from orientd_dynamixel.branches import Bools, Choice, SlewTime, candidates, choose, continued, near
from orientd_dynamixel.certificate import (
    AxisCertificate,
    AxisLimits,
    AxisPath,
    AxisPeak,
    DeviationPolicy,
    Keyhole,
    Slew,
    ToolLimits,
    measured,
    peak,
    rates,
)
from orientd_dynamixel.keyhole import Passage, outer_line, passages, windows
from orientd_dynamixel.kinematics import LOCK, Gimbal, wrapped
from orientd_dynamixel.stops import TILT, Timeline, slew_times, stop_time, with_stops
from orientd_dynamixel.tracker import AxisTracker

_SLACK = 1 + 1e-3
_STILL = 1e-9
_SAME = 1e-3
"""How far a path may begin from the angles that are given, rad."""
_RESERVE = 0.97
"""Share of the fastest slew that keeps the tool's limits; the rest is for stops on it."""
PLANNED = 0.95
"""Share of an axis' acceleration that a plan of its own uses; the rest is to brake on it with."""
_GLANCE = 4096
"""Samples of a long path that are looked at first: what is too much is often its lead-in."""
_ADVICE = "allow a deviation, a slower path or a slew, or choose another path"


def plan_axes(
    gimbal: Gimbal,
    q: ArrayLike,
    period: float,
    limits: Sequence[AxisLimits],
    *,
    start: ArrayLike | None = None,
    before: ArrayLike | None = None,
    policy: DeviationPolicy | None = None,
    tool: ToolLimits | None = None,
) -> AxisPath:
    """Return axis angles for a path of orientations.

    A gimbal of two axes follows the direction of its pointing axis; the roll is what it is.

    Args:
        gimbal: which axes there are.
        q: orientations ``(w, x, y, z)``, tool to world, on a uniform grid, shape ``(n, 4)``.
        period: of the grid, s.
        limits: of every axis.
        start: axis angles from which the path begins, rad, shape ``(axes,)``; by default the plan
            chooses.
        before: axis angles of the samples before a path that begins in motion, the oldest first,
            rad, shape ``(m, axes)``; none where it begins at rest.
        policy: what may be done where the exact path is too much; by default nothing.
        tool: what it keeps to on a slew; by default nothing.

    Raises:
        LimitError: the path needs more than an axis has, and the policy allows no way round.
        PlanError: it would have to stop for a change of branch before it can.
        StartError: the path does not begin at *start*.
        ValueError: a quaternion is not of unit norm, or the number of limits is not that of axes.
    """
    q = check_unit(q)
    policy = policy or DeviationPolicy()
    if len(limits) != len(gimbal.axes):
        raise ValueError(f"limits must be {len(gimbal.axes)}, got {len(limits)}")
    origin = None if start is None else np.asarray(start, dtype=np.float64)
    past = np.empty((0, len(limits))) if before is None else np.reshape(before, (-1, len(limits)))
    tool = tool or ToolLimits()
    own = [replace(limit, acceleration=PLANNED * limit.acceleration) for limit in limits]
    found = _choose(gimbal, q, period, own, origin, policy, tool)
    _refuse(found[0], gimbal, q, period, limits, past)
    paths = [_path(gimbal, q, period, (limits, own), choice, past, tool) for choice in found]
    path = min(paths, key=lambda one: len(one.times))
    _verify(path.certificate, limits)
    return path


def _choose(
    gimbal: Gimbal,
    q: Floats,
    period: float,
    limits: Sequence[AxisLimits],
    start: Floats | None,
    policy: DeviationPolicy,
    tool: ToolLimits,
) -> list[Choice]:
    """Return the best way, or some of which the quickest is, where only their stops show it."""
    first = float(start[0]) if start is not None and _is_at_pole(gimbal, q[0]) else None
    may_slew = policy.allow_slews or policy.free > 0.0
    is_plain = start is not None and policy.max_deviation == 0.0 and not may_slew
    if start is not None and is_plain and len(q) > 2 * _GLANCE:
        begun = continued(_principal(gimbal, q[:_GLANCE], first), limits, period, start, _SAME)
        if begun.reached < _GLANCE:
            return [begun]
    principal = _principal(gimbal, q, first)
    ways: list[Passage] = []
    if policy.max_deviation > 0.0:
        matrix = gimbal.matrix(q)
        line, _ = outer_line(gimbal, matrix)
        for window in windows(line, period, limits[0]):
            ways += passages(gimbal, matrix, window, limits, period, policy.max_deviation)
    if start is not None and not ways:
        on_its_way = continued(principal, limits, period, start, _SAME)
        if on_its_way.reached == len(q) or not may_slew:
            return [on_its_way]
    every = candidates(principal, near(principal, limits, start))
    choice = choose(every, limits, period, start=start, entry=_SAME, passages=ways)
    if choice.reached == len(q) or not may_slew:
        return [choice]
    where = np.ones(len(q), dtype=bool)
    if not policy.allow_slews:
        where[1:] = _is_by_pole(gimbal, q, policy.free / period)
    ramp = stop_time(q, period, tool)
    quick = SlewTime(ramp, lambda gaps: slew_times(gaps, limits, tool))
    return [
        choose(
            every, limits, period, start=start, entry=_SAME, passages=ways, slews=where,
            slew_time=slew_time,
        )
        for slew_time in (quick, None)
    ]  # fmt: skip


def _principal(gimbal: Gimbal, q: Floats, first: float | None) -> Floats:
    """Return both branches along a path, the outer angle continuous through the pole itself."""
    matrix = gimbal.matrix(q)
    line, _ = outer_line(gimbal, matrix, first)
    branches = []
    for turn in (0.0, np.pi):
        inner = gimbal.rest(matrix, line + turn).inner
        branches.append(np.concatenate([wrapped(line + turn)[:, None], inner], axis=-1))
    return np.stack(branches, axis=1)


def _refuse(
    choice: Choice,
    gimbal: Gimbal,
    q: Floats,
    period: float,
    limits: Sequence[AxisLimits],
    past: Floats,
) -> None:
    """Raise what is wrong with *choice*, if anything is."""
    if choice.reached == 0:
        principal = gimbal.inverse(q[:1])[0]
        if np.all(np.isnan(candidates(principal[None], limits))):
            refuse_angle(principal, limits, 0.0)
        raise StartError(
            "the path does not begin at the axis angles the gimbal is commanded to be at; it "
            f"begins at {np.rad2deg(principal[0]).round(3).tolist()} deg or its other branch"
        )
    if choice.reached < len(q):
        at, time = choice.reached, choice.reached * period
        principal = gimbal.inverse(q[at : at + 1])[0]
        every = candidates(principal[None], limits)[0]
        if np.all(np.isnan(every)):
            refuse_angle(principal, limits, time)
        gaps = np.abs(every - choice.angles[at - 1])
        share = gaps / (np.array([limit.velocity for limit in limits]) * period)
        best = int(np.nanargmin(np.max(share, axis=-1)))
        axis = int(np.argmax(share[best]))
        if _is_at_pole(gimbal, q[at - 1]):
            away = float(np.nanmin(gaps[:, 0]))
            raise PlanError(
                f"at {time:.6g} s the path leaves the pole in a direction that is "
                f"{np.rad2deg(away):.1f} deg away from where {limits[0].name} is; leave out the "
                f"times or `allow_slews`, so that {limits[0].name} turns at the pole first"
            )
        _refuse_way_on(principal, choice.angles[at - 1], limits, period, time)
        rate = float(gaps[best, axis] / period)
        raise LimitError(
            f"velocity of {limits[axis].name}", rate, limits[axis].velocity, time, "rad/s", _ADVICE,
            kind=LimitKind.VELOCITY,
        )  # fmt: skip
    _, acceleration = rates(choice.angles, period, past)
    if choice.slews:
        return
    for a, limit in enumerate(limits):
        worst = peak(
            acceleration[:, a], period * np.arange(len(q), dtype=np.float64), limit.acceleration
        )
        if worst.value > limit.acceleration * _SLACK:
            raise LimitError(
                f"acceleration of {limit.name}", worst.value, worst.limit, worst.time, "rad/s^2",
                _ADVICE, kind=LimitKind.ACCELERATION,
            )  # fmt: skip


def _refuse_way_on(
    principal: Floats, last: Floats, limits: Sequence[AxisLimits], period: float, time: float
) -> None:
    """Raise where the axes could go on from *last* but for the limits of their angles."""
    turn = 2 * np.pi
    onward = principal + turn * np.round((last - principal) / turn)
    nearest = onward[int(np.argmin(np.max(np.abs(onward - last), axis=-1)))]
    if np.any(np.abs(nearest - last) > period * np.array([limit.velocity for limit in limits])):
        return
    for value, limit in zip(nearest.tolist(), limits, strict=True):
        if not limit.low - 1e-9 <= value <= limit.high + 1e-9:
            raise LimitError(
                f"angle of {limit.name}", value, limit.high if value > limit.high else limit.low,
                time, "rad", "allow a slew, or begin on another turn",
                kind=LimitKind.RANGE,
            )  # fmt: skip


def _is_by_pole(gimbal: Gimbal, q: Floats, count: float) -> Bools:
    """Return which of the first *count* steps begin or end so near the pole that it is passed."""
    _, sine = gimbal.pointing(gimbal.matrix(q))
    is_near = sine < np.sin(TILT)
    found: Bools = (is_near[:-1] | is_near[1:]) & (np.arange(len(q) - 1) < count)
    return found


def _is_at_pole(gimbal: Gimbal, q: Floats) -> bool:
    _, sine = gimbal.pointing(gimbal.matrix(q))
    return bool(sine < LOCK)


def refuse_angle(principal: Floats, limits: Sequence[AxisLimits], time: float) -> None:
    """Raise for the axis that is farthest outside its limits on the better branch."""
    turn = 2 * np.pi
    worst = []
    for branch in principal:
        outside = []
        for value, limit in zip(branch, limits, strict=True):
            middle = (limit.low + limit.high) / 2
            nearest = value - turn * np.round((value - middle) / turn)
            outside.append(max(limit.low - nearest, nearest - limit.high, 0.0))
        axis = int(np.argmax(outside))
        worst.append((outside[axis], axis, float(branch[axis])))
    _, axis, value = min(worst)
    limit = limits[axis]
    bound = limit.high if abs(value - limit.high) < abs(value - limit.low) else limit.low
    raise LimitError(
        f"angle of {limit.name}", value, bound, time, "rad", "no branch is inside the limits",
        kind=LimitKind.RANGE,
    )  # fmt: skip


def _path(
    gimbal: Gimbal,
    q: Floats,
    period: float,
    bounds: tuple[Sequence[AxisLimits], Sequence[AxisLimits]],
    choice: Choice,
    past: Floats,
    tool: ToolLimits,
) -> AxisPath:
    """Return the path of *choice*, with what the axes may do and what slews are to use of it."""
    limits, own = bounds
    line = with_stops(
        choice.angles, period, choice.slews, own, is_moving=_is_moving(past),
        ramp=stop_time(q, period, tool),
        excess=lambda angles: tool.excess(gimbal.forward(angles), period) / _RESERVE,
        is_at_pole=lambda angles: _is_at_pole(gimbal, gimbal.forward(angles)),
    )  # fmt: skip
    reached = gimbal.forward(line.angles)
    certificate = AxisCertificate(
        velocity=(), acceleration=(), travel=(),
        error=_error(gimbal, q, period, choice, line, reached),
        manipulability=float(np.min(gimbal.manipulability(line.angles))),
        keyholes=tuple(
            Keyhole(
                _when(line, way.first * period), _when(line, way.last * period), way.kind, way.error
            )
            for way in choice.passages
        ),
        slews=_honest(gimbal, q, period, reached, line),
    )  # fmt: skip
    certificate = measured(certificate, line.angles, period, limits, past)
    return AxisPath(line.times, line.angles, reached, line.path_times, certificate)


def as_driven(
    gimbal: Gimbal,
    path: AxisPath,
    start: ArrayLike,
    period: float,
    limits: Sequence[AxisLimits],
    past: Floats,
) -> AxisPath:
    """Return *path* with the angles that the driver makes of its orientations.

    Within reach of rounding at the pole they say of three axes the sum of two angles only: there
    the driver leaves the innermost one as it is.

    Args:
        gimbal: whose.
        path: as planned.
        start: axis angles commanded before it, rad.
        period: s.
        limits: of every axis.
        past: the samples before the first, as for :func:`.rates`.

    Raises:
        LimitError: an axis cannot follow that.
    """
    _, sine = gimbal.pointing(gimbal.matrix(path.q))
    if len(limits) < 3 or np.min(sine) > 2.0 * LOCK:
        return path
    tracker = AxisTracker(gimbal.order, gimbal.mount, gimbal.tool)
    tracker.angles = tuple(np.asarray(start, dtype=np.float64).tolist())
    made = []
    for w, x, y, z in path.q.tolist():
        tracker.angles, _ = tracker.solve((w, x, y, z))
        made.append(tracker.angles)
    angles = np.array(made)
    certificate = measured(path.certificate, angles, period, limits, past)
    _verify(certificate, limits)
    return replace(path, angles=angles, certificate=certificate)


def _is_moving(past: Floats) -> bool:
    return len(past) > 0 and bool(np.ptp(past, axis=0).max() > _STILL)


def _verify(certificate: AxisCertificate, limits: Sequence[AxisLimits]) -> None:
    """Raise if the path as it came out breaks a limit after all."""
    for limit, velocity, acceleration in zip(
        limits, certificate.velocity, certificate.acceleration, strict=True
    ):
        for name, worst, unit in (
            ("velocity", velocity, "rad/s"),
            ("acceleration", acceleration, "rad/s^2"),
        ):
            if worst.value > worst.limit * _SLACK:
                raise LimitError(
                    f"{name} of {limit.name}", worst.value, worst.limit, worst.time, unit, _ADVICE,
                    kind=LimitKind(name),
                )  # fmt: skip


def _honest(
    gimbal: Gimbal, q: Floats, period: float, reached: Floats, line: Timeline
) -> tuple[Slew, ...]:
    """Return the slews with how far each is off the path, which stands still or goes on slowly."""
    told = []
    for slew in line.slews:
        part = slice(round(slew.start / period), round(slew.end / period) + 1)
        at = line.path_times[part] / period
        first = np.minimum(at.astype(np.int64), len(q) - 2)
        turn = log(multiply(conjugate(q[first]), q[first + 1]))
        asked = multiply(q[first], exp((at - first)[:, None] * turn))
        told.append(replace(slew, error=float(np.max(_missed(gimbal, reached[part], asked)))))
    return tuple(told)


def _missed(gimbal: Gimbal, reached: Floats, q: Floats) -> Floats:
    """Return the angle between orientations; of two axes, between the directions pointed to."""
    if len(gimbal.axes) == 3:
        return angle(reached, q)
    pointed = rotate(conjugate(gimbal.tool), np.eye(3)[gimbal.inner_axis])
    made, asked = rotate(reached, pointed), rotate(q, pointed)
    cross = np.linalg.norm(np.cross(made, asked), axis=1)
    return np.asarray(np.arctan2(cross, np.sum(made * asked, axis=1)), dtype=np.float64)


def _when(line: Timeline, path_time: float) -> float:
    return float(line.times[int(np.searchsorted(line.path_times, path_time - 1e-9))])


def _error(
    gimbal: Gimbal, q: Floats, period: float, choice: Choice, line: Timeline, reached: Floats
) -> AxisPeak:
    """Return the largest angle missed, measured on the orientations that the axes make."""
    made = gimbal.forward(choice.angles) if line.slews else reached
    missed = _missed(gimbal, made, q)
    limit = max((way.error for way in choice.passages), default=0.0)
    at = int(np.argmax(missed))
    return AxisPeak(float(missed[at]), _when(line, at * period), limit)
