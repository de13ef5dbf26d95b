"""Texts of the page."""

import math

import pytest

from orientd.errors import Fault
from orientd.model.limits import DEFAULT_LIMITS
from orientd.protocol import control_pb2 as pb
from orientd.protocol import quaternion
from orientd.protocol.limits import limits_to_message
from orientd.viewer import words

STATES = [number for number in pb.State.values() if number != pb.STATE_UNSPECIFIED]
DAEMON = pb.DaemonReport(version="1", pid=7, uptime=60.0, socket="/run/it.sock")
DEVICE = pb.DeviceReport(
    name="arm", driver="loopback", rate_hz=500.0, limits=limits_to_message(DEFAULT_LIMITS),
    state=pb.STATE_HOLDING, speed=1.0, motion_number=3, motion_id="id", path_time=1.24,
    duration=8.0, servo_pid=12, scheduling="SCHED_FIFO 80", is_memory_locked=True,
)  # fmt: skip


def changed(message, **fields):
    """Return a copy of *message* with other *fields*."""
    copy = type(message).FromString(message.SerializeToString())
    copy.MergeFrom(type(message)(**fields))
    return copy


def status(device=DEVICE, daemon=DAEMON, *, is_ours=False, problem="", is_connected=True):
    """Return the head of the page, a text for each line."""
    lines = words.status(
        device, daemon, is_ours=is_ours, problem=problem, is_connected=is_connected
    )
    return [" ".join(line[1:]) for line in lines]


def test_no_two_states_look_alike():
    said = {words.state(changed(DEVICE, state=state))[0] for state in STATES}
    paused = words.state(changed(DEVICE, state=pb.STATE_STREAMING, is_paused=True))[0]
    assert len({*said, paused}) == len(STATES) + 1
    assert len({word.partition(" ")[0] for word in (*said, paused)}) == len(STATES) + 1


@pytest.mark.parametrize("fault", Fault)
def test_every_fault_is_put_in_words(fault):
    assert words.FAULTS[fault]


def test_a_fault_is_told_with_what_the_device_said():
    device = changed(
        DEVICE, state=pb.STATE_FAULT, fault=Fault.FEEDBACK_STALE, fault_text="silent for 0.1 s"
    )
    assert f"⚠ {words.FAULTS[Fault.FEEDBACK_STALE]} silent for 0.1 s" in status(device)


def test_the_last_motion_is_told_with_its_end_and_by_whom():
    ended = {"motion_number": 3, "name": "wave", "path_time": 0.8, "duration": 3.7}
    stopped = {"outcome": pb.OUTCOME_STOPPED, "text": "stopped by ana", **ended}
    assert "Last motion 3 'wave': stopped by ana, at 0.800 of 3.700 s" in status(
        changed(DEVICE, ended=stopped)
    )
    done = changed(DEVICE, ended={"outcome": pb.OUTCOME_DONE, **ended})
    assert "Last motion 3 'wave': done, 3.700 s" in status(done)
    assert "Last motion" not in str(status(changed(done, motion_number=4)))


def test_a_slow_motion_is_told_with_its_speed():
    device = changed(DEVICE, state=pb.STATE_STREAMING, speed=0.5)
    assert words.state(device)[1] == "motion 3, 1.2 of 8.0 s at 50 % speed"
    ready = changed(DEVICE, state=pb.STATE_HOLDING, speed=0.5)
    assert words.state(ready)[1] == "at rest, ready to move at 50 % speed"


@pytest.mark.parametrize(
    ("holder", "is_ours", "said"),
    [("", False, "free"), ("ana", False, "held by ana"), ("it", True, "held by this view")],
)
def test_who_may_command_is_said(holder, is_ours, said):
    lease = pb.LeaseReport(holder=holder, remaining=1.0, devices=["arm"])
    daemon = changed(DAEMON, leases=[lease]) if holder else DAEMON
    assert f"Lease {said}" in status(daemon=daemon, is_ours=is_ours)


def test_what_is_out_of_date_is_not_told_as_what_is():
    for is_connected, said in ((False, "✕ Not connected gone"), (True, "✕ Out of date gone")):
        lines = status(problem="gone", is_connected=is_connected)
        assert said in lines
        assert "? Unknown holding when last heard of" in lines
        assert not any("ready" in line for line in lines)


def test_a_measurement_has_an_age():
    assert words.measured(DEVICE) == "never"
    assert words.measured(changed(DEVICE, feedback_age=3.2)) == "3.2 s ago"
    assert words.measured(changed(DEVICE, feedback_age=0.002)) == "less than 0.1 s ago"


def test_where_the_device_is_stands_there_in_numbers():
    half = math.sqrt(0.5)
    turned, home = quaternion((half, 0.0, 0.0, half)), quaternion((1.0, 0.0, 0.0, 0.0))
    lines = status(changed(DEVICE, cycle=pb.Cycle(q=turned, feedback_q=home)))
    # A line never ends between the name of a component and its number.
    assert "Sent w_+0.7071 x_+0.0000 y_+0.0000 z_+0.7071" in _shown(lines)
    assert " yaw 90.00° pitch 0.00° roll 0.00° (ZYX)" in lines
    assert "Measured w_+1.0000 x_+0.0000 y_+0.0000 z_+0.0000" in _shown(lines)
    assert [line.partition(" ")[0] for line in lines].count("Measured") == 1


def _shown(lines):
    return [line.replace("\N{NO-BREAK SPACE}", "_") for line in lines]


def test_a_pause_is_not_shown_as_a_motion():
    moving = changed(DEVICE, state=pb.STATE_STREAMING)
    assert words.state(moving)[0] == "▶ Moving"
    assert words.state(changed(moving, is_paused=True))[0] == "Ⅱ Paused"
