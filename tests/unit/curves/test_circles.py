"""The families made of circles: circular blending and Nielson and Shieh's arcs."""

import numpy as np
import pytest

from orientd.curves import METHODS
from orientd.curves.inner_points import _inside_cone
from orientd.errors import PlanError
from orientd.rotation import angle, exp, multiply, slerp

BLENDING, ARCS = METHODS["circular_blending"], METHODS["nielson_shieh"]


def speed_jump(curve):
    knots = curve.knots[1:-1]
    left, right = curve.evaluate(np.nextafter(knots, -np.inf)), curve.evaluate(knots)
    return np.abs(left[1] - right[1]).max() / np.abs(right[1]).max()


def test_the_angle_of_the_notes_leaves_speed_jumps_of_half_the_speed():
    rng = np.random.default_rng(3)
    keys = exp(np.cumsum(rng.normal(scale=0.6, size=(8, 3)), axis=0))
    assert speed_jump(BLENDING(keys=keys, times="uniform")) > 0.2
    assert speed_jump(BLENDING(keys=keys, times="uniform", param="quadratic")) < 1e-11


def test_keyframes_that_leave_no_first_tangent_are_said_to(random_keys):
    with pytest.raises(PlanError, match=r"weight .* negative"):
        ARCS(keys=random_keys(20), times="uniform")
    assert ARCS(keys=random_keys(20), times="uniform", require_positive=False).weights.min() < 0.0


@pytest.mark.parametrize("criterion", [13, 14])
def test_no_random_first_inner_point_is_better_than_the_one_found(random_keys, criterion):
    keys = random_keys(5, 0.8, seed=4)

    def cost(m):
        if criterion == 13:
            sides = np.diff(np.concatenate([keys[:1], m, keys[-1:]]), axis=0)
            return np.linalg.norm(sides, axis=1).sum()
        w = np.sqrt((1 - np.sum(keys[1:] * keys[:-1], axis=1)) / (2 * (np.sum(m * m, axis=1) - 1)))
        middles = (keys[:-1] + keys[1:] + 2 * w[:, None] * m) / (2 + 2 * w[:, None])
        return np.sum((middles - m) ** 2)

    best = ARCS(keys=keys, times="uniform", criterion=criterion)
    assert best.weights.min() > 0.0
    rng = np.random.default_rng(1)
    others = [
        ARCS(keys=keys, times="uniform", M1=best.shoulders[0] + rng.normal(scale=0.3, size=4))
        for _ in range(200)
    ]
    possible = [other for other in others if other.weights.min() > 0.0]
    assert len(possible) > 20
    for other in possible:
        assert cost(other.shoulders) >= cost(best.shoulders) - 1e-12


def test_the_reparametrisation_makes_the_speed_continuous(random_keys):
    keys, times = random_keys(6), [0.0, 1.0, 1.4, 2.4, 3.4, 3.9]
    given = {"keys": keys, "times": times, "require_positive": False}
    assert speed_jump(ARCS(**given)) < 1e-12
    assert speed_jump(ARCS(**given, reparam=False)) > 1e-2
    one, other = ARCS(**given, a1=1.0), ARCS(**given, a1=2.0)
    assert speed_jump(other) < 1e-11
    assert angle(one.evaluate([0.5])[0], other.evaluate([0.5])[0])[0] > 1e-2


def test_an_inner_point_given_for_the_other_signs_is_the_same_point(random_keys):
    keys = random_keys(4)
    m = 1.3 * slerp(keys[0], keys[1], 0.4) + 0.1
    one, other = ARCS(keys=keys, times="uniform", M1=m), ARCS(keys=-keys, times="uniform", M1=m)
    assert angle(one.evaluate([1.7])[0], other.evaluate([1.7])[0])[0] < 1e-13


@pytest.mark.parametrize("step", [1e-2, 1e-4, 1e-6])
def test_arcs_through_keyframes_close_to_one_another_join_as_smoothly_as_their_digits_allow(step):
    rng = np.random.default_rng(1)
    keys = exp([0.3, -0.8, 0.5])[None]
    for turn in rng.normal(size=(4, 3)):
        keys = np.vstack([keys, multiply(keys[-1], exp(step * turn))])
    assert speed_jump(ARCS(keys=keys, times="uniform", require_positive=False)) < 1e-12 / step


@pytest.mark.parametrize("width", [1e-7, 1e-4, 1e-1, 10.0])
@pytest.mark.parametrize("count", [1, 3, 40])
def test_a_direction_with_positive_weights_is_found_however_few_there_are(width, count):
    rng = np.random.default_rng(count)
    sides = rng.normal(size=(count, 3)) * [1.0, 1.0, 0.0]
    sides /= np.linalg.norm(sides, axis=1)[:, None]
    pulls = (sides + np.array([0.0, 0.0, width])) * rng.uniform(0.1, 10.0, (count, 1))
    assert (pulls @ _inside_cone(pulls)).min() > 0.0
    assert _inside_cone(np.concatenate([pulls, -pulls])) is None
