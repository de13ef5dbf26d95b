"""The doctor's checks of a robot, and its messages."""

import pytest

from orientd.cli.commands.doctor import device_findings, latency_finding
from orientd.config import DeviceSettings
from orientd.driver import Verdict
from orientd_ur.wire import RtdeClient

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world


def settings_of(host, **options):
    return DeviceSettings(
        # A busy machine may let nobody run for longer than a real controller ever pauses.
        name="arm", driver="ur", priority=0, feedback_timeout=5.0, heartbeat_timeout=5.0,
        stall_timeout=5.0,
        options={
            "host": host, "feedback_timeout": 1.0, "link_timeout": 2.0, "watchdog_hz": 1.0,
            **options,
        },
    )  # fmt: skip


def by_name(findings):
    """Return findings by their names; those that are not good say what to do."""
    for one in findings:
        assert bool(one.mend) == (one.verdict is not Verdict.OK)
    return {one.name: one for one in findings}


def rows_of(host, **options):
    return by_name(settings_of(host, **options).make_driver().diagnose())


@pytest.mark.real
def test_robot_that_is_ready_has_no_problem(ur_robot):
    rows = by_name(device_findings(settings_of(ur_robot.host)))
    assert rows.pop("link").found.startswith("round trip ")
    assert {one.verdict for one in rows.values()} == {Verdict.OK}
    assert rows.pop("client library").found.startswith("ur-rtde 1.")
    assert {name: one.found for name, one in rows.items()} == {
        "reachability": f"{ur_robot.host} answers on every port",
        "version": "PolyScope 5.12.6",
        "rate": "500 Hz",
        "arm": "ur5e, by the published lengths",
        "remote control": "on",
        "readiness": "powered, brakes released, no stop",
        "registers": "free",
    }
    assert ur_robot.wait_until(lambda s: s["rtde_clients"] == 0)["log"] == []


def test_robot_that_is_not_there_is_one_problem(ur_host):
    rows = rows_of(ur_host)
    assert rows["reachability"].verdict is Verdict.PROBLEM
    assert "no dashboard server" in rows["reachability"].found
    assert "link" not in rows


def test_local_control_and_a_stop_are_named_with_what_to_do(ur_robot):
    ur_robot.ask("local")
    ur_robot.ask("safeguard")
    ur_robot.wait_until(lambda s: s["safety_mode"] != "NORMAL")
    rows = rows_of(ur_robot.host)
    assert rows["remote control"].verdict is Verdict.PROBLEM
    assert "pendant" in rows["remote control"].mend
    assert "safeguard" in rows["readiness"].found
    unneeded = rows_of(ur_robot.host, check_remote_control=False)
    assert unneeded["remote control"].verdict is Verdict.OK


def test_registers_of_another_client_are_named(ur_robot):
    with RtdeClient(ur_robot.host, 2.0) as other:
        assert other.claim("input_int_register_0")
        found = rows_of(ur_robot.host)["registers"]
        assert found.verdict is Verdict.PROBLEM
        assert "end the client" in found.mend
        upper = rows_of(ur_robot.host, registers="upper")["registers"]
        assert upper.verdict is Verdict.OK


def test_latency_of_a_robot_that_cannot_move_says_why(ur_robot):
    ur_robot.ask("safeguard")
    ur_robot.wait_until(lambda s: s["safety_mode"] != "NORMAL")
    found = latency_finding(settings_of(ur_robot.host))
    assert found.verdict is Verdict.PROBLEM
    assert "safeguard" in found.found


@pytest.mark.real
def test_latency_is_found_by_a_small_motion(ur_robot):
    found = latency_finding(settings_of(ur_robot.host, lookahead=0.2))
    assert found.verdict is Verdict.IMPROVE, found


@pytest.mark.slow
@pytest.mark.real
def test_latency_of_the_whole_chain_is_found_by_a_small_motion(ur_robot):
    found = latency_finding(settings_of(ur_robot.host, lookahead=0.2))
    assert found.verdict is Verdict.IMPROVE, found
    milliseconds = float(found.found.split()[0])
    # The model's lookahead; what it lags beyond it depends on how busy the machine is.
    assert 150.0 < milliseconds < 300.0
