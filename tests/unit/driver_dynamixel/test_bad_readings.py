"""Servos that report where they are not: no goal comes from that, so nothing moves by it."""

import math
import os
import random

import numpy as np
import pytest
from rig import PERIOD_NS
from watched_gimbal import DEGREE, SLACK, TURN, Watched, turning

from emulated_dynamixel import FaultKind, Lie, ReplyFault
from orientd.errors import DeviceFaultError, Fault
from orientd.stream.records import Answer, Command, ServoState

CASES = int(os.environ.get("ORIENTD_CASES", "6"))

MOMENTS = ("open", "enable", "motion", "end", "fault", "reset", "second enable")
CAUSES = ("none", "silent", "jam", "overload", "restart")


def ticks(degrees):
    return round(2048 + degrees * DEGREE)


def tell_lies(it, rng, servos):
    """Have *servos* report what is not so, once or for as long as they stand there or for ever."""
    offset = rng.choice(
        [-4095, -4096, 4096, 4097, -8192, rng.choice([-1, 1]) * rng.randrange(80, 8000)]
    )
    kind = rng.choice(["single", "standing", "here"])
    for number in servos:
        servo = it.gimbal.servo(number)
        here = round(servo.shaft.position)
        if kind == "here":
            servo.lie = Lie(offset, at=here)
        else:
            servo.lie = Lie(offset, remaining=rng.randrange(1, 4) if kind == "single" else None)
    return kind, offset


def inject(it, cause, number):
    gimbal = it.gimbal
    servo = gimbal.servo(number)
    if cause == "silent":
        gimbal.bus.faults.add(number, ReplyFault(FaultKind.DROP))
    elif cause == "jam":
        servo.shaft.jammed = True
    elif cause == "overload":
        servo.fail(1 << 5, gimbal.clock.now_ns())
    elif cause == "restart":
        before = servo.shaft.position
        servo.reboot(gimbal.clock.now_ns(), boot_ns=0)
        shift = servo.shaft.position - before
        it.low[number - 1] += shift
        it.high[number - 1] += shift


def heal(it):
    it.gimbal.bus.faults.clear()
    for servo in it.gimbal.bus.servos:
        servo.shaft.jammed = False


def live(rig, gimbal_loop, seed):
    """Let one gimbal be told lies at one random moment of its life."""
    rng = random.Random(seed)
    moment, cause = rng.choice(MOMENTS), rng.choice(CAUSES)
    if moment == "fault" and cause == "none":
        cause = "jam"
    yaw = rng.choice([-180.09, 180.0, rng.uniform(-200, 200)])
    it = Watched(
        rig, gimbal_loop, [ticks(a) for a in (yaw, rng.uniform(-30, 30), rng.uniform(-60, 60))]
    )
    liars = rng.choice([[rng.randrange(1, 4)], [1, 2, 3]])
    lies = lambda now: tell_lies(it, rng, liars) if moment == now else None  # noqa: E731
    lies("open")
    it.open()
    lies("enable")
    if it.ask(Command.ENABLE)[0] is Answer.DONE:
        axis, angle = rng.randrange(3), rng.uniform(-0.6, 0.6)
        path = turning(it.loop.driver, axis, angle)
        first = it.loop.lay(*path)
        reach = angle * TURN / math.tau
        it.low[axis] += min(0.0, reach)
        it.high[axis] += max(0.0, reach)
        it.loop.ask(Command.START, path_index=first)
        it.run(rng.randrange(20, 400))
        lies("motion")
        inject(it, cause, rng.randrange(1, 4))
        it.run(500)
        lies("end")
        if it.state is ServoState.HOLDING:
            it.stand()
        it.run(rng.randrange(1, 300))
    lies("fault")
    it.run(300)
    it.ask(Command.STOP)
    it.run(100)
    it.stand()
    if rng.random() < 0.5:
        heal(it)
    it.run(100)
    if rng.random() < 0.5:
        it.ask(Command.DISABLE)
    heal(it)
    it.run(50)
    lies("reset")
    # A servo that starts again counts from its first turn: the same place, another number.
    before = [servo.shaft.position for servo in it.gimbal.bus.servos]
    moved = it.positions() - np.array(before)
    it.low, it.high = it.low + moved, it.high + moved
    it.loop.ask(Command.RESET)
    turned = it.positions() - it.high
    it.low = it.low + TURN * np.round(turned / TURN)
    it.high = it.high + TURN * np.round(turned / TURN)
    it.check()
    it.run(50)
    lies("second enable")
    it.ask(Command.ENABLE)
    it.run(200)


