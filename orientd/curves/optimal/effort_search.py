r"""The search for the increments of least effort: Gauss-Newton steps, accelerated.

A Gauss-Newton step leaves out the curvature of residuals and equations, so near the solution the
error shrinks by a factor that grows with the turn between keyframes: 0.03 a step at 45 degrees,
0.15 at 90, 0.5 at 170.  Anderson's mixing (1965; Walker and Ni, 2011) of the last few steps takes
half the way of that away for the cost of a tiny least-squares problem.

Far from the solution a step counts as progress when it lowers the effort plus the errors of the
equations, each with more weight than its multiplier has (the exact penalty of Han, 1977).

The search begins at a cumulative spline in finer knots.  A cumulative spline is not one over finer
knots, as it would be in Euclidean space, but close to one.  Its control quaternions are estimated
from the curve and its acceleration.  If the estimate misses the keyframes by far, the spline of the
finer knots passes through points of the curve instead.
"""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from orientd.curves.construct import Path
from orientd.curves.interpolating import C2Cumulative
from orientd.curves.optimal.effort_equations import EffortEquations, Linearised
from orientd.curves.optimal.starts import spline_through
from orientd.errors import PlanError
from orientd.rotation import Floats, between, exp_half, log_half, multiply

LARGE = 2.0
"""Rad between keyframes, beyond which torque has several minima: in 4 of a hundred sets of 150
degrees, up to 50 % apart."""

FEW = 10
"""Keyframes, for which looking twice takes no longer than once for twice as many."""

FAR = 0.1
"""Rad of half angle by which an estimate misses a keyframe so that another start is tried too."""

ITERATIONS = 100
DEPTH = 4
"""So many earlier steps are mixed in."""

MIXED = 1.0
"""Rad of half angle, the longest step that is mixed with others."""

SETTLED = 1e-6
"""A step of so much of the longest increment is the last: the effort is stationary to the square
of that, and the equations hold to the square of the step."""

SMALL = 1e-4
"""Rad; steps below it are taken as they are, what they gain being near rounding."""

PATIENCE = 6
"""A mixed step need not do better than the worst of so many steps: on its way it may miss the
keyframes by the square of its length, which the next step mends."""

SMALLEST_SHARE = 1e-4
SLACK = 1e-10


def least_effort(equations: EffortEquations, guess: Floats) -> Floats:
    """Return increments of stationary effort near a guess, shape ``(count, 3)``.

    Raises:
        PlanError: the search does not settle.
    """
    increments = equations.ends.imposed(guess)
    here = equations.linearised(increments)
    weights = np.zeros(len(here.missed))
    memory, recent = _Memory(), [here]
    for _ in range(ITERATIONS):
        try:
            step, multipliers = equations.step(here)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise PlanError(_NOT_FOUND) from error
        size = _longest(step)
        if not np.isfinite(size):
            break
        weights = np.maximum(weights, 2.0 * np.sqrt(np.sum(multipliers**2, axis=1)))
        recent = [*recent[1 - PATIENCE :], here]
        before = _merit(here, weights)
        enough = before + SLACK * abs(before)
        enough_mixed = max(_merit(earlier, weights) for earlier in recent)
        is_settled = size <= SETTLED * _longest(increments + step)
        mixed = step if is_settled or size > MIXED else memory.mixed(increments, step)
        there = equations.linearised(increments + mixed)
        if mixed is not step and not _merit(there, weights) <= enough_mixed:
            memory, mixed = _Memory(), step
            there = equations.linearised(increments + mixed)
        share = 1.0
        while size > SMALL and mixed is step and not _merit(there, weights) <= enough:
            share *= 0.5
            if share < SMALLEST_SHARE:
                raise PlanError(_NOT_FOUND)
            there = equations.linearised(increments + share * step)
        increments, here = increments + share * mixed, there
        if is_settled:
            return equations.ends.imposed(increments)
    raise PlanError(_NOT_FOUND)


_NOT_FOUND = (
    "no curve of least effort was found through the keyframes: the search does not settle; add "
    "keyframes, lower the end velocities or make neighbouring intervals more alike"
)


def _merit(here: Linearised, weights: Floats) -> float:
    lengths = np.sqrt(np.sum(here.missed * here.missed, axis=1))
    return here.effort + float(np.sum(weights * lengths))


def _longest(vectors: Floats) -> float:
    return float(np.sqrt(np.max(np.sum(vectors * vectors, axis=1))))


class _Memory:
    """The last increments and the steps from them."""

    def __init__(self) -> None:
        self._increments: list[Floats] = []
        self._steps: list[Floats] = []

    def mixed(self, increments: Floats, step: Floats) -> Floats:
        """Return the step to where the steps, were they linear, would vanish most nearly."""
        self._increments = [*self._increments[-DEPTH:], increments.ravel()]
        self._steps = [*self._steps[-DEPTH:], step.ravel()]
        if len(self._steps) == 1:
            return step
        moved = np.diff(self._increments, axis=0).T
        changed = np.diff(self._steps, axis=0).T
        mixture = np.linalg.lstsq(changed, step.ravel(), rcond=1e-8)[0]
        mixed: Floats = step - ((moved + changed) @ mixture).reshape(-1, 3)
        return mixed


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
