r"""The axes of a mechanism along a path: their angles, and the limits that the timing keeps.

An axis is one more rate of the timing, a scalar.  With its angle :math:`q(x)` along the path and
:math:`y = \dot x^2`, its velocity is :math:`q' \sqrt y`, and its acceleration is
:math:`q'' y + q' y' / 2` (Bobrow, Dubowsky and Gibson 1985); see ``orientd/kernels/c/profile.h``.

Between two knots of the curve the path is smooth.  There the mechanism's own inverse kinematics
gives the angles at samples, seven of these the derivatives, and quintics the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from orientd.curves.quintic import quintics
from orientd.driver import AxisLimits, Joints
from orientd.mechanism import Gimbal, Mechanism
from orientd.mechanism.poles import made_by_two, rounding, turn_in, with_poles
from orientd.mechanism.routing import at_time, check_way, joints_along, made
from orientd.mechanism.turning import turned_along
from orientd.mechanism.way import Slew
from orientd.model.limits import Limits
from orientd.planner.certify.measuring import AxisRecords
from orientd.planner.path import Path, RecordedPath
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.rotation import Floats, angle

SHARE, VELOCITY_SHARE = 0.90, 0.9998
"""Shares of the limits of an axis that a timing uses: of acceleration and jerk, and of velocity.

The more of an acceleration it uses, the longer stops on the path take.  The rest also is for the
cubic between two records, which overshoots where the acceleration of a joint jumps.
"""

RISE = 2.0
"""Fewest periods in which an axis reaches its acceleration.

