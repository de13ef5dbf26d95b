import json

import pytest

from orientd import config
from orientd.config import FleetSettings
from orientd.errors import ConfigError, RequestError
from orientd.fleet import nested, read_plan, zenoh_configuration
from orientd.fleet.access import basic_configuration, router_configuration

TLS = {"cell": "line", "name": "arm", "certificate": "/c", "key": "/k", "ca": "/a"}
DEVICES = {"arm": {"driver": "loopback"}}


def settings(**more):
    return FleetSettings.model_validate({**TLS, "connect": ["tls/host:7447"], **more})


def test_a_daemon_is_alone_unless_the_settings_say_otherwise():
    assert config.default_settings().fleet is None


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
        config.parse({"fleet": table, "devices": DEVICES}, source="test")


def test_tls_needs_a_certificate():
    with pytest.raises(ConfigError, match=r"fleet\.certificate: missing"):
        zenoh_configuration(FleetSettings(cell="c", name="a", connect=["tls/h:1"]))


def test_whoever_is_in_no_list_may_do_nothing():
    control = zenoh_configuration(settings(), callers=["pendant"])["access_control"]
    assert control["enabled"]
    assert control["default_permission"] == "deny"
    assert {rule["permission"] for rule in control["rules"]} == {"allow"}
    named = {name for one in control["subjects"] for name in one["cert_common_names"]}
    assert named == {"pendant"}


def test_a_caller_may_ask_in_its_own_name_alone():
    control = zenoh_configuration(settings(), callers=["pendant", "chief"])["access_control"]
    rules = {rule["id"]: rule for rule in control["rules"]}
    for policy in control["policies"]:
        (subject,) = policy["subjects"]
        (name,) = next(
            one["cert_common_names"] for one in control["subjects"] if one["id"] == subject
        )
        asking = [rules[one] for one in policy["rules"] if "query" in rules[one]["messages"]]
        keys = [key for rule in asking for key in rule["key_exprs"]]
        assert keys == [f"orientd/line/*/as/{name}/**"]
        incoming = [rules[one] for one in policy["rules"] if "ingress" in rules[one]["flows"]]
        assert all("put" not in rule["messages"] for rule in incoming)


def test_another_daemon_asks_for_nothing():
    control = zenoh_configuration(settings(daemons=["arm-2"]))["access_control"]
    rules = {rule["id"]: rule for rule in control["rules"]}
    (policy,) = control["policies"]
    for one in policy["rules"]:
        if "ingress" in rules[one]["flows"]:
            assert "query" not in rules[one]["messages"]


def test_nothing_is_listened_at_that_was_not_named():
    assert basic_configuration([], ["tls/h:1"])["listen/endpoints"] == []
    assert basic_configuration([], ["tls/h:1"])["scouting/multicast/enabled"] is False


def test_values_by_path_become_a_tree():
    found = nested({"mode": "router", "listen/endpoints": ["x"], "listen/exit": True})
    assert found == {"mode": "router", "listen": {"endpoints": ["x"], "exit": True}}


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
