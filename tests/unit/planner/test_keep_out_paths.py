"""Random paths among keep-out cones: never inside, refused only where a grid has no way either."""

import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from orientd.errors import PlanError
from orientd.keep_out import KeepOut
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import rotate

PERIOD = 0.002
X = np.array([1.0, 0.0, 0.0])
DEEPEST = math.radians(0.01)
SEARCHED = json.loads(
    (Path(__file__).parents[2] / "data" / "keep_out" / "durations.json").read_text()
)["cases"]


def unit(vector):
    return vector / np.linalg.norm(vector)


def clearance(points, cones):
    return np.min(
        [np.arccos(np.clip(points @ one.direction, -1.0, 1.0)) - one.half_angle for one in cones],
        axis=0,
    )


def random_path(random):
    """Return keyframes outside of one to four cones, some with times, and the cones."""
    cones = [
        KeepOut(f"c{k}", tuple(unit(random.normal(size=3)).tolist()), random.uniform(0.09, 0.6))
        for k in range(random.integers(1, 5))
    ]
    keys = []
    wanted = int(random.integers(2, 6))
    while len(keys) < wanted:
        q = unit(random.normal(size=4))
        if clearance(rotate(q, X)[None], cones)[0] > 0.01:
            keys.append(q)
    times = [None] * wanted
    if random.random() < 0.25:
        times = (3.0 * np.arange(wanted)).tolist()
    return [Keyframe(tuple(q.tolist()), t) for q, t in zip(keys, times, strict=True)], cones


def dense(motion):
    """Return where the axis points at five phases of every cycle."""
    times = np.arange(0.0, motion.duration, motion.period / 5.0)
    return rotate(motion.sample(times).q, X)


def is_connected(a, b, cones, count=6000):
    """Return whether neighbours on a grid of the sphere lead from one direction to another."""
    k = np.arange(count) + 0.5
    height, turn = 1.0 - 2.0 * k / count, math.pi * (1.0 + math.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - height**2)
    grid = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    grid = np.concatenate([grid[clearance(grid, cones) > 0.0], [a, b]])
    reached = np.zeros(len(grid), dtype=bool)
    edge = [len(grid) - 2]
    reached[edge] = True
    while len(edge):
        is_near = (grid @ grid[edge].T).max(axis=1) > math.cos(2.2 / math.sqrt(count) * 2.0)
        edge = np.flatnonzero(is_near & ~reached)
        reached[edge] = True
    return bool(reached[-1])


@pytest.mark.parametrize(
    "numbers",
    [
        pytest.param(range(12), id="few"),
        pytest.param(range(300), id="many", marks=[pytest.mark.slow, pytest.mark.timeout(3000)]),
    ],
)
def test_random_paths_are_never_inside_and_refused_only_without_a_way(numbers):
    worst, refused, led = math.inf, [], 0
    for number in numbers:
        keyframes, cones = random_path(np.random.default_rng(number))
        request = MotionRequest(keyframes, keep_out=cones)
        start = State.at_rest(keyframes[0].q)
        try:
            motion = plan(request, start=start, limits=DEFAULT_LIMITS, period=PERIOD)
        except PlanError as error:
            points = [rotate(np.array(one.q), X) for one in keyframes]
            if all(is_connected(a, b, cones) for a, b in pairwise(points)):
                refused.append(f"{number}: {error}")
            continue
        led += any("led around" in one for one in motion.certificate.notes)
        worst = min(worst, float(clearance(dense(motion), cones).min()))
    print(f"{led} of {len(numbers)} led around, least clearance {math.degrees(worst):.4f} deg")
    assert not refused
    assert worst >= -DEEPEST
    assert led >= len(numbers) // 5


@pytest.mark.parametrize(
    "cases", [SEARCHED[:4], pytest.param(SEARCHED, marks=[pytest.mark.slow])], ids=["few", "all"]
)
def test_a_turn_around_takes_at_most_a_twentieth_longer_than_a_fine_search(cases):
    ratios = []
    for case in cases:
        first, last = map(tuple, case["ends"])
        cones = [
            KeepOut(f"c{k}", (x, y, z), half) for k, (x, y, z, half) in enumerate(case["cones"])
        ]
        request = MotionRequest([Keyframe(last)], keep_out=cones)
        start = State.at_rest(first)
        motion = plan(request, start=start, limits=DEFAULT_LIMITS, period=PERIOD)
        ratios.append(motion.duration / case["duration"])
    print("duration by that of the search:", np.round(ratios, 4).tolist())
    assert max(ratios) <= 1.05
