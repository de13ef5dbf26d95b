"""How the driver looks at a robot, and what it makes of its sockets and of hanging calls."""

import json
import os
import signal
import socket
import subprocess
import sys
import time

import pytest
from direct_planners import move, run
from ur_rig import (
    device_of,
    driver_of,
    is_holding,
    stream_of,
    streaming,
    swing,
    swing_motion,
    until,
)

from orientd.clock import MonotonicClock
from orientd.daemon.device import MoveOptions
from orientd.daemon.planners.messages import PlanRequest
from orientd.driver import Setpoint
from orientd.errors import LinkError, PlanError, RequestError, StateError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd_ur import UrDriver
from orientd_ur.controller import RuntimeState, version_problem
from orientd_ur.link import are_open, send_at_once
from orientd_ur.pose import pose_of
from orientd_ur.probe import look, whereabouts
from orientd_ur.wire import numeric_address

rtde_control = pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world


@pytest.mark.real
def test_look_finds_version_modes_and_timing(ur_robot):
    found = look(ur_robot.host)
    assert found.version[:3] == (5, 12, 6)
    assert (found.robot_mode, found.safety_mode) == (7, 1)
    assert found.runtime_state == RuntimeState.STOPPED
    assert found.is_remote
    assert found.registers_are_free
    assert version_problem(found.version) == ""
    assert 0.0 < found.round_trip < 1.0
    assert 0.0 < found.jitter < 1.0


def test_look_changes_nothing(ur_robot):
    before = ur_robot.state()
    look(ur_robot.host)
    after = ur_robot.wait_until(lambda s: s["rtde_clients"] == 0)
    assert after["log"] == before["log"] == []


@pytest.mark.real
def test_library_loses_no_delay_and_it_is_restored(ur_robot):
    client = rtde_control.RTDEControlInterface(ur_robot.host)
    try:
        sockets = send_at_once(ur_robot.host)
        assert len(sockets) == 2
        for found in sockets:
            with socket.socket(fileno=os.dup(found.descriptor)) as copy:
                assert copy.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        assert are_open(sockets)
    finally:
        client.disconnect()
    assert not are_open(sockets)


@pytest.mark.parametrize("host", ["a..b", 70 * "a"])
def test_name_that_is_none_is_said_to_be_none(host):
    with pytest.raises(LinkError, match="the name cannot be resolved"):
        numeric_address(host)


def test_tool_and_payload_are_set_when_enabling(ur_robot):
    tool = [0.0, 0.0, 0.12, 0.0, 0.1, 0.0]
    options = {"tcp_offset": tool, "payload_mass": 1.2, "payload_cog": [0, 0, 0.04]}
    with driver_of(ur_robot.host, **options) as driver:
        start = driver.enable()
        state = ur_robot.state()
        assert state["tcp_offset"] == tool
        assert (state["payload"], state["payload_cog"]) == (1.2, [0.0, 0.0, 0.04])
        place = whereabouts(ur_robot.host)
        turn, offset = pose_of(tool)
        assert place.tool == (pytest.approx(turn), pytest.approx(offset))
        assert start.position == pytest.approx(place.pose[1], abs=1e-9)


def test_watchdog_of_a_disabled_driver_is_kept_quiet(ur_robot):
    with stream_of(ur_robot.host, watchdog_hz=5.0) as stream:
        stream.driver.disable()
        stream.read_for(0.6)
        assert ur_robot.state()["runtime_state"] == "PLAYING"


def test_plan_for_a_robot_that_does_not_answer_is_refused(ur_host):
    driver = UrDriver({"host": ur_host}, period_ns=2_000_000, clock=MonotonicClock())
    planner = DevicePlanner(driver, limits=Limits(1.0, 5.0, 100.0, 0.5, 5.0), period=0.002)
    start = State.at_rest((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    request = MotionRequest([Keyframe((0.0, 1.0, 0.0, 0.0))], approach=True)
    with pytest.raises(PlanError, match=r"cannot predict the axes: no RTDE server"):
        planner.plan(request, start=start, joints=())


def test_motion_brings_options_of_its_own_and_the_next_has_those_of_the_configuration(ur_robot):
    with device_of(ur_robot.host, lookahead=0.05) as device:
        for options, found in (
            ({}, [0.05, 300.0]),
            ({"lookahead": 0.15, "gain": 700}, [0.15, 700.0]),
            ({"gain": 900}, [0.05, 900.0]),
            ({}, [0.05, 300.0]),
        ):
            swing(device, angle=0.02, seconds=0.8, device_options=options)
            streaming(device)
            until(lambda: is_holding(device), "the end")
            assert ur_robot.state()["servoing"] == found
        begun = swing_motion(device)
        other = {**json.loads(begun.request.motion), "device_options": {"gain": 700}}
        order = PlanRequest(json.dumps(other).encode())
        run(device, begun)
        streaming(device)
        with pytest.raises(StateError, match="device_options change at rest only"):
            move(device, order, MoveOptions(is_queued=True))


def test_motion_with_options_that_are_not_allowed_is_refused(ur_robot):
    with device_of(ur_robot.host) as device:
        for options in ({"lookahead": 3}, {"host": "other"}, {"gain": "x" * 500}):
            with pytest.raises(RequestError, match="device_options: "):
                swing_motion(device, device_options=options)


@pytest.mark.real
@pytest.mark.parametrize(
    ("code", "status"),
    [
        (
            "from orientd_ur.link import alarm_after\n"
            "with alarm_after(5.0): pass\n"
            "with alarm_after(0.05):\n    while True: pass",
            -signal.SIGALRM,
        ),
        (
            "from orientd_ur.link import process_ends_after\n"
            "with process_ends_after(0.05):\n    while True: pass",
            1,
        ),
        (
            "from orientd_ur.link import process_ends_after\n"
            "with process_ends_after(5.0): pass\nraise SystemExit(7)",
            7,
        ),
    ],
)
def test_hanging_call_ends_the_process(code, status):
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=20.0)
    assert ended.returncode == status


@pytest.mark.real
def test_no_resolver_and_no_file_is_asked_for_in_a_cycle(ur_robot, monkeypatch):
    asked, resolve_numbers = [], socket.getaddrinfo

    def resolve(host, *rest):
        if host == ur_robot.host:
            return resolve_numbers(host, *rest)
        asked.append(host)
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (ur_robot.host, 0))]

    monkeypatch.setattr(socket, "getaddrinfo", resolve)
    driver = UrDriver({"host": "arm.example"}, period_ns=2_000_000, clock=MonotonicClock())
    try:
        driver.open()
        start = driver.enable()
        assert asked == ["arm.example"]

        def forbidden(*_):
            raise AssertionError("asked for in a cycle")

        monkeypatch.setattr(socket, "getaddrinfo", forbidden)
        for name in ("listdir", "readlink", "open"):
            monkeypatch.setattr(os, name, forbidden)
        for _ in range(600):  # more than a second: every kind of cycle
            driver.read()
            driver.write(Setpoint(0, start.q, position=start.position))
            driver.deadline_shift_ns(0)
            time.sleep(0.002)
    finally:
        monkeypatch.undo()
        driver.close()
