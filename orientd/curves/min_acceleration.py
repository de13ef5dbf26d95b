"""The curve of least squared angular acceleration through keyframes (Barr et al.)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.banded import solve_blocks
from orientd.curves.contract import Curve, Samples
from orientd.curves.keyframes import check_aligned, increments, resolve_times
from orientd.curves.lie_quadratic import Pieces, State, horner, pieces, shoot
from orientd.curves.rotation_vector_spline import RotationVectorSpline, check_end
from orientd.errors import PlanError
from orientd.rotation import (
    Floats,
    conjugate,
    exp_half,
    log_half,
    multiply,
    right_jacobian_inverse,
)

ITERATIONS = 40
ROUNDING = 1e-12
SMALLEST_STEP = 1e-3


class MinAcceleration(Curve):
    r"""Interpolate keyframes with the least integral of squared angular acceleration.

    .. math:: \min \int \|\dot\Omega\|^2 dt \quad\Rightarrow\quad
              \dddot\Omega = \ddot\Omega \times \Omega \text{ between keyframes},
              \quad \Omega, \dot\Omega \text{ continuous at them}

    Barr, Currin, Gabriel and Hughes (1992); Nielson (1993), "The Minimum Tangential Acceleration
    Method".  The :math:`c \times c'' \times c` printed there must be read as the part of *c''*
    along the sphere, :math:`c'' - (c \cdot c'') c`, whose norm is :math:`\|\dot\Omega\|/2`.  They
    discretise the curve and hand it to an optimiser; here the Euler equation of the problem
    (Noakes, Heinzinger and Paden, 1989) is solved to rounding: Taylor series within the segments,
    and Newton's method on the velocity, acceleration and its rate at all keyframes at once, from
    a rotation-vector spline with the same ends.

    The result is a stationary curve, and the best one known; large steps have several.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"`` or ``"chord"``.
        start: ``"natural"``, no acceleration at the first keyframe, which is best when the
            velocity there is free, or ``"clamped"``, the velocity *omega_start* there.
        end: the same for the last keyframe and *omega_end*.
        omega_start: body angular velocity, rad/s.
        omega_end: body angular velocity, rad/s.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
        PlanError: Newton's method does not converge to a stationary curve.
    """

    name = "min_acceleration"
    summary = "least integral of squared acceleration; the slowest to build"
    source = "Barr, Currin, Gabriel and Hughes 1992; Noakes, Heinzinger and Paden 1989"
    interpolates = True
    meets_end_velocities = True

    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike = "uniform",
        start: str = "natural",
        end: str = "natural",
        omega_start: ArrayLike | None = None,
        omega_end: ArrayLike | None = None,
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q)
        first = check_end(start, omega_start, "start")
        last = check_end(end, omega_end, "end")
        super().__init__(knots=instants, continuity=2)
        self._keys = q
        h = np.diff(instants)
        state = stationary_states(increments(q), instants, first, last)
        self._pieces: Pieces = pieces(state, h)
        self._piece_starts = self._knots[self._pieces.segment] + self._pieces.start

    def _sample(self, times: Floats) -> Samples:
        piece = np.searchsorted(self._piece_starts[1:], times, side="right")
        elapsed = times - self._piece_starts[piece]
        turn, _ = horner(self._pieces.turn[piece], elapsed)
        omega_body, alpha_body = horner(self._pieces.omega[piece], elapsed)
        turn /= np.sqrt(np.sum(turn * turn, axis=-1, keepdims=True))
        return multiply(self._keys[self._pieces.segment[piece]], turn), omega_body, alpha_body


def stationary_states(
    steps: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> State:
    """Return velocity, acceleration and its rate at the start of each segment.

    Args:
        steps: half-angle vectors from each keyframe to the next, shape ``(n, 3)``.
        instants: of the keyframes, shape ``(n + 1,)``.
        first: velocity at the first keyframe; without it the acceleration there is zero.
        last: the same for the last keyframe.

    Raises:
        PlanError: the search does not converge.
    """
    h = np.diff(instants)
    reached, stride = 0.0, 1.0
    found: Floats | None = None
    while reached < 1.0:
        target = min(1.0, reached + stride)
        ends = [None if end is None else target * end for end in (first, last)]
        equations = _Equations(target * steps, h, *ends)
        if found is None:
            guess = spline_guess(target * steps, instants, *ends)
        else:
            guess = found * (target / reached)
        settled = equations.solve(guess)
        if settled is None:
            stride *= 0.5
            if stride < SMALLEST_STEP:
                raise PlanError(
                    "no curve of least acceleration was found through the keyframes; the search "
                    f"stopped at {100.0 * reached:.1f} % of the step sizes: add keyframes or "
                    "lower the end velocities"
                )
        else:
            found, reached, stride = settled, target, 2.0 * (target - reached)
    return _state(found[:-1] if found is not None else np.zeros((len(h), 3, 3)))


def spline_guess(
    steps: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> Floats:
    """Return the states of a rotation-vector spline at its knots, shape ``(n + 1, 3, 3)``."""
    keys = [np.array([1.0, 0.0, 0.0, 0.0])]
    for step in steps:
        keys.append(multiply(keys[-1], exp_half(step)))
    spline = RotationVectorSpline(
        keys=np.array(keys),
        times=instants,
        start="natural" if first is None else "clamped",
        end="natural" if last is None else "clamped",
        omega_start=first,
        omega_end=last,
        align=False,
    )
    _, omega_body, alpha_body = spline.evaluate(instants)
    jerk = np.zeros_like(alpha_body)
    jerk[:-1] = np.diff(alpha_body, axis=0) / np.diff(instants)[:, None]
    return np.stack([omega_body, alpha_body, jerk], axis=1)


class _Equations:
    """What holds between the states at the keyframes, scaled to turns over an interval."""

    def __init__(self, steps: Floats, h: Floats, first: Floats | None, last: Floats | None) -> None:
        self._targets, self._h = exp_half(steps), h
        self._first, self._last = first, last

    def solve(self, guess: Floats) -> Floats | None:
        """Return the solution near a guess, or nothing where Newton's method does not settle."""
        unknown = guess
        blocks, error = self._linearised(unknown)
        for _ in range(ITERATIONS):
            try:
                step = -self._solve_linear(blocks, error)
            except np.linalg.LinAlgError:
                return None
            size = self._size(step)
            share = min(1.0, 2.0 / size) if size > 0.0 else 1.0
            before = float(np.sum(error * error))
            while True:
                tried = unknown + share * step
                blocks, error = self._linearised(tried)
                if np.sum(error * error) <= (1.0 - 1e-3 * share) * before or size < 1e-7:
                    break
                share *= 0.5
                if not share >= 1e-3:
                    return None
            unknown = tried
            if size < 1e-7:
                return unknown if self._size(step) < 1e-7 else None
        return None

    def _size(self, step: Floats) -> float:
        """Return the largest part of a step, in turns over the longer interval beside it."""
        h = np.append(self._h, self._h[-1])[:, None]
        scaled = step * np.stack([h, h**2, h**3], axis=1)
        return float(np.max(np.abs(scaled)))

    def _linearised(self, unknown: Floats) -> tuple[Floats, Floats]:
        """Return the derivatives between keyframes ``(n, 9, 15)``, and all errors in order."""
        h = self._h[:, None]
        turn, end, d_turn, d_end = shoot(_state(unknown[:-1]), self._h)
        missed = 2.0 * log_half(multiply(conjugate(self._targets), turn))
        blocks = np.zeros((len(h), 9, 15))
        blocks[:, 0:3, 0:9] = right_jacobian_inverse(missed) @ d_turn
        blocks[:, 3:6, 0:9] = h[..., None] * d_end.omega
        blocks[:, 6:9, 0:9] = h[..., None] ** 2 * d_end.alpha
        blocks[:, 3:6, 9:12] = -h[..., None] * np.eye(3)
        blocks[:, 6:9, 12:15] = -(h[..., None] ** 2) * np.eye(3)
        error = np.concatenate(
            [missed, h * (end.omega - unknown[1:, 0]), h**2 * (end.alpha - unknown[1:, 1])], axis=1
        )
        at_start = unknown[0, 1] if self._first is None else unknown[0, 0] - self._first
        at_end = unknown[-1, 1] if self._last is None else unknown[-1, 0] - self._last
        return blocks, np.concatenate([at_start, error.ravel(), at_end])

    def _solve_linear(self, blocks: Floats, error: Floats) -> Floats:
        count = len(self._h)
        size = len(error)
        rows = 3 + 9 * np.arange(count)
        head, tail = np.zeros((1, 9, 15)), np.zeros((1, 9, 15))
        head[0, 0:3, 3 if self._first is None else 0 :][:, :3] = np.eye(3)
        tail[0, 6:9, 12 if self._last is None else 9 :][:, :3] = np.eye(3)
        solution = solve_blocks(
            np.concatenate([head, blocks, tail]),
            np.concatenate([[0], rows, [size - 9]]),
            np.concatenate([[0], rows - 3, [size - 15]]),
            error,
        )
        step = np.zeros((count + 1) * 9)
        step[:size] = solution
        return step.reshape(-1, 3, 3)


def _state(parts: Floats) -> State:
    return State(parts[:, 0], parts[:, 1], parts[:, 2])
