r"""The curve of least squared angular acceleration through keyframes (Barr et al.).

It is found by Newton's method on states along it (multiple shooting).

Between keyframes such a curve satisfies :math:`\Omega''' = \Omega'' \times \Omega` in the body
frame (Noakes, Heinzinger and Paden, 1989, "Cubic splines on curved spaces"): the second derivative
of the velocity stands still in the world frame.  With *p* the turn since the start of a piece,

.. math:: p' = \tfrac12 p\, \Omega, \quad \Omega' = \alpha, \quad \alpha' = J, \quad
          J' = J \times \Omega

is solved by collocation at Gauss's nodes, whose equations Picard's iteration settles to rounding on
a piece over which the curve turns by about a radian.

The unknowns are orientation, angular velocity, acceleration and its rate *J* at nodes as close
together as that.  Every piece must end in the state the next one starts from.  At a keyframe the
orientation is given and *J* may jump instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from orientd.curves.contract import WithEndVelocities
from orientd.curves.keyframes import EndState, increments
from orientd.curves.minimum_effort import MinimumEffort
from orientd.curves.newton import Linearised, newton, solve_blocks
from orientd.curves.products import Path, squared_acceleration
from orientd.curves.rotation_vector import RotationVectorSpline
from orientd.curves.starts import spline_path, winding_path, winding_reaches
from orientd.curves.trajectory import Samples
from orientd.errors import PlanError
from orientd.rotation import (
    Floats,
    conjugate,
    exp_half,
    log_half,
    multiply,
    normalize,
    right_jacobian_inverse,
    rotate,
)

LARGE = 2.0
"""Rad, from one keyframe to the next, from which there may be several stationary curves."""


STRIDE = 1.2
"""How much may happen over a piece: velocity, root of acceleration and cube root of its rate,
each times the duration, in rad."""

PLACES = 14
ROUNDS = 20
"""Of Picard's iteration, of which each gains a power of the stride over its number."""

ITERATIONS = 30
REFINEMENTS = 4
MOST_PIECES = 200
"""For each keyframe; a guess that needs more, several turns in each interval, leads nowhere."""

ROUNDING = 1e-9
"""A Newton step as small as this one is the last."""

FEW = 7
"""Places, and rounds, for derivatives: good to 1e-6, which costs Newton's method no step."""


class MinAcceleration(WithEndVelocities):
    r"""Interpolate keyframes with the least integral of squared angular acceleration.

    .. math:: \min \int \|\dot\Omega\|^2 dt \quad\Rightarrow\quad
              \dddot\Omega = \ddot\Omega \times \Omega \text{ between keyframes},
              \quad \Omega, \dot\Omega \text{ continuous at them}

    Barr, Currin, Gabriel and Hughes (1992); Nielson (1993), "The Minimum Tangential Acceleration
    Method".  The :math:`c \times c'' \times c` printed there must be read as the part of *c''*
    along the sphere, :math:`c'' - (c \cdot c'') c`, whose norm is :math:`\|\dot\Omega\|/2`.  They
    discretise the curve and hand it to an optimiser; here the Euler equation of the problem
    (Noakes, Heinzinger and Paden, 1989) is solved to rounding: Taylor series over pieces of about a
    radian, and Newton's method on the states between all of them at once (multiple shooting), from
    the rotation-vector spline with the same ends.

    The result is a stationary curve, and the best one found: large steps have several, and a fast
    end may coast through whole turns instead of winding back, which are tried for it (at 20 rad/s
    over intervals of 1 s they lower the integral by a factor of two to three).  Time grows
    linearly, some 1 to 5 ms a keyframe.

    Picture: ``orientd plot min_acceleration``.

    Args:
        start: ``"natural"``, no acceleration at the first keyframe, which is best when the
            velocity there is free, or ``"clamped"``, the velocity *omega_start* there.
        end: the same for the last keyframe and *omega_end*.

    Raises:
        PlanError: Newton's method does not converge to a stationary curve.
    """

    name = "min_acceleration"
    summary = "least integral of squared acceleration; the slowest to build"
    source = "Barr, Currin, Gabriel and Hughes 1992; Noakes, Heinzinger and Paden 1989"

    def _solve(self, q: Floats, instants: Floats, first: EndState, last: EndState) -> None:
        still = np.zeros(3)
        self._ends = (
            (first if first[0] is not None else (None, still)),
            (last if last[0] is not None else (None, still)),
        )
        self._path = stationary_path(q, instants, first[0], last[0])
        self._set_knots(instants, 2)

    def _orientations(self, times: Floats) -> Floats:
        return self._path(times)[0]


