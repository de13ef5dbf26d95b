"""Hard cases of the Kim-Kim-Shin families against a second implementation in mpmath.

The second implementation is the definition written down: Cox-de Boor from the knots, cumulative
sums, quaternion exponentials, and derivatives by differences with 50 digits.
"""

import functools
from itertools import pairwise

import mpmath
import numpy as np
import pytest

from orientd import rotation
from orientd.curves import METHODS

mp = mpmath.mp
H = mpmath.mpf(10) ** -15


@pytest.fixture(autouse=True)
def fifty_digits():
    with mpmath.workdps(50):
        yield


def multiply(p, q):
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return [
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    ]


def conjugate(q):
    return [q[0], -q[1], -q[2], -q[3]]


def exp(v):
    length = mpmath.sqrt(sum(x * x for x in v))
    sinc = mpmath.sin(length) / length if length else mpmath.mpf(1)
    return [mpmath.cos(length), *(sinc * x for x in v)]


def log(q):
    length = mpmath.sqrt(sum(x * x for x in q[1:]))
    factor = mpmath.atan2(length, q[0]) / length if length else mpmath.mpf(1)
    return [factor * x for x in q[1:]]


def rel(p, q):
    return log(multiply(conjugate(p), q))


def scaled(s, v):
    return [s * x for x in v]


def rotate(q, v):
    return multiply(multiply(q, [0, *v]), conjugate(q))[1:]


def unit(q):
    q = [mpmath.mpf(float(x)) for x in q]
    norm = mpmath.sqrt(sum(x * x for x in q))
    return [x / norm for x in q]


def aligned(keys):
    keys = [unit(q) for q in keys]
    for i in range(1, len(keys)):
        if sum(a * b for a, b in zip(keys[i], keys[i - 1], strict=True)) < 0:
            keys[i] = scaled(-1, keys[i])
    return keys


def numbers(values):
    return [mpmath.mpf(float(x)) for x in values]


def b_spline(i, order, knots, t, last):
    if order == 1:
        closed = t == last and knots[i + 1] == last and knots[i] < last
        return mpmath.mpf(knots[i] <= t < knots[i + 1] or closed)
    total = mpmath.mpf(0)
    if knots[i + order - 1] > knots[i]:
        share = (t - knots[i]) / (knots[i + order - 1] - knots[i])
        total += share * b_spline(i, order - 1, knots, t, last)
    if knots[i + order] > knots[i + 1]:
        share = (knots[i + order] - t) / (knots[i + order] - knots[i + 1])
        total += share * b_spline(i + 1, order - 1, knots, t, last)
    return total


@functools.cache
def cumulative_basis(knots, order, count, t):
    """The values of B~_1 ... B~_(count-1) at *t*, which many increments are tried with."""
    functions = [b_spline(j, order, knots, t, knots[count]) for j in range(count)]
    return [sum(functions[i:]) for i in range(1, count)]


def cumulative(start, increments, knots, order):
    """The curve q0 prod exp(w_i B~_i(t)) over all functions, by the definition."""

    def curve(t):
        q = start
        basis = cumulative_basis(tuple(knots), order, len(increments) + 1, t)
        for increment, share in zip(increments, basis, strict=True):
            if share:
                q = multiply(q, exp(scaled(share, increment)))
        return q

    return curve


def controlled(control, knots, order):
    increments = [rel(p, q) for p, q in pairwise(control)]
    return cumulative(control[0], increments, knots, order)


