"""A gimbal from its start to its end: what is asked, retried, switched on and left."""

import math

import numpy as np
import pytest

from emulated_dynamixel import FaultKind, ReplyFault
from orientd.errors import (
    AxisFaultError,
    DeviceError,
    DeviceFaultError,
    LinkError,
)
from orientd_dynamixel.group import answer_bytes, cycle_bytes
from orientd_dynamixel.servo import Servo

MS = 1_000_000


def torques(it):
    return [servo.is_torque_on for servo in it.bus.servos]


def test_gimbal_that_is_not_enabled_is_read_every_cycle(rig):
    it = rig()
    it.driver.open()
    for k in range(20):
        it.servo(1).shaft.position = 2048.0 + k
        it.cycle(write=False)
    times = [feedback.time_ns for feedback in it.seen[2:]]
    assert set(np.diff(times)) == {it.period_ns}
    assert it.seen[-1].joints[0] == pytest.approx(18 * math.tau / 4096, abs=1e-3)


def test_reading_of_before_the_first_cycle_is_not_believed(rig):
    """The servos' clocks are known from the start."""
    it = rig(is_paced=False)
    it.driver.open()
    servo, read = it.servo(1), it.servo(1).read
    old = read(224, 16, it.clock.now_ns())
    it.clock.advance(50 * MS)
    servo.read = lambda *asked: old
    it.run(2, write=False)
    assert (it.driver._group.lost, it.seen[-1]) == (1, None)
    servo.read = read
    it.run(3, write=False)
    assert (it.driver._group.lost, it.driver._group.lost_in_a_row) == (2, 0)
    assert it.seen[-1] is not None


@pytest.mark.parametrize("what", ["enable", "disable", "free", "park", "close"])
def test_nothing_is_asked_while_an_answer_is_on_the_line(rig, what):
    it = rig()
    it.start() if what == "disable" else it.driver.open()
    it.run(3, write=what == "disable")
    assert it.driver._group.is_waiting
    collisions, collides = [], it.bus.wire.collides
    it.bus.wire.collides = lambda now_ns: (collisions.append(collides(now_ns)), collisions[-1])[1]
    getattr(it.driver, what)()
    assert collisions
    assert not any(collisions)


def test_park_is_slow(rig):
    it = rig("ZY", park_deg=[60, -20])
    it.start()
    it.driver.disable()
    times, places = [], []

    def sleep(seconds):
        it.clock.advance(round(seconds * 1e9))
        it.bus.advance(it.clock.now_ns())
        times.append(it.clock.now_ns() * 1e-9)
        places.append([servo.shaft.position for servo in it.bus.servos])

    it.driver._sleep = sleep
    it.driver.park()
    rates = np.diff(places, axis=0) / 4096 * 360 / np.diff(times)[:, None]
    assert 27 <= np.abs(rates).max() <= 32
    assert [it.value(k, "profile acceleration") for k in (1, 2)] == [3, 3]
    assert places[-1] == pytest.approx([2048 + 683, 2048 - 228], abs=1)
    assert torques(it) == [False, False]


def test_park_releases_the_torque_only_at_rest(rig):
    it = rig(at_end="release", park_deg=[10, -20, 5])
    it.start()
    it.run(200, lambda k: [np.radians(0.3 * k), np.radians(0.05 * k), np.radians(0.05 * k)])
    it.run(60)
    it.driver.disable()
    released = []
    for number in (1, 2, 3):
        servo = it.servo(number)
        write = servo.write

        def noted(address, content, now_ns, servo=servo, write=write):
            if (address, content) == (64, b"\0") and servo.is_torque_on:
                servo.advance(now_ns)
                released.append((servo.shaft.position, servo.shaft.speed))
            return write(address, content, now_ns)

        servo.write = noted
    it.driver.park()
    wanted = [2048 + angle * 4096 / 360 for angle in (10, -20, 5)]
    assert [position for position, _ in released] == pytest.approx(wanted, abs=1.0)
    assert max(abs(speed) for _, speed in released) < 20.0


def test_park_is_given_up_if_an_axis_is_held(rig):
    it = rig("ZY", park_deg=[60, -20])
    it.start()
    it.driver.disable()
    it.servo(1).shaft.jammed = True
    begun_ns = it.clock.now_ns()
    it.driver.park()
    assert it.clock.now_ns() - begun_ns == pytest.approx(20e9, rel=0.2)
    assert torques(it) == [False, False]