def stationary_path(q: Floats, instants: Floats, first: Floats | None, last: Floats | None) -> Path:
    """Return the stationary curve of least acceleration that is found.

    Newton's method starts from the rotation-vector spline, and for fast ends from the cumulative
    spline with the best whole turns at its ends, the one that costs less first.  If neither leads
    anywhere, or a step is so large that there may be several stationary curves, it starts from the
    spline of least effort too, and the best result counts.

    Args:
        q: keyframes, shape ``(n, 4)``.
        instants: theirs.
        first: velocity at the first keyframe; without it the acceleration there is zero.
        last: the same for the last keyframe.

    Raises:
        PlanError: Newton's method does not converge.
    """
    ends = (q, instants, first, last)
    guesses = [spline_path(RotationVectorSpline, *ends)]
    if guesses[0] is None or any(winding_reaches(instants, first, last)):
        guesses.append(winding_path(*ends))
    paths = [path for path in guesses if path is not None]
    paths.sort(key=lambda path: squared_acceleration(path, instants))
    found = next(filter(None, (settled(path, *ends) for path in paths)), None)
    is_large = float(np.max(np.sum(increments(q) ** 2, axis=1))) > 0.25 * LARGE**2
    if found is None or is_large:
        near = spline_path(MinimumEffort, *ends)
        other = None if near is None else settled(near, *ends)
        both = [nodes for nodes in (found, other) if nodes is not None]
        found = min(both, key=Nodes.squared_acceleration, default=None)
    if found is None:
        raise PlanError(
            "no curve of least acceleration was found through the keyframes: Newton's method does "
            "not converge, or only over more pieces than are tried; add keyframes, lower the end "
            "velocities or make neighbouring intervals more alike"
        )
    return found.path()


def _integrals(count: int) -> Floats:
    """Return what takes values at Gauss's nodes to the integrals up to each, from -1 on."""
    nodes = legendre.leggauss(count)[0]
    integrated = legendre.legval(nodes, legendre.legint(np.eye(count), lbnd=-1.0))
    matrix: Floats = integrated.T @ np.linalg.inv(legendre.legvander(nodes, count - 1))
    return matrix


_NODES, _WEIGHTS = legendre.leggauss(PLACES)
_TO_SERIES = np.linalg.inv(legendre.legvander(_NODES, PLACES - 1))
"""From values at the nodes to the coefficients of their Legendre series."""

_INTEGRALS, _FEW_INTEGRALS = _integrals(PLACES), _integrals(FEW)
_FEW_NODES, _FEW_WEIGHTS = legendre.leggauss(FEW)
_TO_FEW = legendre.legvander(_FEW_NODES, PLACES - 1) @ _TO_SERIES

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


