"""Room for connections: by identity, by address, and of all together, with some kept."""

import pytest

from orientd.config import AccessSettings, Role
from orientd.daemon.access import peer_credentials
from orientd.daemon.access.identity import Identity, RolePolicy
from orientd.daemon.access.peer_credentials import PeerListener

ANA = Identity("user:1", "ana", Role.OPERATOR)
MOST = 16


@pytest.fixture
def door(monkeypatch):
    monkeypatch.setattr(peer_credentials, "most_together", lambda: MOST)
    return PeerListener(
        RolePolicy(AccessSettings()), "", most_connections=5, refused=lambda *_: None
    )


@pytest.mark.parametrize(
    ("of", "told"), [("user:1", "ana has 5"), ("tcp, 10.0.0.7", "10.0.0.7 has 5")]
)
def test_neither_an_identity_nor_an_address_has_more_than_its_share(door, of, told):
    counted = {"tcp, 10.0.0.7", "user:1", "all"}
    door._counts.update({of: 5, "all": 5})
    assert told in door._why_full(ANA, counted)
    door._counts[of] -= 1
    assert door._why_full(ANA, counted) == ""


def test_processes_of_several_users_share_no_address(door):
    door._counts.update({"unix": 10, "all": 10})
    assert door._why_full(ANA, {"unix", "user:1", "all"}) == ""


def test_some_room_is_kept_for_whoever_commands(door):
    door._counts.update({"user:2": MOST - 2, "all": MOST - 2})
    assert "kept for commanders" in door._why_full(ANA, {"unix", "user:1", "all"})
    door.has_lease = lambda key: key == "user:1"
    assert door._why_full(ANA, {"unix", "user:1", "all"}) == ""
    door._counts["all"] = MOST
    assert "already" in door._why_full(ANA, {"unix", "user:1", "all"})
