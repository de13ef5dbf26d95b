"""One emulated servo: its table, what it refuses, how it moves, what stops it."""

from itertools import pairwise

import pytest

from emulated_dynamixel.motion import TICKS_PER_RADIAN
from emulated_dynamixel.packet import ALERT, ErrorNumber
from emulated_dynamixel.servo import EmulatedServo, Lie
from emulated_dynamixel.table import XL330_M288

TURN_LIMIT = 1_048_575

MS = 1_000_000
S = 1_000_000_000


def signed(value, size=4):
    return (value & ((1 << 8 * size) - 1)).to_bytes(size, "little")


def put(servo, address, value, size, now=0):
    return servo.write(address, signed(value, size), now)


def number(servo, address, size, now=0):
    error, raw = servo.read(address, size, now)
    assert error == 0
    return int.from_bytes(raw, "little", signed=True)


@pytest.fixture
def servo():
    it = EmulatedServo(1)
    assert put(it, 11, 4, 1) == 0
    assert put(it, 64, 1, 1) == 0
    return it


EXTENDED = [(11, 4, 1), (64, 1, 1)]
"""Writes, each an address, a value and its size, that switch a servo on in the extended mode."""

REFUSED = [
    # the writes before, the address, what is written there, and the error
    ([], 9, b"\0", ErrorNumber.NONE),
    (EXTENDED, 9, b"\0", ErrorNumber.ACCESS),  # the EEPROM is closed while torque is on
    ([*EXTENDED, (64, 0, 1)], 9, b"\0", ErrorNumber.NONE),
    (EXTENDED, 132, signed(0), ErrorNumber.ACCESS),  # can only be read
    (EXTENDED, 662, b"\0", ErrorNumber.ACCESS),  # beyond the end
    (EXTENDED, 116, b"\0\0", ErrorNumber.DATA_LENGTH),  # part of a register
    (EXTENDED, 116, signed(-TURN_LIMIT), ErrorNumber.NONE),
    (EXTENDED, 116, signed(-TURN_LIMIT - 1), ErrorNumber.DATA_RANGE),
    ([(48, 3000, 4), (64, 1, 1)], 116, signed(3000), ErrorNumber.NONE),
    ([(48, 3000, 4), (64, 1, 1)], 116, signed(3001), ErrorNumber.DATA_LIMIT),
    (EXTENDED, 104, signed(201), ErrorNumber.DATA_LIMIT),
    # the block of indirect addresses
    ([(168, 116, 2)], 224, b"\0", ErrorNumber.DATA_LENGTH),
    ([], 168, signed(661, 2), ErrorNumber.NONE),
    ([], 168, signed(662, 2), ErrorNumber.DATA_RANGE),
    ([], 168, signed(63, 2), ErrorNumber.DATA_RANGE),  # in the EEPROM
    *(
        ([], 11, bytes([mode]), 0 if mode in (0, 1, 3, 4, 5, 16) else ErrorNumber.DATA_RANGE)
        for mode in range(17)
    ),
]


@pytest.mark.parametrize(("before", "address", "content", "error"), REFUSED)
def test_a_write_has_the_error_of_the_control_table(before, address, content, error):
    servo = EmulatedServo(1)
    for one in before:
        assert put(servo, *one) == 0
    assert servo.write(address, content, 0) == error


def test_the_table_of_a_small_model_is_shorter():
    servo = EmulatedServo(1, XL330_M288)
    assert put(servo, 168, 227, 2) == 0
    assert put(servo, 168, 228, 2) == ErrorNumber.DATA_RANGE
    assert EmulatedServo(1).read(660, 8, 0) == (ErrorNumber.ACCESS, b"")


