"""Joint paths of a mechanism: the motion of its axes, checked against their limits.

Velocity, acceleration and jerk are backward differences, as a device computes them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from orientd.driver import AxisLimits
from orientd.errors import LimitError, LimitKind
from orientd.mechanism.figure import Figure, Loss
from orientd.rotation import Floats, conjugate, log, multiply

_PLANNED = 0.95
"""Share of an axis' acceleration that generated plans use; the rest is for braking."""
_RISE = 5.0
"""Least periods in which an axis of a generated plan reaches its velocity.

At a sharper corner the curve between two records would exceed it.
"""
KINDS = (LimitKind.VELOCITY, LimitKind.ACCELERATION, LimitKind.JERK)


@dataclass(frozen=True, eq=False)
class JointPath:
    """A path of a mechanism's axes on a uniform grid.

    Attributes:
        period: of the grid, s.
        joints: angles of the axes, rad, unwrapped, shape ``(n, axes)``.
        q: tool orientation for these angles, shape ``(n, 4)``.
        path_times: time of each sample on the requested path, s, never decreasing, shape ``(n,)``.
        figures: numbers about the way that the axes take.
        notes: remarks on it, one line each.
        losses: when the axes of a gimbal do not point along the path.
    """

    period: float
    joints: Floats
    q: Floats = field(repr=False)
    path_times: Floats = field(repr=False)
    figures: tuple[Figure, ...] = ()
    notes: tuple[str, ...] = ()
    losses: tuple[Loss, ...] = ()


class ToolLimits(NamedTuple):
    """Limits of the tool where the axes leave the path or its times.

    Attributes:
        velocity: rad/s.
        acceleration: rad/s^2.
        jerk: rad/s^3.
    """

    velocity: float = math.inf
    acceleration: float = math.inf
    jerk: float = math.inf

    @classmethod
    def of(cls, numbers: Sequence[float]) -> ToolLimits:
        """Return the angular rates that keep limits about any axis; see :meth:`.Limits.numbers`."""
        return cls(min(numbers[:4]), min(numbers[4:8]), min(numbers[8:12]))

    def excess(self, q: Floats, period: float) -> float:
        """Return the least factor by which orientations must take longer to keep the limits.

        Args:
            q: from rest to rest, shape ``(n, 4)``.
            period: time between two of them, s.
        """
        q = np.concatenate([q[:1], q[:1], q[:1], q, q[-1:], q[-1:], q[-1:]])
        rate = log(multiply(conjugate(q[:-1]), q[1:])) / period
        most = []
        for _ in range(3):
            most.append(float(np.max(np.linalg.norm(rate, axis=1))))
            rate = np.diff(rate, axis=0) / period
        return max(
            most[0] / self.velocity,
            math.sqrt(most[1] / self.acceleration),
            math.cbrt(most[2] / self.jerk),
        )


class Bounds(NamedTuple):
    """The limits of a plan.

    Attributes:
        period: of its samples, s.
        axes: limits of every axis, reduced to the share that the plan may use.
        tool: limits of the tool where the axes leave the path or its times.
    """

    period: float
    axes: Sequence[AxisLimits]
    tool: ToolLimits = ToolLimits()


class AxisPeak(NamedTuple):
    """The largest rate of an axis of one kind.

    Attributes:
        kind: velocity, acceleration or jerk.
        axis: name of the axis.
        value: the largest size, in rad and s.
        limit: the allowed size.
        time: when it occurs, s from the beginning.
    """

    kind: LimitKind
    axis: AxisLimits
    value: float
    limit: float
    time: float


def rates(joints: Floats, period: float, before: Floats) -> list[Floats]:
    """Return velocity, acceleration and jerk by backward differences.

    Args:
        joints: shape ``(n, axes)``.
        period: s.
        before: the samples before the first, oldest first, shape ``(m, axes)``.  Differences that
            would reach back further are 0.

    Returns:
        Arrays of the shape of *joints*.
    """
    found, rows = [], np.concatenate([before, joints])
    for passed in range(1, len(KINDS) + 1):
        rows = np.diff(rows, axis=0) / period
        kept = np.zeros_like(joints)
        known = len(before) - passed
        kept[max(0, -known) :] = rows[max(0, known) :]
        found.append(kept)
    return found


def losses_of(error: Floats, period: float, tolerance: float) -> tuple[Loss, ...]:
    """Return the intervals in which an error exceeds a tolerance.

    Args:
        error: of each sample, rad, shape ``(n,)``.
        period: s.
        tolerance: rad.
    """
    is_off = np.concatenate([[False], error > tolerance, [False]])
    edges = np.flatnonzero(is_off[1:] != is_off[:-1])
    return tuple(
        Loss(float(begin * period), float(end * period), float(np.max(error[begin:end])))
        for begin, end in zip(edges[::2], edges[1::2], strict=True)
    )


def planned(axes: Iterable[AxisLimits], period: float) -> list[AxisLimits]:
    """Return the limits for generated plans with a period, with a reserve to brake with."""
    return [
        axis._replace(
            acceleration=min(_PLANNED * axis.acceleration, axis.velocity / (_RISE * period))
        )
        for axis in axes
    ]


def refuse_range(
    joints: Sequence[float], axes: Sequence[AxisLimits], time: float, advice: str
) -> None:
    """Raise :class:`.LimitError` for the first axis that is outside its range at *time*."""
    for value, axis in zip(joints, axes, strict=True):
        if not axis.low - axis.resolution <= value <= axis.high + axis.resolution:
            raise out_of_range(axis, value, time, advice)


def out_of_range(axis: AxisLimits, value: float, time: float, advice: str) -> LimitError:
    """Return the error for an angle of *axis*, rad, with the nearer limit."""
    bound = axis.high if abs(value - axis.high) < abs(value - axis.low) else axis.low
    quantity = f"angle of {axis.name}"
    return LimitError(quantity, value, bound, time, "rad", advice, kind=LimitKind.RANGE)


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
