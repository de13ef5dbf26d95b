"""A path of cumulative products alone, as one row of numbers for the compiled kernels.

The row begins with the number of stretches, the path time from which on the path is held, and the
orientations before it and after it.  Of each stretch follow when it begins, what is skipped of it,
its rate, its sign, how many spans and factors it has, and then what its curve is sampled from: the
breaks and the table of cubic factors, for which the number of factors is given as 0, or breaks,
base, axes, lengths and the coefficients of the basis.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from orientd.curves.cumulative import CumulativeCurve
from orientd.planner.fast import kernels
from orientd.rotation import Floats

if TYPE_CHECKING:
    from orientd.planner.path import Stretch

HEAD = 10
"""Numbers of the row before the first stretch."""

STRETCH_HEAD = 6
"""Numbers of a stretch before those of its curve."""


def plain_path(
    stretches: Sequence[Stretch], first: Floats, last: Floats, end: float
) -> Floats | None:
    """Return the row of numbers that a path is sampled from, if its curves are such products.

    Args:
        stretches: end to end.
        first: orientation before the path.
        last: orientation after it.
        end: path time from which on it is held, s.
    """
    parts: list[Floats] = [np.array([len(stretches), end]), first, last]
    for stretch in stretches:
        curve = stretch.curve
        if not isinstance(curve, CumulativeCurve):
            return None
        spans, factors = curve.spans_and_factors
        placing = (stretch.begin, stretch.skipped, stretch.rate, stretch.sign)
        parts.append(np.array([*placing, spans, factors]))
        parts += curve.parts
    return np.concatenate([part.reshape(-1) for part in parts])


def sample(path: Floats, times: Floats, rows: int) -> Floats | None:
    """Return a path at increasing *times*; nothing as long as there is no kernel for it.

    Args:
        path: from :func:`plain_path`.
        times: s, shape ``(n,)``.
        rows: 4 for the orientations alone, 10 for all.

    Returns:
        Orientation, body angular velocity and its rate, shape ``(rows, n)``.
    """
    compiled = kernels().sample_path
    if compiled is None:
        return None
    out: Floats = np.empty((rows, len(times)))
    compiled(path, np.ascontiguousarray(times), out)
    return out


def farthest_from(path: Floats, keys: Floats, times: Floats) -> float | None:
    """Return the largest angle between *keys* and a path, if there is a kernel, rad.

    Args:
        path: from :func:`plain_path`.
        keys: orientations, shape ``(n, 4)``.
        times: increasing path times at which the path should be there, s, shape ``(n,)``.
    """
    compiled = kernels().farthest_from
    return None if compiled is None else compiled(path, times, keys)
