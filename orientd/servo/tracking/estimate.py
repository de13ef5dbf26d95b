"""The velocity of targets that come without one, from their orientations and stamps.

A Kalman filter of orientation, angular velocity and acceleration, driven by white jerk; the three
axes share one covariance, as all of them are measured alike.  Samples may come at any spacing, so
that lost ones need nothing special, and a target of constant rate is met exactly from the second
sample on.  How noisy the orientations are shows in how far they are from what was expected; the
noisier, the longer is averaged.  A target farther from what was expected than the filter can explain
begins a motion of its own, at rest.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import difference, exp, multiply, normalize

JERK = 70.0
"""Power spectral density of the targets' jerk, (rad/s^3)^2/Hz: with the least noise the filter
follows what is slower than some 40 rad/s."""

LEAST_NOISE = 1e-3
"""Standard deviation of an orientation about each axis that is believed at least, rad."""

MOST_NOISE = 0.03
"""The most that is believed, rad: that of 50 ms of jitter where nobody stamps, at 2 rad/s."""

LEARNING = 0.1
"""Share of the last surprise in the noise that is believed."""

GATE = 5.0
"""From how many standard deviations on a surprise is a new order rather than noise or motion."""

AGILITY = 20.0
"""Acceleration that is believed of a target between two samples, rad/s^2."""

LONGEST = 0.25
"""Samples farther apart than that tell of no velocity, s."""

ANY_VELOCITY = 2.0
"""Standard deviation of the angular velocity of what nothing is known of, rad/s."""

ANY_ACCELERATION = 10.0
"""The same of its angular acceleration, rad/s^2."""


class Estimate(NamedTuple):
    """What is believed of the target at the time of a sample.

    Attributes:
        q: orientation ``(w, x, y, z)``.
        omega: angular velocity in its own frame, rad/s.
        alpha: angular acceleration, rad/s^2.
        covariance: of angle, velocity and acceleration about any axis: the upper triangle by rows.
        noise: variance of a sample, rad^2.
        begins: whether the sample was not expected at all: a motion begins there, at rest.
    """

    q: Quaternion
    omega: Vector3
    alpha: Vector3
    covariance: tuple[float, float, float, float, float, float]
    noise: float
    begins: bool


def begun(q: Quaternion, noise: float = LEAST_NOISE * LEAST_NOISE) -> Estimate:
    """Return what is believed of a target of which there is one sample, *q*."""
    v, a = ANY_VELOCITY * ANY_VELOCITY, ANY_ACCELERATION * ANY_ACCELERATION
    return Estimate(q, ZERO, ZERO, (noise, 0.0, 0.0, v, 0.0, a), noise, True)


def updated(before: Estimate, told: Quaternion, seconds: float) -> Estimate:
    """Return what is believed once *told* has come, *seconds* after the sample before."""
    if seconds > LONGEST:
        return begun(told, before.noise)
    t = seconds
    half = 0.5 * t * t
    (a, b, c), (x, y, z) = before.omega, before.alpha
    turn = (t * a + half * x, t * b + half * y, t * c + half * z)
    q = multiply(before.q, exp(turn))
    # F P F^T + Q for F = [[1, t, t^2/2], [0, 1, t], [0, 0, 1]]; Bar-Shalom, Li and Kirubarajan,
    # Estimation with Applications to Tracking and Navigation (2001), 6.2.3.
    p, pv, pa, v, va, w = before.covariance
    s = JERK * t
    p += t * (2.0 * pv + t * (pa + v + t * (va + 0.25 * t * w))) + s * t**4 / 20.0
    pv += t * (pa + v + t * (1.5 * va + 0.5 * t * w)) + s * t**3 / 8.0
    pa += t * (va + 0.5 * t * w) + s * t * t / 6.0
    v += t * (2.0 * va + t * w) + s * t * t / 3.0
    va += t * w + 0.5 * s * t
    w += s
    e, f, g = difference(q, told)
    square = (e * e + f * f + g * g) / 3.0
    noise = before.noise
    total = p + noise
    most = MOST_NOISE * MOST_NOISE
    learned = noise + LEARNING * (min(square, most) - noise)
    learned = max(learned, LEAST_NOISE * LEAST_NOISE)
    if sqrt(square) > GATE * sqrt(total) + AGILITY * half:
        return begun(told, learned)
    k, l, m = p / total, pv / total, pa / total
    return Estimate(
        normalize(multiply(q, exp((k * e, k * f, k * g)))),
        (a + t * x + l * e, b + t * y + l * f, c + t * z + l * g),
        (x + m * e, y + m * f, z + m * g),
        (p - k * p, pv - k * pv, pa - k * pa, v - l * pv, va - l * pa, w - m * pa),
        learned,
        False,
    )
