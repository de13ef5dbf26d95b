"""Targets reach the servo through shared memory and are followed within the limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from rig import PERIOD_NS, TERMS, Rig, peaks, turn

from orientd import rotation
from orientd.errors import Fault
from orientd.stream.records import LEFT_OUT_WORD, NOT_GIVEN, Answer, Command, ServoState

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


def test_a_target_is_reached_and_held_until_it_expires_and_a_stop_ends_it():
    rig = tracking()
    target = rotation.exp([0.0, 0.5, -0.3])
    for _ in range(30):
        aim(rig, target)
        rig.run(20)
    assert rotation.angle(rig.sent()[-1], target) < 1e-9
    rig.run(400)
    assert rig.cycle.state is ServoState.TRACKING
    assert rig.ask(Command.STOP)[0] is Answer.DONE
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.cycle.state is ServoState.HOLDING
    assert keeps_limits(rig)


def test_when_targets_cease_it_comes_to_rest():
    rig = tracking()
    for k in range(25):
        aim(rig, rotation.exp([0.0, 0.0, 0.02 * k]), (0.0, 0.0, 0.5), lives_ns=100_000_000)
        rig.run(20)
    rig.run(300)
    assert rig.cycle.omega_body == (0.0, 0.0, 0.0)
    assert keeps_limits(rig)


def test_it_takes_over_from_a_motion_without_a_step():
    rig = Rig()
    rig.start(turn())
    rig.run(400)
    assert rig.ask(Command.TRACK, motion=2)[0] is Answer.DONE
    for _ in range(50):
        aim(rig, rotation.exp([0.3, 0.0, 0.0]))
        rig.run(20)
    assert rig.cycle.motion == 2
    assert rotation.angle(rig.sent()[-1], rotation.exp([0.3, 0.0, 0.0])) < 1e-9
    assert keeps_limits(rig)


def test_a_position_on_its_way_comes_to_rest_inside_its_limits():
    rig = Rig()
    path = turn(angle=0.9)
    t = np.linspace(0.0, 1.0, len(path[0]))[:, None]
    along = np.array([0.3, 0.0, 0.4])
    rig.start(
        path,
        position=along * t**3 * (10 - 15 * t + 6 * t**2),
        velocity=along * 15 * (t - t * t) ** 2,
    )
    rig.run(500)
    assert np.linalg.norm(rig.driver.setpoints[-1].velocity) == pytest.approx(
        0.5 * 15 / 16, rel=1e-3
    )
    narrow = replace(TERMS, linear_velocity=0.1)
    assert rig.ask(Command.TRACK, motion=2, servo_limits=narrow)[0] is Answer.DONE
    for _ in range(50):
        aim(rig, rotation.exp([0.3, 0.0, 0.0]))
        rig.run(20)
    assert rig.cycle.state is ServoState.TRACKING
    assert rig.driver.setpoints[-1].velocity == (0.0, 0.0, 0.0)
    positions = np.array([setpoint.position for setpoint in rig.driver.setpoints])
    velocity = np.diff(positions, axis=0) * 500.0
    acceleration = np.diff(velocity, axis=0) * 500.0
    assert np.linalg.norm(acceleration, axis=1).max() <= TERMS.linear_acceleration * (1 + 1e-6)
    assert rotation.angle(rig.sent()[-1], rotation.exp([0.3, 0.0, 0.0])) < 1e-9
    assert keeps_limits(rig)


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


def test_what_is_no_target_is_left_out():
    rig = tracking()
    good = rotation.exp([0.1, 0.0, 0.0])
    aim(rig, good)
    rig.run(1)
    now = rig.clock.now_ns()
    for q in ([math.nan] * 4, [0.0] * 4, [1e300, 0.0, 0.0, 0.0], [math.inf, 0.0, 0.0, 0.0]):
        aim(rig, q, time_ns=now + 1)
    aim(rig, good, time_ns=now - 10 * PERIOD_NS)
    aim(rig, good, (math.nan, 0.0, 0.0), time_ns=now + 2)
    rig.run(1)
    assert rig.memory.targets.words[LEFT_OUT_WORD] == 6
    rig.run(200)
    assert rotation.angle(rig.sent()[-1], good) < 1e-9


def test_more_targets_than_the_ring_holds_do_no_harm():
    rig = tracking()
    generator = np.random.default_rng(5)
    for burst in range(40):
        for k in range(150):
            aim(rig, rotation.exp(generator.normal(size=3) * 0.01), time_ns=burst * 10**7 + k)
        aim(rig, rotation.exp([0.2, 0.0, 0.0]))
        rig.run(30)
    assert rotation.angle(rig.sent()[-1], rotation.exp([0.2, 0.0, 0.0])) < 1e-6
    assert keeps_limits(rig)


def test_tracking_is_not_possible_while_stopping():
    rig = Rig()
    rig.start(turn())
    rig.run(400)
    rig.ask(Command.STOP)
    assert rig.ask(Command.TRACK)[0] is Answer.WRONG_STATE
    assert TERMS.velocity == LIMITS[0]
