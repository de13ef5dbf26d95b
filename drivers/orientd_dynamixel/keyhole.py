r"""Passages near the pole: the least deviation with which the axes can follow.

Within a tube of error *E* the outer angle may lie within
:math:`\arcsin(\sin E / \rho)` of an exact one, :math:`\rho` the sine of the distance from the pole
(:mod:`orientd_dynamixel.kinematics`); where :math:`\rho \le \sin E` it is free, and the line may
come out on another branch.  For each branch to come out on, the taut string through the tube asks
the least rate that *E* allows, and *E* is bisected down to the rate that the axis has.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orientd.rotation import Floats
from orientd_dynamixel.certificate import AxisLimits, rates
from orientd_dynamixel.kinematics import LOCK, Gimbal
from orientd_dynamixel.stops import quintic
from orientd_dynamixel.tube import smooth, taut_string

_BRANCHES = (0, 1, -1, 2, -2)
_BISECTIONS = 20
_THROUGH = 2
"""So many samples at the pole belong to a path that goes straight through it."""
_CLOSE = 0.2
"""Share of an axis' limit from which a sample counts as near the pole."""


@dataclass(frozen=True, slots=True)
class Passage:
    """One way past the pole.

    Attributes:
        first: index of the last exact sample before it.
        last: index of the first exact sample after it.
        branch: by how many half turns the outer angle leaves its exact line.
        angles: axis angles from *first* to *last*, rad, unwrapped, shape ``(n, axes)``.
        error: largest angle by which the path is missed, rad.
    """

    first: int
    last: int
    branch: int
    angles: Floats
    error: float

    @property
    def kind(self) -> str:
        """What the outer axis does: ``pass``, ``flip`` or ``deviation``."""
        turn = abs(self.angles[-1, 0] - self.angles[0, 0])
        if turn > np.pi / 2:
            return "flip"
        return "pass" if self.branch % 2 else "deviation"


def outer_line(gimbal: Gimbal, matrix: Floats, first: float | None = None) -> tuple[Floats, Floats]:
    """Return one continuous line of exact outer angles, and the distance from the pole.

    Exact angles lie half a turn apart, so the line goes straight over the pole where the path does.
    Where the path stays at the pole any angle is exact, and the outer axis alone turns the tool, as
    the driver has it: the line may jump where the path leaves in another direction.

    Args:
        gimbal: whose.
        matrix: as from :meth:`.Gimbal.matrix`, shape ``(n, 3, 3)``.
        first: the outer angle where the path begins, rad, for one that begins at the pole; by
            default that with which it leaves the pole.

    Returns:
        Angles in rad and the sine of the distance from the pole, both of shape ``(n,)``.
    """
    outer, sine = gimbal.pointing(matrix)
    is_known = sine > LOCK
    known = np.nonzero(is_known)[0]
    if known.size:
        line = np.interp(np.arange(len(outer)), known, np.unwrap(outer[known], period=np.pi))
    else:
        line = np.zeros_like(outer)
    edges = np.nonzero(np.diff(np.concatenate([[True], is_known, [True]])))[0]
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        if begin > 0 and end - begin <= _THROUGH:
            continue
        turn = gimbal.turn_at_pole(matrix[begin:end])
        if begin:
            line[begin:end] = line[begin - 1] + turn
        elif first is not None:
            line[:end] = first + turn
        elif end < len(line):
            line[:end] = line[end] + turn - turn[-1]
        else:
            line += turn
        if 0 < end < len(line):
            line[end:] += np.pi * np.round((line[end - 1] - line[end]) / np.pi)
    return line, sine


def windows(line: Floats, period: float, limit: AxisLimits) -> list[tuple[int, int]]:
    """Return the index ranges in which the outer axis has to hurry more than it can.

    Args:
        line: as from :func:`outer_line`.
        period: s.
        limit: of the outer axis.
    """
    velocity, acceleration = rates(line[:, None], period)
    share = np.maximum(
        np.abs(velocity[:, 0]) / limit.velocity, np.abs(acceleration[:, 0]) / limit.acceleration
    )
    share[:-1] = np.maximum(share[:-1], share[1:])
    near = np.concatenate([[False], share > _CLOSE, [False]])
    edges = np.nonzero(near[1:] != near[:-1])[0]
    room = _room(limit, period)
    found: list[tuple[int, int]] = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        first, last = max(0, int(begin) - room), min(len(line) - 1, int(end) + room)
        if found and first <= found[-1][1]:
            found[-1] = (found[-1][0], last)
        else:
            found.append((first, last))
    return [(a, b) for a, b in found if np.max(share[a : b + 1]) > 1.0]


