"""The poles of a gimbal near a path: where its axes turn by far more than the tool.

Near a pole the outer axis makes up to half a turn while the tool turns by about its distance from
the pole.  The axes follow such a path, slowly.  Closer to the pole the path rests, and the axes
turn around the pole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from orientd.curves.trajectory import Trajectory
from orientd.driver import ZERO, Joints
from orientd.errors import PlanError
from orientd.mechanism import Gimbal, Mechanism
from orientd.mechanism.arrays import (
    AT_POLE,
    joints_at,
    matrices,
    of_arrays,
    orientations,
    pole_distances,
    row_of,
)
from orientd.mechanism.gimbal import LOCK
from orientd.mechanism.mechanism import inside
from orientd.mechanism.pointing import pointing_error
from orientd.mechanism.routing import joints_along, made
from orientd.mechanism.turning import CLOSE, HOP, angles_in_words, turned
from orientd.mechanism.way import Slew, Way
from orientd.rotation import Floats, angle, conjugate, exp, multiply, rotate

_NEAR, _EXACT = 0.3, 1e-9
"""Sines of the distance from a pole within which a path passes it, and leads through it."""

_WIDTH, _NARROWEST, _LEAST_WIDTH = 3.0, 0.1, 4.0
"""Half of the way of a shift, rad: as a multiple of its root, at least, and as a multiple of it."""

_FEWEST, _GLANCE, _ZOOMS = 24, 0.02, 6
"""Fewest samples of the search for poles between two knots, the largest turn of the tool between
two of them, rad, and how often it looks closer."""

_RISES = 1.001
"""Factor by which the distance from a pole rises between two approaches."""

_ROUNDING, _ROUNDING_OF_PATH = 1e-15, 1e-13
"""Of an angle, and of the orientations of a path, rad; differences of near samples enlarge them."""

_ELSEWHERE = 4e-3
"""Turn of the outer axis from which it does not follow a path that leaves a pole, rad."""

_WIDER, _APART = 3.0, 0.3
"""Ratio of the intervals near a pole, and the least share of them between two knots."""


class _Approach(NamedTuple):
    """Where a path is closest to a pole.

    Attributes:
        time: path time, s.
        sine: of the distance from the pole.
        speed: of the tool there, rad/s.
        begin: path time before it from which the tool turns only a little, s.
        end: path time after it, up to which it turns as little, s.
    """

    time: float
    sine: float
    speed: float
    begin: float
    end: float


def turn_in(trajectory: Trajectory, span: tuple[float, float]) -> float:
    """Return at least about the turn of the tool in an interval of path times, rad."""
    rates = trajectory.sample(np.linspace(*span, _FEWEST))[1]
    return float(np.linalg.norm(rates, axis=1).max()) * (span[1] - span[0])


def samples_of(trajectory: Trajectory) -> Floats:
    """Return path times between which the tool hardly turns, s, shape ``(n,)``."""
    spans = pairwise(trajectory.knots.tolist())
    grids = [
        np.linspace(*span, _FEWEST + math.ceil(turn_in(trajectory, span) / _GLANCE), endpoint=False)
        for span in spans
    ]
    return np.concatenate([*grids, trajectory.knots[-1:]])


def _distances(gimbal: Gimbal, trajectory: Trajectory) -> tuple[Floats, Floats]:
    """Return path times, s, and the sines of the distance from a pole there."""
    times = samples_of(trajectory)
    return times, pole_distances(gimbal, trajectory.orientations(times))


def _approaches(gimbal: Gimbal, path: Trajectory) -> list[_Approach]:
    """Return where a path is closest to a pole."""
    found = []
    times, far = _distances(gimbal, path)
    for place in _least_places(far):
        low, high = times[max(place - 1, 0)], times[min(place + 1, len(times) - 1)]
        for _ in range(_ZOOMS):
            fine = np.linspace(low, high, _FEWEST + 1)
            closer = pole_distances(gimbal, path.orientations(fine))
            at = int(np.argmin(closer))
            low, high = fine[max(at - 1, 0)], fine[min(at + 1, _FEWEST)]
        time, speed = float(fine[at]), float(np.linalg.norm(path.sample(fine[[at]])[1]))
        ends = _near(path, times, time)
        found.append(_Approach(time, float(closer[at]), speed, *ends))
    return found


def _near(path: Trajectory, times: Floats, time: float) -> tuple[float, float]:
    """Return path times before and after another one, between which the tool turns by a hop, s.

    Args:
        path: the path.
        times: path times between which the tool hardly turns, s.
        time: between them.
    """
    here = path.orientations(np.array([time]))

    def turned_by(some: Floats) -> Floats:
        return angle(np.repeat(here, len(some), axis=0), path.orientations(some))

    is_away, ends = turned_by(times) >= HOP, []
    for every, last in (
        (np.flatnonzero(is_away & (times < time))[::-1], 0),
        (np.flatnonzero(is_away & (times > time)), -1),
    ):
        if not len(every):
            ends.append(float(times[last]))
            continue
        near, far = time, float(times[every[0]])
        for _ in range(_ZOOMS):
            fine = np.linspace(near, far, _FEWEST + 1)
            first = max(int(np.argmax(turned_by(fine) >= HOP)), 1)
            near, far = float(fine[first - 1]), float(fine[first])
        ends.append(far)
    return ends[0], ends[1]


def _least_places(far: Floats) -> list[int]:
    """Return where distances from a pole are least; an even section has one place."""
    is_least = (far <= np.append(far[1:], np.inf)) & (far < np.append(np.inf, far[:-1]))
    found: list[int] = []
    for place in np.flatnonzero(is_least & (far < _NEAR)).tolist():
        if found and far[found[-1] : place].max() <= _RISES * max(far[found[-1]], far[place]):
            found[-1] = min(found[-1], place, key=far.__getitem__)
        else:
            found.append(place)
    return found


def with_poles(mechanism: Mechanism, path: Trajectory, knots: Sequence[float]) -> Sequence[float]:
    """Return knots with others near the poles of a gimbal, closer together towards them.

    Args:
        mechanism: kinematics of the axes.
        path: the path.
        knots: path times between which it is smooth, s.
    """
    if not isinstance(mechanism, Gimbal):
        return knots
    found, ends = np.array(knots), path.knots[[0, -1]]
    is_smooth = path.continuity >= 2
    for one in _approaches(mechanism, path):
        if one.sine < AT_POLE:
            # Straight through it the axes turn evenly, and rounding is large.
            is_far = (found < one.begin) | (found > one.end)
            found = found[is_far | np.isin(found, ends)] if is_smooth else found
            continue
        step = one.sine / one.speed if one.speed else math.inf
        while step < ends[1] - ends[0]:
            beside = one.time + step * np.array([-1.0, 1.0])
            # Next to another knot they would only be closer together than they have to be.
            gaps = np.abs(beside[:, None] - np.array(knots)).min(axis=1)
            is_new = (beside > ends[0]) & (beside < ends[1]) & (gaps > _APART * step)
            found, step = np.append(found, beside[is_new]), step * _WIDER
    beside_poles: list[float] = np.sort(found).tolist()
    return beside_poles


def rounding(mechanism: Mechanism, q: Floats) -> float:
    """Return the rounding of axis angles for orientations, rad; it grows towards a pole."""
    if not isinstance(mechanism, Gimbal):
        return _ROUNDING
    return _ROUNDING_OF_PATH / max(float(np.min(pole_distances(mechanism, q))), AT_POLE)


def passes_pole(mechanism: Mechanism, path: Trajectory) -> bool:
    """Return whether a path comes so near to a pole of a gimbal that another may be quicker."""
    if not isinstance(mechanism, Gimbal):
        return False
    return bool(_approaches(mechanism, path))


def around_poles(gimbal: Gimbal, path: Way, near: Joints, deviation: float = 0.0) -> Way:
    """Return a path that leads through the poles to which it comes close, or rests next to them.

    Any other path is returned as it is.

    Args:
        gimbal: kinematics and limits of the axes.
        path: the path.
        near: axis angles at its start, rad.
        deviation: largest angle by which it may be shifted to lead through a pole, rad.

    Raises:
        PlanError: a pose is out of reach.
    """
    found, hops = path, list[tuple[float, float]]()
    farthest = float(np.max(_distances(gimbal, path.trajectory)[1]))
    if _EXACT < farthest < CLOSE:
        return _rested(gimbal, path, [(0.0, path.duration)], near)
    for one in _approaches(gimbal, path.trajectory):
        if not one.time and _elsewhere(gimbal, path.trajectory, near) > _ELSEWHERE:
            hops.append((0.0, one.end))
        if one.time == path.duration and _arrives_elsewhere(gimbal, path.trajectory):
            hops.append((one.begin, one.time))
        if one.time in (0.0, path.duration):
            continue
        shift = math.asin(one.sine)
        width = _width(one, path, shift)
        is_through = shift <= max(deviation, AT_POLE) and width > 0.0
        through = found
        if is_through and one.sine > _EXACT:
            through = _shifted(gimbal, found, one, width, shift)
        if (is_through or one.sine < AT_POLE) and _leads_out(gimbal, through, one, near):
            if one.sine < CLOSE:
                hops.append((one.begin, one.end))
        elif is_through:
            found = through
        elif AT_POLE < one.sine < CLOSE and not is_through:
            inner = path.times[(path.times > one.begin) & (path.times < one.end)].tolist()
            hops += pairwise([one.begin, *inner, one.end])
    return _rested(gimbal, found, hops, near) if hops else found


def through_poles(mechanism: Mechanism, path: Way, deviation: float) -> Way:
    """Return a path shifted near the poles of a gimbal by a deviation, rad; it keeps its pace.

    It leads through each pole within the deviation, and passes another one further away.
    """
    gimbal, found = mechanism, path
    if not isinstance(gimbal, Gimbal):
        return path
    for one in _approaches(gimbal, path.trajectory) if deviation else []:
        far = math.asin(one.sine)
        shift = far if far <= deviation else -deviation
        width = _width(one, path, abs(shift))
        if width and one.sine > _EXACT:
            found = _shifted(gimbal, found, one, width, shift)
    return found


def _width(at: _Approach, path: Way, shift: float) -> float:
    """Return half of the duration of a shift, rad, at a pole, s; 0 if there is no room for it."""
    if not at.speed:
        return 0.0
    room = min(at.time, path.duration - at.time)
    width = min(max(_WIDTH * math.sqrt(shift), _NARROWEST) / at.speed, room)
    return width if width * at.speed > _LEAST_WIDTH * shift else 0.0


def check_leaving(gimbal: Gimbal, path: Trajectory, near: Joints) -> None:
    """Check that a path that begins at a pole leaves it where the outer axis is.

    Args:
        gimbal: kinematics and limits of the axes.
        path: the path, which rests at its start until it begins.
        near: axis angles at its start, rad.

    Raises:
        PlanError: the outer axis would have to turn at the pole first.
    """
    away = _elsewhere(gimbal, path, near)
    if away > _ELSEWHERE:
        outer = gimbal.axes[0].name
        raise PlanError(
            f"the path leaves the pole in a direction that is {math.degrees(away):.1f} deg away "
            f"from where {outer} is; leave out the times or `allow_slews`, so that {outer} turns "
            "at the pole first"
        )


def _elsewhere(gimbal: Gimbal, path: Trajectory, near: Joints) -> float:
    """Return how far the outer axis is from where a path that begins at a pole leaves it, rad."""
    times, far = _distances(gimbal, path)
    is_away = far >= HOP
    if far[0] > CLOSE or not is_away.any():
        return 0.0
    there = path.orientations(times[[int(np.argmax(is_away))]])
    outer, _ = gimbal.kinematics.pointing(gimbal.kinematics.matrix(row_of(there[0])))
    return abs(math.remainder(outer - near[0], math.pi))


def _arrives_elsewhere(gimbal: Gimbal, path: Trajectory) -> bool:
    """Return whether a path that ends next to a pole arrives where the outer axis does not end."""
    times, far = _distances(gimbal, path)
    is_away = far >= HOP
    if not _EXACT < far[-1] <= CLOSE or not is_away.any():
        return False
    ends = path.orientations(times[[int(np.flatnonzero(is_away)[-1]), -1]])
    outer = [gimbal.kinematics.pointing(gimbal.kinematics.matrix(row_of(q)))[0] for q in ends]
    return abs(math.remainder(outer[1] - outer[0], math.pi)) > _ELSEWHERE


def _leads_out(gimbal: Gimbal, path: Way, at: _Approach, near: Joints) -> bool:
    """Return whether an axis leaves its range somewhere behind a pole, straight through it."""
    begin = at.begin
    if begin:
        near = _joints_at_end(gimbal, path.trajectory.restricted(0.0, begin), near)
    joints = _joints_along(gimbal, path.trajectory.restricted(begin, path.duration), near)
    return _is_outside(gimbal, joints)


def _is_outside(gimbal: Gimbal, joints: Floats) -> bool:
    """Return whether axis angles leave the ranges somewhere."""
    low, high, edge = np.array([(one.low, one.high, one.resolution) for one in gimbal.axes]).T
    return bool(np.any((joints < low - edge) | (joints > high + edge)))


def _shifted(gimbal: Gimbal, path: Way, at: _Approach, width: float, shift: float) -> Way:
    """Return a path shifted around its closest approach to a pole, by an angle towards it, rad.

    The shift and its first three derivatives are zero beyond *width* seconds of path time.
    """
    trajectory, mount = path.trajectory, np.array(gimbal.kinematics.mount)
    q = trajectory.orientations(np.array([at.time]))[0]
    outer, inner = gimbal.kinematics.axes[0], gimbal.kinematics.inner_axis
    base = multiply(conjugate(mount), multiply(q, conjugate(np.array(gimbal.kinematics.tool))))
    direction, pole = rotate(base, np.eye(3)[inner]), np.eye(3)[outer]
    pole = pole if float(direction @ pole) > 0.0 else -pole
    across = np.cross(direction, pole)
    size = float(np.linalg.norm(across))
    if not size:
        return path
    turn = rotate(mount, shift / size * across)

    def shifted(times: Floats) -> Floats:
        share = np.clip(1.0 - ((times - at.time) / width) ** 2, 0.0, None) ** 4
        return np.asarray(multiply(exp(share[:, None] * turn), trajectory.orientations(times)))

    begin, end = at.time - width, at.time + width
    knots = trajectory.knots[(trajectory.knots > begin) & (trajectory.knots < end)]
    middle = Trajectory.fit(
        shifted, sorted({begin, at.time, end, *knots.tolist()}), continuity=trajectory.continuity
    )
    parts = [trajectory.restricted(0.0, begin)] if begin > 0.0 else []
    parts.append(middle)
    if end < path.duration:
        parts.append(trajectory.restricted(end, path.duration))
    whole = Trajectory.joined(parts, trajectory.continuity)
    missed = abs(shift)
    kind = "pass" if shift > 0.0 else "deviation"
    note = f"{kind} near the pole, missing by at most {math.degrees(missed):.3f} deg"
    missed = max(path.missed, missed)
    return replace(path, trajectory=whole, notes=(*path.notes, note), missed=missed)


def _rested(gimbal: Gimbal, path: Way, hops: Sequence[tuple[float, float]], near: Joints) -> Way:
    """Return a path that rests at both ends of each hop, between which the axes turn evenly."""
    parts, slews, passed, notes = [], list(path.slews), 0.0, list(path.notes)
    for begin, end in hops:
        begin = max(begin, passed)
        if begin >= end:
            continue
        if begin > passed:
            part = path.trajectory.restricted(passed, begin)
            parts.append(part)
            near = _joints_at_end(gimbal, part, near)
        slew = _hop(gimbal, path.trajectory, (begin, end), near)
        hop = Trajectory.fit(partial(turned, gimbal, slew), (begin, end))
        goal = angles_in_words(slew.there)
        off = math.degrees(_missed(gimbal, path.trajectory, hop))
        notes.append(
            f"at the pole the path stops and the axes slew to {goal} deg, off it by up to "
            f"{off:.2f} deg"
        )
        parts.append(hop)
        slews.append(slew)
        near, passed = slew.there, end
    if passed < path.duration:
        parts.append(path.trajectory.restricted(passed, path.duration))
    whole = Trajectory.joined(parts, 0)
    return replace(path, trajectory=whole, notes=tuple(notes), slews=tuple(slews))


def made_by_two(gimbal: Gimbal, path: Way, near: Joints) -> Way:
    """Return the path that two axes make, with the roll that they give it.

    Args:
        gimbal: kinematics and limits of the axes.
        path: the path as requested.
        near: axis angles at its start, rad.

    Raises:
        LimitError: they leave more roll than the gimbal allows.
        PlanError: an axis would jump.
    """
    trajectory, parts, passed, missed = path.trajectory, list[Trajectory](), 0.0, path.missed
    for slew in [*path.slews, None]:
        until = path.duration if slew is None else slew.begin
        if until > passed:
            asked = trajectory.restricted(passed, until)
            part, near, off = _made(gimbal, asked, near)
            parts.append(part)
            missed = max(missed, off)
        if slew is not None:
            parts.append(trajectory.restricted(slew.begin, slew.end))
            near, passed = slew.there, slew.end
    whole = Trajectory.joined(parts, 0 if path.slews else trajectory.continuity)
    return replace(path, trajectory=whole, missed=missed)


def _made(gimbal: Gimbal, asked: Trajectory, near: Joints) -> tuple[Trajectory, Joints, float]:
    """Return what two axes make of a trajectory, their angles at its end, and how far it is off."""
    grid = np.linspace(*asked.domain, _FEWEST + math.ceil(_length(asked) / CLOSE))
    q = asked.orientations(grid)
    line = joints_along(gimbal, grid, q, np.zeros((len(grid), 3)), near)

    def as_made(times: Floats) -> Floats:
        matrix = matrices(gimbal, asked.orientations(times))
        outer, sine = of_arrays(gimbal).pointing(matrix)
        about = np.stack([np.interp(times, grid, column) for column in line.T], axis=1)
        outer = np.where(sine > LOCK, outer, about[:, 0])
        outer += np.pi * np.round((about[:, 0] - outer) / np.pi)
        return orientations(gimbal, joints_at(gimbal, matrix, outer))

    try:
        whole = Trajectory.fit(as_made, asked.knots, continuity=asked.continuity)
    except ValueError as error:
        raise PlanError(f"{gimbal.axes[0].name} would have to jump at the pole") from error
    off = 0.0
    if gimbal.is_fitting:
        made(gimbal, line, q, float(grid[1] - grid[0]))
        off = float(np.max(angle(orientations(gimbal, line), q)))
    return whole, tuple(line[-1].tolist()), off


def _length(trajectory: Trajectory) -> float:
    """Return about the length of a trajectory, rad."""
    begin, end = trajectory.domain
    rates = trajectory.sample(np.linspace(begin, end, _FEWEST))[1]
    return float(np.linalg.norm(rates, axis=1).max()) * (end - begin)


def _joints_at_end(gimbal: Gimbal, part: Trajectory, near: Joints) -> Joints:
    """Return the axis angles at the end of a part of a path that begins near *near*, rad."""
    return tuple(_joints_along(gimbal, part, near)[-1].tolist())


def _joints_along(gimbal: Gimbal, part: Trajectory, near: Joints) -> Floats:
    """Return the axis angles along a part of a path, rad, shape ``(n, axes)``."""
    times = np.linspace(*part.domain, _FEWEST + math.ceil(_length(part) / CLOSE))
    return joints_along(gimbal, times, part.orientations(times), np.zeros((len(times), 3)), near)


def _hop(gimbal: Gimbal, trajectory: Trajectory, span: tuple[float, float], here: Joints) -> Slew:
    """Return the even turn of the axes that takes the place of a part of a path.

    Args:
        gimbal: kinematics and limits of the axes.
        trajectory: the path.
        span: path times of the part, s.
        here: axis angles at its beginning, rad.
    """
    q = row_of(trajectory.orientations(np.array([span[1]]))[0])
    branches = gimbal.branches(q, here)
    if gimbal.is_fitting and gimbal.is_at_pole(q):
        # The direction does not tell the outer angle there, but the roll does.
        branches = [gimbal.solve(q, here)[0]]
    within = [inside(gimbal.axes, one, here) for one in branches]
    speed = np.array([axis.velocity for axis in gimbal.axes])
    ways, end = [one for one in within if one is not None], trajectory.domain[1]
    rest = trajectory.restricted(span[1], trajectory.domain[1]) if span[1] < end else None

    def cost(there: Joints) -> tuple[bool, float]:
        leads_out = rest is not None and _is_outside(gimbal, _joints_along(gimbal, rest, there))
        return leads_out, float(np.max(np.abs(np.subtract(there, here)) / speed))

    there = min(ways or [gimbal.nearest(q, ZERO, here)], key=cost)
    return Slew(*span, here, there)


def _missed(gimbal: Gimbal, asked: Trajectory, made: Trajectory) -> float:
    """Return the largest angle between a path and a part in its place, rad."""
    times = np.linspace(*made.domain, _FEWEST + 1)
    far = pointing_error(gimbal, made.orientations(times), asked.orientations(times))
    return float(np.max(far))
