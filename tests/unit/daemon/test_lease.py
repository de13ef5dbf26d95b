"""The lease: one holder, a token, an end."""

import pytest

from orientd.clock import ManualClock
from orientd.daemon.leases.lease import LeaseDesk
from orientd.errors import LeaseError

SECOND = 1_000_000_000


@pytest.fixture
def clock():
    return ManualClock(123)


@pytest.fixture
def desk(clock):
    return LeaseDesk(seconds=5.0, clock=clock)


def test_a_free_lease_goes_to_who_asks(desk):
    lease = desk.acquire("ana")
    assert desk.check(lease.token) == lease
    assert desk.current() == lease
    assert desk.remaining(lease) == 5.0


def test_a_taken_lease_is_refused_with_holder_and_time_left(desk, clock):
    desk.acquire("ana")
    clock.advance(2 * SECOND)
    with pytest.raises(LeaseError, match=r"held by 'ana', for another 3\.0 s"):
        desk.acquire("ben")


def test_tokens_differ(desk):
    first = desk.acquire("ana")
    desk.release(first.token)
    assert desk.acquire("ana").token != first.token


def test_a_renewed_lease_lasts_its_full_time_again(desk, clock):
    lease = desk.acquire("ana")
    clock.advance(4 * SECOND)
    assert desk.renew(lease.token).token == lease.token
    clock.advance(4 * SECOND)
    assert desk.check(lease.token).holder == "ana"


def test_an_expired_lease_is_free_and_its_token_worthless(desk, clock):
    lease = desk.acquire("ana")
    clock.advance(5 * SECOND)
    assert desk.current() is None
    for use in (desk.check, desk.renew, desk.release):
        with pytest.raises(LeaseError, match="lease of 'ana' has expired or was released"):
            use(lease.token)
    assert desk.acquire("ben").holder == "ben"


def test_an_expired_lease_is_collected_once(desk, clock):
    lease = desk.acquire("ana")
    assert desk.collect_expired() is None
    clock.advance(5 * SECOND)
    assert desk.collect_expired() == lease
    assert desk.collect_expired() is None
    with pytest.raises(LeaseError, match="has expired"):
        desk.check(lease.token)


def test_a_released_lease_is_free(desk):
    lease = desk.acquire("ana")
    assert desk.release(lease.token) == lease
    assert desk.current() is None
    with pytest.raises(LeaseError, match="was released"):
        desk.check(lease.token)


@pytest.mark.parametrize("token", ["", "nonsense", "é"])
def test_without_the_token_nothing_is_allowed(desk, token):
    with pytest.raises(LeaseError, match="acquire"):
        desk.check(token)
    desk.acquire("ana")
    with pytest.raises(LeaseError):
        desk.check(token)


def test_a_lease_is_somebodys(desk):
    lease = desk.acquire("ana", "user:1")
    assert desk.owner(lease.token) == "user:1"
    assert desk.owner("no such") is None


def test_a_lease_that_is_handed_over_waits_for_its_new_owner_alone(desk, clock):
    lease = desk.acquire("ana", "user:1")
    clock.advance(4 * SECOND)
    before, after = desk.transfer(lease.token, "user:2", "ben")
    assert before == lease
    assert desk.remaining(after) == 5.0
    with pytest.raises(LeaseError, match="held by 'ben'"):
        desk.check(lease.token)
    with pytest.raises(LeaseError, match="held by 'ben'"):
        desk.acquire("ana", "user:1")
    taken = desk.acquire("ben's pendant", "user:2")
    assert (taken.token, taken.holder) == (after.token, "ben's pendant")
    with pytest.raises(LeaseError, match='held by "ben\'s pendant"'):
        desk.acquire("ben again", "user:2")


def test_a_lease_that_is_handed_over_and_not_taken_runs_out(desk, clock):
    _, after = desk.transfer(desk.acquire("ana", "user:1").token, "user:2", "ben")
    clock.advance(5 * SECOND)
    assert desk.collect_expired() == after
    assert desk.acquire("ana", "user:1").owner == "user:1"


def test_a_lease_is_seized_whoever_holds_it(desk):
    before, first = desk.seize("chief", "user:0")
    assert before is None
    held, second = desk.seize("other", "user:9")
    assert held == first
    assert desk.check(second.token).owner == "user:9"
    with pytest.raises(LeaseError, match="held by 'other'"):
        desk.check(first.token)


def test_a_lease_that_ran_out_waits_to_be_collected(desk, clock):
    assert desk.seconds == 5.0
    assert not desk.has_expired
    lease = desk.acquire("ana")
    assert not desk.has_expired
    clock.advance(7 * SECOND)
    assert desk.has_expired
    assert desk.remaining(lease) == 0.0
    desk.collect_expired()
    assert not desk.has_expired


@pytest.mark.parametrize("how", ["handed over", "seized"])
def test_whose_lease_was_taken_is_told_so_once_nobody_holds_it(desk, clock, how):
    lease = desk.acquire("ana", "user:1")
    if how == "seized":
        desk.seize("chief", "user:0")
    else:
        desk.transfer(lease.token, "user:2", "ben")
    clock.advance(5 * SECOND)
    with pytest.raises(LeaseError, match="lease of 'ana' has expired or was released"):
        desk.check(lease.token)


def test_who_has_no_token_is_told_to_acquire_one_and_one_of_nobodys_is_called_so(desk):
    with pytest.raises(LeaseError, match="a command needs the lease"):
        desk.check("")
    with pytest.raises(LeaseError, match="not the token of any lease"):
        desk.check("nonsense")


def test_seizing_what_nobody_holds_leaves_the_lease_before_that_worthless(desk):
    lease = desk.acquire("ana")
    desk.release(lease.token)
    second = desk.seize("chief", "user:0")[1]
    desk.release(second.token)
    with pytest.raises(LeaseError, match="lease of 'chief' has expired or was released"):
        desk.check(second.token)


def test_a_token_is_of_16_random_bytes(desk):
    assert len(bytes.fromhex(desk.acquire("ana").token)) == 16
