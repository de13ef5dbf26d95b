"""What a curve does, in figures: errors, jumps, peaks, effort, length."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from orientd.curves.contract import Curve
from orientd.curves.roles import Task
from orientd.rotation import Floats, angle

NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)

CLOSE = 1e-6
"""Relative change at which an integral counts as found."""

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


def measure(curve: Curve, task: Task, *, inertia: Floats | None = None) -> Figures:
    """Return the figures of a curve that does a task.

    Integrals are by Gauss's rule with ten nodes on pieces of the spans between knots, halved until
    they change by less than a millionth; where a derivative jumps at a knot, both sides count.

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
        for found, wanted in ((ends[0], task.omega_start), (ends[1], task.omega_end))
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
    """Return the instants of the last rule, and length, effort and squared torque by it."""
    moments = np.zeros(3) if inertia is None else inertia
    before, pieces = np.full(3, np.nan), 2
    while True:
        share = np.linspace(0.0, 1.0, pieces + 1)
        spans = np.diff(curve.knots)
        widths = (spans / pieces)[:, None, None]
        starts = curve.knots[:-1, None, None] + spans[:, None, None] * share[:-1, None]
        times = (starts + widths * 0.5 * (NODES + 1.0)).ravel()
        weights = np.broadcast_to(widths * 0.5 * WEIGHTS, starts.shape[:2] + NODES.shape).ravel()
        _, omega, alpha = curve.evaluate(times)
        torque = moments * alpha + np.cross(omega, moments * omega)
        integrands = np.stack(
            [
                np.linalg.norm(omega, axis=-1),
                np.sum(alpha * alpha, axis=-1),
                np.sum(torque * torque, axis=-1),
            ]
        )
        found: Floats = integrands @ weights
        # The length has corners where the curve turns back; the others are smooth.
        is_close = np.abs(found - before)[1:] <= CLOSE * np.abs(found[1:])
        if np.all(is_close) or pieces >= MOST_PIECES:
            return times, found
        before, pieces = found, 2 * pieces


def _peak(vectors: Callable[[Floats], Floats], times: Floats) -> float:
    """Return the largest length of *vectors*, looked for more closely around the largest found."""
    ordered = np.unique(times)
    lengths = np.linalg.norm(vectors(ordered), axis=-1)
    place = int(np.argmax(lengths))
    around = ordered[[max(place - 1, 0), min(place + 1, len(ordered) - 1)]]
    closer = np.linspace(around[0], around[1], 257)
    return float(max(lengths[place], np.linalg.norm(vectors(closer), axis=-1).max()))