@dataclass(frozen=True)
class Pieces:
    """The solution of the equations from a state at the start of each piece.

    Attributes:
        half: half the durations, s, shape ``(m, 1, 1)``.
        turn: since the start, at the nodes, shape ``(m, PLACES, 4)``.
        omega: angular velocity at the nodes, shape ``(m, PLACES, 3)``.
        alpha: its rate.
        jerk: the rate of that.
        ends: turn, angular velocity, acceleration and its rate at the ends, shape ``(m, 13)``.
    """

    half: Floats
    turn: Floats
    omega: Floats
    alpha: Floats
    jerk: Floats
    ends: Floats

    @classmethod
    def of(cls, parts: tuple[Floats, Floats, Floats], durations: Floats) -> Pieces:
        """Return the pieces that begin with an angular velocity, acceleration and its rate."""
        half = 0.5 * durations[:, None, None]
        starts = [part[:, None] for part in parts]
        omega, alpha, jerk = (np.repeat(part, PLACES, axis=1) for part in starts)
        for _ in range(ROUNDS):
            jerk = starts[2] + half * (_INTEGRALS @ _cross(jerk, omega))
            alpha = starts[1] + half * (_INTEGRALS @ jerk)
            omega = starts[0] + half * (_INTEGRALS @ alpha)
        spin = np.concatenate([np.zeros_like(omega[..., :1]), 0.5 * omega], axis=-1)
        still = np.array([1.0, 0.0, 0.0, 0.0])
        turn = np.broadcast_to(still, spin.shape)
        for _ in range(ROUNDS):
            turn = still + half * (_INTEGRALS @ multiply(turn, spin))
        rates = np.concatenate([multiply(turn, spin), alpha, jerk, _cross(jerk, omega)], axis=-1)
        begun = np.concatenate([np.tile(still, (len(half), 1)), *parts], axis=-1)
        ends = begun + half[:, 0] * (_WEIGHTS @ rates)
        return cls(half, turn, omega, alpha, jerk, ends)

    def derivatives(self) -> Floats:
        """Return how the ends change with the state at the start, shape ``(m, 12, 9)``.

        In rows stand the turn, as a body increment, velocity, acceleration and its rate, in columns
        the last three.
        """
        starts = np.eye(9).reshape(3, 1, 3, 9)
        by_omega, by_jerk = (_cross_matrices(_TO_FEW @ part) for part in (self.omega, self.jerk))
        shape = (len(self.half), FEW, 3, 9)

        def integrated(rate: Floats) -> Floats:
            total: Floats = self.half * (_FEW_INTEGRALS @ rate.reshape(-1, FEW, 27))
            return total.reshape(shape)

        omega, alpha, jerk = (np.broadcast_to(start, shape) for start in starts)
        for _ in range(FEW):
            spun = by_jerk @ omega - by_omega @ jerk
            jerk = starts[2] + integrated(spun)
            alpha = starts[1] + integrated(jerk)
            omega = starts[0] + integrated(alpha)
        turn = integrated(omega)
        for _ in range(FEW):
            turn = integrated(omega - by_omega @ turn)
        rates = (omega - by_omega @ turn, alpha, jerk, by_jerk @ omega - by_omega @ jerk)
        gained = [np.einsum("p,mpic->mic", _FEW_WEIGHTS, rate) for rate in rates]
        begun = np.concatenate([np.zeros((3, 9)), np.eye(9)])
        changed: Floats = begun + self.half * np.concatenate(gained, axis=1)
        return changed


@dataclass(frozen=True)
class Nodes:
    """States along a curve, the keyframes among them.

    Attributes:
        times: instants, shape ``(m + 1,)``.
        is_key: which of them are keyframes.
        q: orientations, shape ``(m + 1, 4)``.
        parts: angular velocity, acceleration and its rate, ``(m + 1, 3)`` each; the rate is that
            of the piece that begins at the node.
    """

    times: Floats
    is_key: NDArray[np.bool_]
    q: Floats
    parts: tuple[Floats, Floats, Floats]

    def moved(self, step: Floats) -> Nodes:
        """Return the nodes moved by body increments and changes of state, ``(m + 1, 4, 3)``."""
        q = normalize(multiply(self.q, exp_half(0.5 * step[:, 0])))
        omega, alpha, jerk = (part + step[:, 1 + k] for k, part in enumerate(self.parts))
        return Nodes(self.times, self.is_key, q, (omega, alpha, jerk))

    def pieces(self) -> Pieces:
        """Return the curve from each node to where the next one should be."""
        omega, alpha, jerk = (part[:-1] for part in self.parts)
        return Pieces.of((omega, alpha, jerk), np.diff(self.times))

    def is_close(self) -> bool:
        """Tell whether the nodes are so close together that the collocation is exact."""
        omega, alpha, jerk = (part[:-1] for part in self.parts)
        return bool(np.max(_pace(omega, alpha, jerk) * np.diff(self.times)) <= 1.5 * STRIDE)

    def squared_acceleration(self) -> float:
        """Return the integral of squared angular acceleration."""
        return squared_acceleration(self.path(), self.times)

    def path(self) -> NodesPath:
        """Return the curve through the nodes."""
        found = self.pieces()
        values = np.concatenate([found.turn, found.omega, found.alpha], axis=-1)
        return NodesPath(self.times, self.q, _TO_SERIES @ values)


