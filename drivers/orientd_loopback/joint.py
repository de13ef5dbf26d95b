"""A body that follows an orientation like a good servo: with lag and measurement noise."""

from __future__ import annotations

import random
from math import exp as decay
from math import isfinite, pi

from orientd.driver import IDENTITY, Quaternion, Vector3
from orientd.floats import difference, exp, multiply, normalize


class LaggedBody:
    """First-order lag towards the setpoint about the shortest axis, plus white noise.

    Args:
        bandwidth_hz: the lag's corner frequency, Hz.
        noise: standard deviation of the measured orientation about each axis, rad.
        seed: of the noise.

    Raises:
        ValueError: a number is out of range.
    """

    def __init__(
        self, *, bandwidth_hz: float = 20.0, noise: float = 0.0, seed: int | None = None
    ) -> None:
        if not (isfinite(bandwidth_hz) and bandwidth_hz > 0.0):
            raise ValueError(f"bandwidth_hz must be positive, got {bandwidth_hz!r}")
        if not (isfinite(noise) and noise >= 0.0):
            raise ValueError(f"noise must not be negative, got {noise!r}")
        self._corner = 2.0 * pi * bandwidth_hz
        self._noise = noise
        self._random = random.Random(seed)
        self._q: Quaternion = IDENTITY

    def place(self, q: Quaternion) -> None:
        """Stand still at *q*."""
        self._q = q

    def follow(self, q: Quaternion, period: float) -> tuple[Quaternion, Vector3]:
        """Move for *period* seconds towards *q*.

        Returns:
            The measured orientation (with noise) and the body's angular velocity, rad/s.
        """
        share = 1.0 - decay(-self._corner * period)
        x, y, z = difference(self._q, q)
        step = (x * share, y * share, z * share)
        self._q = normalize(multiply(self._q, exp(step)))
        omega = (step[0] / period, step[1] / period, step[2] / period)
        if not self._noise:
            return self._q, omega
        gauss, deviation = self._random.gauss, self._noise
        error = (gauss(0.0, deviation), gauss(0.0, deviation), gauss(0.0, deviation))
        return normalize(multiply(self._q, exp(error))), omega
