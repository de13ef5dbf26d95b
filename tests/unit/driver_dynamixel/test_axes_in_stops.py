"""Stops, pauses and other speeds keep every limit of the gimbal's axes, wherever they begin."""

import os

import numpy as np
import pytest
from axis_ride import AxisRide
from joint_ride import HALF, KILLED, PAUSE, RANDOM, STOP, disturbed
from pole_passes import AXES, LIMITS, PERIOD, driver_with, over_the_top

from orientd import motion_file, rotation
from orientd.daemon.device import queue
from orientd.errors import Fault, PlanError
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd.stream.records import Command, ServoState
from orientd.tolerances import GUARD_TOLERANCE

CASES = int(os.environ.get("ORIENTD_CASES", "12"))
_SLOW_CASES = ((8, 8, 0), (2, None, 3), (1, 8, 3))
_ORDERS = ("ZYX", "ZXY", "XYZ", "YZX")


def plan_for(request, joints=(0.0, 0.0, 0.0), limits=LIMITS, **options):
    """Return the gimbal's motion for *request*, and the settings of its driver."""
    driver = driver_with(**options)
    planner = DevicePlanner(driver, limits=limits, period=PERIOD)
    start = State.at_rest(driver._gimbal.orientation(joints))
    return planner.plan(request, start=start, joints=joints), driver.options


def assert_keeps(ride, record, what, random=None):
    speed, force = disturbed(ride, record, what, random)
    assert speed <= GUARD_TOLERANCE, (record, what)
    assert force <= GUARD_TOLERANCE, (record, what)


@pytest.mark.parametrize("what", [STOP, PAUSE, HALF, KILLED])
@pytest.mark.parametrize(
    ("miss", "seconds", "deviation"),
    [
        *((1, None, 0), (2, None, 0), (4, None, 0), (8, None, 0), (4, 8, 3)),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in _SLOW_CASES),
    ],
)
def test_no_axis_exceeds_its_limits_by_the_pole(miss, seconds, deviation, what):
    request = motion_file.parse(over_the_top(miss, seconds))
    motion, settings = plan_for(request, max_deviation_deg=deviation)
    ride = AxisRide(motion, settings)
    for record in range(3, motion.record_count - 1, 16):
        assert_keeps(ride, record, what)


@pytest.mark.parametrize(
    ("miss", "deviation"), [pytest.param(0.5, 3, marks=pytest.mark.slow), (2, 0), (8, 0)]
)
def test_no_axis_of_an_azimuth_elevation_mount_exceeds_its_limits(miss, deviation):
    options = {"order": "ZY", "axes": AXES[:2], "pointing": True, "max_deviation_deg": deviation}
    request = motion_file.parse(over_the_top(miss))
    ride = AxisRide(*plan_for(request, (0.0, 0.0), **options))
    for record in range(3, ride.motion.record_count - 1, 24):
        for what in (STOP, PAUSE, HALF, KILLED):
            assert_keeps(ride, record, what)


@pytest.mark.parametrize("miss", [0.0, 1e-5, 1e-4, 3e-4])
def test_no_axis_hurries_for_a_path_that_all_but_meets_the_pole(miss):
    """On its records it goes straight over; between two, yaw would have to turn about at once."""
    motion, settings = plan_for(motion_file.parse(over_the_top(miss)))
    ride = AxisRide(motion, settings)
    pole = int(np.argmin(np.abs(np.cos(ride.joints[:, 1]))))
    for record in range(pole - 40, pole + 2, 3):
        for what in (PAUSE, HALF):
            assert max(disturbed(ride, record, what)) <= GUARD_TOLERANCE
            made = [ride.driver._gimbal.orientation(angles) for angles in ride.driver.sent]
            turned = rotation.log(np.array(made))
            axis = np.array([0.0, -np.cos(np.deg2rad(miss)), np.sin(np.deg2rad(miss))])
            assert np.linalg.norm(turned - np.outer(turned @ axis, axis), axis=1).max() < 2e-4


