"""Single plans of every kind: no false refusal, no limit broken, no turn that nobody asked for."""

import pytest
from bench.single_requests import KINDS, judged_plan, plans

pytestmark = pytest.mark.bench

CASES = 300


@pytest.mark.timeout(900)
@pytest.mark.parametrize("kind", KINDS)
def test_requests_are_planned_wherever_single_moves_are(kind):
    verdicts = [judged_plan(plans(seed, kind)) for seed in range(CASES)]
    refused = [one for one in verdicts if one.refused]
    wrong = {one.case.seed: (one.refused, one.why) for one in refused if one.why}
    wrong |= {one.case.seed: one.faults for one in verdicts if one.faults}
    print(f"\n{kind}: {CASES} requests, {len(refused)} refused, {len(wrong)} wrong")
    assert wrong == {}
