"""Every interpolating family on keyframes that break careless code.

Each case must end in a curve that meets its keyframes and is as smooth as it says, or in an error
that says why there is none; never in a warning, a number that is not one, or a missed keyframe.
"""

import numpy as np
import pytest

from orientd.curves import METHODS
from orientd.errors import PlanError
from orientd.rotation import angle, conjugate, exp, log, multiply, normalize

KEYED = [name for name, family in METHODS.items() if family.interpolates and "keys" in family.takes]
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
        walk(6, 0.02),
        np.cumsum([0.0, 1.0, 1e-4, 1.0, 1e-4, 1e-4]),
    ),
    "late": (walk(7, 1.0), 1e6 + EVEN),
}


FEWER_THAN_3 = r"keys must be a list of at least 3 unit quaternions .*, got .* \(2, 4\)"
SAME = r"got keys\[{}\] and keys\[{}\] the same"
WITHOUT_A_CURVE = {
    "circular_blending": {
        "two keyframes": FEWER_THAN_3,
        "two keyframes half a turn apart": FEWER_THAN_3,
        "two keyframes that are the same": FEWER_THAN_3,
        "all the same": SAME.format(0, 1),
        "one repeated": SAME.format(2, 3),
        "one repeated with the other sign": SAME.format(2, 3),
        "there and back": SAME.format(0, 2),
    },
    "nielson_shieh": {
        "two keyframes that are the same": SAME.format(0, 1),
        "all the same": SAME.format(0, 1),
        "one repeated": SAME.format(2, 3),
        "one repeated with the other sign": SAME.format(2, 3),
    },
    "kks_interpolating": {
        "intervals in a ratio of 10,000": "make neighbouring intervals more alike",
    },
    "nielson_heiland": {
        "intervals in a ratio of 10,000": r"misses one by 0\.0\d+ rad; put keyframes in between",
    },
    "min_acceleration": {
        "intervals in a ratio of 10,000": "make neighbouring intervals more alike",
    },
}
"""By family and case: how it says that there is no curve; everywhere else there is one."""


def made(name, keys, times):
    options = {"require_positive": False} if name == "nielson_shieh" else {}
    return METHODS[name](keys=keys, times=times, **options)


def with_a_curve(cases):
    return [(name, case) for name in KEYED for case in cases if case not in says(name)]


def says(name):
    return WITHOUT_A_CURVE.get(name, {})


SEARCHED_FOR_LONG = [("min_acceleration", "intervals in a ratio of 10,000")]


@pytest.mark.parametrize(
    ("name", "case"),
    [
        pytest.param(n, case, marks=[pytest.mark.slow] * ((n, case) in SEARCHED_FOR_LONG))
        for n in KEYED
        for case in says(n)
    ],
)
def test_where_there_is_no_curve_it_says_why(name, case):
    with pytest.raises((ValueError, PlanError), match=says(name)[case]):
        made(name, *CASES[case])


@pytest.mark.parametrize(("name", "case"), with_a_curve(CASES))
def test_everywhere_else_it_meets_its_keyframes(name, case):
    keys, times = CASES[case]
    curve = made(name, keys, times)
    assert curve.domain == (times[0], times[-1])
    q, omega, alpha = curve.evaluate(np.linspace(*curve.domain, 101))
    assert all(np.isfinite(part).all() for part in (q, omega, alpha))
    assert angle(curve.evaluate(times)[0], keys).max() < 1e-8


@pytest.mark.parametrize(
    ("name", "case"), with_a_curve(["half turns", "one repeated", "there and back", "late"])
)
def test_it_is_as_smooth_as_it_says(name, case):
    curve = made(name, *CASES[case])
    knots = curve.knots[1:-1]
    right = curve.evaluate(knots)
    left = curve.evaluate(np.nextafter(knots, -np.inf))
    everywhere = curve.evaluate(np.linspace(*curve.domain, 301))
    for order in range(1, curve.continuity + 1):
        # One unit in the last place before a knot, the next lower derivative has moved on.
        resolution = 3e-8 + np.spacing(knots[-1]) * 1e6
        scale = 1.0 + np.abs(everywhere[order]).max()
        assert np.abs(right[order] - left[order]).max() < resolution * scale


@pytest.mark.parametrize(
    ("name", "case"),
    with_a_curve(["half turns", "179.99 degrees", "intervals in a ratio of 10,000"]),
)
def test_its_rates_are_those_of_its_orientations(name, case):
    curve = made(name, *CASES[case])
    knots, spans = curve.knots[:-1], np.diff(curve.knots)
    shares = np.array([[1e-4, 1e-3, 0.02, 0.3, 0.71, 0.98, 0.999]])
    times = (knots[:, None] + shares * spans[:, None]).ravel()
    room = (np.minimum(shares, 1.0 - shares) * spans[:, None]).ravel()
    _, omega, alpha = curve.evaluate(times)
    errors = []
    # What turns sharply next to a knot wants other steps than what is even: the best of some.
    for step in (room * 0.4**k for k in range(1, 13)):
        turned, gained = [], []
        for h in (step, 2.0 * step):
            after, before = curve.evaluate(times + h), curve.evaluate(times - h)
            width = ((times + h) - (times - h))[:, None]
            turned.append(log(multiply(conjugate(before[0]), after[0])) / width)
            gained.append((after[1] - before[1]) / width)
        errors.append(
            [
                np.abs((4.0 * near - far) / 3.0 - rate).max(axis=1)
                for (near, far), rate in ((turned, omega), (gained, alpha))
            ]
        )
    least = np.min(errors, axis=0)
    peaks = np.array([[max(1.0, np.abs(rate).max())] for rate in (omega, alpha)])
    # An acceleration loses digits beside what would stop the velocity within the span.
    peaks[1] += 1e-5 * np.abs(omega).max() / spans.min()
    assert (least < 1e-6 * peaks).all()


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
    if "start" in METHODS[name].takes:
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
