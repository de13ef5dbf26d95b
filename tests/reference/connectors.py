"""The limits that joins keep, in plain NumPy."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from orientd.planner.certify import limit_table
from orientd.planner.limits import ACCELERATION_RESERVE, Limits
from orientd.planner.request import State
from orientd.rotation import Floats

VELOCITY_MARGIN = 0.9995
"""Of the limit, for peaks between the points that are looked at."""

ROUNDING = 1e-9
"""Rounding must not decide which joins keep their bounds."""

Booleans = np.ndarray[Any, np.dtype[np.bool_]]


class Bounds(NamedTuple):
    """What a connector keeps: the limits with their reserve, but never less than it begins with.

    Attributes:
        most: velocity, acceleration and jerk: the norm, and the components where they are limited,
            shape ``(3, 1 or 4)``.
        has_axes: whether they are.
    """

    most: Floats
    has_axes: bool

    @classmethod
    def of(
        cls, start: State, end: State, limits: Limits, reserve: float = ACCELERATION_RESERVE
    ) -> Bounds:
        """Return the bounds for a way between two states."""
        reserved = limits.with_reserve(reserve)
        most = limit_table(reserved).copy()
        most[0] *= VELOCITY_MARGIN
        given: Floats = np.empty((2, 2, 4))
        given[..., 1:] = np.abs([(state.omega_body, state.alpha_body) for state in (start, end)])
        given[..., 0] = np.sqrt(np.einsum("...i,...i->...", given[..., 1:], given[..., 1:]))
        np.maximum(most[:2], given.max(axis=0), out=most[:2])
        # Ramps go right up to the bounds: rounding must not decide which of them keep them.
        most *= 1.0 + ROUNDING
        return cls(most if limits.has_axes else most[:, :1].copy(), limits.has_axes)

    @property
    def least(self) -> tuple[float, float, float]:
        """What is allowed in any direction."""
        velocity, acceleration, jerk = self.most.min(axis=1).tolist()
        return velocity, acceleration, jerk

    def keeps(self, rates: Floats) -> Booleans:
        """Return which of several ways keep the bounds, by their largest rates."""
        kept: Booleans = np.all(rates <= self.most[..., None], axis=(0, 1))
        return kept
