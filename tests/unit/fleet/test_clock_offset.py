import random

from emulated_dynamixel import ManualClock
from orientd.client.daemon_clock import DRIFT
from orientd_fleet.client import ClockOffset


class Other:
    """A clock that is ahead of ours, at the end of a link that takes its time both ways."""

    def __init__(self, ahead_ns, delays):
        self.ours, self.ahead_ns, self.delays = ManualClock(10**12), ahead_ns, iter(delays)
        self.offset = ClockOffset(self.ask, now_ns=self.ours.now_ns)

    def ask(self, hear):
        there, back = next(self.delays)
        self.ours.advance(there)
        now = self.ours.now_ns() + self.ahead_ns
        self.ours.advance(back)
        hear(now)


def test_the_offset_is_within_its_bound_however_lopsided_the_link_is():
    chance = random.Random(1)
    for _ in range(200):
        ahead = chance.randrange(-(10**15), 10**15)
        delays = [(chance.randrange(10**8), chance.randrange(10**8)) for _ in range(20)]
        found = Other(ahead, delays).offset.measure(20)
        assert abs(found.ns - ahead) <= found.bound_ns


def test_the_shortest_of_many_trips_bounds_it():
    found = Other(5, [(9_000, 1_000), (100, 100), (50_000, 2_000)]).offset.measure(3)
    # Half of the shortest, and what a clock may have drifted by since.
    assert found.bound_ns <= 100 + round((50_000 + 2_000 + 100) * DRIFT)


def test_many_trips_are_nearer_the_truth_than_any_of_them():
    chance = random.Random(4)
    for ahead in (0, 10**12):
        delays = [[round(chance.uniform(15e6, 25e6)) for _ in "ab"] for _ in range(200)]
        found = Other(ahead, delays).offset.measure(200)
        assert abs(found.ns - ahead) < 500_000  # of 5 ms of jitter


def test_what_is_known_becomes_looser_with_time():
    other = Other(5, [(100, 100)])
    before = other.offset.measure(1)
    other.ours.advance(10**9)
    after = other.offset.at(other.ours.now_ns())
    assert after.bound_ns - before.bound_ns == round(10**9 * DRIFT)


def test_a_clock_that_does_not_answer_has_no_offset():
    assert ClockOffset(lambda hear: None).at(0) is None