def assert_is(curve, reference, times, tolerance=1e-13):
    """Orientation, velocity and acceleration are those of a function of time in mpmath.

    The trajectory is fitted within 1e-14 rad, or the rounding of the instants.  Derivatives enlarge
    that by one and two powers of the length of its pieces.
    """
    q, omega, alpha = curve.evaluate(times)
    breaks = curve.trajectory.breaks
    piece = np.clip(np.searchsorted(breaks, times, side="right") - 1, 0, len(breaks) - 2)
    lengths = np.diff(breaks)[piece].tolist()
    for k, t in enumerate(numbers(times)):
        before, here, after = reference(t - H), reference(t), reference(t + H)
        rate = [(a - b) / (2 * H) for a, b in zip(after, before, strict=True)]
        change = [(a - 2 * m + b) / H**2 for a, m, b in zip(after, here, before, strict=True)]
        omega_k = scaled(2, multiply(conjugate(here), rate)[1:])
        alpha_k = scaled(2, multiply(conjugate(here), change)[1:])
        missed = multiply(conjugate(here), numbers(q[k]))
        assert 2 * mpmath.norm(mpmath.matrix(missed[1:])) < tolerance
        fastest = max(1, *(abs(x) for x in omega_k))
        strongest = max(fastest**2, *(abs(x) for x in alpha_k))
        fit = 1e-14 + 1e-15 * abs(t) * fastest
        for c in range(3):
            omega_off = abs(omega_k[c] - mpmath.mpf(float(omega[k, c])))
            alpha_off = abs(alpha_k[c] - mpmath.mpf(float(alpha[k, c])))
            assert omega_off < tolerance * fastest + 200 * fit / lengths[k]
            assert alpha_off < tolerance * strongest + 1e4 * fit / lengths[k] ** 2


def inside(breaks, shares=(0.1, 0.5, 0.85)):
    breaks = np.unique(breaks)
    return (breaks[:-1, None] + np.array(shares) * np.diff(breaks)[:, None]).ravel()


def walk(steps, seed=0):
    """Keyframes at given turns from one another about random axes, with random signs."""
    rng = np.random.default_rng(seed)
    keys = [rotation.normalize(rng.normal(size=4))]
    for step in steps:
        axis = rotation.normalize(np.append(0.0, rng.normal(size=3)))[1:]
        turned = rotation.multiply(keys[-1], rotation.from_axis_angle(axis, step))
        keys.append(turned * rng.choice([-1.0, 1.0]))
    return np.array(keys)


TURNS = [1e-12, 1e-7, 0.3, 2.0, np.radians(179.99)]


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("path", ["short", "long", "as_is", "complement"])
@pytest.mark.parametrize("spins", [0, 3, -2])
def test_slerp(turn, path, spins):
    q0, q1 = walk([turn], seed=5)
    curve = METHODS["slerp"](q0=q0, q1=q1, t0=1.0, t1=4.0, path=path, spins=spins)
    start, end = unit(q0), unit(q1)
    dot = sum(a * b for a, b in zip(start, end, strict=True))
    if (path == "short" and dot < 0) or (path == "long" and dot > 0):
        end = scaled(-1, end)
    vector = rel(start, end)
    theta = mpmath.sqrt(sum(x * x for x in vector))
    whole = theta + spins * mpmath.pi - (2 * mpmath.pi if path == "complement" else 0)

    def reference(t):
        return multiply(start, exp(scaled((t - 1) / 3 * whole / theta, vector)))

    # Near a whole turn the axis is known only as well as the small rest is.
    tolerance = 1e-13 if theta < 3 and turn > 1e-3 else 1e-15 / min(turn, 3.15 - float(theta))
    assert_is(curve, reference, inside([1.0, 4.0]), max(tolerance, 1e-13))


