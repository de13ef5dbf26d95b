"""Every family put to one task, and what is measured of it."""

import json
from inspect import signature
from pathlib import Path

import numpy as np
import pytest

from orientd.curves import METHODS
from orientd.curves.comparison import COLUMNS, compare, measure, ranked
from orientd.curves.roles import CurveTask, averaged_knots, make_curve, parameters
from orientd.rotation import angle, exp, multiply

GOLDEN = sorted((Path(__file__).parents[2] / "data/golden").glob("*.json"))
ONE = np.array([1.0, 0.0, 0.0, 0.0])
QUARTER = exp(np.array([0.0, 0.0, 0.5 * np.pi]))
QUICK = ("piecewise_slerp", "c2_cumulative", "squad", "kks_bspline", "kks_hermite_spline", "slerp")


def walk(count, *, seed=0, step=1.0, **more):
    rng = np.random.default_rng(seed)
    keys = [ONE]
    for axis in rng.normal(size=(count - 1, 3)):
        keys.append(multiply(keys[-1], exp(step * axis / np.linalg.norm(axis))))
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, count - 1))])
    return CurveTask(np.array(keys), times, **more)


def some(task, **settings):
    families = {name: METHODS[name] for name in QUICK}
    return compare(task, families=families, **settings)


def by_name(candidates):
    return {candidate.name: candidate for candidate in candidates}


def whole(curve):
    """The task of being where the curve is at both ends."""
    ends = np.array(curve.domain)
    return CurveTask(curve.evaluate(ends)[0], ends)


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_effort_is_that_of_the_reference_curves(path):
    case = json.loads(path.read_text())
    if case["family"] in ("spherical_quadratic", "nielson_shieh") and not case["params"].get("M1"):
        pytest.skip("ends a search")
    curve = METHODS[case["family"]](**case["params"])
    effort = measure(curve, whole(curve)).effort
    assert effort == pytest.approx(case["energy"], rel=1e-6, abs=1e-12)


def test_a_turn_at_constant_rate_has_no_effort_and_the_length_of_its_angle():
    task = CurveTask(np.array([ONE, QUARTER]), np.array([0.0, 2.0]))
    figures = measure(make_curve(METHODS["slerp"], task), task)
    assert figures.effort == pytest.approx(0.0, abs=1e-20)
    assert figures.path_length == pytest.approx(0.5 * np.pi, rel=1e-12)
    assert figures.peak_velocity == pytest.approx(0.25 * np.pi, rel=1e-12)


def test_torque_about_a_principal_axis_is_its_moment_times_the_acceleration():
    task = CurveTask(
        np.array([ONE, QUARTER]),
        np.array([0.0, 2.0]),
        omega_start=np.zeros(3),
        omega_end=np.zeros(3),
    )
    curve = make_curve(METHODS["kks_hermite"], task)
    figures = measure(curve, task, inertia=np.array([5.0, 7.0, 3.0]))
    assert figures.torque_effort == pytest.approx(9.0 * figures.effort, rel=1e-12)
    # The cubic from rest to rest accelerates by 6 angle / duration^2 at its ends.
    assert figures.peak_acceleration == pytest.approx(6.0 * 0.5 * np.pi / 4.0, rel=1e-12)
    assert figures.effort == pytest.approx(12.0 * (0.5 * np.pi) ** 2 / 2.0**3, rel=1e-9)


def test_torque_counts_the_gyroscopic_part():
    spin = np.array([1.0, 2.0, 3.0])
    task = CurveTask(np.array([ONE, exp(spin)]), np.array([0.0, 1.0]))
    moments = np.array([1.0, 2.0, 4.0])
    curve = make_curve(METHODS["slerp"], task, {"path": "as_is"})
    omega = curve.evaluate(np.array([0.5]))[1][0]
    torque = np.cross(omega, moments * omega)
    figures = measure(curve, task, inertia=moments)
    assert figures.torque_effort == pytest.approx(float(torque @ torque), rel=1e-9)


def test_jumps_are_measured_at_the_knots():
    task = walk(6)
    found = by_name(some(task))
    slerps = found["piecewise_slerp"].figures
    omega = found["piecewise_slerp"].curve.evaluate(task.times[:-1])[1]
    assert slerps.velocity_jump == pytest.approx(
        np.linalg.norm(np.diff(omega, axis=0), axis=1).max(), rel=1e-9
    )
    assert slerps.has_velocity_jumps
    assert not found["c2_cumulative"].figures.has_velocity_jumps
    assert found["c2_cumulative"].figures.acceleration_jump < 1e-9
    assert found["squad"].figures.acceleration_jump > 1e-3


def test_velocities_at_the_ends_go_to_those_who_can_meet_them():
    task = walk(5, omega_start=np.array([0.0, 1.0, 0.0]), omega_end=np.array([0.5, 0.0, 0.0]))
    found = by_name(some(task))
    assert found["c2_cumulative"].figures.meets_ends
    assert found["kks_hermite_spline"].figures.meets_ends
    assert found["squad"].figures.end_velocity_error > 1e-3


