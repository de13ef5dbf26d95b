"""A path at its limit of acceleration, whose peak is larger between the records than on them."""

from dataclasses import replace

import numpy as np
import pytest
from rig import PERIOD, TERMS, Rig

from orientd import rotation
from orientd.stream import Answer, Command, ServoState

AXIS = np.array([0.6, 0.0, 0.8])
PEAK, RAMP, COUNT = 16.0, 0.02, 241
FIRST, SECOND = 0.1 + 0.5 * PERIOD, 0.3 + 0.5 * PERIOD  # s; both peaks lie between two records


def lobe(t, middle):
    """Return angle, velocity and acceleration of a triangular push, from rest."""
    jerk = PEAK / RAMP
    found = np.zeros((3, len(t)))
    for begin, step in ((-RAMP, jerk), (0.0, -2.0 * jerk), (RAMP, jerk)):
        s = np.maximum(t - middle - begin, 0.0)
        found += step * np.array([s**3 / 6.0, s**2 / 2.0, s])
    return found


@pytest.fixture
def path():
    """A push and one back, as the records have them, and the largest difference between these."""
    t = PERIOD * np.arange(COUNT)
    angle, speed, push = lobe(t, FIRST) - lobe(t, SECOND)
    q = rotation.exp(angle[:, None] * AXIS)
    largest = np.abs(np.diff(angle, 2)).max() / PERIOD**2
    return (q, speed[:, None] * AXIS, push[:, None] * AXIS), largest


@pytest.mark.parametrize("slowed", range(4, 16, 2))
@pytest.mark.parametrize("speed", [0.6, 0.97])
def test_a_peak_between_the_records_is_passed_inside_the_limits(path, slowed, speed):
    records, largest = path
    between = lobe(np.array([FIRST - PERIOD, FIRST, FIRST + PERIOD]), FIRST)[0]
    assert np.diff(between, 2)[0] / PERIOD**2 > 1.005 * largest
    servo_limits = replace(TERMS, acceleration=1.0005 * largest, jerk=3000.0, brake_rate=5.0)
    rig = Rig()
    rig.start(records, servo_limits=servo_limits)
    rig.run(5)
    # The clock is back at full speed before the first peak, but not on the records any more.
    assert rig.ask(Command.SPEED, speed=speed, servo_limits=servo_limits)[0] is Answer.DONE
    rig.run(slowed)
    rig.ask(Command.SPEED, speed=1.0, servo_limits=servo_limits)
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.servo.state is ServoState.HOLDING, rig.servo.setpoints.fault_text
    turns = rotation.log(rotation.multiply(rotation.conjugate(rig.sent()[:-1]), rig.sent()[1:]))
    sent = np.linalg.norm(np.diff(turns, axis=0), axis=1).max() / PERIOD**2
    assert sent <= 1.001 * servo_limits.acceleration
