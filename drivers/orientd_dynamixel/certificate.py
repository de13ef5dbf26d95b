"""What a gimbal path promises: limits of the axes, what the plan may do, and what it certifies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from orientd.rotation import Floats, conjugate, log, multiply


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """What one axis may do.

    Attributes:
        low: least angle, rad, unwrapped: whole turns count.
        high: largest angle, rad.
        velocity: rad/s.  A servo's no-load speed is out of reach under load; take 80 % of it.
        acceleration: rad/s^2.
        name: for messages.
    """

    low: float = -math.pi
    high: float = math.pi
    velocity: float = 3.85
    acceleration: float = 40.0
    name: str = "axis"


@dataclass(frozen=True, slots=True)
class ToolLimits:
    """What the tool may do where the plan leaves the path or its times.

    Attributes:
        velocity: rad/s.
        acceleration: rad/s^2.
        jerk: rad/s^3.
    """

    velocity: float = math.inf
    acceleration: float = math.inf
    jerk: float = math.inf

    def excess(self, q: Floats, period: float) -> float:
        """Return how much longer orientations must take, at least, to keep the limits.

        Args:
            q: from rest to rest, shape ``(n, 4)``.
            period: from one to the next, s.
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


@dataclass(frozen=True, slots=True)
class DeviationPolicy:
    """What a plan may do where the exact path is more than the axes can make.

    Tried in this order: leave the path by a bounded angle, stop and reconfigure.  To run the whole
    path slower is left to whoever plans it.

    Attributes:
        max_deviation: largest angle by which the path may be missed near a pole, rad.
        allow_slews: whether the path may stop while the axes change branch or unwind; the tool
            leaves the path meanwhile.
        free: up to which time the path may stop for that at the pole, allowed or not, s.
    """

    max_deviation: float = 0.0
    allow_slews: bool = False
    free: float = 0.0


@dataclass(frozen=True, slots=True)
class AxisPeak:
    """A largest value, where it is reached, and what is allowed."""

    value: float
    time: float
    limit: float


@dataclass(frozen=True, slots=True)
class Keyhole:
    """A passage near the pole.

    Attributes:
        start: when the path begins to deviate, s.
        end: when it is exact again, s.
        kind: ``pass`` goes over the pole with the outer axis nearly still, ``flip`` turns it about
            half a turn, ``deviation`` cuts the corner without either.
        error: the largest angle by which the path is missed in it, rad.
    """

    start: float
    end: float
    kind: str
    error: float


@dataclass(frozen=True, slots=True)
class Slew:
    """A stop of the path in which the axes change branch or unwind.

    Or a stretch of it that is gone along slowly, from rest to rest, because an axis would have to
    hurry too much: then the path is not left.

    Attributes:
        start: s.
        end: s.
        before: axis angles, rad.
        after: axis angles, rad.
        is_on_path: whether the path is gone along slowly instead of being left.
        error: the largest angle by which the path is missed in it, rad.
    """

    start: float
    end: float
    before: tuple[float, ...]
    after: tuple[float, ...]
    is_on_path: bool = False
    error: float = 0.0

    @property
    def duration(self) -> float:
        """How long it lasts, s."""
        return self.end - self.start


@dataclass(frozen=True, slots=True)
class AxisCertificate:
    """What holds for a planned path, computed from its samples by backward differences.

    Attributes:
        velocity: peak of each axis, rad/s.
        acceleration: peak of each axis, rad/s^2.
        travel: ``(least, largest)`` angle of each axis, rad.
        error: largest angle between path asked and path planned outside slews, rad.
        manipulability: least singular value on the way.
        keyholes: where the path is left by a bounded angle.
        slews: where it stops.
    """

    velocity: tuple[AxisPeak, ...]
    acceleration: tuple[AxisPeak, ...]
    travel: tuple[tuple[float, float], ...]
    error: AxisPeak
    manipulability: float
    keyholes: tuple[Keyhole, ...]
    slews: tuple[Slew, ...]


@dataclass(frozen=True)
class AxisPath:
    """A path in axis angles.

    Attributes:
        times: s, shape ``(n,)``, uniform.
        angles: rad, unwrapped, shape ``(n, axes)``.
        q: orientation that they make, shape ``(n, 4)``; what is to be streamed.
        path_times: how far along the path asked for each sample is, s, shape ``(n,)``.
        certificate: what holds for it.
    """

    times: Floats
    angles: Floats
    q: Floats = field(repr=False)
    path_times: Floats = field(repr=False)
    certificate: AxisCertificate


def rates(angles: Floats, period: float, before: Floats | None = None) -> tuple[Floats, Floats]:
    """Return velocity and acceleration by backward differences.

    Args:
        angles: shape ``(n, axes)``.
        period: s.
        before: the samples before the first, at least two, where the path goes on from them.

    Returns:
        Two arrays of the same shape; without *before* the first row of the velocity and the first
        two of the acceleration are 0, because nothing is known of what was before.
    """
    if before is not None and len(before):
        velocity, acceleration = rates(np.concatenate([before, angles]), period)
        return velocity[len(before) :], acceleration[len(before) :]
    velocity = np.zeros_like(angles)
    velocity[1:] = np.diff(angles, axis=0) / period
    acceleration = np.zeros_like(angles)
    acceleration[2:] = np.diff(velocity[1:], axis=0) / period
    return velocity, acceleration


def peak(values: Floats, times: Floats, limit: float) -> AxisPeak:
    """Return the largest absolute value and when it is reached."""
    at = int(np.argmax(np.abs(values)))
    return AxisPeak(float(np.abs(values[at])), float(times[at]), limit)


def measured(
    certificate: AxisCertificate,
    angles: Floats,
    period: float,
    limits: Sequence[AxisLimits],
    before: Floats,
) -> AxisCertificate:
    """Return *certificate* with the rates and the travel of *angles*.

    Args:
        certificate: what else holds.
        angles: rad, shape ``(n, axes)``.
        period: s.
        limits: of every axis.
        before: the samples before the first, as for :func:`rates`.
    """
    times = period * np.arange(len(angles), dtype=np.float64)
    velocity, acceleration = rates(angles, period, before)
    axes = range(len(limits))
    return replace(
        certificate,
        velocity=tuple(peak(velocity[:, a], times, limits[a].velocity) for a in axes),
        acceleration=tuple(peak(acceleration[:, a], times, limits[a].acceleration) for a in axes),
        travel=tuple((float(np.min(angles[:, a])), float(np.max(angles[:, a]))) for a in axes),
    )
