"""What can change while the daemon runs is told from what cannot."""

from orientd import config
from orientd.daemon.reload import changes


def settings(**tables):
    return config.parse({"devices": {"arm": {"driver": "loopback"}}, **tables}, source="test")


def test_nothing_differs_from_itself():
    assert changes(settings(), settings()) == ([], [])


def test_roles_rates_metrics_and_the_log_change_on_the_way():
    after = settings(
        access={"users": {"0": "observer"}, "streams": 5},
        daemon={"log_level": "debug"},
        metrics={"port": 0},
    )
    can, cannot = changes(settings(), after)
    assert can == ["access.streams", "access.users.0", "daemon.log_level", "metrics"]
    assert cannot == []


def test_devices_and_addresses_need_a_restart():
    after = settings(
        devices={"arm": {"driver": "loopback", "rate_hz": 100, "limits": {"velocity": 1}}},
        daemon={"lease_seconds": 9},
        tcp={"listen": "a:1", "certificate": "/c", "key": "/k", "ca": "/a"},
    )
    can, cannot = changes(settings(), after)
    assert can == []
    assert cannot == [
        "daemon.lease_seconds",
        "devices.arm.limits.velocity",
        "devices.arm.rate_hz",
        "tcp",
    ]