def test_park_that_is_not_held_does_not_set_off(rig):
    it = rig("ZY", park_deg=[60, -20])
    it.start()
    it.driver.disable()
    it.servo(1).write(64, b"\0", it.clock.now_ns())
    it.driver.park()
    it.clock.advance(1000 * MS)
    it.bus.advance(it.clock.now_ns())
    assert it.servo(2).shaft.position == 2048
    assert torques(it) == [False, False]


def test_silent_servo_keeps_no_other_from_losing_its_torque_at_the_end(rig):
    it = rig()
    it.start()
    it.driver.disable()
    it.bus.faults.add(2, ReplyFault(FaultKind.DROP))
    with pytest.raises(LinkError):
        it.driver.park()
    assert torques(it) == [False, False, False]


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize(
    ("number", "address", "answer", "why"),
    [
        (3, 64, 0, r"servo 3 \(roll\) does not switch its torque on"),
        (2, 98, 6, "beyond its limit"),  # the watchdog, once torque is on
    ],
)
def test_torque_comes_on_for_all_or_for_none(rig, held, number, address, answer, why):
    it = rig()
    it.driver.open()
    if held:
        it.servo(1).write(64, b"\1", it.clock.now_ns())
    write = it.servo(number).write
    it.servo(number).write = lambda at, content, now: (
        answer if at == address else write(at, content, now)
    )
    with pytest.raises(DeviceFaultError, match=why):
        it.driver.enable()
    assert torques(it) == [held, False, False]


def test_goal_that_a_servo_does_not_take_keeps_its_torque_off(rig):
    it = rig()
    it.driver.open()
    write = it.servo(2).write

    def wrong(at, content, now):
        found = write(at, content, now)
        if at == 64 and content[0]:
            write(116, (3000).to_bytes(4, "little"), now)
        return found

    it.servo(2).write = wrong
    with pytest.raises(DeviceFaultError, match=r"its goal 952 ticks away from where it is"):
        it.driver.enable()
    assert torques(it) == [False, False, False]


def test_load_that_hangs_on_a_goal_is_not_let_down(rig):
    """The torque is on already, and the goal is a little above the position."""
    it = rig()
    it.driver.open()
    it.servo(1).write(64, b"\1", it.clock.now_ns())
    it.servo(1).write(116, (2048 + 35).to_bytes(4, "little"), it.clock.now_ns())
    it.servo(1).shaft.jammed = True
    it.driver.enable()
    assert it.goals() == [2083, 2048, 2048]


@pytest.mark.parametrize(("asked", "kept"), [(0, 0), (20, 1), (481, 25), (500, 25)])
def test_watchdog_waits_at_least_as_long_as_asked(rig, asked, kept):
    it = rig(watchdog_ms=asked)
    it.start()
    assert it.value(1, "bus watchdog") == kept


def test_profile_is_no_faster_than_the_servo_may_be(rig):
    it = rig()
    it.servo(1).write(44, (100).to_bytes(4, "little"), it.clock.now_ns())
    it.driver.open()
    assert [it.value(k, "profile velocity") for k in (1, 2)] == [100, 193]


def test_profiles_of_another_program_are_put_right(rig):
    it = rig()
    for address in (108, 112):
        it.servo(1).write(address, (7).to_bytes(4, "little"), it.clock.now_ns())
    it.driver.open()
    assert [it.value(1, f"profile {what}") for what in ("acceleration", "velocity")] == [0, 193]


def test_others_are_read_on_when_one_has_started_again(rig):
    it = rig()
    it.start()
    it.run(5)
    it.servo(2).reboot(it.clock.now_ns(), boot_ns=0)
    with pytest.raises(AxisFaultError, match=r"servo 2 \(pitch\) has started again"):
        it.run(3)
    it.run(10)
    assert it.clock.now_ns() - it.seen[-1].time_ns <= it.period_ns
    it.servo(3).fail(1 << 0, it.clock.now_ns())
    with pytest.raises(AxisFaultError, match=r"servo 3 \(roll\) reports input voltage"):
        it.run(3)


@pytest.mark.parametrize(
    ("address", "why"), [(9, "keeps 250 at address 9, asked"), (180, "does not keep the map")]
)
def test_setting_that_is_not_taken_is_named(rig, address, why):
    it = rig()
    write = it.servo(2).write
    it.servo(2).write = lambda at, content, now: 0 if at == address else write(at, content, now)
    with pytest.raises(DeviceFaultError, match=rf"servo 2 \(pitch\) {why}"):
        it.driver.open()