def _room(limit: AxisLimits, period: float) -> int:
    """Return how many exact samples on each side a window has to round the bends in."""
    return 2 * math.ceil(limit.velocity / (limit.acceleration * period)) + 2


def passages(
    gimbal: Gimbal,
    matrix: Floats,
    window: tuple[int, int],
    limits: Sequence[AxisLimits],
    period: float,
    max_error: float,
) -> list[Passage]:
    """Return the ways past the pole that the axes can make, with the least error of each.

    Args:
        gimbal: whose.
        matrix: of the whole path, as from :meth:`.Gimbal.matrix`, shape ``(n, 3, 3)``.
        window: first and last index, as from :func:`windows`.
        limits: of every axis; their angles are not looked at here.
        period: s.
        max_error: the largest angle by which the path may be missed, rad.

    Returns:
        For both branches to come in on, one passage for each branch to go out on.
    """
    first, last = window
    part = matrix[first : last + 1]
    line, sine = outer_line(gimbal, part)
    found = []
    for come_in in (0.0, np.pi):
        for branch in _BRANCHES:
            best: Floats | None = None
            low, high = 0.0, max_error
            for step in range(_BISECTIONS):
                error = high if step == 0 else (low + high) / 2
                angles = _attempt(gimbal, part, line + come_in, sine, branch, error, limits, period)
                if angles is None:
                    if step == 0:
                        break
                    low = error
                else:
                    high, best = error, angles
            if best is not None:
                missed = float(np.max(gimbal.rest(part, best[:, 0]).error))
                if missed <= max_error * (1 + 1e-9):
                    found.append(Passage(first, last, branch, best, missed))
    return found


def _attempt(
    gimbal: Gimbal,
    matrix: Floats,
    line: Floats,
    sine: Floats,
    branch: int,
    error: float,
    limits: Sequence[AxisLimits],
    period: float,
) -> Floats | None:
    """Return axis angles within *error* that keep the rates, or ``None``."""
    free = np.nonzero(sine <= np.sin(error))[0]
    if branch and free.size == 0:
        return None
    half = np.arcsin(np.minimum(1.0, np.sin(error) / np.maximum(sine, 1e-300)))
    low, high = line - half, line + half
    if free.size:
        low[free[0] : free[-1] + 1] = -np.inf
        high[free[0] : free[-1] + 1] = np.inf
        low[free[-1] + 1 :] += branch * np.pi
        high[free[-1] + 1 :] += branch * np.pi
    limit = limits[0]
    # Exact on both sides of the string, so that its ends are rounded too; the rounding itself is
    # faded out where nothing bends.
    room = min(_room(limit, period), (len(line) - 2) // 3)
    first, last = room, len(line) - 1 - room
    exact = line.copy()
    exact[last:] += branch * np.pi
    exact[first : last + 1] = taut_string(
        low[first : last + 1], high[first : last + 1], exact[first], exact[last]
    )
    hurry = float(np.max(np.abs(np.diff(exact)))) / period
    width = min(math.ceil(hurry / (limit.acceleration * period)), room // 2)
    share = np.minimum(1.0, np.arange(len(line)) / max(1, room // 2))
    share = quintic(np.minimum(share, share[::-1]))
    outer = exact + share * (smooth(exact, width) - exact)
    inner = np.unwrap(gimbal.rest(matrix, outer).inner, axis=0)
    angles = np.concatenate([outer[:, None], inner], axis=1)
    velocity, acceleration = rates(angles, period)
    for axis, allowed in enumerate(limits):
        if np.max(np.abs(velocity[:, axis])) > allowed.velocity:
            return None
        if np.max(np.abs(acceleration[:, axis])) > allowed.acceleration * (1 + 1e-6):
            return None
    return angles
