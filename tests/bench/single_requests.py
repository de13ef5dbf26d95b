"""Random requests of single plans, and a judge of their motions that does not trust the planner.

``plans(seed, kind)`` returns one request.  ``judged_plan(case)`` plans it and returns what is wrong
with the outcome.  The judge uses NumPy alone.  It differentiates the setpoints that a driver would
get, with holds before and after, and measures the path between them.
"""

from dataclasses import dataclass, replace

import numpy as np
from bench.following_judge import rates, turns

from orientd.errors import PlanError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State

LIMITS = {
    "1/1/1": Limits(1.0, 1.0, 1.0, 1.0, 10.0),
    "3/30/30": Limits(3.0, 30.0, 30.0, 1.0, 10.0),
    "10/0.5/5": Limits(10.0, 0.5, 5.0, 1.0, 10.0),
    "2.5/17/8500": Limits(2.5, 17.0, 8500.0, 1.0, 10.0),
    "1.5/8/400": Limits(1.5, 8.0, 400.0, 1.0, 10.0),
}
KINDS = ("rest", "one end", "both ends", "times", "positions", "near duplicates", "duration")
PERIOD = 0.002
ROUNDING = 1.0 + 1e-5
NAMES = ("velocity", "acceleration", "jerk", "linear_velocity", "linear_acceleration")
HALF_TURN = np.pi
LARGER = (1.3, 2.0, 5.0, 20.0)
"""Factors of a duration that is tried after a refusal."""


@dataclass(frozen=True)
class Case:
    """A request with everything that its plan depends on.

    Attributes:
        factor: of the shortest duration, which becomes the requested one; ``None`` for none.
    """

    kind: str
    seed: int
    name: str
    request: MotionRequest
    start: State
    limits: Limits
    factor: float | None = None


