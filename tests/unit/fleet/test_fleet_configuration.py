import json
from pathlib import Path

import pytest

from orientd import config
from orientd.errors import ConfigError, RequestError
from orientd_fleet.access import (
    address_of,
    member_configuration,
    router_configuration,
    session_configuration,
)
from orientd_fleet.gateway import _fingerprint
from orientd_fleet.settings import MemberSettings
from orientd_fleet.together import read_plan

SOCKET = Path("/run/control.sock")

FLEET = {"cell": "line", "name": "arm", "certificate": "/c", "key": "/k", "ca": "/a"}
TCP = {"listen": "10.0.0.5:7450", "certificate": "/c", "key": "/k", "ca": "/a"}
DEVICES = {"arm": {"driver": "loopback"}}


def settings(*, callers=(), tcp=TCP, **fleet):
    return config.parse_as(
        MemberSettings,
        {
            "fleet": {**FLEET, "connect": ["tls/host:7447"], **fleet},
            **({"tcp": tcp} if tcp else {}),
            "access": {"certificates": dict.fromkeys(callers, "observer")},
            "devices": DEVICES,
        },
        source="test",
    )


def access_of(given):
    """Return the rules of each subject, and what Zenoh does with all others."""
    control = member_configuration(given)["access_control"]
    assert control["enabled"]
    rules = {rule["id"]: rule for rule in control["rules"]}
    assert {rule["permission"] for rule in rules.values()} == {"allow"}
    names = {one["id"]: one["cert_common_names"] for one in control["subjects"]}
    found = {}
    for policy in control["policies"]:
        for name in (name for subject in policy["subjects"] for name in names[subject]):
            found.setdefault(name, []).extend(rules[one] for one in policy["rules"])
    return found, control["default_permission"]


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"cell": "line", "name": "a"}, "expected an endpoint"),
        ({"cell": "line", "name": "a", "listen": ["tcp/0.0.0.0:7447"]}, "expected tls/HOST:PORT"),
        ({"cell": "line", "name": "a", "listen": ["unixsock-stream/x"]}, "unixsock-stream//PATH"),
        ({"cell": "line", "name": "a", "connect": ["tls/h:70000"]}, "fleet.connect.0"),
        (
            {"cell": "l", "name": "a", "listen": ["tls/h:1", "unixsock-stream//run/x"]},
            "TLS everywhere",
        ),
        ({"cell": "line/2", "name": "a", "listen": ["tls/h:1"]}, "fleet.cell"),
        ({"cell": "line", "name": "a", "listen": ["tls/h:1"], "cells": 1}, "fleet.cells"),
    ],
)
def test_settings_that_open_the_daemon_to_others_are_refused(table, words):
    with pytest.raises(ConfigError, match=words.replace("/", ".")):
        config.parse_as(MemberSettings, {"fleet": table, "devices": DEVICES}, source="test")


def test_tls_needs_a_certificate():
    with pytest.raises(ConfigError, match=r"fleet\.certificate: missing"):
        member_configuration(settings(tcp=None, certificate=None))


def test_a_cell_with_tls_needs_the_port_that_commands_go_to():
    with pytest.raises(ConfigError, match=r"add the table \[tcp\]"):
        address_of(settings(tcp=None), SOCKET)


@pytest.mark.parametrize("listen", ["0.0.0.0:7450", "[::]:7450", "10.0.0.5:0"])
def test_an_address_that_others_cannot_use_is_refused(listen):
    tcp = {**TCP, "listen": listen}
    with pytest.raises(ConfigError, match=r"fleet\.address: expected"):
        address_of(settings(tcp=tcp), SOCKET)
    assert address_of(settings(tcp=tcp, address="arm.lab:7450"), SOCKET) == "arm.lab:7450"


def test_commands_go_to_the_tls_port_or_to_the_socket():
    assert address_of(settings(), SOCKET) == "10.0.0.5:7450"
    local = settings(connect=["unixsock-stream//run/x"])
    assert address_of(local, SOCKET) == "unix:/run/control.sock"


