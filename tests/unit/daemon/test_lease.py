"""Leases: one commander for each device, a token for each holder, an end."""

import logging
from functools import partial

import pytest

from emulated_dynamixel import ManualClock
from orientd.daemon.leases import MOST_LEASES, Leases
from orientd.errors import LeaseError, RequestError, TooMuchError

SECOND = 1_000_000_000


def leases_of(devices, clock):
    """Return leases that tell in ``lost`` which of them were lost."""
    lost = []
    leases = Leases(devices, seconds=5.0, clock=clock, lost=lambda *told: lost.append(told))
    leases.lost = lost
    return leases


@pytest.fixture
def clock():
    return ManualClock(123)


@pytest.fixture
def leases(clock):
    return leases_of(["arm"], clock)


def test_a_taken_lease_is_refused_with_holder_and_time_left(leases, clock):
    leases.acquire("ana")
    clock.advance(2 * SECOND)
    with pytest.raises(LeaseError, match=r"^the lease is held by 'ana', for another 3\.0 s"):
        leases.acquire("ben")


def test_a_renewed_lease_lasts_its_full_time_again(leases, clock):
    lease = leases.acquire("ana")
    clock.advance(4 * SECOND)
    assert leases.renew(lease.token).token == lease.token
    clock.advance(4 * SECOND)
    assert leases.check(lease.token).holder == "ana"


def test_an_expired_lease_is_lost_once(leases, clock):
    lease = leases.acquire("ana")
    leases.expire()
    assert leases.lost == []
    clock.advance(5 * SECOND)
    leases.expire()
    leases.expire()
    assert leases.lost == [(lease, ("arm",), "has expired")]
    with pytest.raises(LeaseError, match="has expired"):
        leases.check(lease.token)


def test_a_released_lease_is_free(leases):
    lease = leases.acquire("ana")
    leases.release(lease.token)
    assert leases.held() == []
    assert leases.lost == [(lease, ("arm",), "was released")]
    with pytest.raises(LeaseError, match="was released"):
        leases.check(lease.token)


def test_a_token_is_of_no_use_to_anybody_else(leases):
    lease = leases.acquire("ana", "user:1")
    assert leases.check(lease.token, "arm", "user:1") == lease
    for use in (partial(leases.check, device="arm"), leases.renew, leases.release):
        with pytest.raises(
            LeaseError, match="the lease is held by user:1, its token is of no use to user:2"
        ):
            use(lease.token, owner="user:2")
    assert leases.held() == [lease]


def test_a_lease_is_seized_whoever_holds_it(leases):
    first = leases.seize("chief", "user:0", "a test")
    assert leases.lost == []
    second = leases.seize("other", "user:9", "another")
    assert leases.lost == [(first, ("arm",), "was seized by 'other': another")]
    assert leases.check(second.token).owner == "user:9"
    with pytest.raises(LeaseError, match="held by 'other'"):
        leases.check(first.token)


def test_a_lease_that_ran_out_waits_to_be_collected(leases, clock):
    assert leases.seconds == 5.0
    assert not leases.has_expired
    lease = leases.acquire("ana")
    assert not leases.has_expired
    clock.advance(7 * SECOND)
    assert leases.has_expired
    assert leases.remaining(lease) == 0.0
    leases.expire()
    assert not leases.has_expired


def test_the_log_names_who_takes_and_loses_a_lease(leases, clock, caplog):
    caplog.set_level(logging.INFO)
    leases.release(leases.acquire("root", "user:7", name="eve").token)
    leases.acquire("  ana \n of  the lab ", "user:1")
    leases.seize(" chief ", "user:0", " arm \n in the way ")
    clock.advance(5 * SECOND)
    leases.expire()
    assert caplog.messages == [
        "lease: acquired by eve (user:7)",
        "lease: released by eve (user:7)",
        "lease: acquired by 'ana of the lab'",
        "lease: 'chief' seizes it from 'ana of the lab': arm in the way",
        "lease: that of 'chief' has expired",
    ]


