"""The ways of a device along a path, of which the quickest counts.

Most devices have one: exactly along it.  A gimbal may pass its poles in others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

from orientd.driver import ZERO, Joints
from orientd.errors import PlanError
from orientd.mechanism import Gimbal
from orientd.mechanism.arrays import row_of
from orientd.mechanism.poles import around_poles, made_by_two, passes_pole
from orientd.mechanism.routing import beginnings
from orientd.mechanism.turning import turned_together
from orientd.mechanism.unwinding import slewed
from orientd.model.limits import Limits
from orientd.planner.timing.axes import RISE, SHARE, Axes, AxisPath, on_the_way
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.profiles import quickest

_WORTH, _TOGETHER = 1.01, 1.1
"""Factors of the duration from which a deviation, and a turn of all axes together, are worth it."""

Candidate = tuple[float, KeyframePath, AxisPath]
"""A factor that a way has to be quicker by, the path, and the axes along it."""


def ways_along(
    axes: Axes,
    path: KeyframePath,
    near: Joints,
    tool: Limits,
    period: float,
    *,
    share: float = SHARE,
    place: Callable[[float], str] = on_the_way,
    has_shape: bool = True,
) -> list[Candidate]:
    """Return the ways along a path, the most exact first.

    Args:
        axes: of the device.
        path: from rest to rest.
        near: axis angles at its start, about, rad.
        tool: limits of the tool, which bound the pace.
        period: of the device, s.
        share: of accelerations and jerks that the timing uses.
        place: as for :meth:`.Axes.along`.
        has_shape: whether only the path itself leads to its end; otherwise all axes may turn to it
            together.

    Raises:
        PlanError: the axes can go along none of them, at whatever pace.
    """
    found: list[Candidate] = []
    refusal: PlanError | None = None
    for worth, make in _variants(axes, path, near, has_shape=has_shape):
        if worth == _TOGETHER and found and not passes_pole(axes.mechanism, path.trajectory):
            continue
        try:
            way = make()
            if worth == _WORTH and way is path:
                continue
            found.append((worth, way, axes.along(way, near, tool, period, share, RISE, place)))
        except PlanError as error:
            # All axes together are refused for the end alone, which no way can change.
            refusal = error if worth == _TOGETHER else refusal or error
    if not found:
        raise refusal or PlanError("there is no way")
    return found


def _variants(
    axes: Axes, path: KeyframePath, near: Joints, *, has_shape: bool
) -> Iterator[tuple[float, Callable[[], KeyframePath]]]:
    """Yield what a way has to be quicker by, and what makes it."""
    gimbal = axes.mechanism
    if not isinstance(gimbal, Gimbal):
        yield 1.0, lambda: path
        return
    near = near or beginnings(gimbal, row_of(path.first.q), ZERO)[0]

    asked = path.way

    def along(deviation: float) -> KeyframePath:
        way = around_poles(gimbal, asked, near, deviation)
        if axes.gives_roll and (way is not asked or not deviation):
            way = made_by_two(gimbal, way, near)
        if has_shape and path.positions.is_held:
            way = slewed(gimbal, way, near)
        return path if way is asked else path.made_as(way)

    def together() -> KeyframePath:
        return path.made_as(turned_together(gimbal, asked, near, axes.goal))

    if axes.goal:
        yield 1.0, together
        return

    yield 1.0, partial(along, 0.0)
    if gimbal.max_deviation:
        yield _WORTH, partial(along, gimbal.max_deviation)
    if not has_shape:
        yield _TOGETHER, together


def quickest_of(
    ways: list[Candidate], limits: Limits, period: float
) -> tuple[KeyframePath, Joints]:
    """Return the quickest of several ways, timed, and the axes at its end.

    Raises:
        PlanError: none has a timing within the limits.
    """
    best: tuple[KeyframePath, Joints] | None = None
    refusal: PlanError | None = None
    for worth, path, along in ways:
        try:
            timed = quickest(path, limits, period, has_rests=True, axes=along)
        except PlanError as error:
            refusal = refusal or error
            continue
        if best is None or worth * timed.duration < best[0].duration:
            best = timed, along.end
    if best is None:
        raise refusal or PlanError("there is no way")
    return best
