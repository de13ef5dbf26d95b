"""How long a stop usually takes: what the limits leave at the place where it takes longest.

The servo brakes in each cycle as hard as the limits permit there, and its stops take about as long
as one on a straight path: a double integrator with bounded jerk, from the speed and its rate of
change to rest.  The certified brake rate promises less, since it needs no look ahead; the servo
falls back on it where no quicker stop is found (see :mod:`orientd.planner.certify.brake`).
"""

from __future__ import annotations

import numpy as np

from orientd.planner.limits import Limits
from orientd.planner.path import Path, RecordedPath
from orientd.rotation import Floats

_LOOKS = 120
"""Places on the path that are looked at, besides the fastest."""


def usual_stop_time(path: Path | RecordedPath, fastest: float, limits: Limits) -> float:
    """Return how long a stop from the place where it takes longest takes, about, s.

    Args:
        path: from hold to hold.
        fastest: path time of the highest angular velocity, s.
        limits: to keep.
    """
    samples = path.sample(np.append(np.linspace(0.0, path.duration, _LOOKS), fastest))
    omega, alpha = samples.omega_body, samples.alpha_body
    speed = np.sqrt(np.einsum("ij,ij->i", omega, omega))
    way = omega / np.where(speed > 0.0, speed, 1.0)[:, None]
    push = np.einsum("ij,ij->i", way, alpha)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        most = _along(way, limits.acceleration, limits.axis_acceleration)
        turning = _to_rest(speed, push, most, _along(way, limits.jerk, limits.axis_jerk))
        moving = np.linalg.norm(samples.velocity, axis=1) / limits.linear_acceleration
    return float(np.max(np.nan_to_num(np.maximum(turning, moving), nan=0.0, posinf=0.0)))


def _along(way: Floats, norm: float, axes: tuple[float, ...]) -> Floats:
    """Return what limits of a vector leave along directions, shape ``(n,)``."""
    along: Floats = np.minimum(norm, np.min(np.array(axes) / np.abs(way), axis=1))
    return along


def _to_rest(speed: Floats, push: Floats, most: Floats, jerk: Floats) -> Floats:
    """Return the shortest times from speeds, with their rates of change, to rest."""
    peak = np.sqrt(jerk * speed + 0.5 * push * push)
    brief = np.maximum(push + 2.0 * peak, 0.0) / jerk
    held = speed + (push * push - 2.0 * most * most) / (2.0 * jerk)
    time: Floats = np.where(peak <= most, brief, (push + 2.0 * most) / jerk + held / most)
    return time
