"""After a fault nothing moves by itself, whatever lets go; healthy axes brake on their path."""

import random

import numpy as np
import pytest
from reference.wire import TORQUE, WireReader

from emulated_dynamixel import FaultKind, ReplyFault
from orientd.errors import Fault
from orientd.stream.records import ServoState

DEGREE = 4096 / 360
PERIOD = 0.002
ROUNDS = [
    pytest.param(range(1), id="few"),
    pytest.param(range(1, 51), id="many", marks=pytest.mark.slow),
]


def _shaft(**settings):
    def inject(g, servo):
        for name, value in settings.items():
            setattr(g.servo(servo).shaft, name, value)

    return inject


def _error(bit):
    return lambda g, servo: g.servo(servo).fail(1 << bit, g.clock.now_ns())


def _power(g, servo):
    g.servo(servo).disconnect(g.clock.now_ns())
    g.servo(servo).connect(g.clock.now_ns())


def _torque_off(g, servo):
    g.servo(servo).write(64, b"\0", g.clock.now_ns())


CAUSES = {
    "jammed": (_shaft(jammed=True), {Fault.DEVICE_FAULT}),
    "stalled": (_shaft(load=1.0), {Fault.DEVICE_FAULT}),
    "overload": (_error(5), {Fault.DEVICE_FAULT}),
    "voltage": (_error(0), {Fault.DEVICE_FAULT}),
    "torque off": (_torque_off, {Fault.DEVICE_FAULT}),
    "supply interrupted": (_power, {Fault.DEVICE_FAULT, Fault.FEEDBACK_STALE}),
    "silent": (
        lambda g, servo: g.bus.faults.add(servo, ReplyFault(FaultKind.DROP)),
        {Fault.FEEDBACK_STALE},
    ),
    "unplugged": (lambda g, _: setattr(g.port, "is_plugged", False), {Fault.LINK_LOST}),
}


def turning(seconds=1.2):
    """Turn all three axes from rest to rest, as path records; 1.3 rad/s at the most."""
    count = round(seconds / PERIOD) + 1
    u = np.linspace(0, 1, count)
    axis = np.array([0.3, 0.4, 0.8]) / np.linalg.norm([0.3, 0.4, 0.8])
    angle = 0.8 * u**3 * (10 - 15 * u + 6 * u**2)
    rate = 0.8 * 30 * u**2 * (1 - u) ** 2 / seconds
    change = 0.8 * 60 * u * (1 - u) * (1 - 2 * u) / seconds**2
    q = np.concatenate([np.cos(angle / 2)[:, None], np.sin(angle / 2)[:, None] * axis], axis=1)
    return q, rate[:, None] * axis, change[:, None] * axis


def read_on_the_wire(gimbal):
    """Return a reader of what goes to the servos from now on."""
    reader, write = WireReader(), gimbal.port.writePort

    def tapped(packet):
        sent = write(packet)
        reader.take(bytes(packet), gimbal.clock.now_ns() * 1e-9)
        return sent

    gimbal.port.writePort = tapped
    return reader


def positions(gimbal):
    gimbal.bus.advance(gimbal.clock.now_ns())
    return np.array([servo.shaft.position for servo in gimbal.bus.servos])


def caught(rig, gimbal_loop, cause, seed):
    """Return a loop in the fault that *cause* leads to amid a motion, and the servo it hit."""
    rng = random.Random(seed)
    gimbal = rig(rate_hz=500, is_paced=False, latency_ms=4.0)
    gimbal.wire = read_on_the_wire(gimbal)
    loop = gimbal_loop(gimbal)
    loop.start(turning())
    loop.run(rng.randrange(150, 400))
    servo = rng.randrange(1, 4)
    # A second axis is held too, for too short a time to be noticed by itself.
    gimbal.servo(servo % 3 + 1).shaft.jammed = cause in {"silent", "unplugged"}
    CAUSES[cause][0](gimbal, servo)
    loop.run_until(lambda one: one.state is ServoState.FAULT)
    assert loop.servo.setpoints.fault in CAUSES[cause][1]
    return loop, servo


def _is_held(wire, servo):
    """Return whether the last that was written of a servo's torque is that it be on."""
    torque = [one.value for one in wire.written if (one.servo, one.address) == (servo, TORQUE)]
    return torque[-1] == 1


@pytest.mark.parametrize("cause", CAUSES)
@pytest.mark.parametrize("rounds", ROUNDS)
def test_nothing_snaps_when_what_held_it_lets_go(rig, gimbal_loop, cause, rounds):
    for seed in rounds:
        loop, _ = caught(rig, gimbal_loop, cause, seed)
        gimbal = loop.gimbal
        loop.run(300)
        before = positions(gimbal)
        written = len(gimbal.wire.written)
        asked = {servo: gimbal.wire.goals(servo)[-1] for servo in (1, 2, 3)}
        gimbal.bus.faults.clear()
        gimbal.port.is_plugged = True
        for servo in gimbal.bus.servos:
            servo.shaft.jammed, servo.shaft.load = False, 0.0
        farthest = np.zeros(3)
        for _ in range(20):
            loop.run(10)
            farthest = np.maximum(farthest, np.abs(positions(gimbal) - before))
        assert farthest.max() < DEGREE
        # So somebody says who reads the wire alone: no goal is farther away than that, and what
        # went over it is what the servos have.  Over a wire that was unplugged nothing could be
        # said any more: the servos' own watchdogs have stopped them before their last goals.
        wire = gimbal.wire
        assert wire.damaged == 0
        for servo, stood in enumerate(before, 1):
            goals = [asked[servo], *wire.goals(servo, written)]
            if _is_held(wire, servo) and cause != "unplugged":
                assert max(abs(goal - stood) for goal in goals) < DEGREE
            assert goals[-1] == gimbal.servo(servo).value("goal position")


def test_healthy_axes_brake_on_the_path_while_the_failed_one_stands(rig, gimbal_loop):
    gimbal = rig(rate_hz=500, is_paced=False, latency_ms=4.0)
    loop = gimbal_loop(gimbal)
    loop.start(turning())
    loop.run(250)
    gimbal.servo(2).fail(1 << 0, gimbal.clock.now_ns())
    goals = []
    while loop.servo.state is not ServoState.FAULT:
        loop.run(1)
        goals.append(gimbal.goals())
    goals = np.array(goals)
    assert np.ptp(goals[3:, 1]) == 0
    assert abs(goals[-1, 1] - positions(gimbal)[1]) < DEGREE
    speed = np.abs(np.diff(goals[:, 0])) / PERIOD / DEGREE
    assert speed[:5].mean() > 20
    assert speed[-10:].mean() < 5
    assert loop.cycle.fault == Fault.DEVICE_FAULT