def test_names_and_reasons_are_needed_and_cut_to_200_characters(leases):
    for ask in (partial(leases.acquire, " \n"), partial(leases.seize, "", "user:0", "why")):
        with pytest.raises(RequestError, match="holder: expected a name"):
            ask()
    with pytest.raises(RequestError, match="reason: expected why the lease is seized"):
        leases.seize("chief", "user:0", " ")
    leases.seize("x" * 300, "user:0", "y" * 300)
    after = leases.seize("chief", "user:0", "y" * 300)
    (before, _, what), cut = leases.lost[0], f"{'y' * 197}..."
    assert (before.holder, what) == (f"{'x' * 197}...", f"was seized by {after.who}: {cut}")


def test_who_has_no_token_is_told_to_acquire_one(leases):
    with pytest.raises(LeaseError, match="a command needs the lease"):
        leases.check("")
    with pytest.raises(LeaseError, match="has expired or was released"):
        leases.check("nonsense")


def test_a_lease_of_another_device_is_said_to_be_one(pair):
    ana = pair.acquire("ana", devices=["arm"])
    with pytest.raises(LeaseError, match="the lease covers arm, not leg: acquire that too"):
        pair.check(ana.token, "leg")


def test_a_token_is_of_16_random_bytes(leases):
    assert len(bytes.fromhex(leases.acquire("ana").token)) == 16


@pytest.fixture
def pair(clock):
    return leases_of(["arm", "leg"], clock)


def test_each_device_has_its_commander(pair):
    ana, ben = pair.acquire("ana", devices=["arm"]), pair.acquire("ben", devices=["leg"])
    pair.check(ana.token, "arm")
    pair.check(ben.token, "leg")
    with pytest.raises(LeaseError, match=r"lease of leg is held by 'ben', for another 5\.0 s"):
        pair.check(ana.token, "leg")


def test_several_devices_are_had_all_or_none_in_a_fixed_order(pair):
    ben = pair.acquire("ben", devices=["leg"])
    for devices in (["leg", "arm"], []):
        with pytest.raises(LeaseError, match="lease of leg is held by 'ben'"):
            pair.acquire("ana", devices=devices)
    assert pair.held() == [ben]
    pair.release(ben.token)
    assert pair.acquire("ana", devices=["leg", "arm"]).devices == ("arm", "leg")


def test_programs_of_one_identity_share_a_device_on_purpose_alone(pair):
    first = pair.acquire("ana", "user:1", devices=["arm"])
    with pytest.raises(LeaseError, match="with --lease, this commands beside it"):
        pair.acquire("ana too", "user:1", devices=["arm"])
    second = pair.acquire("ana too", "user:1", devices=["arm"], beside=True)
    assert (second.devices, second.token != first.token) == (("arm",), True)
    pair.release(second.token)
    assert pair.check(first.token, "arm") == first
    third = pair.acquire("ana again", "user:1", devices=["arm"], beside=True)
    pair.release(first.token)
    assert pair.check(third.token, "arm") == third


def test_the_leases_of_one_owner_are_bounded(pair, clock):
    held = [pair.acquire("ana", "user:1", devices=["arm"], beside=True) for _ in range(MOST_LEASES)]
    with pytest.raises(TooMuchError, match="at most 128 leases of one user"):
        pair.acquire("ana", "user:1", devices=["arm"], beside=True)
    assert pair.acquire("ben", "user:2", devices=["leg"])
    pair.release(held[0].token)
    assert pair.acquire("ana", "user:1", devices=["arm"], beside=True)
    clock.advance(6 * SECOND)
    assert pair.acquire("ana", "user:1", beside=True)


def test_nobody_commands_beside_somebody_else(pair):
    pair.acquire("ana", "user:1", devices=["arm"])
    with pytest.raises(
        LeaseError, match=r"held by 'ana' \(user:1\), for another 5\.0 s if not renewed$"
    ):
        pair.acquire("ben", "user:2", beside=True)
    # What is free needs nobody to be beside.
    assert pair.acquire("ben", "user:2", devices=["leg"], beside=True).devices == ("leg",)


def test_of_several_devices_one_is_seized_and_the_others_are_left(pair):
    both = pair.acquire("ana", "user:1")
    after = pair.seize("chief", "user:0", "a test", devices=["leg"])
    assert (pair.lost[0][:2], after.devices) == ((both, ("leg",)), ("leg",))
    pair.check(both.token, "arm")
    with pytest.raises(LeaseError, match="lease of leg is held by 'chief'"):
        pair.check(both.token, "leg")
