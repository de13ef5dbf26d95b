r"""Lead-ins from rest into a motion, and lead-outs from a motion to rest.

A **lead-out** begins in the state :math:`(q, \omega, \alpha)` of a motion's end and comes to rest.
It is the quintic quaternion curve with velocity and acceleration given at both ends
(``kks_quintic_hermite``) to :math:`q \exp(\omega T/2 + \alpha T^2/12)`.  With that end and parallel
vectors the velocity is the cubic

.. math:: \Omega(u) = \omega (1 - 3u^2 + 2u^3) + \alpha T (u - 2u^2 + u^3), \quad u = t/T,

which falls to rest with no acceleration left.  Without velocity it returns to *q* itself,
:math:`\Omega(u) = \tfrac12 \alpha T (2u - 9u^2 + 12u^3 - 5u^4)`.  A **run-up** is the mirror image
in time of a lead-out from :math:`(q, -\omega, \alpha)`, and an **approach** turns about one axis,
from rest to rest.  The duration is the shortest whole number of periods that keeps the limits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orientd.curves import AxisTurn, Trajectory
from orientd.errors import PlanError
from orientd.planner.connect.quintic_connector import join
from orientd.planner.limits import LONGEST, STILL, Limits
from orientd.planner.path import UNIT_ACCELERATION, UNIT_JERK, UNIT_VELOCITY
from orientd.planner.timing import CAREFUL_JERK_SHARE, SHARE, phases_of_turn
from orientd.rotation import (
    Floats,
    align,
    angle,
    between,
    exp_half,
    log_half,
    multiply,
    nearer_sign,
)

Booleans = NDArray[np.bool_]

_SAME = 1e-12  # rad and m
_SLACK = 1e-9  # of a period
_GRID = 160
_BLOCK = 20  # of the grid, looked at in one go
_FINEST_SHARES = np.linspace(0.0, 1.0, 65)
_SHARES = np.linspace(0.0, 1.0, 33)
_VELOCITY_MARGIN = 0.9999  # of the limit, for peaks between the points that are looked at


@dataclass(frozen=True, slots=True)
class _Bounds:
    """What a lead keeps: the limits with their reserve, but never less than what it begins with."""

    velocity: float
    acceleration: float
    jerk: float
    axis_velocity: Floats
    axis_acceleration: Floats
    axis_jerk: Floats

    @classmethod
    def of(cls, limits: Limits, omega: Floats, alpha: Floats) -> _Bounds:
        reserved = limits.with_reserve()
        rounding = 1.0 + 1e-9
        return cls(
            max(_VELOCITY_MARGIN * limits.velocity, rounding * float(np.linalg.norm(omega))),
            max(reserved.acceleration, rounding * float(np.linalg.norm(alpha))),
            reserved.jerk,
            np.maximum(_VELOCITY_MARGIN * np.array(limits.axis_velocity), rounding * np.abs(omega)),
            np.maximum(reserved.axis_acceleration, rounding * np.abs(alpha)),
            np.array(reserved.axis_jerk),
        )

    @property
    def least(self) -> tuple[float, float]:
        """Acceleration and jerk that are allowed in any direction."""
        return (
            min(self.acceleration, float(self.axis_acceleration.min())),
            min(self.jerk, float(self.axis_jerk.min())),
        )

    def keeps(self, velocity: Floats, acceleration: Floats, jerk: Floats) -> Booleans:
        kept: Booleans = np.all(
            (_norm(velocity) <= self.velocity)
            & (_norm(acceleration) <= self.acceleration)
            & (_norm(jerk) <= self.jerk)
            & np.all(np.abs(velocity) <= self.axis_velocity, axis=-1)
            & np.all(np.abs(acceleration) <= self.axis_acceleration, axis=-1)
            & np.all(np.abs(jerk) <= self.axis_jerk, axis=-1),
            axis=-1,
        )
        return kept


def _norm(vectors: Floats) -> Floats:
    norm: Floats = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    return norm


def lead_out(
    q: Floats, omega: Floats, alpha: Floats, *, limits: Limits, period: float
) -> Trajectory:
    """Return the trajectory from a state to rest, over ``[0, T]``.

    Args:
        q: orientation, shape ``(4,)``.
        omega: angular velocity, body frame, rad/s.
        alpha: angular acceleration in body components, rad/s^2.
        limits: to keep, with their reserve.
        period: the duration is a whole multiple of it, s.

    Raises:
        PlanError: no duration that is planned keeps the limits.
    """
    bounds = _Bounds.of(limits, omega, alpha)
    for cycles in _candidates(omega, alpha, bounds, period):
        lead = _lead(q, omega, alpha, cycles * period)
        if _is_kept(lead, bounds):
            return lead
    raise PlanError(
        f"between rest and {np.linalg.norm(omega):.4g} rad/s with {np.linalg.norm(alpha):.4g} "
        f"rad/s^2 none keeps the limits of {limits.velocity:g} rad/s, {limits.acceleration:g} "
        f"rad/s^2 and {limits.jerk:g} rad/s^3; ask for a lower velocity there, or give it more time"
    )


def _lead(q: Floats, omega: Floats, alpha: Floats, duration: float) -> Trajectory:
    if np.linalg.norm(omega) > STILL:
        turn = omega * (duration / 2.0) + alpha * (duration**2 / 12.0)
        end = multiply(q, exp_half(0.5 * turn))
    else:
        end = q
    # The signs carry the whole turn, which may be more than half of one: they must stay.
    return _to_rest(q, end, omega, alpha, duration)


def _to_rest(q: Floats, end: Floats, omega: Floats, alpha: Floats, duration: float) -> Trajectory:
    """Return the quintic that ends at rest, the way round that the signs of the quaternions say."""
    first = duration / 10.0 * omega
    second = first + duration**2 / 40.0 * alpha
    before = exp_half(-np.stack([second, first]))
    middle = log_half(multiply(multiply(before[0], before[1]), between(q, end)))
    rest = np.zeros(3)
    return join(q, np.stack([first, second, middle, rest, rest]), duration)


def _candidates(omega: Floats, alpha: Floats, bounds: _Bounds, period: float) -> Iterator[int]:
    """Yield numbers of cycles to try, in order, by the closed form of parallel vectors."""
    speed, size = math.hypot(*omega.tolist()), math.hypot(*alpha.tolist())
    most_acceleration, most_jerk = bounds.least
    scale = (
        1.5 * speed / most_acceleration
        + math.sqrt(6.0 * speed / most_jerk)
        + 9.0 * size / most_jerk
    )
    check_lead("a lead", scale)
    most = math.ceil(min(10.0 * scale, LONGEST) / period) + 8
    grid = np.unique(np.round(np.geomspace(1.0, most, _GRID)).astype(np.int64))
    blocks = np.array_split(grid, range(_BLOCK, len(grid), _BLOCK))
    low, found, near = 0, 0, []
    for block in blocks:
        is_kept = _closed_form_keeps(omega, alpha, period * block.astype(np.float64), bounds)
        kept = block[is_kept].tolist()
        if not kept and not found:
            low = int(block[-1])
        elif not found:
            place = int(np.argmax(is_kept))
            low, found = int(block[place - 1]) if place else low, kept[0]
            while found - low > 1:
                middle = (low + found) // 2
                if _closed_form_keeps(omega, alpha, period * np.array([middle]), bounds)[0]:
                    found = middle
                else:
                    low = middle
            # Vectors that are not parallel need a little longer.
            near = [found + math.ceil(found * share) for share in (0.0, 0.005, 0.01, 0.02, 0.04)]
        # What lies beyond the block comes with the next one.
        here = {n for n in (*kept, *near) if found <= n <= block[-1]}
        near = [n for n in near if n > block[-1]]
        yield from sorted(here)
    yield from near


def _closed_form_keeps(
    omega: Floats, alpha: Floats, durations: Floats, bounds: _Bounds
) -> Booleans:
    u = _SHARES[:, None]
    t = durations[:, None, None]
    if np.linalg.norm(omega) > STILL:
        velocity = omega * (1 - 3 * u**2 + 2 * u**3) + alpha * t * (u - 2 * u**2 + u**3)
        acceleration = omega * (6 * u**2 - 6 * u) / t + alpha * (1 - 4 * u + 3 * u**2)
        jerk = omega * (12 * u - 6) / t**2 + alpha * (6 * u - 4) / t
    else:
        velocity = 0.5 * alpha * t * (2 * u - 9 * u**2 + 12 * u**3 - 5 * u**4)
        acceleration = 0.5 * alpha * (2 - 18 * u + 36 * u**2 - 20 * u**3) + 0.0 * t
        jerk = 0.5 * alpha * (72 * u - 18 - 60 * u**2) / t
    return bounds.keeps(velocity, acceleration, jerk)


def _is_kept(lead: Trajectory, bounds: _Bounds) -> bool:
    duration = lead.duration
    _, velocity, acceleration = lead.sample(_FINEST_SHARES * duration)
    jerk = np.diff(acceleration, axis=0) / (_FINEST_SHARES[1] * duration)
    return bool(bounds.keeps(velocity, acceleration, np.concatenate([jerk, jerk[-1:]])))


def approach_cycles(
    q0: Floats,
    q1: Floats,
    p0: Floats,
    p1: Floats,
    *,
    limits: Limits,
    period: float,
    is_even: bool = False,
) -> int:
    """Return the fewest periods for a turn and a move from rest to rest; 0 if neither is needed.

    The arguments are those of :func:`approach`, and the positions.

    Raises:
        PlanError: it takes longer than is planned.
    """
    turn, move = approach(q0, q1, limits, is_even=is_even), float(np.linalg.norm(p1 - p0))
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
    zero = np.zeros(3)
    return _to_rest(q0, align([q0, q1])[1], zero, zero, duration)


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
