"""Certificates of axes and positions, against what is found at random phases and rates."""

import os

import numpy as np
import pytest
from reference.differences import brake_rate_of

from orientd.driver import AxisLimits
from orientd.errors import LimitKind, PlanError
from orientd.model.limits import Limits
from orientd.planner.certify.measuring import STATE, AxisRecords, measure

CASES = int(os.environ.get("ORIENTD_CASES", "40000"))
PERIODS = (0.01, 0.002)
KINDS = (LimitKind.VELOCITY, LimitKind.ACCELERATION, LimitKind.JERK)


def walk(seed, axes, period, *, rough):
    """Return smooth values and velocities from rest to rest; *rough* ones change at each record."""
    random = np.random.default_rng(seed)
    count = int(random.integers(60, 700))
    smooth = np.hanning(int(random.integers(5, 50)))
    sizes = np.concatenate([[1.0], np.geomspace(1.0, 1e-3, axes - 1)])
    noise = sizes * random.normal(size=(count, axes))
    speeds = np.stack([np.convolve(part, smooth, "same") for part in noise.T], axis=1)
    rise = np.clip(np.arange(count) / 10.0, 0.0, 1.0)[:, None]
    speeds *= rise**3 * rise[::-1] ** 3
    values = period * (np.cumsum(speeds, axis=0) - 0.5 * speeds)
    if rough:
        speeds += 0.002 * sizes * random.normal(size=speeds.shape) * rise * rise[::-1]
    speeds[0] = speeds[-1] = 0.0
    return values, speeds


def along(values, speeds, period, places):
    """Return the cubic between records at places among them; before and after them it stays."""
    places = np.clip(places, 0.0, len(values) - 1.0)
    record = np.minimum(places.astype(np.int64), len(values) - 2)
    u = (places - record)[..., None]
    p, q = values[record], values[record + 1]
    v, w = period * speeds[record], period * speeds[record + 1]
    return p + u * (v + u * (3.0 * (q - p) - 2.0 * v - w + u * (2.0 * (p - q) + v + w)))


def seen(values, speeds, period, places, rates):
    """Return the three differences that end at places, at rates of the path, SI units."""
    steps = places[..., None] - rates[..., None] * np.arange(4)
    found = along(values, speeds, period, steps)
    return [
        weighted.sum(axis=-2) / period**order
        for order, weighted in (
            (1, found[..., :2, :] * [[1.0], [-1.0]]),
            (2, found[..., :3, :] * [[1.0], [-2.0], [1.0]]),
            (3, found * [[1.0], [-3.0], [3.0], [-1.0]]),
        )
    ]


def axes_like(count, jerk=1e300):
    return [AxisLimits(f"axis {k}", -1e9, 1e9, 1e300, 1e300, jerk) for k in range(count)]


def certified(values, speeds, period, axes, tolerance=1.0):
    rows = np.zeros((len(values), STATE))
    rows[:, 0] = 1.0
    earlier = np.repeat(values[:1], 3, axis=0)
    given = AxisRecords(values, speeds, earlier, axes)
    return measure(
        rows, len(rows), period, Limits.partial(), before=None, tolerance=tolerance, axes=given
    )


