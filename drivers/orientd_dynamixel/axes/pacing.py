"""How quickly the axes can run along a path: slow where they must be, and nowhere else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orientd.driver import Quaternion, Vector3
from orientd.errors import LimitError, LimitKind
from orientd.rotation import Floats, check_unit, conjugate, log, multiply
from orientd_dynamixel.keyhole import outer_line
from orientd_dynamixel.options import GimbalOptions
from orientd_dynamixel.planning import gimbal_of

_FINER = 8
"""New path times between two samples, so that its bends are smooth."""
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


def pace(
    options: GimbalOptions,
    period: float,
    orientations: Sequence[Quaternion],
    *,
    grid: float,
    fixed: tuple[float, float],
    rates: Vector3,
    share: float,
) -> list[float]:
    """Return how far along a path to be in every cycle; see :meth:`.Driver.pace`."""
    q = check_unit(orientations)
    gimbal = gimbal_of(options)
    matrix = gimbal.matrix(q)
    line, _ = outer_line(gimbal, matrix)
    inner = np.unwrap(gimbal.rest(matrix, line).inner, axis=0)
    angles = np.concatenate([line[:, None], inner], axis=1)
    speed, force = _first(angles, grid), np.abs(_second(angles, grid))
    made = gimbal.forward(angles)
    turn = log(multiply(conjugate(made[:-1]), made[1:])) / grid
    omega = np.concatenate([turn, turn[-1:]])
    bend = np.diff(omega, axis=0, prepend=omega[:1]) / grid
    speed = np.column_stack([speed, np.linalg.norm(omega, axis=1)])
    force = np.column_stack([force, np.linalg.norm(bend, axis=1)])
    fastest = np.array([*(axis.velocity for axis in options.axes), rates[0]])
    hardest = np.array([*(axis.acceleration for axis in options.axes), rates[1]])
    times = grid * np.arange(len(q), dtype=np.float64)
    is_fixed = (times > fixed[0] - 0.5 * grid) & (times < fixed[1] + 0.5 * grid)
    _refuse(options, speed, force, fastest, hardest, is_fixed, times)
    if np.all(is_fixed):
        return np.arange(0.0, times[-1] + 0.5 * period, period).tolist()  # type: ignore[no-any-return]
    with np.errstate(divide="ignore"):
        reserve = _RESERVE if share > _SMALL_SHARE else _MORE_RESERVE
        by_speed = np.min(reserve * fastest / speed, axis=1)
        hardest[:-1] *= _BRAKED
        by_force = np.sqrt(np.min(share * hardest / force, axis=1))
        change = np.min((1.0 - share) * hardest / speed, axis=1)
    most = np.where(is_fixed, 1.0, np.minimum(1.0, np.minimum(by_speed, by_force)))
    return _course(most, np.minimum(change, 1e3), grid, period)


def _first(angles: Floats, period: float) -> Floats:
    """Return the larger rate of the steps to and from each sample."""
    step = np.abs(np.diff(angles, axis=0)) / period
    larger: Floats = np.maximum(np.concatenate([step[:1], step]), np.concatenate([step, step[-1:]]))
    return larger


def _second(angles: Floats, period: float) -> Floats:
    change = np.zeros_like(angles)
    change[1:-1] = np.diff(angles, 2, axis=0) / period**2
    return change


def _refuse(
    options: GimbalOptions,
    speed: Floats,
    force: Floats,
    fastest: Floats,
    hardest: Floats,
    is_fixed: np.ndarray,
    times: Floats,
) -> None:
    """Raise what the axes would need where the times are the user's, and how long would do."""
    if not np.any(is_fixed):
        return
    need = np.maximum(speed / fastest, np.sqrt(force / hardest))[is_fixed]
    place, axis = np.unravel_index(int(np.argmax(need)), need.shape)
    longest = float(need[place, axis])
    if longest <= 1.0:
        return
    at = np.flatnonzero(is_fixed)[place]
    names = [*(one.name for one in options.axes), "the tool"]
    is_fast = speed[at, axis] / fastest[axis] >= longest - 1e-12
    lasts = float(np.ptp(times[is_fixed]))
    advice = f"{_ROOM * longest * lasts:.1f} s in place of {lasts:.1f} s would do"
    if axis == 0:
        advice += f", or a deviation near the pole ({names[0]} needs it there)"
    quantity, unit, values, limits = (
        ("velocity", "rad/s", speed, fastest) if is_fast
        else ("acceleration", "rad/s^2", force, hardest)
    )  # fmt: skip
    raise LimitError(
        f"{quantity} of {names[axis]}", float(values[at, axis]), float(limits[axis]),
        float(times[at]), unit, advice, kind=LimitKind(quantity),
    )  # fmt: skip


def _course(most: Floats, change: Floats, grid: float, period: float) -> list[float]:
    """Return path times for each cycle, at a pace of at most *most* that changes by *change*.

    Along the path the square of the pace changes by twice its change in time.
    """
    square = most**2
    for way in (slice(None), slice(None, None, -1)):
        # No more than the one before and what the pace may rise by since then.
        rise = np.cumsum(2.0 * grid * change[way])
        square[way] = rise + np.minimum.accumulate(square[way] - rise)
    pace = np.sqrt(np.maximum(square, 0.0))
    # The least around each sample, averaged: never above it, and smooth.
    width = max(1, round(_SMOOTHED_S / grid))
    padded = np.pad(pace, 2 * width, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1)
    least = windows.min(axis=1)
    kernel = np.hanning(2 * width + 3)[1:-1]
    pace = np.convolve(least, kernel / kernel.sum(), mode="valid")
    fine = np.linspace(0.0, grid * (len(pace) - 1), _FINER * (len(pace) - 1) + 1)
    slow = np.interp(fine, grid * np.arange(len(pace)), 1.0 / pace)
    taken = np.concatenate([[0.0], np.cumsum((slow[1:] + slow[:-1]) / 2.0 * np.diff(fine))])
    count = int(np.ceil(taken[-1] / period - 1e-9)) + 1
    found: list[float] = np.interp(period * np.arange(count), taken, fine).tolist()
    return found
