"""Filtered targets, and the motion between and beyond them.

A target with a velocity is averaged with the prediction of the previous one.  A target without one
gets its velocity from a Kalman filter of place, velocity and acceleration, driven by white jerk,
for orientations and for positions.  The three axes share one covariance, because their measurements
are alike.  Samples may come at any spacing, so lost ones need no special treatment.  A target of
constant rate is met exactly from the second sample on.

The filter learns the noise of the samples.  Successive surprises in the same direction mean that
the target moves differently than expected.  Alternating surprises mean that the filter followed the
noise. If the filter is right they have no direction (Mehra 1970).  The noisier the samples, the
longer it averages.

A target farther from its prediction than the filter can explain starts a new motion, at rest.  So
does one with velocity that is farther than :data:`JUMP` from its prediction, and one that stands
still.
"""

from __future__ import annotations

from math import exp as exp_of
from math import sqrt
from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import combine, difference, exp, multiply, norm, normalize, plus

JUMP = 0.1
"""Surprise from which a target is a new order rather than a correction, rad."""

TRUST = 0.05
"""Time for which velocities count more than orientations, s: this averages the noise."""

BENT = 0.05
"""Time for which the last acceleration is extrapolated beyond the newest target, s."""

STILL = 1e-4
"""Estimated rate below which a target stands still, rad/s."""

JERK = 1.0
"""Power spectral density of the targets' jerk, (rad/s^3)^2/Hz, or (m/s^3)^2/Hz.

With the least noise the filter follows motion slower than some 40 rad/s.
"""

LEAST_NOISE = 1e-4
"""Least assumed standard deviation of a sample about each axis, rad or m."""

MOST_NOISE = 0.03
"""Largest assumed one, rad or m: that of 50 ms of jitter without stamps, at 2 rad/s."""

FIRST_NOISE = 3e-4
"""Initially assumed one, rad or m."""

LEARNING = 0.3
"""Change of the logarithm of the variance with one surprise."""

NO_SURPRISE = 1e-6
"""Length of a surprise that carries no information, rad or m."""

GATE = 5.0
"""Standard deviations from which a surprise is a new order rather than noise or motion."""

AGILITY = 20.0
"""Assumed acceleration of a target between two samples, rad/s^2 or m/s^2."""

LONGEST = 0.25
"""Longest spacing of samples that still give a velocity, s."""

ANY_VELOCITY = 2.0
"""Standard deviation of an unknown velocity, rad/s or m/s."""

ANY_ACCELERATION = 10.0
"""Standard deviation of an unknown acceleration, rad/s^2 or m/s^2."""


class Target(NamedTuple):
    """The pose for the device at a time, and its velocity there.

    Attributes:
        q: orientation ``(w, x, y, z)``; its sign does not matter.
        omega_body: angular velocity in the target's own frame, rad/s; zero to be at rest there,
            ``None`` to derive it from earlier targets.
        time_ns: time of the target, monotonic clock.
        expires_ns: time from which it no longer counts.
        position: m; ``None`` for a position at rest anywhere.
    """

    q: Quaternion
    omega_body: Vector3 | None
    time_ns: int
    expires_ns: int
    position: Vector3 | None = None


class Estimate(NamedTuple):
    """State of the filter at a sample, of a rotation or a translation.

    Attributes:
        velocity: in the orientation's own frame, rad/s, or m/s.
        acceleration: rad/s^2, or m/s^2.
        covariance: of place, velocity and acceleration along any axis: the upper triangle by rows.
        noise: variance of a sample.
        surprise: distance of the sample from its prediction.
        gain: share of the surprise by which the place was corrected.
        begins: whether the sample was not expected at all, so that a motion begins there, at rest.
    """

    velocity: Vector3
    acceleration: Vector3
    covariance: tuple[float, float, float, float, float, float]
    noise: float
    surprise: Vector3
    gain: float
    begins: bool

    def step(self, t: float) -> Vector3:
        """Return the predicted displacement *t* seconds after the sample."""
        return combine(self.velocity, t, self.acceleration, 0.5 * t * t)


def begun(noise: float = FIRST_NOISE * FIRST_NOISE) -> Estimate:
    """Return the state of the filter after one sample."""
    v, a = ANY_VELOCITY * ANY_VELOCITY, ANY_ACCELERATION * ANY_ACCELERATION
    return Estimate(ZERO, ZERO, (noise, 0.0, 0.0, v, 0.0, a), noise, ZERO, 1.0, True)


def updated(before: Estimate, surprise: Vector3, t: float) -> Estimate:
    """Return the state of the filter after a further sample.

    Args:
        before: state at the previous sample.
        surprise: distance of the sample from its prediction, rad or m.
        t: time between the samples, s.
    """
    if t > LONGEST:
        return begun(before.noise)
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
    total, size = p + before.noise, norm(surprise)
    if size > GATE * sqrt(3.0 * total) + 0.5 * AGILITY * t * t:
        return begun(before.noise)
    agreement = sum(x * y for x, y in zip(surprise, before.surprise, strict=True))
    cosine = agreement / (size * norm(before.surprise) + NO_SURPRISE * NO_SURPRISE)
    noise = before.noise * exp_of(-LEARNING * cosine)
    noise = min(max(noise, LEAST_NOISE * LEAST_NOISE), MOST_NOISE * MOST_NOISE)
    # The gains: the share of the surprise that each of the three takes.
    g, h, k = p / total, pv / total, pa / total
    return Estimate(
        plus(plus(before.velocity, before.acceleration, t), surprise, h),
        plus(before.acceleration, surprise, k),
        (p - g * p, pv - g * pv, pa - g * pa, v - h * pv, va - h * pa, w - k * pa),
        noise,
        surprise,
        g,
        False,
    )


