"""Limits of motions, and how the limits of a request narrow those of its device."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from orientd.errors import RequestError
from orientd.spelling import unknown_key

if TYPE_CHECKING:
    from orientd.rotation import Floats

ACCELERATION_RESERVE = 0.95
"""Share of acceleration and jerk that planned timings use; the rest is for stops."""

_CYCLES_TO_RISE = 2.0  # least cycles in which the velocity rises to its limit
_SLOWLY = 16.0  # the same for acceleration steps that are too small to detect
_LEAST_STEP = 2e-6  # rad in a cycle squared, ten of orientd.servo.path.segment.LEAST_STEP
_STEEPEST = 20.0  # how often the acceleration may rise to its limit in a cycle

LONGEST = 86_400.0
"""Longest motion, s, so that a wrong unit does not plan for ever."""

LOWEST, HIGHEST = 1e-9, 1e12
"""Range of every finite limit, in its unit."""

PERIODS = (1e-5, 1.0)
"""Shortest and longest period of a device, s."""

STILL = 1e-9
"""Angular velocity, rad/s, below which a motion is at rest."""

STEADY = 1e-6
"""Angular acceleration, rad/s^2, and share of its limit, that count as zero."""

UNITS = {
    "velocity": "rad/s",
    "acceleration": "rad/s^2",
    "jerk": "rad/s^3",
    "linear_velocity": "m/s",
    "linear_acceleration": "m/s^2",
}
"""Unit of each limited quantity."""

ANGULAR = ("velocity", "acceleration", "jerk")
"""Quantities with limits for each body axis, lowest derivative first."""

AXES = "xyz"
"""Names of the body's axes."""

Triple = tuple[float, float, float]
Rate = float | Sequence[float]
"""A limit as users write it: of the norm, or of the x, y and z components in the body frame."""

NO_AXES: Triple = (math.inf, math.inf, math.inf)
"""No limit of any component."""

_TABLE = (
    *((name, axis) for name in ANGULAR for axis in ("", *AXES)),
    *((name, "") for name in UNITS if name not in ANGULAR),
)
"""Quantity and axis of each number of :meth:`Limits.numbers`; the axis is empty for the norm."""


def linear_rate(content: object) -> float:
    """Return the limit on a norm.

    Raises:
        ValueError: *content* is not a limit; the message is the expected value.
    """
    if isinstance(content, bool) or not isinstance(content, int | float):
        raise ValueError("a number")
    # A whole number may be beyond all floats.
    if not -sys.float_info.max <= content <= sys.float_info.max:
        raise ValueError("a finite number")
    if not content > 0.0:
        raise ValueError("a number greater than 0")
    return float(content)


def angular_rate(content: object) -> float | Triple:
    """Return the limit on a norm, or three limits on the components in the body frame.

    Raises:
        ValueError: *content* is neither; the message is the expected value.
    """
    if not isinstance(content, list | tuple):
        return linear_rate(content)
    try:
        x, y, z = map(linear_rate, content)
    except ValueError:
        expected = "three finite numbers greater than 0, for the body's x, y and z axes"
        raise ValueError(expected) from None
    return x, y, z


