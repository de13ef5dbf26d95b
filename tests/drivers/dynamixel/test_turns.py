"""Whole turns outlive a power cut and the process, or are said not to be known."""

import math
import random

import pytest

from orientd.errors import DeviceFaultError
from orientd_dynamixel.axes import Turns
from orientd_dynamixel.axis import Axis
from orientd_dynamixel.options import parse

AXES = [{"id": 1, "limits_deg": [-720, 720]}, {"id": 2, "limits_deg": [-90, 90]}]


def started(rig, file):
    it = rig("ZY", axes=AXES, turns_file=str(file), rate_hz=100)
    it.start()
    return it


def turn_to(it, degrees):
    yaw = it.driver._tracker.angles[0]
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
            found = math.degrees(it.driver.enable().joints[0])
        except DeviceFaultError as error:
            assert abs(by_hand) > 30
            assert "were seen last" in str(error)  # noqa: PT017
            cut_power(it, by_hand=-by_hand)
            it.driver.reset()
            found, by_hand = math.degrees(it.driver.enable().joints[0]), 0.0
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
    assert math.degrees(it.driver.enable().joints[0]) == pytest.approx(100, abs=1.0)


def test_axis_of_one_turn_needs_no_memory(rig, tmp_path):
    it = rig("ZY", axes=[{"id": 1, "limits_deg": [-170, 170]}, AXES[1]], rate_hz=100,
             turns_file=str(tmp_path / "turns"))  # fmt: skip
    it.start()
    turn_to(it, 160)
    cut_power(it, by_hand=-150)
    it.driver.disable()
    it.driver.reset()
    assert math.degrees(it.driver.enable().joints[0]) == pytest.approx(10, abs=1.0)


def test_file_has_its_room_on_the_disk_before_anything_is_noted(tmp_path):
    options = parse(
        {"port": "none", "order": "ZY", "axes": AXES, "turns_file": f"{tmp_path}/turns"}
    )
    turns = Turns(options, [Axis(axis) for axis in options.axes])
    turns.open()
    turns.close()
    # A hole would have none, and the process be ended by a signal where the disk is full.
    assert (tmp_path / "turns").stat().st_blocks > 0


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
            with pytest.raises(DeviceFaultError, match=rf"servo 2 .* has {name} 4;"):
                it.driver.open()
            assert it.servo(2).value(name) == 4
        else:
            it.driver.open()
            assert it.servo(2).value(name) == 0