HERMITE = [
    {},
    {"omega0": [50.0, 0.0, 0.0], "omega1": [0.0, -50.0, 0.0]},
    {"omega0": [50.0, 10.0, 5.0], "omega1": [30.0, 50.0, 0.0], "revolutions": 5},
    {"revolutions": -2, "frame": "world"},
    {"product": "global"},
    {"product": "global", "frame": "world", "revolutions": 1, "omega0": [0.0, 20.0, 0.0]},
    {"t0": -3.0, "t1": -2.999},
]


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("change", HERMITE)
def test_kks_hermite(turn, change):
    q0, q1 = walk([turn], seed=7)
    params = {"q0": q0, "q1": q1, "omega0": [1.0, -2.0, 0.5], "omega1": [0.0, 1.5, 2.0]}
    params |= {"t0": 2.0, "t1": 3.5} | change
    curve = METHODS["kks_hermite"](**params)
    start, end = aligned([q0, q1])
    t0, t1 = numbers([params["t0"], params["t1"]])
    rates = []
    for q, name in ((start, "omega0"), (end, "omega1")):
        given = numbers(params[name])
        body = rotate(conjugate(q), given) if params.get("frame") == "world" else given
        rates.append(scaled((t1 - t0) / 6, body))
    is_global = params.get("product") == "global"
    if is_global:
        w1, w3 = rotate(start, rates[0]), rotate(end, rates[1])
        turn_between = multiply(multiply(exp(scaled(-1, w3)), end), conjugate(start))
        w2 = log(multiply(turn_between, exp(scaled(-1, w1))))
    else:
        w1, w3 = rates
        turn_between = multiply(exp(scaled(-1, w1)), multiply(conjugate(start), end))
        w2 = log(multiply(turn_between, exp(scaled(-1, w3))))
    length = mpmath.sqrt(sum(x * x for x in w2))
    w2 = scaled(1 + params.get("revolutions", 0) * mpmath.pi / length, w2)

    def reference(t):
        u = (t - t0) / (t1 - t0)
        first = exp(scaled(1 - (1 - u) ** 3, w1))
        second = exp(scaled(3 * u**2 - 2 * u**3, w2))
        third = exp(scaled(u**3, w3))
        if is_global:
            return multiply(third, multiply(second, multiply(first, start)))
        return multiply(multiply(multiply(start, first), second), third)

    assert_is(curve, reference, inside([params["t0"], params["t1"]]), 1e-12)


CHAINS = {
    "ordinary": ([0.9, 1.1, 0.8, 1.2], [0.0, 1.1, 1.9, 3.4, 4.0]),
    "two keyframes": ([1.0], [0.0, 2.0]),
    "nearly identical": ([1.0, 1e-9, 1e-12, 1.0], [0.0, 1.0, 2.0, 3.0, 4.0]),
    "nearly half turns": ([np.radians(179.99)] * 4, [0.0, 1.0, 2.0, 3.0, 4.0]),
    "ratio of 10,000": ([0.3, 2e-5, 0.4, 0.3], [0.0, 1.0, 1.0001, 2.0, 3.0]),
    "ratio of 10,000 and a fast step": ([0.3, 0.2, 0.4, 0.3], [0.0, 1.0, 1.0001, 2.0, 3.0]),
    "chord of nearly identical": ([0.4, 1e-7, 0.5, 0.3], "chord"),
    "late and short": ([0.5, 0.7, 0.2, 0.6], 1e6 + np.array([0.0, 0.01, 0.03, 0.04, 0.06])),
}


@pytest.mark.parametrize("rule", ["parabola", "mean", "chord"])
@pytest.mark.parametrize("chain", CHAINS)
def test_kks_hermite_spline(chain, rule):
    steps, times = CHAINS[chain]
    keys = walk(steps, seed=11)
    params = {"keys": keys, "times": times, "rule": rule, "omega_start": [50.0, 0.0, 1.0]}
    curve = METHODS["kks_hermite_spline"](**params)
    q = aligned(keys)
    t = numbers(curve.knots)
    h = [b - a for a, b in pairwise(t)]
    steps = [rel(a, b) for a, b in pairwise(q)]
    v = [scaled(mpmath.mpf(1) / 2, numbers([50.0, 0.0, 1.0]))]
    for i in range(1, len(h)):
        before, after = scaled(1 / h[i - 1], steps[i - 1]), scaled(1 / h[i], steps[i])
        weights = (h[i], h[i - 1]) if rule == "parabola" else (1, 1)
        mixed = [weights[0] * b + weights[1] * a for b, a in zip(before, after, strict=True)]
        v.append(scaled(1 / mpmath.mpf(sum(weights)), mixed))
        if rule == "chord":
            v[-1] = scaled(1 / (h[i - 1] + h[i]), rel(q[i - 1], q[i + 1]))
    v.append(scaled(1 / h[-1], steps[-1]))

    def reference(at):
        i = max(k for k in range(len(h)) if t[k] <= at)
        u = (at - t[i]) / h[i]
        w1, w3 = scaled(h[i] / 3, v[i]), scaled(h[i] / 3, v[i + 1])
        inner = multiply(exp(scaled(-1, w1)), multiply(conjugate(q[i]), q[i + 1]))
        w2 = log(multiply(inner, exp(scaled(-1, w3))))
        result = q[i]
        for w, b in ((w1, 1 - (1 - u) ** 3), (w2, 3 * u**2 - 2 * u**3), (w3, u**3)):
            result = multiply(result, exp(scaled(b, w)))
        return result

    breaks = curve.knots
    relative_step = np.diff(breaks).min() / max(1.0, abs(breaks).max())
    assert_is(curve, reference, inside(breaks), max(1e-13, 2e-15 / relative_step))


