"""Defects of the vendor's SDK: each test shows that the driver avoids one.

01  an exception leaves the port busy for ever
    test_01_port_stays_busy_after_an_exception
02  two threads on one port
    test_02_second_thread_is_turned_away_at_once
03  reads spin
    test_03_reads_of_the_port_wait_instead_of_spinning
04  other threads starve the loop
    test_04_cycle_takes_what_is_there_and_waits_for_nobody
05  34 ms for each missing servo
    test_05_missing_servo_costs_what_is_configured_not_34_ms
06  one lost reply fails the whole group
    test_06_lost_reply_keeps_the_last_good_reading_and_names_the_servo
07  a failed read is 0, which is -180 degrees
    test_07_failed_read_is_never_a_zero
08  group reads drop the alert
    test_08_alert_is_seen_in_group_reads
09  values are unsigned
    test_09_negative_values_are_negative
10  an error status is taken for content
    test_10_error_without_content_is_not_content
    test_10b_short_answer_to_a_group_is_a_loss
    test_10c_content_of_an_answer_with_an_error_is_no_reading
11  a late reply answers the next read
    test_11_late_reply_never_answers_a_later_question
    test_11_late_reply_of_another_size_is_not_the_answer
12  instructions are sent unstuffed
    test_12_goal_that_holds_a_header_is_moved_by_a_tick
13  answers are unstuffed wrongly
    test_13_stuffing_of_answers_is_undone_where_the_sdk_fails
    test_13_readings_that_hold_a_header_come_through
14  fast bulk reads look servos up by any byte
    test_14_servos_with_telling_ids_are_all_read
15  the easy SDK fails at alerts and indirect data
    test_15_indirect_data_of_each_model_is_where_it_is
16  group writes are refused in silence
    test_16_goals_refused_in_silence_are_noticed
17  goals without torque are accepted in silence
    test_17_lost_torque_is_noticed
18  parameters are added twice, or short
    test_18_goals_are_always_four_bytes
19  answers are left unread
    test_19_broadcast_and_unicast_leave_nothing_unread
20  a pulled cable raises what no OSError is
    test_20_whatever_a_pulled_cable_raises_is_a_link_error
21  slow factory settings
    test_21_return_delay_is_zero_and_the_adapters_timer_is_allowed_for
22  before version 4.1 the input is not cleared
    test_22_input_is_cleared_with_every_version_of_the_sdk
23  timeouts are on the wall clock
    test_23_timeouts_are_not_on_the_wall_clock
"""

import os
import re
import termios
import threading
import time

import pytest

sdk = pytest.importorskip("dynamixel_sdk")

from emulated_dynamixel import (  # noqa: E402
    Bus,
    EmulatedServo,
    FaultKind,
    ManualClock,
    ReplyFault,
    SerialLine,
    VirtualPort,
)
from emulated_dynamixel.packet import status  # noqa: E402
from orientd.errors import DeviceFaultError, FeedbackError, LinkError  # noqa: E402
from orientd_dynamixel.bus import ServoBus, _unstuffed, open_bus  # noqa: E402
from orientd_dynamixel.group import decode  # noqa: E402
from orientd_dynamixel.tables import X430, Register  # noqa: E402

MS = 1_000_000


def bare(count=3, **settings):
    """A bus with the SDK on it and nothing of ours."""
    bus = Bus([EmulatedServo(k + 1) for k in range(count)], **settings)
    port = VirtualPort(bus, ManualClock())
    port.openPort()
    return bus, port, sdk.Protocol2PacketHandler()


def ours(bus, port, ph, wait_ms=4.0):
    port.ser.timeout = 0.002
    return ServoBus(port, ph, wait_ms=wait_ms)


