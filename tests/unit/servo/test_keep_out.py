"""Nothing inside a keep-out cone is written, by any command; cones that move do so slowly."""

import json
from dataclasses import replace
from math import degrees, radians

import numpy as np
import pytest
from rig import PERIOD, TERMS, RecordingLoopback, Rig, peaks, turn

from orientd.driver import ZERO, AxisLimits
from orientd.errors import Fault
from orientd.floats import exp, rotate
from orientd.keep_out import KeepOut
from orientd.mechanism import Gimbal
from orientd.servo.guard import Guard
from orientd.servo.keep_out_cones import MOST_DRIFT, KeepOutCones, Room
from orientd.servo.settings import ProcessSettings
from orientd.stream.records import NOT_GIVEN, Answer, Command, NoteKind, ServoState
from orientd.sun import Sun

LIMITS = (2.5, 17.0, 8500.0)


def about_z(degrees_):
    return exp((0.0, 0.0, radians(degrees_)))


def cone_at(azimuth, half_angle, name="laser"):
    a = radians(azimuth)
    return KeepOut(name, (float(np.cos(a)), float(np.sin(a)), 0.0), radians(half_angle))


def clearance(rig, cone):
    return degrees(min(cone.clearance(s.q, 0) for s in rig.driver.setpoints))


def keeps_limits(rig):
    return all(a <= b * 1.001 for a, b in zip(peaks(rig.sent()), LIMITS, strict=True))


def test_a_path_into_a_cone_is_stopped_with_a_fault_that_names_it():
    cone = cone_at(60.0, 10.0)
    rig = Rig(cones=(cone_at(-90.0, 30.0, "window"), cone))
    rig.start(turn(angle=1.5, axis=(0.0, 0.0, 1.0)))
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.cycle.fault == Fault.LIMIT_GUARD
    assert "inside the keep-out cone 'laser'" in rig.notes(NoteKind.FAULT)[0].text
    assert "deg" in rig.notes(NoteKind.FAULT)[0].text
    assert clearance(rig, cone) >= 0.0
    assert keeps_limits(rig)


@pytest.mark.parametrize("seed", range(12))
def test_a_path_that_a_cone_moves_into_is_stopped_outside_of_it(seed):
    random = np.random.default_rng(seed)
    now_ns = 1_780_000_000 * 10**9
    cone = KeepOut("sun", Sun(48.0, 11.0), random.uniform(0.05, 0.3))
    # The path leads through the place of the sun once the clock has been set.
    direction = np.array(cone.direction_at(now_ns))
    axis = np.cross([1.0, 0.0, 0.0], direction)
    path = turn(angle=2.5, duration=random.uniform(2.0, 4.0), axis=axis / np.linalg.norm(axis))
    set_by_ns = round(random.uniform(-30.0, 30.0) * 60e9)
    now_ns -= set_by_ns
    rig = Rig(cones=(cone,), unix_ns=lambda: now_ns)
    rig.start(path)
    rig.run(int(random.integers(1, 300)))
    now_ns += set_by_ns
    least, cones = np.inf, rig.servo.setpoints.cones
    while rig.servo.is_moving:
        rig.run()
        least = min(least, *cones.clearances(rig.driver.setpoints[-1].q))
    assert rig.cycle.fault == Fault.LIMIT_GUARD
    assert degrees(least) >= -0.01
    assert keeps_limits(rig)


@pytest.mark.parametrize(("step", "passes"), [(-0.001, True), (0.001, False), (0.0, True)])
def test_from_inside_only_a_setpoint_outwards_passes(step, passes):
    guard = Guard(PERIOD, KeepOutCones([cone_at(10.0, 20.0)], PERIOD))
    guard.anchor(about_z(0.0), ZERO)
    problem = guard.admit(about_z(step), ZERO, TERMS)
    assert (problem == "") is passes
    assert passes or "10 deg inside the keep-out cone 'laser'" in problem


def aim(rig, q, lives_ns=500_000_000):
    time_ns = rig.clock.now_ns()
    rig.memory.targets.publish(time_ns, time_ns + lives_ns, *q, 0.0, 0.0, 0.0, *NOT_GIVEN)


def tracked(cones, q, seconds=2.0):
    rig = Rig(cones=cones)
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    assert rig.ask(Command.TRACK)[0] is Answer.DONE
    for _ in range(round(seconds / 0.04)):
        aim(rig, q)
        rig.run(20)
    return rig


def test_a_tracked_target_inside_is_held_at_the_edge_and_a_stop_ends_there():
    cone = cone_at(60.0, 20.0)
    rig = tracked((cone,), about_z(55.0))
    assert rig.cycle.state is ServoState.TRACKING
    assert 0.0 <= degrees(cone.clearance(rig.cycle.q, 0)) < 0.15
    assert rig.ask(Command.STOP)[0] is Answer.DONE
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.cycle.state is ServoState.HOLDING
    assert clearance(rig, cone) >= 0.0
    assert keeps_limits(rig)


@pytest.mark.parametrize("cycles", range(20, 260, 40))
@pytest.mark.parametrize("command", [Command.STOP, Command.HALT])
def test_a_stop_of_tracking_towards_a_cone_ends_outside(command, cycles):
    cone = cone_at(60.0, 20.0)
    rig = tracked((cone,), about_z(70.0), seconds=0.0)
    aim(rig, about_z(70.0), lives_ns=10**10)
    rig.run(cycles)
    assert rig.ask(command)[0] is Answer.DONE
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.cycle.state is ServoState.HOLDING
    assert clearance(rig, cone) >= 0.0
    assert keeps_limits(rig)


