"""Turn at a constant rate from wherever the device is, as a turntable does."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from orientd.errors import RequestError
from orientd.planner.limits import Limits
from orientd.planner.request import Keyframe, MotionRequest, State
from orientd.rotation import conjugate, exp, multiply, rotate

_MOST_AT_ONCE = 2.0
"""From one keyframe to the next, rad."""
_PEAK_ACCELERATION, _PEAK_JERK = 1.875, 5.78
"""Of the quintic from rest to a velocity, in velocities a duration, and a squared one."""
_SAME_RATE = 1e-6
"""How far from a rate a device turns at it already, rad/s, and rad/s^2 of its acceleration."""
_SHARE = 0.5
"""Of the limits, to be used while the rate is taken up: the lead-in may be quicker, not shorter."""


def at_rate(request: MotionRequest, start: State, limits: Limits) -> MotionRequest:
    """Return *request* with the keyframes of a turn at its rate, if it has one.

    The first is where the rate is reached, so far ahead that the device need not swing back; a
    device that turns at it already goes on from where it is.

    Args:
        request: in the coordinates of the device.
        start: where the device is commanded to be.
        limits: to keep.

    Raises:
        RequestError: it has keyframes or velocities of its own, or no duration.
    """
    if request.rate is None:
        return request
    if not request.is_single:
        raise RequestError("rate", "turns from wherever the device is; give no keyframes")
    if request.end_velocity is not None:
        raise RequestError("end_velocity", "a turn at a rate ends at rest; give none")
    if request.total is None:
        raise RequestError(
            "duration",
            "expected the seconds for which to turn at the rate; "
            "`orientd turn` without one turns until it is stopped",
        )
    omega = np.array(request.rate)
    if request.velocity_frame == "world":
        omega = rotate(conjugate(start.q), omega)
    speed = float(np.linalg.norm(omega))
    if speed == 0.0:
        raise RequestError("rate", "expected a velocity to turn with, got 0")
    apart = [*(start.omega_body - omega), *start.alpha_body, *start.velocity, *start.acceleration]
    goes_on = max(map(abs, apart)) < _SAME_RATE
    ramp = 0.0
    if not goes_on:
        ramp = max(
            _PEAK_ACCELERATION * speed / (_SHARE * limits.acceleration),
            math.sqrt(_PEAK_JERK * speed / (_SHARE * limits.jerk)),
        )
    count = max(1, math.ceil(speed * request.total / _MOST_AT_ONCE))
    times = request.total * np.arange(count + 1) / count
    passed = multiply(start.q, exp((0.5 * ramp + times)[:, None] * omega)).tolist()
    keyframes = [
        Keyframe((w, x, y, z), time)
        for (w, x, y, z), time in zip(passed, times.tolist(), strict=True)
    ]
    return replace(
        request, keyframes=keyframes, start_velocity=request.rate, end_velocity=request.rate,
        rate=None, duration=None, pace=None, approach=not goes_on,
    )  # fmt: skip