@dataclass(frozen=True, slots=True)
class Limits:
    """The largest rates of a motion or a device; infinity means "no limit".

    A quantity has a limit on its Euclidean norm.  For rotations, its components in the body frame
    may have limits too.  If only the components have limits, they imply a limit on the norm, which
    is finite and never the tighter one (:meth:`with_rates`).

    Attributes:
        velocity: angular velocity, rad/s.
        acceleration: angular acceleration, rad/s^2.
        jerk: angular jerk, rad/s^3.
        linear_velocity: velocity of the position, m/s.
        linear_acceleration: acceleration of the position, m/s^2.
        axis_velocity: magnitudes of the angular velocity about each of the body's axes.
        axis_acceleration: magnitudes of the angular acceleration in the same way.
        axis_jerk: magnitudes of the angular jerk in the same way.

    Raises:
        TypeError: a limit is not a number.
        ValueError: a limit is not positive.
    """

    velocity: float
    acceleration: float
    jerk: float
    linear_velocity: float
    linear_acceleration: float
    axis_velocity: Triple = NO_AXES
    axis_acceleration: Triple = NO_AXES
    axis_jerk: Triple = NO_AXES

    def __post_init__(self) -> None:
        for name in UNITS:
            limit = getattr(self, name)
            if not isinstance(limit, int | float):
                raise TypeError(
                    f"{name} must be a number, got {limit!r}; Limits.partial takes three, too"
                )
            object.__setattr__(self, name, float(limit))
        for name in ANGULAR:
            axes = tuple(map(float, getattr(self, f"axis_{name}")))
            object.__setattr__(self, f"axis_{name}", axes)
        for (name, axis), limit in zip(_TABLE, self.numbers(), strict=True):
            if not limit > 0.0:
                of = f"{name} about {axis}" if axis else name
                raise ValueError(f"{of} must be positive, got {limit} {UNITS[name]}")

    @classmethod
    def partial(
        cls,
        *,
        velocity: Rate = math.inf,
        acceleration: Rate = math.inf,
        jerk: Rate = math.inf,
        linear_velocity: float = math.inf,
        linear_acceleration: float = math.inf,
    ) -> Limits:
        """Return limits that leave every missing quantity without a limit.

        >>> Limits.partial(velocity=1.0).jerk
        inf
        """
        return Limits(
            math.inf, math.inf, math.inf, linear_velocity, linear_acceleration
        ).with_rates({"velocity": velocity, "acceleration": acceleration, "jerk": jerk})

    def with_rates(self, rates: Mapping[str, Rate]) -> Limits:
        """Return these limits with some replaced.

        Args:
            rates: new limits by the names of :data:`UNITS`.  Three numbers limit the components in
                the body frame, and the norm of the three then limits the norm.

        Raises:
            RequestError: a name is unknown.

        >>> Limits.partial().with_rates({"velocity": [2.0, 1.0, 2.0]}).velocity
        3.0
        """
        changes: dict[str, float | Triple] = {}
        if not isinstance(rates, Mapping):
            raise RequestError("limits", f"expected Limits or a mapping of {', '.join(UNITS)}")
        for name, rate in rates.items():
            if name not in UNITS:
                raise RequestError(f"limits.{name}", unknown_key(name, UNITS))
            if isinstance(rate, Sized):
                x, y, z = map(float, rate)
                changes[name], changes[f"axis_{name}"] = math.hypot(x, y, z), (x, y, z)
            else:
                changes[name] = float(rate)
                if name in ANGULAR:
                    changes[f"axis_{name}"] = NO_AXES
        return replace(self, **changes)  # type: ignore[arg-type]  # each name has its type

    def numbers(self) -> tuple[float, ...]:
        """Return all limits: norm, x, y and z of each of :data:`ANGULAR`, then the linear ones."""
        return (
            *(self.velocity, *self.axis_velocity),
            *(self.acceleration, *self.axis_acceleration),
            *(self.jerk, *self.axis_jerk),
            *(self.linear_velocity, self.linear_acceleration),
        )

    def axes(self, name: str) -> Triple:
        """Return the limits of the components of one of :data:`ANGULAR`."""
        axes: Triple = getattr(self, f"axis_{name}")
        return axes

    @property
    def has_axes(self) -> bool:
        """Whether any single component is limited."""
        return not self.axis_velocity == self.axis_acceleration == self.axis_jerk == NO_AXES

    def rate(self, name: str) -> Rate:
        """Return a limit as users write it: three numbers if the norm follows from them."""
        norm: float = getattr(self, name)
        if name not in ANGULAR:
            return norm
        axes = self.axes(name)
        return norm if norm < math.hypot(*axes) * (1.0 - 1e-12) or axes == NO_AXES else axes

    def along(self, direction: Sequence[float]) -> Iterator[float]:
        """Yield the limits of :data:`ANGULAR` on a rotation about one axis.

        Args:
            direction: of the axis in the body frame, a unit vector.
        """
        for name in ANGULAR:
            limit = getattr(self, name)
            for component, most in zip(direction, self.axes(name), strict=True):
                if abs(component) * limit > most:
                    limit = most / abs(component)
            yield limit

    def check_range(self, period: float) -> None:
        """Refuse limits that allow no plan.

        Args:
            period: cycle period of the device, s.

        Raises:
            RequestError: a limit is too low or too high, or permits more than half a turn in a
                cycle, which a device cannot tell from a smaller turn the other way.
        """
        for (name, _), limit in zip(_TABLE, self.numbers(), strict=True):
            if math.isfinite(limit) and not LOWEST <= limit <= HIGHEST:
                raise RequestError(
                    f"limits.{name}",
                    f"must be within {LOWEST:g} and {HIGHEST:g} {UNITS[name]}, got {limit:g}; "
                    "give a limit in this range, or leave it out",
                )
        most = math.pi / period
        if math.isfinite(self.velocity) and self.velocity > most:
            raise RequestError(
                "limits.velocity",
                f"must be at most half a turn in a cycle, {most:.6g} rad/s with a period of "
                f"{period:g} s, got {self.velocity:g}; give a lower one",
            )

    def narrowed(self, request: Limits | None) -> Limits:
        """Return these limits of a device, lowered to those of a request.

        Args:
            request: limits of one motion; infinite ones keep the device's limit.

        Raises:
            RequestError: a limit of the request is higher than the device's.
        """
        if request is None:
            return self
        lowered = []
        for (name, axis), own, asked in zip(_TABLE, self.numbers(), request.numbers(), strict=True):
            allowed = min(own, getattr(self, name))
            is_implied = not axis and name in ANGULAR and request.axes(name) != NO_AXES
            if asked > allowed and math.isfinite(asked) and not is_implied:
                field, about = (f"[{AXES.index(axis)}]", f" about {axis}") if axis else ("", "")
                raise RequestError(
                    f"limits.{name}{field}",
                    f"must be at most the device's {allowed:g} {UNITS[name]}{about}, got {asked:g}",
                )
            lowered.append(min(own, asked))
        return _of(lowered)

    def with_reserve(self, share: float = ACCELERATION_RESERVE) -> Limits:
        """Return the limits for timings that the planner computes.

        At the limit of the acceleration there is no reserve to brake with, and a stop on the path
        would never end.  :mod:`orientd.planner.certify.brake` derives the effect of a reserve.

        Args:
            share: of acceleration and jerk that the timing may use.
        """
        return self.times(acceleration=share, jerk=share, linear_acceleration=share)

    def scaled(self, factor: float) -> Limits:
        """Return every limit multiplied by *factor*."""
        return self.times(**dict.fromkeys(UNITS, factor))

    def slowed(self, speed: float) -> Limits:
        """Return the limits under which motions run *speed* times as fast."""
        return self.times(
            velocity=speed,
            acceleration=speed**2,
            jerk=speed**3,
            linear_velocity=speed,
            linear_acceleration=speed**2,
        )

    # A plan needs the same few again and again, of limits that are as good as constants.
    @lru_cache(maxsize=256)  # noqa: B019 - bounded
    def at_period(self, period: float) -> Limits:
        """Return the limits for timings of a device that gets a setpoint every *period* seconds.

        A rate that rises too fast exceeds its limit between two setpoints.  The velocity must take
        at least two cycles to rise to its limit, and the acceleration a twentieth of one.  For very
        low limits the servo cannot detect the acceleration steps, so they need more.
        """
        own = self.numbers()
        speeds = (min(own[0], math.pi / period), *own[1:4])
        is_slow = min(speeds) * period < _SLOWLY * _LEAST_STEP
        rise = (_SLOWLY if is_slow else _CYCLES_TO_RISE) * period
        most = [min(a, v / rise) for a, v in zip(own[4:8], speeds, strict=True)]
        jerks = [min(j, _STEEPEST / period * a) for j, a in zip(own[8:12], most, strict=True)]
        return _of((*speeds, *most, *jerks, own[12], min(own[13], own[12] / rise)))

    def lower(self, others: Limits) -> Limits:
        """Return the lower one of each of these limits and *others*."""
        return _of(list(map(min, self.numbers(), others.numbers())))

    @lru_cache(maxsize=256)  # noqa: B019 - bounded
    def times(self, **factors: float) -> Limits:
        """Return the limits multiplied by factors, given by the names of :data:`UNITS`."""
        numbers = zip(_TABLE, self.numbers(), strict=True)
        return _of([factors.get(name, 1.0) * limit for (name, _), limit in numbers])


def _of(numbers: Sequence[float]) -> Limits:
    """Return the limits whose :meth:`Limits.numbers` are *numbers*."""
    v, a, j = numbers[:4], numbers[4:8], numbers[8:12]
    axes: list[Any] = [tuple(one[1:]) for one in (v, a, j)]
    return Limits(v[0], a[0], j[0], numbers[12], numbers[13], *axes)


DEFAULT_LIMITS = Limits(
    velocity=2.5,
    acceleration=17.0,
    jerk=8500.0,
    linear_velocity=1.0,
    linear_acceleration=10.0,
)
"""Default limits of a device; the angular ones are those of the Franka Research 3."""


def is_still(omega: Floats, alpha: Floats, limits: Limits) -> bool:
    """Return whether a motion in this state needs no lead."""
    speed, size = math.hypot(*omega.tolist()), math.hypot(*alpha.tolist())
    return speed <= STILL and size <= STEADY * limits.acceleration
