"""How quickly the axes can run along a path: slow where they must be, and nowhere else."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orientd.driver import AxisLimits
from orientd.errors import LimitError, LimitKind
from orientd.mechanism.joint_path import UNITS
from orientd.mechanism.timing import calmed, run_through
from orientd.rotation import Floats, conjugate, log, multiply

_SMOOTHED_S = 0.04
"""Over how long the pace is averaged, s of the path; the jerk falls with it."""
_RESERVE, _MORE_RESERVE = 0.98, 0.9
"""Share of the velocities to be used: the path is sampled anew.  The smaller one holds where the
share of the accelerations is small, too, which is tried where others were too much."""
_SMALL_SHARE = 0.2
_BRAKED = 0.95
"""Share of the axes' accelerations to be used; the rest is to brake on the path with."""
_ROOM = 1.02
"""By how much longer than just long enough a duration is named."""
_KEPT = 1.0 + 1e-3
"""Share of a limit up to which a path keeps it: differences show it only nearly."""
_MOST_CHANGE = 1e3
"""Of the pace, 1/s."""


class Demand(NamedTuple):
    """What a path asks of axes and tool when it is run through as it is, against the limits.

    Attributes:
        names: of the axes, and of the tool.
        speed: sizes of the velocities: of the axes, of the tool's turn and of its position, shape
            ``(n, axes + 2)``.
        force: sizes of the accelerations, same shape.
        fastest: limits of the velocities, shape ``(axes + 2,)``.
        hardest: limits of the accelerations.
    """

    names: tuple[str, ...]
    speed: Floats
    force: Floats
    fastest: Floats
    hardest: Floats


def demand(
    axes: Sequence[AxisLimits],
    joints: Floats,
    q: Floats,
    position: Floats,
    grid: float,
    tool: tuple[float, float, float, float],
) -> Demand:
    """Return what a path asks of axes and tool.

    Args:
        axes: their limits.
        joints: of the path, *grid* apart, rad, shape ``(n, axes)``.
        q: orientations that they make, shape ``(n, 4)``.
        position: of the tool, m, shape ``(n, 3)``.
        grid: s of path time.
        tool: largest angular velocity and acceleration, linear velocity and acceleration.
    """
    turn = log(multiply(conjugate(q[:-1]), q[1:])) / grid
    omega = np.concatenate([turn, turn[-1:]])
    bend = np.diff(omega, axis=0, prepend=omega[:1]) / grid
    speed = [
        _larger(np.abs(np.diff(joints, axis=0)) / grid),
        np.linalg.norm(omega, axis=1),
        _larger(np.linalg.norm(np.diff(position, axis=0), axis=1, keepdims=True) / grid),
    ]
    force = [
        np.abs(_second(joints, grid)),
        np.linalg.norm(bend, axis=1),
        np.linalg.norm(_second(position, grid), axis=1),
    ]
    return Demand(
        (*(axis.name for axis in axes), "the tool"),
        np.column_stack(speed),
        np.column_stack(force),
        np.array([*(axis.velocity for axis in axes), tool[0], tool[2]]),
        np.array([*(axis.acceleration for axis in axes), tool[1], tool[3]]),
    )


