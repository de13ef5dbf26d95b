"""An axis that does not follow its command is noticed once that has lasted."""

import pytest

from orientd.driver import FollowCheck

SECOND = 1_000_000_000


@pytest.fixture
def check():
    return FollowCheck("joint elbow", tolerance=0.1, duration=0.3)


def test_an_axis_may_be_far_away_for_a_moment(check):
    for time_ns in range(0, 3 * SECOND, SECOND // 10):
        is_far = time_ns // (SECOND // 10) % 5 < 4
        assert check.problem(0.5 if is_far else -0.1, time_ns) == ""


@pytest.mark.parametrize("gap", [0.2, -0.2])
def test_an_axis_that_stays_away_is_named_with_its_distance(check, gap):
    assert check.problem(gap, 0) == ""
    assert check.problem(gap, round(0.3 * SECOND)) == ""
    assert check.problem(1.5 * gap, round(0.3 * SECOND) + 1) == (
        "joint elbow does not follow: it is 17.2 deg behind for more than 0.3 s; "
        "is it blocked, pushed or overloaded?"
    )


def test_an_axis_may_stay_at_its_tolerance(check):
    assert not any(check.problem(0.1, second * SECOND) for second in range(10))
