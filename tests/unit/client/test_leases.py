"""The client's leases: taken when needed, renewed, lost, given back."""

import threading
from types import SimpleNamespace

import pytest

from orientd.client.leases import RENEWALS, Leases
from orientd.errors import DaemonError, LeaseError
from orientd.protocol import control_pb2 as pb


class Daemon:
    """A connection to a daemon that has two devices."""

    def __init__(self, seconds=3600.0):
        self.seconds = seconds
        self.acquired = []
        self.released = []
        self.renewed = threading.Semaphore(0)
        self.failures = []
        self.refusal = LeaseError("it has expired")
        self.stub = SimpleNamespace(
            AcquireLease=self.acquire,
            RenewLease=self.renew,
            ReleaseLease=self.release,
            SeizeLease=self.acquire,
        )

    def ask(self, method, request):
        return method(request)

    def call(self, method, request, *, timeout):
        return method(request)

    def acquire(self, request):
        self.acquired.append(request)
        lease = pb.Lease(
            token=f"t{len(self.acquired)}", seconds=self.seconds, devices=request.devices
        )
        return pb.LeaseResponse(lease=lease)

    def renew(self, request):
        self.renewed.release()
        failure = self.failures.pop(0) if self.failures else None
        if failure is not None:
            raise failure
        return pb.LeaseResponse()

    def release(self, request):
        self.released.append(request.token)
        raise self.refusal


@pytest.fixture
def daemon():
    return Daemon()


@pytest.fixture
def leases(daemon):
    leases = Leases(daemon, holder="ana")
    yield leases
    leases.release()


def quick(daemon, leases):
    daemon.seconds = 0.01
    return leases.needed("arm")


def until_lost(leases):
    """Wait until the lease is known to be lost."""
    for _ in range(10_000):
        if not leases.is_held("arm"):
            return
        threading.Event().wait(0.001)
    raise AssertionError("the lease is still held")


def test_a_lease_is_taken_once_and_when_it_is_needed(daemon, leases):
    assert not leases.is_held("arm")
    assert daemon.acquired == []
    assert leases.needed("arm") == leases.needed("arm") == leases.token("arm") == "t1"
    assert leases.is_held("arm")
    assert not leases.is_held("leg")
    assert leases.needed("leg") == "t2"


def test_the_only_device_needs_no_name(leases):
    assert leases.token() == ""
    leases.acquire(["arm"])
    assert leases.token() == leases.needed("") == "t1"
    leases.acquire(["leg"])
    assert leases.token() == ""


def test_a_seized_lease_goes_before_one_that_was_refused(leases):
    leases.needed("arm")
    leases.seize("in the way", ["arm"])
    assert leases.needed("arm") == "t2"


def test_a_release_whose_stop_has_no_answer_is_an_error(daemon, leases):
    leases.needed("arm")
    leases.needed("leg")
    daemon.refusal = DaemonError("no servo of arm answers the stop")
    with pytest.raises(DaemonError, match="no servo of arm"):
        leases.release()
    assert daemon.released == ["t2", "t1"]
    assert not leases.is_held("arm")


def test_a_lost_lease_is_an_error_once_then_acquired_again(daemon, leases):
    daemon.failures = [LeaseError("it has expired")]
    quick(daemon, leases)
    until_lost(leases)
    with pytest.raises(LeaseError, match="the lease was lost: it has expired"):
        leases.needed("arm")
    assert leases.needed("arm") == "t2"


def test_a_daemon_that_is_slow_now_and_then_does_not_cost_the_lease(daemon, leases):
    daemon.failures = [DaemonError("slow"), None] * RENEWALS
    quick(daemon, leases)
    for _ in range(2 * RENEWALS + 2):
        assert daemon.renewed.acquire(timeout=10.0)
    assert leases.is_held("arm")


def test_a_lease_is_renewed_before_it_expires(daemon, leases):
    daemon.seconds = 1.5
    leases.needed("arm")
    assert daemon.renewed.acquire(timeout=daemon.seconds)


def test_a_released_lease_is_renewed_no_more(daemon, leases):
    quick(daemon, leases)
    leases.release()
    renewals = 0
    while daemon.renewed.acquire(timeout=0.1):
        renewals += 1
        assert renewals < 500


def test_a_daemon_that_is_gone_costs_the_lease(daemon, leases):
    daemon.failures = [DaemonError("gone")] * RENEWALS
    quick(daemon, leases)
    until_lost(leases)
    with pytest.raises(LeaseError, match="gone"):
        leases.token("arm")


def test_who_looks_for_a_lease_does_not_wait_for_the_daemon(daemon, leases):
    asked, answered, acquire = threading.Event(), threading.Event(), daemon.stub.AcquireLease

    def slow(request):
        asked.set()
        answered.wait(10.0)
        return acquire(request)

    daemon.stub.AcquireLease = slow
    taking = threading.Thread(target=leases.needed, args=("arm",))
    taking.start()
    assert asked.wait(10.0)
    looks = []
    looking = threading.Thread(target=lambda: looks.append(leases.is_held("arm")))
    looking.start()
    looking.join(5.0)
    assert looks == [False]
    answered.set()
    taking.join()
    assert leases.is_held("arm")
