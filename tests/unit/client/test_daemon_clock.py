"""A client knows the daemon's clock: exactly on one machine, within a bound from another."""

import random

import pytest

from orientd.client import daemon_clock
from orientd.client.daemon_clock import DRIFT, DaemonClock, Offset, Reading
from orientd.clock import clock_name
from orientd.errors import DaemonError

MS = 1_000_000


class World:
    """A link with delays, and a daemon whose clock is ahead; its time passes with each message."""

    def __init__(self, monkeypatch, ahead_ns, delays, name="another"):
        self.now_ns, self.trips = 5_000_000_000, 0
        self.ahead_ns, self.name, self._delays = ahead_ns, name, delays
        monkeypatch.setattr(daemon_clock, "time", self)

    def monotonic_ns(self):
        return self.now_ns

    def monotonic(self):
        return 1e-9 * self.now_ns

    def ask(self):
        self.trips += 1
        there, back = self._delays()
        self.now_ns += there
        reading = Reading(self.now_ns + self.ahead_ns, self.name)
        self.now_ns += back
        return reading


@pytest.mark.parametrize("ahead_ns", [0, 17 * MS, -3_600_000 * MS, 10**15])
@pytest.mark.parametrize("seed", range(20))
def test_the_offset_is_within_its_bound_of_half_the_shortest_round_trip(
    monkeypatch, ahead_ns, seed
):
    rng, trips = random.Random(seed), []

    def delays():
        trips.append((rng.randrange(1, 40 * MS), rng.randrange(1, 40 * MS)))
        return trips[-1]

    world = World(monkeypatch, ahead_ns, delays)
    offset = DaemonClock(world.ask, is_local=False).offset()
    assert abs(offset.ns - ahead_ns) <= offset.bound_ns
    # A trip is as old as it is long since its middle, and all that follow it.
    halves = [(sum(trip) + 1) // 2 for trip in trips]
    ages = [sum(map(sum, trips[k:])) - sum(trip) // 2 for k, trip in enumerate(trips)]
    assert offset.bound_ns <= min(
        half + round(age * DRIFT) for half, age in zip(halves, ages, strict=True)
    )


def test_the_clock_of_this_machine_is_exact_and_costs_one_question(monkeypatch):
    world = World(monkeypatch, 0, lambda: (MS, 30 * MS), name=clock_name())
    clock = DaemonClock(world.ask, is_local=False)
    assert clock.offset() == Offset(0, 0)
    world.now_ns += 3600 * 1000 * MS
    assert clock.offset() == Offset(0, 0)
    assert world.trips == 1


def test_a_copied_machine_of_the_same_name_has_a_clock_of_its_own(monkeypatch):
    world = World(monkeypatch, 99 * MS, lambda: (MS, MS), name=clock_name())
    offset = DaemonClock(world.ask, is_local=True).offset()
    assert (offset.ns, offset.bound_ns) == (99 * MS, MS + 500)  # the drift of half a trip


@pytest.mark.parametrize("is_local", [True, False])
def test_without_names_only_a_socket_of_this_machine_means_this_clock(monkeypatch, is_local):
    world = World(monkeypatch, 0, lambda: (MS, MS), name="")
    bound_ns = DaemonClock(world.ask, is_local=is_local).offset().bound_ns
    assert bound_ns == (0 if is_local else MS + 500)  # the drift of half a trip


def test_a_measurement_is_repeated_after_a_minute_as_clocks_run_apart(monkeypatch):
    world = World(monkeypatch, 0, lambda: (MS, MS))
    clock = DaemonClock(world.ask, is_local=False)
    clock.offset()
    world.now_ns, world.ahead_ns = world.now_ns + 59_000 * MS, 5 * MS
    assert clock.offset().ns == 0
    world.now_ns += 2_000 * MS
    assert clock.offset().ns == 5 * MS


def test_a_daemon_that_does_not_answer_again_leaves_the_offset_as_it_was(monkeypatch):
    world = World(monkeypatch, 7 * MS, lambda: (MS, MS))
    is_lost = False

    def ask():
        if is_lost:
            raise DaemonError("lost")
        return world.ask()

    clock = DaemonClock(ask, is_local=False)
    known = clock.offset()
    is_lost = True
    world.now_ns += 61_000 * MS
    assert clock.offset() == known
    with pytest.raises(DaemonError, match="lost"):
        DaemonClock(ask, is_local=False).offset()
