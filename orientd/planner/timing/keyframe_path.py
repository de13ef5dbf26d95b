"""A path through keyframes; with its leads it becomes a motion."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np

from orientd.curves.trajectory import Trajectory
from orientd.mechanism.way import Slew, Way
from orientd.model.limits import STILL, Limits, is_still
from orientd.planner import refusal
from orientd.planner.path import PositionPath, end_states
from orientd.planner.state import State
from orientd.rotation import Floats

_NO_MOVES = np.empty(0), np.empty((0, 18))


@dataclass(frozen=True, slots=True, eq=False)
class KeyframePath:
    """Orientation and position from path time 0 on, and the times of the keyframes.

    Attributes:
        trajectory: the orientations.
        positions: the position.
        times: of all keyframes of the request, s.
        notes: notes for the certificate.
        missed: largest angle by which it deviates from the requested path, rad.
        slews: in order.
    """

    trajectory: Trajectory
    positions: PositionPath
    times: Floats
    notes: tuple[str, ...] = ()
    missed: float = 0.0
    slews: tuple[Slew, ...] = ()

    @classmethod
    def joined(
        cls, parts: Iterable[KeyframePath], times: Floats, notes: tuple[str, ...] = ()
    ) -> KeyframePath:
        """Return paths end to end, except those that take no time.

        Args:
            parts: each begins where the previous one ends.
            times: of all keyframes, s.
            notes: notes of the whole.
        """
        parts = [part for part in parts if part.duration]
        begins = np.cumsum([0.0, *(part.duration for part in parts[:-1])]).tolist()
        positions = parts[0].positions
        for part, begin in zip(parts[1:], begins[1:], strict=True):
            positions = part.positions.delayed(begin).after(positions)
        laid = [part.trajectory.shifted(at) for part, at in zip(parts, begins, strict=True)]
        missed, slews = max(part.missed for part in parts), list[Slew]()
        for part, begin in zip(parts, begins, strict=True):
            slews += [one.moved(partial(np.add, begin)) for one in part.slews]
        whole = Trajectory.joined(laid)
        return KeyframePath(whole, positions, times, notes, missed, tuple(slews))

    @property
    def duration(self) -> float:
        """Duration, s."""
        return self.trajectory.duration

    @property
    def first(self) -> State:
        """The initial state."""
        begin, _ = end_states(self.trajectory)
        return replace(begin, position=self.positions.first)

    @property
    def is_from_rest_to_rest(self) -> bool:
        """Whether the angular velocity is zero at both ends."""
        _, omega, _ = self.trajectory.ends()
        return all(math.hypot(*one) <= STILL for one in omega.tolist())

    @property
    def moves(self) -> tuple[Floats, Floats]:
        """Breaks and coefficients of the position, shape ``(m + 1,)`` and ``(m, 18)``."""
        if self.positions.is_held:
            return _NO_MOVES
        return self.positions.breaks, self.positions.coefficients.reshape(-1, 18)

    def held_ends(self, limits: Limits) -> tuple[bool, bool]:
        """Return whether the device may hold just before it, and just after it."""
        _, omega, alpha = self.trajectory.ends()
        first, last = (is_still(*rates, limits) for rates in zip(omega, alpha, strict=True))
        return first, last

    @property
    def way(self) -> Way:
        """The orientations, and the times of the keyframes."""
        return Way(self.trajectory, self.times)

    def made_as(self, way: Way) -> Self:
        """Return the same path as the axes of a gimbal make it."""
        return replace(
            self,
            trajectory=way.trajectory,
            times=way.times,
            notes=(*self.notes, *way.notes),
            missed=max(self.missed, way.missed),
            slews=(*self.slews, *way.slews),
        )

    def slowed(self, duration: float) -> Self:
        """Return the same path with a duration of *duration* seconds."""
        factor, positions = duration / self.duration, self.positions
        return replace(
            self,
            trajectory=self.trajectory.slowed(duration),
            positions=positions if positions.is_held else positions.slowed(factor),
            times=self.times * factor,
            slews=tuple(one.moved(partial(np.multiply, factor)) for one in self.slews),
        )

    def since(self, time: float) -> KeyframePath:
        """Return the part after *time*, s, which is then its time 0."""
        return KeyframePath(
            self.trajectory.restricted(time, self.duration).shifted(-time),
            self.positions.since(time).delayed(-time),
            self.times - time,
            self.notes,
            self.missed,
            tuple(one.moved(partial(np.add, -time)) for one in self.slews),
        )

    def lasting(self, total: float) -> Self:
        """Return the same path, slowed down to *total* seconds.

        Raises:
            TotalError: it takes longer.
        """
        refusal.check_total(total, self.duration)
        return self.slowed(max(total, self.duration))
