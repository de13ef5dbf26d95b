"""A small fixed sample of random requests: planned, within the limits, without a turn too many."""

import dataclasses

import pytest
from bench.single_requests import (
    KINDS,
    LIMITS,
    judged_plan,
    plans,
)

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
        *(("duration", seed) for seed in (47, 72, 96, 341)),
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
