"""The commanded state of a device at the start of a motion."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from orientd.rotation import Floats, check_unit

_ZERO: list[float] = [0.0, 0.0, 0.0]
_ENDS = [4, 7, 10, 13, 16]
"""Ends of the vectors in a row, but for the last."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The commanded state of a device.

    Attributes:
        q: orientation ``(w, x, y, z)``, tool to world.
        omega_body: angular velocity, body frame, rad/s.
        alpha_body: its derivative in body components, rad/s^2.
        position: of the tool in the world, m.
        velocity: of the position, m/s.
        acceleration: of the position, m/s^2.
        before: orientations ``(3, 4)`` and positions ``(3, 3)`` of the three setpoints before this
            one, oldest first; ``None`` if unknown.
    """

    q: Floats
    omega_body: Floats
    alpha_body: Floats
    position: Floats
    velocity: Floats = field(default_factory=lambda: np.zeros(3))
    acceleration: Floats = field(default_factory=lambda: np.zeros(3))
    before: tuple[Floats, Floats] | None = None

    @classmethod
    def at_rest(cls, q: ArrayLike, position: ArrayLike = (0.0, 0.0, 0.0)) -> State:
        """Return the state at rest at *q* and *position*."""
        zero = np.zeros(3)
        return cls(check_unit(q), zero, zero, np.asarray(position, dtype=np.float64))

    @classmethod
    def of_row(cls, row: Floats, before: tuple[Floats, Floats] | None = None) -> State:
        """Return the state with the numbers of :attr:`row`."""
        q, omega, alpha, position, velocity, acceleration = np.split(row, _ENDS)
        return cls(q, omega, alpha, position, velocity, acceleration, before)

    @property
    def row(self) -> Floats:
        """All numbers of the state, in order, shape ``(19,)``."""
        turning, linear = (self.q, self.omega_body, self.alpha_body), (self.position, self.velocity)
        return np.concatenate([*turning, *linear, self.acceleration])

    @property
    def is_at_rest(self) -> bool:
        """Whether velocity and acceleration are zero."""
        is_turning = self.omega_body.tolist() != _ZERO or self.alpha_body.tolist() != _ZERO
        return not (is_turning or self.is_position_moving)

    @property
    def is_known(self) -> bool:
        """Whether the setpoints before it are known: a state at rest implies them."""
        return self.before is not None or self.is_at_rest

    @property
    def is_position_moving(self) -> bool:
        """Whether the position has a velocity or an acceleration."""
        return [*self.velocity.tolist(), *self.acceleration.tolist()] != 2 * _ZERO
