"""Targets as they are believed, and the motion between and beyond them.

A target without velocity has the one that those before it tell of
(:mod:`orientd.servo.tracking.estimate`); one that is farther than :data:`JUMP` from what the one
before it predicts is not joined to it, and so is one that stands still.
"""

from __future__ import annotations

from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import difference, exp, multiply, norm, normalize
from orientd.servo.tracking.estimate import ORIENTATIONS, POSITIONS, Estimate, begun, updated

JUMP = 0.1
"""From which surprise on a target is a new order rather than a correction, rad."""

TRUST = 0.05
"""For so long velocities are believed more than orientations, s: this averages the noise."""

BENT = 0.05
"""For so long the last acceleration is believed beyond the newest target, s."""

STILL = 1e-4
"""What is estimated to turn more slowly stands still, rad/s."""


class Target(NamedTuple):
    """Where the device should be at an instant, and how it should turn there.

    Attributes:
        q: orientation ``(w, x, y, z)``; its sign does not matter.
        omega_body: angular velocity in the target's own frame, rad/s; zero to be at rest there,
            ``None`` if only those before it tell.
        time_ns: when it is valid, monotonic clock.
        expires_ns: from when on it says nothing any more.
        position: where it is, m; ``None`` for a position at rest wherever that is.
    """

    q: Quaternion
    omega_body: Vector3 | None
    time_ns: int
    expires_ns: int
    position: Vector3 | None = None


class Knot(NamedTuple):
    """A target as it is believed.

    Attributes:
        q: orientation ``(w, x, y, z)``.
        omega: angular velocity in its own frame, rad/s.
        alpha: angular acceleration up to there, rad/s^2.
        time_ns: when, monotonic clock.
        expires_ns: from when on it says nothing any more.
        begins: whether it begins something, and is not joined to those before.
        told: what it was told to be, before it was believed.
        estimate: where nobody told the velocity, what is known of it.
        told_position: the position that it was told to have, m, if any.
        position: what is believed of that.
    """

    q: Quaternion
    omega: Vector3
    alpha: Vector3
    time_ns: int
    expires_ns: int
    begins: bool
    told: Quaternion
    estimate: Estimate[Quaternion] | None
    told_position: Vector3 | None
    position: Estimate[Vector3] | None

    def carried(self, seconds: float) -> Quaternion:
        """Return the orientation *seconds* later, at the same velocity."""
        x, y, z = self.omega
        return multiply(self.q, exp((x * seconds, y * seconds, z * seconds)))


class ReferenceState(NamedTuple):
    """The reference at an instant.

    Attributes:
        q: orientation ``(w, x, y, z)``.
        omega: angular velocity in the reference's own frame, rad/s.
        alpha: angular acceleration, rad/s^2.
        swing: how much more that is by now, as it has changed lately, rad/s^2.
    """

    q: Quaternion
    omega: Vector3
    alpha: Vector3
    swing: Vector3 = ZERO


def knot_of(target: Target) -> Knot:
    """Return the knot of a target of which nothing else is known."""
    q, omega, time_ns, expires_ns, position = target
    told = normalize(q)
    return Knot(
        told,
        omega or ZERO,
        ZERO,
        time_ns,
        expires_ns,
        True,
        told,
        begun(told) if omega is None else None,
        position,
        None,
    )


def believed(before: Knot | None, knot: Knot) -> Knot:
    """Return the knot of a target: corrected by what the one before it predicts."""
    last, told = None if before is None else before.position, knot.told_position
    if told is not None:
        if before is None or last is None:
            position = begun(told)
        else:
            seconds = (knot.time_ns - before.time_ns) * 1e-9
            position = updated(last, told, seconds, POSITIONS)
        knot = knot._replace(position=position)
    return _turning(before, knot)


def _turning(before: Knot | None, knot: Knot) -> Knot:
    if knot.estimate is not None:
        return _estimated(before, knot)
    omega, told = knot.omega, knot.told
    if before is None or omega == ZERO or before.omega == ZERO:
        return knot._replace(q=told, alpha=ZERO, begins=True)
    seconds = (knot.time_ns - before.time_ns) * 1e-9
    (a, b, c), (x, y, z), half = before.omega, omega, 0.5 * seconds
    there = multiply(before.q, exp((half * (a + x), half * (b + y), half * (c + z))))
    alpha = (x - a) / seconds, (y - b) / seconds, (z - c) / seconds
    x, y, z = surprise = difference(there, told)
    if norm(surprise) > JUMP:
        return knot._replace(q=told, alpha=ZERO, begins=True)
    share = seconds / (seconds + TRUST)
    q = normalize(multiply(there, exp((share * x, share * y, share * z))))
    return knot._replace(q=q, alpha=alpha, begins=False)


def _estimated(before: Knot | None, knot: Knot) -> Knot:
    """Return the knot of a target without velocity, with the one that those before it tell of."""
    if before is None or before.estimate is None:
        found = begun(knot.told)
    else:
        found = updated(
            before.estimate, knot.told, (knot.time_ns - before.time_ns) * 1e-9, ORIENTATIONS
        )
    omega = found.velocity if norm(found.velocity) > STILL else ZERO
    begins = before is None or ZERO in (omega, before.omega) or found.begins
    return knot._replace(
        q=found.place,
        omega=omega,
        alpha=ZERO if begins else found.acceleration,
        begins=begins,
        estimate=found,
    )


def continued(here: Knot, since: float) -> ReferenceState:
    """Return the motion *since* the last knot, s."""
    (a, b, c), (x, y, z) = here.omega, here.alpha
    bent = min(since, BENT)
    u = bent * (since - 0.5 * bent)
    q = multiply(here.q, exp((since * a + u * x, since * b + u * y, since * c + u * z)))
    omega = (a + bent * x, b + bent * y, c + bent * z)
    return ReferenceState(q, omega, here.alpha if bent < BENT else ZERO)


def joined(here: Knot, there: Knot, since: float) -> ReferenceState:
    """Return the motion between two knots, *since* the first, s."""
    span = (there.time_ns - here.time_ns) * 1e-9
    u = since / span
    (a, b, c), (d, e, f) = here.omega, there.omega
    alpha = x, y, z = (d - a) / span, (e - b) / span, (f - c) / span
    # Velocity runs straight from knot to knot; what the orientations say beyond, along a ramp.
    u2 = 0.5 * since * since
    q = multiply(here.q, exp((a * since + u2 * x, b * since + u2 * y, c * since + u2 * z)))
    u2 = 0.5 * span * span
    end = multiply(here.q, exp((a * span + u2 * x, b * span + u2 * y, c * span + u2 * z)))
    r, s, t = difference(end, there.q)
    share = u * u * (3.0 - 2.0 * u)
    q = multiply(q, exp((share * r, share * s, share * t)))
    rate = 6.0 * u * (1.0 - u) / span
    omega = (a + since * x + rate * r, b + since * y + rate * s, c + since * z + rate * t)
    return ReferenceState(q, omega, alpha)


def place_of(knot: Knot, since: float) -> tuple[Vector3, Vector3] | None:
    """Return position and velocity *since* a knot, s; ``None`` where it has no position."""
    found = knot.position
    if found is None:
        return None
    bent = min(since, BENT)
    u = bent * (since - 0.5 * bent)
    (i, j, k), (a, b, c), (x, y, z) = found[:3]
    return (
        (i + since * a + u * x, j + since * b + u * y, k + since * c + u * z),
        (a + bent * x, b + bent * y, c + bent * z),
    )