@pytest.mark.parametrize("seed", range(CASES))
def test_no_motion_that_nobody_asked_for(rig, gimbal_loop, seed):
    live(rig, gimbal_loop, seed)


@pytest.mark.parametrize(("degrees", "tick", "read"), [(-180.09, -1, -4096), (180.0, 4095, 0)])
def test_servo_that_misreads_one_tick_stays_there_in_the_fault(
    rig, gimbal_loop, degrees, tick, read
):
    start = ticks(degrees * 170 / 180)
    it = Watched(rig, gimbal_loop, [start, 2048, 2048])
    it.open()
    it.gimbal.servo(1).lie = Lie(read - tick, at=tick)
    assert it.ask(Command.ENABLE)[0] is Answer.DONE
    path = turning(it.loop.driver, 0, (tick - start) * math.tau / TURN)
    first = it.loop.lay(*path)
    it.low[0], it.high[0] = min(start, tick), max(start, tick)
    it.loop.ask(Command.START, path_index=first)
    it.run(1200)
    assert it.loop.servo.setpoints.fault is Fault.FEEDBACK_STALE
    assert "reports a jump of 409" in it.loop.servo.setpoints.fault_text
    it.run(6 * 1_000_000_000 // PERIOD_NS)
    assert abs(it.positions()[0] - tick) < 2
    assert it.gimbal.goals()[0] == tick


@pytest.mark.parametrize("command", [Command.STOP, Command.DISABLE])
def test_stop_and_disable_act_in_a_fault(rig, gimbal_loop, command):
    it = Watched(rig, gimbal_loop, [2048, 2048, 2048])
    it.open()
    it.ask(Command.ENABLE)
    it.loop.servo.setpoints.brake(Fault.INTERNAL, "tried")
    it.run(200)
    # Somebody else on the bus has sent it away, slowly.
    gimbal = it.gimbal
    it.high[0] += 2000
    goal = gimbal.driver._servos[0]
    goal.goal = 4000
    gimbal.driver._standing.goals[0] = 4000
    it.run(300)
    it.ask(command)
    it.run(80)
    it.stand()
    it.run(500)
    assert it.state is ServoState.FAULT


def test_servo_that_disagrees_with_itself_is_not_enabled(rig):
    it = rig()
    it.driver.open()
    it.servo(1).lie = Lie(4096)
    with pytest.raises(DeviceFaultError, match=r"servo 1 \(yaw\) reports a jump of 4096 ticks"):
        it.driver.enable()
    assert not it.servo(1).is_torque_on
    it.servo(1).lie = Lie(4096, remaining=1)
    it.driver.enable()
    assert it.goals()[0] == 2048


def test_tripped_servo_stays_stopped_until_its_position_is_believed(rig):
    it = rig()
    it.start()
    it.run(50, lambda k: [0.01 * k, 0.0, 0.0])
    it.clock.advance(900_000_000)
    it.servo(1).lie = Lie(-4096)
    stood = it.servo(1).shaft.position
    with pytest.raises(DeviceFaultError, match="jump of"):
        it.driver.disable()
    it.clock.advance(500_000_000)
    assert it.value(1, "bus watchdog") == -1 or it.value(1, "bus watchdog") == 255
    it.bus.advance(it.clock.now_ns())
    assert abs(it.servo(1).shaft.position - stood) < SLACK