def test_01_port_stays_busy_after_an_exception(monkeypatch):
    bus, port, ph = bare()
    with monkeypatch.context() as patch:
        patch.setattr(port, "readPort", lambda n: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            ours(bus, port, ph).ping(1)
    assert not port.is_using
    assert ours(bus, port, ph).ping(1) == (1020, 48)


def test_02_second_thread_is_turned_away_at_once(monkeypatch):
    bus, port, ph = bare()
    it = ours(bus, port, ph)
    inside, go_on, found = threading.Event(), threading.Event(), []
    original = port.readPort

    def slow(length):
        inside.set()
        go_on.wait(10)
        return original(length)

    monkeypatch.setattr(port, "readPort", slow)
    thread = threading.Thread(target=lambda: found.append(it.ping(1)))
    thread.start()
    inside.wait(10)
    with pytest.raises(LinkError, match="another thread is using the bus"):
        it.ping(2)
    go_on.set()
    thread.join()
    assert found == [(1020, 48)]


def test_03_reads_of_the_port_wait_instead_of_spinning(rig):
    it = rig()
    it.driver.open()
    assert it.port.ser.timeout == pytest.approx(0.001)


def test_04_cycle_takes_what_is_there_and_waits_for_nobody(gimbal):
    """Nothing to starve: a cycle makes no more than a handful of calls to the port."""
    count, original = [0], gimbal.port.readPort

    def counted(length):
        count[0] += 1
        return original(length)

    gimbal.port.readPort = counted
    gimbal.run(100)
    assert count[0] <= 3 * 100


def test_05_missing_servo_costs_what_is_configured_not_34_ms():
    _, port, ph = bare(line=SerialLine(is_paced=True))
    port.ser.timeout = 0.002
    before = port.clock.now_ns()
    assert ServoBus(port, ph, wait_ms=4.0).ping(9) is None
    assert port.clock.now_ns() - before < 9 * MS


def test_06_lost_reply_keeps_the_last_good_reading_and_names_the_servo(gimbal):
    gimbal.run(20)
    good = gimbal.seen[-1]
    gimbal.bus.faults.add(2, ReplyFault(FaultKind.DROP, remaining=1))
    gimbal.run(3)
    assert gimbal.driver._group.lost == 1
    assert gimbal.seen[-1].joints == good.joints
    gimbal.bus.faults.add(2, ReplyFault(FaultKind.DROP))
    with pytest.raises(FeedbackError, match=r"10 readings lost in a row.*servo 2 \(pitch\)"):
        gimbal.run(200)


def test_07_failed_read_is_never_a_zero(rig):
    it = rig(max_losses=1000)
    for servo in it.bus.servos:
        servo.shaft.position = 3000.0
    it.start()
    it.bus.faults.add(1, ReplyFault(FaultKind.DROP, probability=0.3))
    it.run(100)
    assert it.driver._group.lost > 5
    for feedback in it.seen:
        assert feedback.joints == pytest.approx([952 / 4096 * 6.283185] * 3, abs=0.002)


@pytest.mark.parametrize("fast", ["on", "off"])
def test_08_alert_is_seen_in_group_reads(rig, fast):
    it = rig(fast_read=fast)
    it.start()
    it.servo(3).fail(1 << 0, it.clock.now_ns())  # outside the shutdown mask: an alert alone
    assert it.servo(3).is_torque_on
    with pytest.raises(DeviceFaultError, match=r"servo 3 \(roll\) reports input voltage"):
        it.run(5)


def test_09_negative_values_are_negative():
    bus, port, ph = bare()
    bus.servo(1).shaft.position = -5.0
    assert ours(bus, port, ph).read(1, X430.table.position) == -5
    block = bytes([1, 2, 0, 10]) + b"\1\0" + b"\xfe\xff" + b"\xfd\xff\xff\xff" + b"\xfb\xff\xff\xff"
    reading = decode(block)
    assert (reading.current, reading.position) == (-2, -5)
    assert reading.velocity < 0


def test_10_error_without_content_is_not_content(monkeypatch):
    bus, port, ph = bare()
    monkeypatch.setattr(bus.servo(1), "read", lambda *a: (7, b""))
    with pytest.raises(DeviceFaultError, match="servo 1 refused instruction 0x02"):
        ours(bus, port, ph).read(1, X430.table.position)


def test_10b_short_answer_to_a_group_is_a_loss(gimbal, monkeypatch):
    gimbal.run(5)
    original = gimbal.servo(2).read
    monkeypatch.setattr(gimbal.servo(2), "read", lambda a, n, t: (0, original(a, n, t)[1][:5]))
    gimbal.driver._group._is_fast = False
    before = gimbal.driver._group.lost
    gimbal.run(2)
    assert gimbal.driver._group.lost > before


@pytest.mark.parametrize("fast", ["on", "off"])
def test_10c_content_of_an_answer_with_an_error_is_no_reading(rig, monkeypatch, fast):
    it = rig(fast_read=fast)
    it.start()
    it.run(5)
    original = it.servo(2).read
    monkeypatch.setattr(it.servo(2), "read", lambda *what: (7, original(*what)[1]))
    with pytest.raises(FeedbackError, match=r"servo 2 \(pitch\): error 7 instead of a reading"):
        it.run(50)


@pytest.mark.parametrize("order", ["ZY", "ZYX"])
@pytest.mark.parametrize("fast", ["on", "off"])
@pytest.mark.parametrize("late_ms", [3, 6, 11, 16, 26, 51, 101, 201])
def test_11_late_reply_never_answers_a_later_question(rig, order, fast, late_ms):
    """While the axes turn, a reading taken for a newer one would show the wrong place."""
    it = rig(order, fast_read=fast, max_losses=1000, latency_ms=4.0)
    it.start()
    it.run(100, lambda k: [0.01 * k] * len(order))
    it.bus.faults.add(1, ReplyFault(FaultKind.DELAY, probability=0.1, delay_ns=late_ms * MS))
    it.seen.clear()
    track = []
    for k in range(150):
        it.cycle([1.0 + 0.01 * k] * len(order))
        track.append((it.clock.now_ns(), it.servo(1).shaft.position))
    # 0.01 rad a cycle are 6.5 ticks; a reading from one cycle earlier or later is allowed for.
    tracked = [feedback for feedback in it.seen if feedback.time_ns >= track[0][0]]
    assert len(tracked) > 100
    for feedback in tracked:
        ticks = 2048 + feedback.joints[0] * 4096 / 6.283185307
        near = min(track, key=lambda row: abs(row[0] - feedback.time_ns))
        assert abs(ticks - near[1]) <= 2.5 * 6.6


def test_11_late_reply_of_another_size_is_not_the_answer(monkeypatch):
    bus, port, ph = bare()
    write = port.writePort

    def write_behind(packet):
        port._input = status(1, 0, bytes(range(1, 11)))
        return write(packet)

    monkeypatch.setattr(port, "writePort", write_behind)
    it = ours(bus, port, ph)
    assert it.read(1, Register(70, 1)) == 0
    assert it.read(1, Register(132, 4)) == 2048
    it.write(1, Register(112, 4), 5)
    assert it.read(1, Register(112, 4)) == 5
    assert it.ping(1) == (1020, 48)


def test_12_goal_that_holds_a_header_is_moved_by_a_tick(rig):
    axes = [{"id": 1, "limits_deg": [-12000, 12000]}, {"id": 2, "limits_deg": [-90, 90]}]
    it = rig("ZY", axes=axes)
    it.start()
    axis = it.driver._servos[0]
    angle = axis.angle(-131_073)
    assert axis.ticks(angle) in (-131_074, -131_072)
    assert axis.ticks(axis.angle(-131_075)) == -131_075
    goal = X430.table.goal
    with pytest.raises(ValueError, match="holds a packet header"):
        it.driver._group.bus.sync_write([(1, goal, -131_073), (2, goal, 0)])


def test_13_stuffing_of_answers_is_undone_where_the_sdk_fails():
    content = b"\xff\xff\xfd\xff\xfd\xfd\x01\x02\x03\x04"
    raw = list(status(1, 0, content))
    assert _unstuffed(raw) == content


def test_13_readings_that_hold_a_header_come_through(rig):
    for fast in ("on", "off"):
        it = rig("ZY", fast_read=fast, axes=[{"id": 1, "limits_deg": [-12000, 12000]}, {"id": 2}])
        it.servo(1).shaft.position = -131_073.0
        feedback = it.start()
        it.run(20)
        assert it.driver._group.lost == 0
        assert it.seen[-1].joints[0] == pytest.approx(feedback.joints[0], abs=0.002)


def test_14_servos_with_telling_ids_are_all_read(rig):
    """Ids that equal an address or a length make the SDK's fast bulk read lose a servo."""
    axes = [{"id": 16, "model": "xm430"}, {"id": 224, "model": "xl330"}]
    it = rig("ZY", models=["xm430", "xl330"], axes=axes)
    it.bus.servos[0]._memory[7] = 16
    it.bus.servos[1]._memory[7] = 224
    it.start()
    it.run(20)
    assert it.driver._group.lost == 0


def test_15_indirect_data_of_each_model_is_where_it_is(rig):
    it = rig("ZY", models=["xm430", "xl330"])
    it.start()
    for number, address in ((1, 224), (2, 208)):
        raw = it.servo(number).read(address, len(X430.table.block), it.clock.now_ns())[1]
        assert decode(raw).position == 2048


def test_16_goals_refused_in_silence_are_noticed(gimbal):
    gimbal.run(5)
    gimbal.bus.servo(2)._memory[98] = 0xFF
    with pytest.raises(DeviceFaultError, match=r"servo 2 \(pitch\) stopped because nothing"):
        gimbal.run(5)


def test_17_lost_torque_is_noticed(gimbal):
    gimbal.run(5)
    gimbal.servo(2).write(64, b"\0", gimbal.clock.now_ns())
    with pytest.raises(DeviceFaultError, match=r"servo 2 \(pitch\) has lost its torque"):
        gimbal.run(5)


def test_18_goals_are_always_four_bytes(gimbal):
    sent, original = [], gimbal.port.writePort
    gimbal.port.writePort = lambda packet: (sent.append(bytes(packet)), original(packet))[1]
    gimbal.run(3, lambda k: [-0.01 * k, 0.01 * k, 0.0])
    goals = [packet for packet in sent if packet[7] == 0x83]
    assert len(goals) == 3
    assert all(len(packet) == 14 + 5 * 3 for packet in goals)


def test_19_broadcast_and_unicast_leave_nothing_unread(gimbal):
    gimbal.run(5)
    gimbal.driver.disable()
    assert gimbal.port.getBytesAvailable() == 0
    assert gimbal.bus.wire.due_ns() is None


@pytest.mark.parametrize(
    "error", [OSError(5, "gone"), termios.error(5, "gone"), IndexError("list index")]
)
def test_20_whatever_a_pulled_cable_raises_is_a_link_error(gimbal, monkeypatch, error):
    def raise_it(*_):
        raise error

    gimbal.run(3)
    monkeypatch.setattr(gimbal.port, "clearPort", raise_it)
    with pytest.raises(LinkError, match=re.escape(str(error))):
        gimbal.run(2)
    assert not gimbal.port.is_using


def test_21_return_delay_is_zero_and_the_adapters_timer_is_allowed_for(rig):
    it = rig(latency_ms=16.0)
    assert it.servo(1).return_delay_ns == 500_000
    it.start()
    assert it.servo(1).return_delay_ns == 0
    it.run(200)
    assert it.driver._group.lost == 0


def test_22_input_is_cleared_with_every_version_of_the_sdk(monkeypatch):
    monkeypatch.setattr(sdk.PortHandler, "clearPort", lambda port: port.ser.flush())
    device, port = os.openpty()
    theirs = sdk.PortHandler(os.ttyname(port))
    bus = open_bus(os.ttyname(port), 1_000_000)
    try:
        theirs.openPort()
        os.write(device, b"a late answer\n")
        while bus.available < 14:
            time.sleep(0)
        theirs.clearPort()
        assert bus.available == 14
        bus.clear()
        assert bus.available == 0
    finally:
        bus.close()
        theirs.closePort()
        os.close(device)
        os.close(port)


def test_23_timeouts_are_not_on_the_wall_clock(monkeypatch):
    device, port = os.openpty()
    bus = open_bus(os.ttyname(port), 1_000_000)
    try:
        monkeypatch.setattr(time, "time", lambda: 0.0)
        before = time.monotonic()
        assert bus.ping(1) is None
        # Its bytes, and what is to be allowed for the adapter.
        assert time.monotonic() - before >= 0.018
        assert bus._port.getCurrentTime() == pytest.approx(time.monotonic() * 1e3, abs=500)
    finally:
        bus.close()
        os.close(device)
        os.close(port)