def plans(seed, kind):
    """Return the random case *seed* of a kind; the limits follow from the seed."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    name = list(LIMITS)[seed % len(LIMITS)]
    limits = LIMITS[name]
    keys = _keys(rng, has_duplicates=kind == "near duplicates")
    moves = {
        "rest": (False, False),
        "one end": [(True, False), (False, True)][int(rng.integers(2))],
        "both ends": (True, True),
    }.get(kind, [(False, False), (True, False), (False, True), (True, True)][int(rng.integers(4))])
    if kind == "duration" and not any(moves):
        moves = (True, True)
    ends = [_velocity(rng, limits) if one else None for one in moves]
    positions = [None] * len(keys)
    if kind == "positions" or (kind == "times" and rng.random() < 0.3):
        positions = np.cumsum(rng.normal(size=(len(keys), 3)) * 0.06, axis=0).tolist()
    times = _times(rng, keys, limits) if kind == "times" else [None] * len(keys)
    keyframes = [
        Keyframe(tuple(q), t, None if p is None else tuple(p))
        for q, t, p in zip(keys.tolist(), times, positions, strict=True)
    ]
    request = MotionRequest(
        keyframes, start_velocity=ends[0], end_velocity=ends[1], approach=ends[0] is not None
    )
    start = State.at_rest(keys[0], keyframes[0].position or (0.0, 0.0, 0.0))
    factor = None
    if kind == "duration":
        factor = float(rng.choice([1.0, 1.02, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0]))
    return Case(kind, seed, name, request, start, limits, factor)


def _keys(rng, *, has_duplicates):
    count = int(rng.integers(2, 8))
    largest, keys = 10.0 ** rng.uniform(-2.0, 0.48), [_unit(rng, 4)]
    for _ in range(count - 1):
        is_like = rng.random() < 0.5
        turn = largest * rng.uniform(0.3, 1.0) if is_like else 10.0 ** rng.uniform(-2.5, 0.49)
        keys.append(_turned(rng, keys[-1], turn))
        if has_duplicates and rng.random() < 0.6:
            keys.append(_turned(rng, keys[-1], 10.0 ** rng.uniform(-4.0, -2.0)))
    if has_duplicates and len(keys) == count:
        keys.insert(1, _turned(rng, keys[0], 10.0 ** rng.uniform(-4.0, -2.0)))
    return np.array(keys)


def _times(rng, keys, limits):
    """Return times that leave each interval between 1.1 and 20 times its quickest turn."""
    quickest = quickest_turns(keys, limits)
    factor = 10.0 ** rng.uniform(0.15, 1.3)
    spread = rng.uniform(0.8, 1.25, len(quickest))
    steps = quickest * np.maximum(factor * spread, 1.1)
    return np.concatenate([[0.0], np.cumsum(steps)]).tolist()


def quickest_turns(keys, limits):
    """Return an upper bound of the time of each turn from rest to rest, s, shape ``(n - 1,)``."""
    return np.array([_turn_time(turn, limits) for turn in _angles(keys[:-1], keys[1:])])


def _velocity(rng, limits):
    return tuple((_unit(rng, 3) * limits.velocity * rng.uniform(0.1, 0.95)).tolist())


def _unit(rng, size):
    vector = rng.normal(size=size)
    return vector / np.linalg.norm(vector)


def _turned(rng, q, turn):
    axis = _unit(rng, 3)
    return _product(q, np.array([np.cos(turn / 2.0), *(np.sin(turn / 2.0) * axis)]))


def _turn_time(turn, limits):
    """Return an upper bound of the time of one turn from rest to rest, s."""
    speed, most, jerk = limits.velocity, limits.acceleration, limits.jerk
    return turn / speed + 2.0 * np.sqrt(turn / most) + 4.0 * np.cbrt(turn / jerk)


# The judge: from here on only setpoints count.


def _product(a, b):
    """Return the Hamilton product of quaternions ``(w, x, y, z)``."""
    w, x, y, z = np.moveaxis(np.asarray(a), -1, 0)
    e, f, g, h = np.moveaxis(np.asarray(b), -1, 0)
    return np.stack(
        [
            w * e - x * f - y * g - z * h,
            w * f + x * e + y * h - z * g,
            w * g - x * h + y * e + z * f,
            w * h + x * g - y * f + z * e,
        ],
        axis=-1,
    )


def _angles(before, after):
    return np.linalg.norm(turns(np.asarray(before), np.asarray(after)), axis=-1)


def ratios(q, position, limits, period):
    """Return the largest share of each limit that setpoints use, between holds before and after."""
    held, place = (np.concatenate([[rows[0]] * 3, rows, [rows[-1]] * 3]) for rows in (q, position))
    largest = rates(held, place, period).max(axis=0).tolist()
    return {name: value / getattr(limits, name) for name, value in zip(NAMES, largest, strict=True)}


def stopping_way(speed, limits):
    """Return how far a device turns until it rests, from a constant velocity, rad."""
    most, jerk = limits.acceleration, limits.jerk
    if speed * jerk > most**2:
        return 0.5 * speed * (speed / most + most / jerk)
    return speed * np.sqrt(speed / jerk)


def further(q, keys, begin, end, ends, limits, period):
    """Return how much further a path turns than the short ways between its keyframes, rad.

    Braking at a moving end and turning back from there is not counted.

    Args:
        q: setpoints.
        begin: time of the first keyframe, s; *end* is that of the last.
        ends: angular velocities at both, or ``None``.
    """
    first, last = int(np.floor(begin / period)), min(int(np.ceil(end / period)), len(q) - 1)
    path = float(_angles(q[first:last], q[first + 1 : last + 1]).sum())
    speeds = [0.0 if omega is None else float(np.linalg.norm(omega)) for omega in ends]
    braking = sum(2.0 * stopping_way(speed, limits) for speed in speeds)
    return path - float(_angles(keys[:-1], keys[1:]).sum()) - braking


def faults(motion, case):
    """Return what is wrong with a motion: limits, keyframes, turns that nobody asked for."""
    request, limits, period = motion.request, case.limits, motion.period
    rows = motion.rows(0, motion.record_count)
    found = []
    for name, ratio in ratios(rows[:, :4], rows[:, 10:13], limits, period).items():
        if not ratio <= ROUNDING:
            found.append(f"limit: {name} at {ratio:.5f} of its limit")
    keys = np.array([keyframe.q for keyframe in case.request.keyframes])
    there = motion.sample(motion.keyframe_times)
    missed = float(_angles(there.q, keys).max())
    # Keyframes closer than this may count as one, with a note.
    if missed > (2e-4 if any("passed as one" in one for one in _notes(motion)) else 1e-9):
        found.append(f"keyframe missed by {missed:.3g} rad")
    for name, omega, place in (
        ("start", request.start_velocity, 0),
        ("end", request.end_velocity, -1),
    ):
        if omega is not None and np.linalg.norm(there.omega_body[place] - omega) > 1e-6:
            found.append(f"{name} velocity missed")
    if case.request.has_times:
        late = motion.keyframe_times - motion.start_time - case.request.times
        if np.abs(late).max() > 1e-9:
            found.append("a time is missed")
    ends = request.start_velocity, request.end_velocity
    far = further(
        rows[:, :4], keys, motion.start_time, motion.end_time, ends, limits, motion.period
    )
    if far > HALF_TURN:
        found.append(f"turns: {far:.3g} rad further than the short ways and braking")
    return found


def _notes(motion):
    return motion.certificate.notes


def planned(case, request=None):
    return plan(
        case.request if request is None else request,
        start=case.start,
        limits=case.limits,
        period=PERIOD,
    )


def chain(case):
    """Return what single moves with a rest at each keyframe take, s, one for each interval.

    Each is a motion of the planner's own, so they are a motion that keeps the limits.
    """
    keyframes, request = case.request.keyframes, case.request
    state, steps = case.start, []
    for index, one in enumerate(keyframes):
        is_last = index == len(keyframes) - 1
        omega = request.end_velocity if is_last else None
        if index == 0:
            if request.start_velocity is None:
                continue
            omega = request.start_velocity
        goal = MotionRequest([Keyframe(one.q, None, one.position)], end_velocity=omega)
        motion = plan(goal, start=state, limits=case.limits, period=PERIOD)
        steps.append(motion.end_time if omega is not None else motion.duration)
        zero, place = np.zeros(3), np.array(one.position or case.start.position)
        moving = zero if omega is None else np.array(omega)
        state = State(np.array(one.q), moving, zero, place)
    return np.array(steps[1:] if request.start_velocity is not None else steps)


def is_possible(case, request):
    """Return why a refusal is false, or an empty text if that is not known."""
    total = request.total
    with_times = request.has_times
    try:
        steps = chain(case)
    except PlanError:
        steps = None
    if steps is not None:
        if with_times and np.all(steps <= np.diff(request.times) * (1.0 + 1e-9)):
            return "single moves take no longer"
        if not with_times and (total is None or steps.sum() <= total * (1.0 + 1e-9)):
            return f"single moves take {steps.sum():.4g} s"
    if with_times:
        return ""
    least = total or (10.0 if steps is None else float(steps.sum()))
    for factor in LARGER:
        try:
            planned(case, replace(request, duration=factor * least))
        except PlanError:
            continue
        return f"{factor:g} times as long is planned"
    return ""


@dataclass(frozen=True)
class Verdict:
    """The outcome of one case.

    Attributes:
        refused: the refusal; empty if a motion was planned.
        why: for a refusal, why it is false; empty if that is not known.
        faults: of the motion.
    """

    case: Case
    refused: str = ""
    why: str = ""
    faults: tuple[str, ...] = ()


def judged_plan(case):
    """Plan a case and return the verdict."""
    request = case.request
    if case.factor is not None:
        try:
            quickest = planned(case)
        except PlanError as error:
            return Verdict(case, str(error), is_possible(case, request))
        duration = case.factor * (quickest.end_time - quickest.start_time)
        request = replace(request, duration=duration)
    try:
        motion = planned(case, request)
    except PlanError as error:
        why = is_possible(case, request)
        if case.factor is not None and not why:
            why = "the quickest is shorter"
        return Verdict(case, str(error), why)
    return Verdict(case, faults=tuple(faults(motion, case)))