@pytest.mark.parametrize("rough", [False, True])
def test_no_axis_is_above_its_certificate_at_any_phase_and_rate(rough):
    random, paths = np.random.default_rng(3), 40
    for seed in range(paths):
        period = PERIODS[seed % 2]
        values, speeds = walk(seed, 5, period, rough=rough)
        peaks = certified(values, speeds, period, axes_like(5)).axes
        assert [(one.axis.name, one.kind) for one in peaks] == [
            (f"axis {k}", kind) for k in range(5) for kind in KINDS
        ]
        bounds = np.array([one.value for one in peaks]).reshape(5, 3).T
        size = -(-CASES // paths)
        places = random.uniform(0.0, len(values) + 2.0, size)
        rates = 1.0 - random.uniform(size=size) ** 3 * (random.uniform(size=size) < 0.7)
        for order, found in enumerate(seen(values, speeds, period, places, rates)):
            rounding = 1e-13 / period ** (order + 1)
            assert (np.abs(found).max(axis=0) <= bounds[order] * (1.0 + 1e-6) + rounding).all()


@pytest.mark.parametrize("rough", [False, True])
def test_a_certificate_of_axes_is_hardly_above_what_is_reached(rough):
    for seed in range(20):
        period = PERIODS[seed % 2]
        values, speeds = walk(seed, 4, period, rough=rough)
        peaks = certified(values, speeds, period, axes_like(4)).axes
        bounds = np.array([one.value for one in peaks]).reshape(4, 3).T
        places = np.linspace(0.0, len(values) + 2.0, 32 * (len(values) + 2) + 1)
        best = np.zeros((3, 4))
        for rate in np.linspace(1.0, 0.4, 13 if rough else 1):
            found = seen(values, speeds, period, places, np.full(len(places), rate))
            best = np.maximum(best, [np.abs(part).max(axis=0) for part in found])
        assert (bounds <= 1.005 * best).all()


@pytest.mark.parametrize("rough", [False, True])
def test_a_position_is_bounded_at_every_rate(rough):
    """A position whose acceleration reverses within two periods is quicker at a lower rate."""
    random = np.random.default_rng(4)
    for seed in range(20):
        period = PERIODS[seed % 2]
        values, speeds = walk(seed, 3, period, rough=rough)
        rows = np.zeros((len(values), STATE))
        rows[:, 0], rows[:, 10:13], rows[:, 13:] = 1.0, values, speeds
        before = rows[[0, 0, 0], :4], rows[[0, 0, 0], 10:13]
        peaks = measure(rows, len(rows), period, Limits.partial(), before=before, tolerance=1.0)
        places = random.uniform(0.0, len(values) + 2.0, 20_000)
        rates = random.uniform(size=len(places)) ** 0.25
        velocity, acceleration, _ = seen(values, speeds, period, places, rates)
        for found, peak in (
            (velocity, peaks.linear_velocity),
            (acceleration, peaks.linear_acceleration),
        ):
            assert np.linalg.norm(found, axis=1).max() <= peak.value * (1.0 + 1e-6)


@pytest.mark.parametrize("rough", [False, True])
def test_axes_keep_their_acceleration_at_every_rate_and_change_of_it(rough):
    random, largest = np.random.default_rng(5), 0.0
    for seed in range(30):
        period = PERIODS[seed % 2]
        values, speeds = walk(seed, 3, period, rough=rough)
        free = certified(values, speeds, period, axes_like(3)).axes
        most = [1.1 * one.value for one in free if one.kind is LimitKind.ACCELERATION]
        axes = [AxisLimits(f"axis {k}", -1e9, 1e9, 1e300, bend) for k, bend in enumerate(most)]
        brake = certified(values, speeds, period, axes).brake_rate
        assert brake > 0.0
        # Two cycles at rates of which the change is the largest that the servo may make.
        places = random.uniform(2.0, len(values) - 1.0, 20_000)
        rates = 1.0 - random.uniform(size=len(places)) ** 2
        change = np.minimum(2.0, np.sqrt(8.0 * np.minimum(rates, 1.0 - rates))) * brake * period
        for sign in (-0.5, 0.5):
            before, behind = rates - sign * change, rates + sign * change
            a, b, c = (
                along(values, speeds, period, at)
                for at in (places - before - behind, places - behind, places)
            )
            found = np.abs(c - 2.0 * b + a).max(axis=0) / period**2
            largest = max(largest, float(np.max(found / most)))
    assert 0.95 < largest <= 1.0


ENDS = [(3.1, -1.58), (2.39, 2.61), (-2.9, -2.79), (2.29, 2.33), (-0.22, -1.63)]
"""Accelerations at the beginning and the end of periods of 20 ms, rad/s^2."""


def test_an_axis_that_accelerates_most_at_a_lower_rate_is_braked_for_that():
    """At the full rate, differences average steps at neighbouring records away."""
    period, most = 0.02, 2.88
    begins, ends = np.array([*ENDS, (3.11, -0.86), (0.97, -0.55), (1.4, -0.21), (0.96, -2.57)]).T
    speeds = 32.425 + np.concatenate([[0.0], np.cumsum(0.5 * period * (begins + ends))])
    ways = period * (speeds[:-1] + period * (begins / 3.0 + ends / 6.0))
    rows = np.zeros((10, 6))
    rows[:, 0], rows[:, 3] = np.concatenate([[0.0], np.cumsum(ways)]), speeds
    table = np.full((2, 4), np.inf)
    table[1, 1] = most
    brake = brake_rate_of(rows, period, table, range(1, 2))
    assert brake > 0.02
    middles = np.arange(2.0, 7.0, 0.125)[:, None]
    rates = np.linspace(0.3, 0.99, 70)
    change = np.minimum(2.0, np.sqrt(8.0 * np.minimum(rates, 1.0 - rates)))
    for by in (0.5 * brake * period * change, -0.5 * brake * period * change):
        first, middle, last = (
            along(rows[:, :1], rows[:, 3:4], period, middles + part)
            for part in (by - rates, 0.0 * rates, rates + by)
        )
        assert np.abs(first + last - 2.0 * middle).max() / period**2 <= most


def test_an_axis_that_is_no_number_is_refused_by_its_name():
    values, speeds = walk(1, 4, 0.01, rough=False)
    for broken in (values, speeds):
        kept, broken[30, 1] = broken[30, 1], np.nan
        with pytest.raises(PlanError, match=r"axis 1 is not a number at 0\.3000 s"):
            certified(values, speeds, 0.01, axes_like(4))
        broken[30, 1] = kept
