"""The fastest timing of a keyframe path: along itself as fast as its limits permit.

The problem is Bobrow's: velocity, acceleration and jerk limits of a motion along a given path
(Bobrow, Dubowsky and Gibson 1985; Pham and Pham 2018 for current methods).  The limits hold for
norms and components of vectors of the rotation group.  Angular velocity and acceleration are as
linear in the derivatives of the parameter as on any other path.

The squared path velocity is found on a mesh that is fine where it changes fast; see
``orientd/kernels/c/timing.h`` and ``profile.h``.

A curve whose velocity or acceleration has a step at a knot rests there.  It also rests at an end
with a velocity that the request did not ask for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from orientd.curves.trajectory import TimeMap, Trajectory
from orientd.errors import PlanError
from orientd.kernels import time_quickest
from orientd.model.limits import Limits
from orientd.planner import refusal
from orientd.planner.certify.measuring import limit_table
from orientd.planner.timing.axes import NO_AXES, AxisPath
from orientd.planner.timing.axis_turn import SHARE, VELOCITY_SHARE, turned_at_once, usable
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.rotation import Floats, angle

_STEP = 1e-6  # share of the peak velocity and acceleration that is a step at a knot
_ROOTS = np.array([1.0, 1 / 2, 1 / 3])  # of shares of velocity, acceleration and jerk, for a pace

# Rows of a profile, see timing.h.
_SHARES, _AIMS, _PLACES, _TIMES, _ROWS = 1, 4, 7, 10, 11
_MOST_ABOVE = 1.0005  # share of a velocity that the tolerance of a certificate has room for
_PART = 7  # numbers of a part
_SAME_TIME = 1e-9  # s


def aimed_at(limits: Limits, turn: float = 0.0) -> Limits:
    """Return the limits of the fastest timing of a path.

    Args:
        turn: the length of the path, rad; a path without a length needs no more than the usual
            reserve for a stop.
    """
    full = limits.velocity, limits.acceleration, limits.jerk
    used = usable(turn, *full) if turn and math.isfinite(limits.acceleration) else full
    velocity, acceleration, jerk = (
        min(part / whole, share) if math.isfinite(whole) else share
        for part, whole, share in zip(used, full, (VELOCITY_SHARE, SHARE, SHARE), strict=True)
    )
    return limits.times(
        velocity=velocity,
        acceleration=acceleration,
        jerk=jerk,
        linear_velocity=VELOCITY_SHARE,
        linear_acceleration=acceleration,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """The squared path velocity on a mesh of *n* elements, a quadratic spline.

    Attributes:
        rows: in the layout of ``orientd/kernels/c/timing.h``, shape ``(11, n + 2)``, read only.
        leaves: lengths over which the path leaves rest, shape ``(2,)``.
        moves: whether the path moves at its start and at its end.
        span: path times of the start and the end of its part, s.
    """

    rows: Floats
    leaves: Floats
    moves: tuple[bool, bool]
    span: tuple[float, float]

    @property
    def duration(self) -> float:
        """Duration of the part, s."""
        return float(self.rows[_TIMES, -2])

    @property
    def slower(self) -> float:
        """Factor by which to slow down if a utilisation is above 1; otherwise 1."""
        shares = self.rows[_SHARES:_AIMS, :-2].max(1)
        return max(1.0, float(np.max(shares**_ROOTS)))

    @property
    def above(self) -> float:
        """Largest share of a velocity if an end moves, so that it cannot be slowed down; or 1."""
        return float(self.rows[_SHARES, :-2].max()) if any(self.moves) else 1.0

    def clock(self) -> TimeMap:
        """Return the path time since the start of the part as a function of time."""
        places, values, slopes, times = self.rows[_PLACES:, :-1]
        return TimeMap(times, places, values, slopes, self.leaves)


@dataclass(frozen=True, slots=True, eq=False)
class QuickPath(KeyframePath):
    """A path in the shortest time that keeps a share of the limits.

    Attributes:
        profile: its timing; ``None`` for a single turn, and for a path with rests.
    """

    profile: Profile | None = None


def profiles(
    path: KeyframePath,
    limits: Limits,
    period: float,
    *,
    rests: Floats | None = None,
    axes: AxisPath = NO_AXES,
) -> list[Profile]:
    """Return the fastest profiles of the parts of a path.

    Args:
        rests: knots between which there are parts, both ends included, s, shape ``(p + 1,)``: each
            of them is from rest to rest.  ``None`` leaves the path in one part, with its ends as
            they are.
        axes: of the device, along the path.

    Raises:
        PlanError: a part has no profile.
    """
    trajectory = path.trajectory
    aims = aimed_at(limits, _length(trajectory))
    found = time_quickest(
        trajectory.breaks,
        trajectory.pieces,
        trajectory.knots,
        trajectory.knots[[0, -1]] if rests is None else rests,
        rests is not None,
        *path.moves,
        limit_table(aims),
        np.array([aims.linear_velocity, aims.linear_acceleration]),
        period,
        axes.breaks,
        axes.pieces,
        axes.limits,
    )
    if isinstance(found, bool):
        why = "it would have to stand still on the way" if found else "the limits allow no timing"
        raise PlanError(f"no quickest timing was found: {why}")
    parts = np.frombuffer(found[1]).reshape(-1, _PART)
    ends = np.cumsum(parts[:-1, 0].astype(np.intp) + 2)
    rows = np.split(np.frombuffer(found[0]).reshape(_ROWS, -1), ends, axis=1)
    return [
        Profile(np.ascontiguousarray(some), part[1:3], (bool(part[3]), bool(part[4])), span)
        for some, part, span in zip(rows, parts, parts[:, 5:].tolist(), strict=True)
    ]


def _length(trajectory: Trajectory) -> float:
    """Return the approximate length of a trajectory, rad."""
    knots = trajectory.orientations(trajectory.knots)
    return float(angle(knots[:-1], knots[1:]).sum())


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


def quickest(
    path: KeyframePath,
    limits: Limits,
    period: float,
    *,
    has_rests: bool = False,
    axes: AxisPath = NO_AXES,
) -> KeyframePath:
    """Return the same path in the shortest time found within the limits.

    An end at rest stays at rest, and gets no acceleration if the jerk is limited.  A moving end
    keeps its velocity and acceleration.

    Args:
        path: with continuous acceleration, or at rest at its corners.
        has_rests: whether to begin and end at rest, and to rest at corners.
        axes: of the device, along the path.

    Raises:
        PlanError: none was found.
    """
    inner = corners(path.trajectory) if has_rests else ()
    rests = None
    if len(inner) or (has_rests and not _rests_at_ends(path)):
        rests = np.concatenate([[0.0], inner, [path.duration]])
    elif axes is NO_AXES:
        turn = turned_at_once(path, limits)
        if turn is not None:
            return replace(turn, notes=path.notes)
    found = profiles(path, limits, period, rests=rests, axes=axes)
    above = max(one.above for one in found)
    if axes is not NO_AXES and above > _MOST_ABOVE:
        found = profiles(path, limits, period, rests=rests, axes=axes.below(above))
    parts = [_at_limits(retimed(path, one)) for one in found]
    quick: KeyframePath = parts[0]
    if len(parts) > 1:
        # A keyframe is at the end of every part before it, and at the start of every one after it.
        times = np.sum([part.times for part in parts], axis=0)
        quick = KeyframePath.joined(parts, times, path.notes)
    refusal.check_duration(quick.duration)
    return quick


def _rests_at_ends(path: KeyframePath) -> bool:
    """Return whether orientation and position begin and end at rest."""
    ends = path.positions.state(0.0), path.positions.state(path.duration)
    return path.is_from_rest_to_rest and not any(velocity.any() for _, velocity, _ in ends)


def retimed(path: KeyframePath, profile: Profile) -> QuickPath:
    """Return the part of a path that belongs to a profile, timed by it, from time 0 on."""
    clock, trajectory = profile.clock(), path.trajectory
    begin, end = profile.span
    if (begin, end) != trajectory.domain:
        trajectory = trajectory.restricted(begin, end)

    def path_times(times: Floats) -> tuple[Floats, Floats, Floats]:
        s, rate, change = clock(times)
        return begin + s, rate, change

    positions = path.positions.retimed(path_times, clock.times)
    times = clock.times_of(path.times - begin)
    # Corners are where parts meet, at rest.
    smooth = replace(clock.retimed(trajectory), continuity=2)
    slews = tuple(
        one.moved(lambda at: clock.times_of(at - begin))
        for one in path.slews
        if begin - _SAME_TIME < one.begin and one.end < end + _SAME_TIME
    )
    return QuickPath(smooth, positions, times, path.notes, path.missed, slews, profile)


def _at_limits(quick: QuickPath) -> QuickPath:
    """Return a path at the speed of its profile, slowed down by a small excess of it."""
    profile = quick.profile
    if profile is None or any(profile.moves):
        return quick
    return quick.slowed(quick.duration * profile.slower)
