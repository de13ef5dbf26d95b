"""What the page says."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from orientd.errors import Fault
from orientd.planner import DEFAULT_LIMITS
from orientd.rpc.reports import STALE, DaemonReport, DeviceReport, LeaseReport
from orientd.stream import ServoState
from orientd.viewer import words
from orientd.viewer.cell import Member

DAEMON = DaemonReport("1", 7, 60.0, "/run/it.sock", "", "ana", 3.0)
DEVICE = DeviceReport(
    "arm", "loopback", 500.0, DEFAULT_LIMITS, ServoState.HOLDING, Fault.NONE, "", False, 1.0, 3,
    "id", 1.24, 8.0, 12, "SCHED_FIFO 80", True, None,
)  # fmt: skip


@pytest.mark.parametrize("state", ServoState)
def test_every_state_has_a_sign_and_a_word(state):
    sign, word, _ = words.state(replace(DEVICE, state=state))
    assert sign
    assert word


def test_no_two_states_look_alike():
    said = {words.state(replace(DEVICE, state=state))[:2] for state in ServoState}
    paused = words.state(replace(DEVICE, state=ServoState.STREAMING, is_paused=True))[:2]
    assert len({*said, paused}) == len(ServoState) + 1
    assert len({sign for sign, _ in (*said, paused)}) == len(ServoState) + 1


@pytest.mark.parametrize("fault", Fault)
def test_every_fault_is_put_in_words(fault):
    assert words.FAULTS[fault]


def test_a_fault_is_told_with_what_the_device_said():
    device = replace(
        DEVICE, state=ServoState.FAULT, fault=Fault.FEEDBACK_STALE, fault_text="silent for 0.1 s"
    )
    html = words.status(device, DAEMON, is_ours=False)
    assert words.FAULTS[Fault.FEEDBACK_STALE] in html
    assert "silent for 0.1 s" in html


def test_a_slow_motion_is_told_with_its_speed():
    device = replace(DEVICE, state=ServoState.STREAMING, speed=0.5)
    assert words.state(device)[2] == "motion 3, 1.2 of 8.0 s, at 50 % speed"
    ready = replace(DEVICE, state=ServoState.HOLDING, speed=0.5)
    assert words.state(ready)[2] == "at rest, ready to move at 50 % speed"


@pytest.mark.parametrize(
    ("holder", "is_ours", "said"),
    [("", False, "free"), ("ana", False, "held by ana"), ("it", True, "held by this view")],
)
def test_who_may_command_is_said(holder, is_ours, said):
    leases = (LeaseReport(holder, 1.0, devices=(DEVICE.name,)),) if holder else ()
    daemon = replace(DAEMON, leases=leases)
    assert said in words.status(DEVICE, daemon, is_ours=is_ours)


def test_what_others_wrote_is_no_markup():
    evil = "<img src=x onerror=alert(1)>"
    device = replace(DEVICE, state=ServoState.FAULT, fault_text=evil, fault=Fault.DEVICE_FAULT)
    daemon = replace(DAEMON, leases=(LeaseReport(evil, 1.0, devices=(DEVICE.name,)),))
    page = words.status(device, daemon, is_ours=False, problem=evil)
    for html in (page, words.trouble(evil), words.refusal(evil), words.note(evil)):
        assert "<img" not in html


def test_what_is_out_of_date_is_not_told_as_what_is():
    for problem, is_connected, said in (
        ("gone", False, "Not connected"),
        ("x", True, "Out of date"),
    ):
        html = words.status(
            DEVICE, DAEMON, is_ours=False, problem=problem, is_connected=is_connected
        )
        assert said in html
        assert "holding when last heard of" in html
        assert "ready" not in html


def test_a_measurement_has_an_age():
    cycle = SimpleNamespace(has_feedback=True, feedback_age_ns=200_000_000)
    assert words.measured(DEVICE) == "never"
    assert words.measured(replace(DEVICE, cycle=cycle, cycle_age=3.0)) == "3.2 s ago"
    cycle.feedback_age_ns = 2_000_000
    assert words.measured(replace(DEVICE, cycle=cycle)) == "less than 0.1 s ago"


def test_where_the_device_is_stands_there_in_numbers():
    half = math.sqrt(0.5)
    cycle = SimpleNamespace(
        q=(half, 0.0, 0.0, half),
        has_feedback=True,
        feedback_q=(1.0, 0.0, 0.0, 0.0),
        feedback_age_ns=0,
        joints=(math.pi / 2, 0.0),
    )
    html = words.status(replace(DEVICE, cycle=cycle), DAEMON, is_ours=False)
    assert "w +0.7071 x +0.0000 y +0.0000 z +0.7071" in html
    assert "yaw 90.00° pitch 0.00° roll 0.00° (ZYX)" in html
    assert "w +1.0000 x +0.0000 y +0.0000 z +0.0000" in html
    assert "90.00° 0.00°" in html


def test_a_daemon_of_a_cell_that_is_gone_or_silent_is_not_told_as_it_was():
    evil = "<img src=x>"
    member = Member(evil, is_alive=True, age=0.1, age_bound=0.001, devices=[DEVICE])
    html = words.cell([member])
    assert "<b>Holding</b>" in html
    assert "<img" not in html
    for one in (replace(member, is_alive=False), replace(member, age=STALE + 0.1)):
        html = words.cell([one])
        assert "<b>Unknown</b> holding when last heard of" in html
        assert "ready" not in html
    assert "says nothing" in words.cell([Member("arm", is_alive=True)])
