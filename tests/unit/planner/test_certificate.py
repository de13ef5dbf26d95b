import tracemalloc
from math import sqrt

import numpy as np
import pytest
from planned import rotations

from orientd.floats import difference
from orientd.planner import DEFAULT_LIMITS, Limits
from orientd.planner.certify import measuring
from orientd.planner.certify.differences import Rough
from orientd.planner.certify.measuring import measure

H = 0.004


def walk(count=300, seed=1):
    """Return a smooth walk of orientations and positions: rates from filtered noise."""
    from orientd.rotation import exp, multiply

    random = np.random.default_rng(seed)
    window = np.hanning(41)
    noise = random.normal(size=(3, count)) * np.hanning(count) ** 2
    noise[:, :40] = noise[:, -40:] = 0.0
    omega = np.stack([np.convolve(part, window, "same") for part in noise], axis=1)
    q = [np.array(rotations(random, 2, 0.1)[0])]
    for rate in omega[1:] * H * 0.2:
        q.append(multiply(q[-1], exp(rate)))
    return np.array(q), np.cumsum(omega, axis=0) * H * 0.1


def look(q, p, **changes):
    def setpoints(first, size):
        return q[first : first + size], p[first : first + size]

    before = np.repeat(q[:1], 3, axis=0), np.repeat(p[:1], 3, axis=0)
    fields = {"before": before, "holds_after": True, **changes}
    return measure(setpoints, len(q), H, DEFAULT_LIMITS, **fields)


def plainly(q):
    """Return the peaks and their indices in plain floats, as a device would find them."""
    setpoints = [tuple(row) for row in q.tolist()]
    setpoints = [setpoints[0], *setpoints, *setpoints[-1:] * 3]
    omega = alpha = (0.0, 0.0, 0.0)
    peaks = [(0.0, 0)] * 3
    for k in range(1, len(setpoints)):
        w = tuple(c / H for c in difference(setpoints[k - 1], setpoints[k]))
        a = tuple((x - y) / H for x, y in zip(w, omega, strict=True))
        j = tuple((x - y) / H for x, y in zip(a, alpha, strict=True))
        omega, alpha = w, a
        for place, rate in enumerate((w, a, j)):
            size = sqrt(sum(c * c for c in rate))
            peaks[place] = max(peaks[place], (size, k - 1))
    return peaks


def test_peaks_are_those_of_backward_differences_with_their_times():
    q, p = walk()
    peaks = look(q, p)
    for peak, (value, index) in zip(
        (peaks.velocity, peaks.acceleration, peaks.jerk), plainly(q), strict=True
    ):
        assert peak.value == pytest.approx(value, rel=1e-6)
        assert peak.time == pytest.approx(index * H)


def test_linear_peaks_are_those_of_the_position():
    q, p = walk()
    peaks = look(q, p)
    padded = np.concatenate([p[:1], p, p[-1:]])
    v = np.linalg.norm(np.diff(padded, axis=0), axis=1) / H
    a = np.linalg.norm(np.diff(padded, n=2, axis=0), axis=1) / H**2
    assert peaks.linear_velocity.value == pytest.approx(v.max())
    assert peaks.linear_acceleration.value == pytest.approx(a.max())


@pytest.mark.parametrize("chunk", [1, 2, 3, 7, 299, 300, 301])
def test_the_size_of_chunks_makes_no_difference(monkeypatch, chunk):
    q, p = walk()
    limits = DEFAULT_LIMITS.scaled(8.0)
    whole = look(q, p, brake_limits=limits)
    assert whole.brake_rate > 0.0
    monkeypatch.setattr(measuring, "CHUNK", chunk)
    assert look(q, p, brake_limits=limits) == whole


def test_the_signs_of_quaternions_make_no_difference():
    q, p = walk()
    flipped = q * np.random.default_rng(2).choice([-1.0, 1.0], size=(len(q), 1))
    assert look(flipped, p).jerk.value == pytest.approx(look(q, p).jerk.value)


def test_a_jump_at_the_start_is_seen_against_what_the_device_held():
    q, p = walk()
    away = np.repeat(q[:1] * [1, -1, -1, -1], 3, axis=0), np.repeat(p[:1], 3, axis=0)
    assert look(q, p, before=away).velocity.time == 0.0


def test_without_history_only_differences_inside_count():
    q, p = walk()
    inside = look(q, p, before=None, holds_after=False)
    assert inside.velocity.value <= look(q, p).velocity.value
    lone = look(q[:1], p[:1], before=None, holds_after=False)
    assert lone.velocity.value == 0.0


@pytest.mark.parametrize("chunk", [60, 8192])
def test_what_is_not_a_number_is_the_peak(monkeypatch, chunk):
    monkeypatch.setattr(measuring, "CHUNK", chunk)
    q, p = walk()
    q[150] = np.nan
    assert np.isnan(look(q, p).velocity.value)


def test_a_rough_part_brakes_more_carefully_than_a_smooth_one():
    q, p = walk()
    tight = Limits(10.0, 200.0, 1.2 * look(q, p).jerk.value, 10.0, 1e3)
    smooth = look(q, p, brake_limits=tight)
    rough = look(q, p, brake_limits=tight, rough=Rough(0.0, len(q) * H, 1))
    elsewhere = look(q, p, brake_limits=tight, rough=Rough(10.0, 20.0, 1))
    assert rough.brake_rate < smooth.brake_rate == elsewhere.brake_rate


def test_a_long_motion_needs_no_more_memory_than_a_short_one():
    unit, nowhere = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3))

    def setpoints(first, size):
        return np.repeat(unit, size, axis=0), np.repeat(nowhere, size, axis=0)

    used = []
    for count in (50_000, 500_000):
        tracemalloc.start()
        measure(
            setpoints,
            count,
            H,
            DEFAULT_LIMITS,
            before=setpoints(0, 3),
            holds_after=True,
            brake_limits=DEFAULT_LIMITS,
        )
        used.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert used[1] < 1.3 * used[0]
