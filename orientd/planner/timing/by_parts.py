"""The quickest timing of a path with corners: smooth parts, each of them from rest to rest.

A curve whose velocity or acceleration has a step at a knot is passed there at rest; so is the end
of one that has a velocity there which nobody asked for.  The path stays what it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from orientd.curves import Trajectory
from orientd.planner.limits import Limits
from orientd.planner.path import PositionPath, repositioned
from orientd.planner.timing.axis_turn import SHARE
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.quickest_timing import FirstProfile, Profile, quickest
from orientd.rotation import Floats, angle

_STEP = 1e-6  # of the largest velocity and acceleration, between both sides of a knot
_REST = 1e-9  # of the largest velocity
_NEWTON_STEPS = 8
_PIECES = 32  # of a part at the least, in which its position is a quintic
_APART = 1e-9  # of a part's length, which pieces are longer than


@dataclass(frozen=True, slots=True, eq=False)
class RestingClock:
    r"""A clock on which a part of a path begins and ends at rest.

    Near an end where the path moves, its time goes like
    :math:`\ell (z^3 - z^4/2), z = x/\ell`, which has two continuous derivatives to where it goes
    like *x* again.

    Attributes:
        begin: path time where the part begins, a knot, s.
        end: where it ends, another one.
        knots: of the path in it, both ends included.
        lengths: over which it leaves rest, and comes to it; 0 where the path does not move.
    """

    begin: float
    end: float
    knots: Floats
    lengths: Floats

    @classmethod
    def of(cls, part: Trajectory, moves: tuple[bool, bool] = (False, False)) -> RestingClock:
        """Return the clock of a part.

        Args:
            part: smooth, where it is in the path.
            moves: whether something else moves at the beginning and at the end.
        """
        knots = part.knots
        middles = 0.5 * (knots[1:] + knots[:-1])
        _, omega, _ = part.sample(np.concatenate([knots[[0, -1]], middles]))
        speeds = np.linalg.norm(omega, axis=1)
        spans = np.diff(knots) * (1.0 if len(knots) > 2 else 0.5)
        is_moving = np.array(moves) | (speeds[:2] > _REST * speeds.max())
        return cls(*part.domain, knots, np.where(is_moving, 2.0 * spans[[0, -1]], 0.0))

    @property
    def duration(self) -> float:
        """Of the part by the clock, s."""
        return self.end - self.begin + 0.5 * float(self.lengths.sum())

    def retimed(self, part: Trajectory) -> Trajectory:
        """Return a part on the clock, from its time 0 on."""
        return Trajectory.fit(
            lambda times: part.orientations(self(times)[0]), self.times(self.knots)
        )

    def times(self, path_times: Floats) -> Floats:
        """Return when it is at given path times; at its ends for those beyond."""
        first, last = self.lengths.tolist()
        times: Floats = path_times - self.begin + 0.5 * first
        early = path_times < self.begin + 0.5 * first
        late = path_times > self.end - 0.5 * last
        times[early] = _left(np.maximum(path_times[early] - self.begin, 0.0), first)
        times[late] = self.duration - _left(np.maximum(self.end - path_times[late], 0.0), last)
        return times

    def __call__(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the path time and its first two derivatives by the clock."""
        first, last = self.lengths.tolist()
        path_times = self.begin + times - 0.5 * first
        rate, change = np.ones(len(times)), np.zeros(len(times))
        for length, ahead, sign in ((first, times, 1.0), (last, self.duration - times, -1.0)):
            near = ahead < length
            if near.any():
                z = np.maximum(ahead[near], 0.0) / length
                way = length * z**3 * (1.0 - 0.5 * z)
                path_times[near] = self.begin + way if sign > 0.0 else self.end - way
                rate[near] = z * z * (3.0 - 2.0 * z)
                change[near] = sign * 6.0 * z * (1.0 - z) / length
        return np.clip(path_times, self.begin, self.end), rate, change


def _left(ways: Floats, length: float) -> Floats:
    """Return when so much of the way has been gone that is gone while rest is left."""
    if not length:
        return np.zeros(len(ways))
    goal, z = ways / length, np.cbrt(ways / length)
    for _ in range(_NEWTON_STEPS):
        slope = z * z * (3.0 - 2.0 * z)
        z = z - np.divide(z**3 * (1.0 - 0.5 * z) - goal, slope, where=slope > 0.0, out=0.0 * z)
    return length * z


