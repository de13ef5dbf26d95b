"""The fastest pace of the axes along a path: slow only where the axes need it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orientd.driver import AxisLimits
from orientd.errors import LimitError, LimitKind
from orientd.mechanism.joint_path import UNITS
from orientd.mechanism.timing import calmed, run_through
from orientd.rotation import Floats, conjugate, log, multiply

_SMOOTHED_S = 0.04
"""Interval over which the pace is averaged, s of the path; a longer one lowers the jerk."""
_RESERVE, _MORE_RESERVE = 0.98, 0.9
"""Usable share of the velocities, because the path is resampled.

The smaller one goes with the small share of the accelerations, which is tried if others fail.
"""
_SMALL_SHARE = 0.2
_BRAKED = 0.95
"""Usable share of the axes' accelerations; the rest is for braking on the path."""
_ROOM = 1.02
"""Margin of the suggested duration over the shortest one."""
_KEPT = 1.0 + 1e-3
"""Share of a limit up to which a path keeps it, because differences are approximate."""
_MOST_CHANGE = 1e3
"""Least pace, 1/s."""


def pace(
    axes: Sequence[AxisLimits],
    path: tuple[Floats, Floats, Floats],
    period: float,
    *,
    grid: float,
    tool: Sequence[float],
    fixed: tuple[float, float],
    share: float,
) -> Floats:
    """Return path times, a period apart, at which the axes can follow a path that is too fast.

    Args:
        axes: limits of the axes.
        path: joints, tool orientations and tool positions, *grid* apart, shapes ``(n, axes)``,
            ``(n, 4)`` and ``(n, 3)``.
        period: of the cycles, s.
        grid: s of path time.
        tool: its largest angular velocity and acceleration, linear velocity and acceleration.
        fixed: path times between which the pace is fixed; the first one is later than the second
            if there are none.
        share: usable share of the accelerations where the pace is constant.

    Returns:
        Path times a period apart, s, from 0 to the end.

    Raises:
        LimitError: an axis cannot follow between the fixed times; the error names a feasible
            duration.
    """
    joints, q, position = path
    turn = log(multiply(conjugate(q[:-1]), q[1:])) / grid
    omega = np.concatenate([turn, turn[-1:]])
    bend = np.diff(omega, axis=0, prepend=omega[:1]) / grid
    # Each axis, the tool's turn and its position.
    speed = np.column_stack([
        _larger(np.abs(np.diff(joints, axis=0)) / grid),
        np.linalg.norm(omega, axis=1),
        _larger(np.linalg.norm(np.diff(position, axis=0), axis=1, keepdims=True) / grid),
    ])  # fmt: skip
    force = np.column_stack([
        np.abs(_second(joints, grid)),
        np.linalg.norm(bend, axis=1),
        np.linalg.norm(_second(position, grid), axis=1),
    ])  # fmt: skip
    fastest = np.array([*(axis.velocity for axis in axes), tool[0], tool[2]])
    hardest = np.array([*(axis.acceleration for axis in axes), tool[1], tool[3]])
    times = grid * np.arange(len(speed), dtype=np.float64)
    is_fixed = (times > fixed[0] - 0.5 * grid) & (times < fixed[1] + 0.5 * grid)
    if np.any(is_fixed):
        names = [*(axis.name for axis in axes), "the tool"]
        advice = f", or a deviation near the pole ({names[0]} needs it there)"
        limits = fastest[:-1], hardest[:-1]
        _refuse(names, times, is_fixed, (speed[:, :-1], force[:, :-1]), limits, advice)
    if np.all(is_fixed):
        return np.arange(0.0, times[-1] + 0.5 * period, period)
    with np.errstate(divide="ignore"):
        reserve = _RESERVE if share > _SMALL_SHARE else _MORE_RESERVE
        by_speed = np.min(reserve * fastest / speed, axis=1)
        hardest[:-2] *= _BRAKED
        by_force = np.sqrt(np.min(share * hardest / force, axis=1))
        change = np.min((1.0 - share) * hardest / speed, axis=1)
    most = np.where(is_fixed, 1.0, np.minimum(1.0, np.minimum(by_speed, by_force)))
    return _course(most, np.minimum(change, _MOST_CHANGE), grid, period)


def _larger(steps: Floats) -> Floats:
    """Return the larger of the steps before and after each sample."""
    larger: Floats = np.maximum(
        np.concatenate([steps[:1], steps]), np.concatenate([steps, steps[-1:]])
    )
    return larger


def _second(values: Floats, grid: float) -> Floats:
    change = np.zeros_like(values)
    change[1:-1] = np.diff(values, 2, axis=0) / grid**2
    return change


def _refuse(
    names: Sequence[str],
    times: Floats,
    is_fixed: np.ndarray,
    rates: tuple[Floats, Floats],
    limits: tuple[Floats, Floats],
    advice: str,
) -> None:
    """Raise what the axes would need if the user set the times, and a feasible duration.

    With two pointing axes the tool turns more than the given path, so its turn counts too.
    """
    kinds, powers = (LimitKind.VELOCITY, LimitKind.ACCELERATION), (1.0, 0.5)
    needs = [
        (rate[is_fixed] / limit) ** power
        for rate, limit, power in zip(rates, limits, powers, strict=True)
    ]
    which, place, axis = map(int, np.unravel_index(int(np.argmax(needs)), np.shape(needs)))
    longest = float(needs[which][place, axis])
    if longest <= _KEPT:
        return
    at, lasts = np.flatnonzero(is_fixed)[place], float(np.ptp(times[is_fixed]))
    words = f"{_ROOM * longest * lasts:.1f} s in place of {lasts:.1f} s would do"
    raise LimitError(
        f"{kinds[which].value} of {names[axis]}", float(rates[which][at, axis]),
        float(limits[which][axis]), float(times[at]), UNITS[kinds[which]],
        words if axis else words + advice, kind=kinds[which],
    )  # fmt: skip


def _course(most: Floats, change: Floats, grid: float, period: float) -> Floats:
    """Return path times for each cycle, at a pace of at most *most* that changes by *change*.

    Along the path the square of the pace changes by twice its change in time.
    """
    square = most**2
    for way in (slice(None), slice(None, None, -1)):
        # At most the previous pace plus the possible increase since then.
        rise = np.cumsum(2.0 * grid * change[way])
        square[way] = rise + np.minimum.accumulate(square[way] - rise)
    fastest = np.sqrt(np.maximum(square, 0.0))
    slow = grid / calmed(fastest, max(1, round(_SMOOTHED_S / grid)))
    lasts = float(np.sum(slow[1:] + slow[:-1])) / 2.0
    cycles = np.arange(int(np.ceil(lasts / period - 1e-9)) + 1, dtype=np.float64)
    return grid * run_through(slow, np.minimum(period * cycles, lasts))
