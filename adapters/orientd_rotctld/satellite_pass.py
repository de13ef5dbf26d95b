"""The request of a whole pass: compass azimuth and elevation of a moving target, by time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from orientd.errors import RequestError
from orientd.model.keyframes import keyframe_mappings
from orientd.model.request import MotionRequest
from orientd.motion_file import parse
from orientd_serving.pointing import vectors

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from orientd.rotation import Floats


def satellite_pass(
    times: ArrayLike,
    azimuth: ArrayLike,
    elevation: ArrayLike,
    *,
    name: str = "",
) -> MotionRequest:
    """Return the request to follow a target in the sky from the first of *times* to the last.

    The world has x north, y west and z up.  The motion begins with a lead-in that reaches the first
    direction with the target's own rate, and ends with a lead-out.  Its first keyframe is at path
    time ``plan.start_time``, so start it at the time of the first direction minus that.

    Args:
        times: increasing, s, shape ``(n,)``, at least 3.  The path is smooth between them: a
            direction each second suits a low orbit.
        azimuth: degrees from north towards east, from -720 to 720, shape ``(n,)``.
        elevation: degrees above the horizon, from -90 to 180, shape ``(n,)``.  Above 90 it points
            backwards.
        name: label of the motion in reports and logs.

    Raises:
        RequestError: the three differ in length, there are fewer than 3, or one is malformed.
    """
    columns = {"times": times, "azimuth": azimuth, "elevation": elevation}
    given = {key: _column(key, values) for key, values in columns.items()}
    count = len(given["times"])
    for key, values in given.items():
        if len(values) != count or count < _FEWEST:
            expected = f"expected {count} entries, one for each time, and at least {_FEWEST}"
            raise RequestError(key, f"{expected}, got {len(values)}")
        low, high = RANGES.get(key, (-np.inf, np.inf))
        if beyond := np.flatnonzero((values < low) | (values > high)).tolist():
            expected = f"expected {low:g} to {high:g} degrees"
            problem = f"{expected}, got {values[beyond[0]]:.10g}; check the decimal point"
            raise RequestError(f"{key}[{beyond[0]}]", problem)
    seconds, east, up = (given[key] for key in columns)
    angles = zip((-east).tolist(), up.tolist(), strict=True)
    directions = [{"azimuth_elevation": {"azimuth": a, "elevation": e}} for a, e in angles]
    return parse(
        {
            "keyframes": keyframe_mappings(directions, times=seconds),
            "start_velocity": _omega(seconds[:3], east[:3], up[:3]),
            "end_velocity": _omega(seconds[:-4:-1], east[:-4:-1], up[:-4:-1]),
            "velocity_frame": "world",
            "approach": True,
            "name": name,
        }
    )


_FEWEST = 3
RANGES = {"azimuth": (-720.0, 720.0), "elevation": (-90.0, 180.0)}
"""Ranges of the angles of a target, degrees; above 90 a rotator has flipped over."""


def _column(key: str, values: ArrayLike) -> Floats:
    """Return *values* as finite floats, shape ``(n,)``."""
    try:
        column = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise RequestError(key, f"expected numbers, got {values!r}") from None
    if column.ndim != 1 or not np.all(np.isfinite(column)):
        raise RequestError(key, f"expected finite numbers in one row, got shape {column.shape}")
    return column


def _omega(times: Floats, azimuth: Floats, elevation: Floats) -> list[float]:
    """Return the angular velocity of a direction at the first of three times, rad/s, world.

    It has no part about the direction itself.  The rate is that of the parabola through the three.
    """
    directions = vectors(azimuth, elevation)
    first, second = times[1] - times[0], times[2] - times[0]
    if first == 0.0 or second in (0.0, first):
        return [0.0, 0.0, 0.0]  # times that do not increase: the request refuses them
    rise, other = directions[1] - directions[0], directions[2] - directions[0]
    rate = (rise * second / first - other * first / second) / (second - first)
    omega: list[float] = np.cross(directions[0], rate).tolist()
    return omega
