"""An inertial measurement unit: stamped samples of a base, with noise, latency and dropouts."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from emulated_base.motion import BaseMotion, Quaternion, Vector3


class Sample(NamedTuple):
    """One measurement.

    Attributes:
        time: when it was measured, s.
        arrives: when it is available, s.
        q_world_base: orientation ``(w, x, y, z)``.
        omega_base: angular velocity in the frame of the base, rad/s.
    """

    time: float
    arrives: float
    q_world_base: Quaternion
    omega_base: Vector3


@dataclass(frozen=True, slots=True)
class Imu:
    """The properties of a unit.

    Attributes:
        rate_hz: samples a second.
        noise: standard deviation of the orientation about each axis, rad.
        rate_noise: of the angular velocity about each axis, rad/s.
        latency: least time until a sample is available, s.
        jitter: largest additional time, s.
        dropouts: share of samples that are lost.
        seed: of everything random.
    """

    rate_hz: float = 100.0
    noise: float = 2e-4
    rate_noise: float = 5e-4
    latency: float = 0.01
    jitter: float = 0.002
    dropouts: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_hz < math.inf:
            raise ValueError(f"rate_hz must be positive, got {self.rate_hz!r}")
        for name in ("noise", "rate_noise", "latency", "jitter"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} must be at least 0, got {value!r}")
        if not 0.0 <= self.dropouts < 1.0:
            raise ValueError(f"dropouts must be at least 0 and less than 1, got {self.dropouts!r}")

    def samples(self, motion: BaseMotion) -> Iterator[Sample]:
        """Yield the samples of a motion, in the order of their measurement, without end."""
        chance, k = random.Random(self.seed), 0
        while True:
            t = k / self.rate_hz
            k += 1
            q, omega = motion.orientation(t), motion.rate(t)
            half = [0.5 * chance.gauss(0.0, self.noise) for _ in range(3)]
            x, y, z = (a + chance.gauss(0.0, self.rate_noise) for a in omega)
            arrives = t + self.latency + self.jitter * chance.random()
            if chance.random() >= self.dropouts:
                yield Sample(t, arrives, _turned(q, half), (x, y, z))


def _turned(q: Quaternion, half: list[float]) -> Quaternion:
    """Return *q* turned by a small angle, given as half a rotation vector."""
    w, x, y, z = q
    a, b, c = half
    p = (
        w - x * a - y * b - z * c,
        x + w * a + y * c - z * b,
        y + w * b + z * a - x * c,
        z + w * c + x * b - y * a,
    )
    size = math.sqrt(sum(one * one for one in p))
    return (p[0] / size, p[1] / size, p[2] / size, p[3] / size)
