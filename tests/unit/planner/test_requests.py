"""A small fixed sample of random requests: planned, within the limits, without a turn too many."""

import dataclasses

import numpy as np
import pytest
from bench.single_requests import (
    KINDS,
    LIMITS,
    PERIOD,
    Case,
    chain,
    faults,
    judged_plan,
    plans,
    ratios,
)

from orientd.planner import DEFAULT_LIMITS, Keyframe, MotionRequest, State, plan

SAMPLE = 15
"""Seeds of each kind of request; every fifth has the same limits."""


@pytest.mark.parametrize("limits", range(len(LIMITS)), ids=list(LIMITS))
def test_a_sample_of_requests_has_no_fault_and_no_false_refusal(limits):
    verdicts = [
        judged_plan(plans(seed, kind))
        for kind in KINDS
        for seed in range(limits, SAMPLE, len(LIMITS))
    ]
    for verdict in verdicts:
        name = f"{verdict.case.kind} {verdict.case.seed}"
        assert verdict.faults == (), name
        assert not verdict.why, f"{name}: {verdict.refused}"
    assert sum(not verdict.refused for verdict in verdicts) >= 0.9 * len(verdicts)


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        *(("times", seed) for seed in (30, 64, 66, 102, 108, 109, 115, 126, 165, 250, 277, 286)),
        *(("duration", seed) for seed in (47, 72, 96)),
    ],
)
def test_what_single_moves_can_do_is_planned_without_a_turn_too_many(kind, seed):
    verdict = judged_plan(plans(seed, kind))
    assert (verdict.refused, verdict.faults) == ("", ())


@pytest.mark.parametrize("factor", [1.0, 1.02, 1.1, 1.5])
def test_two_moving_keyframes_are_planned_for_any_duration_from_the_shortest_on(factor):
    for seed in (8, 28, 72, 96, 165, 286):
        case = dataclasses.replace(plans(seed, "duration"), factor=factor)
        assert len(case.request.keyframes) == 2
        verdict = judged_plan(case)
        assert (verdict.refused, verdict.faults) == ("", ()), seed


def quarter(**fields):
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    request = MotionRequest([Keyframe(rotation_vector=(0.0, 0.0, 0.5 * np.pi), **fields)])
    return plan(request, start=start, limits=DEFAULT_LIMITS, period=PERIOD)


def test_the_judge_finds_a_broken_limit():
    motion = quarter()
    case = Case("", 0, "", motion.request, motion.start_state, DEFAULT_LIMITS)
    assert faults(motion, case) == []
    narrow = Case("", 0, "", motion.request, motion.start_state, DEFAULT_LIMITS.scaled(0.99))
    assert {one.split()[1] for one in faults(motion, narrow)} >= {"velocity", "acceleration"}


def test_the_judge_differentiates_as_a_device_does():
    rate, count = 0.3, 50
    half = 0.5 * rate * PERIOD * np.arange(count)
    q = np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=1)
    found = ratios(q, np.zeros((count, 3)), DEFAULT_LIMITS, PERIOD)
    assert found["velocity"] == pytest.approx(rate / DEFAULT_LIMITS.velocity, rel=1e-9)
    step = rate / PERIOD
    assert found["acceleration"] == pytest.approx(step / DEFAULT_LIMITS.acceleration, rel=1e-6)
    assert found["jerk"] == pytest.approx(step / PERIOD / DEFAULT_LIMITS.jerk, rel=1e-6)


def test_the_judge_finds_a_turn_that_nobody_asked_for():
    keys = [Keyframe((1.0, 0.0, 0.0, 0.0)), Keyframe(rotation_vector=(0.0, 0.0, 0.5), turns=1)]
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    motion = plan(MotionRequest(keys), start=start, limits=DEFAULT_LIMITS, period=PERIOD)
    case = Case("", 0, "", motion.request, start, DEFAULT_LIMITS)
    (fault,) = faults(motion, case)
    assert fault.startswith("turns: 6.28 rad further")


def test_single_moves_are_compared_interval_by_interval():
    case = plans(0, "both ends")
    steps = chain(case)
    assert len(steps) == len(case.request.keyframes) - 1
    assert (steps > 0.0).all()
