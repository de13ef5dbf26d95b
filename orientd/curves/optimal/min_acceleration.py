"""The curve of least squared angular acceleration through keyframes (Barr et al.)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import Path, squared_acceleration
from orientd.curves.contract import Curve, Samples, takes_common_names
from orientd.curves.interpolating import C2Cumulative
from orientd.curves.keyframes import check_aligned, check_end, increments, resolve_times
from orientd.curves.optimal.relaxation import relaxed, spline_path
from orientd.curves.optimal.shooting import Nodes, settled
from orientd.curves.rotation_vector import RotationVectorSpline
from orientd.errors import PlanError
from orientd.rotation import Floats

COASTED = 10.0
"""From this angle on, in rad, that an end velocity goes through in its interval, whole turns are
tried."""

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
        super().__init__(knots=instants, continuity=2)
        self._path = stationary_nodes(q, instants, first, last).path()

    def _sample(self, times: Floats) -> Samples:
        return self._path(times)


def stationary_nodes(
    q: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> Nodes:
    """Return states of the stationary curve, close together.

    Newton's method starts from the rotation-vector spline, for fast ends from the cumulative spline
    with the best whole turns at its ends instead where that costs less.  Where a start leads
    nowhere, or a step is so large that there may be several stationary curves, it is relaxed
    towards a minimum too, and the better result counts.

    Args:
        q: keyframes, shape ``(n, 4)``.
        instants: theirs.
        first: velocity at the first keyframe; without it the acceleration there is zero.
        last: the same for the last keyframe.

    Raises:
        PlanError: Newton's method does not converge.
    """
    guesses = [spline_path(RotationVectorSpline, q, instants, first, last)]
    if guesses[0] is None or any(winding_reaches(instants, first, last)):
        guesses.append(winding_path(q, instants, first, last))
    is_large = float(np.max(np.sum(increments(q) ** 2, axis=1))) > 0.25 * LARGE**2
    paths = [path for path in guesses if path is not None]
    for path in sorted(paths, key=lambda path: squared_acceleration(path, instants)):
        found = settled(path, q, instants, first, last)
        if found is None or is_large:
            near = relaxed(path, instants, first, last)
            other = None if near is None else settled(near, q, instants, first, last)
            both = [nodes for nodes in (found, other) if nodes is not None]
            found = min(both, key=Nodes.squared_acceleration, default=None)
        if found is not None:
            return found
    raise PlanError(
        "no curve of least acceleration was found through the keyframes: Newton's method does "
        "not converge, or only over more pieces than are tried; add keyframes, lower the end "
        "velocities or make neighbouring intervals more alike"
    )


def winding_reaches(instants: Floats, first: Floats | None, last: Floats | None) -> list[int]:
    """Return how many whole turns either way are worth trying in the first and last interval."""
    ends = zip((first, last), np.diff(instants)[[0, -1]].tolist(), strict=True)
    return [
        0 if end is None else min(2, int(float(np.linalg.norm(end)) * h / COASTED))
        for end, h in ends
    ]


def winding_path(
    q: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> Path | None:
    """Return the cumulative spline with those whole turns in its end intervals that cost least.

    A fast end that is not given the turns it would coast through has to wind back: that may cost
    many times the acceleration.  The two ends are scanned one after the other.
    """
    turns = np.zeros(len(instants) - 1, dtype=np.intp)
    best = spline_path(C2Cumulative, q, instants, first, last)
    reaches = winding_reaches(instants, first, last)
    if not any(reaches):
        return best
    least = np.inf if best is None else squared_acceleration(best, instants)
    for place, reach in zip((0, -1), reaches, strict=True):
        kept = turns
        for count in (*range(-reach, 0), *range(1, reach + 1)):
            tried = kept.copy()
            tried[place] += count
            path = spline_path(C2Cumulative, q, instants, first, last, turns=tried)
            cost = np.inf if path is None else squared_acceleration(path, instants)
            if cost < least:
                best, least, turns = path, cost, tried
    return best
