"""Shafts that cannot get where they are sent, and servos that start again in the middle."""

import math

import numpy as np
import pytest
from rig import PERIOD, TERMS
from watched_gimbal import DEGREE, Watched, turning

from orientd.errors import Fault
from orientd.stream.records import Answer, Command, CycleFlag, ServoState

AXES = [{"id": k, "limits_deg": [-179, 179]} for k in (1, 2, 3)]


def moving(rig, gimbal_loop, degrees, *, to=2048, **options):
    """Return a loop that is about to turn yaw by *degrees* to the tick *to*, in a second."""
    it = Watched(rig, gimbal_loop, [to - degrees * DEGREE, 2048, 2048], axes=AXES, **options)
    it.open()
    it.low[0], it.high[0] = -1e9, 1e9
    assert it.ask(Command.ENABLE)[0] is Answer.DONE
    path = turning(it.loop.driver, 0, math.radians(degrees))
    it.loop.ask(Command.START, path_index=it.loop.lay(*path))
    return it


@pytest.mark.parametrize("behind", [6.1, 3.0, -3.0])
def test_motion_that_a_stop_keeps_from_its_end_is_a_fault_that_says_by_how_much(
    rig, gimbal_loop, behind
):
    stop = 3981 if behind > 0 else 113
    it = moving(rig, gimbal_loop, math.copysign(40, behind), to=round(stop + behind * DEGREE))
    it.gimbal.servo(1).shaft.stops = (113.0, 3981.0)
    it.run(500)
    assert it.loop.cycle.flags & CycleFlag.ARRIVING or it.state is ServoState.FAULT
    it.run(350)
    setpoints = it.loop.servo.setpoints
    assert setpoints.fault is Fault.DEVICE_FAULT
    assert (
        f"servo 1 (z) has not arrived: it is {abs(behind):.1f} deg behind" in setpoints.fault_text
    )
    assert " A; is it blocked" in setpoints.fault_text
    # It presses against the stop no longer, so it does not switch itself off.
    it.run(1000)
    assert abs(it.gimbal.goals()[0] - stop) < 0.5 * DEGREE
    assert it.gimbal.servo(1).is_torque_on


def test_motion_is_done_once_the_servo_is_within_its_tolerance(rig, gimbal_loop):
    it = moving(rig, gimbal_loop, 40.0)
    it.loop.run_until(lambda servo: servo.state is ServoState.HOLDING)
    it.loop.run_until(lambda _: not it.loop.cycle.flags & CycleFlag.ARRIVING)
    assert abs(it.positions()[0] - 2048) < 2.0 * DEGREE + 3
    it.run(400)
    assert it.state is ServoState.HOLDING


def test_tolerance_of_arrival_is_an_option(rig, gimbal_loop):
    it = moving(rig, gimbal_loop, 40.0, to=3981 + 60, arrival_tolerance_deg=7)
    it.gimbal.servo(1).shaft.stops = (113.0, 3981.0)
    it.run(780)
    assert it.state is ServoState.HOLDING
    assert not it.loop.cycle.flags & CycleFlag.ARRIVING


def braking(goals):
    """Return the largest acceleration of an axis, rad/s^2, over a fiftieth of a second.

    Rounding to ticks makes up to 8 of it.
    """
    some = np.array(goals)[::10] * math.tau / 4096
    return np.abs(np.diff(some, 2)).max() / (10 * PERIOD) ** 2


@pytest.mark.parametrize("boot_ms", [0, 40, 300])
@pytest.mark.parametrize("kind", ["restart", "overload"])
def test_others_brake_on_the_path_when_one_servo_starts_again(rig, gimbal_loop, kind, boot_ms):
    it = moving(rig, gimbal_loop, 60.0)
    goals = []
    for k in range(900):
        if k == 250:
            servo, now_ns = it.gimbal.servo(3), it.gimbal.clock.now_ns()
            if kind == "overload":
                servo.fail(1 << 5, now_ns)
            else:
                servo.reboot(now_ns, boot_ns=boot_ms * 1_000_000)
        it.loop.run(1)
        goals.append(it.gimbal.goals()[0])
    assert it.loop.servo.setpoints.fault in {Fault.DEVICE_FAULT, Fault.FEEDBACK_STALE}
    if boot_ms < 20 or kind == "overload":
        assert it.loop.servo.setpoints.fault is Fault.DEVICE_FAULT
        assert "servo 3 (x)" in it.loop.servo.setpoints.fault_text
    assert braking(goals) < TERMS.acceleration + 8.0
    assert braking(goals[250:]) > 3.0
    assert abs(it.positions()[0] - goals[-1]) < 2
