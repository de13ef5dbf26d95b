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


def status(device=DEVICE, daemon=DAEMON, *, is_ours=False, problem="", is_connected=True):
    """Return the head of the page, a text for each line."""
    lines = words.status(
        device, daemon, is_ours=is_ours, problem=problem, is_connected=is_connected
    )
    return [" ".join(line[1:]) for line in lines]


def test_no_two_states_look_alike():
    said = {words.state(replace(DEVICE, state=state))[0] for state in ServoState}
    paused = words.state(replace(DEVICE, state=ServoState.STREAMING, is_paused=True))[0]
    assert len({*said, paused}) == len(ServoState) + 1
    assert len({word.partition(" ")[0] for word in (*said, paused)}) == len(ServoState) + 1


@pytest.mark.parametrize("fault", Fault)
def test_every_fault_is_put_in_words(fault):
    assert words.FAULTS[fault]


def test_a_fault_is_told_with_what_the_device_said():
    device = replace(
        DEVICE, state=ServoState.FAULT, fault=Fault.FEEDBACK_STALE, fault_text="silent for 0.1 s"
    )
    assert f"⚠ {words.FAULTS[Fault.FEEDBACK_STALE]} silent for 0.1 s" in status(device)


def test_a_slow_motion_is_told_with_its_speed():
    device = replace(DEVICE, state=ServoState.STREAMING, speed=0.5)
    assert words.state(device)[1] == "motion 3, 1.2 of 8.0 s at 50 % speed"
    ready = replace(DEVICE, state=ServoState.HOLDING, speed=0.5)
    assert words.state(ready)[1] == "at rest, ready to move at 50 % speed"


@pytest.mark.parametrize(
    ("holder", "is_ours", "said"),
    [("", False, "free"), ("ana", False, "held by ana"), ("it", True, "held by this view")],
)
def test_who_may_command_is_said(holder, is_ours, said):
    leases = (LeaseReport(holder, 1.0, devices=(DEVICE.name,)),) if holder else ()
    daemon = replace(DAEMON, leases=leases)
    assert f"Lease {said}" in status(daemon=daemon, is_ours=is_ours)


def test_what_is_out_of_date_is_not_told_as_what_is():
    for is_connected, said in ((False, "✕ Not connected gone"), (True, "✕ Out of date gone")):
        lines = status(problem="gone", is_connected=is_connected)
        assert said in lines
        assert "? Unknown holding when last heard of" in lines
        assert not any("ready" in line for line in lines)


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
    lines = status(replace(DEVICE, cycle=cycle))
    assert "Sent w +0.7071 x +0.0000 y +0.0000 z +0.7071" in lines
    assert " yaw 90.00° pitch 0.00° roll 0.00° (ZYX)" in lines
    assert "Measured w +1.0000 x +0.0000 y +0.0000 z +0.0000" in lines
    assert "Axes measured 90.00° 0.00°" in lines


def test_a_daemon_of_a_cell_that_is_gone_or_silent_is_not_told_as_it_was():
    def cell(one):
        return [" ".join(line[1:]) for line in words.cell([one])]

    member = Member("arm-1", is_alive=True, age=0.1, age_bound=0.001, devices=[DEVICE])
    assert "arm: ● Holding at rest, ready to move" in cell(member)
    for one in (replace(member, is_alive=False), replace(member, age=STALE + 0.1)):
        lines = cell(one)
        assert "arm: ? Unknown holding when last heard of" in lines
        assert not any("ready" in line for line in lines)
    assert "✕ Out of date arm says nothing" in cell(Member("arm", is_alive=True))
