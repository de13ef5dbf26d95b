"""The keyframe path of a motion, and the request that it is made from.

The **keyframe path** is the part of a motion from the first keyframe to the last; leads come before
and after it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from orientd.curves import Trajectory
from orientd.errors import PlanError
from orientd.planner import refusal
from orientd.planner.certify import Peaks, measure
from orientd.planner.limits import STILL, Limits, is_still
from orientd.planner.methods import Ends, build
from orientd.planner.path import Motion3, Path, PositionPath, position_path
from orientd.planner.recorded import HISTORY
from orientd.planner.request import MotionRequest, State
from orientd.planner.timing.timing import Indices
from orientd.rotation import Floats

_SAME = 1e-14  # of quaternions that are the same to rounding


@dataclass(frozen=True, slots=True, eq=False)
class KeyframePath:
    """A trajectory through the keyframes, from path time 0 on.

    Attributes:
        trajectory: the orientations.
        positions: what the position does.
        times: of all keyframes of the request, s.
        found: period, limits and peaks of the records from hold to hold, once these were looked at.
        stop_time: how long a certain stop takes where it is slowest, about, s; ``None`` where
            nobody looked.
        is_turn: whether it is the quickest turn about one axis.
    """

    trajectory: Trajectory
    positions: PositionPath
    times: Floats
    found: tuple[float, Limits, Peaks] | None = None
    stop_time: float | None = None
    is_turn: bool = False

    @property
    def duration(self) -> float:
        """From the first keyframe to the last, s."""
        return self.trajectory.duration

    @property
    def continuity(self) -> int:
        """How many derivatives of the orientation are continuous."""
        return self.trajectory.continuity

    def has_acceleration_of(self, state: State, limits: Limits) -> bool:
        """Return whether it begins with the acceleration of *state*."""
        _, _, alpha = self.trajectory.ends()
        return is_still(np.zeros(3), alpha[0] - state.alpha_body, limits)

    @property
    def is_from_rest_to_rest(self) -> bool:
        """Whether neither end turns."""
        _, omega, _ = self.trajectory.ends()
        return all(math.hypot(*one) <= STILL for one in omega.tolist())

    def held_ends(self, limits: Limits) -> tuple[bool, bool]:
        """Return whether the device may hold right before it, and right after it."""
        _, omega, alpha = self.trajectory.ends()
        first, last = (is_still(*rates, limits) for rates in zip(omega, alpha, strict=True))
        return first, last

    def is_held_at_both_ends(self, limits: Limits) -> bool:
        """Return whether neither end needs a lead of its own."""
        return all(self.held_ends(limits))

    def slowed(self, duration: float) -> KeyframePath:
        """Return the same orientations taking *duration* seconds."""
        factor = duration / self.duration
        positions = self.positions if self.positions.is_held else self.positions.slowed(factor)
        return replace(
            self,
            trajectory=self.trajectory.slowed(duration),
            positions=positions,
            times=self.times * factor,
            found=None,
            stop_time=None,
        )

    def in_total(self, total: float | None) -> KeyframePath:
        """Return the same path taking *total* seconds, which are no fewer; as it is for ``None``.

        Raises:
            TotalError: it takes longer.
        """
        if total is None:
            return self
        refusal.check_total(total, self.duration)
        return self.slowed(max(total, self.duration))

    def found_as_whole(
        self, path: Path, start: State, period: float, limits: Limits
    ) -> Peaks | None:
        """Return what was found on the records of *path* from a state on, if that is all of it."""
        is_same = path.trajectory is self.trajectory and start.is_at_rest and start.before is None
        if self.found is None or not is_same or self.found[:2] != (period, limits):
            return None
        is_there = bool((start.position == self.positions.first).all())
        is_here = float(np.abs(start.q - path.first).max()) < _SAME
        return self.found[2] if is_here and is_there else None

    def record_count(self, period: float) -> int:
        """Return how many records a period apart it has."""
        return round(self.duration / period) + 1

    def peaks(self, period: float, limits: Limits, last: int | None = None) -> Peaks:
        """Return the largest backward differences of the keyframe path alone, or of a part of it.

        Where it begins or ends at rest the device is held before or after; elsewhere a lead, which
        has limits of its own, goes on with the same acceleration.

        Args:
            period: time between the records, s.
            limits: what the peaks are held against.
            last: the last record to look at; ``None`` is the end of the keyframe path.
        """
        final = self.record_count(period) - 1
        last = final if last is None else last
        is_held, holds_after = self.held_ends(limits)
        path = Path(self.trajectory, self.positions)
        before = np.tile(path.first, (HISTORY, 1)), np.tile(self.positions.first, (HISTORY, 1))
        return measure(
            path,
            last + 1,
            period,
            limits,
            before=before if is_held else None,
            rests=(is_held, holds_after and last == final),
        )


@dataclass(frozen=True, slots=True, eq=False)
class PathRequest:
    """What a keyframe path is made from.

    Attributes:
        request: what was asked for.
        ends: velocities at the first and last keyframe.
        times: of all keyframes of the request, from 0 on, in any unit.
        kept: indices of those that the curve passes; the others repeat one of them.
        halt: how the position comes to rest; it stays there where nothing asks for another.
        first: position, velocity and acceleration that the path request takes over; ``None`` where
            the position is at rest at the first keyframe.
    """

    request: MotionRequest
    ends: Ends
    times: Floats
    kept: Indices
    halt: PositionPath
    first: Motion3 | None = None

    @property
    def has_one_shape(self) -> bool:
        """Whether another duration is the same curve at another rate: nothing moves at its ends."""
        return self.first is None and not any(self.ends.moves)

    def keyframe_path(self, duration: float) -> KeyframePath:
        """Return the keyframe path that takes *duration* seconds.

        Raises:
            PlanError: the method cannot join these keyframes.
        """
        times = self.times * (duration / self.times[-1])
        times[-1] = duration
        keys, turns = self.request.keys[self.kept], self.request.turns[self.kept]
        curve = build(self.request, keys, times[self.kept], turns, self.ends)
        try:
            trajectory = curve.trajectory
        except ValueError as error:
            raise PlanError(f"{self.request.method} has no smooth curve here: {error}") from error
        if trajectory.domain != (0.0, duration):
            trajectory = trajectory.shifted(-trajectory.domain[0]).slowed(duration)
        return KeyframePath(trajectory, self._position_path(times[self.kept]), times)

    def _position_path(self, times: Floats) -> PositionPath:
        positions = self._positions()
        few = positions is None or np.count_nonzero(np.isfinite(positions[:, 0])) < 2
        if self.first is not None and few:
            return self.halt
        return position_path(times, positions, self.halt.last, self.first)

    def _positions(self) -> Floats | None:
        """Return the positions of the kept keyframes, taken from their repetitions if need be."""
        positions = self.request.positions
        if positions is None or len(self.kept) == len(positions):
            return positions
        kept: Floats = positions[self.kept].copy()
        owner = np.searchsorted(self.kept, np.arange(len(positions)), side="right") - 1
        for index in np.flatnonzero(np.isfinite(positions[:, 0])):
            if not np.isfinite(kept[owner[index], 0]):
                kept[owner[index]] = positions[index]
        return kept
