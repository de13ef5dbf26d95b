"""Differences of setpoints and of paths, and what they leave for a stop, against plain NumPy."""

import functools

import numpy as np
import pytest
from reference import brake as reference_brake
from reference import differences as reference
from reference.aims import retarget
from reference.differences import certified

from orientd.model.limits import ANGULAR
from orientd.planner import DEFAULT_LIMITS, Keyframe, MotionRequest, State, plan
from orientd.planner.certify.brake import brake_rate
from orientd.planner.certify.measuring import measure
from orientd.rotation import exp, multiply

PERIOD = 0.002
LIMITS = [DEFAULT_LIMITS, DEFAULT_LIMITS.with_rates({"velocity": [2.0, 0.7, 1.5], "jerk": 300.0})]


@pytest.mark.parametrize("past", [0, 1])
@pytest.mark.parametrize("with_axes", [False, True])
def test_the_largest_differences_are_those_of_numpy(past, with_axes):
    rng = np.random.default_rng(past)
    for count in (1, 2, 3, 4, 255, 256, 257, 508, 509, 510, 2000):
        q = exp(np.cumsum(rng.normal(size=(count, 3)), axis=0))
        if count <= 3 * past:
            continue
        found = certified(q, past=past, with_axes=with_axes)
        wanted = reference.extremes(q, past=past, with_axes=with_axes)
        columns = 4 if with_axes else 1
        assert [row[:columns] for row in found.places] == [row[:columns] for row in wanted.places]
        assert np.abs(np.subtract(found.largest, wanted.largest)).max() <= 1e-12


def test_what_is_not_a_number_is_the_largest_difference():
    q = exp(np.linspace(0.0, 1.0, 40)[:, None] * np.ones(3))
    q[20] = np.nan
    assert np.isnan([row[0] for row in certified(q).largest]).all()


@pytest.mark.parametrize("angle", [1e-12, 1e-4, 0.0624, 0.0625, 0.0626, 1.0, 3.0])
def test_differences_are_those_of_turns_of_any_size(angle):
    rng = np.random.default_rng(1)
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    q = multiply(exp(rng.normal(size=3)), exp(angle * np.arange(5)[:, None] * axis))
    q *= rng.choice([-1.0, 1.0], 5)[:, None]
    found = certified(q, with_axes=True)
    sizes = np.sqrt(found.largest[0])
    assert sizes == pytest.approx(angle * np.array([1.0, *np.abs(axis)]), rel=1e-12, abs=1e-15)
    assert np.sqrt(found.largest[1:3]).max() <= 1e-15 + 1e-14 * angle


@pytest.mark.parametrize("limits", [LIMITS[0], LIMITS[1].with_rates({"jerk": [9e3, 5e3, 7e3]})])
@pytest.mark.parametrize("count", [3, 4, 400])
def test_the_brake_rate_of_setpoints_is_that_of_numpy(limits, count):
    times = PERIOD * np.arange(count)
    q = exp(np.stack([np.sin(2.0 * times), 0.5 * np.cos(3.0 * times), 0.1 * times], axis=1))
    options = {"brake_limits": limits, "period": PERIOD}
    wanted, found = (each(q, **options) for each in (reference.extremes, certified))
    assert found.rate == pytest.approx(wanted.rate, rel=1e-9)
    assert found.rate_place == wanted.rate_place


@pytest.mark.parametrize("scale", [0.1, 0.9, 1.0, 1.2])
@pytest.mark.parametrize("count", [0, 1, 500])
@pytest.mark.parametrize("width", [1, 3])
def test_the_brake_rate_is_that_of_numpy(scale, count, width):
    rng = np.random.default_rng(7)
    velocity, acceleration = (
        scale * limit * rng.uniform(-0.55, 0.55, (count, width)) for limit in (1.0, 12.0)
    )
    jerk = scale * 165.0 * rng.uniform(0.0, 1.0, count)
    for limits in ((12.0, 300.0), (12.0, np.inf), (np.inf, 300.0)):
        points = velocity, acceleration, jerk, *limits
        wanted, found = reference_brake.brake_rate(*points), brake_rate(*points)
        assert found[0] == pytest.approx(wanted[0], rel=1e-12)
        # Of several points where nothing is left either may be named.
        assert found[1] == wanted[1] or found[0] == 0.0


