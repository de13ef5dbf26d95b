"""The curve of least squared angular acceleration through keyframes (Barr et al.)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.c2_cumulative import C2Cumulative
from orientd.curves.contract import Curve, Samples
from orientd.curves.keyframes import check_aligned, resolve_times
from orientd.curves.rotation_vector_spline import RotationVectorSpline, check_end
from orientd.curves.shooting import Nodes, Path, settled, squared_acceleration
from orientd.errors import PlanError
from orientd.rotation import Floats

COASTED = 10.0
"""From this angle on, in rad, that an end velocity goes through in its interval, whole turns are
tried."""

SMALLEST_STEP = 1.0 / 256.0


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
    linearly, some 3 ms a keyframe.

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
        self._path = stationary_nodes(q, instants, first, last).path()

    def _sample(self, times: Floats) -> Samples:
        return self._path(times)


def stationary_nodes(
    q: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> Nodes:
    """Return states of the stationary curve, close together.

    Newton's method starts from the rotation-vector spline and, with prescribed end velocities,
    from cumulative splines, for fast ones with whole turns in the end intervals; the best result
    counts.  Where none leads to one, the end velocities are scaled up from less, each solution
    the guess for the next.

    Args:
        q: keyframes, shape ``(n, 4)``.
        instants: theirs.
        first: velocity at the first keyframe; without it the acceleration there is zero.
        last: the same for the last keyframe.

    Raises:
        PlanError: Newton's method does not converge.
    """
    guesses = [spline_path(RotationVectorSpline, q, instants, first, last)]
    if first is not None or last is not None:
        guesses += winding_paths(q, instants, first, last)
    found = []
    for path in guesses:
        nodes = None if path is None else settled(path, q, instants, first, last)
        if nodes is not None:
            found.append(nodes)
    if found:
        return min(found, key=Nodes.squared_acceleration)
    return _continued(q, instants, first, last)


def winding_paths(
    q: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> list[Path | None]:
    """Return cumulative splines with those whole turns in the end intervals that cost least.

    A fast end that is not given the turns it would coast through has to wind back: that may cost
    many times the acceleration.  The two ends are scanned one after the other.
    """
    h = np.diff(instants)
    turns = np.zeros(len(h), dtype=np.intp)
    best = spline_path(C2Cumulative, q, instants, first, last)
    least = squared_acceleration(best, instants) if best is not None else np.inf
    paths = [best]
    for place, end in ((0, first), (-1, last)):
        coasted = 0.0 if end is None else float(np.linalg.norm(end)) * float(h[place])
        reach = min(2, int(coasted / COASTED))
        kept = turns
        for count in (*range(-reach, 0), *range(1, reach + 1)):
            tried = kept.copy()
            tried[place] += count
            path = spline_path(C2Cumulative, q, instants, first, last, turns=tried)
            cost = squared_acceleration(path, instants) if path is not None else np.inf
            if path is not None and cost < least:
                best, least, turns = path, cost, tried
    if best is not paths[0]:
        paths.append(best)
    return paths


def _continued(q: Floats, instants: Floats, first: Floats | None, last: Floats | None) -> Nodes:
    """Return the stationary curve connected with the one of no end velocities."""
    reached, stride = 0.0, 0.5
    found: Nodes | None = None
    while found is None or reached < 1.0:
        target = min(1.0, reached + stride)
        ends = [None if end is None else target * end for end in (first, last)]
        if found is None:
            path = spline_path(RotationVectorSpline, q, instants, *ends)
        else:
            path = found.path()
        nodes = None if path is None else settled(path, q, instants, *ends)
        if nodes is None:
            stride *= 0.5
            if stride < SMALLEST_STEP or (first is None and last is None):
                raise PlanError(
                    "no curve of least acceleration was found through the keyframes: Newton's "
                    "method does not converge; add keyframes, lower the end velocities or make "
                    "neighbouring intervals more alike"
                )
        else:
            found, reached, stride = nodes, target, 1.5 * (target - reached)
    return found


def spline_path(
    family: type[RotationVectorSpline | C2Cumulative],
    q: Floats,
    instants: Floats,
    first: Floats | None,
    last: Floats | None,
    **options: ArrayLike,
) -> Path | None:
    """Return a spline with the same keyframes and ends, if there is one."""
    try:
        spline = family(
            keys=q,
            times=instants,
            start="natural" if first is None else "clamped",
            end="natural" if last is None else "clamped",
            omega_start=first,
            omega_end=last,
            align=False,
            **options,
        )
    except (PlanError, ValueError):
        return None
    return spline.evaluate
