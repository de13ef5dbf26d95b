"""The curve of least squared angular acceleration through keyframes (Barr et al.)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import Path, squared_acceleration
from orientd.curves.contract import Curve, takes_common_names
from orientd.curves.keyframes import check_aligned, check_end, increments, resolve_times
from orientd.curves.optimal.minimum_effort import MinimumEffort
from orientd.curves.optimal.shooting import Nodes, settled
from orientd.curves.optimal.starts import spline_path, winding_path, winding_reaches
from orientd.curves.rotation_vector import RotationVectorSpline
from orientd.errors import PlanError
from orientd.rotation import Floats

LARGE = 2.0
"""Rad, from one keyframe to the next, from which there may be several stationary curves."""


class MinAcceleration(Curve):
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
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
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
    takes = ("keys", "times", "start", "end", "omega_start", "omega_end", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        start: str = "natural",
        end: str = "natural",
        omega_start: ArrayLike | None = None,
        omega_end: ArrayLike | None = None,
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q)
        first, _ = check_end(start, "start", omega_start)
        last, _ = check_end(end, "end", omega_end)
        self._ends = tuple(
            (omega, np.zeros(3) if omega is None else None) for omega in (first, last)
        )
        self._path = stationary_path(q, instants, first, last)
        super().__init__(knots=instants, continuity=2)

    @property
    def _end_states(self) -> tuple[tuple[Floats | None, Floats | None], ...]:
        return self._ends

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
