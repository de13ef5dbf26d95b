"""Where satellites are seen, against an independent computation."""

import math

import numpy as np
import pytest

from orientd_rotctld.ephemeris import from_table
from orientd_rotctld.sky import find_pass, from_elements

ELEMENTS = """0 VANGUARD 1
1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753
2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667
"""
"""The first case of "Revisiting Spacetrack Report #3" (Vallado et al. 2006)."""


def test_a_satellite_is_seen_where_its_place_in_space_says(tmp_path):
    """Vallado's TEME position 360 minutes after the epoch, turned by hand into a direction."""
    pytest.importorskip("sgp4")
    file = tmp_path / "one.tle"
    file.write_text(ELEMENTS)
    (target,) = from_elements(file, (0.0, 0.0, 0.0))
    assert target.name == "VANGUARD 1"
    days = 179.78495062 + 360.0 / 1440.0
    since_1970 = (10957.0 + days - 1.0) * 86400.0
    place = np.array([-7154.03120202, -3783.17682504, -3536.19412294])  # km, of that report
    julian = 2451544.5 + days - 1.0
    # The Earth Rotation Angle, and the precession of the equinox since 2000 in right ascension.
    angle = 2.0 * math.pi * (0.7790572732640 + 1.00273781191135448 * (julian - 2451545.0))
    angle += math.radians((0.014506 + 4612.156534 * (julian - 2451545.0) / 36525.0) / 3600.0)
    x = place[0] * math.cos(angle) + place[1] * math.sin(angle)
    y = place[1] * math.cos(angle) - place[0] * math.sin(angle)
    seen = np.array([place[2], -y, x - 6378.137])  # from 0 north, 0 east: north, west, up
    (found,) = target.at(np.array([since_1970]))
    assert found == pytest.approx(seen / np.linalg.norm(seen), abs=2e-5)


def great_circle(since, rate):
    """Return unit vectors of a target that rises due east at time 0; *rate* in degrees a second."""
    along, aside = np.radians(rate) * np.asarray(since), math.radians(20.0)
    x, up = np.sin(along) * math.sin(aside), np.sin(along) * math.cos(aside)
    return np.stack([x, -np.cos(along), up], axis=-1)


def table_of(folder, times, points):
    """Return the target of a table of unit vectors."""
    x, y, z = points.T
    azimuth, elevation = np.degrees(np.arctan2(-y, x)) % 360.0, np.degrees(np.arcsin(z))
    rows = "".join(
        f"{t:.6f},{a:.6f},{e:.6f}\n" for t, a, e in zip(times, azimuth, elevation, strict=True)
    )
    (folder / "pass.csv").write_text(f"time,azimuth,elevation\n{rows}")
    return [from_table(folder / "pass.csv").target]


NOW = 1.8e9


def quick_pass(folder, rise, rate):
    """Return the table of a pass that rises a time after ``NOW``, from 5 degrees below."""
    since = np.arange(-5.0, 185.0, 2.0) / rate
    return table_of(folder, NOW + rise + since, great_circle(since, rate))


@pytest.mark.parametrize("rate", [5.0, 12.0, 20.0, 33.0, 45.0])
@pytest.mark.parametrize("mask", [0.0, 10.0])
def test_a_pass_is_found_at_every_phase_of_the_clock(tmp_path, rate, mask):
    """A program waits at the rise, or where the target crosses the mask of the program."""
    crossing = math.degrees(math.asin(math.sin(math.radians(mask)) / math.cos(math.radians(20.0))))
    position = great_circle(crossing / rate, rate)
    for phase in np.linspace(0.0, 5.0, 40, endpoint=False):
        found = find_pass(quick_pass(tmp_path, 30.0 + phase, rate), NOW, position)
        rise = NOW + 30.0 + phase
        assert found is not None
        assert found.start == pytest.approx(rise + crossing / rate, abs=0.005)
        assert found.end == pytest.approx(rise + 180.0 / rate, abs=0.005)
        assert math.dist(found.point(NOW), position) < math.radians(0.2)


@pytest.mark.parametrize("rate", [5.0, 20.0, 45.0])
@pytest.mark.parametrize("ahead", [-0.3, 0.0, 1.0, 4.9])
def test_a_position_on_the_path_of_the_next_seconds_means_the_pass(tmp_path, rate, ahead):
    """At every phase: a program sends where the target will be, or was a moment ago."""
    for phase in np.linspace(0.0, 1.0, 8, endpoint=False):
        since = 0.35 + phase
        targets = quick_pass(tmp_path, -since, rate)
        if (since + ahead) * rate < 180.0:
            found = find_pass(targets, NOW, great_circle(since + ahead, rate))
            assert found is not None
            assert found.start == NOW


