"""Every interpolating family on keyframes that break careless code.

Each case must end in a curve that meets its keyframes and is as smooth as it says, or in an error
that says why there is none; never in a warning, a number that is not one, or a missed keyframe.
"""

import numpy as np
import pytest

from orientd.curves import METHODS
from orientd.errors import PlanError
from orientd.rotation import angle, exp, multiply, normalize

KEYED = [
    name
    for name, family in METHODS.items()
    if family.interpolates and "keys" in family.__init__.__annotations__
]
EVEN = np.arange(7.0)


def walk(count, step, seed=1):
    rng = np.random.default_rng(seed)
    turns = rng.normal(size=(count - 1, 3))
    turns *= step / np.linalg.norm(turns, axis=1)[:, None]
    keys = [normalize([1.0, 2.0, -1.0, 0.5])]
    for turn in exp(turns):
        keys.append(normalize(multiply(keys[-1], turn)))
    return np.array(keys)


def around(size):
    return multiply(normalize([0.3, 0.5, -0.2, 0.8]), exp(walk(7, 1.0)[:, 1:] * size))


def repeated(keys, sign=1.0):
    changed = keys.copy()
    changed[3] = sign * changed[2]
    return changed


CASES = {
    "two keyframes": (walk(2, 1.0), np.array([0.0, 2.0])),
    "two keyframes half a turn apart": (walk(2, np.radians(179.99)), np.array([0.0, 2.0])),
    "two keyframes that are the same": (repeated(walk(7, 1.0))[2:4], np.array([0.0, 2.0])),
    "three keyframes": (walk(3, 1.0), np.array([0.0, 0.3, 2.0])),
    "a microradian apart": (around(1e-6), EVEN),
    "a nanoradian apart": (around(1e-9), EVEN),
    "all the same": (np.tile(walk(2, 1.0)[:1], (7, 1)), EVEN),
    "one repeated": (repeated(walk(7, 1.0)), EVEN),
    "one repeated with the other sign": (repeated(walk(7, 1.0), -1.0), EVEN),
    "signs flipped": (walk(7, 1.0) * np.array([1, -1, -1, 1, -1, 1, -1.0])[:, None], EVEN),
    "there and back": (walk(2, 1.0)[[0, 1, 0, 1, 0, 1, 0]], EVEN),
    "179.99 degrees": (walk(7, np.radians(179.99)), EVEN),
    "half turns": (walk(7, np.pi), EVEN),
    "intervals in a ratio of 10,000": (
        walk(7, 0.02),
        np.cumsum([0.0, 1.0, 1e-4, 1.0, 1e-4, 1e-4, 1.0]),
    ),
    "late": (walk(7, 1.0), 1e6 + EVEN),
}


def made(name, keys, times):
    options = {"require_positive": False} if name == "nielson_shieh" else {}
    return METHODS[name](keys=keys, times=times, **options)


@pytest.mark.parametrize("name", KEYED)
@pytest.mark.parametrize("case", CASES)
def test_it_meets_its_keyframes_or_says_why_not(name, case):
    keys, times = CASES[case]
    try:
        curve = made(name, keys, times)
    except (ValueError, PlanError) as error:
        assert len(str(error)) > 30  # noqa: PT017 - a curve is right as well
        return
    q, omega, alpha = curve.evaluate(np.linspace(*curve.domain, 101))
    assert all(np.isfinite(part).all() for part in (q, omega, alpha))
    assert angle(curve.evaluate(times)[0], keys).max() < 1e-8


@pytest.mark.parametrize("name", KEYED)
@pytest.mark.parametrize("case", ["half turns", "one repeated", "there and back", "late"])
def test_it_is_as_smooth_as_it_says(name, case):
    try:
        curve = made(name, *CASES[case])
    except (ValueError, PlanError):
        pytest.skip("says that there is no such curve")
    knots = curve.knots[1:-1]
    right = curve.evaluate(knots)
    left = curve.evaluate(np.nextafter(knots, -np.inf))
    everywhere = curve.evaluate(np.linspace(*curve.domain, 301))
    for order in range(1, curve.continuity + 1):
        # One unit in the last place before a knot, the next lower derivative has moved on.
        resolution = 1e-8 + np.spacing(knots[-1]) * 1e6
        scale = 1.0 + np.abs(everywhere[order]).max()
        assert np.abs(right[order] - left[order]).max() < resolution * scale


# What the others need is in their docstrings: circles three keyframes that differ, and so on.
ALWAYS = sorted(set(KEYED) - {"circular_blending", "nielson_shieh", "nielson_heiland"})


@pytest.mark.parametrize("name", ALWAYS)
@pytest.mark.parametrize("case", [case for case in CASES if "ratio" not in case])
def test_the_families_without_such_conditions_always_find_a_curve(name, case):
    keys, times = CASES[case]
    assert made(name, keys, times).domain == (times[0], times[-1])


@pytest.mark.parametrize("name", KEYED)
def test_a_thousand_keyframes_are_met(name):
    t = np.linspace(0.0, 30.0, 1000)
    keys = multiply(exp(np.stack([np.sin(t), 0.7 * t, 0.0 * t], axis=1)), exp([0.3, 0.0, 0.0]))
    times = np.cumsum(np.random.default_rng(0).uniform(0.9, 1.1, 1000))
    curve = made(name, keys, times)
    assert angle(curve.evaluate(times)[0], keys).max() < 1e-9


@pytest.mark.parametrize("name", [n for n in KEYED if METHODS[n].meets_end_velocities])
def test_ends_of_50_radians_a_second_are_met(name):
    fast = {"omega_start": [30.0, 0.0, 40.0], "omega_end": [0.0, -50.0, 0.0]}
    if "start" in METHODS[name].__init__.__annotations__:
        fast |= {"start": "clamped", "end": "clamped"}
    if name == "kks_interpolating":
        # Higher orders need whole turns to coast through at such speeds.
        fast["order"] = 4
    keys, times = walk(4, 1.0), np.array([0.0, 0.5, 0.8, 1.2])
    curve = METHODS[name](keys=keys, times=times, **fast)
    q, omega, _ = curve.evaluate(times)
    assert angle(q, keys).max() < 1e-9
    assert np.abs(omega[0] - fast["omega_start"]).max() < 1e-9
    assert np.abs(omega[-1] - fast["omega_end"]).max() < 1e-9