def test_settings_are_written_without_torque(rig):
    it = rig()
    it.servo(1).write(9, b"\7", it.clock.now_ns())
    it.servo(1).write(64, b"\1", it.clock.now_ns())
    it.driver.open()
    assert torques(it) == [False, False, False]
    assert it.value(1, "return delay time") == 0


def test_return_level_is_set_first(rig):
    it = rig()
    it.servo(1).write(68, b"\1", it.clock.now_ns())
    it.start()
    it.run(5)
    assert it.value(1, "status return level") == 2
    assert it.driver._group.lost == 0


def test_error_that_outlives_a_reboot_is_named(rig):
    it = rig()
    servo, reboot = it.servo(2), it.servo(2).reboot
    servo.fail(1 << 2, it.clock.now_ns())
    servo.reboot = lambda now_ns: (reboot(now_ns), servo.fail(1 << 2, now_ns))
    with pytest.raises(DeviceFaultError, match="still reports overheating after a reboot"):
        it.driver.open()


def test_servo_that_does_not_come_back_is_named(rig):
    it = rig()
    servo = it.servo(2)
    servo.fail(1 << 2, it.clock.now_ns())
    servo.reboot = lambda now_ns: servo.disconnect(now_ns)
    begun_ns = it.clock.now_ns()
    with pytest.raises(LinkError, match=r"servo 2 \(pitch\) did not come back after a reboot"):
        it.driver.open()
    assert 1e9 < it.clock.now_ns() - begun_ns < 2e9


@pytest.mark.parametrize("kind", [FaultKind.DROP, FaultKind.CORRUPT, FaultKind.TRUNCATE])
def test_servo_is_asked_four_times_outside_of_the_cycle(rig, kind):
    it = rig()
    it.driver.open()
    servo = it.driver._servos[1]
    table, bus = servo.table, it.driver._group.bus
    for lost, is_told in ((3, True), (4, False)):
        for what, ask in (
            ("read of address 116", lambda: servo.get(table.goal)),
            ("write of address 112", lambda: servo.put(table.profile_velocity, 9)),
        ):
            it.bus.faults.clear()
            it.bus.faults.add(2, ReplyFault(kind, remaining=lost))
            if is_told:
                assert ask() in {2048, None}
            else:
                with pytest.raises(LinkError, match=f"servo 2 does not answer a {what}"):
                    ask()
    it.bus.faults.clear()
    it.bus.faults.add(2, ReplyFault(kind, remaining=11))
    assert servo.get(table.position, 12) == 2048
    assert bus.ping(2) == (1020, 48)


def test_silent_servos_keep_their_goals_when_the_others_stand(rig):
    """What was seen before the fault is not where an axis is in it."""
    it = rig()
    it.start()
    it.run(60, lambda k: [0.018 * min(k, 60), 0.0, 0.0])
    goals = it.goals()
    assert goals[0] - it.servo(1).shaft.position > 20
    for k in (1, 2, 3):
        it.bus.faults.add(k, ReplyFault(FaultKind.DROP))
    it.driver.rest_in_fault()
    for _ in range(60):
        try:
            it.cycle()
        except DeviceError:
            assert it.goals() == goals
    assert it.goals() == goals


@pytest.mark.parametrize("fast_read", ["on", "off"])
@pytest.mark.parametrize("silent", [(2,), (1, 2)])
def test_silent_servos_do_not_keep_the_others_from_being_seen_in_a_fault(rig, fast_read, silent):
    it = rig(fast_read=fast_read)
    it.start()
    it.run(5)
    for number in silent:
        it.bus.faults.add(number, ReplyFault(FaultKind.DROP))
    for servo in it.bus.servos:
        servo.shaft.jammed = True
        servo.shaft.position += 50.0
    for k in range(500):
        try:
            it.cycle()
        except DeviceError:
            if k > 100 and not it.driver._standing.is_at_rest:
                it.driver.rest_in_fault()
    assert it.goals() == [2048 if number in silent else 2098 for number in (1, 2, 3)]


def test_axes_that_stand_are_slow(rig):
    it = rig()
    it.start()
    it.driver.rest_in_fault()
    it.run(3)
    assert [it.value(k, "profile velocity") for k in (1, 2, 3)] == [22, 22, 22]