def test_no_velocity_wanted_is_no_error():
    assert by_name(some(walk(4)))["squad"].figures.end_velocity_error is None


def test_what_does_not_apply_says_why():
    found = by_name(some(walk(4)))
    assert found["slerp"].curve is None
    assert found["slerp"].why_not == "takes exactly 2 keyframes, got 4"


def test_whole_turns_are_for_those_who_can_make_them():
    task = walk(4, turns=np.array([1, 0, -1]))
    found = by_name(some(task))
    assert "whole turns" in found["squad"].why_not
    plain = by_name(some(walk(4)))["c2_cumulative"].figures.path_length
    assert found["c2_cumulative"].figures.path_length > plain + 2.0 * np.pi


def test_a_curve_that_has_its_own_clock_is_put_on_the_clock_of_the_task():
    task = walk(5)
    even = CurveTask(task.keys, 3.0 + 0.25 * np.arange(5.0))
    curve = make_curve(METHODS["kks_uniform"], even)
    assert curve.domain == (3.0, 4.0)
    own = METHODS["kks_uniform"](control=task.keys)
    times = np.linspace(3.0, 4.0, 41)
    q, omega, alpha = own.evaluate(4.0 * (times - 3.0))
    for ours, theirs in zip(curve.evaluate(times), (q, 4.0 * omega, 16.0 * alpha), strict=True):
        assert np.abs(ours - theirs).max() < 1e-9


def test_unequal_intervals_are_not_for_a_curve_without_times():
    with pytest.raises(ValueError, match="equal intervals"):
        parameters(METHODS["kks_uniform"], walk(5))


def test_knots_are_averages_between_clamped_ends():
    knots = averaged_knots(np.array([0.0, 1.0, 3.0, 4.0, 8.0]), 4)
    assert knots.tolist() == [0.0] * 4 + [8.0 / 3.0] + [8.0] * 4


def test_the_whole_task_comes_before_half_of_it():
    task = walk(5, omega_start=np.zeros(3), omega_end=np.zeros(3))
    names = [candidate.name for candidate in ranked(some(task))]
    assert set(names[:2]) == {"c2_cumulative", "kks_hermite_spline"}
    assert names[2:] == ["squad", "piecewise_slerp", "kks_bspline", "slerp"]


@pytest.mark.parametrize("column", COLUMNS)
def test_columns_sort_smallest_first_among_equals(column):
    candidates = ranked(some(walk(5), inertia=np.ones(3)), column)
    met = [
        candidate
        for candidate in candidates
        if candidate.figures is not None
        and candidate.figures.interpolates
        and not candidate.figures.has_velocity_jumps
    ]
    values = [COLUMNS[column](candidate, candidate.figures) for candidate in met]
    assert values == sorted(values)


def test_an_unknown_column_is_refused():
    with pytest.raises(ValueError, match="column must be one of name, effort"):
        ranked([], "beauty")


def test_time_is_told_by_the_timer_handed_in():
    ticks = iter(range(10_000))
    found = by_name(some(walk(4), timer=lambda: float(next(ticks))))
    assert found["squad"].build_time == 1.0
    assert found["squad"].sample_time == pytest.approx(1e-3)


def test_a_family_of_a_known_kind_needs_no_line_of_its_own():
    class Own(METHODS["squad"]):
        name = "own"

    found = compare(walk(4), families={"own": Own})
    assert found[0].figures.interpolates


@pytest.mark.parametrize("name", METHODS)
def test_every_family_has_a_task_it_can_do(name):
    family = METHODS[name]
    takes_two = {"q0", "q1"} <= set(signature(family).parameters)
    task = CurveTask(walk(2 if takes_two else 5).keys, np.arange(2.0 if takes_two else 5.0))
    curve = make_curve(family, task)
    assert curve.domain == (task.times[0], task.times[-1])
    if family.interpolates:
        assert angle(curve.evaluate(task.times)[0], task.keys).max() < 1e-9


def test_the_length_is_found_where_a_curve_turns_back():
    turns = np.array([[0.0, 0, 0], [0, 0, 1.0], [0, 0.01, 0.2], [0, 0, 1.4], [0, 0.01, 0]])
    task = CurveTask(exp(turns), np.arange(5.0))
    curve = make_curve(METHODS["c2_cumulative"], task)
    times = np.linspace(0.0, 4.0, 400_001)
    rates = np.linalg.norm(curve.evaluate(times)[1], axis=1)
    # The trapezoidal rule's error is a hundredth of what is asked for here.
    length = float(np.sum(0.5 * (rates[1:] + rates[:-1]) * np.diff(times)))
    assert measure(curve, task).path_length == pytest.approx(length, rel=1e-6)
