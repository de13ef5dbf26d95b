r"""Where the search for a curve of least effort begins: at a cumulative spline in finer knots.

A cumulative spline is not one over finer knots, as it would be in Euclidean space, but close to
one.  Its control quaternions are estimated from the curve and its acceleration; where it is so
violent that the estimate misses the keyframes by far, the spline of the finer knots is made to pass
through points of it instead.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from orientd.curves.construct import Path
from orientd.curves.interpolating import C2Cumulative
from orientd.curves.optimal.effort_equations import EffortEquations
from orientd.curves.optimal.effort_search import least_effort
from orientd.curves.optimal.min_acceleration import winding_path
from orientd.curves.optimal.relaxation import spline_path, spline_through
from orientd.curves.rotation_vector import RotationVectorSpline
from orientd.errors import PlanError
from orientd.rotation import Floats, between, exp_half, log_half, multiply

LARGE = 2.0
"""Rad between keyframes, beyond which torque has several minima: in 4 of a hundred sets of 150
degrees, up to 50 % apart."""

FEW = 10
"""Keyframes, for which looking twice takes no longer than once for twice as many."""

FAR = 0.1
"""Rad of half angle by which an estimate misses a keyframe so that another start is tried too."""


def start_path(
    q: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> tuple[Path, Floats]:
    """Return a curve near which to search, and the keyframes with the signs they have on it."""
    path = winding_path(q, instants, first, last)
    if path is None:
        path = spline_path(RotationVectorSpline, q, instants, first, last)
    if path is None:
        raise PlanError(
            "no curve was found through the keyframes near which to look for one of least effort: "
            "add keyframes, lower the end velocities or make neighbouring intervals more alike"
        )
    signs = np.sign(np.sum(q * path(instants)[0], axis=1, keepdims=True))
    return path, q * signs


def search(
    equations: EffortEquations,
    path: Path,
    knots: Floats,
    order: int,
    ends: tuple[Floats | None, Floats | None],
) -> Floats:
    """Return increments of stationary effort near a curve, the best found if it is violent.

    Torque is looked for from the least acceleration, too, where keyframes are few and far apart, or
    where nothing is found otherwise.

    Raises:
        PlanError: the search does not settle.
    """
    guesses = [refined(path, knots, order)]
    missed = equations.linearised(guesses[0]).missed
    if np.max(np.sum(missed * missed, axis=1)) > FAR**2 and order == 4:
        breaks = np.unique(knots)
        spline = spline_through(C2Cumulative, path(breaks)[0], breaks, *ends)
        guesses += [] if spline is None else [spline.increments]
    found, problems = [], []
    for guess in guesses:
        try:
            found.append(least_effort(equations, guess))
        except PlanError as error:
            problems.append(error)
    if equations.inertia is not None and (not found or equations.is_wide(LARGE, FEW)):
        with suppress(PlanError):
            eased = least_effort(equations.of_acceleration(), guesses[0])
            found.append(least_effort(equations, eased))
    if not found:
        raise problems[0]
    if len(found) == 1:
        return found[0]
    return min(found, key=lambda solved: equations.linearised(solved).effort)


def refined(path: Path, knots: Floats, order: int) -> Floats:
    r"""Return the increments of a spline close to a curve, half-angle vectors.

    The control point of a spline that belongs to knots :math:`t_1, \dots, t_{k-1}` with mean *m*
    and variance *s* is, up to third derivatives, :math:`f(m) - \tfrac{s}{2 (k - 2)} f''(m)`.
    """
    own = np.lib.stride_tricks.sliding_window_view(knots[1:-1], order - 1)
    middle = np.clip(own.mean(axis=1), knots[0], knots[-1])
    spread = np.var(own, axis=1)[:, None] / (order - 2)
    q, omega, alpha = path(middle)
    controls = multiply(q, exp_half(-0.25 * spread * alpha))
    shortest = log_half(between(controls[:-1], controls[1:]))
    # Whole turns between two control quaternions show only in the velocity.
    expected = 0.25 * np.diff(middle)[:, None] * (omega[:-1] + omega[1:])
    lengths = np.sqrt(np.sum(shortest**2, axis=1, keepdims=True))
    axes = shortest / np.where(lengths > 0.0, lengths, 1.0)
    ahead = np.sum(axes * expected, axis=1, keepdims=True) - lengths
    found: Floats = shortest + 2.0 * math.pi * np.round(ahead / (2.0 * math.pi)) * axes
    return found
