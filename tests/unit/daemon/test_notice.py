"""How far ahead a motion is left for one that is yet to be planned."""

import pytest

from orientd.daemon.notice import Notice


def noticed(*seconds):
    notice = Notice()
    for taken in seconds:
        notice.add(taken)
    return notice


def test_notice_is_longer_than_what_planning_has_taken():
    assert noticed(*[0.02] * 8).ahead(0) > 0.02


def test_notice_follows_what_planning_takes_within_a_few_motions():
    quick, slow = noticed(*[0.01] * 8).ahead(0), noticed(*[0.01] * 8, *[0.03] * 3).ahead(0)
    assert slow > 0.03 > quick


def test_a_plan_that_was_held_up_does_not_delay_those_after_it():
    usual = noticed(*[0.01] * 8).ahead(0)
    assert noticed(0.5, *[0.01] * 4).ahead(0) == usual
    assert noticed(*[0.01] * 6, 0.4, 0.01).ahead(0) == usual


def test_each_attempt_that_was_too_late_doubles_it():
    notice = noticed(0.01)
    assert notice.ahead(3) == pytest.approx(8.0 * notice.ahead(0))


def test_a_motion_that_takes_seconds_to_plan_is_in_time_at_last():
    notice = noticed(3.0)
    assert notice.ahead(0) < 1.0
    assert max(notice.ahead(attempt) for attempt in range(6)) > 3.0
