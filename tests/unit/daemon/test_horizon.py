"""How far ahead a motion is taken over by one that is yet to be planned."""

import pytest

from orientd.daemon.motions.horizon import ReplanningHorizon

KIND = (8, False)


def learnt(*seconds, kind=KIND):
    horizon = ReplanningHorizon()
    for taken in seconds:
        horizon.add(kind, taken)
    return horizon


def test_it_is_longer_than_what_planning_has_taken():
    assert learnt(*[0.02] * 8).ahead(KIND, 0) > 0.02


def test_it_follows_what_planning_takes_within_a_few_motions():
    quick = learnt(*[0.01] * 8).ahead(KIND, 0)
    slow = learnt(*[0.01] * 8, *[0.03] * 3).ahead(KIND, 0)
    assert slow > 0.03 > quick


def test_a_plan_that_was_held_up_does_not_delay_those_after_it():
    usual = learnt(*[0.01] * 8).ahead(KIND, 0)
    assert learnt(0.5, *[0.01] * 4).ahead(KIND, 0) == usual
    assert learnt(*[0.01] * 6, 0.4, 0.01).ahead(KIND, 0) == usual


def test_plans_of_another_kind_do_not_count():
    horizon = learnt(*[0.2] * 8)
    assert horizon.ahead((8, True), 0) == ReplanningHorizon().ahead(KIND, 0)


def test_each_attempt_that_was_too_late_doubles_it():
    horizon = learnt(0.01)
    assert horizon.ahead(KIND, 3) == pytest.approx(8.0 * horizon.ahead(KIND, 0))


def test_a_motion_that_takes_seconds_to_plan_is_in_time_at_last():
    horizon = learnt(3.0)
    assert horizon.ahead(KIND, 0) < 1.0
    assert max(horizon.ahead(KIND, attempt) for attempt in range(6)) > 3.0