@dataclass(frozen=True, slots=True, eq=False)
class NodesPath:
    """The curve through nodes.

    Attributes:
        times: instants of the nodes, shape ``(m + 1,)``.
        q: orientations there, shape ``(m + 1, 4)``.
        series: Legendre coefficients of turn, angular velocity and acceleration on each piece,
            shape ``(m, PLACES, 10)``.
    """

    times: Floats
    q: Floats
    series: Floats

    def __call__(self, times: Floats) -> Samples:
        """Return orientation, angular velocity and angular acceleration at *times*."""
        piece = np.searchsorted(self.times[1:-1], times, side="right")
        begin, end = self.times[piece], self.times[piece + 1]
        values = legendre.legvander((2.0 * times - begin - end) / (end - begin), PLACES - 1)
        found = np.einsum("tp,tpc->tc", values, self.series[piece])
        return normalize(multiply(self.q[piece], found[:, :4])), found[:, 4:7], found[:, 7:]


def settled(
    path: Path, q: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> Nodes | None:
    """Return the stationary curve near a guess, its nodes close, or nothing if none is found."""
    for _ in range(REFINEMENTS):
        nodes = nodes_along(path, q, instants)
        if nodes is None:
            return None
        h = np.diff(nodes.times, append=2.0 * nodes.times[-1] - nodes.times[-2])[:, None]
        found = newton(
            _equations(first, last),
            nodes,
            move=Nodes.moved,
            size=_turned_by(np.stack([np.ones_like(h), h, h**2, h**3], axis=1)),
            tolerance=ROUNDING,
            iterations=ITERATIONS,
        )
        if found is None or found.is_close():
            return found
        path = found.path()
    return None


def nodes_along(path: Path, q: Floats, knots: Floats) -> Nodes | None:
    """Return nodes on a guess, close where it is fast; nothing where that would be too many.

    Args:
        path: a curve through the keyframes.
        q: keyframes, with the signs wanted, shape ``(n, 4)``.
        knots: their instants.
    """
    h = np.diff(knots)
    count = 8
    times = knots[:-1, None] + h[:, None] * np.arange(count + 1) / count
    times[:, -1] = knots[1:]
    _, omega, alpha = path(times.ravel())
    omega, alpha = (part.reshape(len(h), count + 1, 3) for part in (omega, alpha))
    jerk = np.diff(alpha, axis=1, append=2.0 * alpha[:, -1:] - alpha[:, -2:-1])
    jerk *= (count / h)[:, None, None]
    pieces = np.maximum(np.ceil(h * _pace(omega, alpha, jerk).max(axis=1) / STRIDE), 1.0)
    if not pieces.sum() < MOST_PIECES * len(q):
        return None
    counts = pieces.astype(np.intp)
    start = np.repeat(np.arange(len(h)), counts)
    number = np.arange(len(start)) - np.repeat(np.cumsum(counts) - counts, counts)
    nodes = np.append(knots[start] + h[start] * number / counts[start], knots[-1])
    is_key = np.append(number == 0, True)
    orientation, omega, alpha = path(nodes)
    orientation = np.array(orientation)
    # An odd number of whole turns away from a keyframe, the other sign leads on to it.
    orientation[is_key] = q * np.sign(np.sum(q * orientation[is_key], axis=1, keepdims=True))
    rate = np.zeros_like(alpha)
    rate[:-1] = np.diff(alpha, axis=0) / np.diff(nodes)[:, None]
    return Nodes(nodes, is_key, orientation, (omega, alpha, rate))


def _pace(omega: Floats, alpha: Floats, jerk: Floats) -> Floats:
    """Return what, times a duration, ``STRIDE`` is compared with, in 1/s."""
    rates = (np.sqrt(np.sum(part * part, axis=-1)) for part in (omega, alpha, jerk))
    fastest: Floats = np.max([rate ** (1.0 / k) for k, rate in enumerate(rates, 1)], axis=0)
    return fastest


def _turned_by(scale: Floats) -> Callable[[Floats], float]:
    """Return the size of a step: its largest part, as a turn over the piece beside it."""
    return lambda step: float(np.max(np.abs(step * scale)))


def _cross(a: Floats, b: Floats) -> Floats:
    """Return cross products, several times as fast as NumPy's for a few thousand vectors."""
    product: Floats = a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]
    return product


