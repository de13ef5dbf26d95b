"""The real servo loop with the gimbal driver: faults are typed, held, and reset recovers."""

import numpy as np
import pytest
from rig import PERIOD

from emulated_dynamixel import FaultKind, ReplyFault
from orientd.errors import Fault
from orientd.stream.records import Answer, Command, ServoState


@pytest.fixture
def loop(rig, gimbal_loop):
    return gimbal_loop(rig(rate_hz=500, is_paced=False, latency_ms=4.0))


def turning(seconds=2.0):
    """A yaw of 0.8 rad from rest to rest, as path records."""
    count = round(seconds / PERIOD) + 1
    u = np.linspace(0, 1, count)
    angle = 0.8 * u**3 * (10 - 15 * u + 6 * u**2)
    rate = 0.8 * 30 * u**2 * (1 - u) ** 2 / seconds
    change = 0.8 * 60 * u * (1 - u) * (1 - 2 * u) / seconds**2
    q = np.zeros((count, 4))
    q[:, 0], q[:, 3] = np.cos(angle / 2), np.sin(angle / 2)
    axis = np.array([0.0, 0.0, 1.0])
    return q, rate[:, None] * axis, change[:, None] * axis


CAUSES = {
    "silence": (lambda g: g.bus.faults.add(2, ReplyFault(FaultKind.DROP)), Fault.FEEDBACK_STALE),
    "overload": (lambda g: g.servo(2).fail(1 << 5, g.clock.now_ns()), Fault.DEVICE_FAULT),
    "unplugged": (lambda g: setattr(g.port, "is_plugged", False), Fault.LINK_LOST),
}


@pytest.mark.parametrize("cause", CAUSES)
def test_fault_in_the_middle_is_typed_held_and_reset(loop, cause):
    inject, fault = CAUSES[cause]
    loop.start(turning())
    loop.run(400)
    inject(loop.gimbal)
    loop.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert loop.cycle.fault == fault
    goals = loop.gimbal.goals()
    loop.run(50)
    assert loop.gimbal.goals() == goals
    loop.gimbal.bus.faults.clear()
    loop.gimbal.port.is_plugged = True
    answer = loop.ask(Command.RESET)
    assert answer == (Answer.DONE, "")
    assert loop.ask(Command.ENABLE)[0] is Answer.DONE
    loop.run(100)
    assert loop.cycle.state is ServoState.HOLDING
    assert loop.cycle.fault == 0
    assert all(servo.is_torque_on for servo in loop.gimbal.bus.servos)