class FilteredTarget(NamedTuple):
    """A target with its filtered values.

    Attributes:
        target: as received, its quaternion normalised.
        q: orientation ``(w, x, y, z)``.
        omega: angular velocity in its own frame, rad/s.
        alpha: angular acceleration up to there, rad/s^2.
        begins: whether it begins a motion, and is not joined to earlier targets.
        turning: state of the filter of its orientation, if it came without velocity.
        position: m, if it came with a position.
        travelling: state of the filter of the position.
    """

    target: Target
    q: Quaternion
    omega: Vector3
    alpha: Vector3
    begins: bool
    turning: Estimate | None = None
    position: Vector3 = ZERO
    travelling: Estimate | None = None


class ReferenceState(NamedTuple):
    """The reference at a time.

    Attributes:
        q: orientation ``(w, x, y, z)``.
        omega: angular velocity in the reference's own frame, rad/s.
        alpha: angular acceleration, rad/s^2.
        lead: expected change of that by now, from its recent trend, rad/s^2, for feed-forward.
    """

    q: Quaternion
    omega: Vector3
    alpha: Vector3
    lead: Vector3 = ZERO


def filtered(before: FilteredTarget | None, target: Target) -> FilteredTarget:
    """Return a target filtered with the one *before* it.

    Args:
        before: the last target, filtered; ``None`` for the first.
        target: normalised.
    """
    seconds = 0.0 if before is None else (target.time_ns - before.target.time_ns) * 1e-9
    found = _turned(before, target, seconds)
    place = target.position
    if place is None:
        return found
    travelling = begun()
    if before is not None and before.travelling is not None:
        expected = plus(before.position, before.travelling.step(seconds), 1.0)
        surprise = plus(place, expected, -1.0)
        travelling = updated(before.travelling, surprise, seconds)
        place = plus(expected, surprise, travelling.gain)
    return found._replace(position=place, travelling=travelling)


def _turned(before: FilteredTarget | None, target: Target, seconds: float) -> FilteredTarget:
    q, omega = target.q, target.omega_body
    if omega is None:
        turning = begun()
        if before is not None and before.turning is not None:
            expected = multiply(before.q, exp(before.turning.step(seconds)))
            surprise = difference(expected, q)
            turning = updated(before.turning, surprise, seconds)
            q = normalize(multiply(expected, exp(plus(ZERO, surprise, turning.gain))))
        omega = turning.velocity if norm(turning.velocity) > STILL else ZERO
        begins = before is None or ZERO in (omega, before.omega) or turning.begins
        alpha = ZERO if begins else turning.acceleration
        return FilteredTarget(target, q, omega, alpha, begins, turning)
    if before is not None and omega != ZERO != before.omega:
        there = multiply(before.q, exp(combine(before.omega, 0.5 * seconds, omega, 0.5 * seconds)))
        surprise = difference(there, q)
        if norm(surprise) <= JUMP:
            alpha = combine(omega, 1.0 / seconds, before.omega, -1.0 / seconds)
            share = seconds / (seconds + TRUST)
            q = normalize(multiply(there, exp(plus(ZERO, surprise, share))))
            return FilteredTarget(target, q, omega, alpha, begins=False)
    return FilteredTarget(target, q, omega, ZERO, begins=True)


def carried_on(velocity: Vector3, acceleration: Vector3, since: float) -> tuple[Vector3, Vector3]:
    """Return displacement and velocity *since* the last target, s, extrapolated."""
    bent = min(since, BENT)
    way = combine(velocity, since, acceleration, bent * (since - 0.5 * bent))
    return way, plus(velocity, acceleration, bent)


def continued(here: FilteredTarget, since: float) -> ReferenceState:
    """Return the motion *since* the last target, s."""
    turn, omega = carried_on(here.omega, here.alpha, since)
    alpha = here.alpha if since < BENT else ZERO
    return ReferenceState(multiply(here.q, exp(turn)), omega, alpha)


def joined(here: FilteredTarget, there: FilteredTarget, since: float) -> ReferenceState:
    """Return the motion between two targets, *since* the first, s."""
    span = (there.target.time_ns - here.target.time_ns) * 1e-9
    u, omega = since / span, here.omega
    alpha = combine(there.omega, 1.0 / span, omega, -1.0 / span)
    # Velocity changes linearly between them; the rest of the orientation change follows a ramp.
    end = multiply(here.q, exp(combine(omega, span, alpha, 0.5 * span * span)))
    gap = difference(end, there.q)
    q = multiply(here.q, exp(combine(omega, since, alpha, 0.5 * since * since)))
    q = multiply(q, exp(plus(ZERO, gap, u * u * (3.0 - 2.0 * u))))
    omega = plus(plus(omega, alpha, since), gap, 6.0 * u * (1.0 - u) / span)
    return ReferenceState(q, omega, alpha)
