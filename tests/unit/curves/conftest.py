"""Example parameters for every family in METHODS, so that each goes through the same suites.

A family that takes ``keys`` and ``times`` needs no line here.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from orientd import rotation
from orientd.curves import METHODS
from orientd.curves.keyframes import resolve_times


def keyframed(keys, times):
    return {"keys": keys, "times": times}


EXAMPLES = {}
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
    if "example" in metafunc.fixturenames:
        examples = [
            pytest.param(Example(name, make), id=f"{name}-{make.__name__}")
            for name in METHODS
            for make in EXAMPLES.get(name, (keyframed,))
        ]
        metafunc.parametrize("example", examples)


@pytest.fixture
def keyframes_of():
    return met_keyframes
