"""What no motion may exceed, and how a request's own limits narrow those of its device."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

from orientd.errors import RequestError

ACCELERATION_RESERVE = 0.95
"""Share of acceleration and jerk that planned timings use; the rest lets a motion be stopped."""

GUARD_TOLERANCE = 1.001
"""How far above a limit the servo's guard lets a setpoint be."""

UNITS = {
    "velocity": "rad/s",
    "acceleration": "rad/s^2",
    "jerk": "rad/s^3",
    "linear_velocity": "m/s",
    "linear_acceleration": "m/s^2",
}


@dataclass(frozen=True, slots=True)
class Limits:
    """Largest rates, each the Euclidean norm of a vector; infinity stands for "no limit".

    Attributes:
        velocity: angular velocity, rad/s.
        acceleration: angular acceleration, rad/s^2.
        jerk: angular jerk, rad/s^3.
        linear_velocity: velocity of the position, m/s.
        linear_acceleration: acceleration of the position, m/s^2.

    Raises:
        ValueError: a limit is not positive.
    """

    velocity: float
    acceleration: float
    jerk: float
    linear_velocity: float
    linear_acceleration: float

    def __post_init__(self) -> None:
        for name, unit in UNITS.items():
            limit = getattr(self, name)
            if not limit > 0.0:
                raise ValueError(f"{name} must be positive, got {limit} {unit}")

    @classmethod
    def partial(
        cls,
        *,
        velocity: float = math.inf,
        acceleration: float = math.inf,
        jerk: float = math.inf,
        linear_velocity: float = math.inf,
        linear_acceleration: float = math.inf,
    ) -> Limits:
        """Return limits with nothing said about what is not given.

        >>> Limits.partial(velocity=1.0).jerk
        inf
        """
        return cls(velocity, acceleration, jerk, linear_velocity, linear_acceleration)

    def within(self, other: Limits) -> bool:
        """Return whether every limit is at most as high as the one of *other*."""
        return all(getattr(self, name) <= getattr(other, name) for name in UNITS)

    def narrowed(self, request: Limits | None) -> Limits:
        """Return these limits of a device, lowered to those of a request.

        Args:
            request: limits of one motion; infinite ones are left to the device.

        Raises:
            RequestError: the request asks for more than the device's limit.
        """
        if request is None:
            return self
        lowered = {}
        for name, unit in UNITS.items():
            asked, allowed = getattr(request, name), getattr(self, name)
            if asked > allowed and math.isfinite(asked):
                raise RequestError(
                    f"limits.{name}",
                    f"must be at most the device's {allowed:g} {unit}, got {asked:g}",
                )
            lowered[name] = min(asked, allowed)
        return Limits(**lowered)

    def with_reserve(self) -> Limits:
        """Return the limits for timings of the planner's own making.

        At a limit of acceleration there is nothing left to slow down with, and a stop on the path
        would take for ever; :mod:`orientd.planner.brake` says how much a reserve buys.
        """
        return replace(
            self,
            acceleration=ACCELERATION_RESERVE * self.acceleration,
            jerk=ACCELERATION_RESERVE * self.jerk,
            linear_acceleration=ACCELERATION_RESERVE * self.linear_acceleration,
        )

    def scaled(self, factor: float) -> Limits:
        """Return every limit multiplied by *factor*."""
        return Limits(**{f.name: factor * getattr(self, f.name) for f in fields(self)})


DEFAULT_LIMITS = Limits(
    velocity=2.5,
    acceleration=17.0,
    jerk=8500.0,
    linear_velocity=1.0,
    linear_acceleration=10.0,
)
"""Where a configuration says nothing; the angular ones are those of the Franka Research 3."""