READ = [
    # the writes before, the address, its size, when it is read, its value, and how nearly
    ([(20, 100, 4)], 132, 4, 0, 2148, 0),  # the homing offset
    ([*EXTENDED, (98, 5, 1), (64, 0, 1)], 98, 1, S, 5, 0),  # the watchdog waits without torque
    ([(108, 5, 4), (11, 4, 1)], 108, 4, 0, 0, 0),  # a new mode resets profile and goals
    ([(112, 6, 4), (11, 4, 1)], 112, 4, 0, 0, 0),
    ([(102, 7, 2), (11, 4, 1)], 102, 2, 0, 1193, 0),
    ([(36, 500, 2), (11, 4, 1)], 36, 2, 0, 885, 0),  # and lifts the limit of PWM
    ([(36, 500, 2), (11, 4, 1)], 100, 2, 0, 885, 0),
    (EXTENDED, 120, 2, 1234 * MS, 1234, 0),  # milliseconds since the boot, which wrap
    (EXTENDED, 120, 2, 32_769 * MS, 1, 0),
    ([(11, 1, 1), (64, 1, 1), (104, 100, 4)], 128, 4, S, 100, 1),  # the modes of speed
    ([(11, 16, 1), (64, 1, 1), (100, 442, 2)], 128, 4, S, 100, 1),
    ([(38, 0, 2), (11, 0, 1), (64, 1, 1)], 128, 4, S, 0, 0),  # no current, no turn
    ([(38, 0, 2), (11, 5, 1), (64, 1, 1)], 128, 4, S, 0, 0),
    ([(11, 1, 1), (64, 1, 1), (104, 9, 4)], 122, 1, S, 0, 0),  # moving, above a threshold
    ([(11, 1, 1), (64, 1, 1), (104, 12, 4)], 122, 1, S, 1, 0),
]


@pytest.mark.parametrize(("before", "address", "size", "now", "value", "within"), READ)
def test_a_register_reads_what_the_writes_have_made_of_it(
    before, address, size, now, value, within
):
    servo = EmulatedServo(1)
    for one in before:
        assert put(servo, *one) == 0
    assert number(servo, address, size, now) == pytest.approx(value, abs=within)


def test_torque_on_takes_the_present_position_as_goal():
    servo = EmulatedServo(1)
    servo.shaft.position = 1234.0
    put(servo, 64, 1, 1)
    assert number(servo, 116, 4) == 1234


def test_write_of_several_registers_is_whole_or_nothing(servo):
    assert servo.write(112, signed(100) + signed(TURN_LIMIT + 1), 0) == ErrorNumber.DATA_RANGE
    assert number(servo, 112, 4) == 0


def test_indirect_block_reads_and_writes_through():
    servo = EmulatedServo(1)
    for k, target in enumerate([70, *range(126, 136), *range(116, 120)]):
        assert put(servo, 168 + 2 * k, target, 2) == 0
    put(servo, 11, 4, 1)
    put(servo, 64, 1, 1)
    assert servo.read(224, 11, 0) == (0, b"\0" * 7 + signed(2048))
    assert servo.write(235, signed(-5), 0) == 0
    assert number(servo, 116, 4) == -5


def test_step_follows_the_first_order_lag(servo):
    put(servo, 116, 2058, 4)
    assert number(servo, 132, 4, 20 * MS) == pytest.approx(2048 + 10 * (1 - 0.3679), abs=0.5)
    assert number(servo, 132, 4, S) == 2058


def test_speed_never_exceeds_the_no_load_speed(servo):
    put(servo, 116, 100_000, 4)
    first, second = number(servo, 132, 4, S), number(servo, 132, 4, 2 * S)
    assert second - first == pytest.approx(4.817 * TICKS_PER_RADIAN, rel=1e-3)
    assert number(servo, 128, 4, 2 * S) == pytest.approx(200.9, abs=1)


def test_profile_keeps_its_speed_and_acceleration(servo):
    put(servo, 108, 10, 4)
    put(servo, 112, 50, 4)
    put(servo, 116, 2048 + 4096, 4)
    speeds = [number(servo, 136, 4, k * 10 * MS) for k in range(700)]
    assert max(speeds) == 50
    # 10 units are 214.6 deg/s^2, 156.2 speed units/s
    assert max(b - a for a, b in pairwise(speeds)) <= 2
    assert number(servo, 132, 4, 7 * S) == 2048 + 4096
    assert speeds[-1] == 0


def test_time_based_profile_takes_its_time(servo):
    put(servo, 64, 0, 1)
    put(servo, 10, 4, 1)
    put(servo, 64, 1, 1)
    put(servo, 108, 250, 4)
    put(servo, 112, 1000, 4)
    put(servo, 116, 3048, 4)
    assert number(servo, 140, 4, 500 * MS) == pytest.approx(2548, abs=5)
    assert number(servo, 140, 4, 980 * MS) < 3048
    assert number(servo, 140, 4, 1010 * MS) == 3048


