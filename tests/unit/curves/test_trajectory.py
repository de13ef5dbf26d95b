"""Trajectories: fitted, sampled, cut, turned, joined and pinned."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from orientd.curves.trajectory import FINE, Trajectory
from orientd.rotation import angle, conjugate, exp, log, multiply

KNOTS = np.array([0.5, 1.0, 2.5, 3.0])


def orientations(times):
    """Return a wild but smooth way of turning, with steps of its acceleration at the knots."""
    kinks = 0.2 * np.maximum(times - 1.0, 0.0) ** 2 - 0.3 * np.maximum(times - 2.5, 0.0) ** 2
    r = np.stack([np.sin(2.0 * times), np.cos(times) + kinks, 0.3 * times**2], axis=-1)
    return exp(r)


@pytest.fixture(scope="module")
def fitted():
    return Trajectory.fit(orientations, KNOTS, continuity=1)


@pytest.fixture(scope="module")
def times():
    return np.sort(np.random.default_rng(2).uniform(KNOTS[0], KNOTS[-1], 2000))


def test_it_is_where_the_function_is(fitted, times):
    assert angle(fitted.orientations(times), orientations(times)).max() < FINE


def test_its_velocity_is_the_difference_of_its_orientations(fitted, times):
    h = 1e-5
    inner = times[np.abs(times[:, None] - KNOTS).min(axis=1) > 2 * h]
    before, after = orientations(inner - h), orientations(inner + h)
    omega = log(multiply(conjugate(before), after)) / (2 * h)
    assert np.abs(fitted.sample(inner)[1] - omega).max() < 1e-8


def test_acceleration_and_jerk_are_rates_of_what_is_above_them(fitted, times):
    h = 1e-5
    inner = times[np.abs(times[:, None] - KNOTS).min(axis=1) > 2 * h]
    _, before, first = fitted.sample(inner - h)
    _, after, second = fitted.sample(inner + h)
    assert np.abs(fitted.sample(inner)[2] - (after - before) / (2 * h)).max() < 1e-7
    assert np.abs(fitted.jerk(inner) - (second - first) / (2 * h)).max() < 1e-5


def test_any_order_gives_the_same_bits(fitted, times):
    order = np.random.default_rng(3).permutation(len(times))
    for sorted_part, part in zip(fitted.sample(times), fitted.sample(times[order]), strict=True):
        assert np.abs(sorted_part[order] - part).max() < 1e-13 * max(1.0, np.abs(part).max())


def test_beyond_the_ends_it_is_at_them(fitted):
    q, omega, alpha = fitted.sample(np.array([-9.0, 99.0]))
    for part, end in zip((q, omega, alpha), fitted.ends(), strict=True):
        assert (part == end).all()


def test_what_is_not_a_number_is_refused(fitted):
    with pytest.raises(ValueError, match="times must be numbers, got nan"):
        fitted.sample(np.array([1.0, np.nan]))


def test_backwards_it_turns_the_other_way(fitted, times):
    q, omega, alpha = fitted.sample(times)
    back = fitted.reversed().sample(KNOTS[0] + (KNOTS[-1] - times))
    assert np.abs(back[0] - q).max() < 1e-14
    assert np.abs(back[1] + omega).max() < 1e-11
    assert np.abs(back[2] - alpha).max() < 1e-9


def test_slowed_it_keeps_its_orientations(fitted, times):
    slow = fitted.slowed(2.0 * fitted.duration)
    q, omega, alpha = slow.sample(KNOTS[0] + 2.0 * (times - KNOTS[0]))
    assert np.abs(q - fitted.orientations(times)).max() < 1e-14
    assert np.abs(2.0 * omega - fitted.sample(times)[1]).max() < 1e-11
    assert np.abs(4.0 * alpha - fitted.sample(times)[2]).max() < 1e-9


@pytest.mark.parametrize(("begin", "end"), [(0.5, 3.0), (0.6, 2.9), (1.0, 2.5), (1.2, 1.2001)])
def test_a_part_is_where_it_was(fitted, times, begin, end):
    part = fitted.restricted(begin, end)
    inner = times[(times >= begin) & (times <= end)]
    assert part.domain == (begin, end)
    for one, whole in zip(part.sample(inner), fitted.sample(inner), strict=True):
        assert np.abs(one - whole).max(initial=0.0) < 1e-9


def test_parts_joined_are_the_whole(fitted, times):
    parts = [fitted.restricted(0.5, 1.3).turned_over(), fitted.restricted(1.3, 3.0)]
    whole = Trajectory.joined(parts)
    assert np.abs(whole.orientations(times) + fitted.orientations(times)).max() < 1e-14


def test_a_later_one_is_the_same_later(fitted, times):
    assert np.abs(
        fitted.shifted(8.0).orientations(times + 8.0) - fitted.orientations(times)
    ).max() < (1e-13)


def test_a_piece_whose_ends_are_one_time_later_is_left_out(fitted):
    begin, end = fitted.domain
    last = np.nextafter(end, begin)
    joined = Trajectory.joined([fitted.restricted(begin, last), fitted.restricted(last, end)])
    later = joined.shifted(1e3)
    assert (np.diff(later.breaks) > 0.0).all()
    assert (np.diff(later.knots) > 0.0).all()
    found = later.orientations(later.knots)
    np.testing.assert_allclose(found[-1:], fitted.orientations(np.array([end])), atol=1e-12)


def test_asked_velocities_and_accelerations_are_met_at_the_ends(fitted):
    first = np.array([1.0, -2.0, 0.5]), np.array([0.1, 0.2, 3.0])
    last = np.array([0.3, 0.1, -0.7]), None
    alpha = fitted.ends()[2][1]
    found = fitted.pinned(first, last).ends()
    assert np.abs(found[1] - np.array([first[0], last[0]])).max() < 1e-14
    assert np.abs(found[2][0] - first[1]).max() < 1e-12
    assert angle(found[0], fitted.ends()[0]).max() < 1e-15
    assert np.isfinite(alpha).all()


def test_an_arc_at_constant_velocity_has_no_acceleration():
    turn = Rotation.from_rotvec([0.1, 0.2, 0.2])

    def arc(times):
        found = (Rotation.from_rotvec(np.outer(times, turn.as_rotvec()))).as_quat()
        return found[:, [3, 0, 1, 2]]

    _, omega, alpha = Trajectory.fit(arc, [0.0, 1e-4]).sample(np.linspace(0.0, 1e-4, 50))
    assert np.abs(alpha).max() < 1e-9
    assert np.abs(omega - turn.as_rotvec()).max() < 1e-11


def test_a_jump_is_refused():
    with pytest.raises(ValueError, match="orientations jump near"):
        Trajectory.fit(lambda t: exp(np.outer(t > 0.4, [1.0, 0.0, 0.0])), [0.0, 1.0])