KNOTS = {
    "uniform": np.arange(14.0),
    "ratio of 10,000": np.cumsum([0, 1, 1, 1, 1, 1, 1e-4, 1, 0.5, 1, 1, 1, 1, 1]),
    "double": np.array([0, 0, 0, 0, 1, 2, 2, 3, 4, 5, 6, 6, 6, 6.0]),
    "clamped": np.array([0, 0, 0, 0, 0, 0, 1, 1.1, 3, 3, 3, 3, 3, 3.0]),
}


@pytest.mark.parametrize("knots", KNOTS)
@pytest.mark.parametrize("order", [2, 3, 4, 5, 6])
def test_kks_bspline(knots, order):
    vector = KNOTS[knots]
    control = walk([0.8, 1e-9, 2.0, 0.5, np.radians(179.99), 1.0, 0.2, 0.9, 0.7, 1.1, 0.4], seed=3)
    control = control[: 14 - order]
    last = len(control)
    inner = vector[order:last]
    if len(inner) and max(np.sum(inner == knot) for knot in inner) >= order:
        pytest.skip("the curve would jump")
    curve = METHODS["kks_bspline"](control=control, order=order, knots=vector)
    reference = controlled(aligned(control), numbers(vector), order)
    assert_is(curve, reference, inside(vector[order - 1 : last + 1], (0.2, 0.9)), 2e-11)


@pytest.mark.parametrize("degree", [1, 2, 7, 20])
def test_kks_bezier(degree):
    control = walk([0.7] * degree, seed=degree)
    curve = METHODS["kks_bezier"](control=control, t0=1.0, t1=1.5)
    q = aligned(control)
    steps = [rel(a, b) for a, b in pairwise(q)]

    def reference(t):
        u = (t - 1) * 2
        weights = [
            mpmath.binomial(degree, j) * (1 - u) ** (degree - j) * u**j for j in range(degree + 1)
        ]
        result = q[0]
        for i in range(1, degree + 1):
            result = multiply(result, exp(scaled(sum(weights[i:]), steps[i - 1])))
        return result

    assert_is(curve, reference, inside([1.0, 1.5]))


@pytest.mark.parametrize("count", [2, 3, 6])
def test_kks_uniform(count):
    control = walk([1.0] * (count - 1), seed=count)
    q = aligned(control)
    q.insert(0, multiply(multiply(q[0], conjugate(q[1])), q[0]))
    q.append(multiply(multiply(q[-1], conjugate(q[-2])), q[-1]))
    knots = [mpmath.mpf(i - 3) for i in range(len(q) + 4)]
    curve = METHODS["kks_uniform"](control=control)
    assert_is(curve, controlled(q, knots, 4), inside(np.arange(float(count))))


ENDS = {
    "natural": {},
    "clamped": {"omega_start": [1.0, 2.0, 0.0], "omega_end": [0.0, -1.0, 0.5]},
    "state": {
        "omega_start": [1.0, 2.0, 0.0],
        "omega_end": [0.0, -1.0, 0.5],
        "alpha_start": [3.0, 0.0, -1.0],
        "alpha_end": [0.0, 4.0, 2.0],
    },
}


