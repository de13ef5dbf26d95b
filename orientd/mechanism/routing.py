"""A path of the tool as the axes of a mechanism follow it, made before anything moves.

The whole path is known, so nothing has to be decided on the way.  A gimbal chooses branch and
winding by least cost over all of it, passes the pole with the least deviation that the axes need,
and stops to slew if it may.  Any other mechanism follows the path exactly, on the branch on which
it begins.  What cannot be done is refused with axis, value and time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from orientd.driver import AxisLimits, Figure, Joints, Quaternion, Vector3
from orientd.errors import LimitError, LimitKind, PlanError, StartError
from orientd.mechanism.arrays import joints_at, matrices, of_arrays, orientations, wrapped
from orientd.mechanism.branches import (
    Bools,
    Choice,
    SlewTime,
    candidates,
    choose,
    continued,
    near,
)
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.joint_path import (
    UNLIMITED,
    AxisPeak,
    JointPath,
    ToolLimits,
    axis_peaks,
    figures_of,
    out_of_range,
    planned,
    refuse_range,
    refuse_rates,
    words_of,
)
from orientd.mechanism.mechanism import Mechanism
from orientd.mechanism.pole import Passage, outer_line, passages, windows
from orientd.mechanism.slews import Slew, slew_times, stop_time, with_stops
from orientd.rotation import Floats, angle, check_unit, conjugate, exp, log, multiply, rotate

_STILL = 1e-9
_SAME = 1e-3
"""How far a path may begin from the angles that are given, rad."""
_GLANCE = 4096
"""Samples of a long path that are looked at first: what is too much is often its lead-in."""
_BY_POLE = np.sin(np.radians(2.0))
"""Sine of the distance from the pole within which a path passes it."""
_LONGEST_STEP = 0.5
"""rad; joints that are farther apart in neighbouring samples are on different branches."""
_ADVICE = "allow a deviation, a slower path or a slew, or choose another path"
_TIME_ADVICE = "allow the motion more time, or keep away from singularities"
_RANGE_ADVICE = "turn less far (a turn by a shorter `--duration`), or unwind it first"


@dataclass(frozen=True, eq=False)
class Route:
    """What the axes of a mechanism make of a path, and where they leave it.

    Attributes:
        path: the joints.
        peaks: of the axes.
        passages: near the pole.
        slews: stops of the path.
        error: largest angle between path asked and path planned outside slews, rad, and when.
    """

    path: JointPath
    peaks: tuple[AxisPeak, ...]
    passages: tuple[Passage, ...] = ()
    slews: tuple[Slew, ...] = ()
    error: tuple[float, float] = (0.0, 0.0)


def route(
    mechanism: Mechanism,
    period: float,
    q: Floats,
    position: Floats,
    *,
    joints: Joints = (),
    before: Sequence[Joints] = (),
    tool: ToolLimits = UNLIMITED,
    free: float = 0.0,
) -> JointPath:
    """Return the path that the axes of a mechanism follow.

    Args:
        mechanism: whose axes.
        period: of the grid, s.
        q: orientations of the tool up to its rest, shape ``(n, 4)``.
        position: of the tool, m, shape ``(n, 3)``.
        joints: axis angles planned or reported where the path begins, rad; empty where they are
            not known.
        before: axis angles planned for the periods before a path that begins in motion, the oldest
            first; empty where it begins at rest.
        tool: what it may do where the axes leave the path or its times.
        free: up to which path time the path may stand while a gimbal turns at its pole, s.

    Raises:
        LimitError: an axis cannot follow, or a gimbal of two axes leaves too much roll.
        PlanError: the path is out of reach, or comes too near to a singularity.
        StartError: the axes cannot be where the path begins.
        ValueError: a quaternion is not of unit norm.
    """
    q, past = check_unit(q), np.reshape(np.array(before), (-1, len(mechanism.axes)))
    if isinstance(mechanism, Gimbal):
        start = np.array(mechanism.solve(_row(q[0]), joints)[0]) if joints else None
        found = plan_axes(mechanism, q, period, start=start, past=past, tool=tool, free=free)
        return _certified(mechanism, found, q)
    return _followed(mechanism, period, q, position, joints, past)


def joints_along(
    mechanism: Mechanism, period: float, q: Floats, position: Floats, near: Joints
) -> Floats:
    """Return axis angles along a path for its pace, rad, shape ``(n, axes)``; limits do not count.

    Args:
        mechanism: whose axes.
        period: of the poses, s.
        q: orientations of the tool, shape ``(n, 4)``.
        position: of the tool, m, shape ``(n, 3)``.
        near: axis angles where the path begins, rad; empty where they are not known.

    Raises:
        PlanError: a pose is out of reach.
    """
    if isinstance(mechanism, Gimbal):
        matrix = matrices(mechanism, check_unit(q))
        joints = joints_at(mechanism, matrix, outer_line(mechanism, matrix)[0])
        joints[:, 1:] = np.unwrap(joints[:, 1:], axis=0)
        return joints
    found: list[Joints] = []
    last = near or begun(mechanism, _row(q[0]), tuple(position[0].tolist()))
    for place, (turned, point) in enumerate(zip(q.tolist(), position.tolist(), strict=True)):
        here = mechanism.nearest(tuple(turned), tuple(point), last)
        if here is None:
            raise PlanError(f"the axes do not reach the pose at {place * period:.4f} s")
        found.append(here)
        last = here
    return np.array(found)


def begun(mechanism: Mechanism, q: Quaternion, position: Vector3) -> Joints:
    """Return axis angles inside their ranges that pose the tool so, the nearest to home, rad.

    Raises:
        StartError: there are none.
    """
    middle = mechanism.home() or (0.0,) * len(mechanism.axes)
    found = []
    for one in mechanism.solutions(q, position):
        turned = np.array(one) - 2 * np.pi * np.round((np.array(one) - middle) / (2 * np.pi))
        is_inside = [
            axis.low <= value <= axis.high
            for axis, value in zip(mechanism.axes, turned.tolist(), strict=True)
        ]
        if all(is_inside):
            found.append(tuple(turned.tolist()))
    if not found:
        raise StartError("the axes do not reach where the path begins")
    return min(found, key=lambda one: max(abs(a - b) for a, b in zip(one, middle, strict=True)))


def _followed(
    mechanism: Mechanism,
    period: float,
    q: Floats,
    position: Floats,
    near: Joints,
    past: Floats,
) -> JointPath:
    """Return the axis angles that make every pose exactly, on the branch on which they begin."""
    axes = mechanism.axes
    joints = joints_along(mechanism, period, q, position, near)
    low, high = np.array([(axis.low, axis.high) for axis in axes]).T
    outside = np.any((joints < low) | (joints > high), axis=1)
    if np.any(outside):
        at = int(np.argmax(outside))
        refuse_range(joints[at].tolist(), axes, at * period, _RANGE_ADVICE)
    steps = np.abs(np.diff(joints, axis=0))
    if len(steps) and np.max(steps) > _LONGEST_STEP:
        row, place = np.unravel_index(int(np.argmax(steps > _LONGEST_STEP)), steps.shape)
        raise PlanError(f"{axes[place].name} would have to jump at {(row + 1) * period:.4f} s")
    _refuse_singular(mechanism, joints, period)
    peaks = list(axis_peaks(joints, period, axes, past))
    refuse_rates(peaks, _TIME_ADVICE)
    times = period * np.arange(len(joints), dtype=np.float64)
    figures = tuple(figures_of(joints, peaks))
    return JointPath(period, joints, q, times, figures, tuple(words_of(joints, peaks)))


def _refuse_singular(mechanism: Mechanism, joints: Floats, period: float) -> None:
    """Raise :class:`.PlanError` where *joints* come too near to a singularity."""
    reserves = [mechanism.reserve(tuple(row)) for row in joints.tolist()]
    for every in zip(*reserves, strict=True):
        at, worst = min(enumerate(every), key=lambda one: one[1].value)
        if worst.value < worst.least:
            raise PlanError(
                f"the {worst.name} comes within {worst.value:.4f} {worst.unit} of its singularity "
                f"at {at * period:.4f} s, at least {worst.least:g} are needed; {worst.advice}"
            )


# Gimbals


def plan_axes(
    gimbal: Gimbal,
    q: Floats,
    period: float,
    *,
    start: Floats | None = None,
    past: Floats | None = None,
    tool: ToolLimits = UNLIMITED,
    free: float = 0.0,
) -> Route:
    """Return axis angles of a gimbal for a path of orientations.

    A gimbal of two axes follows the direction of its pointing axis; the roll is what it is.  Tried
    in this order: leave the path by a bounded angle, stop and reconfigure.  To run the whole path
    slower is left to whoever plans it.

    Args:
        gimbal: whose; it says what may be done where the exact path is too much.
        q: orientations ``(w, x, y, z)``, tool to world, shape ``(n, 4)``.
        period: of the grid, s.
        start: axis angles from which the path begins, rad, shape ``(axes,)``; by default the plan
            chooses.
        past: axis angles of the samples before a path that begins in motion, the oldest first, rad,
            shape ``(m, axes)``.
        tool: what it keeps to on a slew.
        free: as for :func:`route`.

    Raises:
        LimitError: the path needs more than an axis has, and the gimbal allows no way round.
        PlanError: it would have to stop for a change of branch before it can.
        StartError: the path does not begin at *start*.
    """
    past = np.empty((0, len(gimbal.axes))) if past is None else past
    own = planned(gimbal.axes)
    found = _choose(gimbal, q, period, own, start, tool, free)
    _refuse(found[0], gimbal, q, period, past)
    routes = [_routed(gimbal, q, period, own, choice, past, tool) for choice in found]
    best = min(routes, key=lambda one: len(one.path.joints))
    refuse_rates(best.peaks, _ADVICE)
    return best


def _choose(
    gimbal: Gimbal,
    q: Floats,
    period: float,
    own: Sequence[AxisLimits],
    start: Floats | None,
    tool: ToolLimits,
    free: float,
) -> list[Choice]:
    """Return the best way, or some of which the quickest is, where only their stops show it."""
    first = float(start[0]) if start is not None and _is_at_pole(gimbal, q[0]) else None
    may_slew = gimbal.allow_slews or free > 0.0
    is_plain = start is not None and gimbal.max_deviation == 0.0 and not may_slew
    if start is not None and is_plain and len(q) > 2 * _GLANCE:
        begun = continued(_principal(gimbal, q[:_GLANCE], first), own, period, start, _SAME)
        if begun.reached < _GLANCE:
            return [begun]
    principal = _principal(gimbal, q, first)
    ways: list[Passage] = []
    if gimbal.max_deviation > 0.0:
        matrix = matrices(gimbal, q)
        line, _ = outer_line(gimbal, matrix)
        for window in windows(line, period, own[0]):
            ways += passages(gimbal, matrix, window, own, period)
    if start is not None and not ways:
        on_its_way = continued(principal, own, period, start, _SAME)
        if on_its_way.reached == len(q) or not may_slew:
            return [on_its_way]
    every = candidates(principal, near(principal, own, start))
    choice = choose(every, own, period, start=start, entry=_SAME, passages=ways)
    if choice.reached == len(q) or not may_slew:
        return [choice]
    where = np.ones(len(q), dtype=bool)
    if not gimbal.allow_slews:
        where[1:] = _is_by_pole(gimbal, q, free / period)
    quick = SlewTime(stop_time(q, period, tool), lambda gaps: slew_times(gaps, own, tool))
    return [
        choose(
            every, own, period, start=start, entry=_SAME, passages=ways, slews=where,
            slew_time=slew_time,
        )
        for slew_time in (quick, None)
    ]  # fmt: skip


def _principal(gimbal: Gimbal, q: Floats, first: float | None) -> Floats:
    """Return both branches along a path, the outer angle continuous through the pole itself."""
    matrix = matrices(gimbal, q)
    line, _ = outer_line(gimbal, matrix, first)
    branches = [joints_at(gimbal, matrix, wrapped(line + turn)) for turn in (0.0, np.pi)]
    return np.stack(branches, axis=1)


def _refuse(choice: Choice, gimbal: Gimbal, q: Floats, period: float, past: Floats) -> None:
    """Raise what is wrong with *choice*, if anything is."""
    axes, at = gimbal.axes, choice.reached
    if at < len(q):
        time = at * period
        principal = wrapped(np.array(gimbal.solutions(_row(q[at]))))
        every = candidates(principal[None], axes)[0]
        if np.all(np.isnan(every)):
            refuse_angle(principal, axes, time)
        if not at:
            raise StartError(
                "the path does not begin at the axis angles the gimbal is commanded to be at; it "
                f"begins at {np.rad2deg(principal[0]).round(3).tolist()} deg or its other branch"
            )
        gaps = np.abs(every - choice.joints[at - 1])
        share = gaps / (np.array([axis.velocity for axis in axes]) * period)
        best = int(np.nanargmin(np.max(share, axis=-1)))
        worst = int(np.argmax(share[best]))
        if _is_at_pole(gimbal, q[at - 1]):
            away = float(np.nanmin(gaps[:, 0]))
            raise PlanError(
                f"at {time:.6g} s the path leaves the pole in a direction that is "
                f"{np.rad2deg(away):.1f} deg away from where {axes[0].name} is; leave out the "
                f"times or `allow_slews`, so that {axes[0].name} turns at the pole first"
            )
        _refuse_way_on(principal, choice.joints[at - 1], axes, period, time)
        raise LimitError(
            f"velocity of {axes[worst].name}", float(gaps[best, worst] / period),
            axes[worst].velocity, time, "rad/s", _ADVICE, kind=LimitKind.VELOCITY,
        )  # fmt: skip
    if not choice.slews:
        peaks = axis_peaks(choice.joints, period, axes, past)
        refuse_rates([one for one in peaks if one.kind is not LimitKind.VELOCITY], _ADVICE)


def _refuse_way_on(
    principal: Floats, last: Floats, axes: Sequence[AxisLimits], period: float, time: float
) -> None:
    """Raise where the axes could go on from *last* but for the limits of their angles."""
    turn = 2 * np.pi
    onward = principal + turn * np.round((last - principal) / turn)
    nearest = onward[int(np.argmin(np.max(np.abs(onward - last), axis=-1)))]
    if np.all(np.abs(nearest - last) <= period * np.array([axis.velocity for axis in axes])):
        refuse_range(nearest.tolist(), axes, time, "allow a slew, or begin on another turn")


def refuse_angle(principal: Floats, axes: Sequence[AxisLimits], time: float) -> None:
    """Raise for the axis that is farthest outside its limits on the better branch."""
    turn = 2 * np.pi
    worst = []
    for branch in principal:
        outside = []
        for value, axis in zip(branch, axes, strict=True):
            middle = (axis.low + axis.high) / 2
            nearest = value - turn * np.round((value - middle) / turn)
            outside.append(max(axis.low - nearest, nearest - axis.high, 0.0))
        place = int(np.argmax(outside))
        worst.append((outside[place], place, float(branch[place])))
    _, place, value = min(worst)
    raise out_of_range(axes[place], value, time, "no branch is inside the limits")


def _is_by_pole(gimbal: Gimbal, q: Floats, count: float) -> Bools:
    """Return which of the first *count* steps begin or end so near the pole that it is passed."""
    _, sine = of_arrays(gimbal).pointing(matrices(gimbal, q))
    is_near = sine < _BY_POLE
    found: Bools = (is_near[:-1] | is_near[1:]) & (np.arange(len(q) - 1) < count)
    return found


def _is_at_pole(gimbal: Gimbal, q: Floats) -> bool:
    return gimbal.is_at_pole(_row(q))


def _routed(
    gimbal: Gimbal,
    q: Floats,
    period: float,
    own: Sequence[AxisLimits],
    choice: Choice,
    past: Floats,
    tool: ToolLimits,
) -> Route:
    """Return the route of *choice*, with the limits that its own stops and slews keep."""
    line = with_stops(
        gimbal, choice.joints, period, choice.slews, own, tool=tool,
        ramp=stop_time(q, period, tool),
        is_moving=len(past) > 0 and bool(np.ptp(past, axis=0).max() > _STILL),
    )  # fmt: skip
    reached = orientations(gimbal, line.joints)
    made = orientations(gimbal, choice.joints) if line.slews else reached
    missed = _missed(gimbal, made, q)
    at = int(np.argmax(missed))
    error = float(missed[at]), _when(line.path_times, at * period, period)
    path = JointPath(period, line.joints, reached, line.path_times)
    peaks = tuple(axis_peaks(line.joints, period, gimbal.axes, past))
    return Route(path, peaks, choice.passages, _honest(gimbal, q, path, line.slews), error)


def _honest(gimbal: Gimbal, q: Floats, path: JointPath, slews: Sequence[Slew]) -> tuple[Slew, ...]:
    """Return the slews with how far each is off the path, which stands still or goes on slowly."""
    told = []
    for slew in slews:
        part = slice(round(slew.start / path.period), round(slew.end / path.period) + 1)
        at = path.path_times[part] / path.period
        first = np.minimum(at.astype(np.int64), len(q) - 2)
        turn = log(multiply(conjugate(q[first]), q[first + 1]))
        asked = multiply(q[first], exp((at - first)[:, None] * turn))
        error = float(np.max(_missed(gimbal, path.q[part], asked)))
        told.append(replace(slew, error=error))
    return tuple(told)


def _missed(gimbal: Gimbal, reached: Floats, q: Floats) -> Floats:
    """Return the angle between orientations; of two axes, between the directions pointed to."""
    if len(gimbal.axes) == 3:
        return angle(reached, q)
    back = conjugate(np.array(gimbal.kinematics.tool))
    pointed = rotate(back, np.eye(3)[gimbal.kinematics.inner_axis])
    made, asked = rotate(reached, pointed), rotate(q, pointed)
    cross = np.linalg.norm(np.cross(made, asked), axis=1)
    return np.asarray(np.arctan2(cross, np.sum(made * asked, axis=1)), dtype=np.float64)


def _when(path_times: Floats, path_time: float, period: float) -> float:
    return period * int(np.searchsorted(path_times, path_time - 1e-9))


def _certified(gimbal: Gimbal, route: Route, asked: Floats) -> JointPath:
    """Return the joints of *route* with figures and notes.

    Raises:
        LimitError: two axes miss the orientations *asked*, shape ``(n, 4)``, by too much.
    """
    path, (missed, when) = route.path, route.error
    figures = figures_of(path.joints, route.peaks)
    figures.append(Figure("pointing error", missed, "rad", gimbal.max_deviation, when))
    if route.slews:
        worst = max(route.slews, key=lambda slew: slew.error)
        figures += [
            Figure("pointing error in slews", worst.error, "rad", None, worst.start),
            Figure("time in slews", sum(slew.duration for slew in route.slews), "s"),
        ]
    figures.append(manipulability(gimbal, path.joints))
    if gimbal.is_fitting:
        figures.append(_roll(gimbal, path, asked))
    notes = [*words_of(path.joints, route.peaks), *_deviations(route)]
    return JointPath(
        path.period, path.joints, path.q, path.path_times, tuple(figures), tuple(notes)
    )


def manipulability(gimbal: Gimbal, joints: Floats) -> Figure:
    """Return how near *joints* (rad, shape ``(n, axes)``) come to the pole, which is at 0."""
    least = float(np.min(of_arrays(gimbal).manipulability(joints.T)))
    return Figure("manipulability", least, "1")


def _deviations(route: Route) -> list[str]:
    """Return where and by how much a route leaves the path, in words, a line each."""
    missed, when = route.error
    outside = " outside slews" if route.slews else ""
    lines = [f"the path is missed by at most {degrees(missed):.4f} deg{outside} at {when:.3f} s"]
    period, times = route.path.period, route.path.path_times
    for one in route.passages:
        start, end = (_when(times, place * period, period) for place in (one.first, one.last))
        lines.append(
            f"{start:.3f} to {end:.3f} s: {one.kind} near the pole, missing by at most "
            f"{degrees(one.error):.3f} deg"
        )
    for slew in route.slews:
        goal = ", ".join(f"{degrees(angle):.1f}" for angle in slew.after)
        what = "goes on slowly" if slew.is_on_path else "stops and the axes slew"
        lines.append(
            f"{slew.start:.3f} to {slew.end:.3f} s ({slew.duration:.2f} s): the path {what} to "
            f"{goal} deg, off it by up to {degrees(slew.error):.1f} deg"
        )
    return lines


def _roll(gimbal: Gimbal, path: JointPath, asked: Floats) -> Figure:
    """Return by how much two axes miss orientations, which have three degrees of freedom.

    Raises:
        LimitError: by more than they may.
    """
    missed = angle(path.q, asked[np.rint(path.path_times / path.period).astype(np.int64)])
    at, most = int(np.argmax(missed)), gimbal.roll_tolerance
    value, time = float(missed[at]), at * path.period
    if value > most:
        raise LimitError(
            "orientation error of the two axes", value, most, time, "rad",
            f"at most {degrees(most):.2f} deg are allowed; `pointing = true` follows the "
            "direction alone", kind=LimitKind.DEVIATION,
        )  # fmt: skip
    return Figure("orientation error", value, "rad", most, time)


def _row(q: Floats) -> Quaternion:
    w, x, y, z = q.tolist()
    return w, x, y, z
