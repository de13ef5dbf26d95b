"""What a curve does, in figures: errors, jumps, peaks, effort, length."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orientd.curves.contract import Curve
from orientd.curves.roles import CurveTask
from orientd.rotation import Floats, angle

NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)

CLOSE = 1e-7
"""Relative change at which the integral over a span counts as found."""

MOST_PIECES = 256
"""Into which a span between two knots is divided."""

MET = 1e-9
"""Rad, or rad/s; a keyframe or a velocity met within this is met."""

JUMP = 1e-6
"""Of the peak velocity; a smaller jump is rounding."""


@dataclass(frozen=True, slots=True)
class Figures:
    """What was measured of a curve; integrals leave out jumps of the velocity.

    Attributes:
        keyframe_error: largest angle to a keyframe at its time, rad.
        continuity: what the curve declares for its knots: 0, 1 or 2.
        velocity_jump: largest jump of the angular velocity at a knot, rad/s.
        acceleration_jump: largest jump of the angular acceleration at a knot, rad/s^2.
        end_velocity_error: largest difference to a velocity that is wanted at an end, rad/s;
            ``None`` if none is.
        peak_velocity: rad/s.
        peak_acceleration: rad/s^2, between the knots.
        effort: integral of the squared angular acceleration, rad^2/s^3.
        torque_effort: integral of the squared torque, N^2 m^2 s; ``None`` without an inertia.
        path_length: integral of the angular velocity, rad.
    """

    keyframe_error: float
    continuity: int
    velocity_jump: float
    acceleration_jump: float
    end_velocity_error: float | None
    peak_velocity: float
    peak_acceleration: float
    effort: float
    torque_effort: float | None
    path_length: float

    @property
    def interpolates(self) -> bool:
        """Whether every keyframe is met."""
        return self.keyframe_error <= MET

    @property
    def has_velocity_jumps(self) -> bool:
        """Whether the velocity jumps at a knot, which would take an infinite acceleration."""
        return self.velocity_jump > JUMP * self.peak_velocity

    @property
    def meets_ends(self) -> bool:
        """Whether every velocity that is wanted at an end is met; true where none is wanted."""
        error = self.end_velocity_error
        return error is None or error <= MET * max(1.0, self.peak_velocity)


def measure(curve: Curve, task: CurveTask, *, inertia: Floats | None = None) -> Figures:
    """Return the figures of a curve that does a task.

    Integrals are by Gauss's rule with ten nodes on each span between knots, which is halved until
    its share changes by less than a ten-millionth: the length has corners where a curve turns back.
    Where a derivative jumps at a knot, both sides count.

    Args:
        curve: on the clock of the task.
        task: what it was asked to do.
        inertia: principal moments about the body's axes, kg m^2, shape ``(3,)``.
    """
    knots = curve.knots
    inner = knots[1:-1]
    right = curve.evaluate(inner)
    left = curve.evaluate(np.nextafter(inner, -np.inf))
    ends = curve.evaluate(np.array(curve.domain))[1]
    errors = [
        float(np.linalg.norm(found - wanted))
        for found, wanted in zip(ends, task.wanted, strict=True)
        if wanted is not None
    ]
    times, integrals = _integrated(curve, inertia)
    sides = np.concatenate([knots, np.nextafter(inner, -np.inf), times])
    return Figures(
        keyframe_error=float(angle(curve.evaluate(task.times)[0], task.keys).max()),
        continuity=curve.continuity,
        velocity_jump=_largest(right[1] - left[1]),
        acceleration_jump=_largest(right[2] - left[2]),
        end_velocity_error=max(errors) if errors else None,
        peak_velocity=_peak(lambda t: curve.evaluate(t)[1], sides),
        peak_acceleration=_peak(lambda t: curve.evaluate(t)[2], sides),
        path_length=float(integrals[0]),
        effort=float(integrals[1]),
        torque_effort=None if inertia is None else float(integrals[2]),
    )


def _largest(vectors: Floats) -> float:
    return float(np.linalg.norm(vectors, axis=-1).max(initial=0.0))


def _integrated(curve: Curve, inertia: Floats | None) -> tuple[Floats, Floats]:
    """Return the instants of the rules, and length, effort and squared torque by them."""
    moments = np.zeros(3) if inertia is None else inertia
    open_spans = np.arange(len(curve.knots) - 1)
    found: Floats = np.full((len(open_spans), 3), np.nan)
    instants, pieces = [], 1
    while len(open_spans):
        times, weights = _rule(curve.knots[open_spans], curve.knots[open_spans + 1], pieces)
        _, omega, alpha = curve.evaluate(times.ravel())
        torque = moments * alpha + np.cross(omega, moments * omega)
        integrands = np.linalg.norm([omega, alpha, torque], axis=-1)
        integrands[1:] **= 2
        integrals = np.einsum("csn,sn->sc", integrands.reshape(3, *times.shape), weights)
        change = np.abs(integrals - found[open_spans])
        found[open_spans] = integrals
        is_close = np.all(change <= CLOSE * np.maximum(integrals, found.mean(axis=0)), axis=1)
        is_done = is_close | (pieces >= MOST_PIECES)
        instants.append(times[is_done].ravel())
        open_spans, pieces = open_spans[~is_done], 2 * pieces
    return np.concatenate(instants), found.sum(axis=0)


def _rule(starts: Floats, ends: Floats, pieces: int) -> tuple[Floats, Floats]:
    """Return nodes and weights of Gauss's rule on equal *pieces* of spans, a span in each row."""
    begins = np.arange(pieces)[:, None] / pieces
    nodes = (begins + 0.5 * (NODES + 1.0) / pieces).ravel()
    spans = (ends - starts)[:, None]
    return starts[:, None] + spans * nodes, spans * np.tile(0.5 * WEIGHTS / pieces, pieces)


def _peak(vectors: Callable[[Floats], Floats], times: Floats) -> float:
    """Return the largest length of *vectors*, looked for more closely around the largest found."""
    ordered = np.unique(times)
    lengths = np.linalg.norm(vectors(ordered), axis=-1)
    place = int(np.argmax(lengths))
    around = ordered[[max(place - 1, 0), min(place + 1, len(ordered) - 1)]]
    closer = np.linspace(around[0], around[1], 257)
    return float(max(lengths[place], np.linalg.norm(vectors(closer), axis=-1).max()))
