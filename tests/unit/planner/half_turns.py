"""Plan random half turns and print which way each goes, as JSON: ``python half_turns.py COUNT``."""

import json
import math
import sys

import numpy as np

import orientd
from orientd.errors import OrientdError
from orientd.motion_file import parse
from orientd.rotation import exp, log, multiply, to_matrix

FORMS = ("quaternion", "rotation_vector", "matrix")


def form_of(q, form):
    """Return an orientation as a motion file gives it, quaternions with eight decimals."""
    if form == "quaternion":
        return {"quaternion": {name: round(float(c), 8) for name, c in zip("wxyz", q, strict=True)}}
    if form == "rotation_vector":
        return {"rotation_vector": log(q).tolist()}
    return {"matrix": to_matrix(q).tolist()}


def rate(keyframes, **fields):
    """Return the body angular velocity halfway between the last two keyframes but *after*."""
    after = fields.pop("after", 0)
    motion = orientd.plan(parse({"keyframes": keyframes, **fields}))
    times = motion.keyframe_times[len(keyframes) - 2 - after :][:2]
    return motion.sample(np.array([0.5 * times.sum()])).omega_body[0]


def way(keyframes, axis, **fields):
    return math.copysign(1.0, float(rate(keyframes, **fields) @ axis))


def random_half_turn(random):
    """Return an orientation, and one half a turn away, about an axis that may be a simple one."""
    axis = random.normal(size=3) if random.random() < 0.6 else random.integers(-1, 2, size=3)
    axis = axis / np.linalg.norm(axis) if np.any(axis) else np.array([0.0, 0.0, 1.0])
    first = random.normal(size=4)
    first /= np.linalg.norm(first)
    return first, multiply(first, exp(math.pi * axis)), axis


def ways(number):
    """Return which way one half turn goes in every form and sign, and as a middle interval."""
    random = np.random.default_rng(number)
    first, second, axis = random_half_turn(random)
    before, after = (multiply(q, exp(0.4 * random.normal(size=3))) for q in (first, second))
    found = []
    for form in FORMS:
        for sign in (1.0, -1.0) if form == "quaternion" else (1.0,):
            pair = [form_of(first, form), form_of(sign * second, form)]
            found.append(way(pair, axis))
            others = [form_of(before, form), *pair, form_of(after, form)]
            try:
                # Given times, such a curve is straight enough not to turn back in the middle.
                timed = [{**one, "time": t} for one, t in zip(others, (0, 3, 5, 8), strict=True)]
                found.append(way(timed, axis, after=1))
            except OrientdError as error:
                found.append(type(error).__name__)
    return found


if __name__ == "__main__":
    print(json.dumps([ways(number) for number in range(int(sys.argv[1]))]))
