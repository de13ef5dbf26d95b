r"""Lead-ins from rest into a motion, and lead-outs from a motion to rest.

A **lead-out** begins in the state :math:`(q, \omega, \alpha)` of a motion's end and comes to rest:
``orientd/kernels/c/leave.c`` has its formulas.  A **run-up** is the mirror image in time of a
lead-out from :math:`(q, -\omega, \alpha)`, and an **approach** turns about one axis, from rest to
rest.  The duration is the shortest whole number of periods that keeps the limits.
"""

from __future__ import annotations

import math

import numpy as np

from orientd import kernels
from orientd.curves import AxisTurn, Trajectory
from orientd.errors import PlanError
from orientd.planner.certify import limit_table
from orientd.planner.connect.quintic_connector import FACTORS, join, joins, state_row
from orientd.planner.limits import LONGEST, Limits
from orientd.planner.path import UNIT_ACCELERATION, UNIT_JERK, UNIT_VELOCITY
from orientd.planner.request import State
from orientd.planner.timing import CAREFUL_JERK_SHARE, SHARE, phases_of_turn
from orientd.rotation import Floats, align, angle, between, log_half, nearer_sign

_SAME = 1e-12  # rad and m
_SLACK = 1e-9  # of a period


def lead_out(start: State, *, limits: Limits, period: float, may_ramp: bool = False) -> Trajectory:
    """Return the trajectory from a state to rest, over ``[0, T]``.

    Args:
        start: the state.
        limits: to keep, with their reserve.
        period: the duration is a whole multiple of it, s.
        may_ramp: whether the acceleration may change first, at the limit of the jerk, if the device
            is at rest sooner then.

    Raises:
        PlanError: no duration that is planned keeps the limits.
    """
    q, w, breaks = np.empty((2, 4)), np.empty((2, FACTORS, 3)), np.empty(3)
    table = limit_table(limits.with_reserve())
    count = kernels.leave(state_row(start), table, period, LONGEST, may_ramp, q, w, breaks)
    if count:
        return joins(q[:count], w[:count], breaks[: count + 1])
    check_lead("a lead", float(breaks[1]))
    raise PlanError(
        f"between rest and {np.linalg.norm(start.omega_body):.4g} rad/s with "
        f"{np.linalg.norm(start.alpha_body):.4g} rad/s^2 none keeps the limits of "
        f"{limits.velocity:g} rad/s, {limits.acceleration:g} rad/s^2 and {limits.jerk:g} rad/s^3; "
        "ask for a lower velocity there, or give it more time"
    )


def approach_cycles(turn: Trajectory | None, move: float, *, limits: Limits, period: float) -> int:
    """Return the fewest periods for a turn and a move from rest to rest; 0 if neither is needed.

    Args:
        turn: the one of :func:`approach`.
        move: of the position, m.
        limits: to keep.
        period: s.

    Raises:
        PlanError: it takes longer than is planned.
    """
    most = limits.with_reserve().linear_acceleration
    duration = max(
        0.0 if turn is None else turn.duration,
        UNIT_VELOCITY * move / limits.linear_velocity if move > _SAME else 0.0,
        math.sqrt(UNIT_ACCELERATION * move / most) if move > _SAME else 0.0,
    )
    check_lead("an approach", duration)
    return math.ceil(duration / period - _SLACK)


def approach(
    q0: Floats,
    q1: Floats,
    limits: Limits,
    *,
    is_even: bool = False,
    share: float = SHARE,
    jerk_share: float = CAREFUL_JERK_SHARE,
    is_part: bool = True,
) -> Trajectory | None:
    """Return the quickest turn from rest at *q0* to rest at *q1*, the short way round.

    It begins at path time 0; there is none where both are the same.

    Args:
        q0: where it begins.
        q1: where it ends.
        limits: to keep.
        is_even: whether it is to be a quintic, as long as its peaks need, instead.
        share: of the acceleration to use.
        jerk_share: of the jerk.
        is_part: whether it is one of a longer motion.

    Raises:
        PlanError: it takes longer than is planned.
    """
    turn = float(angle(q0, q1))
    if turn <= _SAME:
        return None
    axis, is_shorter = _axis_between(q0.tolist(), q1.tolist())
    if not is_shorter:
        turn = 2.0 * math.pi - turn
    if math.isfinite(limits.acceleration) and not is_even:
        phases = phases_of_turn(
            axis, turn, limits, share=share, jerk_share=jerk_share, is_part=is_part
        )
        check_lead("an approach", float(phases.sum()))
        return AxisTurn(q0, axis, turn, phases).trajectory
    velocity, acceleration, jerk = limits.with_reserve().along(axis.tolist())
    duration = max(
        UNIT_VELOCITY * turn / velocity,
        math.sqrt(UNIT_ACCELERATION * turn / acceleration),
        math.cbrt(UNIT_JERK * turn / jerk),
    )
    check_lead("an approach", duration)
    w = np.zeros((FACTORS, 3))
    w[2] = log_half(between(*align([q0, q1])))
    return join(q0, w, duration)


def _axis_between(q0: list[float], q1: list[float]) -> tuple[Floats, bool]:
    """Return the axis of the shorter turn between two orientations, in the body frame.

    Also whether it is the shorter one: a half turn goes the way of :func:`.nearer_sign`, which may
    be longer by rounding.  In plain numbers, which takes a tenth of what the same takes on arrays.
    """
    (w0, x0, y0, z0), (w1, x1, y1, z1) = q0, q1
    w = w0 * w1 + x0 * x1 + y0 * y1 + z0 * z1
    x = w0 * x1 - x0 * w1 - y0 * z1 + z0 * y1
    y = w0 * y1 - y0 * w1 - z0 * x1 + x0 * z1
    z = w0 * z1 - z0 * w1 - x0 * y1 + y0 * x1
    sign = nearer_sign(w, x, y, z)
    scale = sign / math.hypot(x, y, z)
    return np.array([scale * x, scale * y, scale * z]), sign * w >= 0.0


def check_lead(what: str, duration: float) -> None:
    """Refuse a lead that would take days.

    Raises:
        PlanError: it is longer than allowed.
    """
    if not duration <= LONGEST:
        raise PlanError(f"{what} takes {duration:.6g} s, at most {LONGEST:g} s is planned")