Setpoints between two records are poses, or cubics of the joints.  Both differ where an acceleration
jumps from one record to the next.
"""

_FEWEST, _COARSE = 24, 0.1
"""Fewest samples in an interval between two knots, and the largest turn of the tool from one to the
next, rad."""

_DENSE, _MOST = 8, 128
"""Factors of the fewest samples: from the first on an axis that jumps shows, and up to the second
they double."""

_EXACT = 1e-2
"""Largest change of an acceleration when the samples double, as a share of its limit."""

_NO_WAY = 1e-9  # rad and m, between two knots
_SAME_TIME = 1e-9  # s
_NEAR = 1e-3
"""Distance of the poses on both sides of a record that give the axis velocities there, periods."""

_STENCIL = 7  # samples of a finite difference
_COEFFICIENTS = 6  # of a quintic
_PLACES = np.linspace(0.0, 1.0, 5)  # in a piece


def on_the_way(_: float) -> str:
    """Return where a path is, if nothing more is known."""
    return "on the way to a keyframe"


@dataclass(frozen=True, slots=True, eq=False)
class AxisPath:
    """The angles of the axes along a path, in the layout of ``orientd/kernels/c/timing.h``.

    Attributes:
        breaks: path times, s, shape ``(m + 1,)``.
        pieces: quintics by the time since each begins, power by power, shape ``(m, 6 axes)``.
        limits: of velocity, acceleration and jerk of every axis, shape ``(3, axes)``.
        end: the angles at the end, rad.
    """

    breaks: Floats
    pieces: Floats
    limits: Floats
    end: Joints

    def excess(self, period: float) -> float:
        """Return the factor by which the path at its own pace should take longer for the axes.

        Args:
            period: of the device, s: a step of an acceleration takes at least as long.
        """
        if not self.limits.size:
            return 0.0
        first, second, third = (self._rates(order) for order in (1, 2, 3))
        step = np.abs(second[0, 1:] - second[-1, :-1]).max(0, initial=0.0) / period
        shares = [
            np.max(np.abs(first), (0, 1)) / self.limits[0],
            np.sqrt(np.max(np.abs(second), (0, 1)) / self.limits[1]),
            np.cbrt(np.max(np.abs(third), (0, 1)) / self.limits[2]),
            np.sqrt(step / self.limits[2]),
        ]
        return float(np.max(shares))

    def below(self, over: float) -> AxisPath:
        """Return the same axes with velocity limits lower by a factor."""
        return replace(self, limits=self.limits / [[over], [1.0], [1.0]])

    def _rates(self, order: int) -> Floats:
        """Return a derivative at places in every piece, shape ``(places, m, axes)``."""
        pieces = self.pieces.reshape(len(self.pieces), _COEFFICIENTS, -1)
        times = _PLACES[:, None] * np.diff(self.breaks)
        found: Floats = np.zeros((*times.shape, pieces.shape[2]))
        for k in range(order, _COEFFICIENTS):
            found += math.perm(k, order) * times[..., None] ** (k - order) * pieces[:, k]
        return found


NO_AXES = AxisPath(np.empty(0), np.empty((0, 0)), np.empty((3, 0)), ())
"""Of a device without axes."""


@dataclass(frozen=True, slots=True, eq=False)
class Axes:
    """The axes of a device before a motion.

    Attributes:
        mechanism: kinematics and limits.
        joints: the angles where the motion begins, rad; empty if unknown.
        before: planned angles of the previous cycles, if it begins in motion, oldest first; see
            :meth:`.RecordedMotion.joints_before`.
        rates: planned velocities there, rad/s.
        is_recorded: whether the records of the motion have them; otherwise the timing alone regards
            them.
        goal: the angles to which all axes turn together, rad; by default they follow the path.
    """

    mechanism: Mechanism
    joints: Joints
    before: Sequence[Joints] = ()
    rates: Joints = ()
    is_recorded: bool = True
    goal: Joints = ()

    @property
    def gives_roll(self) -> bool:
        """Whether they are two of a gimbal, which give the tool another roll than its path."""
        return isinstance(self.mechanism, Gimbal) and len(self.mechanism.axes) == 2

    @property
    def is_at_goal(self) -> bool:
        """Whether they are at the angles to which all of them turn, if there are any."""
        return not self.goal or math.dist(self.joints, self.goal) <= _NO_WAY

    def recorded(
        self,
        path: Path,
        count: int,
        period: float,
        missed: float = 0.0,
        slews: Sequence[Slew] = (),
    ) -> tuple[RecordedPath, AxisRecords]:
        """Return the records of a path, and the angles and velocities of the axes there.

        Args:
            path: from the beginning of the motion to rest.
            count: number of its records.
            period: between them, s.
            missed: largest angle by which it deviates from the requested path, rad.
            slews: of the path, in order.

        Raises:
            LimitError: an axis leaves its range.
            PlanError: a pose is out of reach, an axis jumps, or comes too near to a singularity.
        """
        times = period * np.arange(count, dtype=np.float64)
        near = _NEAR * period * np.array([-1.0, 0.0, 1.0])
        around = np.clip(times[:, None] + near, 0.0, path.duration)
        beside = around.ravel()
        samples = path.sample(beside)
        every = self._angles(slews, beside, samples.q, samples.position, self.joints)
        before, joints, after = every.reshape(count, len(near), -1).swapaxes(0, 1)
        joints = np.ascontiguousarray(joints)
        check_way(self.mechanism, joints, times)
        span = around[:, -1:] - around[:, :1]
        rates = np.divide(after - before, span, out=np.zeros_like(joints), where=span > 0.0)
        rates[-1] = 0.0
        is_moving = len(self.before) > 0
        if self.rates or not is_moving:
            rates[0] = self.rates or 0.0
        earlier = np.array(self.before) if is_moving else None
        q = np.ascontiguousarray(samples.q.reshape(count, len(near), 4)[:, 1])
        q, figures = made(self.mechanism, joints, q, period, missed)
        found_path = RecordedPath.of(q, times, path, period, joints, earlier, rates=rates)
        records = AxisRecords(joints, rates, found_path.earlier, self.mechanism.axes, figures)
        return found_path, records

    def made(self, path: KeyframePath, near: Callable[[], Joints]) -> KeyframePath:
        """Return the path that the axes make: two of a gimbal give it another roll.

        Args:
            path: as requested.
            near: returns the angles at its start, about, rad.

        Raises:
            LimitError: they leave more roll than the gimbal allows.
            PlanError: an axis would jump.
        """
        gimbal = self.mechanism
        if isinstance(gimbal, Gimbal) and self.gives_roll:
            return path.made_as(made_by_two(gimbal, path.way, near()))
        return path

    def along(
        self,
        path: KeyframePath,
        near: Joints,
        tool: Limits,
        period: float,
        share: float = SHARE,
        rise: float = RISE,
        place: Callable[[float], str] = on_the_way,
    ) -> AxisPath:
        """Return the angles along a path, sampled until their accelerations do not change any more.

        Args:
            path: within reach.
            near: angles at its start, about, rad.
            tool: limits of the tool, which bound the pace.
            period: of the device, s.
            share: of accelerations and jerks that the timing uses.
            rise: fewest periods in which an axis reaches its acceleration.
            place: returns where the path is at a path time, in words for a refusal.

        Raises:
            PlanError: the axes cannot go along it, at whatever pace.
        """
        breaks, pieces = [], []
        for span in pairwise(with_poles(self.mechanism, path.trajectory, _knots(path, period))):
            grid, joints, first, second = self._sampled(path, span, near, tool, period, place)
            near = tuple(joints[-1].tolist())
            breaks.append(grid[:-1])
            steps = np.diff(grid)
            pieces.append(quintics(steps, joints, first, second).reshape(len(steps), -1))
        return AxisPath(
            np.concatenate([*breaks, path.trajectory.knots[-1:]]),
            np.ascontiguousarray(np.concatenate(pieces)),
            _limits(self.mechanism.axes, share, rise * period),
            near,
        )

    def _angles(
        self,
        slews: Sequence[Slew],
        times: Floats,
        q: Floats,
        position: Floats,
        near: Joints,
        place: Callable[[float], str] = at_time,
    ) -> Floats:
        """Return the angles along a path, as from :func:`.joints_along`, and in its slews, rad."""
        mechanism, found, done = self.mechanism, list[Floats](), 0
        in_slews = [
            (
                slew,
                *np.searchsorted(times, [slew.begin - _SAME_TIME, slew.end + _SAME_TIME]).tolist(),
            )
            for slew in (slews if isinstance(mechanism, Gimbal) else ())
        ]
        for slew, first, last in [*in_slews, (None, len(times), len(times))]:
            if first > done:
                part = slice(done, first)
                last_of_part = slew.here if slew is not None and last > first else ()
                found.append(
                    joints_along(
                        mechanism, times[part], q[part], position[part], near, place, last_of_part
                    )
                )
                done = first
            if slew is not None and last > done and isinstance(mechanism, Gimbal):
                before = tuple(found[-1][-1].tolist()) if found else near
                found.append(turned_along(mechanism, slew, before, q[done:last]))
                done, near = last, slew.there
        return np.concatenate(found)

    def _sampled(
        self,
        path: KeyframePath,
        span: tuple[float, float],
        near: Joints,
        tool: Limits,
        period: float,
        place: Callable[[float], str],
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return path times, angles and their two derivatives in an interval between two knots."""
        mechanism, before = self.mechanism, None
        most = np.array([(axis.velocity, axis.acceleration) for axis in mechanism.axes])
        count = fewest = max(_FEWEST, math.ceil(turn_in(path.trajectory, span) / _COARSE))
        while True:
            grid = np.linspace(*span, count + 1)
            h = float(grid[1] - grid[0])
            q, position = path.trajectory.orientations(grid), path.positions.sample(grid)[0]
            joints = self._angles(path.slews, grid, q, position, near, place)
            check_way(mechanism, joints, grid, place, is_dense=count >= _DENSE * fewest)
            first, second = _derivatives(joints, h)
            if before is not None:
                pace = _most_square(path, grid, (first, second), most, tool)
                # No way takes less than a period.
                pace = np.minimum(pace, (path.duration / period) ** 2)
                with np.errstate(invalid="ignore"):
                    off = np.abs(second[::2] - before) * pace[::2, None] / most[:, 1]
                blur = rounding(mechanism, q) / h**2 * np.nanmax(pace)
                blurred = blur > _EXACT * most[:, 1].min()
                if not np.nanmax(off) > _EXACT or blurred or count >= _MOST * fewest:
                    return grid, joints, first, second
            before, count = second, 2 * count