def test_motion_does_not_depend_on_how_often_it_is_looked_at(servo):
    other = EmulatedServo(1)
    for it in (servo, other):
        put(it, 64, 0, 1)
        put(it, 11, 4, 1)
        put(it, 64, 1, 1)
        put(it, 112, 30, 4)
        put(it, 116, 5000, 4)
    for k in range(300):
        servo.advance(k * MS)
    other.advance(299 * MS)
    assert servo.shaft.position == other.shaft.position


def test_turns_are_counted_in_extended_mode_and_lost_at_reboot(servo):
    put(servo, 116, 10_000, 4)
    assert number(servo, 132, 4, 5 * S) == 10_000
    servo.reboot(5 * S)
    assert not servo.is_listening(5 * S + 299 * MS)
    assert servo.is_listening(5 * S + 300 * MS)
    assert number(servo, 132, 4, 6 * S) == 10_000 % 4096
    assert number(servo, 64, 1, 6 * S) == 0


def test_clear_forgets_turns_only_at_rest(servo):
    put(servo, 116, 10_000, 4)
    assert servo.clear_turns(500 * MS) == ErrorNumber.RESULT_FAIL
    assert servo.clear_turns(5 * S) == 0
    assert number(servo, 132, 4, 5 * S) == 10_000 % 4096


def test_torque_on_in_position_mode_loses_turns():
    servo = EmulatedServo(1)
    servo.shaft.position = 5000.0
    put(servo, 64, 1, 1)
    assert number(servo, 132, 4) == 904


def test_watchdog_stops_the_servo_and_refuses_goals_until_it_is_cleared(servo):
    put(servo, 98, 5, 1)
    put(servo, 116, 50_000, 4)
    servo.feed_watchdog(0)
    moving = number(servo, 132, 4, 99 * MS)
    assert moving > 2300
    stopped = number(servo, 132, 4, 300 * MS)
    assert number(servo, 132, 4, S) == stopped
    assert number(servo, 98, 1, S) == -1
    assert put(servo, 116, 2048, 4, S) == ErrorNumber.DATA_RANGE
    assert put(servo, 98, 0, 1, S) == 0
    assert put(servo, 116, 2048, 4, S) == 0


def test_error_in_the_shutdown_mask_switches_torque_off_until_reboot(servo):
    servo.fail(1 << 2, 0)
    assert servo.error_bits == ALERT
    assert number(servo, 64, 1) == 0
    assert put(servo, 64, 1, 1) == 0
    assert number(servo, 64, 1) == 0
    servo.reboot(0)
    assert servo.error_bits == 0


def test_error_outside_the_mask_alerts_only(servo):
    servo.fail(1 << 0, 0)
    assert servo.error_bits == ALERT
    assert servo.is_torque_on


def test_jam_becomes_an_overload_after_a_second(servo):
    servo.shaft.jammed = True
    put(servo, 116, 3000, 4)
    servo.advance(900 * MS)
    assert servo.is_torque_on
    servo.advance(1100 * MS)
    assert not servo.is_torque_on
    assert servo.value("hardware error status") == 1 << 5
    assert round(servo.shaft.position) == 2048


def test_load_slows_the_servo(servo):
    servo.shaft.load = 0.5
    put(servo, 116, 100_000, 4)
    first, second = number(servo, 132, 4, S), number(servo, 132, 4, 2 * S)
    assert second - first == pytest.approx(4.817 / 2 * TICKS_PER_RADIAN, rel=1e-3)


def test_factory_reset_keeps_what_it_is_told_to_keep():
    for option, kept in ((0xFF, (1, 1)), (1, (7, 1)), (2, (7, 3))):
        servo = EmulatedServo(7)
        servo.factory_reset(option, 0)
        assert (servo.id, servo.baud_index) == kept


def test_time_based_profile_ramps_for_as_long_as_it_is_told(servo):
    put(servo, 64, 0, 1)
    put(servo, 10, 4, 1)
    put(servo, 64, 1, 1)
    put(servo, 108, 400, 4)
    put(servo, 112, 1000, 4)
    put(servo, 116, 2048 + 600, 4)
    speeds = [servo.shaft.reference_speed for k in range(500) if not servo.advance(k * 2 * MS)]
    assert max(speeds) == pytest.approx(600 / (1.0 - 0.4), rel=0.01)
    assert speeds[100] == pytest.approx(max(speeds) / 2, rel=0.02)  # after half the ramp