def test_a_pause_keeps_the_tools_limit_during_a_slew():
    keyframes = [
        Keyframe(tuple(rotation.exp([0.0, 0.0, np.deg2rad(turn)]).tolist()))
        for turn in np.linspace(0, 300, 7)
    ]
    request = MotionRequest(keyframes, approach=True)
    ride = AxisRide(*plan_for(request, allow_slews=True))
    (loss,) = ride.motion.certificate.losses
    for record in range(round(loss.start / PERIOD), round(loss.end / PERIOD), 40):
        ride.go_to(record)
        assert ride.set_speed(0.0)
        ride.come_to_rest()
        ride.set_speed(1.0)
        ride.run(80)
        assert ride.servo.state is not ServoState.FAULT, ride.servo.setpoints.fault_text


def test_a_stop_by_the_pole_is_as_short_as_the_certificate_says():
    for miss in (1, 4):
        motion, settings = plan_for(motion_file.parse(over_the_top(miss)))
        ride = AxisRide(motion, settings)
        for record in range(3, motion.record_count - 1, 8):
            disturbed(ride, record, STOP)
            cycles = len(ride.driver.sent) - 2
            assert cycles * PERIOD <= motion.certificate.stop_time + 4 * PERIOD, record


def random_pass(random):
    """Return a random motion of a random gimbal with its settings, or ``None`` if it is refused."""
    order = str(random.choice(_ORDERS))
    velocity, acceleration = random.uniform(40, 200), random.uniform(200, 2300)
    axes = [
        {**axis, "velocity_deg": velocity * random.uniform(0.7, 1.3),
         "acceleration_deg": acceleration * random.uniform(0.7, 1.3)}
        for axis in AXES
    ]  # fmt: skip
    options = {
        "order": order,
        "axes": axes,
        "max_deviation_deg": float(random.choice([0.0, 3.0, 10.0])),
        "allow_slews": bool(random.random() < 0.3),
    }
    driver = driver_with(**options)
    # From one side of the pole to the other, missing it by some degrees, and on from there.
    middle = random.choice([-1.0, 1.0]) * np.pi / 2
    count = int(random.integers(2, 6))
    sweep = middle + np.sort(random.uniform(-1.2, 1.2, count))[:: int(random.choice([-1, 1]))]
    aside = np.deg2rad(random.uniform(-15, 15)) + np.deg2rad(2.0) * random.normal(size=count)
    heading = random.uniform(-2.0, 2.0)
    joints = (heading, float(sweep[0]), 0.0)
    first = np.array(driver._gimbal.orientation(joints))
    q = [first]
    for angle, off in zip(sweep[1:], aside[1:], strict=True):
        turned = np.array(driver._gimbal.orientation((heading, float(angle), 0.0)))
        q.append(rotation.multiply(turned, rotation.exp(off * random.normal(size=3))))
    is_timed = random.random() < 0.4
    seconds = np.cumsum(random.uniform(0.5, 3.0, count)) if is_timed else [None] * count
    keyframes = [
        Keyframe(tuple(key.tolist()), None if time is None else float(time))
        for key, time in zip(q, seconds, strict=True)
    ]
    limits = LIMITS if random.random() < 0.6 else LIMITS.slowed(random.uniform(0.4, 3.0))
    try:
        return plan_for(MotionRequest(keyframes, approach=True), joints, limits, **options)
    except PlanError:
        return None


def test_another_speed_keeps_the_tools_limit_where_the_axes_bend_the_path_between_its_records():
    random = np.random.default_rng(2026)
    planned = None
    while planned is None or not 40 < planned[0].record_count < 4000:
        planned = random_pass(random)
    ride = AxisRide(*planned)
    near = int(np.argmax(np.abs(np.diff(ride.joints, 2, axis=0)).max(axis=1)))
    for record in range(max(near - 10, 3), near + 10, 2):
        for what in (HALF, PAUSE):
            # The guard would make a fault of the tool's acceleration.
            assert_keeps(ride, record, what)


