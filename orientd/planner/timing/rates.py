"""Limited rates along a path: what velocity, acceleration and jerk are at any pace."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from orientd.planner.limits import ANGULAR
from orientd.planner.timing.profile import Profile
from orientd.planner.timing.timing import Indices
from orientd.rotation import Floats

_SLACK = 1.00005  # by which to aim lower than necessary
_SPARE = 1.0002  # by which to aim lower than the limits of velocity


@dataclass(frozen=True, slots=True, eq=False)
class LimitedRate:
    """A limited rate along the path, at four places in every step.

    Attributes:
        name: of the quantity that is limited.
        order: of the derivative, 1 to 3.
        columns: what *y*, *y'* and *y''* contribute, in units of the limit, shape ``(3, m, k)``;
            the rate is their sum, times the square root of *y* for odd orders.
        aim: what to divide the limit by, at every other place.
        near: the only ones of these other places to look at; ``None`` for all.
    """

    name: str
    order: int
    columns: Floats
    aim: Floats
    near: Indices | None = None

    @classmethod
    def of(cls, name: str, derivatives: Floats, limit: float) -> LimitedRate:
        """Return the rate of a path with given derivatives by the parameter, ``(3, m, k)``."""
        p, pp, ppp = derivatives / limit
        order = next(k for k, word in enumerate(ANGULAR, 1) if name.endswith(word))
        # Velocities have no reserve that could take up what lies between the places.
        aim = _SPARE if order == 1 else 1.0
        rows = ((p, 0.0 * p, 0.0 * p), (pp, 0.5 * p, 0.0 * p), (ppp, 1.5 * pp, 0.5 * p))
        return cls(name, order, np.stack(rows[order - 1]), np.full(len(p[::2]), aim))

    @property
    def aimed(self) -> Floats:
        """The columns where the search looks, in units of what is aimed at."""
        columns: Floats = self.columns[:, ::2] * self.aim[:, None]
        return columns

    def beside(self, near: Indices, shift: int) -> LimitedRate:
        """Return the rate at some places, with the path's own part that it has *shift* further on.

        Args:
            near: of the places that are looked at.
            shift: in quarters of a step.
        """
        columns = self.columns.copy()
        columns[0, 2 * near] = columns[0, 2 * near + shift]
        return replace(self, columns=columns, near=near)

    def aiming_lower(self, profile: Profile, excess: float) -> LimitedRate:
        """Return the rate with lower aims where a profile exceeds the limit.

        Args:
            profile: found with the present aims.
            excess: share of the limit to aim lower by everywhere, if it is more than 1.
        """
        z = np.empty((3, self.columns.shape[1]))
        for quarter in range(4):
            z[:, quarter::4] = profile.at(0.25 * quarter)
        shares = np.sqrt(np.sum(np.einsum("ank,an->nk", self.columns, z) ** 2, axis=-1))
        if self.order != 2:
            shares *= np.sqrt(z[0])
        around = np.maximum(np.append(shares[1::2], 0.0), np.append(0.0, shares[1::2]))
        lower = np.where(around > 1.0, around * _SLACK, 1.0)
        if excess > 1.0:
            lower = np.maximum(lower, excess * _SLACK)
        return replace(self, aim=self.aim * lower)
