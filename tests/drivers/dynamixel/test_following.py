"""Targets are followed by axes that have limits; what they miss is what is reported."""

import math

import numpy as np
import pytest

from orientd.driver import Setpoint
from orientd.rotation import angle, exp, from_euler
from orientd.stream import NOT_GIVEN, Command, ServoLimits, ServoState

PERIOD = 0.01
VELOCITY, ACCELERATION = math.radians(220), 40.0
AXES = [
    {"id": k + 1, "name": name, "limits_deg": [-reach, reach], "velocity_deg": 220,
     "acceleration_deg": 2290}
    for k, (name, reach) in enumerate((("yaw", 270), ("pitch", 100), ("roll", 270)))
]  # fmt: skip


def followed(rig, orientations, order="ZYX"):
    """Return the axis angles, goals and orientations that a driver makes of setpoints."""
    it = rig(order, rate_hz=100, axes=AXES[: len(order)])
    it.start()
    angles, goals, sent = [it.driver._following.angles], [], []
    for q in orientations:
        it.next_ns += it.period_ns
        it.clock.advance(max(0, it.next_ns - it.clock.now_ns()))
        it.driver.read()
        sent.append(it.driver.follow(Setpoint(it.next_ns, tuple(q)))[0])
        angles.append(it.driver._following.angles)
        goals.append(it.goals())
    return np.array(angles), np.array(goals), np.array(sent)


def assert_kept(angles):
    """Check limits of rate, acceleration and angle on what was commanded."""
    rates = np.diff(angles, axis=0) / PERIOD
    changes = np.diff(np.vstack([np.zeros(angles.shape[1]), rates]), axis=0) / PERIOD
    assert np.max(np.abs(rates)) <= VELOCITY * (1 + 1e-9)
    assert np.max(np.abs(changes)) <= ACCELERATION * (1 + 1e-9)
    for axis, row in zip(AXES, np.rad2deg(angles).T, strict=False):
        assert row.min() >= axis["limits_deg"][0] - 1e-6
        assert row.max() <= axis["limits_deg"][1] + 1e-6


def forward(angles):
    """Return the orientations of ZYX axis angles, not by way of the driver."""
    return np.array([from_euler("ZYX"[: len(row)], row) for row in angles])


def over(miss_deg, seconds=3.0, sweep_deg=150):
    """Return a turn over the top that misses the pole, from rest to rest."""
    miss = math.radians(miss_deg)
    u = np.linspace(0, 1, round(seconds / PERIOD))
    turn = math.radians(sweep_deg) * u**3 * (10 - 15 * u + 6 * u**2)
    return exp(turn[:, None] * np.array([0, -math.cos(miss), math.sin(miss)]))


def test_a_turn_that_the_axes_can_do_is_followed_exactly(rig):
    u = np.arange(300) * PERIOD
    turn = np.stack([0.4 * np.sin(2 * u), 0.5 * np.sin(1.3 * u) ** 2, 0.8 * (1 - np.cos(u))], 1)
    wanted = np.array([from_euler("ZYX", row) for row in turn[:, ::-1] * [1, 1, 0.3]])
    angles, goals, sent = followed(rig, wanted)
    assert_kept(angles)
    late = angle(sent, wanted)
    assert np.max(late[60:]) < 1e-9
    assert np.max(np.abs(goals - 2048 - angles[1:] * 4096 / math.tau)) <= 0.51


@pytest.mark.parametrize("order", ["ZYX", "ZY"])
@pytest.mark.parametrize("miss", [0.0, 1.0, 5.0])
def test_pole_is_passed_with_bounded_rates_and_what_is_sent_is_what_the_axes_make(rig, miss, order):
    wanted = np.concatenate([over(miss), np.repeat(over(miss)[-1:], 100, axis=0)])
    angles, _, sent = followed(rig, wanted, order)
    assert_kept(angles)
    assert np.max(angle(forward(angles[1:]), sent)) < 1e-6
    missed = angle(sent, wanted)
    if order == "ZYX":
        assert missed[-1] < 1e-9
        assert np.max(missed) < math.radians(65)


def test_angle_outside_the_limits_is_followed_up_to_them(rig):
    count = 600
    wanted = exp(np.linspace(0, math.radians(350), count)[:, None] * [0.0, 0.0, 1.0])
    angles, _, _ = followed(rig, np.concatenate([wanted, np.repeat(wanted[-1:], 400, axis=0)]))
    assert_kept(angles)
    # Past the limit it goes round to the other winding.
    assert math.degrees(angles[-1, 0]) == pytest.approx(-10, abs=0.01)


def test_a_stop_amid_following_ends_where_the_axes_are(rig, gimbal_loop):
    gimbal = rig(rate_hz=500, is_paced=False, latency_ms=4.0, axes=AXES)
    loop = gimbal_loop(gimbal)
    assert loop.ask(Command.ENABLE)[0].name == "DONE"
    limits = ServoLimits(3.0, 20.0, 2000.0, 1.0, 10.0, 1.0)
    loop.ask(Command.TRACK, motion=1, servo_limits=limits)
    now = loop.clock.now_ns()
    target = exp([0.0, 0.0, 1.0]).tolist()
    loop.memory.targets.publish(now, now + 10**10, *target, *([0.0] * 3), *NOT_GIVEN)
    loop.run(400)
    assert loop.cycle.state is ServoState.TRACKING
    assert math.degrees(gimbal.driver._following.angles[0]) == pytest.approx(57.3, abs=0.1)
    loop.ask(Command.STOP)
    loop.run_until(lambda servo: servo.state is ServoState.HOLDING)
    loop.run(50)
    assert loop.cycle.fault == 0
    assert angle(np.array(loop.cycle.q), np.array(target)) < 1e-6
