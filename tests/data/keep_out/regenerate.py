"""Durations of turns around keep-out cones, by a fine search over where they pass.

    python tests/data/keep_out/regenerate.py

Twenty turns from rest to rest cross one to four cones.  A (1+1) evolution strategy moves one to
three keyframes between the ends, in all three degrees of freedom, from ten random beginnings.  The
duration of a try is that of orientd's quickest motion through its
keyframes.  Clearances are computed here, between the records too.  None of orientd's code for
keep-out cones is used.
"""

import json
import math
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from orientd.errors import PlanError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State

CASES, SEEDS, TRIES = 20, 10, 140
PERIOD = 0.002
X = np.array([1.0, 0.0, 0.0])


def unit(vector):
    return vector / np.linalg.norm(vector)


def quaternion(rotation):
    x, y, z, w = rotation.as_quat()
    return (float(w), float(x), float(y), float(z))


def clearance(rotations, cones):
    """Return the least angle to the edge of any cone, rad."""
    points = np.atleast_2d(rotations.apply(X))
    return min(
        float(np.min(np.arccos(np.clip(points @ direction, -1.0, 1.0)))) - half
        for direction, half in cones
    )


def planned(keys):
    request = MotionRequest([Keyframe(quaternion(one)) for one in keys])
    start = State.at_rest(quaternion(keys[0]))
    return plan(request, start=start, limits=DEFAULT_LIMITS, period=PERIOD)


def along(motion):
    q = motion.sample(np.arange(0.0, motion.duration, 0.4 * PERIOD)).q
    return Rotation.from_quat(q[:, [1, 2, 3, 0]])


def cost(keys, cones):
    """Return the duration, longer for what is inside, and whether all is outside."""
    try:
        motion = planned(keys)
    except PlanError:
        return math.inf, False
    depth = -math.degrees(clearance(along(motion), cones))
    if depth <= 0.0:
        return motion.duration, True
    return motion.duration * (1.0 + 0.05 * depth) + 0.3, False


def case(random):
    """Return both ends and the cones of a turn that crosses the first cone."""
    while True:
        ends = [Rotation.random(random_state=random) for _ in range(2)]
        turn = (ends[0].inv() * ends[1]).as_rotvec()
        cones = []
        for number in range(random.integers(1, 5)):
            point = (ends[0] * Rotation.from_rotvec(random.uniform(0.2, 0.8) * turn)).apply(X)
            spread = 0.35 if number else 0.1
            half = math.radians(random.uniform(6.0, 30.0))
            cones.append((unit(point + spread * random.normal(size=3)), half))
        both = Rotation.concatenate(ends)
        if np.linalg.norm(turn) < 0.6 or clearance(both, cones) < 0.02:
            continue
        if clearance(along(planned(ends)), cones) < 0.0:
            return ends, cones


def search(ends, cones, random):
    """Return the least duration found."""
    turn, best = (ends[0].inv() * ends[1]).as_rotvec(), math.inf
    for seed in range(SEEDS):
        count = 1 + seed % 3
        inner = []
        for k in range(count):
            here = ends[0] * Rotation.from_rotvec((k + 1) / (count + 1) * turn)
            inner.append(Rotation.from_rotvec(0.5 * random.normal(size=3)) * here)
        now, _ = cost([ends[0], *inner, ends[1]], cones)
        size = 0.3
        for _ in range(TRIES):
            other = [Rotation.from_rotvec(size * random.normal(size=3)) * one for one in inner]
            then, is_outside = cost([ends[0], *other, ends[1]], cones)
            if then < now:
                inner, now, size = other, then, 1.4 * size
                best = min(best, then) if is_outside else best
            else:
                size = max(0.94 * size, 0.004)
    return best


def main():
    rows = []
    for number in range(CASES):
        random = np.random.default_rng(number)
        ends, cones = case(random)
        rows.append(
            {
                "ends": [quaternion(one) for one in ends],
                "cones": [[*direction.tolist(), half] for direction, half in cones],
                "duration": round(search(ends, cones, random), 4),
            }
        )
        print(rows[-1]["duration"], flush=True)
    text = json.dumps({"cases": rows}).replace('{"ends"', '\n{"ends"')
    (Path(__file__).parent / "durations.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
