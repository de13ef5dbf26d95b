"""Findings about a controller, and the doctor's messages about them."""

import struct
from dataclasses import replace
from importlib import metadata

import pytest
from peers import package

from orientd.driver import Verdict
from orientd.errors import LinkError
from orientd.floats import exp
from orientd_ur.arm import MODELS
from orientd_ur.doctor import inspect
from orientd_ur.options import check
from orientd_ur.probe import Place, Probe, look
from orientd_ur.robot import Robot
from orientd_ur.wire import DASHBOARD_PORT, RTDE_PORT, SCRIPT_PORT

WELL = Probe((5, 12, 6, 0), True, 7, 1, 2, True, 0.0005, 0.0008)
JOINTS = (0.3, -1.4, 1.2, -1.1, -1.3, 0.5)
GREETING = b"Connected: Universal Robots Dashboard Server\n"
ACCEPTED = package("V", b"\1")


def controller(peer, *, version=(5, 12, 6, 0), registers=b"INT32,DOUBLE", modes=(7, 1, 2)):
    """Serve the ports that are looked at; the clock runs late by 3 ms once."""
    stamps = [1e6, 1e6 + 0.002, 1e6 - 0.003]
    data = [package("U", struct.pack(">BdiiI", 1, stamp, *modes)) for stamp in stamps]
    trips = [package("v", struct.pack(">4I", *version))] * 5
    host, heard = peer(
        RTDE_PORT, None, ACCEPTED, *trips, package("I", b"\1" + registers),
        package("O", b"\1DOUBLE,INT32,INT32,UINT32"), package("S", b"\1") + b"".join(data),
    )  # fmt: skip
    peer(SCRIPT_PORT)
    return host, heard


def test_look_finds_what_the_controller_says(peer):
    peer(DASHBOARD_PORT, GREETING, b"false\n")
    host, heard = controller(peer, modes=(5, 3, 1))
    found = look(host, timeout=1.0, packages=3, first_register=24)
    assert found.version == (5, 12, 6, 0)
    assert (found.is_remote, found.registers_are_free) == (False, True)
    assert (found.robot_mode, found.safety_mode, found.runtime_state) == (5, 3, 1)
    assert 0.0 < found.round_trip < 0.5
    assert found.jitter == pytest.approx(0.005, abs=0.002)
    assert package("I", b"input_int_register_24,input_double_register_24") in heard
    names = b"timestamp,robot_mode,safety_mode,runtime_state"
    assert package("O", struct.pack(">d", 500.0) + names) in heard


def test_dashboard_may_be_missing_on_no_other_robot(peer):
    host, _ = controller(peer)
    with pytest.raises(LinkError, match="no dashboard server"):
        look(host, timeout=1.0, packages=2)


# The arm and its tool


def robot_at(monkeypatch, place, arms, **options):
    asked = []

    def ask(_, timeout):
        asked.append(timeout)
        return arms[min(len(asked), len(arms)) - 1]

    monkeypatch.setattr("orientd_ur.robot.whereabouts", lambda *_, **__: place)
    monkeypatch.setattr("orientd_ur.robot.ask", ask)
    return Robot(check({"host": "127.0.0.9", **options}, period=0.002)), asked


def place_of(model, *, tool=None, off=(0.0, 0.0, 0.0), turned=(0.0, 0.0, 0.0)):
    told = (exp(turned), off)
    arm = replace(MODELS[model].arm(), tool=tool or told)
    return Place(JOINTS, arm.forward(JOINTS), ((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))


def test_arm_is_asked_for_once_and_again_when_another_robot_takes_its_place(monkeypatch):
    arms = [MODELS["ur5e"].arm(), MODELS["ur10e"].arm()]
    robot, asked = robot_at(monkeypatch, place_of("ur5e"), arms)
    for _ in range(3):
        assert robot.look()[0].name == "ur5e"
    assert len(asked) == 1
    monkeypatch.setattr("orientd_ur.robot.whereabouts", lambda *_, **__: place_of("ur10e"))
    assert robot.look()[0].name == "ur10e"
    assert len(asked) == 2
    assert all(0.4 < seconds <= 0.8 for seconds in asked)


@pytest.mark.parametrize(
    ("off", "turned", "fits"),
    [
        ((0.009, 0.0, 0.0), (0.0, 0.019, 0.0), True),
        ((0.0, -0.011, 0.0), (0.0, 0.0, 0.0), False),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.021), False),
    ],
)
def test_joints_and_tool_that_do_not_agree_are_refused(monkeypatch, off, turned, fits):
    place = place_of("ur5e", off=off, turned=turned)
    robot, _ = robot_at(monkeypatch, place, [MODELS["ur5e"].arm()], joint_acceleration_deg=600)
    if fits:
        arm, _ = robot.look()
        assert arm.forward(JOINTS)[1] == pytest.approx(place.pose[1])
        assert [axis.acceleration for axis in arm.axes] == pytest.approx([10.471976] * 6)
    else:
        with pytest.raises(LinkError, match="they do not agree for the ur5e"):
            robot.look()


def test_arm_of_the_options_has_their_tool_and_start():
    options = {"host": "r", "model": "ur3", "tcp_offset": [0, 0, 0.1, 0, 0.2, 0]}
    arm = Robot(check(options, period=0.002)).named()
    assert arm.tool == (exp((0.0, 0.2, 0.0)), (0.0, 0.0, 0.1))
    assert arm.home() == check(options, period=0.002).start_joints


# The doctor


def rows(monkeypatch, probe=WELL, *, arm=None, period_ns=2_000_000, **options):
    def told(_):
        if isinstance(arm, LinkError):
            raise arm
        return arm or MODELS["ur5e"].arm(), None

    monkeypatch.setattr("orientd_ur.doctor.look", lambda *_, **__: probe)
    monkeypatch.setattr(Robot, "look", told)
    monkeypatch.setattr(metadata, "version", lambda _: "1.6.5")
    checked = check({"host": "127.0.0.9", **options}, period=period_ns * 1e-9)
    findings = inspect(checked, period_ns)
    assert all(bool(one.mend) == (one.verdict is not Verdict.OK) for one in findings)
    return {one.name: one for one in findings}


@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({"round_trip": 0.002, "jitter": 0.002}, Verdict.OK),
        ({"round_trip": 0.0021}, Verdict.IMPROVE),
        ({"jitter": 0.01}, Verdict.IMPROVE),
        ({"jitter": 0.0101}, Verdict.PROBLEM),
        ({"jitter": 0.0101, "version": (3, 15, 8, 0)}, Verdict.IMPROVE),
        ({"jitter": 0.008, "version": (3, 15, 8, 0)}, Verdict.OK),
    ],
)
def test_link_is_judged_by_the_cycle_of_the_robot(monkeypatch, changes, verdict):
    found = rows(monkeypatch, replace(WELL, **changes))["link"]
    assert found.verdict is verdict
    assert ("a cable of its own" in found.mend) == (verdict is not Verdict.OK)


def test_arm_that_is_not_known_is_a_problem_if_its_joints_are_to_be_checked(monkeypatch):
    silent = LinkError("it does not say")
    found = rows(monkeypatch, arm=silent)["arm"]
    assert (found.found, found.verdict) == ("it does not say", Verdict.PROBLEM)
    assert rows(monkeypatch, arm=silent, check_joints=False)["arm"].verdict is Verdict.OK