def test_gimbal_that_is_free_is_held_again_where_it_was_turned_to(rig):
    it = rig()
    it.start()
    it.driver.disable()
    it.driver.free()
    assert torques(it) == [False, False, False]
    assert [it.value(k, "bus watchdog") for k in (1, 2, 3)] == [0, 0, 0]
    it.run(5, write=False)
    it.servo(1).shaft.position += 100.0
    it.run(50, write=False)
    it.driver.disable()
    assert torques(it) == [True, True, True]
    assert it.goals() == [2148, 2048, 2048]


def test_bus_of_two_families_gets_the_goals_of_each_at_their_own_address(rig):
    it = rig("ZY")
    it.start()
    sent, write = [], it.port.writePort
    it.port.writePort = lambda packet: (sent.append(bytes(packet)), write(packet))[1]
    goal = it.driver._servos[0].table.goal
    it.driver._group.bus.sync_write([(1, goal, 2050), (2, goal._replace(address=564), 7)])
    assert [packet[8] | packet[9] << 8 for packet in sent] == [116, 564]
    assert [packet[12] for packet in sent] == [1, 2]


def test_goal_beyond_what_the_servo_counts_is_refused(rig):
    it = rig("ZY", axes=[{"id": 1, "limits_deg": "endless"}, {"id": 2}])
    servo = it.driver._servos[0]
    assert servo.ticks(servo.angle(1_048_575)) == 1_048_575
    with pytest.raises(ValueError, match="z cannot go to 1048576 ticks"):
        servo.ticks(servo.angle(1_048_576))


def options_of(rig, **axis):
    return rig("ZY", axes=[{"id": 1, **axis}, {"id": 2}]).driver.settings.axes[0]


def test_torqueless_servo_may_have_been_turned_by_hand_but_not_by_whole_turns(rig):
    servo = Servo(options_of(rig))
    servo.believe(2048, 0)
    for position, is_possible in ((2048 + 1500, True), (2048 + 4096, False), (2048 - 4110, False)):
        assert (not servo.doubt(position, is_driven=False)) is is_possible, position


def test_torqueless_servo_turns_no_faster_than_by_hand_while_it_is_watched(rig):
    servo = Servo(options_of(rig))
    servo.believe(2048, 9000 * MS)
    # 221 deg/s and half as much again in 20 ms, and the play of 4.7 degrees.
    for degrees, is_possible in ((10.0, True), (12.5, False), (44.0, False)):
        position = round(2048 + degrees / 360 * 4096)
        told = servo.doubt(position, is_driven=False, now_ns=9020 * MS)
        assert (not told) is is_possible, degrees
    for degrees, is_possible in ((44.0, True), (46.0, False)):
        position = round(2048 + degrees / 360 * 4096)
        told = servo.doubt(position, is_driven=False, now_ns=10_000 * MS)
        assert (not told) is is_possible, degrees


def test_driven_servo_is_between_where_it_was_seen_and_where_it_was_sent(rig):
    servo = Servo(options_of(rig))
    servo.believe(2048, 0)
    servo.goal = 2500
    servo.goal = 1900
    for position, is_possible in ((1880, True), (2520, True), (1800, False), (2600, False)):
        assert (not servo.doubt(position, is_driven=True)) is is_possible, position
    servo.believe(1950, MS)
    assert servo.doubt(2300, is_driven=True)
    assert "from its goal" in servo.doubt(1900 + 4096, is_driven=True)


@pytest.mark.parametrize("drift", [-0.005, 0.005])
def test_servo_whose_clock_drifts_is_believed_for_ever(rig, drift):
    it = rig(rate_hz=50, is_paced=False)
    it.start()
    for _ in range(2000):
        it.servo(2)._boot_ns += round(drift * it.period_ns)
        it.cycle()
    assert it.driver._group.lost == 0


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (1, "could not do it"),
        (2, "does not know the instruction"),
        (3, "arrived damaged"),
        (4, "out of range"),
        (5, "length is not that of the register"),
        (6, "beyond its limit"),
        (7, "cannot be written now"),
        (9, "error 9"),
    ],
)
def test_servo_that_refuses_says_why(rig, number, words):
    it = rig()
    it.driver.open()
    servo = it.driver._servos[1]
    it.servo(2).write = lambda at, content, now: number
    with pytest.raises(DeviceFaultError, match=rf"servo 2 refused instruction 0x03: .*{words}"):
        servo.put(servo.table.torque, 1)


