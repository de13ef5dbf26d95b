"""Initial curves for the searches for optimal curves: splines with the same keyframes and ends."""

from __future__ import annotations

from typing import Any

import numpy as np

from orientd.curves.contract import Curve
from orientd.curves.interpolating import C2Cumulative
from orientd.curves.products import Path, squared_acceleration
from orientd.curves.rotation_vector import RotationVectorSpline
from orientd.errors import PlanError
from orientd.rotation import Floats

COASTED = 10.0
"""Angle in rad of an end velocity over its interval from which whole turns are tried."""


def spline_path(
    family: type[Curve],
    q: Floats,
    instants: Floats,
    first: Floats | None,
    last: Floats | None,
    **options: Any,  # noqa: ANN401 - of any family
) -> Path | None:
    """Return the path of a spline with the same keyframes, signs and ends, if there is one.

    An end without a velocity is natural.
    """
    for side, omega in (("start", first), ("end", last)):
        options |= {side: "natural" if omega is None else "clamped", f"omega_{side}": omega}
    try:
        spline = family(keys=q, times=instants, align=False, **options)
        spline.ends()  # none if the spline spins too fast to be sampled
    except (PlanError, ValueError):
        return None
    return spline.evaluate


def start_path(
    q: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> tuple[Path, Floats]:
    """Return a curve near which to search, and the keyframes with their signs on it.

    Raises:
        PlanError: the search found none.
    """
    ends = (q, instants, first, last)
    path = winding_path(*ends) or spline_path(RotationVectorSpline, *ends)
    if path is None:
        raise PlanError(
            "no curve was found through the keyframes near which to look for one of least effort: "
            "add keyframes, lower the end velocities or make neighbouring intervals more alike"
        )
    signs = np.sign(np.sum(q * path(instants)[0], axis=1, keepdims=True))
    return path, q * signs


def winding_reaches(instants: Floats, first: Floats | None, last: Floats | None) -> list[int]:
    """Return how many whole turns in either direction to try in the first and last interval."""
    ends = zip((first, last), np.diff(instants)[[0, -1]].tolist(), strict=True)
    return [
        0 if end is None else min(2, int(float(np.linalg.norm(end)) * h / COASTED))
        for end, h in ends
    ]


def winding_path(
    q: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> Path | None:
    """Return the cumulative spline whose end intervals have the best number of whole turns.

    Without enough turns, a fast end has to wind back, which may take many times the acceleration.
    The two ends are scanned one after the other.
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
