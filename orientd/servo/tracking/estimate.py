"""The velocity of targets that come without one, from where they are and their stamps.

A Kalman filter of place, velocity and acceleration, driven by white jerk, for orientations and for
positions; the three axes share one covariance, as all of them are measured alike.  Samples may come
at any spacing, so that lost ones need nothing special, and a target of constant rate is met exactly
from the second sample on.

How noisy the samples are is learned: surprises that follow one another in the same direction say
that the target moves otherwise than was expected, surprises to and fro that it was followed too
closely; they have no direction where the filter is right (Mehra 1970).  The noisier, the longer is
averaged.  A target farther from what was expected than the filter can explain begins a motion of
its own, at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from math import exp as exp_of
from math import sqrt
from typing import Generic, NamedTuple, TypeVar

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import difference, exp, multiply, norm, normalize

JERK = 1.0
"""Power spectral density of the targets' jerk, (rad/s^3)^2/Hz, or (m/s^3)^2/Hz: with the least
noise the filter follows what is slower than some 40 rad/s."""

LEAST_NOISE = 1e-4
"""Standard deviation of a sample about each axis that is believed at least, rad or m."""

MOST_NOISE = 0.03
"""The most that is believed, rad or m: that of 50 ms of jitter where nobody stamps, at 2 rad/s."""

FIRST_NOISE = 3e-4
"""What is believed before there was any surprise, rad or m."""

LEARNING = 0.3
"""By how much the logarithm of the variance changes with one surprise."""

NO_SURPRISE = 1e-6
"""Length of a surprise that tells of nothing, rad or m."""

GATE = 5.0
"""From how many standard deviations on a surprise is a new order rather than noise or motion."""

AGILITY = 20.0
"""Acceleration that is believed of a target between two samples, rad/s^2 or m/s^2."""

LONGEST = 0.25
"""Samples farther apart than that tell of no velocity, s."""

ANY_VELOCITY = 2.0
"""Standard deviation of the velocity of what nothing is known of, rad/s or m/s."""

ANY_ACCELERATION = 10.0
"""The same of its acceleration, rad/s^2 or m/s^2."""

Place = TypeVar("Place", Quaternion, Vector3)


class Space(NamedTuple, Generic[Place]):
    """Where samples lie.

    Attributes:
        moved: returns a place moved by a vector, in its own frame.
        way: returns the vector from a place to another.
    """

    moved: Callable[[Place, Vector3], Place]
    way: Callable[[Place, Place], Vector3]


class Estimate(NamedTuple, Generic[Place]):
    """What is believed of the target at the time of a sample.

    Attributes:
        place: orientation ``(w, x, y, z)``, or position, m.
        velocity: in the orientation's own frame, rad/s, or m/s.
        acceleration: rad/s^2, or m/s^2.
        covariance: of place, velocity and acceleration along any axis: the upper triangle by rows.
        noise: variance of a sample.
        surprise: how far the sample was from what was expected.
        begins: whether the sample was not expected at all: a motion begins there, at rest.
    """

    place: Place
    velocity: Vector3
    acceleration: Vector3
    covariance: tuple[float, float, float, float, float, float]
    noise: float
    surprise: Vector3
    begins: bool


def _turned(q: Quaternion, step: Vector3) -> Quaternion:
    return normalize(multiply(q, exp(step)))


def _shifted(p: Vector3, step: Vector3) -> Vector3:
    return (p[0] + step[0], p[1] + step[1], p[2] + step[2])


def _straight(p: Vector3, q: Vector3) -> Vector3:
    return (q[0] - p[0], q[1] - p[1], q[2] - p[2])


ORIENTATIONS = Space[Quaternion](_turned, difference)
POSITIONS = Space[Vector3](_shifted, _straight)


def begun(place: Place, noise: float = FIRST_NOISE * FIRST_NOISE) -> Estimate[Place]:
    """Return what is believed of a target of which there is one sample, *place*."""
    v, a = ANY_VELOCITY * ANY_VELOCITY, ANY_ACCELERATION * ANY_ACCELERATION
    return Estimate(place, ZERO, ZERO, (noise, 0.0, 0.0, v, 0.0, a), noise, ZERO, True)


def updated(
    before: Estimate[Place], told: Place, seconds: float, space: Space[Place]
) -> Estimate[Place]:
    """Return what is believed once *told* has come, *seconds* after the sample before."""
    if seconds > LONGEST:
        return begun(told, before.noise)
    t = seconds
    half = 0.5 * t * t
    (a, b, c), (x, y, z) = before.velocity, before.acceleration
    expected = space.moved(before.place, (t * a + half * x, t * b + half * y, t * c + half * z))
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
    d, e, f = surprise = space.way(expected, told)
    total = p + before.noise
    size = norm(surprise)
    if size > GATE * sqrt(3.0 * total) + AGILITY * half:
        return begun(told, before.noise)
    i, j, k = before.surprise
    cosine = (d * i + e * j + f * k) / (size * norm(before.surprise) + NO_SURPRISE * NO_SURPRISE)
    noise = before.noise * exp_of(-LEARNING * cosine)
    noise = min(max(noise, LEAST_NOISE * LEAST_NOISE), MOST_NOISE * MOST_NOISE)
    # The gains: how much of the surprise each of the three takes.
    g, h, k = p / total, pv / total, pa / total
    return Estimate(
        space.moved(expected, (g * d, g * e, g * f)),
        (a + t * x + h * d, b + t * y + h * e, c + t * z + h * f),
        (x + k * d, y + k * e, z + k * f),
        (p - g * p, pv - g * pv, pa - g * pa, v - h * pv, va - h * pa, w - k * pa),
        noise,
        surprise,
        False,
    )