def test_a_step_of_the_wall_clock_turns_the_sun_slowly():
    hour_ns = 3_600_000_000_000
    now_ns = 1_780_000_000 * 10**9
    cones = KeepOutCones([KeepOut("sun", Sun(48.0, 11.0), 0.1)], PERIOD, lambda: now_ns)
    before = np.array(cones.directions[0])
    now_ns += 6 * hour_ns
    for _ in range(500):
        cones.tick()
    after = np.array(cones.directions[0])
    assert np.linalg.norm(after - before) == pytest.approx(MOST_DRIFT, rel=0.01)
    for _ in range(500 * 180):
        cones.tick()
    assert cones.directions[0] == Sun(48.0, 11.0).direction(now_ns)


def test_the_sun_is_followed_by_the_wall_clock():
    now_ns = 1_780_000_000 * 10**9
    cones = KeepOutCones([KeepOut("sun", Sun(48.0, 11.0), 0.1)], PERIOD, lambda: now_ns)
    now_ns += 10**9
    for _ in range(500):
        cones.tick()
    assert cones.directions[0] == Sun(48.0, 11.0).direction(now_ns)


def test_the_clearance_of_a_tool_at_rest_is_that_of_a_cone_that_moves():
    now_ns = 1_780_000_000 * 10**9
    cone, q = KeepOut("sun", Sun(48.0, 11.0), 0.1), (1.0, 0.0, 0.0, 0.0)
    cones = KeepOutCones([cone], PERIOD, lambda: now_ns)
    room, begun = Room(cones), cones.clearances(q)[0]
    near = begun - 0.005
    assert not room.is_within(q, near)
    # The wall clock steps to where the sun is nearer, and its direction follows slowly.
    hours = 3_600_000_000_000, -3_600_000_000_000
    now_ns += min(hours, key=lambda hour: cone.clearance(q, now_ns + hour))
    for _ in range(500):
        cones.tick()
        room.shrink(0.0)
        (clearance,) = cones.clearances(q)
        assert clearance == pytest.approx(pointing_away(cones.directions[0], q, cone), abs=1e-12)
        assert room.is_within(q, near) == (clearance <= near)
    assert clearance < near


def pointing_away(direction, q, cone):
    """Return the angle from the tool's axis to the edge of a cone in a given direction."""
    return float(np.arccos(np.dot(rotate(q, cone.axis), direction))) - cone.half_angle


def test_cones_reach_the_servo_process_as_they_are():
    cones = (
        KeepOut("sun", Sun(48.0, 11.0, 80.0), 0.1, 0.2),
        KeepOut("mast", (0.0, 0.6, 0.8), 0.3, axis=(0.0, 0.0, 1.0)),
    )
    settings = ProcessSettings(
        "d", "m:D", {"a": 1}, 2_000_000, 0, 16, 16, 1, 1, 1, 0, 0, 1, "/r", keep_out=cones
    )
    text = settings.to_json()
    assert json.loads(text)["device"] == "d"
    assert ProcessSettings.from_json(text) == settings


class GimbalLoopback(RecordingLoopback):
    """A gimbal of two axes that takes joints and is slower than the poses."""

    takes = "joints"
    gimbal = Gimbal(
        (AxisLimits("pan", -6.0, 6.0, 4.0, 12.0), AxisLimits("tilt", -3.0, 3.0, 2.0, 6.0)),
        order="ZY",
        is_pointing=True,
    )

    def enable(self):
        joints = (0.0, 0.5)
        return super().enable()._replace(joints=joints, q=self.gimbal.forward(joints)[0])

    def mechanism(self, *, may_ask):
        return self.gimbal


@pytest.mark.parametrize("seed", range(4))
def test_the_axes_of_a_gimbal_keep_out_too(seed):
    random = np.random.default_rng(seed)
    forward = GimbalLoopback.gimbal.forward
    cones = (cone_at(50.0, 20.0), cone_at(-100.0, 12.0), KeepOut("up", (0.0, 0.0, 1.0), 0.15))
    rig = Rig(kind=GimbalLoopback, cones=cones)
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    assert rig.ask(Command.TRACK, servo_limits=replace(TERMS, acceleration=8.0))[0] is Answer.DONE
    for step in range(60):
        if step % 15 == 0:
            pan, tilt = random.uniform(-3.0, 3.0), random.uniform(-1.6, 1.0)
            q = forward((pan, tilt))[0]
        aim(rig, q)
        rig.run(20)
    rig.ask(Command.STOP)
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.cycle.state is ServoState.HOLDING
    assert min(clearance(rig, cone) for cone in cones) > -0.01
    joints = np.array([setpoint.joints for setpoint in rig.driver.setpoints])
    change = np.abs(np.diff(joints, 2, axis=0)).max(0) / PERIOD**2
    assert (change <= np.array([12.0, 6.0]) * 1.001).all()


@pytest.mark.parametrize("near", [True, False])
def test_a_halt_near_a_cone_stays_on_its_path(near):
    path, axis = turn(angle=1.5), np.array([0.6, 0.0, 0.8])
    here = np.array(rotate(tuple(path[0][400].tolist()), (1.0, 0.0, 0.0)))
    # Beside the path, on the outer side of its curve.
    aside = np.cross(here, np.cross(axis, here))
    aside *= -np.sign(aside @ axis) / np.linalg.norm(aside)
    centre = np.cos(0.2) * here + np.sin(0.2) * aside
    rig = Rig(cones=(KeepOut("beside", tuple(centre.tolist()), 0.18 if near else 0.05),))
    rig.start(path)
    rig.run(400)
    assert rig.ask(Command.HALT)[0] is Answer.DONE
    assert rig.servo.setpoints.pursuit.is_on is not near
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.cycle.state is ServoState.HOLDING
    assert keeps_limits(rig)