def test_gaps_say_how_far_each_axis_is_from_its_goal_and_what_it_draws(rig):
    axes = [{"id": 1, "model": "xm430"}, {"id": 2, "model": "xl430-w250"}]
    it = rig("ZY", models=["xm430", "xl430-w250"], axes=axes, arrival_tolerance_deg=3)
    assert list(it.driver.gaps()) == []
    it.start()
    assert list(it.driver.gaps()) == []
    it.servo(1).shaft.jammed = True
    it.run(60, lambda k: [0.002 * k, 0.001 * k])
    yaw, pitch = it.driver.gaps()
    assert (yaw.name, pitch.name) == ("servo 1 (z)", "servo 2 (y)")
    assert yaw.gap == pytest.approx(0.118, abs=0.003)
    assert pitch.gap == pytest.approx(0.0, abs=0.01)
    assert yaw.tolerance == pytest.approx(math.radians(3))
    assert yaw.load.endswith(" A")
    assert float(yaw.load[:-2]) > 0.1
    assert pitch.load == ""


def test_bus_that_is_out_of_reach_is_not_waited_for_again(rig):
    it = rig()
    it.start()
    it.run(5)
    for k in (1, 2, 3):
        it.bus.faults.add(k, ReplyFault(FaultKind.DROP))
    with pytest.raises(LinkError):
        it.driver.disable()
    begun_ns = it.clock.now_ns()
    it.driver.disable()
    it.driver.close()
    assert it.clock.now_ns() == begun_ns
    assert not it.port.is_open


def test_every_servo_is_left_holding_though_one_is_silent(rig):
    it = rig()
    it.start()
    it.bus.faults.add(1, ReplyFault(FaultKind.DROP))
    with pytest.raises(LinkError, match="servo 1 does not answer"):
        it.driver.disable()
    assert [it.value(k, "bus watchdog") for k in (1, 2, 3)] == [25, 0, 0]


def test_health_is_judged_once_a_look(rig):
    it = rig()
    it.start()
    it.run(3)
    first = it.driver.health()
    assert it.driver.health() is first
    it.run(110)
    assert it.driver.health()[0].time_ns - first[0].time_ns == pytest.approx(500 * MS, rel=0.02)


def test_health_of_before_a_reset_is_told_until_there_is_new(rig):
    it = rig()
    assert it.driver.health() == ()
    it.start()
    assert it.driver.health() == ()
    it.run(3)
    before = it.driver.health()
    it.driver.disable()
    it.driver.reset()
    assert it.driver.health() is before
    it.driver.enable()
    it.run(3)
    assert it.driver.health()[0].time_ns > before[0].time_ns


def test_a_second_port_is_not_opened_while_the_first_is(rig):
    it = rig()
    it.start()
    closed = []
    close = it.port.closePort
    it.port.closePort = lambda: (closed.append(it.port.is_open), close())[1]
    it.driver.reset()
    assert closed == [True]
    it.driver.close()
    assert closed == [True, True]
    it.driver.close()
    assert closed == [True, True]


def test_torque_is_left_alone_by_a_start(rig):
    """A gimbal that holds goes on holding while it is opened again."""
    it = rig()
    it.start()
    it.driver.close()
    it.driver.open()
    assert torques(it) == [True, True, True]
    it.driver.enable()
    assert it.goals() == [2048, 2048, 2048]


@pytest.mark.parametrize("fast_read", ["on", "off"])
def test_answer_within_the_latency_is_awaited(rig, fast_read):
    it = rig(rate_hz=100, latency_ms=16.0, fast_read=fast_read)
    it.start()
    it.run(5)
    it.bus.faults.add(3, ReplyFault(FaultKind.DELAY, delay_ns=12 * MS))
    it.run(50)
    assert it.driver._group.lost == 0
    assert it.clock.now_ns() - it.seen[-1].time_ns <= 3 * it.period_ns


def test_feedback_is_new_only_with_a_new_reading(rig):
    it = rig()
    it.start()
    it.run(3)
    first = it.driver.read()
    assert it.driver.read() is first
    it.run(1)
    assert it.driver.read() is not first


def test_bytes_of_a_cycle_are_those_of_the_protocol():
    """A goal of 5 bytes each after 14, a request of 14 and an id each, the answers."""
    assert cycle_bytes(3, is_fast=False) == 29 + 17 + 3 * 27
    assert cycle_bytes(3, is_fast=True) == 29 + 17 + 8 + 3 * 20
    assert answer_bytes(2, is_fast=True, size=10) == 36