def test_watchdog_in_velocity_mode_sets_the_goal_to_zero():
    servo = EmulatedServo(1)
    put(servo, 11, 1, 1)
    put(servo, 64, 1, 1)
    put(servo, 98, 5, 1)
    put(servo, 104, 100, 4)
    assert number(servo, 128, 4, 90 * MS) > 90
    assert number(servo, 104, 4, 300 * MS) == 0
    assert number(servo, 128, 4, 600 * MS) == 0


def test_a_stalled_servo_overloads_only_if_it_wants_to_turn(servo):
    servo.shaft.load = 1.0
    servo.advance(3 * S)
    assert servo.is_torque_on
    put(servo, 116, 4000, 4, 3 * S)
    servo.advance(5 * S)
    assert not servo.is_torque_on


def test_effort_has_the_sign_of_the_motion_and_the_size_of_the_load(servo):
    assert number(servo, 126, 2) == number(servo, 124, 2) == 0
    servo.shaft.load = 0.5
    for goal, sign in ((100_000, 1), (-100_000, -1)):
        put(servo, 116, goal, 4)
        servo.advance(S)
        assert number(servo, 126, 2, S) == sign * 1193
        assert number(servo, 124, 2, S) == sign * 885
    put(servo, 116, number(servo, 132, 4, S), 4, S)
    assert abs(number(servo, 124, 2, 3 * S)) == pytest.approx(885 * 0.5, abs=1)
    put(servo, 64, 0, 1, 3 * S)
    assert number(servo, 126, 2, 3 * S) == 0


def test_the_trajectory_of_a_motor_that_is_off_is_where_it_is_turned_by_hand():
    servo = EmulatedServo(1)
    servo.shaft.turn(500.0, 0.5)
    assert number(servo, 140, 4, S) == number(servo, 132, 4, S) == 2548


@pytest.mark.parametrize(("remaining", "readings"), [(2, [2148, 2148, 2048]), (None, [2148] * 3)])
def test_a_lie_is_told_as_often_as_asked(servo, remaining, readings):
    servo.lie = Lie(100, remaining=remaining)
    assert [number(servo, 132, 4) for _ in range(3)] == readings


def test_a_lie_is_told_at_one_position_alone(servo):
    servo.lie = Lie(100, at=2048)
    assert number(servo, 132, 4) == 2148
    servo.shaft.position = 2050.0
    assert number(servo, 132, 4) == 2050


def test_a_new_mode_has_the_present_position_as_its_goal():
    servo = EmulatedServo(1)
    servo.shaft.position = 3000.0
    put(servo, 11, 4, 1)
    assert number(servo, 116, 4) == 3000


def test_in_current_mode_half_the_current_is_half_the_speed():
    servo = EmulatedServo(1)
    put(servo, 11, 0, 1)
    put(servo, 64, 1, 1)
    put(servo, 102, 597, 2)
    half = number(servo, 128, 4, S)
    put(servo, 102, 1193, 2, S)
    assert number(servo, 128, 4, 2 * S) == pytest.approx(2 * half, abs=2)


def test_a_servo_without_its_cable_stops_where_it_is(servo):
    put(servo, 116, 100_000, 4)
    servo.disconnect(S)
    assert not servo.is_torque_on
    assert servo.shaft.position == pytest.approx(2048 + 4.817 * TICKS_PER_RADIAN, rel=0.03)
    assert number(servo, 128, 4, S) == 0
    stopped = servo.shaft.position
    servo.advance(3 * S)
    assert servo.shaft.position == stopped


def test_a_servo_that_has_arrived_has_no_speed(servo):
    put(servo, 116, 2100, 4)
    servo.advance(3 * S)
    assert (servo.shaft.position, servo.shaft.speed) == (2100.0, 0.0)


@pytest.mark.parametrize(("attribute", "value", "bit"), [("supply", 90, 0), ("supply", 170, 0),
                                                         ("temperature", 81, 2)])  # fmt: skip
def test_supply_and_heat_beyond_their_limits_are_errors(servo, attribute, value, bit):
    servo.advance(S)
    assert servo.value("hardware error status") == 0
    setattr(servo, attribute, value)
    servo.advance(2 * S)
    assert servo.value("hardware error status") == 1 << bit
    assert servo.error_bits == ALERT
    assert servo.is_torque_on == (bit == 0)  # heat is in the shutdown mask, the supply is not
