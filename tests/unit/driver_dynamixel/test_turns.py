"""Whole turns outlive a power cut and the process, or are said not to be known."""

import math
import os
import random

import pytest

from orientd.errors import DeviceFaultError
from orientd_dynamixel.options import parse
from orientd_dynamixel.servo import Servo
from orientd_dynamixel.turns import Turns

AXES = [{"id": 1, "limits_deg": [-720, 720]}, {"id": 2, "limits_deg": [-90, 90]}]


def started(rig, file):
    it = rig("ZY", axes=AXES, turns_file=str(file), rate_hz=100)
    it.start()
    return it


def turn_to(it, degrees):
    yaw = it.joints[0]
    steps = max(1, math.ceil(abs(math.radians(degrees) - yaw) / 0.035))
    for k in range(1, steps + 1):
        it.cycle([yaw + (math.radians(degrees) - yaw) * k / steps, 0.0])
    it.run(30)


def cut_power(it, *, by_hand=0.0):
    """Take the supply away, turn yaw *by_hand* degrees, and give it back."""
    servo = it.servo(1)
    servo.disconnect(it.clock.now_ns())
    servo.shaft.position += by_hand * 4096 / 360
    servo.connect(it.clock.now_ns())
    it.clock.advance(1_000_000_000)


def next_process(it, rig, file):
    """Return a rig with a driver of its own on the servos of *it*."""
    other = rig("ZY", axes=AXES, turns_file=str(file), rate_hz=100)
    other.bus.servos[:] = it.bus.servos
    other.clock.advance(it.clock.now_ns() + 10_000_000_000 - other.clock.now_ns())
    other.driver.open()
    return other


@pytest.mark.parametrize("rounds", [8, pytest.param(50, marks=pytest.mark.slow)])
def test_turns_are_known_or_refused_after_a_power_cut_at_any_winding(rig, tmp_path, rounds):
    generator, known = random.Random(5), 0
    it = started(rig, tmp_path / "turns")
    at = 0.0
    for number in range(rounds):
        at = min(600.0, max(-600.0, at + generator.uniform(-200, 200)))
        turn_to(it, at)
        by_hand = generator.choice([0.0, generator.uniform(-15, 15), generator.uniform(-170, 170)])
        cut_power(it, by_hand=by_hand)
        it = next_process(it, rig, tmp_path / "turns")
        try:
            found = math.degrees(it.enable().joints[0])
        except DeviceFaultError as error:
            assert abs(by_hand) > 30
            assert "were seen last" in str(error)  # noqa: PT017
            cut_power(it, by_hand=-by_hand)
            it.driver.reset()
            found, by_hand = math.degrees(it.enable().joints[0]), 0.0
        else:
            known += 1
        assert found == pytest.approx(at + by_hand, abs=1.0), number
        at += by_hand
    assert known > rounds // 2


def test_servo_that_kept_its_power_is_believed_however_far_it_was_turned(rig, tmp_path):
    it = started(rig, tmp_path / "turns")
    turn_to(it, 400)
    cut_power(it)
    it = next_process(it, rig, tmp_path / "turns")
    it.driver.enable()
    it.servo(1).write(64, b"\0", it.clock.now_ns())
    it.servo(1).shaft.position -= 300 * 4096 / 360
    it = next_process(it, rig, tmp_path / "turns")
    assert math.degrees(it.enable().joints[0]) == pytest.approx(100, abs=1.0)


def turned_without_power(rig, tmp_path, limit, at, by_hand):
    """Return a gimbal whose yaw stood *at*, was turned *by_hand* without power, and was reset."""
    axes = [{"id": 1, "limits_deg": [-limit, limit]}, AXES[1]]
    it = rig("ZY", axes=axes, rate_hz=100, turns_file=str(tmp_path / "turns"))
    it.start()
    turn_to(it, at)
    cut_power(it, by_hand=by_hand)
    it.driver.disable()
    it.driver.reset()
    return it


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    ("limit", "at", "by_hand"),
    [(180, 170, 46), (270, 250, 46), (90, 80, 300), (170, 160, -150), (270, 0, 47), (90, 0, -50)],
)
def test_turn_that_may_be_lost_is_never_guessed(rig, tmp_path, side, limit, at, by_hand):
    it = turned_without_power(rig, tmp_path, limit, side * at, side * by_hand)
    with pytest.raises(DeviceFaultError, match="were seen last; turn it by hand to within 45 deg"):
        it.driver.enable()
    assert not it.servo(1).is_torque_on


@pytest.mark.parametrize("side", [1, -1])
def test_axis_that_was_turned_a_little_beyond_its_limit_is_refused_by_that(rig, tmp_path, side):
    it = turned_without_power(rig, tmp_path, 180, side * 170, side * 44)
    with pytest.raises(
        DeviceFaultError, match=r"z would be at -?21[34]\.\d+ deg, allowed are -180"
    ):
        it.driver.enable()


