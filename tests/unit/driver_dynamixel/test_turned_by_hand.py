"""A gimbal that was turned by hand stays there, whatever begins again, until somebody asks.

The judge is the emulated shafts' own record, every 2 ms.  The servos keep an old goal when their
torque comes on, and nothing limits their speed but their supply.
"""

from contextlib import suppress
from itertools import pairwise

import pytest

from orientd.errors import DeviceError

HAND = 196
"""0.3 rad in ticks."""
TICK_RAD = 0.3 / HAND
REST = 2.0
"""Ticks: a position is rounded to one, and a goal too."""
TORQUE = 64
MS = 1_000_000


def now(rig):
    return rig.clock.now_ns()


def advance(rig, seconds):
    """Let time pass without a cycle: the process hangs, or there is none."""
    for _ in range(round(seconds / 0.002)):
        rig.clock.advance(2 * MS)
        for servo in rig.bus.servos:
            servo.advance(now(rig))


def cycles(rig, count):
    """Let cycles pass in a fault."""
    for _ in range(count):
        with suppress(DeviceError):
            rig.cycle()


def fault(rig):
    """Let cycles pass until the driver raises; then rest, as the servo loop does."""
    for _ in range(200):
        try:
            rig.cycle()
        except DeviceError:
            break
    else:
        raise AssertionError("no fault")
    rig.driver.rest_in_fault()
    with suppress(DeviceError):
        rig.driver.disable()
    cycles(rig, 100)


def move(rig):
    """Stream a motion, and leave the servos on their way to a goal 0.3 rad ahead."""
    rig.run(40, lambda k: [0.01 * k] * 3)
    rig.cycle([0.7] * 3)


def stop_on_the_way(rig):
    """Send the servos to a goal 0.3 rad ahead, while something blocks them."""
    rig.run(20)
    for servo in rig.bus.servos:
        servo.shaft.jammed = True
    rig.cycle([0.3] * 3)


def come_free(rig):
    """Take the obstacle away."""
    for servo in rig.bus.servos:
        servo.shaft.jammed = False


def torque_off(rig):
    for servo in rig.bus.servos:
        servo.write(TORQUE, b"\0", now(rig))


def turn_by_hand(rig):
    """Turn every axis without torque by 0.3 rad; then record the shafts."""
    for servo in rig.bus.servos:
        servo.advance(now(rig))
        if not servo.is_torque_on:
            servo.shaft.turn(HAND, 0.3)
    cycles(rig, 80)
    advance(rig, 0.4)
    for servo in rig.bus.servos:
        servo.shaft.trace = [servo.shaft.position]


def begin_again(rig):
    rig.driver.reset()
    rig.enable()


def fresh(rig):
    torque_off(rig)
    turn_by_hand(rig)
    rig.driver.open()
    rig.enable()


def freed(rig):
    move(rig)
    rig.driver.disable()
    rig.driver.free()
    turn_by_hand(rig)
    rig.enable()


def lost_torque(rig):
    move(rig)
    torque_off(rig)
    fault(rig)
    turn_by_hand(rig)
    begin_again(rig)


def one_lost_torque(rig):
    move(rig)
    rig.servo(2).write(TORQUE, b"\0", now(rig))
    fault(rig)
    turn_by_hand(rig)
    begin_again(rig)


def restarted(rig):
    move(rig)
    for servo in rig.bus.servos:
        servo.reboot(now(rig), boot_ns=20 * MS)
    fault(rig)
    turn_by_hand(rig)
    begin_again(rig)


def power(rig):
    move(rig)
    for servo in rig.bus.servos:
        servo.disconnect(now(rig))
    fault(rig)
    turn_by_hand(rig)
    for servo in rig.bus.servos:
        servo.connect(now(rig))
    advance(rig, 0.4)
    begin_again(rig)


def shutdown(rig):
    move(rig)
    for servo in rig.bus.servos:
        servo.fail(1 << 5, now(rig))
    fault(rig)
    turn_by_hand(rig)
    begin_again(rig)


def watchdog(rig):
    move(rig)
    advance(rig, 1.0)
    turn_by_hand(rig)
    begin_again(rig)


def watchdog_ahead(rig):
    stop_on_the_way(rig)
    advance(rig, 1.0)
    come_free(rig)
    turn_by_hand(rig)
    begin_again(rig)


def watchdog_without_torque(rig):
    move(rig)
    advance(rig, 1.0)
    torque_off(rig)
    turn_by_hand(rig)
    begin_again(rig)


def killed_on_the_way(rig):
    stop_on_the_way(rig)
    advance(rig, 1.0)
    come_free(rig)
    turn_by_hand(rig)
    rig.driver.open()
    rig.enable()


def closed(rig):
    move(rig)
    advance(rig, 0.2)
    rig.run(20)
    rig.driver.disable()
    rig.driver.close()
    torque_off(rig)
    turn_by_hand(rig)
    rig.driver.open()
    rig.enable()


def parked(rig):
    move(rig)
    rig.run(40)
    rig.driver.disable()
    rig.driver.park()
    rig.driver.close()
    turn_by_hand(rig)
    rig.driver.open()
    rig.enable()


def unplugged(rig):
    move(rig)
    rig.port.is_plugged = False
    fault(rig)
    torque_off(rig)
    turn_by_hand(rig)
    rig.port.is_plugged = True
    begin_again(rig)


def unplugged_on_the_way(rig):
    stop_on_the_way(rig)
    rig.port.is_plugged = False
    fault(rig)
    advance(rig, 1.0)
    come_free(rig)
    turn_by_hand(rig)
    rig.port.is_plugged = True
    begin_again(rig)


CASES = (
    fresh, freed, lost_torque, one_lost_torque, restarted, power, shutdown, watchdog,
    watchdog_ahead, watchdog_without_torque, killed_on_the_way, closed, parked, unplugged,
    unplugged_on_the_way,
)  # fmt: skip


def travel(rig):
    """Return how far an axis went since the hand, ticks, and how fast, rad/s, at the most."""
    traces = [servo.shaft.trace for servo in rig.bus.servos]
    assert all(traces)
    far = max(abs(at - trace[0]) for trace in traces for at in trace)
    fast = max((abs(b - a) for trace in traces for a, b in pairwise(trace)), default=0)
    return far, fast * TICK_RAD / 0.002


@pytest.mark.parametrize("usb_ms", [1, 16], ids=["1 ms", "16 ms"])
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_gimbal_turned_by_hand_stays_until_somebody_asks(rig, case, usb_ms):
    it = rig(
        at_end="release", usb_ms=usb_ms, latency_ms=usb_ms + 4, rate_hz=20 if usb_ms > 4 else 200
    )
    for servo in it.bus.servos:
        servo.keeps_goal = True
    if case is not fresh:
        it.start()
    try:
        case(it)
        it.run(50)
    finally:
        far, fast = travel(it)
        print(f"\n| {case.__name__} | {far * TICK_RAD:.2e} rad | {fast:.2e} rad/s |")
        assert far <= REST, f"moved by {far:.1f} ticks, at {fast:.2f} rad/s"
