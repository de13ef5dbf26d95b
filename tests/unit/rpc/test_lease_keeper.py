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


def keeper_of(desk):
    return LeaseKeeper(acquire=desk.acquire, renew=desk.renew, release=desk.release)


def test_the_lease_is_taken_once_and_when_it_is_needed():
    desk = Desk()
    keeper = keeper_of(desk)
    assert not keeper.is_held
    assert desk.acquired == 0
    assert keeper.token() == keeper.token() == "t1"
    assert keeper.is_held
    keeper.release()


def test_what_was_never_taken_is_not_given_back():
    desk = Desk()
    keeper_of(desk).release()
    assert desk.released == []


def test_the_lease_is_given_back_even_if_the_daemon_knows_better():
    desk = Desk()
    keeper = keeper_of(desk)
    keeper.token()
    keeper.release()
    assert desk.released == ["t1"]
    assert not keeper.is_held


def test_the_lease_is_renewed_in_the_background():
    desk = Desk(seconds=0.01)
    keeper = keeper_of(desk)
    keeper.token()
    for _ in range(5):
        assert desk.renewed.acquire(timeout=10.0)
    keeper.release()


def lost(keeper):
    """Wait until the keeper knows that the lease is lost."""
    for _ in range(10_000):
        if not keeper.is_held:
            return
        threading.Event().wait(0.001)
    raise AssertionError("the lease is still held")


def test_a_lost_lease_is_told_once_then_asked_for_again():
    desk = Desk(seconds=0.01)
    desk.failures = [LeaseError("it has expired")]
    keeper = keeper_of(desk)
    keeper.token()
    lost(keeper)
    with pytest.raises(LeaseError, match="the lease was lost: it has expired"):
        keeper.token()
    assert keeper.token() == "t2"
    keeper.release()


def test_a_daemon_that_is_slow_once_does_not_cost_the_lease():
    desk = Desk(seconds=0.01)
    desk.failures = [DaemonError("slow")]
    keeper = keeper_of(desk)
    keeper.token()
    for _ in range(RENEWALS + 2):
        assert desk.renewed.acquire(timeout=10.0)
    assert keeper.is_held
    keeper.release()


def test_a_daemon_that_is_gone_costs_the_lease():
    desk = Desk(seconds=0.01)
    desk.failures = [DaemonError("gone")] * RENEWALS
    keeper = keeper_of(desk)
    keeper.token()
    lost(keeper)
    with pytest.raises(LeaseError, match="gone"):
        keeper.token()