@pytest.mark.parametrize("seed", range(int(os.environ.get("ORIENTD_CASES", "40"))))
def test_angle_is_right_or_refused_wherever_it_was_turned(rig, tmp_path, seed):
    generator = random.Random(seed)
    limit = generator.choice([90, 170, 180, 270, 400, 720])
    at = generator.uniform(-limit, limit)
    by_hand = generator.choice([generator.uniform(-44, 44), generator.uniform(-400, 400)])
    it = turned_without_power(rig, tmp_path, limit, at, by_hand)
    try:
        found = math.degrees(it.enable().joints[0])
    except DeviceFaultError:
        is_inside = -limit < at + by_hand < limit
        # Whole turns away it stands where it was, for all that anybody can tell.
        assert abs(by_hand) > 44 or not is_inside
    else:
        turns = round(by_hand / 360)
        assert abs(by_hand - 360 * turns) < 46
        assert found == pytest.approx(at + by_hand - 360 * turns, abs=1.0)


def test_file_has_its_room_on_the_disk_before_anything_is_noted(tmp_path):
    options = parse(
        {"port": "none", "order": "ZY", "axes": AXES, "turns_file": f"{tmp_path}/turns"}
    )
    turns = Turns(options, [Servo(axis) for axis in options.axes])
    turns.open()
    turns.close()
    # A hole would have none, and the process be ended by a signal where the disk is full.
    assert (tmp_path / "turns").stat().st_blocks > 0


def test_whoever_deletes_the_file_begins_anew(rig, tmp_path):
    it = turned_without_power(rig, tmp_path, 720, 400, 100)
    with pytest.raises(DeviceFaultError, match=r"delete .*turns, then reset"):
        it.driver.enable()
    (tmp_path / "turns").unlink()
    it.driver.disable()
    it.driver.reset()
    assert math.degrees(it.driver.enable().joints[0]) == pytest.approx(140, abs=1.0)


@pytest.mark.parametrize("how", ["reset", "another process"])
def test_turns_that_are_unknown_stay_so_until_the_axis_is_turned_back(rig, tmp_path, how):
    it = turned_without_power(rig, tmp_path, 720, 400, 100)
    for _ in range(2):
        it.run(50, write=False)
        if how == "reset":
            it.driver.disable()
            it.driver.reset()
        else:
            it.driver.close()
            it = next_process(it, rig, tmp_path / "turns")
        with pytest.raises(DeviceFaultError, match=r"400\.\d deg were seen last; turn it by hand"):
            it.driver.enable()
    it.servo(1).shaft.position -= 80 * 4096 / 360
    it.driver.disable()
    it.driver.reset()
    assert math.degrees(it.driver.enable().joints[0]) == pytest.approx(420, abs=1.0)


def test_file_of_another_gimbal_is_not_believed(rig, tmp_path):
    it = started(rig, tmp_path / "turns")
    turn_to(it, 400)
    it.driver.close()
    other = rig("ZY", axes=[{**AXES[0], "id": 2}, {**AXES[1], "id": 1}],
                turns_file=str(tmp_path / "turns"))  # fmt: skip
    assert other.start().joints == pytest.approx((0.0, 0.0), abs=0.01)


@pytest.mark.parametrize("moved", [0.0, 43.0, -43.0])
def test_turns_without_a_file_are_known_as_long_as_the_process_lives(rig, moved):
    it = rig("ZY", axes=AXES, turns_file="", rate_hz=100)
    it.start()
    turn_to(it, 500)
    cut_power(it, by_hand=moved)
    it.driver.disable()
    it.driver.reset()
    assert math.degrees(it.driver.enable().joints[0]) == pytest.approx(500 + moved, abs=1.0)


def test_file_that_cannot_be_written_is_named(rig, tmp_path):
    it = rig("ZY", axes=AXES, turns_file=str(tmp_path))
    with pytest.raises(DeviceFaultError, match=r"cannot be remembered in .*turns_file"):
        it.driver.open()


@pytest.mark.parametrize(
    ("name", "address", "size"), [("homing offset", 20, 4), ("drive mode", 10, 1)]
)
def test_settings_of_a_servo_are_not_overwritten_unasked(rig, name, address, size):
    for may, is_refused in ((["operating_mode"], True), (True, False)):
        it = rig("ZY", axes=AXES, overwrite=may)
        it.servo(2).write(address, (4).to_bytes(size, "little"), it.clock.now_ns())
        if is_refused:
            with pytest.raises(DeviceFaultError, match=rf"^servo 2 [^;]* has {name} 4;"):
                it.driver.open()
            assert it.servo(2).value(name) == 4
        else:
            it.driver.open()
            assert it.servo(2).value(name) == 0
