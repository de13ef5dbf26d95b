r"""How a moving position comes to rest: at a given point, or at any point.

The pieces are quintics with position, velocity and acceleration given at both ends.  A stop ends at
:math:`p + vT/2 + aT^2/12`.  Its velocity is then the cubic Hermite polynomial :math:`v (1 - 3u^2 +
2u^3) + aT (u - 2u^2 + u^3)` with :math:`u = t/T`.
"""

from __future__ import annotations

import math

import numpy as np

from orientd.curves.quintic import QUINTIC, quintic, quintics
from orientd.errors import PlanError
from orientd.model.limits import LONGEST, Limits
from orientd.planner.path import Motion3, PositionPath
from orientd.planner.state import State
from orientd.rotation import Floats

_MOST_LOOKS = 64  # at durations
_SLACK = 1e-9  # of a period
_PRECISION = 0.01  # of the shortest duration
_INDEX = np.arange(float(QUINTIC))
_LOOKS = 65  # along a piece


def _contributions() -> tuple[Floats, Floats]:
    """Return velocities and accelerations of quintics over a time of 1 that end at rest.

    Returns:
        Those for a distance, an initial velocity and an initial acceleration of 1, at even places,
        shape ``(3, n, 1)`` each.
    """
    given: Floats = np.zeros((3, 2, 3))
    given[0, 1, 0] = given[1, 0, 1] = given[2, 0, 2] = 1.0
    pieces = quintics(np.ones(1), *given)[0, ::-1].T
    places = np.linspace(0.0, 1.0, _LOOKS)
    rates, bends = (
        np.array([np.polyval(np.polyder(one, order), places) for one in pieces]) for order in (1, 2)
    )
    return rates[..., None], bends[..., None]


_RATES, _BENDS = _contributions()
_MARGIN = 1.0 + 1e-9
_ZERO = np.zeros(3)


def position_lead(
    start: State, target: Floats | None, *, limits: Limits, period: float, least: float = 0.0
) -> PositionPath:
    """Return the path of a position from its current state to rest, beginning at time 0.

    The velocity may be as high as at the beginning, and otherwise keeps *limits*.  The acceleration
    keeps them with its reserve.

    Args:
        start: position, velocity and acceleration.
        target: final position, m; ``None`` leaves it open.
        period: the path takes a whole number of periods, s.
        least: preferred duration, s; used if it keeps the limits.

    Raises:
        PlanError: the target is days away.
    """
    if not start.is_position_moving and (target is None or (target == start.position).all()):
        return PositionPath.held(start.position)
    here: Motion3 = (start.position, start.velocity, start.acceleration)
    bounds = _bounds(here, limits)
    if least > 0.0 and _excess(here, target, least, bounds) <= 1.0:
        return _path([(_piece(here, target, least), least)], start.position, target)
    pieces: list[tuple[Floats, float]] = []
    duration = _shortest(here, target, bounds, period)
    if duration is None:
        # The acceleration falls first, and changes its sign if the velocity would exceed its limit;
        # its rate of change is not limited.
        p, v, a = here
        turns = float(np.linalg.norm(v + a * period / 2.0)) > bounds[0]
        last = -a if turns else _ZERO
        way = v * period + (2.0 * a + last) * period**2 / 6.0
        after: Motion3 = (p + way, v + (a + last) * period / 2.0, last)
        pieces.append((quintic(here, after, period), period))
        here, bounds = after, _bounds(after, limits)
        duration = _shortest(here, target, bounds, period)
    if duration is None:
        raise PlanError("found no path to rest from the velocity of the position")
    pieces.append((_piece(here, target, duration), duration))
    return _path(pieces, start.position, target)


def _path(pieces: list[tuple[Floats, float]], first: Floats, target: Floats | None) -> PositionPath:
    breaks = np.cumsum([0.0, *(duration for _, duration in pieces)])
    coefficients = np.array([piece for piece, _ in pieces])
    last = coefficients[-1].T @ pieces[-1][1] ** _INDEX if target is None else target
    return PositionPath(breaks, coefficients, first, last)


def _piece(here: Motion3, target: Floats | None, duration: float) -> Floats:
    p, v, a = here
    end = p + v * duration / 2.0 + a * duration**2 / 12.0 if target is None else target
    return quintic(here, (end, _ZERO, _ZERO), duration)


def _bounds(here: Motion3, limits: Limits) -> tuple[float, float]:
    return (
        max(limits.linear_velocity, _MARGIN * float(np.linalg.norm(here[1]))),
        max(limits.with_reserve().linear_acceleration, _MARGIN * float(np.linalg.norm(here[2]))),
    )


def _excess(
    here: Motion3, target: Floats | None, duration: float, bounds: tuple[float, float]
) -> float:
    """Return by which factor a piece should be slower for the bounds."""
    (p, v, a), t = here, duration
    way = v * t / 2.0 + a * t**2 / 12.0 if target is None else target - p
    velocity = way / t * _RATES[0] + v * _RATES[1] + a * t * _RATES[2]
    push = way / t**2 * _BENDS[0] + v / t * _BENDS[1] + a * _BENDS[2]
    return max(_peak(velocity) / bounds[0], math.sqrt(_peak(push) / bounds[1]))


def _peak(vectors: Floats) -> float:
    """Return the largest size of a vector from even samples: that of a parabola through three."""
    sizes = np.sqrt(np.einsum("ui,ui->u", vectors, vectors))
    at = int(np.argmax(sizes))
    largest = float(sizes[at])
    if not 0 < at < len(sizes) - 1:
        return largest
    before, after = sizes[[at - 1, at + 1]].tolist()
    bend = before - 2.0 * largest + after
    return largest - (after - before) ** 2 / (8.0 * bend) if bend < 0.0 else largest


def _shortest(
    here: Motion3, target: Floats | None, bounds: tuple[float, float], period: float
) -> float | None:
    """Return about the shortest duration of a single piece, in whole periods.

    The distance and the initial velocity add a velocity and an acceleration that fall with the
    duration.  The initial acceleration adds what does not, so there may be no duration.
    """
    distance = 0.0 if target is None else float(np.linalg.norm(target - here[0]))
    check_lead("a move of the position", distance / bounds[0])
    fewest, cycles = 0, 1
    for _ in range(_MOST_LOOKS):
        excess = _excess(here, target, cycles * period, bounds)
        if excess <= 1.0:
            break
        if excess * cycles * period > LONGEST:
            return None
        fewest, cycles = cycles, max(math.ceil(excess * cycles - _SLACK), cycles + 1)
    else:
        return None
    while cycles - fewest > max(1.0, _PRECISION * cycles):
        middle = (fewest + cycles) // 2
        if _excess(here, target, middle * period, bounds) <= 1.0:
            cycles = middle
        else:
            fewest = middle
    return cycles * period


def check_lead(what: str, duration: float) -> None:
    """Refuse a lead that would take days.

    Raises:
        PlanError: it is longer than allowed.
    """
    if not duration <= LONGEST:
        raise PlanError(f"{what} takes {duration:.6g} s, at most {LONGEST:g} s is planned")
