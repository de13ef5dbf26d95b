"""Targets reach the servo through shared memory and are followed within the limits."""

import pytest
from rig import Rig, peaks

from orientd import rotation
from orientd.errors import Fault
from orientd.stream.records import NOT_GIVEN, Answer, Command, ServoState

LIMITS = (2.5, 17.0, 8500.0)


def aim(rig, q, omega=(0.0, 0.0, 0.0), *, position=NOT_GIVEN, time_ns=None, lives_ns=500_000_000):
    time_ns = rig.clock.now_ns() if time_ns is None else time_ns
    rig.memory.targets.publish(time_ns, time_ns + lives_ns, *q, *omega, *position)


def tracking():
    rig = Rig()
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    assert rig.ask(Command.TRACK)[0] is Answer.DONE
    assert rig.cycle.state is ServoState.TRACKING
    return rig


def keeps_limits(rig):
    return all(a <= b * 1.001 for a, b in zip(peaks(rig.sent()), LIMITS, strict=True))


@pytest.mark.parametrize("what", ["parent", "heartbeat", "halt", "end"])
def test_whatever_ends_it_ends_inside_the_limits(what):
    rig = tracking()
    for k in range(25):
        aim(rig, rotation.exp([0.0, 0.02 * k, 0.0]), (0.0, 1.0, 0.0))
        rig.run(10)
    if what == "parent":
        rig.parent_is_alive = False
    elif what == "heartbeat":
        rig.beats = False
    elif what == "halt":
        rig.ask(Command.HALT)
    else:
        rig.servo.request_end("a test")
    rig.run_until(lambda servo: not servo.is_moving)
    wanted = ServoState.FAULT if what == "heartbeat" else ServoState.HOLDING
    assert rig.cycle.state is wanted
    assert (rig.cycle.fault == Fault.HEARTBEAT_LOST) == (what == "heartbeat")
    assert keeps_limits(rig)