def pace(
    needs: Demand,
    period: float,
    *,
    grid: float,
    fixed: tuple[float, float],
    share: float,
    is_by_pole: bool = False,
) -> Floats:
    """Return how far along a path that the axes cannot follow they can be in every cycle.

    Args:
        needs: what the path asks, *grid* apart.
        period: of the cycles, s.
        grid: s of path time.
        fixed: path times between which it must be as it is; the first one later than the second
            where there are none.
        share: of the accelerations, to be used where the pace does not change.
        is_by_pole: whether it is a pole that the first axis hurries for.

    Returns:
        Path times a period apart, s, from 0 to the end.

    Raises:
        LimitError: an axis cannot follow between the fixed times; it says how long would do.
    """
    times = grid * np.arange(len(needs.speed), dtype=np.float64)
    is_fixed = (times > fixed[0] - 0.5 * grid) & (times < fixed[1] + 0.5 * grid)
    _refuse(needs, is_fixed, times, is_by_pole=is_by_pole)
    if np.all(is_fixed):
        return np.arange(0.0, times[-1] + 0.5 * period, period)
    hardest = needs.hardest.copy()
    with np.errstate(divide="ignore", invalid="ignore"):
        reserve = _RESERVE if share > _SMALL_SHARE else _MORE_RESERVE
        by_speed = np.fmin.reduce(reserve * needs.fastest / needs.speed, axis=1)
        hardest[:-2] *= _BRAKED
        by_force = np.sqrt(np.fmin.reduce(share * hardest / needs.force, axis=1))
        change = np.fmin.reduce((1.0 - share) * hardest / needs.speed, axis=1)
    most = np.where(is_fixed, 1.0, np.minimum(1.0, np.minimum(by_speed, by_force)))
    return _course(most, np.minimum(change, _MOST_CHANGE), grid, period)


def _larger(steps: Floats) -> Floats:
    """Return the larger of the steps to and from each sample."""
    larger: Floats = np.maximum(
        np.concatenate([steps[:1], steps]), np.concatenate([steps, steps[-1:]])
    )
    return larger


def _second(values: Floats, grid: float) -> Floats:
    change = np.zeros_like(values)
    change[1:-1] = np.diff(values, 2, axis=0) / grid**2
    return change


def _refuse(needs: Demand, is_fixed: np.ndarray, times: Floats, *, is_by_pole: bool) -> None:
    """Raise what the axes would need where the times are the user's, and how long would do."""
    if not np.any(is_fixed):
        return
    # Two axes that only point turn the tool more than the path as it is; its position is kept.
    speed, force = needs.speed[:, :-1], needs.force[:, :-1]
    fastest, hardest = needs.fastest[:-1], needs.hardest[:-1]
    share = np.maximum(speed / fastest, np.sqrt(force / hardest))[is_fixed]
    place, axis = np.unravel_index(int(np.argmax(share)), share.shape)
    longest = float(share[place, axis])
    if longest <= _KEPT:
        return
    at = np.flatnonzero(is_fixed)[place]
    is_fast = speed[at, axis] / fastest[axis] >= longest - 1e-12
    lasts = float(np.ptp(times[is_fixed]))
    advice = f"{_ROOM * longest * lasts:.1f} s in place of {lasts:.1f} s would do"
    if axis == 0 and is_by_pole:
        advice += f", or a deviation near the pole ({needs.names[0]} needs it there)"
    kind = LimitKind.VELOCITY if is_fast else LimitKind.ACCELERATION
    values, limits = (speed, fastest) if is_fast else (force, hardest)
    raise LimitError(
        f"{kind.value} of {needs.names[axis]}", float(values[at, axis]), float(limits[axis]),
        float(times[at]), UNITS[kind], advice, kind=kind,
    )  # fmt: skip


def _course(most: Floats, change: Floats, grid: float, period: float) -> Floats:
    """Return path times for each cycle, at a pace of at most *most* that changes by *change*.

    Along the path the square of the pace changes by twice its change in time.
    """
    square = most**2
    for way in (slice(None), slice(None, None, -1)):
        # No more than the one before and what the pace may rise by since then.
        rise = np.cumsum(2.0 * grid * change[way])
        square[way] = rise + np.minimum.accumulate(square[way] - rise)
    fastest = np.sqrt(np.maximum(square, 0.0))
    slow = grid / calmed(fastest, max(1, round(_SMOOTHED_S / grid)))
    lasts = float(np.sum(slow[1:] + slow[:-1])) / 2.0
    cycles = np.arange(int(np.ceil(lasts / period - 1e-9)) + 1, dtype=np.float64)
    return grid * run_through(slow, np.minimum(period * cycles, lasts))