def corners(trajectory: Trajectory) -> Floats:
    """Return the knots inside a trajectory at which its velocity or acceleration has a step."""
    knots = trajectory.knots[1:-1]
    if trajectory.continuity >= 2 or not len(knots):
        return knots[:0]
    _, omega, alpha = trajectory.sample(np.concatenate([np.nextafter(knots, -np.inf), knots]))
    step = np.zeros(len(knots), dtype=bool)
    for rows in (omega, alpha):
        before, after = np.split(rows, 2)
        largest = np.linalg.norm(rows, axis=1).max()
        step |= np.linalg.norm(after - before, axis=1) > _STEP * largest
    return knots[step]


def least_with_stops(keys: Floats, limits: Limits) -> float:
    """Return what turns from key to key take at the least, from rest to rest, s.

    That is without limits of the jerk and of components.
    """
    turns = angle(keys[:-1], keys[1:])
    turns = turns[turns > 0.0]
    velocity, acceleration = limits.velocity, limits.acceleration
    peaks = np.minimum(np.sqrt(turns * acceleration), velocity)
    # Where neither is limited their quotient is not a number.
    rises = np.fmin(np.sqrt(turns / acceleration), velocity / acceleration)
    return float(np.sum(turns / peaks + rises))


def quickest_by_parts(
    keyframe_path: KeyframePath,
    limits: Limits,
    period: float,
    *,
    share: float = SHARE,
    guess: FirstProfile | Profile | None = None,
) -> KeyframePath:
    """Return the same path in the shortest time that keeps the limits, at rest at its corners.

    Args:
        keyframe_path: any, whose position is at rest at both ends.
        limits: as for :func:`quickest`, like all that have the same name.
        period: likewise.
        share: likewise.
        guess: likewise, for a path without corners from rest to rest.

    Raises:
        PlanError: none was found.
    """
    trajectory, total = keyframe_path.trajectory, keyframe_path.duration
    edges = [0.0, *corners(trajectory).tolist(), total]
    if len(edges) == 2 and keyframe_path.is_from_rest_to_rest:
        return quickest(keyframe_path, limits, period, share=share, guess=guess)
    times, duration = np.zeros(len(keyframe_path.times)), 0.0
    positions = PositionPath.held(keyframe_path.positions.first)
    parts: list[Trajectory] = []
    for first, last in pairwise(edges):
        part = trajectory.restricted(first, last)
        clock = RestingClock.of(part, (_moves(keyframe_path, first), _moves(keyframe_path, last)))
        path = KeyframePath(
            clock.retimed(part),
            _positions_of(keyframe_path, clock),
            clock.times(keyframe_path.times),
        )
        quick = quickest(path, limits, period, share=share)
        parts.append(quick.trajectory.shifted(duration))
        positions = quick.positions.delayed(duration).after(positions)
        times += np.clip(quick.times, 0.0, quick.duration)
        duration += quick.duration
    if len(parts) == 1:
        return quick
    return KeyframePath(Trajectory.joined(parts), positions, times)


def _moves(keyframe_path: KeyframePath, time: float) -> bool:
    """Return whether the position moves at a path time."""
    return bool(np.any(keyframe_path.positions.state(time)[1]))


def _positions_of(keyframe_path: KeyframePath, clock: RestingClock) -> PositionPath:
    """Return what the position does during a part of a path, on the clock of that part."""
    positions = keyframe_path.positions
    if positions.is_held:
        return positions
    end = clock.duration
    knots = clock.times(np.concatenate([positions.breaks, clock.knots]))
    nodes = np.unique(np.concatenate([knots, np.linspace(0.0, end, _PIECES + 1)]))
    nodes = nodes[np.append(np.diff(nodes) > _APART * end, True)]
    nodes[0] = 0.0
    moved = repositioned(positions, clock, nodes)
    first, last = positions.sample(clock(nodes[[0, -1]])[0])[0]
    return replace(moved, first=first, last=last)