def _knots(path: KeyframePath, period: float) -> list[float]:
    """Return the knots of a path between which it is smooth as far as differences can tell.

    In less than a period a path that hardly turns and moves differs from its neighbours by rounding
    alone.
    """
    knots = path.trajectory.knots
    q, position = path.trajectory.orientations(knots), path.positions.sample(knots)[0]
    ways = angle(q[:-1], q[1:]) + np.linalg.norm(np.diff(position, axis=0), axis=1)
    is_short = (np.diff(knots) < period) & (ways < _NO_WAY)
    is_kept = np.append(~is_short, True)
    is_kept[0] = True
    kept: list[float] = knots[is_kept].tolist()
    return kept


def _most_square(
    path: KeyframePath, grid: Floats, rates: tuple[Floats, Floats], most: Floats, tool: Limits
) -> Floats:
    """Return about the largest square of the pace that tool and axes permit, shape ``(n,)``."""
    first, second = (np.abs(one) for one in rates)
    _, omega, alpha = path.trajectory.sample(grid)
    with np.errstate(divide="ignore"):
        squares = [
            (tool.velocity / np.linalg.norm(omega, axis=1)) ** 2,
            2.0 * tool.acceleration / np.linalg.norm(alpha, axis=1),
            np.min((most[:, 0] / first) ** 2, axis=1),
            np.min(2.0 * most[:, 1] / second, axis=1),
        ]
    square = np.min(squares, axis=0)
    # At rest itself the pace is 0, whatever these permit.
    found: Floats = np.minimum(square, 4.0 * np.median(square))
    return found


