"""The doctor's checks of a robot, and its messages."""

import pytest

from orientd.cli.commands.doctor import device_findings, latency_finding
from orientd.config import DeviceSettings
from orientd.driver import Verdict
from orientd_ur.doctor import _link
from orientd_ur.probe import Probe

rtde_control = pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world

WELL = Probe((5, 12, 6, 0), True, 7, 1, 1, True, 0.0005, 0.0008)


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


def rows_of(host, **options):
    found = {one.name: one for one in device_findings(settings_of(host, **options))}
    for one in found.values():
        assert bool(one.mend) == (one.verdict is not Verdict.OK)
    return found


@pytest.mark.real
def test_robot_that_is_ready_has_no_problem(ur_robot):
    rows = rows_of(ur_robot.host)
    assert rows["version"].found == "PolyScope 5.12.6"
    for name in ("client library", "reachability", "remote control", "readiness", "registers"):
        assert rows[name].verdict is Verdict.OK, rows[name]
    assert "round trip" in rows["link"].found
    assert ur_robot.wait_until(lambda s: s["rtde_clients"] == 0)["log"] == []


def test_robot_that_is_not_there_is_one_problem(ur_host):
    rows = rows_of(ur_host)
    assert rows["reachability"].verdict is Verdict.PROBLEM
    assert "no dashboard server" in rows["reachability"].found
    assert "link" not in rows


@pytest.mark.real
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


@pytest.mark.real
def test_registers_of_another_client_are_named(ur_robot):
    other = rtde_control.RTDEControlInterface(ur_robot.host)
    try:
        assert rows_of(ur_robot.host)["registers"].verdict is Verdict.PROBLEM
        assert other.isProgramRunning()
    finally:
        other.disconnect()


@pytest.mark.parametrize(
    ("jitter", "verdict"),
    [(0.0005, Verdict.OK), (0.005, Verdict.IMPROVE), (0.05, Verdict.PROBLEM)],
)
def test_link_is_judged_by_the_controllers_tick(jitter, verdict):
    probe = Probe(*(getattr(WELL, name) for name in WELL.__slots__[:-1]), jitter)
    assert _link(probe).verdict is verdict


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