@functools.cache
def several_paths(limits):
    """Return motions with leads and without, from rest and taken over."""
    rng = np.random.default_rng(6)
    here = State.at_rest([1.0, 0.0, 0.0, 0.0])
    keys = [tuple(q) for q in exp(0.3 * rng.normal(size=(5, 3))).tolist()]
    times = [0.0, 4.0, 9.0, 13.0, 17.0]
    timed = [Keyframe(q, t) for q, t in zip(keys, times, strict=True)]
    velocities = {"start_velocity": (0.2, 0.0, -0.1), "end_velocity": (0.0, 0.3, 0.0)}
    motions = []
    for keyframes, method, options in (
        ([Keyframe(keys[0])], "c2_cumulative", {}),
        ([Keyframe(keys[0])], "c2_cumulative", {"end_velocity": (0.0, 0.3, 0.0)}),
        ([Keyframe(q) for q in keys], "c2_cumulative", {}),
        (timed, "c2_cumulative", velocities),
        (timed, "kks_hermite_spline", velocities),
        (timed, "kks_hermite_spline", {}),
    ):
        request = MotionRequest(
            keyframes,
            method=method,
            approach=True,
            pace=None if keyframes is timed else "even",
            **options,
        )
        away = retarget(keys[1], start=here, limits=limits, period=PERIOD, pace="even")
        for start in (here, away):
            state = start if start is here else start.state_at(start.record_count // 2)
            motions.append(plan(request, start=state, limits=limits, period=PERIOD))
    return motions


def value_at(path, name, time):
    """Return the size of a backward difference of a path that was held before."""
    times = np.arange(round(time / PERIOD) - 3, round(time / PERIOD) + 1) * PERIOD
    rate = reference.differences(path.sample(np.maximum(times, 0.0)).q)[ANGULAR.index(name)][-1]
    return np.linalg.norm(rate) / PERIOD ** (1 + ANGULAR.index(name))


def sampled(path, count, limits, before):
    """Return what :func:`measure` does, at the records and three phases, by name: in NumPy."""
    at = path.sample(PERIOD * np.arange(count))
    rows = np.concatenate(at[:3], axis=1)
    # A device that stays has no rates.
    held = np.concatenate([rows[-1:, :4], np.zeros((1, 6))], axis=1).repeat(3, axis=0)
    rows, places = np.concatenate([rows, held]), np.concatenate([at.position, at.position[-1:]])
    if before is not None:
        past = np.concatenate([before[0], np.zeros((3, 6))], axis=1)
        rows, places = np.concatenate([past, rows]), np.concatenate([before[1], places])
    options = {"past": int(before is not None), "period": PERIOD, "brake_limits": limits}
    found = reference.extremes(rows, with_axes=limits.has_axes, **options)
    peaks = {name: np.sqrt([found.largest[k][0], found.largest[3 + k][0]]) / PERIOD ** (1 + k)
             for k, name in enumerate(ANGULAR)}  # fmt: skip
    steps = np.diff(places, axis=0)[2 if before is not None else 0 :]
    return peaks, np.linalg.norm(steps, axis=1).max() / PERIOD, found.rate


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("with_each", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_path_is_held_against_its_limits_as_numpy_does(limits, with_each):
    for number, motion in enumerate(several_paths(limits), LIMITS.index(limits)):
        path, count = motion.path, motion.record_count
        q = path.sample(np.zeros(3)).q
        befores = [None, (q, np.zeros((3, 3))), (q, np.full((3, 3), 0.1))]
        for before in befores if with_each else [befores[number % 3]]:
            found = measure(path, count, PERIOD, limits, before=before, tolerance=1.0)
            peaks, speed, rate = sampled(path, count, limits, before)
            assert found.brake_rate <= rate * (1.0 + 1e-4)
            assert found.linear_velocity.value == pytest.approx(speed)
            if not speed:
                assert found.brake_rate == pytest.approx(rate, rel=1e-4)
            for name in ANGULAR:
                one, (value, on_records) = getattr(found, name), peaks[name]
                # The bound is above what a few phases show, by more where there are steps; where
                # the path does not go on from what was before, it is beyond all limits.
                assert value * (1.0 - 1e-3) <= one.value
                assert one.value <= value * 1.03 or one.on_records > 1.1 * one.limit
                assert one.on_records == pytest.approx(on_records, rel=1e-6)
                # Of several that are as large either may be named; between a record and the next
                # it may be somewhat larger than on both.
                values = [value_at(path, name, one.time + k * PERIOD) for k in (0, 1)]
                assert 0.5 * one.value <= max(values) <= one.value * (1.0 + 1e-6)
