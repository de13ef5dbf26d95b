"""Every published arm, against the product of its transforms in mpmath."""

import json
import math
import random
from functools import reduce
from pathlib import Path

import mpmath
import pytest

from orientd.floats import difference, norm
from orientd.rotation import convert
from orientd_ur.arm import MODELS
from orientd_ur.kinematics import Kinematics, Table

PUBLISHED = json.loads((Path(__file__).parents[2] / "data/ur/models.json").read_text())
NAMES = sorted(PUBLISHED.keys() - {"source", "columns"})
TWISTS = (0.5, 0, 0, 0.5, -0.5, 0)  # of pi


def table(name):
    d1, a2, a3, d4, d5, d6, _ = PUBLISHED[name]
    return [0, a2, a3, 0, 0, 0], [d1, 0, 0, d4, d5, d6]


def product_of_transforms(a, d, alpha, theta):
    """The flange with 30 digits, from the definition of Denavit and Hartenberg."""

    def link(a, d, alpha, theta):
        c, s, ca, sa = mpmath.cos(theta), mpmath.sin(theta), mpmath.cos(alpha), mpmath.sin(alpha)
        return mpmath.matrix(
            [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        )

    return reduce(lambda m, n: m * n, (link(*row) for row in zip(a, d, alpha, theta, strict=True)))


def off(pose, expected):
    q, position = pose
    rows = [[*row, p] for row, p in zip(convert.to_matrix(q).tolist(), position, strict=True)]
    return max(abs(rows[i][j] - expected[i, j]) for i in range(3) for j in range(4))


def shoulder_reserve(name, joints):
    return next(one.value for one in MODELS[name].arm().reserve(joints) if one.name == "shoulder")


def postures(count, seed, *, away=0.1):
    generator = random.Random(seed)
    found = []
    while len(found) < count:
        q = [generator.uniform(-math.pi, math.pi) for _ in range(6)]
        if min(abs(math.sin(q[2])), abs(math.sin(q[4]))) > away:
            found.append(q)
    return found


def test_every_published_arm_is_known_with_its_speeds():
    assert sorted(MODELS) == NAMES
    for name in NAMES:
        degrees = PUBLISHED[name][6]
        assert MODELS[name].speeds == pytest.approx([math.radians(v) for v in degrees])


@pytest.mark.parametrize("name", NAMES)
def test_forward_and_inverse_are_those_of_the_published_table(name):
    kinematics = MODELS[name].arm().kinematics
    a, d = table(name)
    with mpmath.workdps(30):
        for q in postures(25, seed=name):
            expected = product_of_transforms(a, d, [t * mpmath.pi for t in TWISTS], q)
            pose = kinematics.forward(q)
            assert off(pose, expected) < 1e-12
            if shoulder_reserve(name, q) < 0.02:
                continue
            found = kinematics.inverse(pose, [angle + 0.01 for angle in q])
            assert max(abs(x - y) for x, y in zip(found, q, strict=True)) < 1e-12
            assert off(kinematics.forward(found), expected) < 1e-12


def test_calibrated_arm_is_solved_as_exactly():
    a, d = table("ur10e")
    generator = random.Random(5)
    # Nearly parallel axes are a long way apart along themselves, as controllers tell them.
    own = Table(
        theta=tuple(generator.uniform(-2e-3, 2e-3) for _ in range(6)),
        a=tuple(x + generator.uniform(-5e-4, 5e-4) for x in a),
        d=(d[0], 12.5, -12.5 + 3e-4, *d[3:]),
        alpha=tuple(t * math.pi + generator.uniform(-2e-5, 2e-5) for t in TWISTS),
    )
    kinematics = Kinematics(MODELS["ur10e"].links, own)
    with mpmath.workdps(30):
        for q in postures(25, seed=1, away=0.3):
            theta = [x + y for x, y in zip(own.theta, q, strict=True)]
            expected = product_of_transforms(own.a, own.d, own.alpha, theta)
            assert off(kinematics.forward(q), expected) < 1e-12
            if shoulder_reserve("ur10e", q) < 0.2:
                continue
            for near in (q, [angle + 0.02 for angle in q]):
                found = kinematics.inverse(kinematics.forward(q), near)
                assert off(kinematics.forward(found), expected) < 1e-12
            every = kinematics.solutions(kinematics.forward(q))
            assert all(off(kinematics.forward(one), expected) < 1e-11 for one in every)
            assert len(every) >= 2


def test_joints_that_do_not_reach_the_pose_are_no_solution():
    a, d = table("ur10e")
    generator = random.Random(7)
    reached = 0
    for size in (1e-3, 3e-2, 0.1, 0.3):
        own = Table(
            theta=tuple(generator.uniform(-size, size) for _ in range(6)),
            a=tuple(x + generator.uniform(-size, size) for x in a),
            d=tuple(x + generator.uniform(-size, size) for x in d),
            alpha=tuple(t * math.pi + generator.uniform(-size, size) for t in TWISTS),
        )
        kinematics = Kinematics(MODELS["ur10e"].links, own)
        for q in postures(25, seed=2):
            pose = kinematics.forward(q)
            for joints in kinematics.solutions(pose):
                reached += 1
                assert apart(kinematics.forward(joints), pose) < 2e-9
            joints = kinematics.inverse(pose, q)
            if joints is not None:
                assert apart(kinematics.forward(joints), pose) < 2e-9
    assert reached > 200


def apart(pose, other):
    """Return how far two poses are apart, the larger one of rad and m."""
    (q, position), (q1, position1) = pose, other
    return max(norm(difference(q, q1)), math.dist(position, position1))
