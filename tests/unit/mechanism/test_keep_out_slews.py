"""Slews of rotators around keep-out cones: never inside, and little more of the pass is lost."""

import math

import numpy as np
import pytest
from gimbals import gimbal_of, orientations
from reference.slew_search import least_loss

from orientd.driver import AxisLimits
from orientd.mechanism.joint_path import ToolLimits
from orientd.mechanism.timed_route import route_at_times
from orientd.rotation import from_axis_angle, multiply, rotate

PERIOD, SPEED = 0.1, 6.0
RANGES = [(0.0, 360.0), (0.0, 450.0), (-180.0, 180.0)]
HEIGHTS = [(0.0, 90.0), (0.0, 180.0)]
X = [1.0, 0.0, 0.0]
ENOUGH = 2
"""Cones tried on each kind of rotator."""


def rotator(azimuth, elevation, speed=SPEED):
    axes = [
        AxisLimits(name, *np.radians([*ends, speed, 60.0]).tolist())
        for name, ends in (("azimuth", azimuth), ("elevation", elevation))
    ]
    mount = (0.0, 1.0, 0.0, 0.0)
    return gimbal_of("ZY", axes=axes, mount=mount, is_pointing=True, allow_slews=True)


def overhead(miss_deg, heading_deg, half=90.0):
    """A pass of 0.8 deg/s that misses the zenith, and its directions north, west and up."""
    times = np.arange(-half, half + PERIOD / 2, PERIOD)
    turn, miss = np.radians(0.8) * times, np.radians(miss_deg)
    azimuth = np.radians(heading_deg) + np.arctan2(np.sin(miss) * np.cos(turn), np.sin(turn))
    elevation = np.arcsin(np.cos(miss) * np.cos(turn))
    return multiply(
        from_axis_angle([0.0, 0.0, 1.0], -azimuth), from_axis_angle([0.0, 1.0, 0.0], -elevation)
    )


def clearances(cones, q):
    points = rotate(q, X)
    cosines = np.clip([points @ direction for direction, _ in cones], -1.0, 1.0)
    return np.min(np.arccos(cosines) - np.array([[half] for _, half in cones]), axis=0)


def routed(gimbal, q, cones=(), joints=(0.0, 0.0), keep_out=()):
    path = np.concatenate([orientations(gimbal, np.tile(joints, (10, 1))), q])
    ends = (10 * PERIOD, (len(path) - 1) * PERIOD)
    keep_out = (lambda at, _: clearances(cones, at),) if cones else keep_out
    tool = ToolLimits(1.5, 8.0, 1500.0)
    return route_at_times(gimbal, PERIOD, path, ends, joints=joints, tool=tool, keep_out=keep_out)


def lost(path):
    return sum(one.end - one.start for one in path.losses)


def cone_at(q, path, random, most_deg):
    """A cone around where the axes point, that the path keeps out of; ``None`` if it cannot."""
    direction = rotate(q, X)
    nearest = float(clearances([(direction, 0.0)], path).min())
    half = min(math.radians(random.uniform(4.0, most_deg)), nearest - 0.01)
    return (direction, half) if half > math.radians(2.0) else None


def passes(turns, heights, seed):
    """Yield rotators, passes and how their axes follow them without cones."""
    random = np.random.default_rng([seed, RANGES.index(turns), HEIGHTS.index(heights)])
    for _ in range(40):
        gimbal = rotator(turns, heights, speed=random.choice([3.0, 6.0, 12.0, 30.0]))
        q = overhead(random.uniform(0.5, 50.0), random.uniform(0.0, 360.0))
        yield gimbal, q, routed(gimbal, q), random


def outside(path, cones, gimbal):
    """Whether the axes keep out of cones, and their limits."""
    speed = np.abs(np.diff(path.joints, axis=0)) / PERIOD
    most = [axis.velocity * 1.001 for axis in gimbal.axes]
    return clearances(cones, path.q).min() >= 0.0 and bool(np.all(speed <= most))


@pytest.mark.parametrize("turns", RANGES, ids=str)
def test_a_slew_of_a_pass_leads_around_a_cone(turns):
    tried = 0
    for gimbal, q, free, random in passes(turns, (0.0, 90.0), 1):
        if tried == ENOUGH:
            break
        if not free.losses:
            continue
        longest = max(free.losses, key=lambda one: one.end - one.start)
        at = round(random.uniform(longest.start, longest.end) / PERIOD)
        cone = cone_at(free.q[at], q, random, 15.0)
        if cone is None:
            continue
        tried += 1
        path = routed(gimbal, q, [cone])
        print(f"lost {lost(free):.2f} s, around the cone {lost(path):.2f} s")
        assert outside(path, [cone], gimbal)
        assert any("around keep-out cones" in note for note in path.notes)
    assert tried == ENOUGH


@pytest.mark.parametrize("heights", HEIGHTS, ids=str)
@pytest.mark.parametrize("turns", RANGES, ids=str)
def test_the_slew_to_the_beginning_of_a_pass_leads_around_a_cone(turns, heights):
    tried = 0
    for gimbal, q, free, random in passes(turns, heights, 2):
        lead = int(np.searchsorted(free.path_times, 10 * PERIOD - 1e-9))
        cone = cone_at(free.q[random.integers(lead)], q, random, 15.0)
        if tried == ENOUGH:
            break
        if cone is None or clearances([cone], free.q[:1])[0] < 0.02:
            continue
        tried += 1
        path = routed(gimbal, q, [cone])
        assert outside(path, [cone], gimbal)
    assert tried == ENOUGH


def test_a_slew_keeps_out_of_cones_that_move():
    gimbal, q = rotator((0.0, 360.0), (0.0, 90.0)), overhead(30.0, 270.0)
    free = routed(gimbal, q)
    (loss,) = free.losses
    here = rotate(free.q[round(0.5 * (loss.start + loss.end) / PERIOD)], X)
    axis = np.array([0.0, 0.0, 1.0])

    def clearance(at, times):
        turned = rotate(from_axis_angle(axis, 7.3e-4 * (times - 0.5 * times[-1])), here)
        return np.arccos(np.clip(np.sum(rotate(at, X) * turned, axis=-1), -1.0, 1.0)) - 0.2

    path = routed(gimbal, q, keep_out=(clearance,))
    assert clearance(path.q, PERIOD * np.arange(len(path.q))).min() >= 0.0


@pytest.mark.slow
@pytest.mark.parametrize(("miss", "heading", "speed"), [(30.0, 270.0, 6.0), (12.0, 300.0, 12.0)])
def test_a_slew_around_a_cone_loses_hardly_more_than_a_fine_search(miss, heading, speed):
    turns, heights = (0.0, 360.0), (0.0, 90.0)
    gimbal, q = rotator(turns, heights, speed), overhead(miss, heading)
    free = routed(gimbal, q)
    longest = max(free.losses, key=lambda one: one.end - one.start)
    cones = [(rotate(free.q[round(0.5 * (longest.start + longest.end) / PERIOD)], X), 0.15)]
    path = routed(gimbal, q, cones)
    least = least_loss(
        PERIOD * np.arange(len(q)), rotate(q, X), turns=np.radians(turns),
        inner=np.radians(heights), velocity=math.radians(speed), tolerance=gimbal.on_target,
        cones=cones, cell=math.radians(0.5),
    )  # fmt: skip
    print(f"lost {lost(path):.2f} s, without the cone {lost(free):.2f} s, at least {least:.2f} s")
    assert clearances(cones, path.q).min() >= 0.0
    assert lost(path) <= 1.05 * least + 2.0 * PERIOD
