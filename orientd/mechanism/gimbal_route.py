"""Axis angles of a gimbal for a path of orientations: branches, turns, pole and stops.

The whole path is known in advance.  Branches and turns therefore have the least cost over all of
it, and a passage near the pole has the least deviation that the axes need.  A path that the gimbal
cannot follow is refused with axis, value and time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import degrees

import numpy as np

from orientd.driver import AxisLimits, Quaternion
from orientd.errors import LimitError, LimitKind, PlanError, StartError
from orientd.mechanism.arrays import (
    joints_at,
    matrices,
    of_arrays,
    orientations,
    outer_line,
    wrapped,
)
from orientd.mechanism.branches import Bools, Choice, candidates, choose, continued
from orientd.mechanism.figure import Figure
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.joint_path import (
    Bounds,
    JointPath,
    ToolLimits,
    axis_peaks,
    losses_of,
    out_of_range,
    planned,
    refuse_range,
    refuse_rates,
)
from orientd.mechanism.pole import Passage, passages, windows
from orientd.mechanism.slews import Slew, stop_time, with_stops
from orientd.rotation import Floats, angle, conjugate, exp, log, multiply, rotate

_STILL = 1e-9
_GLANCE = 4096
"""Samples at the start of a long path that are checked first: often the lead-in is too fast."""
_BY_POLE = np.sin(np.radians(2.0))
"""Sine of the distance from the pole within which a path passes it."""
_ADVICE = "allow a deviation, a slower path or a slew, or choose another path"


@dataclass(frozen=True, eq=False)
class Route:
    """The axis angles of a gimbal for a path, and where they leave it.

    Attributes:
        path: the joints.
        passages: passages near the pole.
        slews: stops of the path.
        error: largest angle between requested and planned path outside slews, rad, and its time.
    """

    path: JointPath
    passages: tuple[Passage, ...] = ()
    slews: tuple[Slew, ...] = ()
    error: tuple[float, float] = (0.0, 0.0)


def plan_axes(
    gimbal: Gimbal,
    q: Floats,
    period: float,
    *,
    start: Floats | None = None,
    past: Floats | None = None,
    tool: ToolLimits | None = None,
    free: float = 0.0,
) -> Route:
    """Return axis angles of a gimbal for a path of orientations.

    A gimbal of two axes follows the direction of its pointing axis with any roll.  If the axes
    cannot follow exactly, the plan first leaves the path by a bounded angle, then stops and changes
    branch. Running the whole path slower is left to the caller.

    Args:
        gimbal: the gimbal, with the deviations that it allows.
        q: orientations ``(w, x, y, z)``, tool to world, shape ``(n, 4)``.
        period: of the grid, s.
        start: axis angles before the path, rad, shape ``(axes,)``; by default the plan chooses.
        past: axis angles of the samples before a path that begins in motion, oldest first, rad,
            shape ``(m, axes)``.
        tool: limits of the tool during a slew; none by default.
        free: as for :func:`route`.

    Raises:
        LimitError: the path needs more than an axis can do, and the gimbal allows no alternative.
        PlanError: the path would have to stop for a change of branch before it can.
        StartError: the path does not begin at *start*.
    """
    past = np.empty((0, len(gimbal.axes))) if past is None else past
    bounds = Bounds(period, planned(gimbal.axes, period), tool or ToolLimits())
    ramp = stop_time(q, bounds)
    choice = _choose(gimbal, q, bounds, start, free, ramp)
    _refuse(choice, gimbal, q, period, past)
    is_moving = len(past) > 0 and bool(np.ptp(past, axis=0).max() > _STILL)
    line = with_stops(gimbal, choice.joints, choice.slews, bounds, ramp=ramp, is_moving=is_moving)
    refuse_rates(axis_peaks(line.joints, period, gimbal.axes, past), _ADVICE)
    reached = orientations(gimbal, line.joints)
    made = orientations(gimbal, choice.joints) if line.slews else reached
    missed = pointing_error(gimbal, made, q)
    at = int(np.argmax(missed))
    error = float(missed[at]), _when(line.path_times, at * period, period)
    off = error_along(gimbal, q, reached, line.path_times / period)
    losses = losses_of(off, period, gimbal.on_target)
    path = JointPath(period, line.joints, reached, line.path_times, losses=losses)
    slews = tuple(
        replace(slew, error=float(np.max(off[_samples(slew, period)]))) for slew in line.slews
    )
    return Route(path, choice.passages, slews, error)


def _choose(
    gimbal: Gimbal, q: Floats, bounds: Bounds, start: Floats | None, free: float, ramp: float
) -> Choice:
    """Return the best axis angles, with stops where they are allowed and needed."""
    first = float(start[0]) if start is not None and _is_at_pole(gimbal, q[0]) else None
    may_slew = gimbal.allow_slews or free > 0.0
    is_plain = start is not None and gimbal.max_deviation == 0.0 and not may_slew
    if start is not None and is_plain and len(q) > 2 * _GLANCE:
        begun = continued(_principal(gimbal, q[:_GLANCE], first), bounds, start)
        if begun.reached < _GLANCE:
            return begun
    principal = _principal(gimbal, q, first)
    ways: list[Passage] = []
    if gimbal.max_deviation > 0.0:
        matrix = matrices(gimbal, q)
        line, _ = outer_line(gimbal, matrix)
        for window in windows(line, bounds):
            ways += passages(gimbal, matrix, window, bounds)
    if start is not None and not ways:
        on_its_way = continued(principal, bounds, start)
        if on_its_way.reached == len(q) or not may_slew:
            return on_its_way
    every = candidates(principal, bounds.axes, start)
    choice = choose(every, bounds, start=start, passages=ways)
    if choice.reached == len(q) or not may_slew:
        return choice
    where = np.ones(len(q), dtype=bool)
    if not gimbal.allow_slews:
        where[1:] = _is_by_pole(gimbal, q, free / bounds.period)
    return choose(every, bounds, start=start, passages=ways, slews=where, stop=ramp)


def _principal(gimbal: Gimbal, q: Floats, first: float | None) -> Floats:
    """Return both branches along a path, with a continuous outer angle through the pole itself."""
    matrix = matrices(gimbal, q)
    line, _ = outer_line(gimbal, matrix, first)
    branches = [joints_at(gimbal, matrix, wrapped(line + turn)) for turn in (0.0, np.pi)]
    return np.stack(branches, axis=1)


def _refuse(choice: Choice, gimbal: Gimbal, q: Floats, period: float, past: Floats) -> None:
    """Raise an error if *choice* does not cover the whole path."""
    axes, at = gimbal.axes, choice.reached
    if at < len(q):
        time = at * period
        principal = wrapped(np.array(gimbal.solutions(row_of(q[at]))))
        every = candidates(principal[None], axes)[0]
        if np.all(np.isnan(every)):
            refuse_angle(principal, axes, time)
        if not at:
            raise StartError(
                "the path does not begin at the axis angles the gimbal is commanded to be at; it "
                f"begins at {np.rad2deg(principal[0]).round(3).tolist()} deg or its other branch"
            )
        gaps = np.abs(every - choice.joints[at - 1])
        step = Bounds(period, axes).longest_step
        share = gaps / step
        best = int(np.nanargmin(np.max(share, axis=-1)))
        worst = int(np.argmax(share[best]))
        if _is_at_pole(gimbal, q[at - 1]):
            away = float(np.nanmin(gaps[:, 0]))
            raise PlanError(
                f"at {time:.6g} s the path leaves the pole in a direction that is "
                f"{np.rad2deg(away):.1f} deg away from where {axes[0].name} is; leave out the "
                f"times or `allow_slews`, so that {axes[0].name} turns at the pole first"
            )
        # The axes could continue if their angles had no limits.
        last, turn = choice.joints[at - 1], 2 * np.pi
        onward = principal + turn * np.round((last - principal) / turn)
        nearest = onward[int(np.argmin(np.max(np.abs(onward - last), axis=-1)))]
        if np.all(np.abs(nearest - last) <= step):
            refuse_range(nearest.tolist(), axes, time, "allow a slew, or begin on another turn")
        raise LimitError(
            f"velocity of {axes[worst].name}", float(gaps[best, worst] / period),
            axes[worst].velocity, time, "rad/s", _ADVICE, kind=LimitKind.VELOCITY,
        )  # fmt: skip
    if not choice.slews:
        peaks = axis_peaks(choice.joints, period, axes, past)
        refuse_rates([one for one in peaks if one.kind is not LimitKind.VELOCITY], _ADVICE)


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
    raise out_of_range(axes[place], value, time, "no branch is within the limits")


def _is_by_pole(gimbal: Gimbal, q: Floats, count: float) -> Bools:
    """Return which of the first *count* steps begin or end near enough to the pole to pass it."""
    _, sine = of_arrays(gimbal).pointing(matrices(gimbal, q))
    is_near = sine < _BY_POLE
    found: Bools = (is_near[:-1] | is_near[1:]) & (np.arange(len(q) - 1) < count)
    return found


def _is_at_pole(gimbal: Gimbal, q: Floats) -> bool:
    return gimbal.is_at_pole(row_of(q))


def error_along(gimbal: Gimbal, q: Floats, reached: Floats, at: Floats | None = None) -> Floats:
    """Return the angle between a path and the orientations of the axes, rad, shape ``(m,)``.

    Args:
        gimbal: the gimbal.
        q: the path, shape ``(n, 4)``.
        reached: orientations of the axes, shape ``(m, 4)``.
        at: their places in *q*, in samples, shape ``(m,)``; by default one on each.
    """
    if at is None:
        return pointing_error(gimbal, reached, q)
    first = np.clip(at.astype(np.int64), 0, max(0, len(q) - 2))
    turn = log(multiply(conjugate(q[first]), q[np.minimum(first + 1, len(q) - 1)]))
    asked = multiply(q[first], exp((at - first)[:, None] * turn))
    return pointing_error(gimbal, reached, asked)


def _samples(slew: Slew, period: float) -> slice:
    return slice(round(slew.start / period), round(slew.end / period) + 1)


def pointing_error(gimbal: Gimbal, reached: Floats, q: Floats) -> Floats:
    """Return the angle between orientations; for two axes, between the pointing directions, rad.

    Args:
        gimbal: the gimbal.
        reached: orientations of its axes, shape ``(n, 4)``.
        q: requested orientations, shape ``(n, 4)``.
    """
    if len(gimbal.axes) == 3:
        return angle(reached, q)
    back = conjugate(np.array(gimbal.kinematics.tool))
    pointed = rotate(back, np.eye(3)[gimbal.kinematics.inner_axis])
    made, asked = rotate(reached, pointed), rotate(q, pointed)
    cross = np.linalg.norm(np.cross(made, asked), axis=1)
    return np.asarray(np.arctan2(cross, np.sum(made * asked, axis=1)), dtype=np.float64)


def _when(path_times: Floats, path_time: float, period: float) -> float:
    return period * int(np.searchsorted(path_times, path_time - 1e-9))


def certify(gimbal: Gimbal, route: Route, asked: Floats) -> JointPath:
    """Return the path of *route* with figures and notes.

    Raises:
        LimitError: two axes deviate too much from the orientations *asked*, shape ``(n, 4)``.
    """
    path, (missed, when) = route.path, route.error
    figures = [Figure("pointing error", missed, "rad", gimbal.max_deviation, when)]
    figures.append(manipulability(gimbal, path.joints))
    if gimbal.is_fitting:
        figures.append(_roll(gimbal, path, asked))
    return replace(path, figures=tuple(figures), notes=tuple(_deviations(route)))


def manipulability(gimbal: Gimbal, joints: Floats) -> Figure:
    """Return the distance of *joints* (rad, shape ``(n, axes)``) from the pole, which is at 0."""
    least = float(np.min(of_arrays(gimbal).manipulability(joints.T)))
    return Figure("manipulability", least, "1")


def _deviations(route: Route) -> list[str]:
    """Return where and by how much a route leaves the path, in words, one line each."""
    missed, when = route.error
    outside = " outside slews" if route.slews else ""
    angle = f"{degrees(missed):.4f}"
    lines = []
    if float(angle):
        lines.append(f"the path is missed by at most {angle} deg{outside} at {when:.3f} s")
    period, times = route.path.period, route.path.path_times
    for one in route.passages:
        start, end = (_when(times, place * period, period) for place in (one.first, one.last))
        lines.append(
            f"{start:.3f} to {end:.3f} s: {one.kind} near the pole, missing by at most "
            f"{degrees(one.error):.3f} deg"
        )
    for slew in route.slews:
        goal = ", ".join(f"{degrees(angle):.1f}" for angle in slew.after)
        what = "slows down" if slew.is_on_path else "stops and the axes slew"
        lines.append(
            f"{slew.start:.3f} to {slew.end:.3f} s ({slew.duration:.2f} s): the path {what} to "
            f"{goal} deg, off it by up to {degrees(slew.error):.1f} deg"
        )
    return lines


def _roll(gimbal: Gimbal, path: JointPath, asked: Floats) -> Figure:
    """Return the orientation error of two axes, which lack a degree of freedom.

    Raises:
        LimitError: the error is larger than allowed.
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


def row_of(q: Floats) -> Quaternion:
    """Return an orientation, shape ``(4,)``, as plain floats."""
    w, x, y, z = q.tolist()
    return w, x, y, z
