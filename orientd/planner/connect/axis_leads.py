"""Leads from a motion that the axes of a device can follow.

The connector of a tool uses the limits of the tool to the full from the beginning on, so the tool
cannot wait for an axis on it.  Only its way counts here: it is timed for tool and axes at once,
from the velocity that both have.  The connector at a lower pace has a longer way, on which it can.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from orientd.curves.trajectory import Trajectory
from orientd.driver import Joints
from orientd.errors import PlanError
from orientd.model.limits import Limits
from orientd.planner.connect.connector import hold
from orientd.planner.connect.leads import Lead
from orientd.planner.path import end_states
from orientd.planner.timing.axes import Axes
from orientd.planner.timing.even import excess
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.planner.timing.profiles import quickest
from orientd.rotation import Floats

_PACES = np.geomspace(1.0, 0.12, 7)
"""Shares of the tool's pace, each for another way."""

_SHARE = 0.95
"""Share of the acceleration and jerk of an axis.

It is more than that of timings, so that a device that brakes as a timing does can go elsewhere.
"""

_RISE = 1.0
"""Fewest periods in which an axis reaches its acceleration, since it may have some already."""

_ELEMENT = 20.0  # longest interval of the mesh, periods: connectors change quickly at their ends
_WHOLE = 1e-9  # of a period


def followed(
    find: Callable[[float], Lead],
    axes: Axes,
    near: Joints,
    limits: Limits,
    period: float,
    *,
    has_one_way: bool = False,
) -> Lead:
    """Return a lead on the first way on which the axes can keep their limits.

    Args:
        find: returns the lead of the tool alone, at a share of its pace.
        axes: of the device.
        near: their angles where it begins, rad.
        limits: of the tool.
        period: of the device, s.
        has_one_way: whether a lower pace has the same way, as from rest to rest.

    Raises:
        PlanError: the axes cannot follow any of them; the reason is that of the shortest.
    """
    refusal: PlanError | None = None
    for pace in [1.0] if has_one_way else _PACES.tolist():
        try:
            return _followed(find(pace), axes, near, limits, period, is_quickest=pace == 1.0)
        except PlanError as error:
            refusal = refusal or error
    raise refusal or ValueError("there must be a pace")


def _followed(
    lead: Lead, axes: Axes, near: Joints, limits: Limits, period: float, *, is_quickest: bool
) -> Lead:
    """Return the same way at a pace that the axes can follow.

    Args:
        is_quickest: whether its own pace is the quickest of the tool, so that it stays if the axes
            can follow it.  So does a pace that no timing begins or ends with.

    Raises:
        PlanError: the axes cannot follow it, or the limits allow no timing.
    """
    if not lead.parts:
        return replace(lead, joints=near)
    whole = Trajectory.joined(lead.parts)
    asked = KeyframePath(whole, lead.positions, np.array([0.0, whole.duration]))
    path = axes.made(asked, lambda: near)
    along = axes.along(path, near, limits, period, _SHARE, _RISE)
    own = replace(lead, parts=(path.trajectory,), joints=along.end)
    begins_at_rest, ends_at_rest = path.held_ends(limits)
    can_follow = along.excess(period) <= 1.0
    if path is not asked:
        # The tool turns further than asked, by the roll that the axes give it.
        can_follow = can_follow and excess(path, limits, period) <= 1.0
    if can_follow and is_quickest:
        return own
    if not (begins_at_rest or ends_at_rest):
        # It takes whole periods, which no timing keeps between two velocities.
        if can_follow:
            return own
        raise PlanError(
            "the axes cannot follow the tool from one velocity to another; stop first, or ask for "
            "a lower one"
        )
    finer = replace(path.trajectory, knots=_finer(path.trajectory.knots, _ELEMENT * period))
    try:
        timed = quickest(replace(path, trajectory=finer), limits, period, axes=along)
    except PlanError:
        if can_follow:
            return own
        raise
    cycles = math.ceil(timed.duration / period - _WHOLE)
    rest, parts, positions = cycles * period - timed.duration, [timed.trajectory], timed.positions
    if rest > _WHOLE * period:
        first, last = end_states(timed.trajectory)
        if ends_at_rest:
            parts.append(hold(np.ascontiguousarray(last.q), rest).shifted(timed.duration))
        else:
            parts = [hold(np.ascontiguousarray(first.q), rest), timed.trajectory.shifted(rest)]
            positions = positions.delayed(rest)
    return Lead(tuple(parts), cycles, positions, along.end)


def _finer(knots: Floats, widest: float) -> Floats:
    """Return the knots with others between them, at most *widest* apart."""
    counts = np.ceil(np.diff(knots) / widest).astype(int).tolist()
    spans = zip(pairwise(knots.tolist()), counts, strict=True)
    inner = [np.linspace(*span, count, endpoint=False) for span, count in spans]
    return np.concatenate([*inner, knots[-1:]])
