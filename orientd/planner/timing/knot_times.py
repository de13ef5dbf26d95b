"""Times at keyframes that come without, chosen for the quickest way through them.

The pace along the curve is found afterwards, so these times decide nothing but where the curve
passes between the keyframes; see ``orientd/kernels/c/knot_times.h``.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from orientd import kernels
from orientd.planner.certify import limit_table
from orientd.planner.limits import Limits
from orientd.planner.request import DEFAULT_METHOD
from orientd.planner.timing.candidate_path import PathRequest
from orientd.rotation import Floats, align, angle, between

MOST_KEYFRAMES = 100
"""For which other times are tried; with more of them a plan would take too long."""

_MOST_DESCENDED = 12
"""For which the slope of the duration is looked at, which takes a curve for each of them."""
_DESCENTS = 2
_PIECES, _FEWEST = 10, 100  # elements of an interval and of all, as time_quickest begins with
_SAME_AXIS = 1e-6  # of the length, across the first axis; more than for one turn at once


def with_chosen_times(
    path_request: PathRequest, duration: float, limits: Limits
) -> tuple[PathRequest, Floats] | None:
    """Return a path request with the times of the quickest way that is found.

    Its curve leaves rest with an acceleration, since the pace along it is yet to be found.

    Args:
        path_request: of keyframes without times.
        duration: of the curve to be made, s.
        limits: to keep, with what is kept in reserve.

    Returns:
        The path request, and a first profile on the curve of that duration, its coefficients and
        utilisation, shape ``(4, n + 2)``; ``None`` where other times are not tried: where the
        method is another one, where a position moves, whole turns are made, all is one turn, or
        nothing limits the jerk.
    """
    request, kept = path_request.request, path_request.kept
    if not (
        request.method == DEFAULT_METHOD
        and not request.options
        and request.positions is None
        and path_request.has_one_shape
        and path_request.halt.is_held
        and 3 <= len(kept) <= MOST_KEYFRAMES
        and not request.turns.any()
        and min(limits.jerk, *limits.axis_jerk) < math.inf
    ):
        return None
    keys = align(request.keys[kept])
    if _is_about_one_axis(keys):
        return None
    count = len(keys) - 1
    elements = count * max(_PIECES, math.ceil(_FEWEST / count))
    chosen, profile = np.empty(count + 1), np.empty((4, elements + 2))
    descents = _DESCENTS if len(keys) <= _MOST_DESCENDED else 0
    if not kernels.choose_knots(
        keys,
        angle(keys[:-1], keys[1:]),
        limit_table(limits),
        duration,
        descents,
        chosen,
        profile,
    ):
        return None
    # Keyframes that are passed as one have one time.
    times = np.interp(path_request.times, path_request.times[kept], chosen)
    ends = replace(path_request.ends, leaves_freely=True)
    return replace(path_request, times=times, ends=ends), profile


def _is_about_one_axis(keys: Floats) -> bool:
    """Return whether all steps turn one way about one axis: such a turn is known in closed form."""
    steps = between(keys[:-1], keys[1:])[:, 1:]
    lengths = np.sqrt(np.einsum("ij,ij->i", steps, steps))
    return bool(np.all(steps @ steps[0] >= (1.0 - _SAME_AXIS) * lengths * lengths[0]))