def test_a_position_on_the_path_of_a_later_time_means_no_pass(tmp_path):
    """Where a target is in half a minute a program does not wait for it, unless at a mask."""
    targets = quick_pass(tmp_path, -10.0, 1.0)
    assert find_pass(targets, NOW, great_circle(50.0, 1.0)) is None
    assert find_pass(targets, NOW, great_circle(25.0, 1.0)) is not None


def test_the_next_rise_of_a_target_that_is_up_can_be_asked_for(tmp_path):
    """A target of two passes a minute."""
    since = np.arange(-1.0, 119.0, 0.2)
    targets = table_of(tmp_path, NOW + since, great_circle(since, 6.0))
    following = find_pass(targets, NOW + 10.0, great_circle(0.0, 6.0))
    assert following is not None
    assert following.start == pytest.approx(NOW + 60.0, abs=0.005)
    assert following.end == pytest.approx(NOW + 90.0, abs=0.005)


def test_two_passes_of_a_table_are_two(tmp_path):
    """A file with rows above the horizon alone: the target is nowhere between its passes."""
    since = np.arange(0.05, 30.0, 0.5)
    times = np.concatenate([NOW + 60.0 + since, NOW + 125.0 + since])
    targets = table_of(tmp_path, times, np.tile(great_circle(since, 6.0), (2, 1)))
    rise = great_circle(0.0, 6.0)
    first, second = find_pass(targets, NOW, rise), find_pass(targets, NOW + 100.0, rise)
    assert first is not None
    assert second is not None
    assert (first.start - NOW, first.end - NOW) == pytest.approx((60.05, 89.55), abs=0.01)
    assert (second.start - NOW, second.end - NOW) == pytest.approx((125.05, 154.55), abs=0.01)
    (target,) = targets
    places = target.at(np.array([times[0], times[59], times[59] + 1.0, times[60] - 1.0, times[60]]))
    assert np.isnan(places).any(axis=1).tolist() == [False, False, True, True, False]


@pytest.mark.parametrize("late", [-0.4, 0.0, 4.0])
def test_a_quick_pass_is_still_meant_by_a_position_that_comes_early_or_late(tmp_path, late):
    found = find_pass(quick_pass(tmp_path, 30.0, 20.0), NOW, great_circle(0.0, 20.0))
    assert found is not None
    assert found.is_meant(NOW + 20.0, great_circle(0.0, 20.0))
    assert found.is_meant(NOW + 33.0, great_circle(3.0 + late, 20.0))
    assert not found.is_meant(NOW + 33.0, great_circle(0.0, 20.0))


def test_of_two_targets_at_a_position_the_one_that_is_there_now_is_meant(tmp_path):
    """A second one passes there three seconds later."""
    (first,) = quick_pass(tmp_path, -10.0, 2.0)
    (second,) = quick_pass(tmp_path, -7.0, 2.0)
    for targets in ([first, second], [second, first]):
        found = find_pass(targets, NOW, great_circle(10.0, 2.0))
        assert found is not None
        assert found.target is first


def low_orbit(since, top):
    """Return unit vectors of a target 500 km high that culminates at *top* degrees at time 0.

    The earth is a sphere that does not turn, and the orbit a circle.
    """
    earth, orbit = 6378.0, 6878.0
    rate, elevation = math.sqrt(398600.4 / orbit**3), math.radians(top)
    aside = math.acos(earth / orbit * math.cos(elevation)) - elevation
    along = rate * np.asarray(since)
    up = orbit * math.cos(aside) * np.cos(along) - earth
    north = orbit * math.sin(aside) * np.cos(along)
    away = np.stack([north, -orbit * np.sin(along), up], axis=-1)
    return away / np.linalg.norm(away, axis=-1, keepdims=True)


@pytest.mark.parametrize(("step", "most"), [(1.0, 1e-3), (10.0, 1e-3), (30.0, 0.1)])
@pytest.mark.parametrize("top", [30.0, 60.0, 85.0])
@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_a_target_stays_on_its_path_between_coarse_rows(tmp_path, step, most, top, jitter):
    since = np.arange(-400.0, 400.0, step) + 0.3 * step
    since += jitter * step * np.random.default_rng(1).uniform(-1.0, 1.0, len(since))
    (target,) = table_of(tmp_path, NOW + since, low_orbit(since, top))
    fine = np.linspace(since[0], since[-1], 2000)[1:-1]
    apart = np.linalg.norm(target.at(NOW + fine) - low_orbit(fine, top), axis=1)
    assert math.degrees(apart.max()) < most * (1.0 + 3.0 * (jitter > 0.0))


def test_nothing_is_known_of_a_target_before_and_after_its_table(tmp_path):
    since = np.arange(0.0, 100.0, 10.0)
    (target,) = table_of(tmp_path, NOW + since, low_orbit(since, 60.0))
    places = target.at(NOW + np.array([-0.01, 0.0, 90.0, 90.01]))
    assert np.isnan(places).any(axis=1).tolist() == [True, False, False, True]
