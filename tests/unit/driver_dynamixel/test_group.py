"""When a reading is believed: the servos' clocks."""

import pytest

from orientd_dynamixel.group import STALE_MS, ServoClock

MS = 1_000_000


def test_prompt_answers_are_not_behind_however_long_it_goes_on():
    clock = ServoClock()
    for k in range(5000):
        asked_ns, tick = k * 10 * MS, (k * 10) % 32768
        assert abs(clock.behind_ms(asked_ns, tick)) <= 1.0
        clock.learn(asked_ns, tick)


def test_answer_to_a_question_of_earlier_is_behind_by_its_age():
    clock = ServoClock()
    clock.learn(0, 100)
    assert clock.behind_ms(50 * MS, 130) == pytest.approx(19.5)


def test_answer_that_took_long_to_measure_does_not_spoil_the_next_ones():
    clock = ServoClock()
    clock.learn(0, 100)
    clock.learn(10 * MS, 140)  # measured 30 ms after it was asked for
    assert clock.behind_ms(20 * MS, 120) <= 1.0


def test_difference_is_taken_across_the_wrap():
    clock = ServoClock()
    clock.learn(0, 32760)
    assert clock.behind_ms(0, 5) == -13.0
    clock = ServoClock()
    clock.learn(0, 5)
    assert clock.behind_ms(0, 32760) == 13.0


@pytest.mark.parametrize("drift", [-0.005, 0.005])
def test_clock_that_drifts_is_known_again_after_a_long_pause(drift):
    clock = ServoClock()
    clock.learn(0, 0)
    for asked_ns in (15_000 * MS, 15_020 * MS, 15_040 * MS):
        tick = int(asked_ns / MS * (1 + drift))
        assert clock.behind_ms(asked_ns, tick) < STALE_MS
        clock.learn(asked_ns, tick)
    assert clock.behind_ms(15_060 * MS, tick) == pytest.approx(20.0, abs=2.0)