def _cross_matrices(v: Floats) -> Floats:
    """Return the matrices of cross products ``v x``, shape ``(..., 3, 3)``."""
    matrices: Floats = np.swapaxes(np.cross(v[..., None, :], np.eye(3)), -1, -2)
    return matrices


def _equations(first: Floats | None, last: Floats | None) -> Callable[[Nodes], Linearised]:
    """Return what holds between the states at neighbouring nodes, scaled by the time between."""
    at_start, at_end = 3 if first is not None else 6, 3 if last is not None else 6

    def equations(nodes: Nodes) -> Linearised:
        omega, alpha, jerk = nodes.parts
        pieces = nodes.pieces()
        h = 2.0 * pieces.half[:, 0]
        turn, reached = pieces.ends[:, :4], pieces.ends[:, 4:]
        missed = 2.0 * log_half(multiply(conjugate(nodes.q[1:]), multiply(nodes.q[:-1], turn)))
        jumps = np.where(nodes.is_key[1:, None], 0.0, h**3)
        error = np.concatenate(
            [
                missed,
                h * (reached[:, :3] - omega[1:]),
                h**2 * (reached[:, 3:6] - alpha[1:]),
                jumps * (reached[:, 6:] - jerk[1:]),
            ],
            axis=1,
        )
        begun = alpha[0] if first is None else omega[0] - first
        ended = alpha[-1] if last is None else omega[-1] - last
        errors = np.concatenate([np.zeros(3), begun, error.ravel(), ended])

        def step() -> Floats:
            scales = np.concatenate([h, h**2, jumps], axis=1).repeat(3, axis=1)[..., None]
            change = pieces.derivatives()
            to_error = right_jacobian_inverse(missed)
            blocks = np.zeros((len(h), 12, 24))
            blocks[:, 0:3, 0:3] = to_error @ np.swapaxes(
                rotate(conjugate(turn)[:, None], np.eye(3)), 1, 2
            )
            blocks[:, 0:3, 3:12] = to_error @ change[:, :3]
            blocks[:, 0:3, 12:15] = -right_jacobian_inverse(-missed)
            blocks[:, 3:12, 3:12] = scales * change[:, 3:]
            blocks[:, 3:12, 15:24] = -scales * np.eye(9)
            blocks[:, 9:12, 12:15] = np.where(nodes.is_key[1:, None, None], np.eye(3), 0.0)
            head, tail = np.zeros((1, 12, 24)), np.zeros((1, 12, 24))
            head[0, 0:3, 0:3] = head[0, 3:6, at_start : at_start + 3] = np.eye(3)
            tail[0, 9:12, 12 + at_end : 15 + at_end] = np.eye(3)
            rows, size = 6 + 12 * np.arange(len(h)), len(errors)
            solution = solve_blocks(
                np.concatenate([head, blocks, tail]),
                np.concatenate([[0], rows, [size - 12]]),
                np.concatenate([[0], rows - 6, [size - 21]]),
                -errors,
            )
            # The last node has no rate of acceleration.
            return np.append(solution, np.zeros(3)).reshape(-1, 4, 3)

        return errors, step

    return equations
