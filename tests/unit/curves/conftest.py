"""Example parameters for every family in METHODS, so that each goes through the same suites.

A family that takes ``keys`` and ``times`` needs no line here.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from orientd import rotation
from orientd.curves import METHODS, Curve
from orientd.curves.keyframes import resolve_times
from orientd.curves.products import Product


def keyframed(keys, times):
    return {"keys": keys, "times": times}


def controlled(keys, times):
    return {"control": keys}


def slerped(keys, times):
    return {"q0": keys[0], "q1": keys[1], "t0": times[0], "t1": times[-1]}


def spun(keys, times):
    return {**slerped(keys, times), "path": "long", "spins": 2}


def hermite(keys, times):
    return {**slerped(keys, times), "omega0": [1.0, -2.0, 0.5], "omega1": [0.3, 1.5, 2.0]}


def hermite_world(keys, times):
    return {**hermite(keys, times), "frame": "world", "revolutions": 1}


def hermite_global(keys, times):
    return {**hermite(keys, times), "product": "global"}


def quintic(keys, times):
    return {**hermite(keys, times), "alpha0": [3.0, 0.0, -1.0], "alpha1": [0.0, -2.0, 4.0]}


def quintic_world(keys, times):
    return {**quintic(keys, times), "frame": "world", "revolutions": -1}


def ends_given(keys, times):
    return {**keyframed(keys, times), "omega_start": [1.0, 0.5, 0.0], "omega_end": [0.0, 0.0, -1.0]}


def clamped(keys, times):
    return {**ends_given(keys, times), "start": "clamped", "end": "clamped"}


def state(keys, times):
    accelerations = {"alpha_start": [4.0, 0.0, -3.0], "alpha_end": [1.0, 2.0, 2.0]}
    return {**ends_given(keys, times), **accelerations, "start": "state", "end": "state"}


def state_natural(keys, times):
    given = {"omega_start": [0.0, 1.0, 0.0], "alpha_start": [2.0, 2.0, 2.0]}
    return {**keyframed(keys, times), **given, "start": "state"}


def clamped_state(keys, times):
    given = {"omega_start": [0.0, 0.0, 1.0], "omega_end": [0.0, 1.0, 0.0], "alpha_end": [1, 2, 3]}
    return {**keyframed(keys, times), **given, "start": "clamped", "end": "state"}


def turned(keys, times):
    return {**keyframed(keys, times), "turns": [1, 0, -1] + [0] * (len(keys) - 4)}


def order_three(keys, times):
    return {"control": keys, "order": 3}


def clamped_knots(keys, times):
    inner = times[: len(keys) - 3]
    vector = np.concatenate([np.repeat(inner[0], 3), inner, np.repeat(inner[-1], 3)])
    return {"control": keys, "order": 4, "knots": np.insert(vector, 4, 0.5 * (inner[0] + inner[1]))}


def aligned_controls(keys, times):
    return {"control": keys, "align": True}


def order_five(keys, times):
    return {"control": keys, "order": 5}


def uniform(keys, times):
    return {"keys": keys, "times": "uniform"}


def by_mean(keys, times):
    return {**keyframed(keys, times), "rule": "mean"}


def by_chord(keys, times):
    return {**keyframed(keys, times), "rule": "chord"}


def as_printed(keys, times):
    return {**keyframed(keys, times), "s": 1.0}


def reversed_order(keys, times):
    return {**keyframed(keys, times), "order": "reversed"}


def quadratic_angle(keys, times):
    return {**keyframed(keys, times), "param": "quadratic"}


def smooth_circles(keys, times):
    return {**quadratic_angle(keys, times), "weight": "smooth"}


def any_arcs(keys, times):
    return {**keyframed(keys, times), "require_positive": False}


def any_arcs_14(keys, times):
    return {**any_arcs(keys, times), "criterion": 14, "a1": 1.5}


def unparametrised(keys, times):
    return {**any_arcs(keys, times), "reparam": False}


def positive_arcs(keys, times):
    return keyframed(keys[:3], times[:3])


def polygon(keys, times):
    return {**keyframed(keys, times), "criterion": 20}


def tense(keys, times):
    return {**keyframed(keys, times), "nu": 2.0}


def through_order_three(keys, times):
    return {**keyframed(keys, times), "order": 3}


def through_order_four(keys, times):
    return {**clamped(keys, times), "order": 4}


def through_order_five(keys, times):
    return {**keyframed(keys, times), "order": 5}


def through_order_six(keys, times):
    accelerations = {"alpha_start": [1.0, 2.0, 3.0], "alpha_end": [-4.0, 0.0, 1.0]}
    return {**clamped(keys, times), **accelerations, "order": 6}


def least_torque(keys, times):
    inertia = [[2.0, 0.3, 0.0], [0.3, 1.0, -0.1], [0.0, -0.1, 0.5]]
    return {**clamped(keys, times), "inertia": inertia, "spans": 3}


def least_torque_free(keys, times):
    return {**keyframed(keys, times), "inertia": [1.0, 2.0, 2.5]}


def quintic_effort(keys, times):
    return {**state_natural(keys, times), "order": 6, "smoothness": 2}


def smooth_effort(keys, times):
    return {**clamped_state(keys, times), "order": 5, "smoothness": 3}


EXAMPLES = {
    "slerp": (slerped, spun),
    "kks_bezier": (controlled,),
    "kks_hermite": (hermite, hermite_world, hermite_global),
    "kks_quintic_hermite": (quintic, quintic_world),
    "kks_hermite_spline": (keyframed, ends_given),
    "kks_bspline": (controlled, order_three, clamped_knots),
    "c2_cumulative": (keyframed, clamped, state, state_natural, clamped_state, turned),
    "kks_uniform": (controlled,),
    "kks_interpolating": (
        keyframed,
        through_order_three,
        through_order_four,
        through_order_five,
        through_order_six,
    ),
    "squad": (keyframed, uniform, by_mean, by_chord),
    "de_casteljau": (aligned_controls,),
    "shoemake_bezier": (keyframed, uniform, as_printed),
    "bezier_catmull_rom": (keyframed, uniform, reversed_order),
    "schlag_catmull_rom": (keyframed, uniform),
    "schlag_bspline": (controlled, order_three, order_five, clamped_knots),
    "circular_blending": (keyframed, quadratic_angle, smooth_circles),
    "nielson_shieh": (any_arcs, any_arcs_14, unparametrised, positive_arcs),
    "spherical_quadratic": (keyframed, uniform, polygon),
    "nielson_heiland": (keyframed, uniform),
    "nu_spline": (keyframed, tense),
    "rotation_vector_spline": (keyframed, clamped),
    "min_acceleration": (keyframed, clamped),
    "minimum_effort": (
        keyframed,
        clamped,
        state,
        least_torque,
        least_torque_free,
        quintic_effort,
        smooth_effort,
    ),
}
"""Family name -> tuple of makers of parameters from keyframes and their times."""


@dataclass(frozen=True)
class Example:
    name: str
    make: Callable

    @property
    def family(self):
        return METHODS[self.name]

    def params(self, count=6, *, seed=0, step=1.0):
        return self.make(*random_keyframes(count, seed=seed, step=step))

    @functools.cache  # noqa: B019 - a few curves, none of which can change
    def curve(self, **settings):
        return self.family(**self.params(**settings))


def random_keyframes(count, *, seed=0, step=1.0):
    """A walk of turns of about *step* rad about random axes, with random signs, and its times."""
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(count - 1, 3))
    turns *= (step * rng.uniform(0.7, 1.3, count - 1) / np.linalg.norm(turns, axis=1))[:, None]
    keys = [rotation.normalize(rng.normal(size=4))]
    for turn in rotation.exp(turns):
        keys.append(rotation.multiply(keys[-1], turn) * rng.choice([-1.0, 1.0]))
    times = 0.5 + np.concatenate([[0.0], np.cumsum(rng.uniform(0.6, 1.4, count - 1))])
    return np.array(keys), times


def met_keyframes(params):
    """The orientations a parameter set asks for, and when."""
    if "keys" in params:
        keys = rotation.align(params["keys"])
        return keys, resolve_times(params.get("times", "uniform"), keys)
    return np.array([params["q0"], params["q1"]]), np.array([params["t0"], params["t1"]])


def pytest_generate_tests(metafunc):
    for fixture, kind in (("example", Curve), ("product_example", Product)):
        if fixture not in metafunc.fixturenames:
            continue
        examples = [
            pytest.param(Example(name, make), id=f"{name}-{make.__name__}")
            for name, family in METHODS.items()
            if issubclass(family, kind)
            for make in EXAMPLES.get(name, (keyframed,))
        ]
        metafunc.parametrize(fixture, examples)


@pytest.fixture
def keyframes_of():
    return met_keyframes


@pytest.fixture
def random_keys():
    """Makes a walk of turns of a given size, rad, about random axes, signs aligned."""

    def make(count, step=1.0, seed=0):
        rng = np.random.default_rng(seed)
        turns = rng.normal(size=(count - 1, 3))
        turns *= step / np.linalg.norm(turns, axis=1)[:, None]
        keys = [rotation.normalize(rng.normal(size=4))]
        for turn in rotation.exp(turns):
            keys.append(rotation.multiply(keys[-1], turn))
        return np.array(keys)

    return make
