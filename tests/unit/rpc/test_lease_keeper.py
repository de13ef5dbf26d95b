"""The client's lease: taken when needed, renewed, lost, given back."""

import threading

import pytest

from orientd.errors import DaemonError, LeaseError
from orientd.rpc import control_pb2 as pb
from orientd.rpc.lease_keeper import RENEWALS, LeaseKeeper


class Desk:
    """What the daemon would answer."""

    def __init__(self, seconds=3600.0):
        self.seconds = seconds
        self.acquired = 0
        self.released = []
        self.renewed = threading.Semaphore(0)
        self.failures = []

    def acquire(self):
        self.acquired += 1
        return pb.Lease(token=f"t{self.acquired}", seconds=self.seconds)

    def renew(self, token):
        self.renewed.release()
        if self.failures:
            raise self.failures.pop(0)
        return pb.Lease(token=token, seconds=self.seconds)

    def release(self, token):
        self.released.append(token)
        raise LeaseError("it has expired")


def keeper_of(leases):
    return LeaseKeeper(acquire=leases.acquire, renew=leases.renew, release=leases.release)


def test_the_lease_is_taken_once_and_when_it_is_needed():
    leases = Desk()
    keeper = keeper_of(leases)
    assert not keeper.is_held
    assert leases.acquired == 0
    assert keeper.token() == keeper.token() == "t1"
    assert keeper.is_held
    keeper.release()


def test_what_was_never_taken_is_not_given_back():
    leases = Desk()
    keeper_of(leases).release()
    assert leases.released == []


def test_the_lease_is_given_back_even_if_the_daemon_knows_better():
    leases = Desk()
    keeper = keeper_of(leases)
    keeper.token()
    keeper.release()
    assert leases.released == ["t1"]
    assert not keeper.is_held


def test_the_lease_is_renewed_in_the_background():
    leases = Desk(seconds=0.01)
    keeper = keeper_of(leases)
    keeper.token()
    for _ in range(5):
        assert leases.renewed.acquire(timeout=10.0)
    keeper.release()


def lost(keeper):
    """Wait until the keeper knows that the lease is lost."""
    for _ in range(10_000):
        if not keeper.is_held:
            return
        threading.Event().wait(0.001)
    raise AssertionError("the lease is still held")


def test_a_lost_lease_is_told_once_then_asked_for_again():
    leases = Desk(seconds=0.01)
    leases.failures = [LeaseError("it has expired")]
    keeper = keeper_of(leases)
    keeper.token()
    lost(keeper)
    with pytest.raises(LeaseError, match="the lease was lost: it has expired"):
        keeper.token()
    assert keeper.token() == "t2"
    keeper.release()


def test_a_daemon_that_is_slow_once_does_not_cost_the_lease():
    leases = Desk(seconds=0.01)
    leases.failures = [DaemonError("slow")]
    keeper = keeper_of(leases)
    keeper.token()
    for _ in range(RENEWALS + 2):
        assert leases.renewed.acquire(timeout=10.0)
    assert keeper.is_held
    keeper.release()


def test_a_daemon_that_is_gone_costs_the_lease():
    leases = Desk(seconds=0.01)
    leases.failures = [DaemonError("gone")] * RENEWALS
    keeper = keeper_of(leases)
    keeper.token()
    lost(keeper)
    with pytest.raises(LeaseError, match="gone"):
        keeper.token()
