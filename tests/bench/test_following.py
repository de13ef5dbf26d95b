"""Motions that follow one another: limits, tolerances and refusals of many requests."""

from itertools import islice

import pytest
from bench.following_judge import judged
from bench.random_requests import blends, chains

pytestmark = pytest.mark.bench

CASES = 300


@pytest.mark.timeout(900)
@pytest.mark.parametrize("requests", [blends, chains])
def test_motions_that_follow_one_another_keep_limits_and_tolerances(requests):
    verdicts = [judged(case) for case in islice(requests(2), CASES)]
    problems = [problem for verdict in verdicts for problem in verdict.problems]
    refusals = sum(bool(v.refused) for v in verdicts)
    blended, corners = sum(v.blended for v in verdicts), sum(v.corners for v in verdicts)
    print(
        f"\n{requests.__name__}: {CASES} requests, {refusals} refused, "
        f"{blended} of {corners} corners blended, {sum(v.joined for v in verdicts)} end velocities "
        f"joined; largest share of a limit {max(v.largest for v in verdicts):.5f}, of a tolerance "
        f"{max(v.farthest for v in verdicts):.3f}"
    )
    assert problems == []
