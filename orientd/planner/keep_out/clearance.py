r"""The least clearance of a motion from its keep-out cones, with a bound between its records.

The clearance is computed at every record.  Between two of them, *h* apart, the tool turns with at
most the angular velocity *V* and the angular acceleration *A*, which
:func:`rates_between` proves.  The angle *c* of its axis from the direction of a
cone changes with

.. math:: |\dot c| \le V, \qquad |\ddot c| \le A + V^2 (\tfrac12 + |\cot c|) .

The cotangent is the curvature of the circles of a constant angle.  A turn about the axis bends its
way by at most half of the square of the velocity.  So *c* lies at most :math:`h^2/8`
times the second bound below the lower one of its two neighbours, and at most :math:`hV/2` below
their mean.  The direction of a cone may move, which adds to *V*.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from orientd.keep_out import KeepOut
from orientd.mechanism.figure import Figure
from orientd.model.request import MotionRequest
from orientd.planner.motion import Motion
from orientd.rotation import Floats, conjugate, log, multiply, right_jacobian_inverse, rotate
from orientd.sun import Sun

LEAST_STEP = 2e-7
"""Least acceleration step that the law between two records knows, rad per squared period."""

_STEP = 13.0
r"""Bound of the step, in sizes of its trace in the records.

The trace is :math:`(d m, d n)` with :math:`m = w - 1/2`, :math:`n = w^2 - 1/3` and *w* from 0 to 1,
whose size is at least *d* / 13.
"""


def rates_between(rows: Floats, period: float) -> tuple[Floats, Floats]:
    r"""Return proven bounds of the angular velocity and acceleration between records.

    Between two records the rotation vector *r* from the first one is a cubic of the share *u* of
    the period, plus :math:`\tfrac12 d \max(u - f, 0)^2` at a step *d* of the acceleration
    (:mod:`orientd.servo.path.segment`).  So its derivative lies in the hull of three Bernstein
    coefficients, and its second derivative is largest at an end.  The step changes value and slope
    at the ends if the cubic does not change too.  That moves the derivative by at most *d* / 2 and
    the second one by at most 4 *d* / 3.  For the angular velocity and acceleration,

    .. math::
        |\omega| \le |\dot r|, \qquad |\alpha| \le |\ddot r| + \tfrac14 |r|\, |\dot r|^2 ,

    since the right Jacobian shortens vectors, and since its derivative begins with
    :math:`\tfrac16 [\dot r]_\times [r]_\times \dot r`.

    Args:
        rows: orientations, angular velocities (rad/s) and accelerations (rad/s^2) in the body
            frame, shape ``(n, 10)`` or wider.
        period: time between records, s.

    Returns:
        Norms in rad/s and rad/s^2, both of shape ``(n - 1,)``.
    """
    q, omega, alpha = rows[:, :4], period * rows[:, 4:7], period**2 * rows[:, 7:10]
    turn = log(multiply(conjugate(q[:-1]), q[1:]))
    begin, there = omega[:-1], omega[1:]
    end = np.einsum("nij,nj->ni", right_jacobian_inverse(turn), there)
    second, third = 3.0 * turn - 2.0 * begin - end, begin + end - 2.0 * turn
    step = _steps(turn, begin, there, alpha[:-1], alpha[1:] - alpha[:-1])
    speed = np.max([_sizes(begin), _sizes(begin + second), _sizes(end)], axis=0) + 0.5 * step
    bend = np.maximum(2.0 * _sizes(second), 2.0 * _sizes(second + 3.0 * third))
    bend += 4.0 / 3.0 * step + 0.25 * _sizes(turn) * speed**2
    return speed / period, bend / period**2


def _steps(turn: Floats, begin: Floats, end: Floats, alpha: Floats, rise: Floats) -> Floats:
    """Return bounds of the acceleration steps, in rad per squared period."""
    found = end - begin - alpha - 0.5 * rise
    other = 2.0 * (turn - begin) - alpha - rise / 3.0 - np.cross(begin, end) / 6.0
    size = np.hypot(_sizes(found), _sizes(other))
    return np.where(size >= LEAST_STEP, _STEP * size, 0.0)


def _sizes(vectors: Floats) -> Floats:
    found: Floats = np.sqrt(np.einsum("ni,ni->n", vectors, vectors))
    return found


_BLOCK = 8192  # records at a time, to bound memory
_SUN_STEP = 1.0  # s between two directions of the sun; it turns by 7e-5 rad meanwhile
_FALLS = 1e-9  # rad; rounding of a clearance that must not fall
_POLE = 1e-3  # rad; least angle from the direction with a bounded curvature


@dataclass(frozen=True, slots=True, eq=False)
class Cones:
    """The keep-out cones of a motion.

    Attributes:
        cones: at least one.
        unix_ns: Unix time at the beginning of the motion, ns.
    """

    cones: Sequence[KeepOut]
    unix_ns: int

    @classmethod
    def of(cls, cones: Sequence[KeepOut], unix_ns: int | None) -> Cones:
        """Return the cones of a motion that begins at a Unix time, ns.

        Raises:
            ValueError: a cone moves, and no time is given.  The planner has no clock of its own:
                a request that is planned again gives the same motion.
        """
        if unix_ns is None and any(isinstance(cone.direction, Sun) for cone in cones):
            raise ValueError("expected unix_ns, the time of the motion: a keep-out cone moves")
        return cls(cones, unix_ns or 0)

    def later(self, seconds: float) -> Cones:
        """Return the cones of a motion that begins later."""
        return replace(self, unix_ns=self.unix_ns + round(1e9 * seconds))

    def directions(self, cone: KeepOut, times: Floats) -> Floats:
        """Return unit vectors towards a cone at increasing path times, s, shape ``(n, 3)``."""
        if not isinstance(cone.direction, Sun):
            return np.broadcast_to(np.array(cone.direction), (len(times), 3))
        first = math.floor(float(times[0]) / _SUN_STEP)
        last = math.floor(float(times[-1]) / _SUN_STEP) + 1
        grid = _SUN_STEP * np.arange(first, last + 1)
        table = np.array([cone.direction_at(self.unix_ns + round(1e9 * t)) for t in grid.tolist()])
        found = np.stack([np.interp(times, grid, column) for column in table.T], axis=1)
        return unit(found)

    def clearances(self, q: Floats, times: Floats) -> Floats:
        """Return the clearance of each cone at orientations, rad.

        Args:
            q: shape ``(n, 4)``.
            times: path times, s, increasing, shape ``(n,)``.

        Returns:
            Shape ``(cones, n)``.
        """
        return np.array(
            [
                angles(rotate(q, np.array(cone.axis)), self.directions(cone, times))
                - cone.half_angle
                for cone in self.cones
            ]
        )

    def least(self, q: Floats, times: Floats, *, margins: float = 0.0) -> Floats:
        """Return the least clearance of all cones, rad, shape ``(n,)``.

        Args:
            q: orientations, shape ``(n, 4)``.
            times: path times, s, increasing, shape ``(n,)``.
            margins: share of each margin that belongs to the cone.
        """
        found = self.clearances(q, times)
        found -= margins * np.array([[cone.margin] for cone in self.cones])
        least: Floats = found.min(axis=0)
        return least

    def bounds(self, motion: Motion) -> Floats:
        """Return the least clearance of each cone in each interval between records, rad.

        Returns:
            Shape ``(cones, n - 1)``, or ``(cones, 1)`` for a single record; infinite while a motion
            that begins inside a cone moves out.
        """
        bound, found = self._bounded(motion)
        if found.shape[1] > 1:
            for row, at in zip(bound, found, strict=True):
                row[: _moving_out(at)] = math.inf
        return bound

    def _bounded(self, motion: Motion) -> tuple[Floats, Floats]:
        """Return the least clearance of each cone in each interval, and at each record, rad.

        Returns:
            Shape ``(cones, n - 1)``, or ``(cones, 1)`` for a single record; and ``(cones, n)``.
        """
        period = motion.period
        found, speed, bend = self._along(motion)
        if found.shape[1] == 1:
            return found, found
        half = np.array([[cone.half_angle] for cone in self.cones])
        moves = np.array([[cone.fastest] for cone in self.cones])
        fastest = speed + moves
        lower = np.minimum(found[:, :-1], found[:, 1:])
        mean = 0.5 * (found[:, :-1] + found[:, 1:])
        nearest = np.maximum(half + mean - fastest * period, _POLE)
        curved = bend + fastest**2 * (0.5 + 1.0 / np.abs(np.tan(nearest)))
        bound: Floats = np.maximum(lower - period**2 / 8.0 * curved, mean - 0.5 * period * fastest)
        return bound, found

    def _along(self, motion: Motion) -> tuple[Floats, Floats, Floats]:
        """Return clearances at records ``(cones, n)``, and bounds of the rates between them."""
        clear, speeds, bends = [], [], []
        for first in range(0, motion.record_count, _BLOCK):
            count = min(_BLOCK, motion.record_count - first)
            # The first record of the next block ends the last interval of this one.
            rows = motion.rows(first, min(count + 1, motion.record_count - first))
            times = motion.period * np.arange(first, first + count, dtype=np.float64)
            clear.append(self.clearances(rows[:count, :4], times))
            speed, bend = rates_between(rows, motion.period)
            speeds.append(speed)
            bends.append(bend)
        return np.concatenate(clear, axis=1), np.concatenate(speeds), np.concatenate(bends)

    def are_kept(self, motion: Motion) -> bool:
        """Return whether a motion stays out of all cones and their margins."""
        margins = np.array([[cone.margin] for cone in self.cones])
        return bool(np.all(self.bounds(motion) >= margins))

    def certified(self, motion: Motion, request: MotionRequest) -> Motion:
        """Return a motion with the clearances in its certificate, and the cones of its request."""
        found = motion.certificate
        figures = (*found.figures, *self.figures(motion))
        return replace(
            motion,
            request=replace(motion.request, keep_out=request.keep_out),
            certificate=replace(found, figures=figures),
            keep_out=tuple(cone.frozen(self.unix_ns) for cone in self.cones),
        )

    def figures(self, motion: Motion) -> list[Figure]:
        """Return the least clearance of each cone along a motion; negative inside of it."""
        figures = []
        for cone, row in zip(self.cones, self._bounded(motion)[0], strict=True):
            place = int(np.argmin(row))
            figures.append(
                Figure(
                    f"keep-out {cone.name}", float(row[place]), "rad", None, place * motion.period
                )
            )
        return figures


def _moving_out(clearance: Floats) -> int:
    """Return the first record outside, if a motion begins inside and only moves out; else 0."""
    first = int(np.argmax(clearance >= 0.0))
    rises = np.diff(clearance[: first + 1])
    return first if bool(np.all(rises >= -_FALLS)) else 0


def angles(a: Floats, b: Floats) -> Floats:
    """Return the angles between unit vectors, rad, shape ``(n,)``."""
    found: Floats = np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))
    return found


def unit(vectors: Floats) -> Floats:
    """Return vectors of length one in the same directions, shape ``(n, 3)``."""
    found: Floats = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return found
