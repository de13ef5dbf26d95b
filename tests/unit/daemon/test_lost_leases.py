"""A client that loses the lease loses the motions that it started with it, and only those."""

import logging
from functools import partial
from types import SimpleNamespace

import pytest

from orientd.clock import ManualClock
from orientd.daemon.devices import Devices
from orientd.daemon.leases import Leases
from orientd.errors import DeviceError, LeaseError, RequestError

SECOND = 1_000_000_000


class FakeRuns:
    """Motions by the token they were started with, and what has been stopped for which reason."""

    def __init__(self):
        self.tokens, self.halted = {}, []


class FakeDevice:
    """A device that counts how often it was to be let go no longer, and may refuse that."""

    def __init__(self, name, runs):
        self.name, self.runs = name, runs
        self.ends, self.error = 0, None

    def disown(self, token, reason):
        if self.runs.tokens.get(self.name) == token:
            self.runs.halted.append(([self.name], reason))

    def end_free(self):
        self.ends += 1
        if self.error:
            raise self.error


@pytest.fixture
def clock():
    return ManualClock(1)


@pytest.fixture
def runs():
    return FakeRuns()


@pytest.fixture
def devices(runs):
    return {name: FakeDevice(name, runs) for name in ("arm", "leg")}


@pytest.fixture
def leases(clock, runs, devices, caplog):
    caplog.set_level(logging.INFO, "orientd.daemon.leases")
    lost = partial(Devices._disown, SimpleNamespace(by_name=devices))
    return Leases(list(devices), seconds=5.0, clock=clock, lost=lost)


@pytest.fixture
def lease(leases, runs):
    lease = leases.acquire("ana", "user:1")
    runs.tokens = {"arm": lease.token, "leg": "another"}
    return lease


def test_an_acquisition_is_logged_and_stops_nothing(leases, runs, caplog):
    lease = leases.acquire("  ana \n of  the lab ", "user:1")
    assert (lease.holder, lease.owner) == ("ana of the lab", "user:1")
    assert runs.halted == []
    assert caplog.messages == ["lease: acquired by 'ana of the lab'"]


def test_acquiring_an_expired_lease_stops_what_was_under_it(leases, runs, clock, lease, caplog):
    clock.advance(5 * SECOND)
    leases.acquire("ben")
    assert runs.halted == [(["arm"], "the lease of 'ana' has expired")]
    assert caplog.messages[-2:] == ["lease: that of 'ana' has expired", "lease: acquired by 'ben'"]


def test_an_expiry_stops_once_what_was_under_the_lease(leases, runs, clock, lease):
    leases.expire()
    assert runs.halted == []
    clock.advance(5 * SECOND)
    leases.expire()
    leases.expire()
    assert runs.halted == [(["arm"], "the lease of 'ana' has expired")]


def test_an_expiry_alone_ends_what_was_let_go_by_hand(leases, devices, clock, caplog):
    leases.release(leases.acquire("ana", devices=["arm"]).token)
    assert [device.ends for device in devices.values()] == [0, 0]
    leases.acquire("ana", devices=["arm"])
    devices["arm"].error = DeviceError("it is jammed")
    clock.advance(5 * SECOND)
    leases.expire()
    assert [device.ends for device in devices.values()] == [1, 0]
    assert caplog.messages[-1] == "lease: cannot end hand guiding of arm: it is jammed"


def test_a_release_stops_what_was_under_the_lease(leases, runs, lease, caplog):
    with pytest.raises(LeaseError):
        leases.release("another")
    assert runs.halted == []
    leases.release(lease.token)
    assert runs.halted == [(["arm"], "the lease of 'ana' was released")]
    assert caplog.messages[-1] == "lease: released by 'ana'"


def test_what_was_under_a_seized_lease_stops_with_the_reason(leases, runs, lease, caplog):
    after = leases.seize(" chief ", "user:0", " arm \n in the way ")
    assert (after.holder, after.owner) == ("chief", "user:0")
    assert runs.halted == [(["arm"], "the lease of 'ana' was seized by 'chief': arm in the way")]
    assert caplog.messages[-1] == "lease: 'chief' seizes it from 'ana': arm in the way"


def test_a_lease_that_nobody_holds_is_seized_from_nobody(leases, runs, caplog):
    assert leases.seize("chief", "user:0", "testing").holder == "chief"
    assert runs.halted == []
    assert caplog.messages[-1] == "lease: 'chief' seizes it from nobody: testing"


def test_nobody_without_a_name_or_a_reason_gets_the_lease(leases, runs, lease):
    for ask in (
        lambda: leases.acquire(" \n"),
        lambda: leases.seize("", "user:0", "why"),
    ):
        with pytest.raises(RequestError, match="holder: expected a name"):
            ask()
    with pytest.raises(RequestError, match="reason: expected why the lease is seized"):
        leases.seize("chief", "user:0", " ")
    assert runs.halted == []


def test_names_and_reasons_are_cut_to_200_characters(leases, caplog):
    leases.seize("x" * 300, "user:0", "y" * 300)
    assert (
        caplog.messages[-1] == f"lease: {'x' * 197 + '...'!r} seizes it from nobody: {'y' * 197}..."
    )


def test_what_was_checked_of_a_holder_is_what_others_are_told(leases, runs, caplog):
    lease = leases.acquire("root", "user:7", name="eve", devices=["arm"])
    runs.tokens = {"arm": lease.token}
    leases.release(lease.token)
    assert runs.halted == [(["arm"], "the lease of eve (user:7) was released")]
    assert caplog.messages[-1] == "lease: released by eve (user:7)"


def test_a_lease_beside_another_that_is_given_back_stops_what_was_started_with_it_alone(
    leases, runs, lease
):
    second = leases.acquire("ana too", lease.owner, beside=True)
    runs.tokens["leg"] = second.token
    leases.release(second.token)
    assert runs.halted == [(["leg"], "the lease of 'ana too' was released")]