def _limits(axes: Sequence[AxisLimits], share: float, rise: float) -> Floats:
    """Return the limits of a timing in which velocity and acceleration take *rise* s to come."""
    forces = [min(axis.acceleration, axis.velocity / rise) for axis in axes]
    jerks = [min(axis.jerk, force / rise) for axis, force in zip(axes, forces, strict=True)]
    velocities = [VELOCITY_SHARE * axis.velocity for axis in axes]
    return np.array([velocities, share * np.array(forces), share * np.array(jerks)])


@cache
def _weights() -> tuple[Floats, Floats]:
    """Return the finite differences of seven samples by the place of the sample, for h = 1.

    Returns:
        Of the first and the second derivative, exact up to degree six, shape ``(7, 7)``.
    """
    places = np.arange(_STENCIL, dtype=np.float64)
    first, second = np.zeros((2, _STENCIL, _STENCIL))
    for at in range(_STENCIL):
        powers = np.vander(places - at, increasing=True).T
        first[at] = np.linalg.solve(powers, np.eye(_STENCIL)[1])
        second[at] = np.linalg.solve(powers, 2.0 * np.eye(_STENCIL)[2])
    return first, second


def _derivatives(values: Floats, h: float) -> tuple[Floats, Floats]:
    """Return the first and the second derivative of samples, *h* apart, shape ``(n, axes)``."""
    middle = _STENCIL // 2
    windows = np.lib.stride_tricks.sliding_window_view(values, _STENCIL, axis=0)
    first, second = (
        np.concatenate(
            [
                table[:middle] @ values[:_STENCIL],
                windows @ table[middle],
                table[middle + 1 :] @ values[-_STENCIL:],
            ]
        )
        for table in _weights()
    )
    return first / h, second / h**2