def test_no_axis_of_random_gimbals_exceeds_its_limits():
    random = np.random.default_rng(37)
    found = 0
    while found < CASES:
        planned = random_pass(random)
        if planned is None or not 40 < planned[0].record_count < 4000:
            continue
        found += 1
        ride = AxisRide(*planned)
        # Half of them where an axis turns fastest, or is bent most.
        steps = np.abs(np.diff(ride.joints, axis=0)).max(axis=1)
        for k in range(10):
            record = int(random.integers(3, len(ride.joints) - 20))
            if k % 2:
                near = int(np.argmax(steps if k % 4 == 1 else np.abs(np.diff(steps))))
                record = min(max(near - int(random.integers(0, 25)), 3), len(ride.joints) - 20)
            assert_keeps(ride, record, (STOP, PAUSE, HALF, RANDOM, KILLED)[k % 5], random)


@pytest.mark.parametrize("miss", [2, 5])
def test_a_change_of_speed_that_counts_no_axes_is_a_stop_off_the_path_and_a_fault(miss):
    motion, settings = plan_for(motion_file.parse(over_the_top(miss)))
    blind = queue.servo_limits_of(motion.facts.limits, 20.0)
    speed = np.abs(np.diff(motion.path.joints[:, 0]))
    ride = AxisRide(motion, settings, blind)
    ride.go_to(int(np.argmax(speed)))
    ride.set_speed(0.3)
    ride.run_until(lambda servo: not servo.is_moving)
    setpoints = ride.servo.setpoints
    assert (ride.servo.state, setpoints.fault) == (ServoState.FAULT, Fault.LIMIT_GUARD)
    assert "rad/s^2 of yaw, the limit is 39.9" in setpoints.fault_text
    assert max(ride.excess()) <= GUARD_TOLERANCE


def test_a_halt_off_the_path_is_within_the_limits_of_the_axes():
    motion, settings = plan_for(motion_file.parse(over_the_top(2)))
    for record in range(3, motion.record_count - 1, 8):
        ride = AxisRide(motion, settings)
        ride.go_to(record)
        ride.command(Command.HALT)
        ride.run_until(lambda servo: not servo.is_moving)
        assert ride.servo.state is ServoState.HOLDING, ride.servo.setpoints.fault_text
        assert max(ride.excess()) <= GUARD_TOLERANCE, record
        sent = ride.driver.sent[-1]
        ride.run(20)
        assert ride.driver.sent[-1] == pytest.approx(sent, abs=1e-9)


@pytest.mark.parametrize("miss", [2, 8])
def test_a_stop_where_another_motion_takes_over_keeps_the_limits_of_the_axes(miss):
    motion, settings = plan_for(motion_file.parse(over_the_top(miss)))
    ride = AxisRide(motion, settings)
    stopped = 0
    for record in range(24, motion.record_count - 24, 24):
        target = rotation.multiply(
            motion.sample([record * PERIOD]).q[0], rotation.exp([0, 0.6, 0.2])
        )
        try:
            new = DevicePlanner(driver_with(), limits=LIMITS, period=PERIOD).plan(
                MotionRequest([Keyframe(tuple(target.tolist()))], approach=True),
                start=motion.state_at(record),
                joints=motion.recorded().joints_at(record),
                before=motion.path.joints_before(record),
                rates=motion.recorded().joint_rates_at(record),
            )
        except PlanError:
            continue
        for after in (0, 5, 8, 14):
            ride.go_to(record - 8)
            ride.splice(new, record)
            ride.run(after)
            ride.command(Command.STOP)
            ride.come_to_rest()
            stopped += 1
            assert ride.servo.state is ServoState.HOLDING, ride.servo.setpoints.fault_text
            assert max(ride.excess()) <= GUARD_TOLERANCE, (record, after)
    assert stopped >= 20