def is_quick(chain, ends):
    """Whether it is the ends that give most freedom, or the plainest of chains."""
    return ends == "state" or chain in ("ordinary", "two keyframes")


@pytest.mark.parametrize(
    ("chain", "ends"),
    [
        pytest.param(chain, ends, marks=() if is_quick(chain, ends) else pytest.mark.slow)
        for ends in ENDS
        for chain in CHAINS
        if "fast" not in chain
    ],
)
def test_c2_cumulative(chain, ends):
    """The increments found are roots of the interpolation conditions, refined with 50 digits."""
    steps, times = CHAINS[chain]
    keys = walk(steps, seed=13)
    params = {"keys": keys, "times": times, "start": ends, "end": ends, **ENDS[ends]}
    curve = METHODS["c2_cumulative"](**params)
    q = aligned(keys)
    breaks = numbers(curve.knots)
    added = {2: (1, 2)}.get(len(keys), (1, len(breaks) - 2)) if ends == "state" else ()
    t = [knot for place, knot in enumerate(breaks) if place not in added]
    knots = breaks[:1] * 3 + breaks + breaks[-1:] * 3
    count = len(knots) - 4

    def motion(reference, at, side):
        points = [reference(at + side * k * H) for k in range(3)]
        here = conjugate(points[0])
        rate = [side * (4 * b - 3 * a - c) / (2 * H) for a, b, c in zip(*points, strict=True)]
        points.append(reference(at + side * 3 * H))
        change = [(2 * a - 5 * b + 4 * c - d) / H**2 for a, b, c, d in zip(*points, strict=True)]
        return scaled(2, multiply(here, rate)[1:]), scaled(2, multiply(here, change)[1:])

    def conditions(*unknown):
        w = [list(unknown[3 * i : 3 * i + 3]) for i in range(count - 1)]
        reference = cumulative(q[0], w, knots, 4)
        missed = []
        for key, at in zip(q[1:], t[1:], strict=True):
            missed += rel(key, reference(at))
        for at, side, name in ((t[0], 1, "start"), (t[-1], -1, "end")):
            omega, alpha = motion(reference, at, side)
            short = breaks[1] - breaks[0] if side == 1 else breaks[-1] - breaks[-2]
            if ends != "natural":
                given = numbers(params[f"omega_{name}"])
                missed += [(a - b) * short for a, b in zip(omega, given, strict=True)]
            if ends != "clamped":
                given = numbers(params.get(f"alpha_{name}", [0.0] * 3))
                missed += [(a - b) * short**2 for a, b in zip(alpha, given, strict=True)]
        return missed

    guess = numbers(curve.increments.ravel())
    here = conditions(*guess)
    columns, step = [], mpmath.mpf(10) ** -12  # differences leave 20 digits of accelerations
    for k in range(len(guess)):
        moved = list(guess)
        moved[k] += step
        there = conditions(*moved)
        columns.append([(a - b) / step for a, b in zip(there, here, strict=True)])
    slope = mpmath.matrix(columns).T
    root = guess
    for _ in range(2):  # so near the root, its slope is that of the guess
        change = mpmath.lu_solve(slope, -mpmath.matrix(conditions(*root)))
        root = [a + b for a, b in zip(root, change, strict=True)]
    assert max(abs(miss) for miss in conditions(*root)) < mpmath.mpf(10) ** -17
    largest = max(abs(x) for x in root)
    relative_step = np.diff(curve.knots).min() / max(1.0, abs(curve.knots).max())
    rounding = max(1e-13, 1e-16 / relative_step) * max(1, largest)
    assert max(abs(a - b) for a, b in zip(root, guess, strict=True)) < rounding
    w = [root[3 * i : 3 * i + 3] for i in range(count - 1)]
    tolerance = max(1e-13, 4e-15 / relative_step)
    assert_is(curve, cumulative(q[0], w, knots, 4), inside(curve.knots, (0.5,)), tolerance)