def test_other_roles_are_other_settings_of_the_gateway():
    assert _fingerprint(settings(), SOCKET) == _fingerprint(settings(), SOCKET)
    assert _fingerprint(settings(callers=["ana"]), SOCKET) != _fingerprint(settings(), SOCKET)


def test_a_certificate_that_was_renewed_in_its_place_is_another(tmp_path):
    files = {name: str(tmp_path / name) for name in ("certificate", "key", "ca")}
    for path in files.values():
        Path(path).write_text("old")
    before = _fingerprint(settings(**files), SOCKET)
    Path(files["certificate"]).write_text("new")
    assert _fingerprint(settings(**files), SOCKET) != before


def test_whoever_is_in_no_list_may_do_nothing():
    found, otherwise = access_of(settings(callers=["pendant"]))
    assert list(found) == ["pendant"]
    assert otherwise == "deny"


def test_a_caller_stops_in_its_own_name_alone():
    found, _ = access_of(settings(callers=["pendant", "chief"]))
    for name, rules in found.items():
        asking = [rule for rule in rules if "query" in rule["messages"]]
        keys = [key for rule in asking for key in rule["key_exprs"]]
        assert sorted(keys) == ["orientd/line/*/clock", f"orientd/line/*/stop/{name}"]
        incoming = [rule for rule in rules if "ingress" in rule["flows"]]
        assert all("put" not in rule["messages"] for rule in incoming)


def test_another_daemon_asks_for_nothing():
    found, _ = access_of(settings(daemons=["arm-2"]))
    for rule in found["arm-2"]:
        if "ingress" in rule["flows"]:
            assert "query" not in rule["messages"]


def test_nothing_is_listened_at_that_was_not_named():
    found = session_configuration([], ["tls/h:1"])
    assert found["listen"]["endpoints"] == []
    assert found["scouting"]["multicast"]["enabled"] is False


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"a = " + b"[" * 5000, "not TOML: nested too deeply"),
        (b"\xff", r"not UTF-8 text \(byte 0\)"),
        (b"a =", "not TOML: "),
        (b"", "fleet: missing"),
    ],
)
def test_what_no_router_can_be_configured_by_is_told(tmp_path, content, told):
    path = tmp_path / "router.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=rf"router\.toml: {told}"):
        router_configuration(path)


MOTION = {"keyframes": [{"rotation_vector": [0, 0, 1]}]}


def write(tmp_path, content):
    path = tmp_path / "plan.yaml"
    path.write_text(json.dumps(content))
    return path


def test_a_plan_is_a_motion_for_each_device(tmp_path):
    (tmp_path / "turn.json").write_text(json.dumps(MOTION))
    plan = {
        "start_in": 2,
        "motions": [
            {"daemon": "a", "device": "arm", "motion": MOTION},
            {"daemon": "b", "file": "turn.json"},
        ],
    }
    motions, start_in = read_plan(write(tmp_path, plan))
    assert [str(motion) for motion in motions] == ["a/arm", "b"]
    assert start_in == 2.0


@pytest.mark.parametrize(
    ("plan", "field"),
    [
        ({}, "motions"),
        ({"motions": []}, "motions"),
        ({"motions": [{"daemon": "a", "motion": MOTION}], "start": 1}, "start"),
        ({"motions": [{"daemon": "a", "motion": MOTION}], "start_in": 0}, "start_in"),
        ({"motions": [{"daemon": "*", "motion": MOTION}]}, "motions[0].daemon"),
        ({"motions": [{"daemon": "a"}]}, "motions[0].motion"),
        ({"motions": [{"daemon": "a", "motion": {}}]}, "motions[0].motion"),
        ({"motions": [{"daemon": "a", "motion": MOTION}] * 2}, "motions"),
    ],
)
def test_a_plan_that_is_not_well_formed_is_refused_by_its_field(tmp_path, plan, field):
    with pytest.raises(RequestError) as caught:
        read_plan(write(tmp_path, plan))
    assert caught.value.field.startswith(field)
