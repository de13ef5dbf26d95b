"""Motions that follow one another, of the requests that the benches draw from."""

from itertools import islice

import pytest
from bench.following_judge import judged
from bench.random_requests import blends, chains


@pytest.mark.parametrize("requests", [blends, chains])
def test_a_sample_keeps_limits_tolerances_and_is_not_refused(requests):
    verdicts = [judged(case) for case in islice(requests(1), 12)]
    assert [verdict.problems for verdict in verdicts] == [[]] * len(verdicts)
    assert sum(verdict.blended + verdict.joined for verdict in verdicts) >= 8


@pytest.mark.parametrize("place", [49, 66, 148])
def test_a_chain_whose_curve_would_swing_out_with_the_device_begins_with_a_connector(place):
    (case,) = islice(chains(2), place, place + 1)
    assert judged(case).problems == []
