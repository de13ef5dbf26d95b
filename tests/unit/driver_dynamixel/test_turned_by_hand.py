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


def each_servo(act):
    """Return a step that does something with every servo."""

    def step(rig):
        for servo in rig.bus.servos:
            act(servo, now(rig))

    return step


def with_driver(*names):
    """Return a step that calls methods of the driver."""

    def step(rig):
        for name in names:
            getattr(rig.driver, name)()

    return step


def plugged(is_plugged):
    """Return a step that plugs or unplugs the adapter."""
    return lambda rig: setattr(rig.port, "is_plugged", is_plugged)


def hang(seconds):
    """Return a step in which time passes without a cycle."""
    return lambda rig: advance(rig, seconds)


def run(count):
    """Return a step of some cycles."""
    return lambda rig: rig.run(count)


def enable(rig):
    rig.enable()


def pitch_torque_off(rig):
    rig.servo(2).write(TORQUE, b"\0", now(rig))


restart = each_servo(lambda servo, now_ns: servo.reboot(now_ns, boot_ns=20 * MS))
cut_power = each_servo(lambda servo, now_ns: servo.disconnect(now_ns))
give_power = each_servo(lambda servo, now_ns: servo.connect(now_ns))
overload = each_servo(lambda servo, now_ns: servo.fail(1 << 5, now_ns))
BEGIN_AGAIN = with_driver("reset"), enable
OPEN_AGAIN = with_driver("open"), enable
"""By another process than the one before."""

CASES = {
    "fresh": (torque_off, turn_by_hand, *OPEN_AGAIN),
    "freed": (move, with_driver("disable", "free"), turn_by_hand, enable),
    "lost torque": (move, torque_off, fault, turn_by_hand, *BEGIN_AGAIN),
    "one lost torque": (move, pitch_torque_off, fault, turn_by_hand, *BEGIN_AGAIN),
    "restarted": (move, restart, fault, turn_by_hand, *BEGIN_AGAIN),
    "power": (move, cut_power, fault, turn_by_hand, give_power, hang(0.4), *BEGIN_AGAIN),
    "shutdown": (move, overload, fault, turn_by_hand, *BEGIN_AGAIN),
    "watchdog": (move, hang(1.0), turn_by_hand, *BEGIN_AGAIN),
    "watchdog ahead": (stop_on_the_way, hang(1.0), come_free, turn_by_hand, *BEGIN_AGAIN),
    "watchdog without torque": (move, hang(1.0), torque_off, turn_by_hand, *BEGIN_AGAIN),
    "killed on the way": (stop_on_the_way, hang(1.0), come_free, turn_by_hand, *OPEN_AGAIN),
    "closed": (
        *(move, hang(0.2), run(20), with_driver("disable", "close")),
        *(torque_off, turn_by_hand, *OPEN_AGAIN),
    ),
    "parked": (
        *(move, run(40), with_driver("disable", "park", "close")),
        *(turn_by_hand, *OPEN_AGAIN),
    ),
    "unplugged": (
        *(move, plugged(False), fault, torque_off, turn_by_hand),
        *(plugged(True), *BEGIN_AGAIN),
    ),
    "unplugged on the way": (
        *(stop_on_the_way, plugged(False), fault, hang(1.0), come_free, turn_by_hand),
        *(plugged(True), *BEGIN_AGAIN),
    ),
}
"""What happens, step by step."""


def travel(rig):
    """Return how far an axis went since the hand, ticks, and how fast, rad/s, at the most."""
    traces = [servo.shaft.trace for servo in rig.bus.servos]
    assert all(traces)
    far = max(abs(at - trace[0]) for trace in traces for at in trace)
    fast = max((abs(b - a) for trace in traces for a, b in pairwise(trace)), default=0)
    return far, fast * TICK_RAD / 0.002


@pytest.mark.parametrize("usb_ms", [1, 16], ids=["1 ms", "16 ms"])
@pytest.mark.parametrize("case", CASES)
def test_gimbal_turned_by_hand_stays_until_somebody_asks(rig, case, usb_ms):
    it = rig(
        at_end="release", usb_ms=usb_ms, latency_ms=usb_ms + 4, rate_hz=20 if usb_ms > 4 else 200
    )
    for servo in it.bus.servos:
        servo.keeps_goal = True
    if case != "fresh":
        it.start()
    try:
        for step in CASES[case]:
            step(it)
        it.run(50)
    finally:
        far, fast = travel(it)
        print(f"\n| {case} | {far * TICK_RAD:.2e} rad | {fast:.2e} rad/s |")
        assert far <= REST, f"moved by {far:.1f} ticks, at {fast:.2f} rad/s"
