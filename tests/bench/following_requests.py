"""Seeded requests of motions that follow one another: blends and chains.

Each generator yields cases without end.  The same seed yields the same cases, so a bench may take
hundreds of those of which a test takes ten.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.state import State
from orientd.rotation import Floats, exp, multiply

DEVICE = Limits(2.5, 17.0, 8500.0, 1.0, 10.0)
PERIOD = 0.002


@dataclass(frozen=True, eq=False)
class Case:
    """Motions that follow one another on one device.

    Attributes:
        requests: one motion each.
        start: of the device.
        limits: of the device.
        period: of its cycle, s.
        tolerances: of the corner before each motion but the first, rad; 0 for no blend.
        passed: share of each motion but the last that has passed when the next one is planned.
    """

    requests: tuple[MotionRequest, ...]
    start: State
    limits: Limits = DEVICE
    period: float = PERIOD
    tolerances: tuple[float, ...] = ()
    passed: tuple[float, ...] = ()


def blends(seed: int) -> Iterator[Case]:
    """Yield pairs and chains of motions to be blended, of different limits and paces."""
    random = np.random.default_rng(seed)
    while True:
        count = int(random.integers(2, 6)) if random.random() < 0.4 else 2
        legs = _legs(random, count, most=3 if random.random() < 0.3 else 2)
        requests = [
            MotionRequest(leg, approach=place > 0, **_pace(random, leg))
            for place, leg in enumerate(legs)
        ]
        tolerances = np.exp(random.uniform(np.log(0.005), np.log(0.3), count - 1))
        yield _case(random, requests, tolerances)


def chains(seed: int) -> Iterator[Case]:
    """Yield chains without blends: half of them meet at end velocities, the others at rest."""
    random = np.random.default_rng(seed)
    while True:
        count = int(random.integers(2, 6))
        legs = _legs(random, count, most=2)
        requests = []
        if random.random() < 0.5:
            for place, leg in enumerate(legs):
                requests.append(MotionRequest(leg, approach=place > 0, **_pace(random, leg)))
            yield _case(random, requests, np.zeros(count - 1))
            continue
        # One after the other about axes that differ little, at velocities along them.
        within = _limits(random, 0.2) if random.random() < 0.3 else None
        has_times = random.random() < 0.5
        speed = (DEVICE if within is None else DEVICE.narrowed(within)).velocity
        speeds = [0.0, *(speed * random.uniform(0.05, 0.6, count - 1)), 0.0]
        axis, tilt = _direction(random), random.choice([0.0, 0.1])
        keys = [exp(random.normal(size=3))]
        sizes = random.uniform(0.3, 1.2, count)
        for size in sizes:
            keys.append(multiply(keys[-1], exp(size * (axis + tilt * _direction(random)))))
        positions = [leg[0].position for leg in legs] + [legs[-1][-1].position]
        for place in range(count):
            here, there = (_keyframe(keys[k], positions[k]) for k in (place, place + 1))
            fields = {}
            if has_times:
                usual = 0.5 * (speeds[place] + speeds[place + 1])
                took = sizes[place] / max(usual, 0.3 * speed) * random.uniform(0.9, 1.3) + 0.1
                # Every other end falls between two cycles.
                took = round(took, 2) if random.random() < 0.5 else took
                here, there = (
                    Keyframe(one.q, position=one.position, time=time)
                    for one, time in ((here, 0.0), (there, took))
                )
            if place:
                fields["start_velocity"] = tuple((speeds[place] * axis).tolist())
            if place < count - 1:
                fields["end_velocity"] = tuple((speeds[place + 1] * axis).tolist())
            requests.append(MotionRequest([here, there], limits=within, **fields))
        yield _case(random, requests, np.zeros(count - 1), latest=0.4)


def _case(
    random: np.random.Generator,
    requests: list[MotionRequest],
    tolerances: Floats,
    latest: float = 0.95,
) -> Case:
    first = requests[0].keyframes[0]
    passed = random.uniform(0.0, latest, len(tolerances))
    passed[random.random(len(passed)) < 0.5] = 0.0
    return Case(
        tuple(requests),
        State.at_rest(first.q, first.position or (0.0, 0.0, 0.0)),
        tolerances=tuple(tolerances.tolist()),
        passed=tuple(passed.tolist()),
    )


def _legs(random: np.random.Generator, count: int, most: int) -> list[list[Keyframe]]:
    """Return the keyframes of some motions; each begins where the one before ends."""
    has_positions = random.random() < 0.5
    size = np.exp(random.uniform(np.log(0.05), np.log(1.5)))
    q, p = exp(random.normal(size=3)), random.uniform(-0.3, 0.3, 3)
    last = _keyframe(q, p if has_positions else None)
    legs = []
    for _ in range(count):
        leg = [last]
        for _ in range(int(random.integers(1, most))):
            turn = size * random.uniform(0.5, 1.5)
            q = multiply(q, exp(turn * _direction(random)))
            if random.random() < 0.9:
                p = p + 0.15 * random.uniform(0.0, 1.0) * _direction(random)
            last = _keyframe(q, p if has_positions else None)
            leg.append(last)
        legs.append(leg)
    return legs


def _pace(random: np.random.Generator, leg: list[Keyframe]) -> dict[str, object]:
    """Return how fast a motion is to run: its limits, its pace, its duration or its times."""
    turn = sum(2.0 * np.arccos(min(1.0, abs(float(np.dot(a.q, b.q))))) for a, b in pairwise(leg))
    kind = random.choice(
        ["quickest", "limits", "pace", "duration", "even"], p=[0.3, 0.3, 0.2, 0.15, 0.05]
    )
    if kind == "limits":
        return {"limits": _limits(random, 0.03)}
    if kind == "pace":
        return {"pace": float(np.exp(random.uniform(np.log(0.1), 0.0)))}
    if kind == "duration":
        return {"duration": float((0.4 + turn) * random.uniform(1.0, 5.0))}
    return {"pace": "even"} if kind == "even" else {}


def _limits(random: np.random.Generator, least: float) -> Limits:
    """Return limits of which some are lower than the device's, each by a factor of its own."""
    names = ("velocity", "acceleration", "jerk", "linear_velocity", "linear_acceleration")
    lower = {
        name: getattr(DEVICE, name) * float(np.exp(random.uniform(np.log(least), 0.0)))
        for name in names
        if random.random() < 0.5
    }
    return Limits.partial(**lower)


def _direction(random: np.random.Generator) -> Floats:
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def _keyframe(q: Floats, position: Floats | tuple[float, ...] | None) -> Keyframe:
    w, x, y, z = np.asarray(q, dtype=np.float64).tolist()
    if position is None:
        return Keyframe((w, x, y, z))
    return Keyframe((w, x, y, z), position=tuple(float(part) for part in position))
